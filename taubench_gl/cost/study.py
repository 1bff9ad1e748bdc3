"""``cost``: error and time of every declared configuration of one scene, and which one to use."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from taubench_gl.animation import CameraTrack, camera_of_run
from taubench_gl.conventions import COLUMNS
from taubench_gl.cost import methods
from taubench_gl.cost.analysis import validate
from taubench_gl.cost.configurations import BASELINE, HIGHEST, Plan, fingerprint, identity, make_plan
from taubench_gl.cost.errors import (
    COMPARED_CHANNELS,
    center_settings,
    compare_features,
    feature_frames,
    from_run,
    measure_errors,
    render_channels,
)
from taubench_gl.cost.parameters import PARAMETERS, StudyContext
from taubench_gl.cost.records import RECORDS_FILE, Records
from taubench_gl.cost.result import CostStudy, assemble
from taubench_gl.cost.timing import SWEEPS, Clock, OpenConfiguration, Pool, StudyTimer, due_visits, round_medians
from taubench_gl.effects.decide import decide
from taubench_gl.effects.lighting import environment_of
from taubench_gl.errors import SettingsError, note_renamed
from taubench_gl.evaluation import file_hashes, files_identity, frame_range, resolve_lighting
from taubench_gl.frame.spec import SceneFacts, ranked_with_sun
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK, TimerVerdict, probe_timer
from taubench_gl.pathtraced.compare import noise_floor_percent
from taubench_gl.pathtraced.sequence import PREFIX, is_sequence
from taubench_gl.pathtraced.series import Render, SampleCountSeries, find_series
from taubench_gl.provenance import provenance
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

REFERENCE = "highest-quality"
FORMER_REFERENCE = "best"
REPEATS = 5
MIN_VALIDATION_ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Step:
    """Reported before each measurement."""

    done: int
    total: int
    what: str


Progress = Callable[[Step], None]


@dataclass(frozen=True, slots=True)
class Limits:
    """What the recommended configuration must meet."""

    within: float | None  # percentage points
    budget_ms: float | None
    columns: Sequence[str] | None  # None: all

    def check(self, measured: Sequence[str]) -> None:
        """Raises SettingsError.  ``measured``: the columns of the study."""
        if self.within is not None and not self.within >= 0:
            raise SettingsError(f"within is {self.within}", hint="give percentage points of at least 0")
        if self.budget_ms is not None and not self.budget_ms > 0:
            raise SettingsError(f"budget is {self.budget_ms} ms", hint="give milliseconds above 0")
        for column in self.columns or ():
            if column not in COLUMNS:
                raise SettingsError(f"no column is named {column!r}", hint=f"choose from {', '.join(COLUMNS)}")
            if column not in measured:
                hint = "it is not among the columns to measure"
                raise SettingsError(f"nothing can be chosen for {column}", hint=hint)


@dataclass(frozen=True, slots=True)
class Subject:
    """What a study measures."""

    gpu: Gpu
    verdict: TimerVerdict  # whether the GPU's timer queries are usable
    scene: Scene
    camera: CameraTrack
    frames: range
    plan: Plan
    methods: tuple[methods.MethodConfiguration, ...]
    series: SampleCountSeries | None  # path-traced reference; None: highest quality

    @property
    def baseline(self) -> Settings:
        return self.plan.named(BASELINE).settings

    @property
    def renders(self) -> tuple[Render, ...]:
        return () if self.series is None else self.series.renders


def cost(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path,
    parameters: Sequence[str] | None = None,
    method_inputs: Sequence[str] = methods.INPUTS,
    reference: str = REFERENCE,
    within: float | None = None,
    budget_ms: float | None = None,
    choose_for: Sequence[str] | None = None,
    repeats: int = REPEATS,
    fresh: bool = False,
    check: bool = True,
    progress: Progress | None = None,
    now: Clock = time.perf_counter,
    **overrides: Any,
) -> CostStudy:
    """Measure error and time of every configuration, and recommend one.

    ``settings`` and ``overrides`` (fields of Settings) are the baseline.  ``parameters``: names in ``PARAMETERS``
    (None: all) and ``method:NAME@setting=VALUES``, reuse methods, evaluated by their images on ``method_inputs``.
    ``reference``: "highest-quality", or ``exr:DIR``, path-traced renders.  ``within`` percentage points and
    ``budget_ms`` select the preset, for the columns ``choose_for`` (None: all).  ``repeats``: interleaved rounds of
    timing.  ``out`` holds the records: called again, the study resumes; ``fresh`` starts from scratch.  ``check``: run
    the chosen configuration again and validate it.  ``now``: the clock of frames.  Raises TaubenchError.
    """
    baseline = (settings or Settings()).replace(**overrides)
    limits = Limits(within, budget_ms, choose_for)
    limits.check(baseline.metrics.columns)
    if repeats < 1:
        raise SettingsError(f"repeats is {repeats}", hint="give 1 or more; 3 for a spread")
    if parameters is not None and not parameters:
        raise SettingsError("no parameter is given", hint=f"choose from {', '.join(PARAMETERS)}, method:NAME")
    names, method_names = methods.split_parameters(parameters)
    chosen_methods = methods.method_configurations(method_names, method_inputs)
    if not isinstance(scene, Scene):
        scene = load_scene(scene, scene=baseline.sequence.scene, animation=baseline.sequence.animation)
    series = _open_reference(reference)
    if series is not None:
        baseline = series.settings(baseline)
    requested = {name: baseline.get(name) for name in FIXED_LIGHTING}
    baseline = resolve_lighting(scene, baseline, camera_of_run(scene, baseline.sequence)).settings
    subject = _subject(scene, baseline, names, chosen_methods, series)
    out = Path(out)
    if fresh:
        (out / RECORDS_FILE).unlink(missing_ok=True)
    about = _about(subject, reference)
    records = Records(out, {"identity": _identity(subject, about), "machine": about["machine"], "about": about})
    with closing(records):
        measurements = Measurements(subject, records, repeats, progress, now)
        measurements.measure_errors()
        measurements.measure_times()
        measurements.measure_methods()
        study = assemble(about, subject.plan, series, records.lines, repeats)
        study.requested_lighting = requested
        study.methods = methods.method_points(chosen_methods, records.lines, repeats)
        study.choose(within, budget_ms, choose_for)
        if check and study.chosen is not None and study.chosen.point is not None:
            repeated = measurements.repeat(study.chosen.point.name)
            percent = study.about["reference"]["percent"]
            study.validation = validate(study.chosen, study.point(BASELINE).time, percent, repeated)
    study.out = out
    return study


def _open_reference(reference: str) -> SampleCountSeries | None:
    if is_sequence(reference):
        return find_series(reference)
    if reference == FORMER_REFERENCE:
        note_renamed(f"reference {FORMER_REFERENCE}", f"reference {REFERENCE}")
    elif reference != REFERENCE:
        raise SettingsError(f"no reference is named {reference!r}", hint=f"choose {REFERENCE}, or exr:DIR")
    return None


def _subject(
    scene: Scene,
    baseline: Settings,
    names: Sequence[str] | None,
    chosen_methods: tuple[methods.MethodConfiguration, ...],
    series: SampleCountSeries | None,
) -> Subject:
    camera = camera_of_run(scene, baseline.sequence)
    frames = frame_range(scene, camera, baseline)
    if len(frames) < 2:
        raise SettingsError("the scene gives no pair of frames", hint="give more --frames, or an animated scene")
    gpu = open_gpu(baseline.device.backend, baseline.device.device)
    ranked = tuple(ranked_with_sun(SceneFacts(scene, camera).ranked_lights, environment_of(baseline).sun))
    limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
    context = StudyContext(scene, decide(scene, baseline), baseline, len(frames) - 1, ranked, limit)
    plan = make_plan(context, names, bare=bool(chosen_methods))
    with gpu:
        verdict = probe_timer(gpu)
    return Subject(gpu, verdict, scene, camera, frames, plan, chosen_methods, series)


def _about(subject: Subject, reference: str) -> dict[str, Any]:
    """The blocks of study.json that say what was measured, where and with which clock."""
    gpu, scene, series, sequence = subject.gpu, subject.scene, subject.series, subject.baseline.sequence
    if series is None:
        described = {"kind": HIGHEST, "name": HIGHEST, "identity": HIGHEST}
    else:
        hashes = [r.sequence.sha256()[:16] for r in (*series.renders, *filter(None, (series.second,)))]
        described = {"kind": "path_traced", "name": series.reference.name, "identity": " ".join(hashes)}
        described["path"] = reference
    return {
        "scene": {"name": scene.name, "sha256": scene.sha256, "stand_in": scene.stand_in},
        "camera": subject.camera.describe(),
        "size": [sequence.width, sequence.height],
        "fps": sequence.fps,
        "frames": [subject.frames.start, subject.frames.stop],
        "pairs": len(subject.frames) - 1,
        "reference": described,
        "lighting": {name: subject.baseline.to_dict()[name] for name in FIXED_LIGHTING},
        "machine": {
            "renderer": gpu.renderer,
            "driver": gpu.version,
            "processor": _processor(),
            "cores": os.cpu_count(),
        },
        "provenance": provenance(gpu, WALL_CLOCK),
        "clock": WALL_CLOCK,  # of frames: their time includes work of the CPU
        "pass_clock": StudyTimer(gpu, subject.verdict).clock,
        "parameters": list(subject.plan.parameters),
        "inapplicable": dict(subject.plan.inapplicable),
    }


def _identity(subject: Subject, about: Mapping[str, Any]) -> dict[str, str]:
    found = identity(
        subject.plan,
        files_identity(file_hashes(subject.scene, subject.baseline)),
        subject.frames,
        about["reference"]["identity"],
        about["camera"],
    )
    if subject.methods:
        found["methods"] = fingerprint([c.name for c in subject.methods])
    return found


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


class Measurements:
    """The measurements that are not in the records yet.  Each is recorded as soon as it is finished."""

    def __init__(self, subject: Subject, records: Records, repeats: int, progress: Progress | None, now: Clock):
        self._subject, self._records, self._repeats, self._now = subject, records, repeats, now
        self._progress = progress or (lambda step: None)
        self._window = feature_frames(subject.frames)
        self._reference: Mapping[int, Any] | None = None
        self._features: dict[str, Any] = {}
        configurations = subject.plan.configurations
        measured = {r["configuration"] for r in records.of("error")}
        self._errors_due = [n.name for n in (*subject.renders, *configurations) if n.name not in measured]
        self._inputs = {c.input: [o for o in subject.methods if o.input == c.input] for c in subject.methods}
        methods_due = len(self._inputs) * (1 + repeats) - len(records.of("images")) - len(records.of("image_time"))
        visits = len(due_visits(configurations, repeats, records.of("time")))
        self._done, self._total = 0, len(self._errors_due) + visits + max(methods_due, 0)

    def measure_errors(self) -> None:
        """One full run of every render and configuration."""
        for render in self._subject.renders:
            if render.name in self._errors_due:
                self._report(f"errors: {render.name}")
                self._add("error", {"configuration": render.name} | self._render_errors(render))
        for configuration in self._subject.plan.configurations:
            if configuration.name not in self._errors_due:
                continue
            self._report(f"errors: {configuration.name}")
            found = measure_errors(self._subject.scene, self._subject.camera, configuration)
            if configuration.role != "definition":
                found["features"] = self._feature_errors(configuration.settings)
            self._add("error", {"configuration": configuration.name} | found)

    def _render_errors(self, render: Render) -> dict[str, Any]:
        series, baseline = self._subject.series, self._subject.baseline
        if render is series.reference:
            run = render.evaluate(baseline, series.second)
            return from_run(run) | {"floor": dict(noise_floor_percent(run.summary))}
        channels = render.channels(baseline, self._window, COMPARED_CHANNELS)
        features = compare_features(channels, self._reference_channels(), baseline)
        return from_run(render.evaluate(baseline)) | {"features": features}

    def _feature_errors(self, settings: Settings) -> Any:
        """Per-pixel errors, once for all settings that give the same pixel centers."""
        key = repr(center_settings(settings))  # settings have no hash
        if key not in self._features:
            found = render_channels(self._subject.scene, self._subject.camera, settings, self._window)
            self._features[key] = compare_features(found, self._reference_channels(), self._subject.baseline)
        return self._features[key]

    def _reference_channels(self) -> Mapping[int, Any]:
        if self._reference is None:
            subject = self._subject
            if subject.series is not None:
                render = subject.series.reference
                self._reference = render.channels(subject.baseline, self._window, COMPARED_CHANNELS)
            else:
                settings = subject.plan.named(HIGHEST).settings
                self._reference = render_channels(subject.scene, subject.camera, settings, self._window)
        return self._reference

    def measure_times(self) -> None:
        """The visits that are due, round by round, all configurations in turn."""
        due = due_visits(self._subject.plan.configurations, self._repeats, self._records.of("time"))
        if not due:
            return
        with self._subject.gpu, self._pool() as pool:
            for number, sweep, configuration in due:
                self._report(f"round {number + 1} of {self._repeats}: {configuration.name}")
                visit = pool.visit(configuration, passes=sweep == 0)
                tag = {"configuration": configuration.name, "round": number, "sweep": sweep}
                self._add("time", tag | {"load": _load_average()} | visit)

    def measure_methods(self) -> None:
        """Reuse methods: image errors once per input, then times, all inputs in turn."""
        subject, baseline = self._subject, self._subject.baseline
        reference = "max" if subject.series is None else f"{PREFIX}{subject.series.reference.folder}"
        measured = {r["input"] for r in self._records.of("images")}
        for kind, chosen in self._inputs.items():
            if kind not in measured:
                self._report(f"images of {len(chosen)} methods: {kind}")
                found = methods.measure_images(subject.scene, subject.camera, baseline, chosen, reference)
                self._add("images", {"input": kind} | found)
        timed = [r["input"] for r in self._records.of("image_time")]
        for number, (kind, chosen) in product(range(self._repeats), self._inputs.items()):
            if timed.count(kind) <= number:
                self._report(f"round {number + 1} of {self._repeats}: {len(chosen)} methods, {kind}")
                found = methods.time_methods(subject.scene, subject.camera, baseline, subject.frames, chosen)
                self._add("image_time", {"input": kind, "round": number, "load": _load_average()} | found)

    def repeat(self, name: str) -> dict[str, Any]:
        """Measure one configuration again: ``percent`` by column, and ``frame_ms`` and ``baseline_ms`` by round."""
        configuration, baseline = self._subject.plan.named(name), self._subject.plan.named(BASELINE)
        self._report(f"validation: errors of {name}", count=False)
        found = measure_errors(self._subject.scene, self._subject.camera, configuration)
        rounds = max(MIN_VALIDATION_ROUNDS, self._repeats)
        visits = []
        with self._subject.gpu, self._pool() as pool:
            for number, _ in product(range(rounds), range(SWEEPS)):
                for each in {name: configuration, BASELINE: baseline}.values():
                    self._report(f"validation, round {number + 1} of {rounds}: {each.name}", count=False)
                    visits.append({"configuration": each.name, "round": number} | pool.visit(each))
        medians = round_medians(visits)
        return {
            "percent": {c: e["percent"] for c, e in found["columns"].items()},
            "frame_ms": [r["frame_ms"] for r in medians[name]],
            "baseline_ms": [r["frame_ms"] for r in medians[BASELINE]],
        }

    def _pool(self) -> Pool:
        s = self._subject
        return Pool(
            lambda c: OpenConfiguration(s.gpu, s.scene, s.camera, c, StudyTimer(s.gpu, s.verdict), self._now),
            s.gpu.software,
        )

    def _add(self, kind: str, record: Mapping[str, Any]) -> None:
        self._records.add({"kind": kind, **record})

    def _report(self, what: str, count: bool = True) -> None:
        self._progress(Step(self._done, self._total, what))
        self._done += count


def _load_average() -> float | None:
    """Processes that were ready to run in the last minute, this one included; None where the system does not say."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
