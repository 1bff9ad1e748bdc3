"""Progress of long commands: bars on a terminal, elsewhere a few lines."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taubench_gl.apps.screen import note
from taubench_gl.apps.stages import STAGES
from taubench_gl.errors import printable
from taubench_gl.study.progress import Progress as StudyProgress

if TYPE_CHECKING:
    from taubench_gl.run import Progress

PLAIN_STEPS = 10
"""Number of progress lines per scene if standard error is not a terminal."""

LINE_SECONDS = 30.0
"""Seconds between two lines about the running jobs of a study if standard error is not a terminal."""


class Bars:
    """Bars on standard error while a block runs, if it is a terminal; lines are printed above them."""

    def __init__(self) -> None:
        self._progress: Any = None  # None: no terminal
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> Any:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            name, text = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[text]}", markup=False)
            columns = (name, BarColumn(), MofNCompleteColumn(), text, TimeRemainingColumn())
            self._progress = Progress(*columns, console=Console(stderr=True), transient=True)
            self._progress.start()
            STAGES.show = self.stage
        return self

    def stage(self, text: str) -> None:
        """Show what is being done before there is a number to show.  Bars show it nowhere; subclasses do."""

    def __exit__(self, *exc: object) -> None:
        STAGES.show = None
        STAGES.end()
        if self._progress is not None:
            self._progress.stop()

    @property
    def on_terminal(self) -> bool:
        """Whether bars are shown."""
        return self._progress is not None

    def set_bar(self, name: str, done: int, total: int | None, text: str = "", label: str = "") -> None:
        """Show that ``done`` of ``total`` (None: not known) is done.  ``label``, by default the name, stands before the
        bar, ``text`` behind it."""
        if self._progress is None:
            return
        if name not in self._tasks:
            self._tasks[name] = self._progress.add_task(label or name, total=total, text=text)
        self._progress.update(self._tasks[name], completed=done, total=total, text=text)

    def remove_bar(self, name: str) -> None:
        """Remove a bar, if there is one of this name."""
        if name in self._tasks:
            self._progress.remove_task(self._tasks.pop(name))

    def say(self, line: str) -> None:
        """Print a line above the bars, or to standard error where no bar is shown."""
        if self._progress is not None:
            self._progress.console.print(line, markup=False, highlight=False)
        else:
            note(line)


class ProgressBar(Bars):
    """Progress callback of ``evaluate``: a bar on a terminal, PLAIN_STEPS lines in a file or pipe."""

    def __init__(self, scene: str | Path, unit: str = "pairs"):
        super().__init__()
        self.name, self.unit = printable(Path(scene).name), unit
        self.done = self.total = 0
        self._seconds = 0.0

    def __enter__(self) -> ProgressBar:
        super().__enter__()
        self.set_bar(self.name, 0, None, "starting")
        return self

    def stage(self, text: str) -> None:
        self.set_bar(self.name, self.done, self.total or None, text)

    def __call__(self, progress: Progress) -> None:
        STAGES.end()
        if progress.text:
            self.set_bar(self.name, progress.done, progress.total, progress.text)
            if not self.on_terminal:
                self.say(f"{self.name}: {progress.text}")
            return
        self._seconds += progress.frame_seconds
        rate = f"{progress.done / self._seconds:.2f} {self.unit}/s" if self._seconds > 0 else ""
        left = self._seconds / progress.done * (progress.total - progress.done)
        self.step(progress.done, progress.total, rate, f"{rate}, {left:.0f} s left")

    def step(self, done: int, total: int, text: str, line: str = "") -> None:
        """Show that ``done`` of ``total`` is done.  ``text`` stands beside the bar; without a terminal, ``line`` stands
        in place of it.
        """
        before, self.done, self.total = self.done, done, total
        self.set_bar(self.name, done, total, text)
        steps = max(total, 1)
        if not self.on_terminal and done * PLAIN_STEPS // steps > before * PLAIN_STEPS // steps:
            self.say(f"{self.name}: {done}/{total} {self.unit}, {line or text}")


class StudyScreen(Bars, StudyProgress):
    """Progress of a study: on a terminal one bar for everything and one per running job; a line per event, elsewhere
    also one per LINE_SECONDS."""

    def __init__(self, counted: str = "pairs") -> None:
        """``counted``: name of what the weights of units count, such as ``pairs``."""
        Bars.__init__(self)
        StudyProgress.__init__(self, self.say, counted)
        self._said = time.monotonic()

    def __enter__(self) -> StudyScreen:
        super().__enter__()
        self._show_whole()  # first: it stays above the bars of jobs
        return self

    def stage(self, text: str) -> None:
        self._show_whole(text)

    def job_known(self, job: str, label: str, done: int, total: int) -> None:
        super().job_known(job, label, done, total)
        if done < total:  # a job that an earlier run has finished has no bar
            self.set_bar(job, done, total, label=label)
        self._show_whole()

    def advanced(self, job: str, weight: int) -> None:
        super().advanced(job, weight)
        if job in self._tasks:
            self.set_bar(job, self.done[job], self.total[job])
        self._show_whole()
        known = job in self.labels  # before that only the head of a batch's job advances, which counts nothing
        if known and not self.on_terminal and time.monotonic() - self._said >= LINE_SECONDS:
            self._said = time.monotonic()
            self.say(f"{self.labels[job]}: {self.done[job]}/{self.total[job]} {self.counted}{self._rate()}")

    def job_finished(self, job: str) -> None:
        self.remove_bar(job)
        super().job_finished(job)

    def job_failed(self, job: str, label: str, message: str) -> None:
        self.remove_bar(job)
        super().job_failed(job, label, message)

    def _show_whole(self, text: str = "") -> None:
        self.set_bar(f"all {self.counted}", sum(self.done.values()), sum(self.total.values()) or None, text)
