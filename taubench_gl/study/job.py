"""The measurements of a study: errors, times in turn, laps between neighbours, methods, the check at the end."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any

from taubench_gl.animation import CameraTrack
from taubench_gl.gpu.context import Gpu
from taubench_gl.reference.sequence import PREFIX
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings
from taubench_gl.study import quality
from taubench_gl.study import rungs as truth
from taubench_gl.study.analysis import Sanity
from taubench_gl.study.clock import pass_timer
from taubench_gl.study.errors import channels_of, compare_features, feature_frames, from_run, measure_errors
from taubench_gl.study.explain import MASK_PAIRS, Apart, apart, explained, masks_of, masks_of_rung
from taubench_gl.study.knobs import KNOBS
from taubench_gl.study.laps import ROUGH, Laps
from taubench_gl.study.plan import BASE, BEST, Plan, Setting
from taubench_gl.study.rounds import SWEEPS, due_visits, rounds_of
from taubench_gl.study.sessions import Pool
from taubench_gl.study.store import Records


@dataclass(frozen=True, slots=True)
class Step:
    """Said before each measurement."""

    done: int
    total: int
    what: str


Progress = Callable[[Step], None]


class Job:
    """The measurements still due, in an order that a restart repeats."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        frames: range,
        plan: Plan,
        contest: Sequence[quality.Candidate],
        ladder: truth.Ladder | None,
        records: Records,
        repeats: int,
        verdict: Any,
        progress: Progress | None,
        now: Callable[[], float],
    ):
        self._gpu, self._scene, self._camera, self._frames = gpu, scene, camera, frames
        self._plan, self._declared, self._ladder, self._records, self._now = plan, plan.settings, ladder, records, now
        self._contest = {c.input: [o for o in contest if o.input == c.input] for c in contest}
        self._repeats, self._verdict = repeats, verdict
        self._progress = progress or (lambda step: None)
        self._window = feature_frames(frames)
        self._reference: Mapping[int, Any] | None = None
        self._features: dict[str, Any] = {}
        self._rough_is_over = False
        self._kept_masks: dict[str | None, Mapping[int, Any]] = {}
        visits = len(due_visits(plan.settings, repeats, self._visits(0)))
        errors = {r["setting"] for r in records.of("error")}
        rungs = [] if ladder is None else [r.name for r in ladder.rungs]
        self._due = [n for n in (*rungs, *(s.name for s in plan.settings)) if n not in errors]
        judged = len(self._contest) - len(records.of("quality"))
        turns = repeats * len(self._contest) - len(records.of("quality_time"))
        self._done, self._total = 0, len(self._due) + visits + judged + max(turns, 0)

    def measure_errors(self) -> None:
        """One full run of every rung and setting whose errors are not recorded yet."""
        for rung in () if self._ladder is None else self._ladder.rungs:
            if rung.name in self._due:
                self._say(f"errors: {rung.name}")
                self._records.add({"kind": "error", "setting": rung.name} | self._rung(rung))
        for setting in self._plan.settings:
            if setting.name not in self._due:
                continue
            self._say(f"errors: {setting.name}")
            found = measure_errors(self._gpu, self._scene, self._camera, setting)
            if setting.role != "question":
                found["features"] = self._feature_errors(setting.settings)
            self._records.add({"kind": "error", "setting": setting.name} | found)

    def measure_times(self, passed: int = 0, repeats: int | None = None) -> None:
        """Visits of pass number ``passed`` that are still due, round by round, all settings in turn."""
        repeats = self._repeats if repeats is None else repeats
        due = due_visits(self._plan.settings, repeats, self._visits(passed))
        with self._gpu:
            pool = self._pool()
            try:
                for number, sweep, setting in due:
                    self._say(f"round {number + 1} of {repeats}: {setting.name}")
                    tag = {"kind": "time", "setting": setting.name, "pass": passed, "round": number, "sweep": sweep}
                    self._records.add(tag | {"load": load_average(), **pool.session(setting).visit()})
            finally:
                pool.close()

    def _visits(self, passed: int) -> list[dict[str, Any]]:
        return [r for r in self._records.of("time") if r.get("pass", 0) == passed]

    def fill(self, laps: Laps) -> int:
        """Measure errors of settings between neighbours, and time those that would fill the fronts, until every front
        holds as many as are wanted, or nothing is left to try.

        Those that may stand on a front are then timed with all others in turn, a new pass.  Returns the number of the
        last pass, whose times count.
        """
        if not laps.passes:
            self.measure_times(0, min(ROUGH, self._repeats))
        else:
            self._take_up(laps)
        while True:
            if bodies := laps.screen():
                self._screen(bodies)
            elif lap := laps.lap():
                self._try(lap, laps)
            elif laps.begin_pass():
                self._take_up(laps)
            else:
                break
        if not laps.passes:
            self.measure_times()
        return len(laps.passes)

    def _take_up(self, laps: Laps) -> None:
        """Time all settings, those of the last pass among them."""
        kept = laps.kept()
        self._plan = replace(self._plan, settings=(*self._declared, *kept))
        if not self._rough_is_over:  # of the first pass no more visits are made than the rough fronts took
            self._total -= len(due_visits(self._declared, self._repeats, self._visits(0)))
            self._rough_is_over = True
        passed, pixels = len(laps.passes), {r["setting"] for r in self._records.of("features")}
        self._total += len(due_visits(self._plan.settings, self._repeats, self._visits(passed)))
        for setting in kept:
            if setting.name not in pixels:
                found = self._feature_errors(setting.settings)
                self._records.add({"kind": "features", "setting": setting.name, "features": found})
        self.measure_times(passed)

    def _screen(self, settings: Sequence[Setting]) -> None:
        """Errors of settings that may be timed later."""
        known = {r["setting"] for r in self._records.of("error")}
        due = [s for s in settings if s.name not in known]
        self._total += len(due)
        for setting in due:
            self._say(f"errors: {setting.name}")
            found = measure_errors(self._gpu, self._scene, self._camera, setting)
            self._records.add({"kind": "error", "setting": setting.name} | found)

    def _try(self, lap: Sequence[Setting], laps: Laps) -> None:
        """Errors of every setting of a lap, and a few visits of each, in turn with the base."""
        self._total += sum(max(ROUGH * SWEEPS - laps.visits(s.name), 0) for s in lap)
        self._screen(lap)
        base, after = self._plan.named(BASE), len(laps.passes)
        with self._gpu:
            pool = self._pool()
            try:
                for number, sweep in product(range(ROUGH), range(SWEEPS)):
                    turn = [s for s in lap if laps.visits(s.name) <= number * SWEEPS + sweep]
                    if not turn:
                        continue
                    self._say(f"try {number + 1} of {ROUGH}: {BASE}", count=False)
                    beside = pool.session(base).visit()["frame_ms"]
                    for setting in turn:
                        self._say(f"try {number + 1} of {ROUGH}: {setting.name}")
                        told = {"frame_ms": pool.session(setting).visit()["frame_ms"], "base_ms": beside}
                        tag = {"kind": "trial", "setting": setting.name, "after": after}
                        tag |= {"round": number, "sweep": sweep, "load": load_average()}
                        self._records.add(tag | told)
            finally:
                pool.close()

    @property
    def plan(self) -> Plan:
        """Declared settings, and those that were found between neighbours."""
        return self._plan

    def measure_methods(self) -> None:
        """Reuse methods: errors of every input once, then their times, input by input in turn."""
        base = self._plan.named(BASE).settings
        judged = {r["input"] for r in self._records.of("quality")}
        reference = "max" if self._ladder is None else f"{PREFIX}{self._ladder.reference.folder}"
        for kind, chosen in self._contest.items():
            if kind not in judged:
                self._say(f"pictures of {len(chosen)} methods: {kind}")
                found = quality.measure_pictures(self._scene, self._camera, base, chosen, reference)
                self._records.add({"kind": "quality", "input": kind, **found})
        timed = [r["input"] for r in self._records.of("quality_time")]
        for number in range(self._repeats):
            for kind, chosen in self._contest.items():
                if timed.count(kind) <= number:
                    self._say(f"round {number + 1} of {self._repeats}: {len(chosen)} methods, {kind}")
                    told = quality.time_pictures(self._scene, self._camera, base, self._frames, chosen)
                    self._records.add(
                        {"kind": "quality_time", "input": kind, "round": number, "load": load_average(), **told}
                    )

    def explain(self, sanity: Sanity) -> Sanity:
        """What the pixels say to a series that is not monotone; they are compared once."""
        if sanity.holds:
            return sanity
        known = {(r["setting"], r["column"]): r for r in self._records.of("pixels")}
        series = {}
        for value in dict.fromkeys(v for fault in sanity.faults for v in fault):
            name = self._named(sanity.knob, value)
            if (name, sanity.column) not in known:
                self._say(f"pixels: {name}, {sanity.column}", count=False)
                found = asdict(apart(self._masks(name), self._masks(None), sanity.column))
                self._records.add({"kind": "pixels", "setting": name, "column": sanity.column, **found})
                known[name, sanity.column] = found
            fields = ("wrong", "missed", "border", "left", "pairs")
            series[value] = Apart(**{k: known[name, sanity.column][k] for k in fields})
        return replace(sanity, explanation=explained(sanity, series))

    def _named(self, knob: str, value: Any) -> str:
        """The rung or setting with one dial at ``value``."""
        if knob == "spp":
            return next(r.name for r in self._ladder.rungs if r.samples == value)
        base = KNOBS[knob].current(self._plan.named(BASE).settings)
        return BASE if value == base else f"{knob}={value}"

    def _masks(self, name: str | None) -> Mapping[int, Any]:
        """Reason words at pixel centres, of the reference for None; kept while the study goes on."""
        if name not in self._kept_masks:
            base, window = self._plan.named(BASE).settings, feature_frames(self._frames, MASK_PAIRS)
            rungs = {} if self._ladder is None else {r.name: r for r in self._ladder.rungs}
            if self._ladder is not None:
                rungs[None] = self._ladder.reference
            if name in rungs:
                found = masks_of_rung(rungs[name], base, window)
            else:
                settings = self._plan.named(name or BEST).settings
                found = masks_of(self._scene, self._camera, settings, window)
            self._kept_masks[name] = found
        return self._kept_masks[name]

    def _pool(self) -> Pool:
        return Pool(self._gpu, self._scene, self._camera, lambda: pass_timer(self._gpu, self._verdict), self._now)

    def check(self, name: str) -> dict[str, Any]:
        """Errors and, interleaved with the base, times of one setting, measured again."""
        setting = self._plan.named(name)
        self._say(f"again: {name}", count=False)
        found = measure_errors(self._gpu, self._scene, self._camera, setting)
        visits: list[dict[str, Any]] = []
        with self._gpu:
            pool = self._pool()
            try:
                for number, sweep in product(range(max(3, self._repeats)), range(SWEEPS)):
                    for each in dict.fromkeys((name, BASE)):
                        self._say(f"again, round {number + 1}: {each}", count=False)
                        frame_ms = pool.session(self._plan.named(each)).visit()["frame_ms"]
                        visits.append({"setting": each, "round": number, "sweep": sweep, "frame_ms": frame_ms})
            finally:
                pool.close()
        times = {each: [r["frame_ms"] for r in rounds_of(visits) if r["setting"] == each] for each in (name, BASE)}
        return {
            "percent": {c: e["percent"] for c, e in found["columns"].items()},
            "frame_ms": times[name],
            "base_ms": times[BASE],
        }

    def _rung(self, rung: truth.Rung) -> dict[str, Any]:
        base, ladder = self._plan.named(BASE).settings, self._ladder
        is_reference = rung is ladder.reference
        run = truth.run_rung(rung, base, ladder.second if is_reference else None)
        found = from_run(run)
        if is_reference:
            found["floor"] = dict(truth.floor_of(run))
        else:
            kept = truth.rung_channels(rung, base, self._window)
            found["features"] = compare_features(kept, self._channels(), base)
        return found

    def _feature_errors(self, settings: Settings) -> Any:
        """Per-pixel errors at pixel centres; settings that differ only in what does not reach a pixel share them."""
        plain = replace(settings, pairs="all", samples_per_pixel=1, summation="integer", histogram_bits=3)
        key = repr(plain)  # thresholds are a dict, so settings have no hash
        if key not in self._features:
            found = channels_of(self._scene, self._camera, plain, self._window)
            self._features[key] = compare_features(found, self._channels(), self._plan.named(BASE).settings)
        return self._features[key]

    def _channels(self) -> Mapping[int, Any]:
        """The reference's, drawn (or read) once a session."""
        if self._reference is None:
            if self._ladder is not None:
                base = self._plan.named(BASE).settings
                self._reference = truth.rung_channels(self._ladder.reference, base, self._window)
            else:
                best = self._plan.named(BEST).settings
                self._reference = channels_of(self._scene, self._camera, best, self._window)
        return self._reference

    def _say(self, what: str, count: bool = True) -> None:
        self._progress(Step(self._done, self._total, what))
        self._done += count


def load_average() -> float | None:
    """Processes that wanted a core in the last minute, this one included; None where the system does not say."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
