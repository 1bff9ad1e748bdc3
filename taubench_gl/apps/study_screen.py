"""Progress of a study: on a terminal one bar for everything and one per running job, elsewhere one line per event."""

from __future__ import annotations

import sys
from typing import Any

import click

from taubench_gl.study.progress import Progress


class StudyScreen(Progress):
    """Shows the driver's events."""

    def __init__(self, of: str = "pairs") -> None:
        super().__init__(self._print, of)
        self._bar: Any = None
        self._whole: Any = None
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> StudyScreen:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            text = TextColumn("{task.description}", markup=False)
            columns = (text, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._whole = self._bar.add_task(f"all {self.of}", total=None)
            self._bar.start()
        return self

    def __exit__(self, *exc: Any) -> None:
        if self._bar is not None:
            self._bar.stop()

    def job_known(self, job: str, label: str, done: int, total: int) -> None:
        again = job in self.total
        super().job_known(job, label, done, total)
        if self._bar is not None and not again and done < total:
            self._tasks[job] = self._bar.add_task(label, total=total, completed=done)
        self._update(job)

    def advanced(self, job: str, weight: int) -> None:
        super().advanced(job, weight)
        self._update(job)

    def job_finished(self, job: str) -> None:
        self._close(job)
        super().job_finished(job)

    def job_failed(self, job: str, label: str, message: str) -> None:
        self._close(job)
        super().job_failed(job, label, message)

    def _print(self, line: str) -> None:
        if self._bar is not None:
            self._bar.console.print(line, markup=False, highlight=False)
        else:
            click.echo(line, err=True)

    def _close(self, job: str) -> None:
        if self._bar is not None and job in self._tasks:
            self._bar.remove_task(self._tasks.pop(job))

    def _update(self, job: str) -> None:
        if self._bar is None:
            return
        if job in self._tasks:
            self._bar.update(self._tasks[job], completed=self.done[job])
        self._bar.update(self._whole, completed=sum(self.done.values()), total=sum(self.total.values()))
