"""Progress of a batch: on a terminal one bar for all pairs and one per running job, elsewhere one line per event."""

from __future__ import annotations

import sys
import time
from typing import Any

import click

from taubench_gl.batch.driver import Listener
from taubench_gl.batch.spec import Job


class BatchScreen(Listener):
    """Shows the driver's events.  Totals grow while the heads of jobs are computed."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._whole: Any = None
        self._tasks: dict[str, Any] = {}
        self._done: dict[str, int] = {}
        self._total: dict[str, int] = {}
        self._started = time.monotonic()
        self._counted = 0  # pairs of this run

    def __enter__(self) -> BatchScreen:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            text = TextColumn("{task.description}", markup=False)
            columns = (text, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._whole = self._bar.add_task("all pairs", total=None)
            self._bar.start()
        return self

    def __exit__(self, *exc: Any) -> None:
        if self._bar is not None:
            self._bar.stop()

    def job_known(self, job: Job, done: int, total: int) -> None:
        again = job.id in self._total
        self._done[job.id], self._total[job.id] = done, total
        if self._bar is not None and not again and done < total:
            self._tasks[job.id] = self._bar.add_task(job.label, total=total, completed=done)
        self._update(job)

    def pairs_done(self, job: Job, pairs: int) -> None:
        self._done[job.id] = self._done.get(job.id, 0) + pairs
        self._counted += pairs
        self._update(job)

    def job_finished(self, job: Job) -> None:
        self._close(job)
        seconds = max(time.monotonic() - self._started, 1e-9)
        rate = f", {self._counted / seconds:.2f} pairs/s" if self._counted else ""
        self.message(f"{job.label}: done, {self._total.get(job.id, 0)} pairs{rate}")

    def job_failed(self, job: Job, message: str) -> None:
        self._close(job)
        self.message(f"{job.label}: failed: {message}")

    def message(self, line: str) -> None:
        if self._bar is not None:
            self._bar.console.print(line, markup=False, highlight=False)
        else:
            click.echo(line, err=True)

    def _close(self, job: Job) -> None:
        if self._bar is not None and job.id in self._tasks:
            self._bar.remove_task(self._tasks.pop(job.id))

    def _update(self, job: Job) -> None:
        if self._bar is None:
            return
        if job.id in self._tasks:
            self._bar.update(self._tasks[job.id], completed=self._done[job.id])
        self._bar.update(self._whole, completed=sum(self._done.values()), total=sum(self._total.values()))
