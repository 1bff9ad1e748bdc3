"""From measured points to an answer: fronts, monotone sanity, recommendations.  Plain data, no OpenGL."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from taubench_gl.conventions import COLUMNS
from taubench_gl.cost.clock import Time, slower_by

DIGITS = 9
"""Decimals of a point to which two errors are compared: below it lies the rounding of float64 means."""


@dataclass(frozen=True, slots=True)
class ColumnError:
    """One column of one setting.  All in points (percent of w * h), None where not measured, with ``reason``."""

    percent: float | None
    points: float | None = None  # this mean - the reference's mean
    half_width: float | None = None  # of the 95 % confidence interval of a sampled run
    pair_points: float | None = None  # mean over pairs of |this - reference|: what cancels in the mean is in it
    reason: str | None = None

    @property
    def error(self) -> float | None:
        """What a reader of the table must reckon with: |points|, and never less than the half width of a sample."""
        return None if self.points is None else max(abs(self.points), self.half_width or 0.0)


@dataclass(frozen=True, slots=True)
class Point:
    """One setting: what it gets wrong and what a frame costs."""

    name: str
    label: str
    role: str  # base | one | combined | best | question | rung
    choice: Mapping[str, Any]
    columns: Mapping[str, ColumnError]
    time: Time | None
    clock: str
    usable: bool = True  # whether ``evaluate`` can be given it as a preset
    features: Mapping[str, Any] = field(default_factory=dict)
    passes: Mapping[str, float] = field(default_factory=dict)
    bytes: int | None = None

    def error(self, column: str) -> float | None:
        return self.columns[column].error if column in self.columns else None


def compared(points: Sequence[Point], column: str | Sequence[str]) -> list[Point]:
    """Points that stand on the plot of ``column``: they answer the same question, and were measured and timed."""
    columns = _listed(column)
    return [p for p in points if p.role != "question" and worst_error(p, columns) is not None and p.time is not None]


def pareto_front(points: Sequence[Point], column: str | Sequence[str]) -> list[Point]:
    """Points of ``column`` that no other dominates, fastest first.  Several columns: by the worst of their errors.

    Of points with the same error the fastest stays, or, of those that are no slower (``clock.RULE``), the first in
    ``points`` (the base, then single changes).  Of these a point leaves the front if one with a smaller error is no
    slower.  So noise in the times alone puts nothing on the front.
    """
    columns = _listed(column)
    groups: dict[float, list[Point]] = {}
    for p in compared(points, columns):
        groups.setdefault(round(worst_error(p, columns), DIGITS), []).append(p)
    best = [_first_of_the_fastest(group) for _, group in sorted(groups.items())]
    front = [p for i, p in enumerate(best) if all(slower_by(q.time, p.time) > 0 for q in best[:i])]
    return sorted(front, key=lambda p: p.time.median)


def _listed(column: str | Sequence[str]) -> tuple[str, ...]:
    return (column,) if isinstance(column, str) else tuple(column)


def _first_of_the_fastest(group: Sequence[Point]) -> Point:
    fastest = min(group, key=lambda p: p.time.median)
    return next(p for p in group if p is fastest or slower_by(p.time, fastest.time) == 0)


def _one_per_error(rated: Sequence[tuple[Point, float]]) -> list[tuple[Point, float]]:
    """Of points with the same error the first that is no slower than the fastest: a dial that does nothing for the
    columns asked for (a histogram's bins) is not recommended because of a lucky round."""
    groups: dict[float, list[tuple[Point, float]]] = {}
    for point, error in rated:
        groups.setdefault(round(error, DIGITS), []).append((point, error))
    firsts = [_first_of_the_fastest([p for p, _ in group]) for group in groups.values()]
    return [(p, e) for p, e in rated if any(p is first for first in firsts)]


def worst_error(point: Point, columns: Sequence[str]) -> float | None:
    """Largest error over ``columns``; None if one of them was not measured."""
    errors = [point.error(column) for column in columns]
    return None if not errors or any(e is None for e in errors) else max(errors)


def measured_columns(points: Sequence[Point]) -> list[str]:
    """Columns that the base has an error for."""
    base = next((p for p in points if p.role == "base"), None)
    return [] if base is None else [c for c in COLUMNS if base.error(c) is not None]


@dataclass(frozen=True, slots=True)
class Choice:
    """What to use, and what a step further costs.  ``point`` None: nothing meets the wish, ``words`` says so."""

    columns: tuple[str, ...]
    within: float | None
    budget_ms: float | None
    point: Point | None
    next: Point | None
    words: str


def choose(
    points: Sequence[Point], columns: Sequence[str], *, within: float | None = None, budget_ms: float | None = None
) -> Choice:
    """The cheapest usable point whose error is at most ``within`` points in all ``columns`` (and at most ``budget_ms``
    a frame, if given); without ``within`` the most exact one in the budget.

    A time counts with its spread: median + spread must be in the budget.
    """
    columns = tuple(columns)
    subject = f"for the {columns[0]} column" if len(columns) == 1 else f"for {', '.join(columns)}"
    usable = [p for p in points if p.usable and p.role != "question" and p.time is not None]
    rated = [(p, e) for p in usable if (e := worst_error(p, columns)) is not None]
    fit = _one_per_error([(p, e) for p, e in rated if (within is None or e <= within) and _affordable(p, budget_ms)])
    wish = subject
    wish += "" if within is None else f" within {within:g} points"
    wish += "" if budget_ms is None else f" in {budget_ms:g} ms/frame"
    if not fit:
        return Choice(columns, within, budget_ms, None, None, _why_none(wish, rated, within, budget_ms))
    if within is not None:
        best, error = min(fit, key=lambda pe: (pe[0].time.median, pe[1]))
        # What is no slower, also by its median, but more exact, costs nothing.
        reach = best.time.median + (best.time.spread or 0.0)
        ties = [(p, e) for p, e in fit if p.time.median <= reach and slower_by(p.time, best.time) == 0]
        best, error = min(ties, key=lambda pe: round(pe[1], DIGITS), default=(best, error))
    else:
        best, error = min(fit, key=lambda pe: pe[1])
    further = [
        (p, e)
        for p, e in _one_per_error(rated)
        if round(error - e, DIGITS) > 0 and slower_by(p.time, best.time) > 0 and p.time.median > best.time.median
    ]
    nxt = min(further, key=lambda pe: pe[0].time.median, default=None)
    words = f"{wish}: {best.label}, {_ms(best.time)}, error {_points(error)}"
    finer = min(
        (pe for pe in rated if round(error - pe[1], DIGITS) > 0), key=lambda pe: pe[0].time.median, default=None
    )
    if nxt is None and finer is not None:
        ratio = finer[0].time.median / best.time.median
        words += f"; {finer[0].label} (error {_points(finer[1])}) takes {ratio:.2g}x by the median, within the spread"
    elif nxt is None:
        words += "; nothing measured is more exact"
    else:
        ratio, gain = nxt[0].time.median / best.time.median, error - nxt[1]
        words += f"; the next step ({nxt[0].label}) costs {ratio:.2g}x for {_points(gain)}"
    return Choice(columns, within, budget_ms, best, None if nxt is None else nxt[0], words)


def _affordable(point: Point, budget_ms: float | None) -> bool:
    return budget_ms is None or point.time.median + (point.time.spread or 0.0) <= budget_ms


def _why_none(wish: str, rated: Sequence[tuple[Point, float]], within: float | None, budget: float | None) -> str:
    if not rated:
        return f"{wish}: nothing was measured"
    near = [pe for pe in rated if _affordable(pe[0], budget)] if budget is not None else list(rated)
    if not near:
        fastest = min((p for p, _ in rated), key=lambda p: p.time.median)
        return f"{wish}: nothing measured is that fast; the fastest is {fastest.label}, {_ms(fastest.time)}"
    best, error = min(near, key=lambda pe: pe[1])
    return f"{wish}: nothing measured is that exact; nearest is {best.label}, error {_points(error)}, {_ms(best.time)}"


def _ms(time: Time) -> str:
    spread = "" if time.spread is None else f" ± {_digits(time.spread)}"
    return f"{_digits(time.median)}{spread} ms/frame"


def _digits(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def _points(value: float) -> str:
    if value == 0:
        return "0 points"
    return f"{value:.2g} points" if value < 0.1 else f"{value:.2f} points"


@dataclass(frozen=True, slots=True)
class Sanity:
    """Whether the error of ``column`` falls along ``knob``.  ``holds``: no rise beyond the noise of the pairs."""

    knob: str
    column: str
    errors: tuple[tuple[Any, float], ...]  # value -> error, coarse to exact
    holds: bool
    words: str
    faults: tuple[tuple[Any, Any], ...] = ()  # (coarse, fine) where it rises


def rises(
    coarse: Mapping[str, float], fine: Mapping[str, float], reference: Mapping[str, float]
) -> tuple[float, float]:
    """By how much ``fine`` is further from the reference than ``coarse``, per pair: mean and its standard error.

    Percentages by frame.  A mean above twice its standard error is a rise that the choice of pairs does not explain.
    """
    frames = sorted(coarse.keys() & fine.keys() & reference.keys())
    rise = [abs(fine[f] - reference[f]) - abs(coarse[f] - reference[f]) for f in frames]
    n = len(rise)
    if n < 2:
        return (rise[0] if rise else 0.0), math.inf
    mean = math.fsum(rise) / n
    variance = math.fsum((r - mean) ** 2 for r in rise) / (n - 1)
    return mean, math.sqrt(variance / n)
