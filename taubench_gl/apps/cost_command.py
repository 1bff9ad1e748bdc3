"""``taubench-gl cost``: accuracy against time, and which configuration to use."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.accuracy_options import accuracy_options, removed_option
from taubench_gl.apps.aliases import former_option
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
    from taubench_gl.cost.study import Step


def _list_parameters(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if not wanted or context.resilient_parsing:
        return
    from taubench_gl.cost.parameters import PARAMETERS

    for parameter in PARAMETERS.values():
        values = ", ".join(map(str, parameter.values))
        note = "" if parameter.kind == "accuracy" else "  (changes the definition of the metric, not comparable)"
        click.echo(f"{parameter.name}: {values}{note}\n    {parameter.doc}")
    click.echo(
        "method:NAME@setting=VALUES\n    a reuse method, evaluated by its images: 'taubench-gl reuse list' lists the "
        "methods, 'reuse show NAME' their settings"
    )
    context.exit()


@click.command(
    epilog="""\b
Examples:
  taubench-gl cost scene.glb --out study --size 480x270
  taubench-gl cost scene.glb --out study --within 0.5 --for direct,position
  taubench-gl cost scene.glb --out study --budget-ms 20
  taubench-gl cost scene.glb --out study --parameters shadow_size,shadow_filter,pairs
  taubench-gl cost scene.glb --out study --parameters method:taa_variance@gamma=0.5:2:4,method:svgf
  taubench-gl cost scene.glb --out study --reference exr:renders     # renders/spp_1, renders/spp_16, ...
  taubench-gl evaluate scene.glb --preset study/preset.toml
\b
DIR receives study.json, tables (text, Markdown, CSV), plots (PNG, SVG), study.html (interactive), with --within or
--budget-ms preset.toml, and records.jsonl: run again after an interruption, the study resumes."""
)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
@click.option("--out", type=OutPath(), required=True, metavar="DIR", help="Folder of the study.")
@click.option(
    "--parameters",
    metavar="LIST",
    help="Parameters to vary, comma-separated, see --list-parameters.  method:NAME@setting=VALUES evaluates a reuse "
    "method by its images; VALUES: one, lo:hi:n or a/b/c.  [default: all but methods]",
)
@former_option("--knobs", "--parameters")
@click.option(
    "--method-input",
    "method_inputs",
    metavar="LIST",
    default="noisy+jittered",
    show_default=True,
    help="Input of the methods, comma-separated kinds of 'reuse evaluate --input'.",
)
@click.option(
    "--reference",
    metavar="highest-quality|exr:DIR",
    default="highest-quality",
    show_default=True,
    help="Reference of the errors: every parameter at its best value, or path-traced renders, whose sample counts are "
    "then part of the plots.",
)
@click.option("--within", type=float, metavar="PP", help="Choose the fastest configuration with errors up to PP.")
@click.option("--budget-ms", type=float, metavar="T", help="Choose the most exact configuration up to T ms per frame.")
@click.option(
    "--for",
    "choose_for",
    type=Words(*COLUMNS, verb="choose for"),
    help="Columns that the choice is for.  [default: all]",
)
@click.option("--repeats", type=int, default=5, show_default=True, help="Interleaved rounds of timing.")
@removed_option("--front", "only declared configurations are measured")
@click.option("--fresh", is_flag=True, help="Discard the records in DIR and measure from scratch.")
@click.option("--list-parameters", is_flag=True, is_eager=True, expose_value=False, callback=_list_parameters,
              help="Print the parameters and exit.")  # fmt: skip
@former_option("--list-knobs", "--list-parameters")
@frame_options()
@pair_options()
@light_options
@accuracy_options
@gpu_options
def cost(scenes: tuple[str, ...], out: Path, parameters: str | None, **options: Any) -> int:
    """Measure error and time of configurations that trade accuracy for time, and recommend one.

    The options below are the baseline.  Each parameter is changed one at a time and in declared combinations.  Errors
    are in percentage points (pp) of w x h against the reference.  Times are measured in interleaved rounds, A B C
    A B C, after a warm-up.  With several scenes, each gets a folder inside DIR.
    """
    names = ("reference", "within", "budget_ms", "repeats", "fresh", "choose_for")
    request = {name: options.pop(name) for name in names}
    request["parameters"] = None if parameters is None else _split(parameters)
    request["method_inputs"] = _split(options.pop("method_inputs"))
    settings = settings_from(options)
    failed = 0
    for scene, folder in zip(scenes, out_folders(scenes, out), strict=True):
        try:
            _run(scene, settings, folder, request)
        except TaubenchError as error:
            if len(scenes) == 1:
                raise
            click.echo(f"taubench-gl: error: {error}", err=True)
            failed += 1
    return 2 if failed else 0


def _split(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _run(scene: str, settings: Settings, folder: Path, request: dict[str, Any]) -> None:
    from taubench_gl.cost.study import cost as run_study
    from taubench_gl.report.cost_tables import cost_text

    try:
        study = run_study(scene, settings, out=folder, progress=_Progress(Path(scene).name), **request)
    except KeyboardInterrupt:
        click.echo(f"taubench-gl: interrupted; the records are in {folder}, the same command resumes", err=True)
        raise click.exceptions.Exit(130) from None
    study.save()
    click.echo(cost_text(study.as_json()), nl=False)
    click.echo(f"written to {folder}{os.sep}")


class _Progress:
    """Progress on standard error: one line that is overwritten on a terminal, about twenty lines elsewhere."""

    LINES = 20

    def __init__(self, name: str):
        self._name, self._printed = name, -1

    def __call__(self, step: Step) -> None:
        line = f"{self._name}: {step.done}/{step.total}, {step.what}"
        if sys.stderr.isatty():
            click.echo(f"\r\033[K{line}", nl=False, err=True)
            if step.done >= step.total:
                click.echo("", err=True)
            return
        part = step.done * self.LINES // max(step.total, 1)
        if part != self._printed:
            self._printed = part
            click.echo(line, err=True)
