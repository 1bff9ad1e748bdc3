"""What a command does before it has a number to show: reading, metering, building."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable

from taubench_gl.apps.screen import note
from taubench_gl.stage_log import LASTING, SHARE

STAGE_SECONDS = 1.0
"""A stage is printed, where no bar shows it, after so long without a line."""

AGAIN_SECONDS = 10.0
"""Work that says when it ends (``stage_log.lasting``) is printed again after so long, then after twice as long, ..."""

VARIABLE = "TAUBENCH_STAGE_SECONDS"
"""Another number of seconds, for programs that read standard error."""


class Stages(logging.Handler):
    """Shows what a command does before it has a number to show: the package's log records of level INFO.

    A bar has the text of the stage at once; without one, a line says it once nothing was said for STAGE_SECONDS.
    """

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.show: Callable[[str], None] | None = None  # of the bar that is on the terminal
        self._timer: threading.Timer | None = None
        self._said = time.monotonic()  # when the command began, then when the last line was printed
        self._share = 0.0  # of the stage that is done

    def begin(self) -> None:
        """Start the clock: a command begins."""
        self._said = time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        lasting: bool | None = getattr(record, LASTING, None)
        share: float | None = getattr(record, SHARE, None)
        if share is not None:
            self._share = share
            if self.show is not None:
                self.show(f"{record.getMessage()}, {share:.0%}")
            return
        if record.levelno < logging.INFO and lasting is None:
            return
        self.end()
        self._share = 0.0
        if lasting is False:
            return
        if self.show is not None:
            return self.show(record.getMessage())
        began = time.monotonic()
        rest = self._said + _patience() - began
        again = AGAIN_SECONDS if lasting else None
        if rest <= 0.0:  # now: what follows may keep other threads from running
            return self._say(None, record.getMessage(), began, again)
        self._later(rest, record.getMessage(), began, again)

    def _later(self, seconds: float, text: str, began: float, again: float | None) -> None:
        """Print the stage ``text`` in ``seconds``, unless it is over by then.  ``began``, ``again``: as of ``_say``."""
        timer = threading.Timer(seconds, lambda: self._say(timer, text, began, again))
        timer.daemon = True
        self._timer = timer
        timer.start()

    def _say(self, timer: threading.Timer | None, text: str, began: float, again: float | None) -> None:
        """Print the stage, if ``timer`` is the last one, and again in ``again`` seconds (None: once).

        ``began``: when the stage began, as ``time.monotonic``.
        """
        with self.lock:
            if timer is not self._timer:  # the stage has ended meanwhile
                return
            self._said = time.monotonic()
            seconds = self._said - began
            parts = [f"{seconds:.0f} s"] if seconds >= AGAIN_SECONDS else []
            if self._share > 0.0:
                parts.append(f"about {seconds / self._share - seconds:.0f} s left")
            note(f"{text} ... {', '.join(parts)}".rstrip())
            if again is not None:
                self._later(again, text, began, 2.0 * again)

    def silence(self) -> None:
        """Show no stage from now on: the command says by itself how far it is."""
        self.end()
        self.show = lambda text: None

    def end(self) -> None:
        """Stop showing the stage: it is over."""
        with self.lock:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = None


def _patience() -> float:
    """Seconds that a stage lasts before it is printed as a line."""
    try:
        return max(float(os.environ[VARIABLE]), 0.0)
    except (KeyError, ValueError):
        return STAGE_SECONDS


STAGES = Stages()


def show_stages() -> None:
    """Show the stages of this process."""
    logger = logging.getLogger("taubench_gl")
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    logger.addHandler(STAGES)
    STAGES.begin()
