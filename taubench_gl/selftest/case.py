"""Hard cases: their description, registration and results."""

from __future__ import annotations

import functools
import inspect
import math
import numbers
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from taubench_gl.selftest.bench import Bench

Value = float | int | str
GROUPS = (
    "projection", "depth", "camera", "offsets", "animation", "geometry", "skinning", "materials", "lighting", "direct",
    "shadows", "indirect", "path_tracing", "radiance", "sampling", "statistics", "storage", "files", "cross_checks",
    "pictures",
)  # fmt: skip
"""Groups in the order in which they run; each is a module of the same name."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a case's function.  ``error`` is compared with the case's tolerance; NaN never passes."""

    expected: Value
    measured: Value
    error: float


@dataclass(frozen=True, slots=True)
class Case:
    """One hard case with a known answer.

    ``description``: the test.  ``common_failure``: how other programs fail it.
    ``tolerance``: the largest accepted error; ``source``: where the tolerance comes from.
    """

    name: str
    group: str
    description: str
    common_failure: str
    tolerance: float
    source: str
    run: Callable[[Bench], Outcome]


@dataclass(frozen=True, slots=True)
class CaseResult:
    """One row of the self-test.  ``failure``: the text of an exception, or None."""

    case: Case
    expected: Value | None
    measured: Value | None
    error: float
    passed: bool
    failure: str | None = None

    @property
    def name(self) -> str:
        return self.case.name

    def as_json(self) -> dict[str, Any]:
        """The row as JSON values; numbers that are not finite are null."""
        return {
            "name": self.case.name,
            "group": self.case.group,
            "description": self.case.description,
            "common_failure": self.case.common_failure,
            "expected": _plain(self.expected),
            "measured": _plain(self.measured),
            "error": _plain(self.error),
            "tolerance": self.case.tolerance,
            "tolerance_source": self.case.source,
            "passed": self.passed,
            "failure": self.failure,
        }


REGISTRY: dict[str, Case] = {}


def case(
    name: str, *, source: str, tolerance: float = 0.0, each: Sequence[tuple[Any, ...]] = ((),)
) -> Callable[[Callable[..., Outcome]], Callable[..., Outcome]]:
    """Register a function of a bench as the case ``name``; its group is the name of its module.

    The first paragraph of the function's docstring is the description, the second one the common failure.
    ``each``: one case per tuple, which the function takes after the bench; the name, both paragraphs and the source
    hold its values as fields of ``str.format``, such as {0:g}.
    """

    def register(function: Callable[..., Outcome]) -> Callable[..., Outcome]:
        group = function.__module__.rpartition(".")[2]
        if group not in GROUPS:
            raise ValueError(f"{group} is not a group of cases")
        paragraphs = [" ".join(part.split()) for part in inspect.getdoc(function).split("\n\n")]
        for values in each:
            title, description, failure, why = (text.format(*values) for text in (name, *paragraphs, source))
            if title in REGISTRY:
                raise ValueError(f"two cases are named {title}")
            run = functools.partial(_run, function, values)
            REGISTRY[title] = Case(title, group, description, failure, tolerance, why, run)
        return function

    return register


def _run(function: Callable[..., Outcome], values: tuple[Any, ...], bench: Bench) -> Outcome:
    return function(bench, *values)


def count(expected: int, measured: int) -> Outcome:
    """The outcome of an exact count; the error is the difference."""
    return Outcome(int(expected), int(measured), float(abs(int(measured) - int(expected))))


def scalar(expected: float, measured: float, *, relative: bool = False) -> Outcome:
    """The outcome of a number; the error is absolute, or ``relative`` to the expected value."""
    return Outcome(float(expected), float(measured), difference(expected, measured, relative=relative))


def difference(expected: float, measured: float, *, relative: bool = False) -> float:
    """|measured - expected|, divided by |expected| if ``relative``; equal infinities differ by 0."""
    expected, measured = float(expected), float(measured)
    if expected == measured:
        return 0.0
    error = abs(measured - expected)
    return error / abs(expected) if relative else error


def worst(errors: Any) -> float:
    """Largest absolute value of an array of any shape; NaN if any is NaN, 0 for an empty array."""
    errors = np.abs(np.asarray(errors, dtype=np.float64))
    return float(errors.max()) if errors.size else 0.0


def field(expected: str, errors: Any, measured: str | None = None) -> Outcome:
    """The outcome of an array of errors: the largest one.  ``expected`` names the closed form."""
    error = worst(errors)
    return Outcome(expected, measured or f"largest error {error:.3g}", error)


def _plain(value: Any) -> Any:
    if isinstance(value, numbers.Real) and not isinstance(value, (bool, int)):
        return float(value) if math.isfinite(value) else None
    return value
