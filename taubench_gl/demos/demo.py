"""Records of a demo: opening pair, figure, and measured numbers with their theoretical values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import Reason
from taubench_gl.demos.texts import LessonText, NumberText, ParameterText
from taubench_gl.demos.theory import edge_pixels
from taubench_gl.features import TABLE
from taubench_gl.glossary import label_of
from taubench_gl.report.mask_images import as_bytes
from taubench_gl.report.palette import REASON_COLORS

if TYPE_CHECKING:
    from taubench_gl.demos.sheet import Sheet
    from taubench_gl.demos.stage import Stage
    from taubench_gl.scene.model import Scene

Array = np.ndarray
RGB = tuple[int, int, int]
FPS = 1.0
"""Frames per second of a demo whose opening names no other rate."""


@dataclass(frozen=True, slots=True)
class Expected:
    """Theoretical value of a number as a range, both ends inclusive; ``text``: the range for display."""

    low: float
    high: float
    text: str

    @classmethod
    def near(cls, value: float, tolerance: float, digits: int = 2) -> Expected:
        """The range ``value`` ± ``tolerance``, both in the unit of the number; ``digits``: decimals in its text."""
        text = f"{value:.{digits}f}" + (f" ± {tolerance:.{digits}f}" if tolerance else " exactly")
        return cls(value - tolerance, value + tolerance, text)

    @classmethod
    def between(cls, low: float, high: float, digits: int = 2) -> Expected:
        """The range ``low`` to ``high``, of which one may be infinite; ``digits``: decimals in its text."""
        if math.isinf(high):
            text = f"at least {low:.{digits}f}"
        else:
            text = f"at most {high:.{digits}f}" if math.isinf(low) else f"{low:.{digits}f} to {high:.{digits}f}"
        return cls(low, high, text)

    @classmethod
    def share(cls, region: Array) -> Expected:
        """The share of the pixels in ``region`` (h, w) bool, percent, ± half of the pixels on its edge."""
        return cls.near(100.0 * float(region.mean()), 50.0 * edge_pixels(region) / region.size)

    def met_by(self, number: float) -> bool:
        """Whether ``number`` is in the range.  NaN never is."""
        return bool(self.low <= number <= self.high)


@dataclass(frozen=True, slots=True)
class Finding:
    """A measured number, its theoretical value in the same unit, and what the lesson says of it."""

    number: float
    expected: Expected
    about: NumberText

    @property
    def as_expected(self) -> bool:
        """Whether the measured number is in the theoretical range."""
        return self.expected.met_by(self.number)

    @property
    def text(self) -> str:
        """The measured number with its unit: ``31.25 %``."""
        return f"{self.number:.{self.about.digits}f} {self.about.unit}".strip()

    @property
    def expected_text(self) -> str:
        """The theoretical range with its unit: ``36.18 ± 0.44 %``, ``100.00 % exactly``."""
        value, exactly, _ = self.expected.text.partition(" exactly")
        return f"{value} {self.about.unit}".strip() + exactly


@dataclass(frozen=True, slots=True)
class ColorBar:
    """The scale of images whose colors are values.

    ``label``: the quantity and its unit; ``ticks``: place in [0, 1] and text; ``colors``: a color map of Matplotlib.
    """

    label: str
    ticks: tuple[tuple[float, str], ...]
    colors: str = "viridis"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter that the reader drags: an image and a number at each of its values, with the number's theory.

    The images are given, or follow from ``plane``, (h, w) uint8: at value i the pixels above i are marked on ``base``.
    ``expected`` is None where there is no theory; ``tolerance`` is in the unit of the number; ``about``: the lesson's
    text of the parameter, None until the result has its texts.
    """

    values: tuple[float, ...]
    measured: tuple[float, ...]
    expected: tuple[float | None, ...]
    tolerance: tuple[float, ...]
    about: ParameterText | None = None
    start: int = 0  # index of the value that is shown first
    images: tuple[Array, ...] = ()  # (h, w, 3) uint8 each
    plane: Array | None = None
    base: Array | None = None  # (h, w, 3) uint8
    mark: RGB = REASON_COLORS[Reason.POSITION]
    bar: ColorBar | None = None

    def picture(self, i: int) -> Array:
        """The image at the value with index ``i``, (h, w, 3) uint8."""
        if self.plane is None or self.base is None:
            return self.images[i]
        out = self.base.copy()
        out[self.plane > i] = self.mark
        return out

    @property
    def as_expected(self) -> tuple[bool, ...]:
        """Whether the number at each value agrees with its theory; True where there is no theory."""
        rows = zip(self.measured, self.expected, self.tolerance, strict=True)
        return tuple(e is None or abs(m - e) <= t for m, e, t in rows)


def swept(
    values: Sequence[float],
    at: Callable[[float], tuple[Array, float, float | None, float]],
    *,
    start: float,
    bar: ColorBar | None = None,
) -> Parameter:
    """A parameter that is measured at each of ``values``.

    ``at(value)``: image (h, w, 3), uint8 or float in [0, 1], measured number, its theoretical value, and the tolerance.
    ``start``: the value that is shown first, or one near it; ``bar``: of the images.
    """
    images, measured, expected, tolerance = zip(*map(at, values))
    first = int(np.argmin(np.abs(np.asarray(values) - start)))
    shown = tuple(map(as_bytes, images))
    return Parameter(tuple(map(float, values)), measured, expected, tolerance, start=first, images=shown, bar=bar)


def value_texts(parameter: Parameter) -> list[str]:
    """The values of a parameter with their unit: ``0.125 m``, ``3,000,000 m``."""
    texts = (f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}" for value in parameter.values)
    return [f"{text} {parameter.about.unit}".strip() for text in texts]


def threshold_parameter(
    distance: Array,
    values: Array,
    expected: Array,
    base: Array,
    mark: RGB,
    *,
    start: float,
) -> Parameter:
    """A threshold: at each of ``values``, the pixels with a greater ``distance`` (h, w) are marked and counted.

    ``expected``: distances in theory, (h, w); the tolerance is half of the pixels on the edges of the region that a
    threshold marks.  ``base`` (h, w, 3) uint8: the image under the marks; ``start``: the value that is shown first, in
    place of the nearest one.
    """
    values, first = with_value(values, start)
    regions = [expected > value for value in values]
    return Parameter(
        tuple(map(float, values)),
        tuple(100.0 * float((distance > value).mean()) for value in values),
        tuple(100.0 * float(region.mean()) for region in regions),
        tuple(50.0 * edge_pixels(region) / region.size + 1e-9 for region in regions), start=first,
        plane=np.searchsorted(values, distance, side="left").astype(np.uint8), base=base, mark=mark,
    )  # fmt: skip


def percent(region: Array) -> float:
    """The share of the pixels in ``region`` (h, w) bool, percent."""
    return 100.0 * float(region.mean())


def with_value(values: Array, value: float) -> tuple[Array, int]:
    """Positive ``values`` (n,) with ``value`` in place of the one with the nearest logarithm, and its index."""
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
class Screens:
    """Images beside the question, where the opening's pair and masks do not show what is asked.

    Each image is (h, w, 3), uint8 or float in [0, 1].
    ``answer``: shown after the guess, in place of the mask; ``frames``: previous and current frame, None for those of
    the pair.
    """

    answer: Array
    frames: tuple[Array, Array] | None = None


@dataclass(frozen=True, slots=True)
class Measured:
    """What a lesson measures and draws.

    ``numbers``: by the names that its text has, each with its theoretical value; ``sheet``: the figure; ``colors``:
    legend entry -> 8-bit sRGB.
    """

    numbers: Mapping[str, tuple[float, Expected]]
    sheet: Sheet
    parameter: Parameter
    colors: Mapping[str, RGB] = field(default_factory=dict)
    screens: Screens | None = None

    def with_text(self, text: LessonText) -> Result:
        """The result, with what the lesson's text says of each number and of the parameter.  Raises ValueError."""
        if self.numbers.keys() != text.numbers.keys():
            raise ValueError(f"{text.name} measures {', '.join(self.numbers)}, its text has {', '.join(text.numbers)}")
        findings = tuple(Finding(*pair, text.numbers[name]) for name, pair in self.numbers.items())
        return Result(findings, self.sheet, replace(self.parameter, about=text.parameter), self.colors, self.screens)


@dataclass(frozen=True, slots=True)
class Result:
    """What one run of a demo measures and draws; the first finding is its main number.

    ``sheet`` is the figure, ``path`` its PNG once it is saved; ``colors``: legend entry -> 8-bit sRGB.
    """

    findings: tuple[Finding, ...]
    sheet: Sheet
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

    ``measure`` measures and draws; ``scene`` builds its scene, for the viewer and other commands; ``opening``: the pair
    of frames of that scene that page and viewer show.
    """

    number: int
    text: LessonText
    measure: Callable[[Stage], Measured]
    scene: Callable[[], Scene]
    opening: Opening

    def run(self, stage: Stage) -> Result:
        """Measure and draw; the result has the texts of the numbers."""
        return self.measure(stage).with_text(self.text)

    @property
    def name(self) -> str:
        """The word that selects the demo on the command line."""
        return self.text.name

    @property
    def stem(self) -> str:
        """The start of the names of its files: ``03-behind``."""
        return f"{self.number:02d}-{self.name}"

    def opening_settings(self) -> dict[str, Any]:
        """Fields of Settings of the opening pair: columns of its masks and color, the camera, and what it sets.

        The camera is named, because an evaluation of a still scene otherwise has a framing orbit.
        """
        scene = self.scene()
        camera = list(scene.camera_nodes).index(choose_camera(scene).node)
        return {"columns": self._columns(), "fps": FPS, "camera": camera, **self.opening.settings}

    def _columns(self) -> tuple[str, ...]:
        """The columns that measure the masks of the opening, and color."""
        shown = 0
        for mask in self.opening.masks:
            shown |= mask
        measured = (f.name for f in TABLE if f.name != "color" and any(bit & shown for bit in (f.bit, *f.details)))
        return ("frustum", *measured, "color")

    def pair_text(self) -> str:
        """The opening pair in words: ``Frames 0 and 1 at 1 frame per second; masks: position; history: eye.``"""
        frame, settings = self.opening.frame, self.opening.settings
        fps = settings.get("fps", FPS)
        named = {key: value for key, value in settings.items() if key not in ("fps", "columns")}
        parts = [f"masks: {', '.join(map(label_of, self.opening.masks))}"]
        parts += [f"{key.replace('_', ' ')}: {_value_text(value)}" for key, value in named.items()]
        frames = f"Frame {frame}, both eyes," if named.get("history") == "eye" else f"Frames {frame - 1} and {frame}"
        return f"{frames} at {fps:g} frame{'s' if fps != 1 else ''} per second; {'; '.join(parts)}."


def _value_text(value: Any) -> str:
    """A setting in words; a dict, as of thresholds by feature, as ``position 0.125``."""
    return ", ".join(f"{k} {v:.4g}" for k, v in value.items()) if isinstance(value, dict) else str(value)
