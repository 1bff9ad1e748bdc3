"""``taubench-gl conformance``: small scenes with known motion, and the score of an engine's frames of them."""

from __future__ import annotations

import os
from pathlib import Path

import click

from taubench_gl.apps.options import AS_JSON, Commands, command, option_group
from taubench_gl.apps.screen import show_json, show_list, show_tables
from taubench_gl.apps.stages import STAGES
from taubench_gl.fields import setting
from taubench_gl.settings import OUTPUT, Settings

ONLY = setting((), "Only cases whose names contain this; may be repeated", metavar="NAME", repeats=True)


@click.group(cls=Commands)
def conformance() -> None:
    """Score the motion vectors of any engine on small scenes with known answers.  Needs no OpenGL."""


@command(settings=option_group(only=("size",), size="128x72"))
@click.argument("out", type=click.Path(path_type=Path), metavar="DIR")
def write(out: Path, settings: Settings, *, only: tuple[str, ...] = ONLY) -> None:
    """Write the scenes, the list of their frames and the instructions for an engine to DIR.

    Examples:
      taubench-gl conformance write suite
      taubench-gl conformance write suite --only skin --size 64x36
    """
    from taubench_gl.conformance.cases import select
    from taubench_gl.conformance.suite import README, write_suite

    STAGES.silence()
    cases = select(only)
    write_suite(cases, out, (settings.sequence.width, settings.sequence.height))
    click.echo(f"{len(cases)} cases written to {out}{os.sep}; read {out / README}")


@command()
@click.argument("spec", metavar="exr:DIR|npz:DIR")
def score(
    spec: str,
    *,
    mapping: str | None = setting(
        None, "Names and conventions of the passes: a preset or a TOML or JSON file", metavar="FILE",
        shown="taubench for the files of 'export', else blender",
    ),
    layer: str | None = setting(None, "Layer of the EXR files, if they hold several", metavar="NAME"),
    engine: str | None = setting(None, "Name and version of the engine, for the results", metavar="TEXT"),
    only: tuple[str, ...] = ONLY,
    allow_unjudged: bool = setting(False, "Exit with 0 where cases are not judged and none is wrong"),
    as_json: bool = AS_JSON,
    out: Path | None = setting(None, "Also write JSON, JUnit XML and a page", group=OUTPUT, metavar="DIR"),
) -> int:  # fmt: skip
    """Score the frames of an engine: DIR holds one folder for each case, with one file for each of its four frames.

    The exit code is 1 if vectors of a case are wrong, else 3 if a case is not judged, because its frames are missing or
    the scene was not loaded as written, else 0.

    Examples:
      taubench-gl conformance score exr:frames --mapping engine.toml --out scored
      taubench-gl conformance score npz:frames --mapping engine.toml --only morph --json
    """
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.conformance.cases import select
    from taubench_gl.conformance.frames import EngineFrames
    from taubench_gl.conformance.output import save_scores, score_summary, score_tables
    from taubench_gl.conformance.score import score_cases
    from taubench_gl.pathtraced.check_vectors import exit_code, overall

    STAGES.silence()  # scenes are read in milliseconds, one for each case
    frames, sizes = EngineFrames(spec, mapping, layer), {}
    cases = select(only)
    with ProgressBar(spec, "cases") as bar:

        def scored(name: str, size: tuple[int, int]) -> None:
            sizes[name] = size
            bar.step(len(sizes), len(cases), name)

        scores = score_cases(cases, frames, scored)
    about = {"engine": engine or frames.folder.resolve().name, "frames": spec, "mapping": mapping,
             "sizes": sorted({f"{w}x{h}" for w, h in sizes.values()})}  # fmt: skip
    summary = score_summary(scores, about)
    if as_json:
        show_json(summary)
    else:
        show_tables(score_tables(scores, summary))
    if out is not None:
        save_scores(scores, summary, sizes, out)
        click.echo(f"written to {out}{os.sep}", err=as_json)
    return exit_code(overall({score.status for score in scores}), allow_unjudged)


@command("list")
def list_cases(*, as_json: bool = AS_JSON) -> None:
    """List the cases: their names and the classes of pixels that they are about.

    Examples:
      taubench-gl conformance list
    """
    from taubench_gl.conformance.cases import CASES

    if as_json:
        show_json({name: {"classes": list(c.about), "extensions": list(c.extensions)} for name, c in CASES.items()})
    else:
        show_list({name: ", ".join((*case.about, *case.extensions)) for name, case in CASES.items()})


@command()
@click.argument("name", metavar="CASE")
def show(name: str) -> None:
    """Show what CASE is about: its text, classes and extensions.

    Examples:
      taubench-gl conformance show jitter
    """
    from taubench_gl.conformance.cases import CASES
    from taubench_gl.conformance.suite import case_text
    from taubench_gl.errors import SettingsError

    if name not in CASES:
        raise SettingsError(f"no case is named {name!r}", hint="see 'taubench-gl conformance list'")
    click.echo(case_text(CASES[name]).removeprefix("## "))


for member in (write, score, list_cases, show):
    conformance.add_command(member)
