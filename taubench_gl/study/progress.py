"""What a driver reports while it runs, and the lines that say so."""

from __future__ import annotations

import time
from collections.abc import Callable

from taubench_gl.outputs import duration_text


class Listener:
    """Receives the progress of a study.  Every method does nothing here."""

    def begin(self, jobs: int, engine: str) -> None:
        """The workers have started; ``engine``: what they are, in one phrase."""

    def job_known(self, job: str, label: str, done: int, total: int) -> None:
        """The weight of a job is known, and how much of it an earlier run has done."""

    def advanced(self, job: str, weight: int) -> None:
        """More of a job is done; ``weight`` is negative if a unit is repeated."""

    def job_finished(self, job: str) -> None:
        """All units of a job are done, and its results are written."""

    def job_failed(self, job: str, label: str, message: str) -> None:
        """A job has no result; ``message``: why, in one line."""

    def message(self, line: str) -> None:
        """A message, such as that a worker died or has no OpenGL."""


class Progress(Listener):
    """Counts what is done, and says one line for each job that ends.  Totals grow while jobs are planned."""

    def __init__(self, say: Callable[[str], None], counted: str = "pairs"):
        """Begin to count; ``say`` prints a line; ``counted``: what weights count, such as pairs."""
        self.say, self.counted = say, counted
        self.labels: dict[str, str] = {}
        self.done: dict[str, int] = {}
        self.total: dict[str, int] = {}
        self._jobs, self._ended = 0, 0
        self._started, self._here = time.monotonic(), 0  # what this run has done

    def begin(self, jobs: int, engine: str) -> None:
        self._jobs, self._started = jobs, time.monotonic()
        self.say(f"{jobs} job{'' if jobs == 1 else 's'} on {engine}")

    def job_known(self, job: str, label: str, done: int, total: int) -> None:
        self.labels[job], self.done[job], self.total[job] = label, done, total

    def advanced(self, job: str, weight: int) -> None:
        self.done[job] = self.done.get(job, 0) + weight
        self._here += weight

    def job_finished(self, job: str) -> None:
        self._end(f"{self.labels[job]}: done, {self.total[job]} {self.counted}{self._rate()}")

    def job_failed(self, job: str, label: str, message: str) -> None:
        self._end(f"{label}: failed: {message}")

    def message(self, line: str) -> None:
        self.say(line)

    def _end(self, line: str) -> None:
        self._ended += 1
        self.say(f"{self._ended}/{self._jobs} {line}")

    def _rate(self) -> str:
        """How fast this run is, and how long the known rest takes."""
        if not self._here:
            return " of an earlier run"
        rate = self._here / max(time.monotonic() - self._started, 1e-9)
        undone = sum(self.total.values()) - sum(self.done.values())
        left = f"; about {duration_text(undone / rate)} left" if undone else ""
        return f", {rate:.2f} {self.counted}/s{left}"
