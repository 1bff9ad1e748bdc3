"""The texts of the lessons and of the lecture, read from ``lessons.toml``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from taubench_gl.data_files import read_toml


class NumberText(Struct, frozen=True, forbid_unknown_fields=True):
    """What is said of a measured number.  ``source``: formula or reason of its theoretical value."""

    meaning: str
    source: str
    unit: str = ""
    digits: int = 2


class ParameterText(Struct, frozen=True, forbid_unknown_fields=True):
    """What is said of the parameter that the reader drags.

    ``meaning``: of the number, such as "of the pixels are discarded"; ``source``: of its theory; ``note``: how to read
    the image.
    """

    name: str
    meaning: str
    source: str
    unit: str = ""
    number_unit: str = ""
    note: str = ""
    digits: int = 2


class LessonText(Struct, frozen=True, forbid_unknown_fields=True):
    """What a page says around the figure and the numbers of one lesson.

    ``guess``: lowest and highest answer to ``question``, in the unit of the first number.  ``see_also``: text and page
    of ``docs/``.  ``caption``: of the figure; ``screen``: what is beside the question, where that is not the mask.
    """

    name: str
    title: str
    idea: str
    look_for: tuple[str, ...]
    question: str
    guess: tuple[float, float]
    caption: str
    numbers: dict[str, NumberText]
    parameter: ParameterText
    screen: str = ""
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


def minutes_text(parts: Sequence[LecturePart]) -> str:
    """When the last of ``parts`` is due: ``minutes 3 to 6``."""
    end = sum(part.minutes for part in parts)
    return f"minutes {end - parts[-1].minutes} to {end}"
