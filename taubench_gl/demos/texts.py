"""The lessons and the lecture as ``lessons.toml`` states them: texts, opening pair, figure and parameter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from msgspec import Struct

from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.data_files import read_toml
from taubench_gl.glossary import REASONS

BY_KEY = {term.key: reason for reason, term in REASONS.items()}
ReasonKey = Literal[tuple(BY_KEY)]


class NumberText(Struct, frozen=True, forbid_unknown_fields=True):
    """What is said of a measured number.  ``source``: formula or reason of its theoretical value."""

    meaning: str
    source: str
    unit: str = ""
    digits: int = 2


class ColorBar(Struct, frozen=True, forbid_unknown_fields=True):
    """The scale of images whose colors are values.

    ``label``: the quantity and its unit; ``ticks``: place in [0, 1] and text; ``colors``: a color map of Matplotlib;
    ``panel``: the column of the figure that it is below.
    """

    label: str
    ticks: tuple[tuple[float, str], ...]
    colors: str = "viridis"
    panel: int = 0


class ParameterText(Struct, frozen=True, forbid_unknown_fields=True):
    """The parameter that the reader drags.

    ``meaning``: of the number, such as "of the pixels are discarded"; ``source``: of its theory; ``start``: the value
    that is shown first, by default the paper's threshold; ``values``: each value, or ``geometric``: lowest, highest and
    count of a geometric series; ``note``: how to read the image; ``bar``: its color bar.
    """

    name: str
    meaning: str
    source: str
    start: float = DEFAULT_THRESHOLD
    values: tuple[float, ...] = ()
    geometric: tuple[float, float, int] | None = None
    unit: str = ""
    number_unit: str = ""
    note: str = ""
    digits: int = 2
    bar: ColorBar | None = None

    def __post_init__(self) -> None:
        if self.geometric is None and self.start not in self.values:
            raise ValueError(f"start {self.start:g} is not one of the values")

    def all_values(self) -> tuple[np.ndarray, int]:
        """The values (n,), and the index of ``start``, which replaces the nearest value of a geometric series."""
        if self.geometric is None:
            return np.array(self.values), self.values.index(self.start)
        values = np.geomspace(*self.geometric)
        first = int(np.argmin(np.abs(np.log(values / self.start))))
        values[first] = self.start
        return values, first


class Opening(Struct, frozen=True, forbid_unknown_fields=True):
    """The pair of frames that page and viewer open at.

    ``masks``: keys of the reasons that are colored; ``frame``: the current one; ``settings``: fields of Settings.
    """

    masks: tuple[ReasonKey, ...]
    frame: int = 1
    settings: dict[str, Any] = {}

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """The reasons that are colored."""
        return tuple(BY_KEY[key] for key in self.masks)


class FigureText(Struct, frozen=True, forbid_unknown_fields=True):
    """The layout of a figure, in the units of ``Sheet``.

    ``panels``: columns and rows; ``ratio``: width and height of a panel, where it is not that of the stage; ``below``:
    room for plots; ``bar``: below a panel; ``legend``: keys of reasons, or texts with ``#rrggbb``; ``plots``: by name,
    the arguments of ``Axes.set``, ``place`` (left, top below the panels, width, height), and ``key``, the arguments of
    ``Axes.legend``.
    """

    panels: tuple[int, int]
    ratio: tuple[int, int] | None = None
    below: float = 0.0
    bar: ColorBar | None = None
    legend: tuple[ReasonKey | tuple[str, str], ...] = ()
    plots: dict[str, dict[str, Any]] = {}


class LessonText(Struct, frozen=True, forbid_unknown_fields=True):
    """One lesson.

    ``guess``: lowest and highest answer to ``question``, in the unit of the first number.  ``see_also``: text and page
    of ``docs/``.  ``caption``: of the figure; ``screen``: what is beside the question, where that is not the mask;
    ``scene``: the lesson whose scene it shows, by default its own.
    """

    name: str
    title: str
    idea: str
    look_for: tuple[str, ...]
    question: str
    guess: tuple[float, float]
    caption: str
    opening: Opening
    figure: FigureText
    numbers: dict[str, NumberText]
    parameter: ParameterText
    screen: str = ""
    scene: str = ""
    see_also: tuple[tuple[str, str], ...] = ()


class LecturePart(Struct, frozen=True, forbid_unknown_fields=True):
    """A lesson of the lecture: its demo, the planned minutes, and what the speaker says at each step of its page."""

    demo: str
    minutes: int
    idea: str
    question: str
    figure: str
    parameter: str
    numbers: str = "Skip this step, unless somebody asks where a number comes from."


class Texts(Struct, frozen=True, forbid_unknown_fields=True):
    """The content of ``lessons.toml``: lessons in the order of their numbers, and the lecture in order of time."""

    lesson: tuple[LessonText, ...]
    lecture: tuple[LecturePart, ...]


TEXTS = read_toml(Path(__file__).with_name("lessons.toml"), Texts)


def lesson_text(name: str) -> LessonText:
    """The lesson that has a name.  Raises StopIteration for others."""
    return next(text for text in TEXTS.lesson if text.name == name)


def minutes_text(parts: Sequence[LecturePart]) -> str:
    """When the last of ``parts`` is due: ``minutes 3 to 6``."""
    end = sum(part.minutes for part in parts)
    return f"minutes {end - parts[-1].minutes} to {end}"
