"""What engines carry to workers and back: units of work and what became of them.  Plain values that pickle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from taubench_gl.settings import Settings

ATTEMPTS = 3
"""Workers that may die on one unit before its job is given up."""

Key = tuple[str, tuple[int, ...] | None]


@dataclass(frozen=True, slots=True)
class Unit:
    """A piece of one job.  ``positions`` None: its head (what the scene says without a frame being drawn); else the
    pairs to count, ascending positions among the job's pairs (empty where it has none: its frames are drawn)."""

    job: str
    scene: str
    settings: Settings
    positions: tuple[int, ...] | None = None
    sha256: str | None = None  # of the scene when the job's head was made

    @property
    def key(self) -> Key:
        return self.job, self.positions

    @property
    def name(self) -> str:
        if self.positions is None:
            return "head"
        return f"pairs {self.positions[0]} to {self.positions[-1]}" if self.positions else "frames without pairs"


@dataclass(frozen=True, slots=True)
class Finished:
    unit: Unit
    data: bytes  # head: JSON; pairs: a Parquet file


@dataclass(frozen=True, slots=True)
class Failed:
    """The unit raised.  It is not tried again: the same would happen."""

    unit: Unit
    message: str  # one line
    details: str  # traceback


@dataclass(frozen=True, slots=True)
class Lost:
    """The worker died with the unit."""

    unit: Unit
    reason: str
    details: str = ""  # the last it wrote
    tried: int = 1  # workers it has cost


@dataclass(frozen=True, slots=True)
class NoGraphics:
    """A worker cannot open OpenGL; it gets nothing more to do.  ``unit`` goes to another."""

    worker: str
    message: str
    unit: Unit | None = None


@dataclass(frozen=True, slots=True)
class PairDone:
    """Progress within a unit; engines that hear nothing of it leave it out."""

    unit: Unit


Event = Finished | Failed | Lost | NoGraphics | PairDone


@dataclass(frozen=True, slots=True)
class Slot:
    """Room for one more unit.  ``last_job``: what is loaded there already."""

    key: Any
    last_job: str | None = None
