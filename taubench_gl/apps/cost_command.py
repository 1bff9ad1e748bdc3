"""``taubench-gl cost``: accuracy against time, and which configuration to use."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.options import command, part
from taubench_gl.apps.screen import StatusLine, for_each_scene, stop_interrupted
from taubench_gl.errors import SettingsError
from taubench_gl.features import COLUMNS
from taubench_gl.fields import REQUIRED, one_of, setting
from taubench_gl.settings import OUTPUT, Settings

if TYPE_CHECKING:
    from taubench_gl.cost.study import Step

PROGRESS_LINES = 20
"""Lines of progress per study if standard error is not a terminal."""


def _seconds(text: Any) -> Any:
    """``90s``, ``5m``, ``1h`` -> seconds; ``none``: None."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)|none", str(text).strip())
    if match is None:
        raise SettingsError(f"{text!r} is no time", hint="give one such as 90s, 5m, 1h, or none")
    return float(match[1]) * {"s": 1.0, "": 1.0, "m": 60.0, "h": 3600.0}[match[2]] if match[1] else None


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


@command(
    settings=part(without=("exact",)),
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
recommended settings, and records.jsonl: run again after an interruption or for more time, the study goes on.""",
)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
@click.option(
    "--list-parameters",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list_parameters,
    help="Print the parameters and exit.",
)
def cost(
    scenes: tuple[str, ...],
    settings: Settings,
    *,
    out: Path = setting(REQUIRED, "Folder of the study", group=OUTPUT, metavar="DIR"),
    parameters: tuple[str, ...] | None = setting(
        None, "Parameters to vary, comma-separated, see --list-parameters", shown="all", short=False
    ),
    reference: str | None = setting(
        None,
        "What masks are compared with.  path-traced: light traced at the compared pixels, for up to a third of the "
        "time or with M samples per pixel; exr:DIR: path-traced renders; highest-quality: the raster method at its "
        "best",
        metavar="path-traced[@M]|highest-quality|exr:DIR",
        shown="path-traced where anything is lit, else highest-quality",
    ),
    time_limit: float | None = setting(
        300.0,
        "Start no measurement after this time, such as 90s, 5m, 1h or none.  A later run goes on",
        read=_seconds,
        metavar="T",
        shown="5m",
    ),
    within: float | None = setting(None, "Choose the fastest with at most PERCENT wrong masks", metavar="PERCENT"),
    budget_ms: float | None = setting(None, "Choose the most exact configuration up to T ms per frame", metavar="T"),
    choose_for: str = setting(
        "overall",
        "Column that the choice is for; overall: wrong in any column",
        one_of(("overall", *COLUMNS)),
        flag="--for",
        short=False,
    ),
    repeats: int = setting(5, "Interleaved rounds of timing", short=False),
    clock: str = setting(
        "wall",
        "Clock of frames; cpu: CPU time of the process, for software rasterizers beside other work",
        one_of(("wall", "cpu")),
        short=False,
    ),
    fresh: bool = setting(False, "Discard the records in DIR and measure from scratch", short=False),
) -> int:
    """Recommend settings for SCENE: how many masks they get wrong, and what a frame takes.

    The options of scene, picture, masks and light are the baseline.  It is compared with one parameter changed, with
    several changed, and without each effect.  A mask is wrong where it differs from the reference's; a random set of
    pixels is compared.  Configurations are timed in turn, A B C A B C.  The first three lines are the answer.  With
    several scenes, each gets a folder inside DIR and its own time.
    """
    request = {
        "parameters": parameters, "reference": reference, "within": within, "budget_ms": budget_ms,
        "choose_for": choose_for, "repeats": repeats, "time_limit": time_limit, "fresh": fresh, "clock": clock,
    }  # fmt: skip
    failed = for_each_scene(scenes, out, lambda scene, folder: _run(scene, settings, folder, request))
    return 2 if failed else 0


def _run(scene: str, settings: Settings, folder: Path | None, request: dict[str, Any]) -> None:
    from taubench_gl.cost.study import cost as run_study
    from taubench_gl.report.cost import cost_text

    line, parts = StatusLine(), set()

    def show(step: Step) -> None:
        part = step.done * PROGRESS_LINES // max(step.total, 1)
        line(f"{Path(scene).name}: {step.done}/{step.total}, {step.what}", passing=part in parts or sys.stderr.isatty())
        parts.add(part)

    study = run_study(scene, settings, out=folder, progress=show, **request)
    study.save()
    line.end()
    click.echo(cost_text(study.as_json()), nl=False)
    click.echo(f"written to {folder}{os.sep}")
    if study.about["interrupted"]:
        stop_interrupted("the same command goes on")
