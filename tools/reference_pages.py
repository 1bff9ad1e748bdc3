"""Pages made of the help, docstrings and tables of the package: docs/commands/, api.md, glossary.md and repairs.md.

``tools/record commands`` writes them.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path

import click

from taubench_gl import glossary
from taubench_gl.apps.cli import cli
from taubench_gl.apps.options import Command
from taubench_gl.fields import declared
from taubench_gl.scene import notes
from taubench_gl.settings import GROUPS

DOCS = Path(__file__).resolve().parents[1] / "docs"
PROGRAM = "taubench-gl"
WIDTH = 100

MODULES: dict[str, tuple[str, ...]] = {
    "taubench_gl": (
        "evaluate",
        "pairs",
        "Pair",
        "reuse_evaluate",
        "TrainingWindows",
        "ExportedFrames",
        "RenderedFrames",
        "Settings",
        "load_preset",
        "Run",
        "load_run",
        "load_scene",
        "sample",
        "TaubenchError",
    ),
    "taubench_gl.evaluation": ("evaluate_scene", "Explanation", "PairEvaluator"),
    "taubench_gl.metrics.reprojection": ("Reprojection", "reproject"),
    "taubench_gl.metrics.masks": ("pair_masks", "PairMasks"),
    "taubench_gl.metrics.activity": ("camera_activity", "detect_cuts"),
}
"""The public Python interface by module, in the order of the page."""

API_HEAD = """# Python interface

`import taubench_gl as tb` provides the names of the first section.  Errors that a caller can cause are subclasses of
`TaubenchError`, with one line of text.  Importing never opens OpenGL; scenes, metrics, tables and stored runs work on
machines without it.

This page is written by `tools/record commands` from the docstrings.


## Examples

Run them in the folder of the project.  [notebooks/api.ipynb](notebooks/api.ipynb) shows the same in a notebook.

An evaluation takes the options of [`taubench-gl evaluate`](commands/evaluate.md) by name, as the command line spells
them or as Python values:

```python
import taubench_gl as tb

scene = "assets/demo.glb"
run = tb.evaluate(scene, size="320x180", frames=range(0, 4), indirect="none")
print(run.summary["reusable"]["surface"]["mean_percent"])  # % of surface pixels
print(run.table())  # as HTML in a notebook
run.plot().savefig("frames.png")  # discard rate over time, a Matplotlib figure
```

The counts of every pair, as a list of dictionaries or as a pandas table:

```python
print(run.frames[0]["position"])
print(run.to_pandas()[["frame", "pixels", "frustum", "position", "normal"]])
```

The images of every pair, as NumPy arrays, row 0 at the top.  `pair.mask` holds bits of `Reason`
([conventions.md](conventions.md)):

```python
for pair in tb.pairs(scene, size="320x180", frames="0:3", columns="frustum,position,normal", reprojection="motion"):
    disoccluded = (pair.mask & tb.Reason.DISOCCLUDED) != 0
    print(pair.frame, disoccluded.mean(), abs(pair.motion).max())
    print(pair.explain(160, 90))
    if pair.color is None:
        print("no color:", pair.unmeasured["color"])
```

Their light as reuse methods get it, by the words of [`reuse evaluate --input`](reuse-evaluation.md#inputs---input),
and the reference that methods are compared with, linear radiance; and the methods themselves:

```python
size = {"size": "96x54", "frames": range(0, 3), "reprojection": "motion"}
for pair in tb.pairs(scene, input="path-traced@1", reference="path-traced@4", **size):
    print(pair.frame, abs(pair.noisy[..., :3] - pair.reference).mean(), pair.radiance.shape)
done = tb.reuse_evaluate(
    scene, ["none", "svgf"], tb.Settings(**size), input="path-traced@1", reference="path-traced@4", metrics=["psnr"]
)
print(done.summary["methods"]["svgf"]["mean"]["psnr_db"])
```

The same during an evaluation:

```python
masks = {}
options = {"size": (320, 180), "frames": (0, 3), "columns": ["position"]}
tb.evaluate(scene, on_pair=lambda pair: masks.update({pair.frame: pair.mask}), **options)
print(masks[1].shape)
```

Settings that several evaluations share:

```python
settings = tb.Settings(size="320x180", frames=range(3), columns="frustum,position", thresholds={"position": 0.05})
for reprojection in ("camera", "motion"):
    print(tb.evaluate(scene, settings, reprojection=reprojection))
```

A wrong name or value is a `TaubenchError` of one line:

```python
try:
    tb.evaluate(scene, widht=320)
except tb.TaubenchError as error:
    print(error)  # no setting is named 'widht' (did you mean width?)
```
"""


def commands(command: click.Command = cli, path: tuple[str, ...] = (PROGRAM,)) -> Iterator[tuple[tuple[str, ...], str]]:
    """(path, help text) of the program, its commands and their subcommands, groups before their members."""
    # The same names as in the program: click caches the help option of the first context.
    names = cli.context_settings["help_option_names"]
    context = click.Context(
        command, info_name=" ".join(path), terminal_width=WIDTH, max_content_width=WIDTH, help_option_names=names
    )
    yield path, command.get_complete_help(context) if isinstance(command, Command) else command.get_help(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            member = command.get_command(context, name)
            if member is not None and not member.hidden:
                yield from commands(member, (*path, name))


def command_pages() -> dict[str, str]:
    """File name -> Markdown: one page per top-level command, its subcommands on it, and an index."""
    pages: dict[str, str] = {}
    index = [f"# Commands of {PROGRAM}\n\nWritten by `tools/record commands` from the `--help` texts.\n"]
    for path, text in commands():
        if len(path) == 1:
            continue
        name = f"{path[1]}.md"
        if len(path) == 2:
            first = next(line.strip() for line in text.splitlines()[1:] if line.strip())
            index.append(f"- [{' '.join(path[1:])}]({name}): {first}")
            pages[name] = f"# {' '.join(path)}\n"
        else:
            pages[name] += f"\n## {' '.join(path)}\n"
        pages[name] += f"\n```text\n{text.strip()}\n```\n"
    pages["README.md"] = "\n".join(index) + "\n"
    return pages


def api_page() -> str:
    """docs/api.md: signatures and docstrings of MODULES."""
    out = [API_HEAD]
    for module, names in MODULES.items():
        out.append(f"\n## {module}\n")
        for name in names:
            out += _entry(name, getattr(importlib.import_module(module), name), "###")
            out += _members(name, getattr(importlib.import_module(module), name))
            out += settings_table() if name == "Settings" else []
    return "\n".join(out).rstrip() + "\n"


def _entry(name: str, thing: object, level: str) -> list[str]:
    text = inspect.getdoc(thing) or ""
    signature = _signature(name.rsplit(".", 1)[-1], thing)
    return [f"{level} {name}\n", f"```python\n{signature}\n```\n", f"{text}\n"]


def settings_table() -> list[str]:
    """Every setting: name, default, allowed values and meaning, by group."""
    out = []
    for group, kind in GROUPS.items():
        out.append(f"#### Settings.{group}\n\n{inspect.getdoc(kind)}\n")
        out.append("| setting | default | unit | allowed | meaning |\n|---|---|---|---|---|")
        for field in declared(kind).values():
            shown = field.shown or f"`{field.default!r}`"
            allowed = field.check.text if field.check else ""
            cells = (f"`{field.name}`", shown, field.unit, allowed, field.meaning)
            out.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        out.append("")
    return out


def _members(owner: str, thing: object) -> list[str]:
    """Entries of the public methods of a class that have a docstring."""
    if not inspect.isclass(thing) or issubclass(thing, Exception):
        return []
    out = []
    for name, attribute in vars(thing).items():
        member = attribute.__func__ if isinstance(attribute, staticmethod) else attribute
        if isinstance(member, property | cached_property) and not name.startswith("_") and inspect.getdoc(member):
            out += [f"#### {owner}.{name}\n", f"{inspect.getdoc(member)}\n"]
        if inspect.isfunction(member) and not name.startswith("_") and member.__doc__:
            out += _entry(f"{owner}.{name}", member, "####")
    return out


def _signature(name: str, thing: object) -> str:
    """The signature as in the source, on one line if it fits."""
    try:
        signature = inspect.signature(thing)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return name
    parameters = list(_parameters(signature))
    returns = "" if signature.return_annotation is inspect.Signature.empty else f" -> {signature.return_annotation}"
    line = f"{name}({', '.join(parameters)}){returns}"
    return line if len(line) <= WIDTH else f"{name}(\n{''.join(f'    {p},{chr(10)}' for p in parameters)}){returns}"


def _parameters(signature: inspect.Signature) -> Iterator[str]:
    """Each parameter except ``self``, with the star before the first keyword-only one."""
    starred = False
    for name, parameter in signature.parameters.items():
        if name == "self":
            continue
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and not starred:
            starred = True
            yield "*"
        stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        starred = starred or stars == "*"
        text = stars + name
        if parameter.annotation is not inspect.Parameter.empty:
            text += f": {parameter.annotation}"
        if parameter.default is not inspect.Parameter.empty:
            text += f" = {parameter.default!r}"
        yield text


_GLOSSARY_HEAD = """# Glossary

This page is written by `tools/record commands` from `taubench_gl/glossary.toml`. The help of the command line
and the tooltips of the report and of the viewer show the same sentences. Equations are the paper's;
[conventions.md](conventions.md) explains what the paper leaves open.
"""


def glossary_page() -> str:
    """The Markdown text of docs/glossary.md."""
    bits = {reason: str(int(reason)) for reason in glossary.REASONS}
    return "\n".join(
        (
            _GLOSSARY_HEAD,
            *_section("Concepts", glossary.CONCEPTS.values()),
            *_section(
                "Reasons",
                glossary.REASONS.values(),
                "Each pixel of a pair has a mask of reason bits. The column *bit* is the value in exported masks.",
                tuple(bits.values()),
            ),
            *_section(
                "Reasons of pixels that are not reusable",
                glossary.REUSE_REASONS.values(),
                "Disjoint: a pixel counts once, under the first reason of this list that applies. The reasons and the "
                "reuse rate add up to 100 %.",
            ),
            *_section(
                "Columns of Table 4",
                glossary.COLUMNS.values(),
                "A column counts the pixels that it discards. The unit is that of the threshold.",
            ),
            *_section("Camera activity (Tables 2 and 3)", glossary.CAMERA.values()),
            *_section("Statistics", glossary.STATISTICS.values()),
            *_section("Exact visibility", glossary.EXACT.values()),
            *_section("Scene statistics (Table 1)", glossary.CENSUS.values()),
            *_section(
                "Columns of frames.csv",
                glossary.FRAMES.values(),
                "One row per pair; an empty cell was not measured. A count column holds the number of pixels that have "
                "the reason.",
            ),
            *_section("Reprojection, sampling and history", glossary.OPTIONS.values()),
        )
    )


def _section(title: str, terms: Iterable[glossary.Term], text: str = "", bits: tuple[str, ...] = ()) -> list[str]:
    """A heading and a Markdown table; ``bits`` adds a column."""
    terms = list(terms)
    heads = ["key", "label", *(["bit"] if bits else []), "definition", "unit", "source"]
    lines = [f"## {title}\n", *([f"{text}\n"] if text else [])]
    lines += ["| " + " | ".join(heads) + " |", "| " + " | ".join("---" for _ in heads) + " |"]
    for number, term in enumerate(terms):
        bit = [bits[number]] if bits else []
        lines.append(
            "| " + " | ".join([f"`{term.key}`", term.label, *bit, term.definition, term.unit, term.source]) + " |"
        )
    return [*lines, ""]


def repairs_page() -> str:
    """docs/repairs.md: every kind of counted note."""
    lines = [
        "# Repairs and remarks of the scene readers",
        "",
        "This page is generated by `tools/record commands`. A scene has at most one note of each kind, with "
        "the number of findings and the place of the first; `kind` and `count` are fields of `Scene.notes`. What is "
        "never repaired is in [formats](formats.md).",
    ]
    for title, text, kinds in (
        ("Repairs", "Refused by `--strict` and `load_scene(path, strict=True)`.", notes.REPAIRS),
        ("Remarks", "Noted in every mode.", notes.REMARKS),
    ):
        lines += [
            "",
            f"## {title}",
            text,
            "",
            "| kind | what is counted | what the reader does |",
            "| --- | --- | --- |",
        ]
        rows = ((name, kind.counted.replace("{s}", "s"), kind.consequence) for name, kind in kinds.items())
        lines += [f"| `{name}` | {counted} | {consequence} |" for name, counted, consequence in rows]
    return "\n".join(lines) + "\n"


def pages() -> dict[Path, str]:
    """Path -> text of every page that this module makes."""
    out = {DOCS / "commands" / name: text for name, text in command_pages().items()}
    out |= {DOCS / "api.md": api_page(), DOCS / "glossary.md": glossary_page()}
    return out | {DOCS / "repairs.md": repairs_page()}
