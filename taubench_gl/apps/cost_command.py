"""``taubench-gl cost``: accuracy against time, and which configuration to use."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path

import click

from taubench_gl.apps.options import command, part
from taubench_gl.apps.screen import for_each_scene, stop_interrupted
from taubench_gl.fields import REQUIRED, setting
from taubench_gl.option_groups import CostOptions
from taubench_gl.settings import OUTPUT, Settings


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
    options=part(CostOptions),
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
    options: CostOptions,
    *,
    out: Path = setting(REQUIRED, "Folder of the study", group=OUTPUT, metavar="DIR"),
) -> int:
    """Recommend settings for SCENE: how many masks they get wrong, and what a frame takes.

    The options of scene, picture, masks and light are the baseline.  It is compared with one parameter changed, with
    several changed, and without each effect.  A mask is wrong where it differs from the reference's; a random set of
    pixels is compared.  Configurations are timed in turn, A B C A B C.  The first three lines are the answer.  With
    several scenes, each gets a folder inside DIR and its own time.
    """
    failed = for_each_scene(scenes, out, lambda scene, folder: _run(scene, settings, folder, options))
    return 2 if failed else 0


def _run(scene: str, settings: Settings, folder: Path | None, options: CostOptions) -> None:
    from taubench_gl.apps.progress import ProgressBar
    from taubench_gl.cost.study import cost as run_study
    from taubench_gl.report.cost import cost_text

    with ProgressBar(scene, "measurements") as bar:
        study = run_study(
            scene,
            settings,
            out=folder,
            progress=lambda step: bar.step(step.done, step.total, step.what),
            **asdict(options),
        )
    study.save()
    click.echo(cost_text(study.as_json()), nl=False)
    click.echo(f"written to {folder}{os.sep}")
    if study.about["interrupted"]:
        stop_interrupted("the same command goes on")
