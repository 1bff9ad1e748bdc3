"""``taubench-gl batch``: many scenes with many settings."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from taubench_gl.apps.options import Commands, command
from taubench_gl.apps.screen import interruptible, show_tables, warn
from taubench_gl.fields import REQUIRED, setting
from taubench_gl.option_groups import WorkerOptions
from taubench_gl.settings import OUTPUT

if TYPE_CHECKING:
    from taubench_gl.batch.spec import BatchSpec
    from taubench_gl.batch.study import Outcome


@click.group(cls=Commands, default="run")
def batch() -> None:
    """Evaluate many scenes with many settings: 'batch SPEC.toml --out DIR' runs a batch spec.

    A batch spec is a TOML file: scenes = ["a.glb", "more/*.glb"] and any setting of 'evaluate', such as
    size = "640x360".  A list of values is a sweep.  Results do not depend on the number of workers, bit
    for bit, and an interrupted batch can be resumed.

    Examples:
      taubench-gl batch spec.toml --out results
      taubench-gl batch spec.toml --out results --workers 4
      taubench-gl batch status results
      taubench-gl batch resume results --workers 4
      taubench-gl batch report results
    """


@command()
@click.argument("spec", type=click.Path(path_type=Path), metavar="SPEC.toml")
def run(
    spec: Path,
    workers: WorkerOptions,
    *,
    out: Path = setting(REQUIRED, "Folder of the results", group=OUTPUT, metavar="DIR"),
) -> int:
    """Run SPEC.toml and write the results to DIR.  Jobs that DIR already holds are kept.

    DIR gets summary.json, frames.parquet and tables of all jobs, and jobs/JOB with summary.json and frames.csv of each
    job.  A scene that fails does not stop the others: logs/JOB.log gives the reason, and the exit code is 2.

    Examples:
      taubench-gl batch run spec.toml --out results --workers 4
    """
    from taubench_gl.apps.named_scenes import resolve
    from taubench_gl.batch.spec import read_spec

    return _run(read_spec(spec, resolve), out, workers)


@command()
@click.argument("out", type=click.Path(path_type=Path), metavar="DIR")
def resume(out: Path, workers: WorkerOptions) -> int:
    """Continue the batch in DIR with any number of workers.  Finished pairs are kept; failed scenes are tried again.

    Examples:
      taubench-gl batch resume results --workers 4
    """
    return _run(None, out, workers)


@command()
@click.argument("out", type=click.Path(path_type=Path), metavar="DIR")
def status(out: Path) -> int:
    """Print the progress of the batch in DIR.  The exit code is 2 if a scene has failed.

    Examples:
      taubench-gl batch status results
    """
    from taubench_gl.batch.study import batch_status

    name, driver, jobs = batch_status(out)
    running = f"run by {driver}" if driver else "not running"
    click.echo(f"{name}: {sum(job.state == 'done' for job in jobs)} of {len(jobs)} jobs done; {running}")
    for job in jobs:
        total = "?" if job.total is None else job.total
        click.echo(f"  {job.state:<8} {job.done:>6}/{total:<6} {job.id}  {job.label}")
        if job.reason is not None:
            click.echo(f"           {job.reason}")
    return 2 if any(job.state == "failed" for job in jobs) else 0


@command()
@click.argument("out", type=click.Path(path_type=Path), metavar="DIR")
def report(out: Path) -> None:
    """Print Tables 1 to 4 of all finished jobs in DIR, and write them there as text, Markdown, CSV and LaTeX.

    Examples:
      taubench-gl batch report results
    """
    from taubench_gl.batch.study import batch_report

    tables, missing = batch_report(out)
    show_tables(tables)
    for label in missing:
        click.echo(f"note: not finished: {label}")
    click.echo(f"written to {out}/tables.txt, .md, .csv, .tex")


def _run(spec: BatchSpec | None, out: Path, workers: WorkerOptions) -> int:
    from taubench_gl.apps.progress import StudyScreen
    from taubench_gl.batch.study import run_batch

    kept = f"finished pairs are kept: taubench-gl batch resume {out}"
    with interruptible(lambda: kept), StudyScreen() as screen:
        outcome = run_batch(spec, out, **asdict(workers), listener=screen)
    return _print_outcome(outcome, out)


def _print_outcome(outcome: Outcome, out: Path) -> int:
    done, jobs = outcome.summary["done"], len(outcome.summary["jobs"])
    click.echo(f"{done} of {jobs} jobs done; written to {out}/")
    for job, reason in outcome.failed.items():
        warn(f"error: {reason} (see {out}/logs/{job}.log)")
    if outcome.failed:
        warn(f"{len(outcome.failed)} of {jobs} jobs failed")
        return 2
    click.echo(f"tables: {out}/tables.txt, or taubench-gl batch report {out}")
    return 0


for member in (run, resume, status, report):
    batch.add_command(member)
