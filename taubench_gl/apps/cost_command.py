"""``taubench-gl cost``: what accuracy costs, and which options to use."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path

import click

from taubench_gl.apps.options import command, option_group
from taubench_gl.apps.screen import for_each_scene, interruptible
from taubench_gl.fields import REQUIRED, setting
from taubench_gl.option_groups import CostOptions
from taubench_gl.settings import OUTPUT, STEREO, Settings


@command(
    options=option_group(CostOptions),
    settings=option_group(
        without=(*STEREO, "exact", "samples_per_pixel", "light", "spp", "light_within", "light_time", "pattern")
    ),
)
@click.argument("scenes", nargs=-1, required=True, metavar="SCENE...")
def cost(
    scenes: tuple[str, ...],
    settings: Settings,
    options: CostOptions,
    *,
    out: Path = setting(REQUIRED, "Folder of the study", group=OUTPUT, metavar="DIR"),
) -> int:
    """Show what accuracy of Table 4 costs on SCENE, and recommend options for 10 seconds, a minute and 0.5 points.

    One table is evaluated in many ways: previews, decided samples (--light-within 4 to 0.5) and fixed samples per pixel
    (--spp 1 to 64).  Each is timed and compared with the truth, many more decided samples of other seeds.  One picture
    has seconds against error.  With several scenes, each gets a folder inside DIR.

    Examples:
      taubench-gl cost scene.glb --out study --size 480x270
      taubench-gl cost scene.glb --out study --size 480x270 --frames 0:9 --time 5m
      taubench-gl cost scene.glb --out study --columns position,direct --truth-within 0.5 --clock cpu
      taubench-gl evaluate scene.glb --preset study/within-60s.toml

    DIR receives cost.html, cost.txt, cost.json, the picture (PNG, SVG), tables, the presets within-10s.toml,
    within-60s.toml and within-0.5points.toml, and records: the same command goes on after an interruption.
    """
    failed = for_each_scene(scenes, out, lambda scene, folder: _run(scene, settings, folder, options))
    return 2 if failed else 0


def _run(scene: str, settings: Settings, folder: Path | None, options: CostOptions) -> None:
    from taubench_gl.apps.named_scenes import resolve, row_settings
    from taubench_gl.apps.progress import StudyScreen
    from taubench_gl.cost.study import cost as run_study
    from taubench_gl.report.cost import cost_text

    path, row = resolve(scene, settings.sequence.animation)
    with interruptible(lambda: "the same command goes on"), StudyScreen("evaluations") as screen:
        study = run_study(path, settings.replace(**row_settings(row)), out=folder, listener=screen, **asdict(options))
    click.echo(cost_text(study), nl=False)
    click.echo(f"written to {folder}{os.sep}")
