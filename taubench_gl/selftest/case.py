"""A hard case, how it is registered, and what running it gives."""

from __future__ import annotations

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
    "projection", "depth", "camera", "offsets", "animation", "geometry",
    "skinning", "lighting", "radiance", "statistics", "storage", "files",
)  # fmt: skip
"""Themes in the order in which they are run and printed; each has a module of cases of the same name."""


@dataclass(frozen=True, slots=True)
class Naive:
    """The obvious formula on the same input: what it gives.  ``error`` is in the unit of the case's own error."""

    formula: str
    measured: Value
    error: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a case's function returns.  ``error`` is compared with the case's tolerance; NaN never passes."""

    expected: Value
    measured: Value
    error: float
    naive: Naive | None = None


@dataclass(frozen=True, slots=True)
class Case:
    """One hard case with a known answer.

    ``what``: what is tried.  ``elsewhere``: what goes wrong in other renderers or with the obvious formula.  ``here``:
    what this package does.  ``tolerance`` is the largest accepted error and ``source`` says where it comes from.
    """

    name: str
    group: str
    what: str
    elsewhere: str
    here: str
    tolerance: float
    source: str
    run: Callable[[Bench], Outcome]


@dataclass(frozen=True, slots=True)
class CaseResult:
    """One row of the self-test.  ``failure``: the exception's text where the case could not be run, else None."""

    case: Case
    expected: Value | None
    measured: Value | None
    error: float
    passed: bool
    naive: Naive | None = None
    failure: str | None = None

    @property
    def name(self) -> str:
        return self.case.name

    def as_json(self) -> dict[str, Any]:
        """The row as plain JSON values; an error that is not a finite number is null."""
        row: dict[str, Any] = {
            "name": self.case.name,
            "group": self.case.group,
            "what": self.case.what,
            "expected": _plain(self.expected),
            "measured": _plain(self.measured),
            "error": _plain(self.error),
            "tolerance": self.case.tolerance,
            "tolerance_source": self.case.source,
            "passed": self.passed,
            "naive": None,
            "failure": self.failure,
        }
        if self.naive is not None:
            row["naive"] = {
                "formula": self.naive.formula,
                "measured": _plain(self.naive.measured),
                "error": _plain(self.naive.error),
                "passes": bool(self.naive.error <= self.case.tolerance),
            }
        return row


REGISTRY: dict[str, Case] = {}


def case(
    name: str, *, what: str, elsewhere: str, here: str, source: str, tolerance: float = 0.0
) -> Callable[[Callable[[Bench], Outcome]], Callable[[Bench], Outcome]]:
    """Register a function as the case ``name``; its group is the name of its module."""

    def register(function: Callable[[Bench], Outcome]) -> Callable[[Bench], Outcome]:
        group = function.__module__.rpartition(".")[2]
        if group not in GROUPS:
            raise ValueError(f"{group} is no group of cases")
        if name in REGISTRY:
            raise ValueError(f"two cases are named {name}")
        REGISTRY[name] = Case(name, group, what, elsewhere, here, tolerance, source, function)
        return function

    return register


def judge(one: Case, bench: Bench) -> CaseResult:
    """Run one case.  Whatever it raises is a failed row: one case never stops the others."""
    try:
        outcome = one.run(bench)
        bench.gpu.check(f"case {one.name}")
    except Exception as error:  # a driver may fail in any way; the row says how
        return CaseResult(one, None, None, math.nan, False, failure=f"{type(error).__name__}: {error}")
    passed = bool(outcome.error <= one.tolerance)  # False for NaN
    return CaseResult(one, outcome.expected, outcome.measured, float(outcome.error), passed, outcome.naive)


def count(expected: int, measured: int, naive: Naive | None = None) -> Outcome:
    """An exact count; the error is the difference."""
    return Outcome(int(expected), int(measured), float(abs(int(measured) - int(expected))), naive)


def scalar(expected: float, measured: float, naive: Naive | None = None, *, relative: bool = False) -> Outcome:
    """A number; the error is absolute, or ``relative`` to the expected value."""
    return Outcome(float(expected), float(measured), difference(expected, measured, relative=relative), naive)


def difference(expected: float, measured: float, *, relative: bool = False) -> float:
    """|measured - expected|, divided by |expected| where ``relative``; equal infinities differ by 0."""
    expected, measured = float(expected), float(measured)
    if expected == measured:
        return 0.0
    error = abs(measured - expected)
    return error / abs(expected) if relative else error


def worst(errors: Any) -> float:
    """Largest absolute error of an array of any shape; NaN if any is NaN, 0 for an empty array."""
    errors = np.abs(np.asarray(errors, dtype=np.float64))
    return float(errors.max()) if errors.size else 0.0


def field(expected: str, errors: Any, naive: Naive | None = None, measured: str | None = None) -> Outcome:
    """A whole array against its closed form, summed up by its largest error.  ``expected`` names the closed form."""
    error = worst(errors)
    return Outcome(expected, measured or f"off by {error:.3g} at most", error, naive)


def select(only: Sequence[str] | None) -> list[Case]:
    """Cases in order.  ``only``: names, groups or parts of names; None: all.  Unknown words select nothing."""
    ordered = sorted(REGISTRY.values(), key=lambda c: GROUPS.index(c.group))
    if not only:
        return ordered
    return [c for c in ordered if any(word == c.group or word in c.name for word in only)]


def _plain(value: Any) -> Any:
    if isinstance(value, numbers.Real) and not isinstance(value, (bool, int)):
        return float(value) if math.isfinite(value) else None
    return value
