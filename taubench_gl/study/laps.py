"""The search that fills fronts as records: what was measured and tried, what it showed, what comes next.

Four kinds of lines: ``screen`` (settings of which the errors are about to be measured, and after which pass), ``lap``
(settings about to be timed), ``trial`` (a visit of one of them, with the base's in the same round) and ``pass`` (all
settings timed in turn from then on).  Whatever is decided follows from the lines before it, so a study that was killed
decides the same again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from taubench_gl.study.analysis import DIGITS, Point, pareto_front
from taubench_gl.study.column_errors import column_errors, sampled
from taubench_gl.study.forecast import Forecast, Seen
from taubench_gl.study.gaps import Gap, spread_of, told, worth_keeping
from taubench_gl.study.knobs import KNOBS, pair_samples
from taubench_gl.study.plan import BASE, Plan, Setting, setting_of
from taubench_gl.study.points import points_of
from taubench_gl.study.rounds import SWEEPS, rounds_of
from taubench_gl.study.rungs import Ladder
from taubench_gl.study.search import Proposal, Search
from taubench_gl.study.store import Records

ROUGH = 3
"""Rounds of a setting before it is decided whether it is timed beside all others."""

BODIES, TRIES = 6, 8
"""For every setting that is wanted: how many errors are measured in all, how many settings are tried before a pass."""

PASSES = 2
"""Times that a study goes over all its settings with new ones among them: the second fills what noise left open."""


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
        self._known_errors: dict[tuple[str, str | None], dict[str, float]] = {}

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
        return setting_of("between", (self._screened() | self._tried())[name], self._search.situation.base)

    def screen(self) -> list[Setting]:
        """Settings of which the errors are to be measured now: those of the line that was interrupted, or the next.
        Empty: none."""
        known = {r["setting"] for r in self._records.of("error")}
        lines = self._records.of("screen")
        if lines and (due := [m["setting"] for m in lines[-1]["settings"] if m["setting"] not in known]):
            return [self.setting(name) for name in due]
        left = self.wanted * BODIES - sum(len(line["settings"]) for line in lines)
        if left <= 0 or self._passes_used() or self._interrupted_lap():
            return []
        seen = self.seen()
        attempts = Counter((m["front"], *m["gap"]) for line in lines for m in line["settings"])
        search = replace(self._search, fronts=self._short())
        found = search.bodies(seen, self.expected(seen), self._known(), attempts, self._margin())[:left]
        return self._noted("screen", "settings", found)

    def _noted(self, kind: str, key: str, found: Sequence[Proposal]) -> list[Setting]:
        """Put on record what is about to be measured."""
        if not found:
            return []
        names = [self._search.name(p.choice) for p in found]
        told = [{"setting": n, "choice": p.choice, "front": p.front, "gap": list(p.gap)} for n, p in zip(names, found)]
        self._records.add({"kind": kind, "after": len(self.passes), "wanted": self.wanted, key: told})
        return [self.setting(name) for name in names]

    def lap(self) -> list[Setting]:
        """Settings that are to be timed now: those of the lap that was interrupted, or the next.  Empty: none."""
        if names := self._interrupted_lap():
            return [self.setting(n) for n in names]
        left = self.wanted * TRIES - sum(len(lap["tries"]) for lap in self._since_the_pass("lap"))
        if left <= 0 or self._passes_used():
            return []
        seen, search = self.seen(), replace(self._search, fronts=self._short())
        return self._noted("lap", "tries", search.tries(seen, self.expected(seen), self._margin())[:left])

    def _short(self) -> tuple[str, ...]:
        """Fronts that want more: after a pass those that hold fewer than are wanted, by the rule of the study."""
        if not self.passes:
            return self._search.fronts
        settings = [*self._plan.settings, *self.kept()]
        settings = list({s.name: s for s in settings if s.role != "question"}.values())
        points = points_of(settings, self._ladder, self._records.lines, self._reference, None, len(self.passes), "")
        return tuple(f for f in self._search.fronts if len(pareto_front(points, self._fronts[f])) < self.wanted)

    def _interrupted_lap(self) -> list[str]:
        """Names of its settings; empty where every lap was finished.  Nothing is decided from half of its visits."""
        for lap in self._since_the_pass("lap"):
            names = [t["setting"] for t in lap["tries"]]
            if any(self.visits(n) < ROUGH * SWEEPS for n in names):
                return names
        return []

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
        """Everything that was timed, with the times of the last pass, and trials since, over the base's."""
        times = self._log_ratios()
        measured = {r["setting"] for r in self._records.of("error")}
        choices = {s.name: s.choice for s in (*self._plan.settings, *self.kept()) if s.role != "question"}
        choices |= {n: c for n, c in self._tried().items() if n in times}
        found = [
            Seen(name, self._search.off_base(choice), float(np.median(times[name])), self._errors(name))
            for name, choice in choices.items()
            if name in times and name in measured
        ]
        base = [r["frame_ms"] for r in self._timed() if r["setting"] == BASE]
        for rung in () if self._ladder is None else self._ladder.rungs:
            if rung.frame_ms:
                log_time = math.log(float(np.median(rung.frame_ms)) / float(np.median(base)))
                found.append(Seen(rung.name, None, log_time, self._errors(rung.name)))
        return found

    def expected(self, seen: Sequence[Seen]) -> list[Seen]:
        """What was not timed, though its errors are known: every sample of the pairs of every full run, with the time
        that is forecast from ``seen``.  Not what was tried before and not kept."""
        search, margin = self._search, self._margin()
        dials = search.turned(seen, margin)
        forecast = Forecast(search.situation, dials, seen)
        known = {*self._tried(), *(s.name for s in self._plan.settings), *self._same_as_declared()}
        samples = pair_samples(search.situation) if "pairs" in dials else []
        found = []
        for name, choice in self._full_runs(dials).items():
            for pairs in (None, *samples):
                each = choice if pairs is None else search.off_base({**choice, "pairs": pairs})
                its_name = search.name(each)
                if its_name not in known:
                    known.add(its_name)
                    found.append(Seen(its_name, each, forecast.log_time(each), self._errors(name, pairs), timed=False))
        return found

    def _full_runs(self, dials: Sequence[str]) -> dict[str, dict[str, Any]]:
        """Settings of which all pairs were looked at, and their choice among ``dials``; not those in which a dial was
        turned that changes a column but trades nothing, or that the CPU judged."""
        choices = {s.name: s.choice for s in self._plan.settings if s.role != "question" and not s.twin}
        choices |= self._screened() | self._tried()
        errors = {r["setting"] for r in self._records.of("error")}
        found = {}
        for name, choice in choices.items():
            choice = self._search.off_base(choice)
            moving = {d: v for d, v in choice.items() if KNOBS[d].columns}
            pairs = choice.get("pairs", self._search.situation.base.pairs)
            if name in errors and pairs == "all" and all(d in dials or d == "pairs" for d in moving):
                found[name] = moving
        return found

    def report(self, points: Sequence[Point]) -> dict[str, Any]:
        """The block ``search`` of study.json: what was tried, and how full every front is."""
        seen = self.seen()
        expected, margin = self.expected(seen), self._margin()
        named, kept = {s.name: s for s in seen}, {s.name for s in self.kept()}
        words = {}
        for name, columns in self._fronts.items():
            front = [named[p.name] for p in pareto_front(points, columns)]
            if name not in self._search.fronts:
                words[name] = f"{len(front)} setting{'s' * (len(front) != 1)}; the column was not asked for"
                continue
            gaps = [Gap(name, a, b) for a, b in pairwise(front)]
            others = sum(s.errors[name] - front[-1].errors[name] > 10.0**-DIGITS for s in seen if name in s.errors)
            words[name] = told(gaps, self.wanted, lambda gap: self._search.why(gap, expected, margin), others)
        laps = self._records.of("lap")
        tries = [
            {"setting": t["setting"], "front": t["front"], "kept": t["setting"] in kept}
            for lap in laps
            for t in lap["tries"]
        ]
        screened = sum(len(line["settings"]) for line in self._records.of("screen"))
        told_of = len({*named, *(s.name for s in expected)})
        return {
            "wanted": self.wanted, "screened": screened, "known": told_of, "laps": len(laps), "tried": tries,
            "kept": len(kept), "fronts": words,
        }  # fmt: skip

    def _errors(self, name: str, pairs: str | None = None) -> dict[str, float]:
        """Front -> points of a setting; with ``pairs``, of that sample of its pairs."""
        if (name, pairs) not in self._known_errors:
            records = {r["setting"]: r for r in self._records.of("error")}
            record = records[name] if pairs is None else sampled(records[name], pairs)
            columns = column_errors(record, records[self._reference], same_pairs=True)
            errors = {front: [columns[c].error for c in members] for front, members in self._fronts.items()}
            self._known_errors[name, pairs] = {front: max(e) for front, e in errors.items() if None not in e}
        return self._known_errors[name, pairs]

    def _tried(self) -> dict[str, dict[str, Any]]:
        return {t["setting"]: t["choice"] for lap in self._records.of("lap") for t in lap["tries"]}

    def _screened(self) -> dict[str, dict[str, Any]]:
        return {m["setting"]: m["choice"] for line in self._records.of("screen") for m in line["settings"]}

    def _since_the_pass(self, kind: str) -> list[dict[str, Any]]:
        """Each pass shows anew where gaps are, so what was done for them is counted from there."""
        return [line for line in self._records.of(kind) if line["after"] == len(self.passes)]

    def _known(self) -> set[str]:
        """Names under which the search would know what was measured."""
        return {*self._screened(), *self._tried(), *(s.name for s in self._plan.settings), *self._same_as_declared()}

    def _same_as_declared(self) -> list[str]:
        """Names that the search would give settings of the plan."""
        return [self._search.name(self._search.off_base(s.choice)) for s in self._plan.settings]

    def _timed(self) -> list[dict[str, Any]]:
        """Visits of the last pass.  Of the first only the rounds before the search: a study whose search finds nothing
        makes the others after it, and must not decide otherwise when it is called again."""
        last = len(self.passes)
        rounds = rounds_of(r for r in self._records.of("time") if r["pass"] == last)
        return rounds if last else [r for r in rounds if r["round"] < ROUGH]

    def _log_ratios(self) -> dict[str, list[float]]:
        """Setting -> log of its time over the base's of the same round."""
        timed = self._timed()
        base = {r["round"]: r["frame_ms"] for r in timed if r["setting"] == BASE}
        found: dict[str, list[float]] = {}
        for r in timed:
            if r["round"] in base:
                found.setdefault(r["setting"], []).append(math.log(r["frame_ms"] / base[r["round"]]))
        for r in rounds_of(r for r in self._records.of("trial") if r["after"] == len(self.passes)):
            found.setdefault(r["setting"], []).append(math.log(r["frame_ms"] / r["base_ms"]))
        return found

    def _margin(self) -> float:
        return spread_of(r for n, r in self._log_ratios().items() if n != BASE)


def nothing_tried(wanted: int, fronts: Iterable[str]) -> dict[str, Any]:
    """The block ``search`` of a study whose times are too few to be told apart (``clock.RULE``)."""
    words = f"not filled: fewer than {ROUGH} rounds tell no two times apart"
    return {
        "wanted": wanted, "screened": 0, "known": 0, "laps": 0, "tried": [], "kept": 0,
        "fronts": dict.fromkeys(fronts, words),
    }  # fmt: skip
