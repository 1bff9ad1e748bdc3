"""The search of ``between`` as records: what was tried, what it showed, what is tried next.

Three kinds of lines: ``lap`` (settings about to be tried, and after which pass), ``trial`` (a visit of one of them,
with the base's in the same round) and ``pass`` (all settings timed in turn from then on).  Whatever is decided follows
from the lines before it, so a study that was killed decides the same again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from taubench_gl.study.analysis import DIGITS, Point, pareto_front
from taubench_gl.study.between import TRIES, Gap, Search, Seen, spread_of, told, worth_keeping
from taubench_gl.study.knobs import KNOBS
from taubench_gl.study.plan import BASE, Plan, Setting, setting_of
from taubench_gl.study.result import column_errors
from taubench_gl.study.rungs import Ladder
from taubench_gl.study.store import Records

ROUGH = 3
"""Visits of a setting before it is decided whether it is timed beside all others."""

PASSES = 3
"""Times that a study goes over all its settings with new ones among them: the later ones fill what noise left open."""


class Laps:
    """What the records of one study say about its search.  ``fronts``: name -> columns whose worst error counts."""

    def __init__(
        self,
        search: Search,
        plan: Plan,
        fronts: Mapping[str, Sequence[str]],
        records: Records,
        reference: str,
        ladder: Ladder | None,
    ):
        self._search, self._plan, self._fronts, self._records = search, plan, fronts, records
        self._reference, self._ladder = reference, ladder

    @property
    def wanted(self) -> int:
        return self._search.wanted

    @property
    def passes(self) -> list[dict[str, Any]]:
        return self._records.of("pass")

    def kept(self) -> list[Setting]:
        """Settings found so far that are timed with all others."""
        names = self.passes[-1]["kept"] if self.passes else []
        return [self.setting(name) for name in names]

    def setting(self, name: str) -> Setting:
        return setting_of("between", self._tried()[name], self._search.situation.base)

    def lap(self) -> list[Setting]:
        """Settings of the lap that is to be measured now: the one that was interrupted, or the next.  Empty: none."""
        after = len(self.passes)
        for lap in self._records.of("lap"):
            names = [t["setting"] for t in lap["tries"]]
            if lap["after"] == after and any(self.visits(n) < ROUGH for n in names):
                return [self.setting(n) for n in names]
        left = self.wanted * TRIES - sum(len(lap["tries"]) for lap in self._laps_since_the_pass())
        found = self._search.propose(self.seen(), self._known(), self._attempts(), self._margin())[: max(left, 0)]
        if not found or self._passes_used():
            return []
        tries = [
            {"setting": self._search.name(p.choice), "choice": p.choice, "front": p.front, "gap": list(p.gap)}
            for p in found
        ]
        self._records.add({"kind": "lap", "after": after, "wanted": self.wanted, "tries": tries})
        return [self.setting(t["setting"]) for t in tries]

    def visits(self, name: str) -> int:
        return sum(r["setting"] == name for r in self._records.of("trial"))

    def begin_pass(self) -> bool:
        """Whether there is anything new to time beside all others; it is noted."""
        if self._passes_used():
            return False
        old = self.passes[-1]["kept"] if self.passes else []
        new = worth_keeping(self.seen(), self._fronts, [n for n in self._tried() if n not in old], self._margin())
        if new:
            told = {"wanted": self.wanted, "fronts": list(self._search.fronts), "kept": [*old, *new]}
            self._records.add({"kind": "pass", **told})
        return bool(new)

    def _passes_used(self) -> bool:
        """For what is wanted now: another number, or a front not asked for before, has passes of its own."""
        asked = set(self._search.fronts)
        same = [p for p in self.passes if p["wanted"] == self.wanted and asked <= set(p.get("fronts", asked))]
        return len(same) >= PASSES

    def seen(self) -> list[Seen]:
        """Everything that was measured, with the times of the last pass, and trials since, over the base's."""
        times = self._log_ratios()
        errors = {r["setting"]: r for r in self._records.of("error")}
        choices = {s.name: s.choice for s in (*self._plan.settings, *self.kept()) if s.role != "question"}
        choices |= {n: c for n, c in self._tried().items() if n in times}
        found = []
        for name, choice in choices.items():
            if name in times and name in errors:
                found.append(self._seen(name, self._off_base(choice), float(np.median(times[name])), errors))
        base = [r["frame_ms"] for r in self._timed() if r["setting"] == BASE]
        for rung in () if self._ladder is None else self._ladder.rungs:
            if rung.frame_ms:
                log_time = math.log(float(np.median(rung.frame_ms)) / float(np.median(base)))
                found.append(self._seen(rung.name, None, log_time, errors))
        return found

    def report(self, points: Sequence[Point]) -> dict[str, Any]:
        """The block ``search`` of study.json: what was tried, and how full every front is."""
        seen, margin, attempts, known = self.seen(), self._margin(), self._attempts(), self._known()
        named, kept = {s.name: s for s in seen}, {s.name for s in self.kept()}
        words = {}
        for name, columns in self._fronts.items():
            front = [named[p.name] for p in pareto_front(points, columns)]
            if name not in self._search.fronts:
                words[name] = f"{len(front)} setting{'s' * (len(front) != 1)}; the column was not asked for"
                continue
            gaps = [Gap(name, a, b) for a, b in pairwise(front)]
            others = sum(s.errors[name] - front[-1].errors[name] > 10.0**-DIGITS for s in seen if name in s.errors)
            words[name] = told(
                gaps, self.wanted, lambda gap: self._search.why(gap, seen, known, attempts, margin), others
            )
        laps = self._records.of("lap")
        tries = [
            {k: t[k] for k in ("setting", "front", "gap")} | {"kept": t["setting"] in kept}
            for lap in laps
            for t in lap["tries"]
        ]
        return {"wanted": self.wanted, "laps": len(laps), "tried": tries, "kept": len(kept), "fronts": words}

    def _off_base(self, choice: Mapping[str, Any]) -> dict[str, Any]:
        return {n: v for n, v in choice.items() if v != KNOBS[n].current(self._search.situation.base)}

    def _seen(self, name: str, choice: Any, log_time: float, errors: Mapping[str, Any]) -> Seen:
        columns = column_errors(errors[name], errors[self._reference], same_pairs=True)
        worst = {}
        for front, members in self._fronts.items():
            found = [columns[c].error for c in members]
            if None not in found:
                worst[front] = max(found)
        return Seen(name, choice, log_time, worst)

    def _tried(self) -> dict[str, dict[str, Any]]:
        return {t["setting"]: t["choice"] for lap in self._records.of("lap") for t in lap["tries"]}

    def _attempts(self) -> Counter[tuple[str, ...]]:
        """Settings tried: since the last pass for a front, by (front,), and in all in a gap, by its ends."""
        found = Counter(tuple(t["gap"]) for lap in self._records.of("lap") for t in lap["tries"])
        return found + Counter((t["front"],) for lap in self._laps_since_the_pass() for t in lap["tries"])

    def _laps_since_the_pass(self) -> list[dict[str, Any]]:
        """Each pass shows anew where gaps are, so tries are counted from there."""
        return [lap for lap in self._records.of("lap") if lap["after"] == len(self.passes)]

    def _known(self) -> set[str]:
        return {*self._tried(), *(s.name for s in self._plan.settings), *self._same_as_declared()}

    def _same_as_declared(self) -> list[str]:
        """Names that the search would give settings of the plan."""
        return [self._search.name(self._off_base(s.choice)) for s in self._plan.settings]

    def _timed(self) -> list[dict[str, Any]]:
        """Visits of the last pass.  Of the first only the rounds before the search: a study whose search finds nothing
        makes the others after it, and must not decide otherwise when it is called again."""
        last = len(self.passes)
        visits = [r for r in self._records.of("time") if r.get("pass", 0) == last]
        return visits if last else [r for r in visits if r["round"] < ROUGH]

    def _log_ratios(self) -> dict[str, list[float]]:
        """Setting -> log of its time over the base's of the same round."""
        timed = self._timed()
        base = {r["round"]: r["frame_ms"] for r in timed if r["setting"] == BASE}
        found: dict[str, list[float]] = {}
        for r in timed:
            if r["round"] in base:
                found.setdefault(r["setting"], []).append(math.log(r["frame_ms"] / base[r["round"]]))
        for r in self._records.of("trial"):
            if r["after"] == len(self.passes):
                found.setdefault(r["setting"], []).append(math.log(r["frame_ms"] / r["base_ms"]))
        return found

    def _margin(self) -> float:
        return spread_of(r for n, r in self._log_ratios().items() if n != BASE)


def nothing_tried(wanted: int, fronts: Iterable[str]) -> dict[str, Any]:
    """The block ``search`` of a study whose times are too few to be told apart (``clock.RULE``)."""
    words = f"not filled: fewer than {ROUGH} visits tell no two times apart"
    return {"wanted": wanted, "laps": 0, "tried": [], "kept": 0, "fronts": dict.fromkeys(fronts, words)}
