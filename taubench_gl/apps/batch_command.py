"""``taubench-gl batch``: studies of many scenes and settings, on one machine or many."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from taubench_gl.apps.aliases import Group
from taubench_gl.apps.option_types import OutPath

if TYPE_CHECKING:
    from taubench_gl.batch.driver import Outcome
    from taubench_gl.batch.study import Study


class _RunByDefault(Group):
    """``batch STUDY.toml`` is ``batch run STUDY.toml``."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["run", *args]
        return super().parse_args(ctx, args)


@click.group(
    cls=_RunByDefault,
    epilog="""\b
Examples:
  taubench-gl batch study.toml --out results
  taubench-gl batch study.toml --out results --workers 4
  taubench-gl batch study.toml --out results --engine dask-local
  taubench-gl batch study.toml --out results --engine dask://node1:8786
  taubench-gl batch status results
  taubench-gl batch resume results --workers 4
  taubench-gl batch report results""",
)
def batch() -> None:
    """Evaluate many scenes with many settings: 'batch STUDY.toml --out DIR' runs a study.

    A study is a TOML file: scenes = ["a.glb", "more/*.glb"] and any setting of 'evaluate', such as size = "640x360";
    a list sweeps.  Results are the same, bit for bit, whatever runs them; what is interrupted is resumed.
    """


def engine_options(command: Any) -> Any:
    """``--workers``, ``--engine`` and ``--chunk``."""
    for option in reversed(
        (
            click.option("--workers", type=int, metavar="N", help="Worker processes on this machine.  [default: none]"),
            click.option(
                "--engine",
                metavar="NAME",
                help="dask://HOST:PORT, a Dask scheduler, or dask-local, Dask workers here.  [default: this process]",
            ),
            click.option(
                "--chunk", type=int, metavar="PAIRS", help="Pairs of a unit of work; changes no result.  [default: fit]"
            ),
        )
    ):
        command = option(command)
    return command


@batch.command(
    epilog="""\b
Examples:
  taubench-gl batch run study.toml --out results --workers 4"""
)
@click.argument("study", type=click.Path(path_type=Path), metavar="STUDY.toml")
@click.option("--out", type=OutPath(), required=True, metavar="DIR", help="Folder of the results.")
@engine_options
def run(study: Path, out: Path, workers: int | None, engine: str | None, chunk: int | None) -> int:
    """Run STUDY.toml into DIR, or what is missing of it there.

    DIR gets summary.json, frames.parquet and tables of all, and jobs/JOB with summary.json and frames.csv of each.  A
    scene that fails does not stop the others: logs/JOB.log says why, and the exit code is then 2.
    """
    from taubench_gl.apps.named_scenes import resolve
    from taubench_gl.batch.study import read_study

    return _run(read_study(study, resolve), out, workers, engine, chunk)


@batch.command(
    epilog="""\b
Examples:
  taubench-gl batch resume results --workers 4"""
)
@click.argument("out", type=click.Path(path_type=Path), metavar="DIR")
@engine_options
def resume(out: Path, workers: int | None, engine: str | None, chunk: int | None) -> int:
    """Go on with the study of DIR, on any engine: finished pairs are kept, failed scenes are tried again."""
    return _run(None, out, workers, engine, chunk)


@batch.command(
    epilog="""\b
Examples:
  taubench-gl batch status results"""
)
@click.argument("out", type=click.Path(path_type=Path), metavar="DIR")
def status(out: Path) -> int:
    """How far the study of DIR is, whoever runs it.  The exit code is 2 where a scene has failed."""
    from taubench_gl.batch.run import study_status

    name, driver, jobs = study_status(out)
    running = f"driven by {driver}" if driver else "nobody is working on it"
    click.echo(f"{name}: {sum(job.state == 'done' for job in jobs)} of {len(jobs)} jobs done; {running}")
    for job in jobs:
        total = "?" if job.total is None else job.total
        click.echo(f"  {job.state:<8} {job.done:>6}/{total:<6} {job.id}  {job.label}")
        if job.reason is not None:
            click.echo(f"           {job.reason}")
    return 2 if any(job.state == "failed" for job in jobs) else 0


@batch.command(
    epilog="""\b
Examples:
  taubench-gl batch report results"""
)
@click.argument("out", type=click.Path(path_type=Path), metavar="DIR")
def report(out: Path) -> None:
    """Print Tables 1 to 4 of all finished jobs of DIR, and write them there as text, Markdown, CSV and LaTeX."""
    from taubench_gl.apps.screen import show_tables
    from taubench_gl.batch.run import study_report

    tables, missing = study_report(out)
    show_tables(tables)
    for label in missing:
        click.echo(f"note: not finished: {label}")
    click.echo(f"written to {out}/tables.txt, .md, .csv, .tex")


def _run(study: Study | None, out: Path, workers: int | None, engine: str | None, chunk: int | None) -> int:
    from taubench_gl.apps.batch_screen import BatchScreen
    from taubench_gl.batch.run import run_study

    try:
        with BatchScreen() as screen:
            outcome = run_study(study, out, engine=engine, workers=workers, chunk=chunk, listener=screen)
    except KeyboardInterrupt:
        _say(f"interrupted; finished pairs are kept: taubench-gl batch resume {out}")
        raise click.exceptions.Exit(130) from None
    return _tell(outcome, out)


def _tell(outcome: Outcome, out: Path) -> int:
    done, jobs = outcome.summary["done"], len(outcome.summary["jobs"])
    click.echo(f"{done} of {jobs} jobs done; written to {out}/")
    for job, reason in outcome.failed.items():
        _say(f"error: {reason} (see {out}/logs/{job}.log)")
    if outcome.failed:
        _say(f"{len(outcome.failed)} of {jobs} jobs failed")
        return 2
    click.echo(f"tables: {out}/tables.txt, or taubench-gl batch report {out}")
    return 0


def _say(line: str) -> None:
    click.echo(f"taubench-gl: {line}", err=True)
