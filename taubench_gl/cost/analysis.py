"""Mask errors, times, the Pareto front and the recommendation, from measured configurations.  No OpenGL."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.option_groups import OVERALL

Array = np.ndarray
CONFIDENCE = 1.96
"""Standard deviations beyond which two numbers differ."""

SAME_TIME = 1.15
"""Times up to this ratio count as equal on the Pareto front: when they are measured again they change by some 10 %, as
memory is placed otherwise, which the rounds of one run do not show.  Measured on llvmpipe: 5 to 11 % (standard
deviation of the log; 30 and 12 configurations, timed twice)."""

GOOD_ENOUGH = 2.0
"""Errors up to so many times that of the most exact configuration are good enough by default.  With the 4096 pixels of
a study, errors of one percent or more that differ by so much differ beyond noise."""

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

RULE = (
    "configurations are timed in interleaved rounds and compared round by round: they differ if the mean of the "
    "rounds' log ratios differs from 0 (Student's t, 95 %); with fewer than three common rounds they are statistically "
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
    median = statistics.median(samples)
    spread = MAD_TO_SIGMA * statistics.median(abs(s - median) for s in samples) if len(samples) > 2 else None
    return Time(median, spread, len(samples), tuple(samples) if interleaved else ())


def compare_times(a: Time, b: Time) -> int:
    """1 where ``a`` is slower than ``b``, -1 where it is faster, 0 where they are indistinguishable (``RULE``)."""
    from taubench_gl.metrics.bootstrap import student_interval  # imported late: SciPy takes 0.3 s

    ratios = _log_ratios(a, b)
    if len(ratios) < 3 or (interval := student_interval(np.array(ratios))).contains_zero:
        return 0
    return 1 if interval.estimate > 0 else -1


def against(time: Time | None, baseline: Time | None) -> dict[str, Any] | None:
    """Ratio of two times, and whether they differ by ``RULE``; None where one is not known."""
    if time is None or baseline is None:
        return None
    return {"ratio": time.median / baseline.median, "different": compare_times(time, baseline) != 0}


def _log_ratios(a: Time, b: Time) -> list[float]:
    """Of the rounds that both have."""
    return [math.log(x / y) for x, y in zip(a.rounds, b.rounds)]


@dataclass(frozen=True, slots=True)
class MaskError:
    """Pixels of one column whose mask differs from the reference's."""

    wrong: Array  # (n,) bool
    false_positive: float  # percent of the pixels: discarded, and not in the reference
    false_negative: float

    @property
    def percent(self) -> float:
        return self.false_positive + self.false_negative

    @property
    def points(self) -> float:
        """The column less the reference's, percentage points: what is left after false ones cancel."""
        return self.false_positive - self.false_negative


def mask_errors(masks: Mapping[str, Array], reference: Mapping[str, Array]) -> dict[str, MaskError]:
    """By column, and OVERALL: a pixel with errors of both kinds counts as a false positive.

    Both: column -> (n,) bool, whether each pixel is discarded.
    """
    more = {c: masks[c] & ~there for c, there in reference.items()}
    less = {c: there & ~masks[c] for c, there in reference.items()}
    more[OVERALL] = np.logical_or.reduce(list(more.values()))
    less[OVERALL] = np.logical_or.reduce(list(less.values())) & ~more[OVERALL]
    return {c: MaskError(more[c] | less[c], *(100.0 * float(of[c].mean()) for of in (more, less))) for c in more}


def noise_floor(one: Mapping[str, Array], other: Mapping[str, Array]) -> dict[str, float]:
    """Percent of the pixels that each of two independent halves of the samples has wrong, by column and OVERALL.

    Halves that are both wrong at a share p of alike pixels differ at 2p(1 - p) of them: half of that is given.  The
    whole has less noise.  It need not fall with the number of samples n.  Light that both halves miss is no difference
    yet.  And where the brightness x of paths is distributed as 1/x, as near a lamp that almost touches a surface, the
    share of pixels with a path that alone moves their mean by a given ratio is the same at every n.
    """
    return {c: 0.5 * e.percent for c, e in mask_errors(one, other).items()}


@dataclass(frozen=True, slots=True)
class ColumnDifference:
    """One column of a configuration whose pixels or pairs are others than the baseline's, percent and points."""

    percent: float | None
    points: float | None = None  # less the baseline's mean
    half_width: float | None = None  # of the 95 % interval of ``points``
    reason: str | None = None  # why it is not measured


@dataclass(frozen=True, slots=True)
class Point:
    """One measured configuration."""

    name: str
    label: str
    role: str  # baseline | highest_quality | single | combined | path_traced | effect | grid
    values: Mapping[str, Any]
    masks: Mapping[str, MaskError] = field(default_factory=dict)  # by column and OVERALL; {}: not comparable
    columns: Mapping[str, ColumnDifference] = field(default_factory=dict)
    time: Time | None = None
    clock: str = ""
    usable: bool = True  # whether ``evaluate`` can run it from a preset
    bytes: int | None = None

    def error(self, column: str = OVERALL) -> float | None:
        """Percent of the pixels; None where masks were not compared."""
        return self.masks[column].percent if column in self.masks else None


def compare_errors(a: Point, b: Point, column: str, floor: float = 0.0) -> int:
    """1 where ``a`` has the larger error, -1 the smaller, 0 where they are indistinguishable.

    Errors below the noise floor of the reference, percent, are equal.  Of the pixels those count that are wrong in one
    only (McNemar 1947).
    """
    x, y = max(a.error(column), floor), max(b.error(column), floor)
    alone, there = _wrong_in_one(a, b, column)
    if x == y or abs(alone - there) <= CONFIDENCE * math.sqrt(alone + there):
        return 0
    return 1 if x > y else -1


def _wrong_in_one(a: Point, b: Point, column: str) -> tuple[int, int]:
    """Pixels that only ``a``, and that only ``b`` has wrong."""
    first, second = a.masks[column].wrong, b.masks[column].wrong
    return int((first & ~second).sum()), int((second & ~first).sum())


def pareto_front(points: Sequence[Point], column: str, floor: float = 0.0) -> list[Point]:
    """Points that no other one beats beyond noise, fastest first.

    Of those that take up to SAME_TIME times as long as the fastest one, the most exact; of several the first of
    ``points``.  Then in the same way of those that take longer and are more exact than it beyond noise.
    """

    def error(p: Point) -> float:
        return max(p.error(column), floor)

    rest = [p for p in points if p.time is not None and p.error(column) is not None]
    front: list[Point] = []
    while rest:
        longest = SAME_TIME * min(p.time.median for p in rest)
        best = min((p for p in rest if p.time.median <= longest), key=error)
        front.append(best)
        rest = [p for p in rest if p.time.median > longest and compare_errors(best, p, column, floor) > 0]
    return front


@dataclass(frozen=True, slots=True)
class Choice:
    """A recommendation, for ``column`` within the limits.  ``faster`` and ``finer``: its neighbors on the front.

    ``point`` None: nothing meets the limits; then they are the ends of the front.  ``good_enough``: without limits, the
    error up to which the fastest is chosen, percent of the pixels.
    """

    column: str
    within: float | None  # percent of the pixels
    budget_ms: float | None
    point: Point | None
    faster: Point | None
    finer: Point | None
    good_enough: float | None = None


def choose(
    points: Sequence[Point], column: str = OVERALL, floor: float = 0.0, *, within: float | None = None,
    budget_ms: float | None = None,
) -> Choice:  # fmt: skip
    """The fastest of the Pareto front with an error of at most ``within``; or the most exact of what takes at most
    ``budget_ms`` (median + spread), which may be faster than its neighbor on the front; or both limits.  Without
    limits: the fastest of the front with at most GOOD_ENOUGH times the least error, or the most exact if none has.  The
    least error is that of all configurations, timed or not, but for the samples of path-traced light, which have their
    price; at least the noise floor, and what noise does not tell from 0.
    """
    usable = [p for p in points if p.usable]
    good_enough, allowed = None, math.inf if within is None else max(within, floor)
    if within is None and budget_ms is None:
        allowed = good_enough = GOOD_ENOUGH * max(_least_error(usable, column), floor)
    timed = [p for p in usable if p.time is not None]
    fits = [p for p in timed if budget_ms is None or p.time.median + (p.time.spread or 0.0) <= budget_ms]
    within_budget, front = pareto_front(fits, column, floor), pareto_front(usable, column, floor)
    possible = [p for p in within_budget if p.error(column) <= allowed]
    possible = possible or (front[-1:] if good_enough is not None else [])
    if not possible:
        ends = (front[0], front[-1]) if front else (None, None)
        return Choice(column, within, budget_ms, None, *ends, good_enough)
    best = possible[0] if budget_ms is None or within is not None else possible[-1]
    faster = max((p for p in front if p.time.median < best.time.median), key=_median, default=None)
    finer = min((p for p in front if p.time.median > best.time.median), key=_median, default=None)
    return Choice(column, within, budget_ms, best, faster, finer, good_enough)


def _median(point: Point) -> float:
    return point.time.median


def _least_error(points: Sequence[Point], column: str) -> float:
    """Percent of the pixels; at least CONFIDENCE^2 pixels, which McNemar's test does not tell from none."""
    known = [p.masks[column] for p in points if p.role != "path_traced" and column in p.masks]
    if not known:
        return 0.0
    return max(min(e.percent for e in known), 100.0 * CONFIDENCE**2 / len(known[0].wrong))
