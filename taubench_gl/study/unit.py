"""Units of work, workers, and the events that they lead to.  Units and events can be pickled."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

from taubench_gl.errors import GraphicsError, TaubenchError

ATTEMPTS = 3
"""Workers that may die in one unit before it fails."""

THREADS_VARIABLE = "LP_NUM_THREADS"
"""Number of threads of Mesa's software rasterizer in one process; other drivers ignore it."""

THREADS_VARIABLES = (THREADS_VARIABLE, "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
"""Numbers of threads of the rasterizer and of libraries: OpenMP threads wait in loops, so that more of them than cores
took twice the time (FLIP)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """A part of a job.  It can be pickled, and its result depends on its fields only."""

    job: str  # a worker gets units of the same job if it can
    key: str  # of its record, with a hash of everything that the result depends on
    name: str  # which part of its job it is, for messages
    scene: str  # for messages
    weight: int = 0  # amount of work, such as the number of pairs
    limit: float | None = None  # seconds between two calls of ``Worker.done`` that end a worker process

    def run(self, worker: Worker) -> bytes:
        """The result, a JSON value.  Raises TaubenchError; NoOpenGL if no context opens."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Finished:
    """The unit has a result: ``data``, a JSON value."""

    unit: Unit
    data: bytes


@dataclass(frozen=True, slots=True)
class Failed:
    """The unit raised an exception.  It is not repeated: the result would be the same."""

    unit: Unit
    message: str  # one line
    details: str  # traceback


@dataclass(frozen=True, slots=True)
class Lost:
    """The worker died while it ran the unit."""

    unit: Unit
    reason: str
    details: str = ""  # the end of the worker's output
    attempts: int = 1  # workers that died in it


@dataclass(frozen=True, slots=True)
class Advanced:
    """A part of a unit is done, ``weight`` of its work."""

    unit: Unit
    weight: int = 1


Event = Finished | Failed | Lost | Advanced


class NoOpenGL(GraphicsError):
    """The workers of this machine have no OpenGL: the study ends, and what is stored is kept."""


class Worker:
    """Runs units one after another, and keeps what the next unit of the same job needs again."""

    def __init__(self, report: Callable[[Advanced], None] = lambda event: None, *, limited: bool = False):
        """Call ``report`` when a part of a unit is done; ``limited``: a unit beyond its limit ends the process."""
        self._report, self._limited = report, limited
        self._unit: Unit | None = None
        self._key: Hashable = None
        self._kept: Any = None

    def kept(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What ``make`` returned for ``key``, an object with ``release``, if that was the last key asked for.

        Otherwise the object of the last key is released and another one is made.
        """
        if self._kept is None or self._key != key:
            self.release()
            self._key, self._kept = key, make()
        return self._kept

    def release(self) -> None:
        """Free the object that ``kept`` holds."""
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.release()

    def done(self, weight: int = 1) -> None:
        """Report that a part of the running unit is done, ``weight`` of its work."""
        if self._unit is not None:
            self._restart_limit()
            self._report(Advanced(self._unit, weight))

    def attempt(self, unit: Unit) -> Event:
        """Run a unit and return an event, whatever it raises except NoOpenGL, which ends the study."""
        self._unit = unit
        self._restart_limit()
        try:
            return Finished(unit, unit.run(self))
        except NoOpenGL:
            raise
        except TaubenchError as error:
            return self._failed(unit, str(error))
        except Exception as error:
            # A bug in this program or a library fails one job: its log has the traceback, the other jobs still run.
            return self._failed(unit, f"{unit.scene}: internal error, {type(error).__name__}: {error}")
        finally:
            self._unit = None
            if self._limited:
                signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _restart_limit(self) -> None:
        """Start the unit's limit again: its signal also ends a process that waits in a driver or library."""
        if self._limited and self._unit.limit is not None:
            signal.setitimer(signal.ITIMER_REAL, self._unit.limit)

    def _failed(self, unit: Unit, message: str) -> Failed:
        """The event of the exception that is being handled; frees what is kept, which may be what failed."""
        details = traceback.format_exc()
        self.release()
        return Failed(unit, " ".join(message.split()), f"in {unit.name} of {unit.scene}\n\n{details}")
