"""``cost``: mask error and time of every declared configuration of one scene, and which one to use."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import date
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from taubench_gl.animation import camera_of_run
from taubench_gl.cost import pixels
from taubench_gl.cost.configurations import BASELINE, Configuration, Plan, make_plan
from taubench_gl.cost.errors import measure_columns
from taubench_gl.cost.parameters import PARAMETERS, StudyContext
from taubench_gl.cost.pixels import Light, PairChannels, draw_pixels, pack, rendered_masks
from taubench_gl.cost.records import RECORDS_FILE, Records
from taubench_gl.cost.reference import (
    HALVES,
    MOST,
    SUMS_FILE,
    TracedPixels,
    reference_light,
    render_light,
    traced_masks,
)
from taubench_gl.cost.result import CostStudy, assemble
from taubench_gl.cost.timing import Clock, Deadline, OpenConfiguration, OtherWork, OutOfTime, Pool, due_visits
from taubench_gl.data_files import read_text
from taubench_gl.effects.decide import decide
from taubench_gl.effects.lighting import environment_of
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation import file_hashes, files_identity, frame_range, open_scene
from taubench_gl.features import COLUMNS
from taubench_gl.fields import declared, from_values
from taubench_gl.folder_lock import FolderLock
from taubench_gl.frame.plan import effect_costs
from taubench_gl.frame.spec import AnimatedScene, ranked_with_sun
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK
from taubench_gl.option_groups import OVERALL, CostOptions
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.pathtraced.series import Render, SampleCountSeries, find_series
from taubench_gl.provenance import provenance
from taubench_gl.reuse.references import reference_samples
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

HIGHEST_QUALITY, PATH_TRACED = "highest-quality", "path-traced"
SAMPLES = 256
"""Samples per pixel of the path-traced reference where neither they nor the time are limited."""

CLOCKS: dict[str, tuple[Clock, str]] = {
    "wall": (time.perf_counter, WALL_CLOCK),
    "cpu": (time.process_time, "CPU time of the process"),
}
"""Clocks of frames: ``cpu`` is for software rasterizers on machines with other work, which it does not count."""

REFERENCE_SHARE, MASK_SHARE = 1 / 3, 0.65
"""Of the time limit: when the reference ends, and when the masks of further configurations do."""


@dataclass(frozen=True, slots=True)
class Step:
    """Reported before each measurement.  ``total``: an upper bound where time is limited."""

    done: int
    total: int
    what: str


Progress = Callable[[Step], None]


@dataclass(frozen=True, slots=True)
class Reference:
    """What masks are compared with."""

    kind: str  # highest-quality | path-traced | exr
    samples: int | None = None  # asked for, of the path-traced one
    series: SampleCountSeries | None = None  # path-traced renders
    path: str | None = None  # of the renders

    @property
    def renders(self) -> tuple[Render, ...]:
        """Those that are points of the study."""
        return () if self.series is None else self.series.renders

    @property
    def identity(self) -> str:
        """The same for the same masks."""
        if self.series is not None:
            every = (*self.series.renders, *filter(None, (self.series.second,)))
            return " ".join(r.sequence.sha256()[:16] for r in every)
        return self.kind if self.samples is None else f"{self.kind}@{self.samples}"


@dataclass(frozen=True, slots=True)
class Subject(pixels.Subject):
    """What a study measures."""

    frames: range
    plan: Plan
    reference: Reference

    @property
    def baseline(self) -> Settings:
        return self.plan.named(BASELINE).settings


def cost(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path,
    progress: Progress | None = None,
    now: Clock | None = None,
    **options: Any,
) -> CostStudy:
    """Measure mask error and time of every configuration, and recommend one.

    ``options``: fields of ``CostOptions``, and those of Settings, which change ``settings``, the baseline.
    ``parameters`` are names in ``PARAMETERS``, ``combinations`` and ``effects``.  ``out`` holds the records: called
    again, the study resumes.  What the time limit leaves out is left to a later run; the least that an answer needs is
    always measured.  Interrupted by the keyboard, it returns what is measured so far.  ``now`` replaces the clock.
    Raises TaubenchError.
    """
    study_options = {name: options.pop(name) for name in declared(CostOptions) if name in options}
    request, baseline = from_values(CostOptions, study_options), (settings or Settings()).replace(**options)
    _check(baseline, request)
    if not isinstance(scene, Scene):
        scene = load_scene(scene, **baseline.sequence.reading)
    reference = request.reference
    series = find_series(reference) if reference is not None and is_sequence(reference) else None
    if series is not None:
        baseline = series.settings(baseline)
    requested = {name: baseline.get(name) for name in FIXED_LIGHTING}
    baseline = open_scene(scene, baseline).settings.replace(pairs=baseline.metrics.pairs)
    if baseline.metrics.all_pairs:
        baseline = baseline.replace(pairs="all")
    subject = make_subject(scene, baseline, request.parameters, reference, series)
    out, (seconds, clock) = Path(out), CLOCKS[request.clock]
    about = _about(subject, clock)
    header = {"identity": _identity(subject, about), "machine": about["machine"], "about": about}
    with FolderLock(out):
        if request.fresh:
            (out / RECORDS_FILE).unlink(missing_ok=True)
        if not (out / RECORDS_FILE).exists():
            (out / SUMS_FILE).unlink(missing_ok=True)  # of another study
        with closing(Records(out, header)) as records:
            measurements = Measurements(subject, records, out, request, now or seconds, progress)
            about["interrupted"] = not measurements.run()
            study = assemble(about, subject.plan, records, request.repeats)
    study.choose(request.within, request.budget_ms, request.choose_for)
    study.requested_lighting, study.out = requested, out
    return study


def _check(baseline: Settings, request: CostOptions) -> None:
    """Raises SettingsError for options of ``cost`` that mean nothing with this baseline."""
    columns = (OVERALL, *baseline.metrics.columns)
    if request.choose_for not in columns:
        hint = f"choose from {', '.join(columns)}"
        raise SettingsError(f"column {request.choose_for} is not measured", hint=hint)
    if request.parameters is not None and not request.parameters:
        raise SettingsError("no parameter is given", hint=f"choose from {', '.join(PARAMETERS)}")


def make_subject(
    scene: Scene,
    baseline: Settings,
    names: Sequence[str] | None,
    reference: str | None,
    series: SampleCountSeries | None = None,
) -> Subject:
    """What ``cost`` measures; ``baseline``: with its lighting resolved.  ``series``: the renders that ``reference``
    names.  Raises SettingsError."""
    camera = camera_of_run(scene, baseline.sequence)
    frames = frame_range(scene, camera, baseline)
    if len(frames) < 2:
        raise SettingsError("the scene gives no pair of frames", hint="give more --frames, or an animated scene")
    gpu = open_gpu(baseline.device.backend, baseline.device.device)
    ranked = tuple(ranked_with_sun(AnimatedScene(scene, camera).ranked_lights, environment_of(baseline).sun))
    limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
    context = StudyContext(scene, decide(scene, baseline), baseline, len(frames) - 1, ranked, limit)
    compared_with = (
        _reference(reference, context) if series is None else Reference("exr", series=series, path=reference)
    )
    sample = draw_pixels(frames, (baseline.sequence.width, baseline.sequence.height))
    return Subject(gpu, scene, camera, sample, frames, make_plan(context, names), compared_with)


def _reference(asked: str | None, context: StudyContext) -> Reference:
    """Raises SettingsError."""
    lit = PARAMETERS["light"].inapplicable(context) is None
    if asked is None:
        return Reference(PATH_TRACED if lit else HIGHEST_QUALITY)
    if asked == HIGHEST_QUALITY:
        return Reference(HIGHEST_QUALITY)
    samples = None if asked == PATH_TRACED else reference_samples(asked)
    if asked != PATH_TRACED and samples is None:
        hint = f"choose {PATH_TRACED}, {PATH_TRACED}@M, {HIGHEST_QUALITY}, or exr:DIR"
        raise SettingsError(f"no reference is named {asked!r}", hint=hint)
    if not lit:
        hint = f"give --reference {HIGHEST_QUALITY}"
        raise SettingsError("nothing is lit: there is no path-traced reference", hint=hint)
    return Reference(PATH_TRACED, samples)


def _about(subject: Subject, clock: str) -> dict[str, Any]:
    """The blocks of study.json that say what was measured, where and with which clock."""
    gpu, scene, reference, sequence = subject.gpu, subject.scene, subject.reference, subject.baseline.sequence
    costs = effect_costs(subject.animated, subject.baseline)
    return {
        "scene": {"name": scene.name, "sha256": scene.sha256, "stand_in": scene.stand_in},
        "camera": subject.camera.describe(),
        "size": [sequence.width, sequence.height],
        "fps": sequence.fps,
        "frames": [subject.frames.start, subject.frames.stop],
        "pairs": len(subject.frames) - 1,
        "columns": [c for c in COLUMNS if c in subject.baseline.metrics.columns],
        "pixels": {"count": len(subject.sample), "pairs": len(subject.sample.frames)},
        "reference": {name: getattr(reference, name) for name in ("kind", "identity", "path")},
        "lighting": {name: subject.baseline.to_dict()[name] for name in FIXED_LIGHTING},
        "effects": {name: {k: row[k] for k in ("on", "gpu_bytes")} for name, row in costs.items()},
        "machine": {
            "renderer": gpu.renderer,
            "driver": gpu.version,
            "processor": _processor(),
            "cores": os.cpu_count(),
            "clock": clock,
        },
        "provenance": provenance(gpu, clock),
        "date": date.today().isoformat(),
        "clock": clock,  # of frames: their time includes work of the CPU
        "parameters": list(subject.plan.parameters),
        "inapplicable": dict(subject.plan.inapplicable),
    }


def _identity(subject: Subject, about: Mapping[str, Any]) -> dict[str, str]:
    """Short hashes of everything that the records of a study depend on, by part."""
    files, frames = files_identity(file_hashes(subject.scene, subject.baseline)), subject.frames
    parts = {
        "scene": [files, about["camera"]],
        "settings": [subject.baseline.as_summary(frames), about["frames"]],
        "parameters": [[c.name, c.settings.as_summary(frames)] for c in subject.plan.configurations],
        "reference": about["reference"]["identity"],
    }
    texts = {name: json.dumps(part, sort_keys=True, default=str) for name, part in parts.items()}
    return {name: hashlib.sha256(text.encode()).hexdigest()[:16] for name, text in texts.items()}


def _processor() -> str:
    try:
        for line in read_text("/proc/cpuinfo").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OutputError:
        pass
    return platform.processor() or platform.machine()


class Measurements:
    """The measurements that are not in the records yet.  Each is recorded as soon as it is finished."""

    def __init__(
        self, subject: Subject, records: Records, out: Path, request: CostOptions, now: Clock,
        progress: Progress | None,
    ):  # fmt: skip
        self._subject, self._records, self._out, self._now = subject, records, out, now
        self._repeats, self._time_limit = request.repeats, request.time_limit
        self._deadline = Deadline(request.time_limit)
        self._progress = progress or (lambda step: None)
        plan = subject.plan.configurations
        grid = [c for c in plan if not c.comparable]
        self._masks_due = self._due("masks", [c for c in plan if c.comparable])
        self._renders_due = self._due("masks", subject.reference.renders)
        self._columns_due = self._due("columns", [plan[0], *grid] if grid else [])
        due = (self._masks_due, self._renders_due, self._columns_due, self._visits_due(plan))
        self._done, self._total = 0, (records.reference is None) + sum(map(len, due))

    def _due(self, kind: str, wanted: Sequence[Any]) -> list[Any]:
        """Of ``wanted``, configurations or renders, those without a record of ``kind``."""
        recorded = self._records.by_configuration(kind)
        return [item for item in wanted if item.name not in recorded]

    def _visits_due(self, plan: Sequence[Configuration]) -> list[tuple[int, Configuration]]:
        return due_visits(plan, self._repeats, self._records.of("time"))

    def run(self) -> bool:
        """The reference, masks in the order of the plan, times in rounds, columns.  False: interrupted by the user."""
        for measure in (self._measure_reference, self._measure_masks, self._measure_times, self._measure_columns):
            try:
                measure()
            except OutOfTime:
                continue
            except KeyboardInterrupt:
                return False
        return True

    @cached_property
    def _pairs(self) -> PairChannels:
        return PairChannels(self._subject, self._subject.baseline)

    def _words_of(self, light: Light) -> str:
        return pack(self._pairs.masks(light))

    def _words_of_render(self, render: Render) -> str:
        return self._words_of(render_light(render, self._subject.baseline, self._subject.sample.frames))

    def _measure_reference(self) -> None:
        recorded, wanted = self._records.reference, self._subject.reference
        if wanted.kind == PATH_TRACED:
            self._trace_reference(recorded or {"samples": 0, "seconds": 0.0})
        elif recorded is None:
            series = wanted.series
            self._report(f"reference: {'highest quality' if series is None else series.reference.name}")
            self._records.add("reference", self._raster_reference() if series is None else self._render_masks(series))

    def _raster_reference(self) -> dict[str, Any]:
        words = PairChannels(self._subject, self._subject.plan.highest, light=True).masks()
        return {"samples": None, "words": pack(words), "halves": None}

    def _render_masks(self, series: SampleCountSeries) -> dict[str, Any]:
        words = self._words_of_render(series.reference)
        halves = None if series.second is None else [words, self._words_of_render(series.second)]
        return {"samples": series.reference.samples, "words": words, "halves": halves}

    def _trace_reference(self, recorded: Mapping[str, Any]) -> None:
        """Trace until the samples that were asked for, or the reference's share of the time, are reached.

        Without a given number each half has a power of two: a Sobol sequence is balanced there, and two runs of the
        same length usually end at the same number, with the same masks.
        """
        subject, limit = self._subject, self._time_limit
        total = subject.reference.samples or (SAMPLES if limit is None else math.inf)
        wanted = math.ceil(0.5 * total) if total < math.inf else total  # of a half
        share = math.inf if limit is None else REFERENCE_SHARE * limit
        if recorded["samples"] and (
            recorded["samples"] >= 2 * wanted or recorded["seconds"] + recorded["next_seconds"] > share
        ):
            return
        started = time.monotonic() - recorded["seconds"]
        self._report("reference: channels of the sampled pairs")
        with TracedPixels(subject, self._pairs, reference_light(subject.baseline)) as traced:
            traced.load(self._out)
            count, seconds, ahead, series = 1, 0.0, 0.0, []  # count: samples of a half
            while count <= wanted and seconds + ahead <= share:
                ahead = 2.0 * self._trace_up_to(count, traced)
                halves = [self._words_of(traced.light(half)) for half in HALVES]
                series.append({"samples": traced.samples, "halves": halves})
                seconds = time.monotonic() - started
                count = min(2 * count, wanted) if count < wanted else math.inf
            record = series[-1] | {"seconds": seconds, "next_seconds": ahead, "before": series[-2:-1]}
            self._records.add("reference", record | {"words": self._words_of(traced.light())})

    def _trace_up_to(self, count: int, traced: TracedPixels) -> float:
        """Until each half has ``count`` samples, saved every MOST.  Seconds that ``count`` samples take."""
        began, before = time.monotonic(), traced.samples
        while 2 * count > traced.samples:
            self._report(f"reference: {traced.samples} samples per pixel", count=False)
            traced.trace(min(MOST, count - traced.samples // 2))
            traced.save(self._out)
        added = traced.samples - before
        return 2 * count * (time.monotonic() - began) / added if added else 0.0

    def _measure_masks(self) -> None:
        for render in self._renders_due:
            self._report(f"masks: {render.name}")
            facts = {"samples": render.samples, "frame_ms": list(render.frame_ms), "clock": render.clock}
            words = self._words_of_render(render)
            self._records.add("masks", {"configuration": render.name, "words": words, **facts})
        for c in self._masks_due:
            first = c.name == BASELINE  # without it there is no answer
            if not first and self._deadline.left(MASK_SHARE) < self._seconds_of_masks(c):
                continue
            self._report(f"masks: {c.name}")
            words = self._masks(c, (lambda: None) if first else partial(self._deadline.check, MASK_SHARE))
            self._records.add("masks", {"configuration": c.name, "words": pack(words)})

    def _seconds_of_masks(self, configuration: Configuration) -> float:
        """How long path-traced masks take, by the reference, which traces the same pixels; 0 of others."""
        reference = self._records.reference
        if not configuration.traced or not reference.get("seconds"):
            return 0.0
        return configuration.settings.lighting.path_samples * reference["seconds"] / reference["samples"]

    def _masks(self, configuration: Configuration, check: Callable[[], None]) -> Any:
        subject = self._subject
        if configuration.on_cpu:
            return PairChannels(subject, configuration.settings, light=True, check=check).masks()
        if configuration.traced and subject.reference.kind != HIGHEST_QUALITY:
            return traced_masks(subject, self._pairs, configuration.settings, check)
        return rendered_masks(subject, configuration.settings, configuration.without, check)

    def _measure_times(self) -> None:
        """The visits that are due, round by round, all configurations in turn, of those whose masks are known."""
        masks, subject = self._records.by_configuration("masks"), self._subject
        plan = [c for c in subject.plan.configurations if c.name in masks or not c.comparable]

        def open_one(c: Configuration) -> OpenConfiguration:
            return OpenConfiguration(subject.gpu, subject.scene, subject.camera, c, self._now, self._deadline.check)

        with subject.gpu, Pool(open_one, subject.gpu.software) as pool:
            for number, c in self._visits_due(plan):
                self._deadline.check()
                if self._too_long(c):
                    continue
                self._report(f"round {number + 1} of {self._repeats}: {c.name}")
                with OtherWork() as work:
                    times = pool.visit(c)
                busy = {"seconds": work.seconds, "other_seconds": work.other_seconds}
                self._records.add("time", {"configuration": c.name, "round": number, **busy, **times})

    def _too_long(self, configuration: Configuration) -> bool:
        """Whether a visit of path-traced light would take more than half of the time that is left, as far as other
        visits tell."""
        if not configuration.traced:
            return False
        frame_ms = {name: visit["frame_ms"] for name, visit in self._records.by_configuration("time").items()}
        counts = {c.name: c.settings.lighting.path_samples for c in self._subject.plan.configurations if c.traced}
        per_sample = [frame_ms[name] / n for name, n in counts.items() if name in frame_ms]
        ms = frame_ms.get(configuration.name, counts[configuration.name] * max(per_sample, default=0.0))
        frames = 2 if configuration.name in frame_ms else 4  # a first visit also compiles
        return 1e-3 * frames * ms > 0.5 * self._deadline.left()

    def _measure_columns(self) -> None:
        subject, check = self._subject, self._deadline.check
        for c in self._columns_due:
            check()
            self._report(f"columns: {c.name}")
            differences = measure_columns(subject.scene, subject.camera, c.settings, check)
            self._records.add("columns", {"configuration": c.name, **differences})

    def _report(self, what: str, count: bool = True) -> None:
        self._progress(Step(self._done, self._total, what))
        self._done += count
