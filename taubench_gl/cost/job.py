"""The measurements of a study: errors, times in turn, laps between neighbours, methods, the check at the end."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from taubench_gl.animation import CameraTrack
from taubench_gl.cost import methods as quality
from taubench_gl.cost.clock import pass_timer
from taubench_gl.cost.errors import KEPT, channels_of, compare_features, feature_frames, from_run, measure_errors
from taubench_gl.cost.plan import BASE, BEST, Plan
from taubench_gl.cost.records import Records
from taubench_gl.cost.rounds import SWEEPS, due_visits, rounds_of
from taubench_gl.cost.sessions import Pool
from taubench_gl.gpu.context import Gpu
from taubench_gl.pathtraced.compare import noise_floor_percent
from taubench_gl.pathtraced.sequence import PREFIX
from taubench_gl.pathtraced.series import Render, SampleCountSeries
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings


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
        series: SampleCountSeries | None,
        records: Records,
        repeats: int,
        verdict: Any,
        progress: Progress | None,
        now: Callable[[], float],
    ):
        self._gpu, self._scene, self._camera, self._frames = gpu, scene, camera, frames
        self._plan, self._series, self._records, self._now = plan, series, records, now
        self._contest = {c.input: [o for o in contest if o.input == c.input] for c in contest}
        self._repeats, self._verdict = repeats, verdict
        self._progress = progress or (lambda step: None)
        self._window = feature_frames(frames)
        self._reference: Mapping[int, Any] | None = None
        self._features: dict[str, Any] = {}
        visits = len(due_visits(plan.settings, repeats, records.of("time")))
        errors = {r["setting"] for r in records.of("error")}
        renders = [] if series is None else [r.name for r in series.renders]
        self._due = [n for n in (*renders, *(s.name for s in plan.settings)) if n not in errors]
        judged = len(self._contest) - len(records.of("quality"))
        turns = repeats * len(self._contest) - len(records.of("quality_time"))
        self._done, self._total = 0, len(self._due) + visits + judged + max(turns, 0)

    def measure_errors(self) -> None:
        """One full run of every render and setting whose errors are not recorded yet."""
        for render in () if self._series is None else self._series.renders:
            if render.name in self._due:
                self._say(f"errors: {render.name}")
                self._records.add({"kind": "error", "setting": render.name} | self._render(render))
        for setting in self._plan.settings:
            if setting.name not in self._due:
                continue
            self._say(f"errors: {setting.name}")
            found = measure_errors(self._gpu, self._scene, self._camera, setting)
            if setting.role != "question":
                found["features"] = self._feature_errors(setting.settings)
            self._records.add({"kind": "error", "setting": setting.name} | found)

    def measure_times(self) -> None:
        """Visits that are still due, round by round, all configurations in turn."""
        due = due_visits(self._plan.settings, self._repeats, self._records.of("time"))
        with self._gpu:
            pool = self._pool()
            try:
                for number, sweep, setting in due:
                    self._say(f"round {number + 1} of {self._repeats}: {setting.name}")
                    tag = {"kind": "time", "setting": setting.name, "round": number, "sweep": sweep}
                    self._records.add(tag | {"load": load_average(), **pool.session(setting).visit()})
            finally:
                pool.close()

    def measure_methods(self) -> None:
        """Reuse methods: errors of every input once, then their times, input by input in turn."""
        base = self._plan.named(BASE).settings
        judged = {r["input"] for r in self._records.of("quality")}
        reference = "max" if self._series is None else f"{PREFIX}{self._series.reference.folder}"
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

    def _render(self, render: Render) -> dict[str, Any]:
        base, series = self._plan.named(BASE).settings, self._series
        is_reference = render is series.reference
        run = render.evaluate(base, series.second if is_reference else None)
        found = from_run(run)
        if is_reference:
            found["floor"] = noise_floor_percent(run.summary)
        else:
            kept = render.channels(base, self._window, KEPT)
            found["features"] = compare_features(kept, self._channels(), base)
        return found

    def _feature_errors(self, settings: Settings) -> Any:
        """Per-pixel errors at pixel centres; settings that differ only in what does not reach a pixel share them."""
        plain = settings.replace(pairs="all", samples_per_pixel=1)
        key = repr(plain)  # thresholds are a dict, so settings have no hash
        if key not in self._features:
            found = channels_of(self._scene, self._camera, plain, self._window)
            self._features[key] = compare_features(found, self._channels(), self._plan.named(BASE).settings)
        return self._features[key]

    def _channels(self) -> Mapping[int, Any]:
        """The reference's, drawn (or read) once a session."""
        if self._reference is None:
            if self._series is not None:
                base = self._plan.named(BASE).settings
                self._reference = self._series.reference.channels(base, self._window, KEPT)
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
