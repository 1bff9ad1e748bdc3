"""``taubench-gl cost``: what accuracy costs in time, and which settings to use."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.accuracy_options import accuracy_options, removed_option
from taubench_gl.apps.evaluate_command import out_folders
from taubench_gl.apps.options import (
    OutPath,
    Words,
    frame_options,
    gpu_options,
    light_options,
    pair_options,
    settings_from,
)
from taubench_gl.conventions import COLUMNS
from taubench_gl.errors import TaubenchError
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    from taubench_gl.cost.job import Step


@click.command(
    epilog="""\b
Examples:
  taubench-gl cost scene.glb --out study --size 480x270
  taubench-gl cost scene.glb --out study --within 0.5 --for direct,position
  taubench-gl cost scene.glb --out study --budget-ms 20
  taubench-gl cost scene.glb --out study --knobs shadow_size,shadow_filter,pairs
  taubench-gl cost scene.glb --out study --knobs method:taa_variance@gamma=0.5:2:4,method:svgf
  taubench-gl cost scene.glb --out study --reference exr:rungs     # rungs/spp_1, rungs/spp_16, ...
  taubench-gl evaluate scene.glb --preset study/preset.toml
\b
DIR holds study.json, tables (text, Markdown, CSV), plots (PNG, SVG), study.html to point at, with --within or
--budget-ms preset.toml, and records.jsonl: killed and called again, a study goes on where it stopped."""
)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
@click.option("--out", type=OutPath(), required=True, metavar="DIR", help="Folder of the study.")
@click.option(
    "--knobs",
    metavar="LIST",
    help="Dials to turn, comma-separated, see --list-knobs.  method:NAME@setting=VALUES judges a reuse method by its "
    "pictures; VALUES: one, lo:hi:n or a/b/c.  [default: all but methods]",
)
@click.option(
    "--method-input",
    "method_inputs",
    metavar="LIST",
    default="noisy+jittered",
    show_default=True,
    help="What methods are given, comma-separated kinds of 'reuse evaluate --input'.",
)
@click.option(
    "--reference",
    metavar="best|exr:DIR",
    default="best",
    show_default=True,
    help="What errors are measured against: every dial at its best, or path-traced renders, whose sample counts then "
    "stand on the plot.",
)
@click.option("--within", type=float, metavar="POINTS", help="Choose the cheapest settings with errors up to this.")
@click.option("--budget-ms", type=float, metavar="T", help="Choose the most exact settings up to T ms a frame.")
@click.option(
    "--for", "wished", type=Words(*COLUMNS, verb="choose for"), help="Columns the choice is for.  [default: all]"
)
@click.option(
    "--repeats", type=int, default=5, show_default=True, help="Rounds in which every setting is timed, in turn."
)
@removed_option("--front", "only declared configurations are measured")
@click.option("--fresh", is_flag=True, help="Forget what an earlier study measured in DIR.")
@click.option("--list-knobs", is_flag=True, is_eager=True, expose_value=False, callback=lambda c, p, v: _list(c, v),
              help="Print the dials and end.")  # fmt: skip
@frame_options()
@pair_options()
@light_options
@accuracy_options
@gpu_options
def cost(scenes: tuple[str, ...], out: Path, knobs: str | None, **options: Any) -> int:
    """Measure error and time of every setting that trades one for the other, and say which to use.

    The options below describe the base; each dial is turned away from it, one at a time and in declared combinations.
    Errors are in points, percent of w x h, against the reference.  Times are taken in turn, A B C A B C, after a
    warm-up; what is within the spread is called no difference.  Several scenes get one folder each inside DIR.
    """
    wishes = {name: options.pop(name) for name in ("reference", "within", "budget_ms", "repeats", "fresh")}
    wishes["choose_for"] = options.pop("wished") or None
    wishes["knobs"] = None if knobs is None else _listed(knobs)
    wishes["method_inputs"] = _listed(options.pop("method_inputs"))
    settings = settings_from(options)
    failed = 0
    for scene, folder in zip(scenes, out_folders(scenes, out), strict=True):
        try:
            _one(scene, settings, folder, wishes)
        except TaubenchError as error:
            if len(scenes) == 1:
                raise
            click.echo(f"taubench-gl: error: {error}", err=True)
            failed += 1
    return 2 if failed else 0


def _listed(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _one(scene: str, settings: Settings, folder: Path, wishes: dict[str, Any]) -> None:
    from taubench_gl.cost.study import cost as run_study
    from taubench_gl.report.study_tables import study_text

    try:
        study = run_study(scene, settings, out=folder, progress=_Said(Path(scene).name), **wishes)
    except KeyboardInterrupt:
        click.echo(f"taubench-gl: interrupted; what is measured is in {folder}, the same command goes on", err=True)
        raise click.exceptions.Exit(130) from None
    study.save()
    click.echo(study_text(study.as_json()), nl=False)
    click.echo(f"written to {folder}{os.sep}")


def _list(context: click.Context, wanted: bool) -> None:
    if not wanted or context.resilient_parsing:
        return
    from taubench_gl.cost.parameters import KNOBS

    for knob in KNOBS.values():
        values = ", ".join(map(str, knob.values))
        click.echo(f"{knob.name}: {values}{'' if knob.kind == 'accuracy' else '  (another question)'}\n    {knob.doc}")
    click.echo(
        "method:NAME@setting=VALUES  (another quantity)\n    a reuse method, judged by its pictures: "
        "'taubench-gl reuse list' names them, 'reuse show NAME' their settings"
    )
    context.exit()


class _Said:
    """Progress on standard error: one line that is written over on a terminal, about twenty lines elsewhere."""

    STEPS = 20

    def __init__(self, name: str):
        self._name, self._said = name, -1

    def __call__(self, step: Step) -> None:
        line = f"{self._name}: {step.done}/{step.total}, {step.what}"
        if sys.stderr.isatty():
            click.echo(f"\r\033[K{line}", nl=False, err=True)
            if step.done >= step.total:
                click.echo("", err=True)
            return
        part = step.done * self.STEPS // max(step.total, 1)
        if part != self._said:
            self._said = part
            click.echo(line, err=True)
