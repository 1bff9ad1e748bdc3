"""``taubench-gl paper``: the paper's Tables 1 to 4 and Figures 1 and 2 of every scene that is there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from taubench_gl.apps.batch_command import engine_options
from taubench_gl.apps.options import OutPath, Size, Words

LIGHTS = ("raster", "path-traced")
LOBES = ("diffuse", "glossy", "transmission", "volume")


@click.command(
    epilog="""\b
Examples:
  taubench-gl paper --out paper --quick
  taubench-gl paper --out paper --workers 4
  taubench-gl paper eternal-valley-fps --out paper --light raster,path-traced --lobe diffuse --lobe glossy
  taubench-gl paper --out paper --quick --light raster,path-traced --pixels 700
  taubench-gl paper --out paper --light path-traced --estimate"""
)
@click.argument("scenes", nargs=-1, metavar="[SCENE]...")
@click.option("--out", type=OutPath(), default="paper", show_default=True, metavar="DIR", help="Folder of the results.")
@click.option("--quick", is_flag=True, help="Table 4 of 8 pairs spread over the animation, with confidence intervals.")
@click.option(
    "--light",
    type=Words(*LIGHTS, verb="use", none=False),
    default="raster",
    show_default=True,
    help="Light of Table 4, one row each: raster, path-traced, comma-separated.",
)
@click.option("--spp", type=int, metavar="N", help="Samples per pixel of path-traced light.  [default: 256]")
@click.option(
    "--pixels",
    type=int,
    metavar="N",
    help="Path-traced light at N random pixels of each pair instead of all, with confidence intervals.",
)
@click.option(
    "--lobe", "lobes", type=click.Choice(LOBES), multiple=True, help="Also measure this lobe apart; may be repeated."
)
@click.option("--size", type=Size(), default="1920x1080", show_default=True, help="Size of the images of Table 4.")
@click.option("--estimate", "only_estimate", is_flag=True, help="Print the estimated time, and stop.")
@engine_options
def paper(
    scenes: tuple[str, ...],
    out: Path,
    quick: bool,
    light: tuple[str, ...],
    spp: int | None,
    pixels: int | None,
    lobes: tuple[str, ...],
    size: tuple[int, int],
    only_estimate: bool,
    workers: int | None,
    engine: str | None,
    chunk: int | None,
) -> int:
    """Measure the paper's Tables 1 to 4 and redraw its Figures 1 and 2, beside the paper's numbers.

    SCENE names scenes of the paper, such as eternal-valley-fps; all by default.  A scene that 'scenes get' downloaded
    is measured; else its stand-in, if it has one, and every row says so.  Camera activity is at 60 frames a second,
    images are at 24.  From datasets, one set of thresholds for all scenes is fitted to the paper's Table 4.

    DIR gets paper.html, paper.tex, paper.json, tables and figures.  A run that was stopped, in whatever way, continues
    where it stopped when the command is repeated.  The exit code is 2 if a scene has failed.
    """
    from taubench_gl.apps.named_scenes import resolve
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.apps.study_screen import StudyScreen
    from taubench_gl.paper.estimate import estimate
    from taubench_gl.paper.output import PAGE, write_study
    from taubench_gl.paper.scenes import find_scenes
    from taubench_gl.paper.study import PaperOptions, plan, run_jobs
    from taubench_gl.study.estimate import announce
    from taubench_gl.study.run import make_engine

    make_engine(engine, workers, out)  # refuses what there is not before anything is drawn
    options = PaperOptions(size, light, spp, tuple(dict.fromkeys(lobes)), quick, pixels)
    found = find_scenes(scenes, resolve)
    for name, why in found.missing.items():
        _say(f"not measured: {name}: {why}")
    jobs = plan(found.scenes, options)
    times = estimate(jobs, out)
    announce(times, "pairs", workers, _say)
    if only_estimate:
        return 0
    slowest = max((each.seconds for each in times), default=None)
    try:
        with StudyScreen() as screen:
            how: dict[str, Any] = {"engine": engine, "workers": workers, "chunk": chunk, "listener": screen}
            results = run_jobs(jobs, out, slowest, **how)
        tables, files = write_study(results, jobs, found, options, out)
    except KeyboardInterrupt:
        _say("interrupted; finished pairs are kept: repeat the command to continue")
        raise click.exceptions.Exit(130) from None
    show_tables(tables)
    click.echo(f"written to {', '.join(map(str, files))}; open {out / PAGE}")
    for result in results:
        for part, why in result.failed.items():
            _say(f"error: {result.scene.label}, {part}: {why}")
    return 2 if any(result.failed for result in results) else 0


def _say(line: str) -> None:
    click.echo(f"taubench-gl: {line}", err=True)
