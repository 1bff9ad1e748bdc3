"""Units of work, the events they lead to, and the interface of engines.  Units and events can be pickled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from taubench_gl.settings import Settings

ATTEMPTS = 3
"""Workers that may die in one unit before its job fails."""

Key = tuple[str, tuple[int, ...] | None]


@dataclass(frozen=True, slots=True)
class Unit:
    """A part of one job.

    ``positions`` None: the job's head, all that needs no rendering.  Otherwise the pairs to count, as ascending
    positions among the job's pairs; empty for a job without pairs, whose frames are rendered all the same.
    """

    job: str
    scene: str
    settings: Settings
    positions: tuple[int, ...] | None = None
    sha256: str | None = None  # of the files when the head was computed, evaluation.files_identity
    lobes: tuple[str, ...] = ()  # of direct and indirect, to count apart

    @property
    def key(self) -> Key:
        return self.job, self.positions

    @property
    def name(self) -> str:
        if self.positions is None:
            return "head"
        return f"pairs {self.positions[0]} to {self.positions[-1]}" if self.positions else "frames without pairs"


class Task(Protocol):
    """A unit of another package, which engines run as they run a Unit.  It can be pickled; ``run`` returns its result.

    ``job``: a worker gets units of the same one if it can; ``name`` and ``scene`` are for messages.
    """

    @property
    def job(self) -> str: ...

    @property
    def name(self) -> str: ...

    @property
    def scene(self) -> str: ...

    def run(self) -> bytes: ...


@dataclass(frozen=True, slots=True)
class Finished:
    unit: Unit | Task
    data: bytes  # head: JSON; pairs: a Parquet file


@dataclass(frozen=True, slots=True)
class Failed:
    """The unit raised an exception.  It is not repeated: the result would be the same."""

    unit: Unit | Task
    message: str  # one line
    details: str  # traceback


@dataclass(frozen=True, slots=True)
class Lost:
    """The worker died while it ran the unit."""

    unit: Unit | Task
    reason: str
    details: str = ""  # the end of the worker's output
    attempts: int = 1  # workers that died in it


@dataclass(frozen=True, slots=True)
class NoGraphics:
    """A worker cannot open OpenGL and gets no more units.  ``unit`` goes to another worker."""

    worker: str
    message: str
    unit: Unit | Task | None = None


@dataclass(frozen=True, slots=True)
class PairDone:
    """One pair of a unit is counted.  Optional: engines without this information send none."""

    unit: Unit


Event = Finished | Failed | Lost | NoGraphics | PairDone


@dataclass(frozen=True, slots=True)
class Slot:
    """A worker that can take one more unit.  ``last_job``: the job whose scene it has loaded."""

    key: Any
    last_job: str | None = None


class Engine(Protocol):
    """Runs units: in this process, in worker processes or on a Dask cluster.

    A context manager: ``with`` starts the workers and always stops them.
    """

    def __enter__(self) -> Engine: ...

    def __exit__(self, *exc: object) -> None: ...

    def describe(self) -> str:
        """What runs the units, in one phrase for messages."""

    def width(self) -> int:
        """Approximate number of units that run at the same time."""

    def idle(self) -> list[Slot]:
        """Workers that can take a unit.  Empty while nothing is in flight: no worker is left."""

    def submit(self, slot: Slot, unit: Unit | Task) -> None:
        """Start a unit."""

    def wait(self) -> list[Event]:
        """Block until there is an event.  Called only while units are in flight."""
