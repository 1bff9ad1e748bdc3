"""What to try between the settings on a front, so that the front holds as many as were asked for.

A front of declared settings has wide gaps.  Between two neighbours on it this proposes settings: their dials bisected,
the dials of one taken over by the other, and a step on a third dial.  It proposes; what stands on the front is decided
by ``analysis.pareto_front`` alone, from errors and times measured like all others.  Plain data, no OpenGL: the same
records give the same proposals.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from taubench_gl.study.analysis import DIGITS
from taubench_gl.study.knobs import DOUBLE, KNOBS, Situation
from taubench_gl.study.plan import useless_beside

FRONT = 12
"""Settings wanted on every front."""

ATTEMPTS = 4
"""Settings tried between the same two neighbours before their gap is given up."""

GAPS_A_LAP = 3
"""Gaps of one front looked into at once: what is found in the widest ones decides where to look next."""

TRIES, TRIES_A_FRONT = 8, 3
"""Settings tried at most before each pass, in all and for one front, for every one that is wanted."""

SPARE = 2
"""Settings looked for beyond those wanted: what few visits put on a front, more of them may take off it."""

NARROW = 0.02
"""Log of the time ratio below which a gap is narrow, however calm the machine."""

Choice = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Seen:
    """A setting of which error and time are known.  ``choice``: dials off the base; None: it has none (a render)."""

    name: str
    choice: Choice | None
    log_time: float  # log of its time over the base's
    errors: Mapping[str, float]  # front -> points


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


@dataclass(frozen=True, slots=True)
class Proposal:
    """``choice`` is to be tried for ``front``, between the two settings ``gap`` (empty: beyond the fast end)."""

    choice: dict[str, Any]
    front: str
    gap: tuple[str, ...]


def rough_front(seen: Iterable[Seen], front: str, margin: float) -> list[Seen]:
    """Settings that no other beats, fastest first: every smaller error takes longer by more than ``margin`` (log).

    Of equal errors the first in ``seen`` that is within ``margin`` of the fastest.  By medians of few visits; it steers
    the search and says nothing to anybody.
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


RENDERED = "next to a path-traced render, which has no dials"
NARROW_TIME = "narrower in time than the spread of the visits"
NARROW_ERROR = "narrower in error than what is told apart"
TRIED = f"without success after {ATTEMPTS} tries"
NO_DIAL = "where no dial has another value left to try"
NOT_LOOKED_INTO = "not looked into any further: the tries or the passes were used up"


def closed(gap: Gap, margin: float, floor: float, attempts: Mapping[tuple[str, ...], int]) -> str | None:
    """Why nothing is to be tried in a gap, in words; None where it is open.  ``floor``: points below which two errors
    are not told apart."""
    if gap.fast.choice is None or gap.fine.choice is None:
        return RENDERED
    if gap.width < 2.0 * margin:
        return NARROW_TIME
    if gap.fast.errors[gap.front] - gap.fine.errors[gap.front] < 2.0 * floor:
        return NARROW_ERROR
    return TRIED if attempts.get(gap.key, 0) >= ATTEMPTS else None


@dataclass(frozen=True, slots=True)
class Search:
    """``fronts``: to be filled; ``floors``: front -> points below which errors are not told apart."""

    situation: Situation
    dials: tuple[str, ...]
    fronts: tuple[str, ...]
    wanted: int
    floors: Mapping[str, float]
    best: Choice  # dial -> its value in the reference setting
    several: tuple[str, ...] = ()  # fronts that stand for several columns

    def propose(
        self, seen: Sequence[Seen], tried: Iterable[str], attempts: Mapping[tuple[str, ...], int], margin: float
    ) -> list[Proposal]:
        """The next settings to measure, at most ``GAPS_A_LAP`` for each front; empty: no candidate can help.

        ``tried``: names of settings measured already, ``seen`` or not; ``attempts``: gap, or (front,) -> settings tried
        for it.  The front of several columns comes first, as recommendations rest on it, then the emptiest.
        """
        known = set(tried)
        cheap = self.cheapest(seen, margin)
        dials = self.turned(seen, margin)
        forecast = Forecast(self.situation, dials, seen)
        out: list[Proposal] = []
        there_now = {front: rough_front(seen, front, margin) for front in self.fronts}
        for front in sorted(self.fronts, key=lambda f: (f not in self.several, len(there_now[f]))):
            there = there_now[front]
            missing = min(self.wanted + SPARE - len(there), TRIES_A_FRONT * self.wanted - attempts.get((front,), 0))
            if missing <= 0 or not there:
                continue
            if len(there) > 1 and cheap and (name := self.name(cheap)) not in known:
                known.add(name)
                out.append(Proposal(dict(cheap), front, ()))
            gaps = [Gap(front, a, b) for a, b in pairwise(there)]
            gaps = [g for g in gaps if closed(g, margin, self.floors[front], attempts) is None]
            gaps.sort(key=lambda g: -g.width)
            for gap in gaps[: min(missing, GAPS_A_LAP)]:
                choice = self._first(gap, dials, cheap, known, forecast)
                if choice is not None:
                    known.add(self.name(choice))
                    out.append(Proposal(choice, front, gap.key))
        return out

    def why(
        self,
        gap: Gap,
        seen: Sequence[Seen],
        tried: Iterable[str],
        attempts: Mapping[tuple[str, ...], int],
        margin: float,
    ) -> str:
        """Why nothing is in a gap of a finished front."""
        reason = closed(gap, margin, self.floors[gap.front], attempts)
        if reason is not None:
            return reason
        dials, cheap = self.turned(seen, margin), self.cheapest(seen, margin)
        left = self._first(gap, dials, cheap, set(tried), Forecast(self.situation, dials, seen))
        return NO_DIAL if left is None else NOT_LOOKED_INTO

    def name(self, choice: Choice) -> str:
        """As ``plan`` names settings, dials in the order of ``KNOBS``."""
        return ", ".join(f"{n}={choice[n]}" for n in KNOBS if n in choice)

    def _singles(self, seen: Sequence[Seen]) -> list[tuple[str, Any, Seen]]:
        """(dial, value, what it showed) of settings in which one dial that can move a column was turned."""
        alone = [(*next(iter(s.choice.items())), s) for s in seen if s.choice is not None and len(s.choice) == 1]
        return [one for one in alone if one[0] in self.dials and KNOBS[one[0]].columns and KNOBS[one[0]].a_frame]

    def turned(self, seen: Sequence[Seen], margin: float) -> list[str]:
        """Dials that trade: turned alone they saved time, or gave a smaller error.  Others cannot fill a gap."""
        base = next(s for s in seen if s.choice is not None and not s.choice)
        trading = set()
        for dial, value, s in self._singles(seen):
            better = any(base.errors[f] - e > self.floors[f] for f, e in s.errors.items() if f in base.errors)
            if value != DOUBLE and (s.log_time < -margin or better):
                trading.add(dial)
        return [d for d in self.dials if d in trading]

    def cheapest(self, seen: Sequence[Seen], margin: float) -> dict[str, Any]:
        """Every dial at the value that, turned alone, saved most time; empty where none saves any."""
        fastest: dict[str, tuple[float, Any]] = {}
        for dial, value, s in self._singles(seen):
            if s.log_time < min(-margin, fastest.get(dial, (0.0, None))[0]):
                fastest[dial] = (s.log_time, value)
        return self._possible({d: fastest[d][1] for d in self.dials if d in fastest}) or {}

    def _first(
        self, gap: Gap, dials: Sequence[str], cheap: Choice, known: set[str], forecast: Forecast
    ) -> dict[str, Any] | None:
        """Of what can be turned between two neighbours the one that is expected nearest to the middle of the gap."""
        found: dict[str, dict[str, Any]] = {}
        for turned in self._turned(gap, dials, cheap):
            choice = self._off_base(turned)
            if choice and (name := self.name(choice)) not in known:
                found.setdefault(name, choice)
        nearest = sorted(found.values(), key=lambda c: forecast.distance(c, gap))
        return next((c for c in nearest if self._possible(c) is not None), None)

    def _turned(self, gap: Gap, dials: Sequence[str], cheap: Choice) -> Iterable[dict[str, Any]]:
        """Both ends with one or two of ``dials`` moved by a quarter, half or all of the way: towards the other end, or,
        where both have the same value, the fast end's towards the best and the fine end's towards the cheapest."""
        fast, fine, best = (self._full(c, dials) for c in (gap.fast.choice, gap.fine.choice, self.best))
        steps: list[tuple[dict[str, Any], str, Any]] = []  # from which end, dial, value
        for d in dials:
            here = {"fast": fast[d], "fine": fine[d], "cheap": cheap.get(d, fine[d]), "best": best[d]}
            low, high = (here["fast"], here["fine"]) if fast[d] != fine[d] else (here["cheap"], here["best"])
            for end, towards in ((fast, high), (fine, low)):
                if towards != end[d]:
                    middle = self._middle(d, end[d], towards)
                    values = (middle, None if middle is None else self._middle(d, end[d], middle), towards)
                    steps += [(end, d, v) for v in values if v is not None]
        for end, d, v in steps:
            yield end | {d: v}
        for (end, d, v), (other, e, w) in combinations(steps, 2):
            if end is other and d != e:
                yield end | {d: v, e: w}
        yield {d: self._middle(d, fast[d], fine[d]) or fine[d] for d in dials}

    def _middle(self, dial: str, a: Any, b: Any) -> Any:
        if a == b or KNOBS[dial].place(self.situation, a) is None or KNOBS[dial].place(self.situation, b) is None:
            return None
        return KNOBS[dial].between(self.situation, a, b)

    def _full(self, choice: Choice, dials: Sequence[str]) -> dict[str, Any]:
        return {d: choice.get(d, KNOBS[d].current(self.situation.base)) for d in dials}

    def _off_base(self, choice: Choice) -> dict[str, Any]:
        """``choice`` without what the base has anyway, in the order of ``KNOBS``."""
        base = self.situation.base
        return {n: choice[n] for n in KNOBS if n in choice and choice[n] != KNOBS[n].current(base)}

    def _possible(self, choice: Choice) -> dict[str, Any] | None:
        """``choice`` off the base; None where it cannot be had, or only on the CPU."""
        kept = self._off_base(choice)
        if kept.get("storage") == DOUBLE or any(useless_beside(kept, n, self.situation) for n in kept):
            return None
        return kept


class Forecast:
    """What a setting may cost and get wrong, from settings in which one dial was turned: enough to order candidates.

    Log times add up over dials, errors as squares do; between measured values both are interpolated.
    """

    def __init__(self, situation: Situation, dials: Sequence[str], seen: Sequence[Seen]):
        self._situation, self._tables = situation, {}
        base = next((s for s in seen if s.choice is not None and not s.choice), None)
        for dial in dials:
            table = {} if base is None else {KNOBS[dial].current(situation.base): base}
            table |= {s.choice[dial]: s for s in seen if s.choice is not None and set(s.choice) == {dial}}
            self._tables[dial] = table

    def distance(self, choice: Choice, gap: Gap) -> float:
        """From the middle of ``gap``, in halves of it: below 1 it is expected inside."""
        time = 0.5 * sum(end.log_time + self._time(choice) - self._time(end.choice) for end in (gap.fast, gap.fine))
        far = abs(2.0 * time - gap.fast.log_time - gap.fine.log_time) / gap.width
        low, high = gap.fine.errors[gap.front], gap.fast.errors[gap.front]
        wrong = abs(2.0 * self._error(choice, gap.front) - low - high) / (high - low)
        return max(far, wrong) + 0.1 * (far + wrong)

    def _time(self, choice: Choice) -> float:
        return math.fsum(self._at(dial, value, lambda s: s.log_time) for dial, value in choice.items())

    def _error(self, choice: Choice, front: str) -> float:
        return math.hypot(
            *(self._at(dial, value, lambda s: s.errors.get(front, 0.0)) for dial, value in choice.items())
        )

    def _at(self, dial: str, value: Any, read: Any) -> float:
        table = self._tables.get(dial, {})
        if value in table:
            return read(table[value])
        place = KNOBS[dial].place
        known = sorted((p, read(s)) for v, s in table.items() if (p := place(self._situation, v)) is not None)
        at = place(self._situation, value)
        if at is None or not known:
            return 0.0
        return float(np.interp(at, *zip(*known)))


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
        return f"{words}: none of the {others} less exact ones is faster beyond the spread of the visits"
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
