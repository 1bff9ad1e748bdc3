"""Fronts while they are being filled: what stands on them by few visits or forecasts, their gaps, how full they are.

All this steers a search; what stands on a front in the end is decided by ``analysis.pareto_front`` alone.  Plain data.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from taubench_gl.study.analysis import DIGITS
from taubench_gl.study.forecast import Seen

NARROW = 0.02
"""Log of the time ratio below which a gap is narrow, however calm the machine."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Two neighbours on a front."""

    front: str
    fast: Seen
    fine: Seen

    @property
    def key(self) -> tuple[str, str]:
        return self.fast.name, self.fine.name

    @property
    def width(self) -> float:
        """Log of the time ratio."""
        return self.fine.log_time - self.fast.log_time


def rough_front(seen: Iterable[Seen], front: str, margin: float) -> list[Seen]:
    """Settings that no other beats, fastest first: every smaller error takes longer by more than ``margin`` (log).

    Of equal errors the first in ``seen`` that is within ``margin`` of the fastest.  By medians of few visits, or by
    forecasts; it steers the search and says nothing to anybody.
    """
    groups: dict[float, list[Seen]] = {}
    for s in seen:
        if front in s.errors:
            groups.setdefault(round(s.errors[front], DIGITS), []).append(s)
    kept: list[Seen] = []
    fastest = math.inf
    for _, group in sorted(groups.items()):
        least = min(s.log_time for s in group)
        if least < fastest - margin:
            kept.append(next(s for s in group if s.log_time <= least + margin))
        fastest = min(fastest, least)
    return sorted(kept, key=lambda s: s.log_time)


def spread_out(there: Sequence[Seen], front: str, count: int, floor: float) -> list[Seen]:
    """At most ``count`` of a rough front, as far apart in time as they come.

    Its ends stay; what was not timed goes if its error is within twice ``floor`` points of a finer one's, and what was
    timed only if it is much closer to its neighbours than others.
    """
    kept = list(there[-1:])
    for s in reversed(there[:-1]):
        if s.timed or s is there[0] or s.errors[front] - kept[0].errors[front] >= 2.0 * floor:
            kept.insert(0, s)
    while len(kept) > max(count, 2):
        room = {i: kept[i + 1].log_time - kept[i - 1].log_time for i in range(1, len(kept) - 1)}
        kept.pop(min(room, key=lambda i: room[i] * (2.0 if kept[i].timed else 1.0)))
    return kept


RENDERED = "next to a path-traced render, which has no dials"
NARROW_TIME = "narrower in time than the spread of the rounds"
NARROW_ERROR = "narrower in error than what is told apart"
NOTHING = "in which no setting lies whose errors are known"
NOT_LOOKED_INTO = "not looked into any further: the tries or the passes were used up"


def closed(gap: Gap, margin: float, floor: float) -> str | None:
    """Why nothing can be in a gap, in words; None where it is open.  ``floor``: points below which two errors are not
    told apart."""
    if gap.fast.choice is None or gap.fine.choice is None:
        return RENDERED
    if gap.width < 2.0 * margin:
        return NARROW_TIME
    return NARROW_ERROR if gap.fast.errors[gap.front] - gap.fine.errors[gap.front] < 2.0 * floor else None


def worth_keeping(seen: Sequence[Seen], fronts: Iterable[str], names: Iterable[str], margin: float) -> list[str]:
    """Of ``names`` those that no other setting beats on some front: these are timed with all others."""
    kept = set()
    for front in fronts:
        kept |= {s.name for s in rough_front(seen, front, margin)}
    return [n for n in names if n in kept]


def told(gaps: Sequence[Gap], wanted: int, why: Callable[[Gap], str], others: int) -> str:
    """How full a front is, and why it is not fuller, in words.

    ``gaps``: between its settings by the rule of the study; ``why``: says of one gap why nothing is in it; ``others``:
    settings that are less exact than the best, whether or not they are faster.
    """
    count = len(gaps) + 1
    if count >= wanted:
        return f"{count} settings, {wanted} were wanted"
    words = f"{count} of {wanted} settings"
    if not gaps and others:
        return f"{words}: none of the {others} less exact ones is faster beyond the spread of the rounds"
    if not gaps:
        return f"{words}: all are equally exact, so there is nothing to pay time for"
    reasons = Counter(map(why, gaps))
    between = f"of the {len(gaps)} gaps between them" if len(gaps) > 1 else "the gap between them"
    parts = [f"{n} {reason}" if len(gaps) > 1 else reason for reason, n in reasons.items()]
    return f"{words}; {between} {', '.join(parts)}"


def spread_of(rounds: Iterable[Sequence[float]]) -> float:
    """A margin (log) from repeated log ratios of several settings: 1.5 times the middle one's spread, never below
    ``NARROW``.  Two times with five to seven rounds are told apart by ``clock.RULE`` from about there on."""
    spreads = [1.4826 * float(np.median(np.abs(np.subtract(r, np.median(r))))) for r in rounds if len(r) > 2]
    return max(NARROW, 1.5 * float(np.median(spreads))) if spreads else NARROW
