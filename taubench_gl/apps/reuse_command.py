"""``taubench-gl reuse``: temporal reuse methods, built-in ones and your own."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import AS_JSON, GPU, Commands, command, option_group
from taubench_gl.apps.reuse_evaluate_command import evaluate, fit
from taubench_gl.apps.screen import show_json, show_list
from taubench_gl.errors import SettingsError
from taubench_gl.fields import setting
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    from taubench_gl.reuse.contract import Method

FULL_HD = (1920, 1080)


def _pairs(texts: Any) -> Any:
    """Names and values of texts such as ``alpha=0.2``, as pairs; the method checks the values."""
    pairs = tuple(tuple(part.strip() for part in text.partition("=")[::2]) for text in texts)
    for text, pair in zip(texts, pairs, strict=True):
        if not all(pair):
            raise SettingsError(f"{text!r} is not a setting", hint="give one such as alpha=0.1")
    return pairs


def parsed_settings(method: Method, assignments: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    """Setting -> value in its type, from (name, text) pairs of the command line; all others at their default.  Raises
    MethodError.
    """
    parsed = {n: method.settings[n].parse(text) if n in method.settings else text for n, text in assignments}
    return method.values(parsed)


@click.group(cls=Commands)
def reuse() -> None:
    """Temporal reuse methods: built-in ones and your own (docs/reuse.md)."""


@command("list")
def list_methods(*, as_json: bool = AS_JSON) -> None:
    """List the methods that have a name: built-in, or installed by other packages.

    Examples:
      taubench-gl reuse list
      taubench-gl reuse list --json
    """
    from taubench_gl.errors import MethodError
    from taubench_gl.reuse.loading import builtin_methods, installed_methods, load_method

    rows = {}
    for name in (*builtin_methods(), *installed_methods()):
        try:
            rows[name] = load_method(name).title
        except MethodError as error:
            rows[name] = f"unusable: {error}"
    if as_json:
        show_json(rows)
        return
    show_list(rows)


@command()
@click.argument("name", metavar="NAME|PATH")
def show(name: str, *, as_json: bool = AS_JSON) -> None:
    """Show citation, inputs, settings, passes and memory of a method.  Needs no OpenGL.

    Examples:
      taubench-gl reuse show svgf
      taubench-gl reuse show my-method --json
    """
    from taubench_gl.apps.screen import show_pairs
    from taubench_gl.reuse.loading import load_method

    method = load_method(name)
    facts = describe(method)
    if as_json:
        show_json(facts, finite=False)
        return
    show_pairs(
        f"Method {method.name}: {method.title}",
        {
            "reference": "; ".join(facts["cite"]) or None,
            "generates": _generates(facts["generates"]),
            "reads": ", ".join(facts["reads"]),
            "history": ", ".join(f"{n} ({f})" for n, f in facts["history"].items()) or "none declared",
            "buffers": ", ".join(f"{n} ({f})" for n, f in facts["buffers"].items()) or "none",
            "reports": ", ".join(facts["reports"]) or "nothing: an evaluation gives it no bound",
            "memory at 1920x1080": f"{facts['bytes_1080p'] / 1e6:.1f} MB of textures",
            "from": facts["where"],
        },
    )
    settings = {n: f"{_short(s['default'])}   {s['allowed']}: {s['doc']}" for n, s in facts["settings"].items()}
    passes = {p["shader"]: f"x {p['repeat']}, writes {', '.join(p['writes'])}" for p in facts["passes"]}
    stages = {s["name"]: _stage(s) for s in facts["stages"]}
    for title, lines in (("Stages of the paper", stages), ("Settings", settings), ("Passes", passes)):
        if lines:
            show_pairs(title, lines)


def _generates(kind: str | None) -> str:
    return "no frames" if kind is None else f"{kind}: N - 1 frames per rendered one (reuse evaluate --render-every N)"


def _stage(stage: dict[str, Any]) -> str:
    state = "done" if stage["missing"] is None else f"MISSING ({stage['missing']})"
    where = f", {stage['shader']}" if stage["shader"] else ""
    return f"{state}{where}: {stage['doc']} ({stage['paper']})"


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value).lower()


def describe(method: Method) -> dict[str, Any]:
    """What ``reuse show --json`` prints of a method, as JSON values."""
    return {
        "name": method.name,
        "title": method.title,
        "cite": list(method.cite),
        "generates": method.generates,
        "reads": list(method.reads),
        "history": {n: f.name for n, f in method.history.items()},
        "buffers": {n: f.name for n, f in method.buffers.items()},
        "reports": list(method.reports),
        "settings": {
            n: {"default": s.default, "min": s.minimum, "max": s.maximum, "choices": list(s.choices), "scale": s.scale,
                "allowed": s.allowed, "doc": s.doc}
            for n, s in method.settings.items()
        },
        "passes": [
            {"shader": p.shader, "reads": list(p.reads), "writes": list(p.writes), "repeat": p.repeat,
             "block": list(p.block) if p.block else None}
            for p in method.passes
        ],
        "keyframe": method.keyframe,
        "stages": [asdict(stage) for stage in method.stages],
        "bytes_1080p": method.bytes(FULL_HD),
        "where": method.where,
    }  # fmt: skip


@command()
@click.argument("path", metavar="NAME|PATH", type=click.Path(path_type=Path))
def new(
    path: Path,
    *,
    python: bool = setting(False, "Write a Python class (NAME.py) instead of a folder with GLSL; default for NAME.py"),
    samples: bool = setting(
        False, "Write a method that computes direct light itself, from samples of lights and shadow rays"
    ),
) -> None:
    """Write a working example: a folder with method.toml and GLSL, or one Python file.

    Examples:
      taubench-gl reuse new my-method
      taubench-gl reuse check my-method
      taubench-gl reuse new my-method --python
      taubench-gl reuse new my-reservoirs --samples
    """
    from taubench_gl.reuse.check import write_example

    python = python or path.suffix == ".py"
    if python and samples:
        raise SettingsError("a method that samples lights is written in GLSL", hint="leave out --python")
    files = write_example(path, python, samples)
    for file in files:
        click.echo(f"written: {file}")
    click.echo(f"try it: taubench-gl reuse check {shlex.quote(str(files[0] if python else path))}")


@command(settings=option_group(only=GPU))
@click.argument("path", metavar="NAME|PATH")
def check(
    path: str,
    settings: Settings,
    *,
    assignments: tuple[tuple[str, str], ...] = setting(
        (), "Value of a setting; may be repeated", flag="--set", metavar="NAME=V", read=_pairs, repeats=True
    ),
) -> None:
    """Validate a method, compile it, and run it over a small synthetic sequence.

    Examples:
      taubench-gl reuse check my-method
      taubench-gl reuse check my_method.py:Variant --set alpha=0.05
    """
    from taubench_gl.gpu.context import open_gpu
    from taubench_gl.reuse.check import check_method
    from taubench_gl.reuse.loading import load_method

    method = load_method(path)
    values = parsed_settings(method, assignments)
    gpu = open_gpu(settings.device.backend, settings.device.device)
    with gpu:
        report = check_method(gpu, method, values)
    kind = "a Python class" if method.factory else f"{len(method.passes)} pass{'es' * (len(method.passes) != 1)}"
    reused = "not reported (alpha of the result is -1)" if report.reused is None else f"{100 * report.reused:.0f} %"
    click.echo(f"{method.name}: {method.title}: valid, {kind}, {method.bytes(FULL_HD) / 1e6:.1f} MB at 1920x1080")
    click.echo(f"ran {report.frames} frames of {report.size[0]}x{report.size[1]}; every pixel finite")
    plain = report.error_without_reuse
    other = "last rendered frame" if method.generates else "no reuse"
    beside = "" if plain is None else f" ({other} {plain:.4f})"
    click.echo(f"error against the noise-free frames {report.error:.4f}{beside}")
    click.echo(f"weight of history, mean over pixels: {reused}")


for member in (list_methods, show, new, check, evaluate, fit):
    reuse.add_command(member)
