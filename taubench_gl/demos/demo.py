"""What a demo is: one idea, what to look for, and a run that ends with pictures and a number with its expectation."""

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
    """What theory says of the number: a closed form (``value`` and ``tolerance``) or bounds.  ``source``: whence.

    ``low`` and ``high`` are both inclusive.
    """

    low: float
    high: float
    said: str
    source: str

    @classmethod
    def near(cls, value: float, tolerance: float, source: str, digits: int = 2) -> Expected:
        """``value`` give or take ``tolerance``, in the unit of the number."""
        said = f"{value:.{digits}f}" + (f" ± {tolerance:.{digits}f}" if tolerance else " exactly")
        return cls(value - tolerance, value + tolerance, said, source)

    @classmethod
    def between(cls, low: float, high: float, source: str, digits: int = 2) -> Expected:
        """``low`` to ``high``; an infinite end is no bound."""
        if math.isinf(high):
            said = f"at least {low:.{digits}f}"
        else:
            said = f"at most {high:.{digits}f}" if math.isinf(low) else f"{low:.{digits}f} to {high:.{digits}f}"
        return cls(low, high, said, source)

    def met_by(self, number: float) -> bool:
        """False for NaN."""
        return bool(self.low <= number <= self.high)


@dataclass(frozen=True, slots=True)
class Figure:
    """A picture of a demo.  ``path``: PNG; ``caption``: what it shows; ``colors``: meaning -> 8-bit sRGB used in it."""

    path: Path
    caption: str
    colors: Mapping[str, RGB] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Finding:
    """A number the engine gave, what it means, and what it should be, in the same unit."""

    number: float
    unit: str
    meaning: str
    expected: Expected
    digits: int = 2

    @property
    def as_expected(self) -> bool:
        return self.expected.met_by(self.number)

    @property
    def said(self) -> str:
        """``31.25 %``."""
        return f"{self.number:.{self.digits}f} {self.unit}".strip()


@dataclass(frozen=True, slots=True)
class Result:
    """What a demo found.  ``findings``: the first is *the* number of the demo; ``figures``: its pictures."""

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
        """Whether every number is what theory says."""
        return all(f.as_expected for f in self.findings)


@dataclass(frozen=True, slots=True)
class Demo:
    """One numbered demo.

    ``idea``: two or three sentences that a student understands; ``look_for``: where to point.  ``run`` draws into a
    folder and returns its result; ``scene`` makes the scene it is about, to be looked at in the viewer.
    """

    number: int
    name: str
    title: str
    idea: str
    look_for: tuple[str, ...]
    run: Callable[[Stage, Path], Result]
    scene: Callable[[], Scene] | None = None
    see_also: tuple[tuple[str, str], ...] = ()  # (what, page of docs/)

    @property
    def stem(self) -> str:
        """``03-behind``: what its files are called."""
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
            raise ValueError(f"two demos are {number} or {name}")
        REGISTRY[name] = Demo(number, name, title, idea, look_for, run, scene, see_also)
        return run

    return register
