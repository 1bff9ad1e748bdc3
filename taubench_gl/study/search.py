"""What to measure between the settings on a front, so that the front holds as many as were asked for.

A front of declared settings has wide gaps.  Errors are the same every time and cost one run; times need many visits.
So errors are measured of many settings first (``Search.bodies``), of which times are forecast, and of these the ones
that would fill the fronts are timed (``Search.tries``).  Plain data, no OpenGL: the same records give the same
proposals.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

from taubench_gl.study.forecast import Choice, Forecast, Seen
from taubench_gl.study.gaps import NOT_LOOKED_INTO, NOTHING, Gap, closed, rough_front, spread_out
from taubench_gl.study.knobs import DOUBLE, KNOBS, Situation
from taubench_gl.study.plan import useless_beside

FRONT = 12
"""Settings wanted on every front."""

ATTEMPTS = 6
"""Settings whose errors are measured for the same gap before it is given up."""

GAPS_A_LAP = 3
"""Gaps of one front looked into at once: what is found in the widest ones decides where to look next."""

SPARE = 3
"""Settings looked for beyond those wanted: what a forecast puts on a front, its time may take off it."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """``choice`` is to be measured for ``front``, for the gap between two settings (empty: beyond the fast end)."""

    choice: dict[str, Any]
    front: str
    gap: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Search:
    """``fronts``: to be filled; ``floors``: front -> points below which errors are not told apart.

    In its methods ``seen`` are settings that were timed, ``expected`` those of which the errors are known and the times
    forecast, ``margin`` the log of the time ratio below which two settings are not told apart.
    """

    situation: Situation
    dials: tuple[str, ...]
    fronts: tuple[str, ...]
    wanted: int
    floors: Mapping[str, float]
    best: Choice  # dial -> its value in the reference setting
    several: tuple[str, ...] = ()  # fronts that stand for several columns

    def bodies(
        self,
        seen: Sequence[Seen],
        expected: Sequence[Seen],
        known: Iterable[str],
        attempts: Mapping[tuple[str, ...], int],
        margin: float,
    ) -> list[Proposal]:
        """The next settings of which errors are to be measured, over all pairs, at most ``GAPS_A_LAP`` for each front.

        ``known``: names of those that were; ``attempts``: gap -> settings measured for it.  Empty: the fronts are
        expected to be full, or nothing can help.
        """
        known = set(known)
        dials, cheap = self.turned(seen, margin), self.cheapest(seen, margin)
        forecast = Forecast(self.situation, dials, seen)
        out: list[Proposal] = []
        for front, there in self._by_need(seen, expected, margin):
            missing = self.wanted + SPARE - len(there)
            if missing <= 0 or len(there) < 2:
                continue
            body = self.body(cheap)
            if body and (name := self.name(body)) not in known:
                known.add(name)
                out.append(Proposal(body, front))
            gaps = [Gap(front, a, b) for a, b in pairwise(there)]
            gaps = [g for g in gaps if closed(g, margin, self.floors[front]) is None]
            gaps = [g for g in gaps if attempts.get((front, *g.key), 0) < ATTEMPTS]
            gaps.sort(key=lambda g: -g.width)
            for gap in gaps[: min(missing, GAPS_A_LAP)]:
                choice = self._first(gap, dials, cheap, known, forecast)
                if choice is not None:
                    known.add(self.name(choice))
                    out.append(Proposal(choice, front, gap.key))
        return out

    def tries(self, seen: Sequence[Seen], expected: Sequence[Seen], margin: float) -> list[Proposal]:
        """The next settings to be timed: those expected on the fronts, at most ``GAPS_A_LAP`` for each, the furthest
        from what was timed first."""
        known: set[str] = set()
        out: list[Proposal] = []
        for front, there in self._by_need(seen, expected, margin):
            timed = [s.log_time for s in there if s.timed]
            new = [s for s in there if not s.timed and s.name not in known]
            new.sort(key=lambda s: -min((abs(s.log_time - t) for t in timed), default=math.inf))
            for s in new[:GAPS_A_LAP]:
                known.add(s.name)
                out.append(Proposal(dict(s.choice), front))
        return out

    def _by_need(self, seen: Sequence[Seen], expected: Sequence[Seen], margin: float) -> list[tuple[str, list[Seen]]]:
        """Fronts and what is, or is expected, on them.  That of several columns comes first, as recommendations rest
        on it, then the emptiest."""
        every, count = [*seen, *expected], self.wanted + SPARE
        there = {
            front: spread_out(rough_front(every, front, margin), front, count, self.floors[front])
            for front in self.fronts
        }
        return sorted(there.items(), key=lambda item: (item[0] not in self.several, len(item[1])))

    def why(self, gap: Gap, expected: Iterable[Seen], margin: float) -> str:
        """Why nothing is in a gap of a finished front."""
        front, floor = gap.front, self.floors[gap.front]
        inside = (
            margin < s.log_time - gap.fast.log_time < gap.width - margin
            and floor < s.errors[front] - gap.fine.errors[front]
            and floor < gap.fast.errors[front] - s.errors[front]
            for s in expected
            if front in s.errors
        )
        return closed(gap, margin, floor) or (NOT_LOOKED_INTO if any(inside) else NOTHING)

    def name(self, choice: Choice) -> str:
        """As ``plan`` names settings, dials in the order of ``KNOBS``."""
        return ", ".join(f"{n}={choice[n]}" for n in KNOBS if n in choice)

    def body(self, choice: Choice) -> dict[str, Any]:
        """``choice`` with all pairs looked at: its errors tell those of every sample of them."""
        return self.off_base({**choice, "pairs": "all"} if "pairs" in self.dials else choice)

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
        """Of what can be turned between two neighbours the body of the one that is expected nearest to the middle of
        the gap."""
        found: dict[str, tuple[float, dict[str, Any]]] = {}
        for turned in self._turned(gap, dials, cheap):
            choice = self.off_base(turned)
            body = self.body(choice)
            if body and (name := self.name(body)) not in known:
                far = distance(forecast, choice, gap)
                if far < found.get(name, (math.inf, body))[0]:
                    found[name] = far, body
        nearest = sorted(found.values(), key=lambda one: one[0])
        return next((b for _, b in nearest if self._possible(b) is not None), None)

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

    def off_base(self, choice: Choice) -> dict[str, Any]:
        """``choice`` without what the base has anyway, in the order of ``KNOBS``."""
        base = self.situation.base
        return {n: choice[n] for n in KNOBS if n in choice and choice[n] != KNOBS[n].current(base)}

    def _possible(self, choice: Choice) -> dict[str, Any] | None:
        """``choice`` off the base; None where it cannot be had, or only on the CPU."""
        kept = self.off_base(choice)
        if kept.get("storage") == DOUBLE or any(useless_beside(kept, n, self.situation) for n in kept):
            return None
        return kept


def distance(forecast: Forecast, choice: Choice, gap: Gap) -> float:
    """How far ``choice`` is expected from the middle of ``gap``, in halves of it: below 1 it is expected inside.
    Infinite outside in time, of which forecasts are better than of errors."""
    far = abs(2.0 * forecast.log_time(choice) - gap.fast.log_time - gap.fine.log_time) / gap.width
    if far >= 1.0:
        return math.inf
    low, high = gap.fine.errors[gap.front], gap.fast.errors[gap.front]
    wrong = abs(2.0 * forecast.error(choice, gap.front) - low - high) / (high - low)
    return max(far, wrong) + 0.1 * (far + wrong)
