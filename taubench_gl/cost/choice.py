"""Errors of configurations against the truth, the Pareto front, and what to use.  Plain numbers in and out.

The error of a configuration is the largest of its wanted columns, at 95 % confidence, percentage points:

    column with an interval of its own (decided samples)      E = max(its half width, |column - truth| - h)
    other column (preview, fixed samples)                     E = |column - truth| + h,  h: half width of the truth

An evaluation of decided samples knows its half width and no truth, unless the truth contradicts it; the bias of another
column is known as well as the truth is.  Both say: the column is at most E from the true one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from taubench_gl.cost.configurations import DECIDED, PREVIEW

SAME = 1.25
"""Errors, or seconds, within this factor of the best are equal: the configuration with fewer options is taken."""

MARGIN = 1.1
"""Factor on the seconds of a configuration with which it must be within a limit, as when it is measured again."""

LEAST_SECONDS = 1.0
"""Seconds below which times count as equal, because the start of the program takes longer."""

Columns = Mapping[str, Mapping[str, Any]]


def half_width(column: Mapping[str, Any]) -> float:
    """Half width of a column's 95 % interval, whose ends are cut at 0 and 100 %; 0 for a column that is counted."""
    ends, percent = column["interval95"], column["percent"]
    return 0.0 if ends is None else max(percent - ends[0], ends[1] - percent)


def combined(runs: Sequence[Columns]) -> dict[str, dict[str, Any]]:
    """The mean of each column over independent evaluations; half widths add up in squares."""
    out = {}
    for name in runs[0]:
        columns = [run[name] for run in runs]
        percents = [column["percent"] for column in columns]
        if None in percents:
            out[name] = {"percent": None, "half_width": 0.0, "reason": columns[0]["reason"]}
            continue
        half = math.sqrt(sum(half_width(column) ** 2 for column in columns)) / len(columns)
        out[name] = {"percent": math.fsum(percents) / len(percents), "half_width": half, "reason": None}
    return out


@dataclass(frozen=True, slots=True)
class Point:
    """A configuration and what was measured.  Errors in percentage points, ``least`` <= ``error``.

    ``lacking``: wanted columns that it does not measure; with one, ``error`` is None and it is never chosen.
    ``observed``: the largest difference from the truth.
    """

    series: str
    name: str
    options: int
    seconds: float
    error: float | None
    least: float = 0.0
    observed: float | None = None
    lacking: tuple[str, ...] = ()


def errors_of(columns: Columns, truth: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """What a Point says of its errors over the columns that the truth measures, by the names of its fields."""
    wanted = [name for name in truth if truth[name]["percent"] is not None]
    lacking = tuple(name for name in wanted if columns.get(name, {"percent": None})["percent"] is None)
    if lacking:
        return {"error": None, "lacking": lacking}
    errors, least, observed = [0.0], [0.0], [0.0]
    for name in wanted:
        off = abs(columns[name]["percent"] - truth[name]["percent"])
        observed.append(off)
        least.append(off - truth[name]["half_width"])
        if columns[name]["interval95"] is not None:
            errors.append(max(half_width(columns[name]), least[-1]))
        else:
            errors.append(off + truth[name]["half_width"])
    return {"error": max(errors), "least": max(least), "observed": max(observed)}


def comparable(points: Iterable[Point]) -> list[Point]:
    """The points that measure every wanted column."""
    return [point for point in points if point.error is not None]


def pareto_front(points: Iterable[Point]) -> list[Point]:
    """The points to which no comparable point is superior: faster and as exact, or more exact and as fast.

    The fastest comes first.
    """
    out: list[Point] = []
    for point in sorted(comparable(points), key=lambda p: (p.seconds, p.error)):
        if not out or point.error < out[-1].error:
            out.append(point)
    return out


def within_seconds(points: Iterable[Point], limit: float) -> Point | None:
    """The most exact configuration that takes at most ``limit`` / MARGIN seconds; None if none does."""
    return _simplest([p for p in comparable(points) if MARGIN * p.seconds <= limit], lambda p: p.error)


def within_error(points: Iterable[Point], limit: float) -> Point | None:
    """The fastest configuration with an error of at most ``limit`` points, known to 95 %; None if none has."""
    return _simplest([p for p in comparable(points) if p.error <= limit], lambda p: max(p.seconds, LEAST_SECONDS))


def _simplest(points: Sequence[Point], key: Callable[[Point], float]) -> Point | None:
    """The point with the fewest options, then with the least key, among those within SAME of the least key."""
    if not points:
        return None
    best = min(map(key, points))
    return min((p for p in points if key(p) <= SAME * best), key=lambda p: (p.options, key(p)))


def preview_enough(points: Iterable[Point]) -> Point | None:
    """The most exact preview, the simplest of the equal ones."""
    return _simplest([p for p in comparable(points) if p.series == PREVIEW], lambda p: p.error)


def deciding_wins(points: Iterable[Point]) -> Point | None:
    """The fastest evaluation of decided samples with less error than every preview; None if none has."""
    points = comparable(points)
    best = min((p.error for p in points if p.series == PREVIEW), default=math.inf)
    return min((p for p in points if p.series == DECIDED and p.error < best), key=lambda p: p.seconds, default=None)
