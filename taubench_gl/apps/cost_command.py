"""``taubench-gl cost``: accuracy against time, and which configuration to use."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.accuracy_options import accuracy_options
from taubench_gl.apps.evaluate_command import out_folders
from taubench_gl.apps.options import (
    List,
    OutPath,
    frame_options,
    gpu_options,
    light_options,
    pair_options,
    settings_from,
)
from taubench_gl.errors import TaubenchError
from taubench_gl.features import COLUMNS
from taubench_gl.settings import Settings

if TYPE_CHECKING:
    from taubench_gl.cost.study import Step


def _list_parameters(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if not wanted or context.resilient_parsing:
        return
    from taubench_gl.cost.parameters import PARAMETERS

    for parameter in PARAMETERS.values():
        values = ", ".join(map(str, parameter.values))
        note = "  (other pixels or pairs)" if parameter.kind == "grid" else ""
        click.echo(f"{parameter.name}: {values}{note}\n    {parameter.doc}")
    click.echo("combinations\n    several parameters changed together")
    click.echo("effects\n    each effect left out")
    context.exit()


class Duration(click.ParamType):
    """``90s``, ``5m``, ``1h`` -> seconds; ``none``: None."""

    name = "T"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        found = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)|none", str(value).strip())
        if found is None:
            self.fail(f"{value!r} is no time such as 90s, 5m, 1h, or none", param, ctx)
        return float(found[1]) * {"s": 1.0, "": 1.0, "m": 60.0, "h": 3600.0}[found[2]] if found[1] else None


@click.command(
    epilog="""\b
Examples:
  taubench-gl cost scene.glb --out study --size 480x270
  taubench-gl cost scene.glb --out study --size 480x270 --time-limit 20m
  taubench-gl cost scene.glb --out study --within 0.5
  taubench-gl cost scene.glb --out study --budget-ms 20 --for direct
  taubench-gl cost scene.glb --out study --parameters combinations,shadow_size,indirect
  taubench-gl cost scene.glb --out study --reference exr:renders     # renders/spp_1, renders/spp_16, ...
  taubench-gl evaluate scene.glb --preset study/preset.toml
\b
DIR receives study.txt, study.html (interactive), study.json, study.csv, the figure (PNG, SVG), preset.toml with the
recommended settings, and records.jsonl: run again after an interruption or for more time, the study goes on."""
)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
@click.option("--out", type=OutPath(), required=True, metavar="DIR", help="Folder of the study.")
@click.option(
    "--parameters", type=List(), help="Parameters to vary, comma-separated, see --list-parameters.  [default: all]"
)
@click.option(
    "--reference",
    metavar="path-traced[@M]|highest-quality|exr:DIR",
    help="What masks are compared with.  path-traced: light traced at the compared pixels, for up to a third of the "
    "time or with M samples per pixel; exr:DIR: path-traced renders; highest-quality: the raster method at its best.  "
    "[default: path-traced where anything is lit, else highest-quality]",
)
@click.option(
    "--time-limit",
    type=Duration(),
    default="5m",
    show_default=True,
    help="Start no measurement after this time, such as 90s, 5m, 1h or none.  A later run goes on.",
)
@click.option("--within", type=float, metavar="PERCENT", help="Choose the fastest with at most PERCENT wrong masks.")
@click.option("--budget-ms", type=float, metavar="T", help="Choose the most exact configuration up to T ms per frame.")
@click.option(
    "--for",
    "choose_for",
    type=click.Choice(["overall", *COLUMNS]),
    default="overall",
    show_default=True,
    help="Column that the choice is for; overall: wrong in any column.",
)
@click.option("--repeats", type=int, default=5, show_default=True, help="Interleaved rounds of timing.")
@click.option(
    "--clock",
    type=click.Choice(["wall", "cpu"]),
    default="wall",
    show_default=True,
    help="Clock of frames; cpu: CPU time of the process, for software rasterizers beside other work.",
)
@click.option("--fresh", is_flag=True, help="Discard the records in DIR and measure from scratch.")
@click.option("--list-parameters", is_flag=True, is_eager=True, expose_value=False, callback=_list_parameters,
              help="Print the parameters and exit.")  # fmt: skip
@frame_options()
@pair_options()
@light_options
@accuracy_options
@gpu_options
def cost(scenes: tuple[str, ...], out: Path, **options: Any) -> int:
    """Recommend settings for SCENE: how many masks they get wrong, and what a frame takes.

    The options below are the baseline.  It is compared with one parameter changed, with several changed, and without
    each effect.  A mask is wrong where it differs from the reference's; a random set of pixels is compared.
    Configurations are timed in turn, A B C A B C.  The first three lines are the answer.  With several scenes, each
    gets a folder inside DIR and its own time.
    """
    names = ("parameters", "reference", "within", "budget_ms", "choose_for", "repeats", "time_limit", "fresh", "clock")
    request = {name: options.pop(name) for name in names}
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


def _run(scene: str, settings: Settings, folder: Path, request: dict[str, Any]) -> None:
    from taubench_gl.cost.study import cost as run_study
    from taubench_gl.report.cost import cost_text

    study = run_study(scene, settings, out=folder, progress=_Progress(Path(scene).name), **request)
    study.save()
    if sys.stderr.isatty():
        click.echo(err=True)  # ends the line of progress
    click.echo(cost_text(study.as_json()), nl=False)
    click.echo(f"written to {folder}{os.sep}")
    if study.about["interrupted"]:
        click.echo("taubench-gl: interrupted; the same command goes on", err=True)
        raise click.exceptions.Exit(130)


class _Progress:
    """Progress on standard error: one line that is overwritten on a terminal, about LINES lines elsewhere."""

    LINES = 20

    def __init__(self, name: str):
        self._name, self._printed = name, -1

    def __call__(self, step: Step) -> None:
        line = f"{self._name}: {step.done}/{step.total}, {step.what}"
        part = step.done * self.LINES // max(step.total, 1)
        if sys.stderr.isatty():
            click.echo(f"\r\033[K{line}", nl=False, err=True)
        elif part != self._printed:
            self._printed = part
            click.echo(line, err=True)
