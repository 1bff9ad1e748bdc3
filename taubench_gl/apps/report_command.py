"""``taubench-gl report``: stored runs as one self-contained HTML page."""

from __future__ import annotations

from pathlib import Path

import click

from taubench_gl.apps.options import command
from taubench_gl.apps.screen import note
from taubench_gl.data_files import read_bytes
from taubench_gl.errors import OutputError
from taubench_gl.fields import at_least, setting
from taubench_gl.settings import OUTPUT


@command()
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
def report(
    runs: tuple[str, ...],
    *,
    out: Path | None = setting(
        None,
        "Output file",
        group=OUTPUT,
        metavar="FILE",
        shown="report.html in the folder of the run; in the current folder for several runs",
    ),
    images: int = setting(60, "Maximum number of pairs with images", at_least(1)),
) -> None:
    """Write one HTML page about one or more runs.

    RUN is an output folder of 'taubench-gl evaluate'.  The page shows Tables 1 to 4 with the paper's rows, the frames
    with their reason masks, plots per frame, threshold curves, effects, camera cuts and provenance.  One folder of
    'taubench-gl reuse evaluate' makes the page of that evaluation.

    Examples:
      taubench-gl evaluate scene.glb --out results --report
      taubench-gl report results
      taubench-gl report results other-results --out both.html
      taubench-gl report results --images 24 --out small.html
      taubench-gl report reuse-results

    The page is one file that needs no network and no server.  Frames with their masks require runs of
    'evaluate --report', masks that follow the thresholds runs of 'evaluate --report-full'.
    """
    from taubench_gl.apps.screen import load_runs
    from taubench_gl.report.page import REPORT_FILE
    from taubench_gl.report.run_page import ReportRun, write_html_report
    from taubench_gl.reuse.stored import is_evaluation

    if any(map(is_evaluation, runs)):
        _echo_written(_reuse_page(runs, out, images))
        return
    loaded = load_runs(runs)
    for run in loaded:
        _note_lost_images(run.out)
    if out is None:
        out = loaded[0].out / REPORT_FILE if len(loaded) == 1 else Path(REPORT_FILE)
    path = write_html_report([ReportRun(run.summary, run.frames, run.out) for run in loaded], out, images)
    _echo_written(path)


@command()
@click.argument("run", metavar="RUN")
def share(
    run: str,
    *,
    out: Path | None = setting(
        None, "Output file", group=OUTPUT, metavar="FILE", shown="share.html in the folder of the run"
    ),
) -> None:
    """Write one HTML file below 5 MB that plays the masks of every pair of RUN.

    RUN is an output folder of 'taubench-gl evaluate --report'.  The file is the report with smaller images of all
    recorded pairs; it needs no network and no server, and fits in a message.

    Examples:
      taubench-gl evaluate scene.glb --out results --report
      taubench-gl share results
      taubench-gl share results --out walk.html
    """
    from taubench_gl.apps.screen import load_runs
    from taubench_gl.report.run_frames import stored_frames
    from taubench_gl.report.run_page import ReportRun, write_html_report

    (loaded,) = load_runs([run])
    if why := stored_frames(loaded.out)[1]:
        raise OutputError(f"no images: {why}", where=run, hint="evaluate the scene again with --report")
    _note_lost_images(loaded.out)
    shared = ReportRun(loaded.summary, loaded.frames, loaded.out)
    _echo_written(write_html_report([shared], out or loaded.out / "share.html", images=None))


def _reuse_page(runs: tuple[str, ...], out: Path | None, images: int) -> Path:
    """The page of one reuse evaluation.  Raises OutputError for several runs."""
    from taubench_gl.outputs import write_atomically
    from taubench_gl.report.page import REPORT_FILE
    from taubench_gl.report.reuse import reuse_html
    from taubench_gl.report.reuse_frames import NO_IMAGES, reuse_images
    from taubench_gl.reuse.stored import load_evaluation

    if len(runs) > 1:
        hint = "give one RUN, or print their tables with 'taubench-gl compare'"
        raise OutputError("a page shows one reuse evaluation", hint=hint)
    evaluation = load_evaluation(runs[0])
    worst = evaluation.out / "side_by_side.png"
    image = read_bytes(worst) if worst.is_file() else None
    path = out or evaluation.out / REPORT_FILE
    frames = reuse_images(evaluation.out, images)
    if frames.lost or (frames.data is None and frames.text != NO_IMAGES):
        note(f"note: {evaluation.out}: {frames.lost or f'no images: {frames.text}'}")
    write_atomically(path, reuse_html(evaluation.summary, evaluation.rows, image, frames))
    return path


def _note_lost_images(folder: Path) -> None:
    """A note on images that a run recorded and that its page cannot show."""
    from taubench_gl.report.run_frames import NO_PLANES, NO_REPORT, stored_frames

    stored, why = stored_frames(folder)
    if stored is None and why != NO_REPORT:
        note(f"note: {folder}: no images: {why}")
    elif stored is not None:
        lost = [stored.lost, stored.no_planes if stored.no_planes != NO_PLANES else ""]
        for text in filter(None, lost):
            note(f"note: {folder}: {text}")


def _echo_written(path: Path) -> None:
    click.echo(f"written to {path} ({path.stat().st_size / 1e6:.1f} MB)")
