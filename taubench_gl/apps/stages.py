"""What a command does before it has a number to show: reading, metering, building."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable

from taubench_gl.apps.screen import note

STAGE_SECONDS = 1.0
"""A stage is printed, where no bar shows it, after so long without a line."""

VARIABLE = "TAUBENCH_STAGE_SECONDS"
"""Another number of seconds, for programs that read standard error."""


class Stages(logging.Handler):
    """Shows what a command does before it has a number to show: the package's log records of level INFO.

    A bar has the text of the stage at once; without one, a line says it once nothing was said for STAGE_SECONDS.
    """

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.show: Callable[[str], None] | None = None  # of the bar that is on the terminal
        self._timer: threading.Timer | None = None
        self._said = time.monotonic()  # when the command began, then when the last line was printed

    def begin(self) -> None:
        """A command begins."""
        self._said = time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        self.end()
        if self.show is not None:
            return self.show(record.getMessage())
        line, rest = f"{record.getMessage()} ...", self._said + _patience() - time.monotonic()
        if rest <= 0.0:  # now: what follows may keep other threads from running
            return self._say(line)
        self._timer = threading.Timer(rest, self._say, (line,))
        self._timer.daemon = True
        self._timer.start()

    def _say(self, line: str) -> None:
        self._said = time.monotonic()
        note(line)

    def silence(self) -> None:
        """Show none from now on: the command says by itself how far it is."""
        self.end()
        self.show = lambda text: None

    def end(self) -> None:
        """The stage is over."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None


def _patience() -> float:
    """Seconds before a stage is a line."""
    try:
        return max(float(os.environ[VARIABLE]), 0.0)
    except (KeyError, ValueError):
        return STAGE_SECONDS


STAGES = Stages()


def show_stages() -> None:
    """Show the stages of this process."""
    logger = logging.getLogger("taubench_gl")
    logger.setLevel(logging.INFO)
    logger.propagate = False
    logger.addHandler(STAGES)
    STAGES.begin()
