"""``taubench-gl paper``: the paper's Tables 1 to 4 and Figures 1 and 2 of every scene that is there."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from taubench_gl.apps.options import command
from taubench_gl.apps.screen import interruptible, show_tables, warn
from taubench_gl.fields import setting
from taubench_gl.option_groups import PaperOptions, WorkerOptions
from taubench_gl.settings import OUTPUT


@command()
@click.argument("scenes", nargs=-1, metavar="[SCENE]...")
def paper(
    scenes: tuple[str, ...],
    options: PaperOptions,
    workers: WorkerOptions,
    *,
    out: Path = setting(Path("paper"), "Folder of the results", group=OUTPUT, metavar="DIR"),
) -> int:
    """Measure the paper's Tables 1 to 4 and redraw its Figures 1 and 2, beside the paper's numbers.

    SCENE names scenes of the paper, such as eternal-valley-fps; all by default.  A scene that 'scenes get' unpacked
    is measured; else its stand-in, if it has one, and every row says so.  Camera activity is at 60 frames a second,
    images are at 24 and 60.  From datasets, one set of thresholds for all scenes is fitted to the paper's Table 4.

    DIR gets paper.html, paper.tex, paper.json, tables and figures.  A run that was stopped, in whatever way, continues
    where it stopped when the command is repeated.  The exit code is 2 if a scene has failed.

    Examples:
      taubench-gl paper --out paper --quick
      taubench-gl paper --out paper --workers 4
      taubench-gl paper eternal-valley-fps --out paper --light raster,path-traced --lobe diffuse --lobe glossy
      taubench-gl paper --out paper --quick --light auto,raster
    """
    from taubench_gl.apps.named_scenes import resolve
    from taubench_gl.apps.progress import StudyScreen
    from taubench_gl.paper.output import PAGE, write_study
    from taubench_gl.paper.scenes import find_scenes
    from taubench_gl.paper.study import plan, run_jobs
    from taubench_gl.study.engines import engine

    engine(workers.workers, out)  # refuses what there is not before anything is drawn
    available = find_scenes(scenes, resolve)
    for name, why in available.missing.items():
        warn(f"not measured: {name}: {why}")
    jobs = plan(available.scenes, options)
    with interruptible(lambda: "finished pairs are kept: repeat the command to continue"):
        with StudyScreen() as screen:
            results = run_jobs(jobs, out, **asdict(workers), listener=screen)
        tables, files = write_study(results, jobs, available, options, out)
    show_tables(tables)
    click.echo(f"written to {', '.join(map(str, files))}; open {out / PAGE}")
    for result in results:
        for part, why in result.failed.items():
            warn(f"error: {result.scene.label}, {part}: {why}")
    return 2 if any(result.failed for result in results) else 0
