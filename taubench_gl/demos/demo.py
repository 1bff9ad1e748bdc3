"""Records of a demo: opening pair, figure, and measured numbers with their theoretical values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import Reason
from taubench_gl.demos.sheet import Sheet
from taubench_gl.demos.texts import LessonText, NumberText, ParameterText
from taubench_gl.demos.theory import edge_pixels
from taubench_gl.features import TABLE
from taubench_gl.glossary import label_of
from taubench_gl.report.mask_images import as_bytes
from taubench_gl.report.palette import REASON_COLORS

if TYPE_CHECKING:
    from taubench_gl.demos.stage import LitPair, Stage
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
class Parameter:
    """A parameter that the reader drags: an image and a number at each of its values, with the number's theory.

    ``start``: index of the value that is shown first.  The images are given, or follow from ``plane``, (h, w) uint8: at
    value i the pixels above i are marked on ``base``.  ``expected`` is None where there is no theory; ``tolerance`` is
    in the unit of the number.
    """

    about: ParameterText
    values: tuple[float, ...]
    start: int
    measured: tuple[float, ...]
    expected: tuple[float | None, ...]
    tolerance: tuple[float, ...]
    images: tuple[Array, ...] = ()  # (h, w, 3) uint8 each
    plane: Array | None = None
    base: Array | None = None  # (h, w, 3) uint8
    mark: RGB = REASON_COLORS[Reason.POSITION]

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


def value_texts(parameter: Parameter) -> list[str]:
    """The values of a parameter with their unit: ``0.125 m``, ``3,000,000 m``."""
    texts = (f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}" for value in parameter.values)
    return [f"{text} {parameter.about.unit}".strip() for text in texts]


def percent(region: Array) -> float:
    """The share of the pixels in ``region`` (h, w) bool, percent."""
    return 100.0 * float(region.mean())


def beyond(expected: Array) -> Callable[[float], tuple[float, float]]:
    """The theory of a threshold on ``expected`` (h, w): at a value, the percentage of the pixels above it.

    The tolerance is half of the pixels on the edges of their region.
    """

    def at(value: float) -> tuple[float, float]:
        region = expected > value
        return percent(region), 50.0 * edge_pixels(region) / region.size + 1e-9

    return at


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
class Lesson:
    """What a lesson measures from and draws on: its text, its opening pair, and the sheet of its figure."""

    text: LessonText
    pair: LitPair
    sheet: Sheet

    def swept(self, at: Callable[[float], tuple[Array, float, float | None, float]]) -> Parameter:
        """The parameter, measured at each of its values.

        ``at(value)``: image (h, w, 3), uint8 or float in [0, 1], measured number, its theoretical value, and the
        tolerance.
        """
        values, start = self.text.parameter.all_values()
        images, *numbers = zip(*map(at, values))
        shown = tuple(map(as_bytes, images))
        return Parameter(self.text.parameter, tuple(values.tolist()), start, *numbers, images=shown)

    def threshold(
        self, distance: Array, base: Array, theory: Callable[[float], tuple[float, float]], mark: Reason
    ) -> Parameter:
        """The parameter, a threshold: at each value, the pixels with a greater ``distance`` (h, w) are marked.

        ``base`` (h, w, 3) uint8: the image under the marks; ``theory(value)``: the percentage of these pixels and its
        tolerance; ``mark``: the reason whose color marks them.
        """
        values, start = self.text.parameter.all_values()
        plane = np.searchsorted(values, distance, side="left").astype(np.uint8)
        shares = tuple(percent(distance > value) for value in values)
        return Parameter(
            self.text.parameter, tuple(values.tolist()), start, shares, *zip(*map(theory, values)), plane=plane,
            base=base, mark=REASON_COLORS[mark],
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Measured:
    """What a lesson measures.  ``numbers``: by the names that its text has, each with its theoretical value."""

    numbers: Mapping[str, tuple[float, Expected]]
    parameter: Parameter
    screens: Screens | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """What one run of a demo measures and draws; the first finding is its main number.

    ``sheet`` is the figure, ``path`` its PNG once it is saved.
    """

    findings: tuple[Finding, ...]
    sheet: Sheet
    parameter: Parameter
    screens: Screens | None
    path: Path | None = None

    def saved(self, path: Path) -> Result:
        """The result with its figure in a file.  Raises OutputError."""
        return replace(self, path=self.sheet.save(path))

    @property
    def as_expected(self) -> bool:
        """Whether every number agrees with theory."""
        return all(f.as_expected for f in self.findings)


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """One numbered demo.

    ``measure`` measures and draws; ``scene`` builds its scene, for the viewer and other commands.
    """

    number: int
    text: LessonText
    measure: Callable[[Stage, Lesson], Measured]
    scene: Callable[[], Scene]

    def open_pair(self, stage: Stage) -> LitPair:
        """The pair of frames that the page and the viewer open at."""
        frame = self.text.opening.frame
        return stage.evaluate(self.scene(), frames=(frame - 1, frame + 1), **self.opening_settings())[1][0]

    def run(self, stage: Stage, pair: LitPair | None = None) -> Result:
        """Measure and draw.  ``pair``: the opening pair, where it is at hand.

        Raises ValueError if the text has other numbers than the lesson measures.
        """
        text = self.text
        lesson = Lesson(text, pair or self.open_pair(stage), Sheet.of(text.figure, stage.size))
        measured = self.measure(stage, lesson)
        if measured.numbers.keys() != text.numbers.keys():
            names = ", ".join(measured.numbers), ", ".join(text.numbers)
            raise ValueError(f"{text.name} measures {names[0]}, its text has {names[1]}")
        findings = tuple(Finding(*found, text.numbers[name]) for name, found in measured.numbers.items())
        return Result(findings, lesson.sheet, measured.parameter, measured.screens)

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
        scene, shown = self.scene(), reduce(or_, self.text.opening.reasons)
        camera = list(scene.camera_nodes).index(choose_camera(scene).node)
        measured = (f.name for f in TABLE if f.name != "color" and any(bit & shown for bit in (f.bit, *f.details)))
        columns = ("frustum", *measured, "color")
        return {"columns": columns, "fps": FPS, "camera": camera, **self.text.opening.settings}

    def pair_text(self) -> str:
        """The opening pair in words: ``Frames 0 and 1 at 1 frame per second; masks: position; history: eye.``"""
        opening = self.text.opening
        named = dict(opening.settings)
        fps = named.pop("fps", FPS)
        parts = [f"masks: {', '.join(map(label_of, opening.reasons))}"]
        parts += [f"{key.replace('_', ' ')}: {_value_text(value)}" for key, value in named.items()]
        frame = opening.frame
        frames = f"Frame {frame}, both eyes," if named.get("history") == "eye" else f"Frames {frame - 1} and {frame}"
        return f"{frames} at {fps:g} frame{'s' if fps != 1 else ''} per second; {'; '.join(parts)}."


def _value_text(value: Any) -> str:
    """A setting in words; a dict, as of thresholds by feature, as ``position 0.125``."""
    return ", ".join(f"{k} {v:.4g}" for k, v in value.items()) if isinstance(value, dict) else str(value)
