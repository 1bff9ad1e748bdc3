"""``cost``: what accuracy costs in time, for one scene.  The whole road on one page."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from taubench_gl.animation import CameraTrack, Poser, choose_camera
from taubench_gl.conventions import COLUMNS
from taubench_gl.effects.decide import decide
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import frame_range
from taubench_gl.frame.plan import bound_times, significant_lights
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK, probe_timer
from taubench_gl.provenance import provenance
from taubench_gl.reference.sequence import PREFIX, is_sequence
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings
from taubench_gl.study import quality
from taubench_gl.study import rungs as truth
from taubench_gl.study.clock import pass_timer
from taubench_gl.study.errors import channels_of, compare_features, feature_frames, from_run, measure_errors
from taubench_gl.study.knobs import Situation
from taubench_gl.study.plan import BASE, BEST, Plan, fingerprint, identity, make_plan
from taubench_gl.study.result import CostStudy, assemble
from taubench_gl.study.sessions import Pool, due_visits
from taubench_gl.study.store import RECORDS_FILE, Records

REFERENCE_BEST = "best"
REPEATS = 5


@dataclass(frozen=True, slots=True)
class Step:
    """Said before each measurement."""

    done: int
    total: int
    what: str


Progress = Callable[[Step], None]


def cost(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path,
    knobs: Sequence[str] | None = None,
    method_inputs: Sequence[str] = quality.INPUTS,
    reference: str = REFERENCE_BEST,
    within: float | None = None,
    budget_ms: float | None = None,
    choose_for: Sequence[str] | None = None,
    repeats: int = REPEATS,
    fresh: bool = False,
    check: bool = True,
    progress: Progress | None = None,
    now: Callable[[], float] = time.perf_counter,
    **overrides: Any,
) -> CostStudy:
    """Measure error and time of every setting of the plan, and say which to use.

    ``settings`` (and ``overrides``, fields of it) are the base that the knobs turn away from.  ``reference``: "best",
    all accuracy knobs at their best, or ``exr:DIR``, path-traced renders (``study.rungs``).  ``within`` points and
    ``budget_ms`` choose the preset, for ``choose_for`` (all columns).  ``repeats``: visits of each setting.
    ``knobs``: names of ``KNOBS`` (None: all of them) and ``method:NAME@setting=VALUES``, reuse methods judged by their
    pictures on each of ``method_inputs`` (``study.quality``).
    ``out`` holds the records: called again, the study goes on where it stopped; ``fresh`` starts anew.  ``check`` runs
    the chosen preset again and holds it against its promise.  ``now``: seconds, the clock of frames.
    Raises TaubenchError.
    """
    base = replace(settings or Settings(), **overrides)
    _check_wishes(within, budget_ms, choose_for, repeats)
    dials, methods = quality.split_knobs(knobs)
    contest = quality.candidates(methods, method_inputs)
    out = Path(out)
    if not isinstance(scene, Scene):
        scene = load_scene(scene, scene=base.scene, animation=base.animation)
    ladder = None
    if is_sequence(reference):
        ladder = truth.find_ladder(reference)
        base = truth.fitting(base, ladder)
    elif reference != REFERENCE_BEST:
        raise SettingsError(f"no reference is named {reference!r}", hint="choose best, or exr:DIR")
    camera = choose_camera(scene, base.camera)
    frames = frame_range(scene, camera, base)
    if len(frames) < 2:
        raise SettingsError("the scene gives no pair of frames", hint="give more --frames, or an animated scene")
    gpu = open_gpu(base.backend, base.device)
    ranked = tuple(significant_lights(scene, Poser(scene), camera, bound_times(scene)))
    limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
    plan = make_plan(
        Situation(scene, decide(scene, base), base, len(frames) - 1, ranked, limit), dials, bare=bool(contest)
    )
    with gpu:
        verdict = probe_timer(gpu)
        clock = pass_timer(gpu, verdict).clock
    about = _about(gpu, scene, camera, frames, base, plan, reference, ladder, clock)
    if fresh:
        (out / RECORDS_FILE).unlink(missing_ok=True)
    key = identity(plan, scene.sha256, frames, about["reference"]["identity"], about["camera"])
    if contest:
        key["methods"] = fingerprint([c.name for c in contest])
    records = Records(out, {"identity": key, "machine": about["machine"], "about": about})
    job = _Job(gpu, scene, camera, frames, plan, contest, ladder, records, repeats, verdict, progress, now)
    try:
        job.measure_errors()
        job.measure_times()
        job.measure_methods()
        study = assemble(about, plan, ladder, records.lines, repeats)
        study.methods = quality.method_points(contest, records.lines, repeats)
        study = study.with_choices(within, budget_ms, choose_for)
        if check:
            study = study.with_check(job.check)
    finally:
        records.close()
    study.out = out
    return study


class _Job:
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
        self._plan, self._ladder, self._records, self._now = plan, ladder, records, now
        self._contest = {c.input: [o for o in contest if o.input == c.input] for c in contest}
        self._repeats, self._verdict = repeats, verdict
        self._progress = progress or (lambda step: None)
        self._window = feature_frames(frames)
        self._reference: Mapping[int, Any] | None = None
        self._features: dict[str, Any] = {}
        visits = len(due_visits(plan.settings, repeats, records.of("time")))
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

    def measure_times(self) -> None:
        """Visits still due, round by round."""
        due = due_visits(self._plan.settings, self._repeats, self._records.of("time"))
        with self._gpu:
            pool = self._pool()
            try:
                for number, setting in due:
                    self._say(f"round {number + 1} of {self._repeats}: {setting.name}")
                    told = pool.session(setting).visit()
                    self._records.add(
                        {"kind": "time", "setting": setting.name, "round": number, "load": _load(), **told}
                    )
            finally:
                pool.close()

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
                    self._records.add({"kind": "quality_time", "input": kind, "round": number, "load": _load(), **told})

    def _pool(self) -> Pool:
        return Pool(self._gpu, self._scene, self._camera, lambda: pass_timer(self._gpu, self._verdict), self._now)

    def check(self, name: str) -> dict[str, Any]:
        """Errors and, interleaved with the base, times of one setting, measured again."""
        setting = self._plan.named(name)
        self._say(f"again: {name}", count=False)
        found = measure_errors(self._gpu, self._scene, self._camera, setting)
        times: dict[str, list[float]] = {name: [], BASE: []}
        with self._gpu:
            pool = self._pool()
            try:
                for number in range(max(3, self._repeats)):
                    for each in dict.fromkeys((name, BASE)):
                        self._say(f"again, round {number + 1}: {each}", count=False)
                        times[each].append(pool.session(self._plan.named(each)).visit()["frame_ms"])
            finally:
                pool.close()
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
            found["features"] = compare_features(kept, self._channels(), base.threshold("position"))
        return found

    def _feature_errors(self, settings: Settings) -> Any:
        """Per-pixel errors at pixel centres; settings that differ only in what does not reach a pixel share them."""
        plain = replace(settings, pairs="all", samples_per_pixel=1, summation="integer", histogram_bits=3)
        key = repr(plain)  # thresholds are a dict, so settings have no hash
        if key not in self._features:
            found = channels_of(self._scene, self._camera, plain, self._window)
            place = self._plan.named(BASE).settings.threshold("position")
            self._features[key] = compare_features(found, self._channels(), place)
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


def _about(
    gpu: Gpu,
    scene: Scene,
    camera: CameraTrack,
    frames: range,
    base: Settings,
    plan: Plan,
    reference: str,
    ladder: truth.Ladder | None,
    pass_clock: str,
) -> dict[str, Any]:
    """What every figure of the study is to be printed with."""
    if ladder is None:
        told = {"kind": REFERENCE_BEST, "name": BEST, "identity": REFERENCE_BEST}
    else:
        hashes = [r.sequence.sha256()[:16] for r in (*ladder.rungs, *filter(None, (ladder.second,)))]
        told = {"kind": "path-traced", "name": ladder.reference.name, "identity": " ".join(hashes), "path": reference}
    return {
        "scene": {"name": scene.name, "sha256": scene.sha256, "stand_in": scene.stand_in},
        "camera": camera.describe(),
        "size": [base.width, base.height],
        "fps": base.fps,
        "frames": [frames.start, frames.stop],
        "pairs": len(frames) - 1,
        "reference": told,
        "machine": {
            "renderer": gpu.renderer,
            "driver": gpu.version,
            "processor": _processor(),
            "cores": os.cpu_count(),
        },
        "provenance": provenance(gpu, WALL_CLOCK),
        "clock": WALL_CLOCK,  # of frames, which hold what the CPU does too
        "pass_clock": pass_clock,
        "knobs": list(plan.knobs),
        "skipped": dict(plan.skipped),
    }


def _load() -> float | None:
    """Processes that wanted a core in the last minute, this one included; None where the system does not say."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _check_wishes(within: float | None, budget_ms: float | None, columns: Sequence[str] | None, repeats: int) -> None:
    if within is not None and not within >= 0:
        raise SettingsError(f"within is {within}", hint="give points of at least 0")
    if budget_ms is not None and not budget_ms > 0:
        raise SettingsError(f"budget is {budget_ms} ms", hint="give milliseconds above 0")
    if repeats < 1:
        raise SettingsError(f"repeats is {repeats}", hint="give 1 or more; 3 for a spread")
    for column in columns or ():
        if column not in COLUMNS:
            raise SettingsError(f"no column is named {column!r}", hint=f"choose from {', '.join(COLUMNS)}")
