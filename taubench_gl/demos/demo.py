"""Records of a demo: one idea, things to look for, a figure, and measured numbers with their theoretical values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.theory import edge_pixels

if TYPE_CHECKING:
    from taubench_gl.demos.sheet import Sheet
    from taubench_gl.demos.stage import Stage
    from taubench_gl.scene.model import Scene

Array = np.ndarray
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

    @classmethod
    def share(cls, region: Array, source: str) -> Expected:
        """Percent of the pixels in ``region`` (h, w) bool, ± half of the pixels on its edge."""
        return cls.near(100.0 * float(region.mean()), 50.0 * edge_pixels(region) / region.size, source)

    def met_by(self, number: float) -> bool:
        """Whether ``number`` is in the range; False for NaN."""
        return bool(self.low <= number <= self.high)


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

    @property
    def expected_text(self) -> str:
        """``36.18 ± 0.44 %``, ``100.00 % exactly``."""
        value, exactly, _ = self.expected.text.partition(" exactly")
        return f"{value} {self.unit}".strip() + exactly


@dataclass(frozen=True, slots=True)
class ColorBar:
    """The colors of images of values.  ``colors``: name of a color map; ``ticks``: place in [0, 1] and text."""

    label: str
    ticks: tuple[tuple[float, str], ...]
    colors: str = "viridis"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter that the reader drags: an image and a number at each of its values, with the number's theory.

    The images are given, or follow from ``plane``, (h, w) uint8: at value i the pixels above i are marked on ``base``.
    ``expected`` is None where there is no theory; ``tolerance`` is in the unit of the number.
    """

    name: str
    unit: str
    values: tuple[float, ...]
    meaning: str  # of the number: "of the pixels are discarded"
    number_unit: str
    measured: tuple[float, ...]
    expected: tuple[float | None, ...]
    tolerance: tuple[float, ...]
    source: str  # of the theory
    start: int = 0  # index of the value that is shown first
    images: tuple[Array, ...] = ()  # (h, w, 3) uint8 each
    plane: Array | None = None
    base: Array | None = None  # (h, w, 3) uint8
    mark: RGB = (0, 114, 178)
    note: str = ""  # how to read the image: colors, scale
    bar: ColorBar | None = None
    digits: int = 2

    def picture(self, i: int) -> Array:
        """The image at value ``i``.  (h, w, 3) uint8."""
        if self.plane is None or self.base is None:
            return self.images[i]
        out = self.base.copy()
        out[self.plane > i] = self.mark
        return out

    @property
    def as_expected(self) -> tuple[bool, ...]:
        """For every value: whether the number agrees with its theory; True where there is none."""
        rows = zip(self.measured, self.expected, self.tolerance, strict=True)
        return tuple(e is None or abs(m - e) <= t for m, e, t in rows)


def value_texts(parameter: Parameter) -> list[str]:
    """The values of a parameter with their unit: ``0.125 m``, ``3,000,000 m``."""
    texts = (f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}" for value in parameter.values)
    return [f"{text} {parameter.unit}".strip() for text in texts]


def threshold_parameter(
    distance: Array, values: Array, expected: Array, base: Array, mark: RGB, *, start: float, **texts: Any
) -> Parameter:
    """A threshold: at each of ``values``, pixels with a greater ``distance`` (h, w) are marked and counted.

    ``expected``: distances in theory, (h, w); the tolerance is half of the pixels on the edges of its marked region.
    ``base`` (h, w, 3) uint8; ``start``: the value that is shown first, in place of the nearest one; ``texts``: fields
    of Parameter.
    """
    values, first = with_value(values, start)
    regions = [expected > value for value in values]
    return Parameter(
        values=tuple(map(float, values)),
        meaning=texts.pop("meaning", "of the pixels are discarded"),
        number_unit="%",
        measured=tuple(100.0 * float((distance > value).mean()) for value in values),
        expected=tuple(100.0 * float(region.mean()) for region in regions),
        tolerance=tuple(50.0 * edge_pixels(region) / region.size + 1e-9 for region in regions),
        start=first,
        plane=np.searchsorted(values, distance, side="left").astype(np.uint8),
        base=base,
        mark=mark,
        **texts,
    )


def with_value(values: Array, value: float) -> tuple[Array, int]:
    """Positive ``values`` (n,) with ``value`` in place of the nearest one, and its index."""
    at = int(np.argmin(np.abs(np.log(np.asarray(values) / value))))
    return np.where(np.arange(len(values)) == at, value, values), at


@dataclass(frozen=True, slots=True)
class Opening:
    """The pair of frames that page and viewer open at.

    ``frame``: the current one; ``masks``: the reasons that are colored; ``settings``: fields of Settings.
    """

    masks: tuple[Reason, ...]
    frame: int = 1
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Question:
    """What the reader guesses before seeing the first finding: a number from ``low`` to ``high`` in its unit.

    Neither the idea nor a frame states the answer, and the page shows nothing else before the guess.
    """

    text: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Screens:
    """Images beside the question, where the opening's pair and masks do not show what is asked.  (h, w, 3) uint8 each.

    ``answer``: shown after the guess, in place of the mask; ``note``: what it shows; ``frames``: previous and current
    frame, None for those of the pair.
    """

    answer: Array
    note: str
    frames: tuple[Array, Array] | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """Findings and figure of a demo; the first finding is its main number.

    ``sheet`` is the figure, ``path`` its PNG once it is saved; ``colors``: legend entry -> 8-bit sRGB.
    """

    findings: tuple[Finding, ...]
    sheet: Sheet
    caption: str
    parameter: Parameter
    colors: Mapping[str, RGB] = field(default_factory=dict)
    screens: Screens | None = None
    path: Path | None = None

    def saved(self, path: Path) -> Result:
        """The result with its figure in a file.  Raises OutputError."""
        return replace(self, path=self.sheet.save(path), colors={**self.sheet.colors, **self.colors})

    @property
    def as_expected(self) -> bool:
        """Whether every number agrees with theory."""
        return all(f.as_expected for f in self.findings)


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """One numbered demo.

    ``idea``: two or three sentences for students; ``look_for``: what to notice in the figure; ``question``: asked
    before the first finding is shown.  ``run`` measures and draws; ``scene`` builds its scene, for the viewer and
    other commands; ``opening``: the pair of it that page and viewer show.
    """

    number: int
    name: str
    title: str
    run: Callable[[Stage], Result]
    idea: str
    look_for: tuple[str, ...]
    question: Question
    opening: Opening
    scene: Callable[[], Scene]
    see_also: tuple[tuple[str, str], ...] = ()  # (text, page of docs/)

    @property
    def stem(self) -> str:
        """``03-behind``: start of its file names."""
        return f"{self.number:02d}-{self.name}"


REGISTRY: dict[str, Demo] = {}


def demo(number: int, name: str, title: str, **fields: Any) -> Callable[[Callable[[Stage], Result]], Any]:
    """Register a function as the run of demo ``number``; ``fields``: the others of Demo."""

    def register(run: Callable[[Stage], Result]) -> Callable[[Stage], Result]:
        if name in REGISTRY or any(d.number == number for d in REGISTRY.values()):
            raise ValueError(f"two demos have number {number} or name {name}")
        REGISTRY[name] = Demo(number, name, title, run, **fields)
        return run

    return register
