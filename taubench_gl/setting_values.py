"""Values of settings as people write them: how text is read (``parse_*``), and what is wrong with one (``*_fault``).

A fault takes the name of a field and its value, and is one line, None where the value is allowed.
"""

from __future__ import annotations

import contextlib
import math
import operator
import re
from typing import Any

from taubench_gl.errors import SettingsError
from taubench_gl.features import COLUMNS, FEATURES
from taubench_gl.fields import value_text

AUTO = "auto"
"""Value of ``light_unit``, ``exposure`` and ``environment`` until ``evaluation.resolve_lighting`` has chosen one."""

ENVIRONMENTS = ("auto", "none", "default")
"""Values of ``environment`` besides a radiance (r, g, b) and the path of an image."""

ENVIRONMENT_FILES = (".hdr", ".exr")
MAX_EXPOSURE = 1e30
"""Radiance times exposure stays within float32; 1 / ``MAX_EXPOSURE`` is the least exposure."""

PAIR_SAMPLES = ("auto", "all", "every:K", "strata:H")
_PAIR_SAMPLE = re.compile(r"auto|all|(every|strata):([1-9][0-9]{0,6})")

PAPER_SIZE = (1920, 1080)
"""(width, height) in pixels of the images of Table 4, the size ``paper``."""

MAX_SIZE = 16384
"""Largest width and height of an image, pixels."""

FLOAT32_MAX = 3.4e38
"""Largest number, in two digits, that float32 holds."""


def size_fault(name: str, value: Any) -> str | None:
    return None if all(1 <= side <= MAX_SIZE for side in value) else f"{name} is {value[0]}x{value[1]}"


def columns_fault(_name: str, value: Any) -> str | None:
    return next((f"no column is named {column!r:.60}" for column in value if column not in COLUMNS), None)


def environment_fault(name: str, value: Any) -> str | None:
    if isinstance(value, str):
        return None if value in ENVIRONMENTS or value.lower().endswith(ENVIRONMENT_FILES) else value_text(name, value)
    return None if len(value) == 3 and all(0 <= c <= FLOAT32_MAX for c in value) else value_text(name, value)


def exposure_fault(name: str, value: Any) -> str | None:
    if isinstance(value, str):
        return None if value == AUTO else value_text(name, value)
    return None if 1.0 / MAX_EXPOSURE <= value <= MAX_EXPOSURE else value_text(name, value)


def pairs_fault(name: str, value: Any) -> str | None:
    return None if _PAIR_SAMPLE.fullmatch(value) else value_text(name, value)


def thresholds_fault(_name: str, value: Any) -> str | None:
    for feature, threshold in value.items():
        if feature not in FEATURES:
            return f"no feature is named {feature!r:.60}"
        if not (math.isfinite(threshold) and threshold >= 0):
            return f"threshold of {feature} is {threshold!r}"
    return None


def parse_size(value: Any) -> tuple[int, int]:
    """(width, height) of ``"1280x720"``, ``"paper"`` or two numbers.  Raises SettingsError; checks no range."""
    if isinstance(value, str) and value == "paper":
        return PAPER_SIZE
    sides = value.lower().split("x") if isinstance(value, str) else value
    with contextlib.suppress(TypeError, ValueError):
        width, height = (int(side) if isinstance(side, str) else operator.index(side) for side in sides)
        return width, height
    raise SettingsError(f"{value!r:.60} is not a size", hint="give a size such as 1280x720, or paper", setting="size")


def parse_frames(value: Any) -> tuple[int | None, int | None]:
    """(A, B) of ``"A:B"``, a range, a slice or two numbers; a missing end is None.  Raises SettingsError."""
    hint = "give a range of frames such as 0:24, 100: or :-1"
    if isinstance(value, range | slice):
        if value.step not in (None, 1):
            hint = 'every K-th pair: pairs="every:K"'
            raise SettingsError(f"frames have the step {value.step}", hint=hint, setting="frames")
        value = (value.start, value.stop)
    ends = [end.strip() or None for end in value.split(":")] if isinstance(value, str) else value
    with contextlib.suppress(TypeError, ValueError):
        first, stop = (int(e) if isinstance(e, str) else e if e is None else operator.index(e) for e in ends)
        return first, stop
    raise SettingsError(f"{value!r:.60} is not a range of frames", hint=hint, setting="frames")


def parse_threshold(text: str) -> tuple[str, float]:
    """(feature, threshold) of ``"normal=0.1"``.  Raises SettingsError; the name is checked later."""
    name, equals, number = text.partition("=")
    with contextlib.suppress(ValueError):
        if equals:
            return name.strip(), float(number)
    raise SettingsError(f"{text!r:.60} is not a threshold", hint="give one such as normal=0.1", setting="thresholds")


def parse_thresholds(value: Any) -> Any:
    """A mapping, from thresholds as text, ``"normal=0.1,color=0.2"``, or from a sequence of texts."""
    texts = value.split(",") if isinstance(value, str) else value
    if isinstance(texts, list | tuple) and all(isinstance(text, str) for text in texts):
        return dict(map(parse_threshold, texts))
    return value


def parse_columns(value: Any) -> Any:
    """Names of columns without duplicates, from a sequence or comma-separated text; a set in the order of Table 4."""
    if isinstance(value, str):
        value = [name.strip() for name in value.split(",")]
    if isinstance(value, set | frozenset):
        value = [name for name in COLUMNS if name in value] + sorted(map(str, value - {*COLUMNS}))
    return tuple(dict.fromkeys(map(str, value))) if isinstance(value, list | tuple) else value


def parse_animation(value: Any) -> Any:
    """One animation stands for a sequence of one; an empty sequence for all."""
    return (value,) if isinstance(value, str | int) else value or None


def parse_number(value: Any) -> Any:
    """Text that is a number as that number."""
    with contextlib.suppress(ValueError):
        return float(value) if isinstance(value, str) else value
    return value


def parse_environment(text: Any) -> Any:
    """The value of ``environment`` that ``text`` spells: one number or R,G,B is a radiance (r, g, b).

    Values that are neither text nor numbers are returned unchanged.
    """
    if isinstance(text, float | int) and not isinstance(text, bool):
        return (text,) * 3
    if not isinstance(text, str):
        return text
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return text
    return numbers * 3 if len(numbers) == 1 else numbers
