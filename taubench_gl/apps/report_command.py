"""``taubench-gl report``: stored runs as one self-contained HTML page."""

from __future__ import annotations

from pathlib import Path

import click

from taubench_gl.apps.option_types import OutPath


@click.command(
    epilog="""\b
Examples:
  taubench-gl evaluate scene.glb --out results --report
  taubench-gl report results
  taubench-gl report results other-results --out both.html
  taubench-gl report results --pictures 24 --out small.html
\b
The page needs no network and no server: open it, mail it, print it.  Frames with their masks are shown for runs
that 'evaluate --report' made; all else works for any run."""
)
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option(
    "--out",
    type=OutPath(dir_okay=False),
    metavar="FILE",
    help="Where to write.  [default: report.html in the run's folder, or here for several runs]",
)
@click.option(
    "--pictures", type=click.IntRange(min=1), default=60, show_default=True, help="Pairs pictured at most, in all."
)
def report(runs: tuple[str, ...], out: Path | None, pictures: int) -> None:
    """Write one HTML page about one or more runs (folders that 'taubench-gl evaluate --out' wrote).

    Tables 1 to 4 beside the paper's rows, plots per frame, the frames with masks to switch on and off, thresholds to
    drag, effects, cuts, and where every number comes from.
    """
    from taubench_gl.report.run_page import REPORT_FILE, ReportRun, write_html_report
    from taubench_gl.run import load_run

    loaded = [load_run(run) for run in runs]
    if out is None:
        out = loaded[0].out / REPORT_FILE if len(loaded) == 1 else Path(REPORT_FILE)
    path = write_html_report([ReportRun(run.summary, run.frames, run.out) for run in loaded], out, pictures)
    click.echo(f"written to {path} ({path.stat().st_size / 1e6:.1f} MB)")
