"""Records of a demo: one idea, things to look for, figures, and measured numbers with their theoretical values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from taubench_gl.demos.stage import Stage
    from taubench_gl.scene.model import Scene

RGB = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Expected:
    """Theoretical value of a number as a range, both ends inclusive.

    ``text``: the range for display; ``source``: formula or reason.
    """

    low: float
    high: float
    text: str
    source: str

    @classmethod
    def near(cls, value: float, tolerance: float, source: str, digits: int = 2) -> Expected:
        """``value`` ± ``tolerance``, in the unit of the number."""
        text = f"{value:.{digits}f}" + (f" ± {tolerance:.{digits}f}" if tolerance else " exactly")
        return cls(value - tolerance, value + tolerance, text, source)

    @classmethod
    def between(cls, low: float, high: float, source: str, digits: int = 2) -> Expected:
        """``low`` to ``high``; either may be infinite."""
        if math.isinf(high):
            text = f"at least {low:.{digits}f}"
        else:
            text = f"at most {high:.{digits}f}" if math.isinf(low) else f"{low:.{digits}f} to {high:.{digits}f}"
        return cls(low, high, text, source)

    def met_by(self, number: float) -> bool:
        """Whether ``number`` is in the range; False for NaN."""
        return bool(self.low <= number <= self.high)


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of a demo.  ``path``: PNG; ``colors``: legend entry -> 8-bit sRGB."""

    path: Path
    caption: str
    colors: Mapping[str, RGB] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Finding:
    """A measured number, its meaning, and its theoretical value in the same unit."""

    number: float
    unit: str
    meaning: str
    expected: Expected
    digits: int = 2

    @property
    def as_expected(self) -> bool:
        return self.expected.met_by(self.number)

    @property
    def text(self) -> str:
        """``31.25 %``."""
        return f"{self.number:.{self.digits}f} {self.unit}".strip()


@dataclass(frozen=True, slots=True)
class Result:
    """Findings and figures of a demo; the first finding is its main number."""

    findings: tuple[Finding, ...]
    figures: tuple[Figure, ...]

    @property
    def number(self) -> float:
        return self.findings[0].number

    @property
    def unit(self) -> str:
        return self.findings[0].unit

    @property
    def meaning(self) -> str:
        return self.findings[0].meaning

    @property
    def expected(self) -> Expected:
        return self.findings[0].expected

    @property
    def as_expected(self) -> bool:
        """Whether every number agrees with theory."""
        return all(f.as_expected for f in self.findings)


@dataclass(frozen=True, slots=True)
class Demo:
    """One numbered demo.

    ``idea``: two or three sentences for students; ``look_for``: what to notice in the figures.  ``run`` writes
    figures into a folder and returns its result; ``scene`` builds its scene, for the viewer and other commands.
    """

    number: int
    name: str
    title: str
    idea: str
    look_for: tuple[str, ...]
    run: Callable[[Stage, Path], Result]
    scene: Callable[[], Scene] | None = None
    see_also: tuple[tuple[str, str], ...] = ()  # (text, page of docs/)

    @property
    def stem(self) -> str:
        """``03-behind``: start of its file names."""
        return f"{self.number:02d}-{self.name}"


REGISTRY: dict[str, Demo] = {}


def demo(
    number: int,
    name: str,
    title: str,
    *,
    idea: str,
    look_for: tuple[str, ...],
    scene: Callable[[], Scene] | None = None,
    see_also: tuple[tuple[str, str], ...] = (),
) -> Callable[[Callable[[Stage, Path], Result]], Callable[[Stage, Path], Result]]:
    """Register a function as the run of demo ``number``."""

    def register(run: Callable[[Stage, Path], Result]) -> Callable[[Stage, Path], Result]:
        if name in REGISTRY or any(d.number == number for d in REGISTRY.values()):
            raise ValueError(f"two demos have number {number} or name {name}")
        REGISTRY[name] = Demo(number, name, title, idea, look_for, run, scene, see_also)
        return run

    return register
