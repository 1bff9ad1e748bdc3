"""Times, Pareto fronts, recommendations and their validation, from measured configurations.  No OpenGL."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from taubench_gl.conventions import COLUMNS

DIGITS = 9
"""Decimals to which two errors are compared.  Smaller differences are rounding errors of float64 means."""

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

RULE = (
    "configurations are timed in interleaved rounds and compared round by round: they differ if the median of the "
    "rounds' log ratios is further from 0 than their spread (1.4826 times the median absolute deviation) and 0 lies "
    "outside the 95 % interval of their mean (Student's t); times without common rounds differ if their medians differ "
    "by more than sqrt(s1^2 + s2^2); otherwise, or with fewer than three rounds, they are statistically "
    "indistinguishable"
)


@dataclass(frozen=True, slots=True)
class Time:
    """Milliseconds: median over rounds, spread (1.4826 MAD; None below three rounds), number of rounds, and the rounds
    themselves where they were interleaved with other configurations."""

    median: float
    spread: float | None
    samples: int
    rounds: tuple[float, ...] = ()


def time_of(samples: Sequence[float], *, interleaved: bool = True) -> Time:
    """Median and spread.  ``samples``: milliseconds > 0, one per round, at least one."""
    median, spread = _median_and_spread(samples)
    return Time(median, spread, len(samples), tuple(samples) if interleaved else ())


def compare_times(a: Time, b: Time) -> int:
    """1 where ``a`` is slower than ``b``, -1 where it is faster, 0 where they are indistinguishable (``RULE``)."""
    if a.rounds and len(a.rounds) == len(b.rounds):
        ratios = [math.log(x / y) for x, y in zip(a.rounds, b.rounds)]
        difference, spread = _median_and_spread(ratios)
        significant = abs(statistics.fmean(ratios)) > _half_width(ratios)
    else:
        difference, significant = a.median - b.median, True
        spread = None if a.spread is None or b.spread is None else math.hypot(a.spread, b.spread)
    if spread is None or not significant or abs(difference) <= spread:
        return 0
    return 1 if difference > 0 else -1


def no_slower(a: Time, b: Time) -> bool:
    """Whether ``a`` can replace ``b`` at no cost: not slower by ``RULE``, and its median within the spread of ``b``.

    The second condition keeps a configuration with very noisy times from replacing a faster one.
    """
    if compare_times(a, b) > 0:
        return False
    return a.spread is None or b.spread is None or a.median <= b.median + b.spread


def _half_width(samples: Sequence[float]) -> float:
    """Of the 95 % interval of the mean."""
    n = len(samples)
    if n < 3:
        return math.inf
    from scipy.special import stdtrit  # imported late: 0.3 s

    return float(stdtrit(n - 1, 0.975)) * statistics.stdev(samples) / math.sqrt(n)


def _median_and_spread(samples: Sequence[float]) -> tuple[float, float | None]:
    median = statistics.median(samples)
    if len(samples) < 3:
        return median, None
    return median, MAD_TO_SIGMA * statistics.median(abs(s - median) for s in samples)


@dataclass(frozen=True, slots=True)
class ColumnError:
    """One column of one configuration, percent or percentage points of w * h; None where not measured (``reason``)."""

    percent: float | None
    points: float | None = None  # mean minus the mean of the reference
    half_width: float | None = None  # of the 95 % confidence interval of sampled pairs
    pair_points: float | None = None  # mean over pairs of |difference|: includes what cancels in the mean
    reason: str | None = None

    @property
    def error(self) -> float | None:
        """|points|, and at least the half width of sampled pairs."""
        return None if self.points is None else max(abs(self.points), self.half_width or 0.0)


@dataclass(frozen=True, slots=True)
class Point:
    """One measured configuration: its errors and the time of a frame."""

    name: str
    label: str
    role: str  # baseline | highest_quality | single | combined | definition | path_traced
    values: Mapping[str, Any]
    columns: Mapping[str, ColumnError]
    time: Time | None
    clock: str
    usable: bool = True  # whether ``evaluate`` can run it from a preset
    features: Mapping[str, Any] = field(default_factory=dict)
    passes: Mapping[str, float] = field(default_factory=dict)
    bytes: int | None = None

    def error(self, column: str) -> float | None:
        return self.columns[column].error if column in self.columns else None


def worst_error(point: Point, columns: Sequence[str]) -> float | None:
    """Largest error over ``columns``, percentage points; None if one of them was not measured."""
    errors = [point.error(column) for column in columns]
    return None if not errors or any(e is None for e in errors) else max(errors)


def measured_columns(points: Sequence[Point]) -> list[str]:
    """Columns for which the baseline has an error."""
    baseline = next((p for p in points if p.role == "baseline"), None)
    return [] if baseline is None else [c for c in COLUMNS if baseline.error(c) is not None]


def pareto_front(points: Sequence[Point], column: str | Sequence[str]) -> list[Point]:
    """Points that no other point dominates, fastest first.  Several columns: by the worst of their errors.

    Of points with the same error one stays: the first in ``points`` that is no slower than all others.  Of these a
    point leaves the front if one with a smaller error is no slower, so timing noise alone puts nothing on it.
    """
    columns = (column,) if isinstance(column, str) else tuple(column)
    groups: dict[float, list[Point]] = {}
    for p in points:
        error = worst_error(p, columns)
        if p.role != "definition" and p.time is not None and error is not None:
            groups.setdefault(round(error, DIGITS), []).append(p)
    ordered = [group for _, group in sorted(groups.items())]
    front = []
    for i, group in enumerate(ordered):
        best = _first_no_slower(group)
        if not any(no_slower(q.time, best.time) for finer in ordered[:i] for q in finer):
            front.append(best)
    return sorted(front, key=lambda p: p.time.median)


def _first_no_slower(group: Sequence[Point]) -> Point:
    """The first that no other clearly beats; the fastest by median where times are not transitive."""
    fastest = min(group, key=lambda p: p.time.median)
    return next((p for p in group if all(no_slower(p.time, q.time) for q in group if q is not p)), fastest)


@dataclass(frozen=True, slots=True)
class Choice:
    """A recommendation.  ``point`` None: nothing meets the limits; ``words`` says so."""

    columns: tuple[str, ...]
    within: float | None  # percentage points
    budget_ms: float | None
    point: Point | None
    next: Point | None  # the next slower point of the front
    words: str


def choose(
    points: Sequence[Point], columns: Sequence[str], *, within: float | None = None, budget_ms: float | None = None
) -> Choice:
    """Of the Pareto front of usable points: the fastest with an error of at most ``within`` percentage points in all
    ``columns``; without ``within`` the most exact one.  Median + spread must be within ``budget_ms``, if given.
    """
    columns = tuple(columns)
    limits = f"for the {columns[0]} column" if len(columns) == 1 else f"for {', '.join(columns)}"
    limits += "" if within is None else f" within {within:g} pp"
    limits += "" if budget_ms is None else f" in {budget_ms:g} ms/frame"
    usable = [p for p in points if p.usable and p.time is not None and worst_error(p, columns) is not None]
    usable = [p for p in usable if p.role != "definition"]

    def error(p: Point) -> float:
        return worst_error(p, columns)

    possible = [p for p in usable if (within is None or error(p) <= within) and _affordable(p, budget_ms)]
    front = pareto_front(possible, columns)
    if not front:
        words = _why_none(limits, [(p, error(p)) for p in usable], budget_ms)
        return Choice(columns, within, budget_ms, None, None, words)
    best = front[0] if within is not None else min(front, key=error)
    finer = [p for p in pareto_front(usable, columns) if round(error(best) - error(p), DIGITS) > 0]
    further = next((p for p in finer if p.time.median > best.time.median), None)
    words = f"{limits}: {best.label}, {ms_text(best.time)}, error {_pp(error(best))}"
    if further is None:
        words += "; no measured configuration is more exact"
    else:
        ratio = further.time.median / best.time.median
        same = " (statistically indistinguishable)" if compare_times(further.time, best.time) == 0 else ""
        words += f"; next: {further.label}, {ratio:.2g}x{same}, error {_pp(error(further))}"
    return Choice(columns, within, budget_ms, best, further, words)


def _affordable(point: Point, budget_ms: float | None) -> bool:
    return budget_ms is None or point.time.median + (point.time.spread or 0.0) <= budget_ms


def _why_none(limits: str, rated: Sequence[tuple[Point, float]], budget_ms: float | None) -> str:
    if not rated:
        return f"{limits}: nothing was measured"
    affordable = [(p, e) for p, e in rated if _affordable(p, budget_ms)]
    if not affordable:
        fastest = min((p for p, _ in rated), key=lambda p: p.time.median)
        return f"{limits}: no configuration is that fast; the fastest is {fastest.label}, {ms_text(fastest.time)}"
    best, error = min(affordable, key=lambda pe: pe[1])
    nearest = f"the most exact is {best.label}, error {_pp(error)}, {ms_text(best.time)}"
    return f"{limits}: no configuration is that exact; {nearest}"


def ms_text(time: Time) -> str:
    """``18.2 ± 0.41 ms/frame``."""
    spread = "" if time.spread is None else f" ± {time.spread:.2g}"
    return f"{f'{time.median:.3g}' if time.median < 1000 else f'{time.median:.0f}'}{spread} ms/frame"


def _pp(value: float) -> str:
    return f"{value:.2f} pp" if value >= 0.1 else f"{value:.2g} pp"


def validate(
    choice: Choice, baseline: Time, reference: Mapping[str, float], repeated: Mapping[str, Any]
) -> dict[str, Any]:
    """PASS or FAIL of a chosen configuration that was run again: the block ``validation`` of study.json.

    ``baseline``: its time in the study; ``reference``: percent by column; ``repeated``: ``percent`` by column, and
    ``frame_ms`` and ``baseline_ms``, milliseconds per interleaved round.  Errors must be within ``choice.within``, or
    else within the errors that the study measured.  The budget is compared as a ratio to the baseline, round by round,
    less its spread: milliseconds of another time do not compare.
    """
    limit = choice.within
    if limit is None:
        limit = max(choice.point.error(c) for c in choice.columns)
    errors = {c: abs(repeated["percent"][c] - reference[c]) for c in choice.columns}
    ratio = time_of([t / b for t, b in zip(repeated["frame_ms"], repeated["baseline_ms"], strict=True)])
    allowed = None if choice.budget_ms is None else choice.budget_ms / baseline.median
    return {
        "configuration": choice.point.name,
        "errors": errors,
        "limit_points": limit,
        "errors_pass": all(round(e - limit, DIGITS) <= 0 for e in errors.values()),
        "ms": asdict(time_of(repeated["frame_ms"])),
        "baseline_drift": time_of(repeated["baseline_ms"]).median / baseline.median,
        "budget_ms": choice.budget_ms,
        "ratio": ratio.median,
        "ratio_spread": ratio.spread,
        "allowed_ratio": allowed,
        "time_pass": None if allowed is None else ratio.median - (ratio.spread or 0.0) <= allowed,
    }


def error_increase(
    coarse: Mapping[str, float], fine: Mapping[str, float], reference: Mapping[str, float]
) -> tuple[float, float]:
    """Mean over frames of |fine - reference| - |coarse - reference|, and its standard error.

    Values by frame.  A mean above twice its standard error is an increase that the choice of pairs does not explain.
    """
    frames = sorted(coarse.keys() & fine.keys() & reference.keys())
    increase = [abs(fine[f] - reference[f]) - abs(coarse[f] - reference[f]) for f in frames]
    n = len(increase)
    if n < 2:
        return (increase[0] if increase else 0.0), math.inf
    return math.fsum(increase) / n, statistics.stdev(increase) / math.sqrt(n)
