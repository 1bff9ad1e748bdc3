"""``cost``: mask error and time of every declared configuration of one scene, and which one to use."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import date
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from taubench_gl.animation import camera_of_run
from taubench_gl.conventions import COLUMNS
from taubench_gl.cost import pixels
from taubench_gl.cost.analysis import OVERALL
from taubench_gl.cost.configurations import BASELINE, Configuration, Plan, make_plan
from taubench_gl.cost.errors import measure_columns
from taubench_gl.cost.parameters import PARAMETERS, StudyContext
from taubench_gl.cost.pixels import PairChannels, draw_pixels, pack, rendered_masks
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
from taubench_gl.effects.decide import decide
from taubench_gl.effects.lighting import environment_of
from taubench_gl.errors import SettingsError, note_renamed
from taubench_gl.evaluation import file_hashes, files_identity, frame_range, resolve_lighting
from taubench_gl.folder_lock import FolderLock
from taubench_gl.frame.plan import FramePlan
from taubench_gl.frame.spec import SceneFacts, ranked_with_sun
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.pathtraced.series import Render, SampleCountSeries, find_series
from taubench_gl.provenance import provenance
from taubench_gl.reuse.path_traced import reference_samples
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

HIGHEST_QUALITY, PATH_TRACED = "highest-quality", "path-traced"
FORMER_REFERENCE = "best"
REPEATS = 5
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
class Request:
    """What a study is asked for, besides scene and settings."""

    reference: str | None  # None: path-traced where anything is lit, else highest quality
    within: float | None  # percent of the pixels
    budget_ms: float | None
    choose_for: str
    repeats: int
    time_limit: float | None  # seconds

    def check(self, measured: Sequence[str]) -> None:
        """Raises SettingsError.  ``measured``: the columns of the study."""
        if self.within is not None and not self.within >= 0:
            raise SettingsError(f"within is {self.within}", hint="give percent of the pixels, at least 0")
        if self.budget_ms is not None and not self.budget_ms > 0:
            raise SettingsError(f"budget is {self.budget_ms} ms", hint="give milliseconds above 0")
        if self.time_limit is not None and not self.time_limit > 0:
            raise SettingsError(f"time limit is {self.time_limit} s", hint="give a time above 0")
        if self.repeats < 1:
            raise SettingsError(f"repeats is {self.repeats}", hint="give 1 or more; 3 for a spread")
        if self.choose_for not in (OVERALL, *measured):
            hint = f"choose from {', '.join((OVERALL, *measured))}"
            raise SettingsError(f"nothing can be chosen for {self.choose_for!r}", hint=hint)


@dataclass(frozen=True, slots=True)
class Subject(pixels.Subject):
    """What a study measures."""

    frames: range
    plan: Plan
    series: SampleCountSeries | None  # path-traced renders as reference
    reference: str  # highest-quality | path-traced | exr
    samples: int | None  # asked for, of the path-traced reference

    @property
    def baseline(self) -> Settings:
        return self.plan.named(BASELINE).settings


def cost(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path,
    parameters: Sequence[str] | None = None,
    reference: str | None = None,
    within: float | None = None,
    budget_ms: float | None = None,
    choose_for: str = OVERALL,
    repeats: int = REPEATS,
    time_limit: float | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
    clock: str = "wall",
    now: Clock | None = None,
    **overrides: Any,
) -> CostStudy:
    """Measure mask error and time of every configuration, and recommend one.

    ``settings`` and ``overrides`` (fields of Settings) are the baseline.  ``parameters``: names in ``PARAMETERS``,
    ``levels``, ``combinations``, ``effects`` (None: all these).  ``reference``: "path-traced", "path-traced@M" with M
    samples per pixel, "highest-quality", or ``exr:DIR``, renders; None: path-traced where anything is lit.
    ``within`` percent of the pixels and ``budget_ms`` limit the recommendation, for one column or the overall error
    (``choose_for``).
    ``repeats``: interleaved rounds of timing.  ``time_limit``: seconds; what is not measured by then is left to a later
    run (the least that an answer needs is always measured).  ``out``
    holds the records: called again, the study resumes; ``fresh`` starts from scratch.  Interrupted by the keyboard, it
    returns what is measured so far.
    ``clock``: of CLOCKS; ``now`` replaces it.  Raises TaubenchError.
    """
    baseline = (settings or Settings()).replace(**overrides)
    if clock not in CLOCKS:
        raise SettingsError(f"no clock is named {clock!r}", hint=f"choose from {', '.join(CLOCKS)}")
    request = Request(reference, within, budget_ms, choose_for, repeats, time_limit)
    request.check(baseline.metrics.columns)
    if parameters is not None and not parameters:
        raise SettingsError("no parameter is given", hint=f"choose from {', '.join(PARAMETERS)}")
    if not isinstance(scene, Scene):
        scene = load_scene(scene, **baseline.sequence.reading)
    series = find_series(reference) if reference is not None and is_sequence(reference) else None
    if series is not None:
        baseline = series.settings(baseline)
    requested = {name: baseline.get(name) for name in FIXED_LIGHTING}
    baseline = resolve_lighting(scene, baseline, camera_of_run(scene, baseline.sequence)).settings
    subject = make_subject(scene, baseline, parameters, series, reference)
    out = Path(out)
    about = _about(subject, reference, CLOCKS[clock][1])
    header = {"identity": _identity(subject, about), "machine": about["machine"], "about": about}
    with FolderLock(out):
        if fresh:
            (out / RECORDS_FILE).unlink(missing_ok=True)
        if not (out / RECORDS_FILE).exists():
            (out / SUMS_FILE).unlink(missing_ok=True)  # of another study
        with closing(Records(out, header)) as records:
            measurements = Measurements(subject, records, request, out, progress, now or CLOCKS[clock][0])
            interrupted = False
            try:
                measurements.run()
            except KeyboardInterrupt:
                interrupted = True
            study = assemble(about, subject.plan, records.lines, repeats)
            study.about["interrupted"], study.requested_lighting = interrupted, requested
            study.choose(within, budget_ms, choose_for)
    study.out = out
    return study


def make_subject(
    scene: Scene,
    baseline: Settings,
    names: Sequence[str] | None,
    series: SampleCountSeries | None,
    reference: str | None,
) -> Subject:
    """What ``cost`` measures; ``baseline``: with its lighting resolved.  Raises SettingsError."""
    camera = camera_of_run(scene, baseline.sequence)
    frames = frame_range(scene, camera, baseline)
    if len(frames) < 2:
        raise SettingsError("the scene gives no pair of frames", hint="give more --frames, or an animated scene")
    gpu = open_gpu(baseline.device.backend, baseline.device.device)
    ranked = tuple(ranked_with_sun(SceneFacts(scene, camera).ranked_lights, environment_of(baseline).sun))
    limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
    context = StudyContext(scene, decide(scene, baseline), baseline, len(frames) - 1, ranked, limit)
    kind, samples = ("exr", None) if series is not None else _reference_kind(reference, context)
    plan = make_plan(context, names)
    sample = draw_pixels(frames, (baseline.sequence.width, baseline.sequence.height))
    return Subject(gpu, scene, camera, sample, frames, plan, series, kind, samples)


def _reference_kind(reference: str | None, context: StudyContext) -> tuple[str, int | None]:
    """``path-traced`` with the samples that were asked for, or ``highest-quality``.  Raises SettingsError."""
    lit = PARAMETERS["light"].inapplicable(context) is None
    if reference is None:
        return (PATH_TRACED if lit else HIGHEST_QUALITY), None
    if reference == FORMER_REFERENCE:
        note_renamed(f"reference {FORMER_REFERENCE}", f"reference {HIGHEST_QUALITY}")
    if reference in (HIGHEST_QUALITY, FORMER_REFERENCE):
        return HIGHEST_QUALITY, None
    samples = None if reference == PATH_TRACED else reference_samples(reference)
    if reference != PATH_TRACED and samples is None:
        hint = f"choose {PATH_TRACED}, {PATH_TRACED}@M, {HIGHEST_QUALITY}, or exr:DIR"
        raise SettingsError(f"no reference is named {reference!r}", hint=hint)
    if not lit:
        hint = f"give --reference {HIGHEST_QUALITY}"
        raise SettingsError("nothing is lit: there is no path-traced reference", hint=hint)
    return PATH_TRACED, samples


def _about(subject: Subject, reference: str | None, clock: str) -> dict[str, Any]:
    """The blocks of study.json that say what was measured, where and with which clock."""
    gpu, scene, series, sequence = subject.gpu, subject.scene, subject.series, subject.baseline.sequence
    described: dict[str, Any] = {"kind": subject.reference, "identity": subject.reference, "path": None}
    if series is not None:
        hashes = [r.sequence.sha256()[:16] for r in (*series.renders, *filter(None, (series.second,)))]
        described |= {"identity": " ".join(hashes), "path": reference, "samples": series.reference.samples}
    elif subject.samples is not None:
        described["identity"] = f"{PATH_TRACED}@{subject.samples}"
    plan = FramePlan(scene, subject.baseline, subject.camera)
    return {
        "scene": {"name": scene.name, "sha256": scene.sha256, "stand_in": scene.stand_in},
        "camera": subject.camera.describe(),
        "size": [sequence.width, sequence.height],
        "fps": sequence.fps,
        "frames": [subject.frames.start, subject.frames.stop],
        "pairs": len(subject.frames) - 1,
        "columns": [c for c in COLUMNS if c in subject.baseline.metrics.columns],
        "pixels": {"count": len(subject.sample), "pairs": len(subject.sample.frames)},
        "reference": described,
        "lighting": {name: subject.baseline.to_dict()[name] for name in FIXED_LIGHTING},
        "effects": {name: {k: row[k] for k in ("on", "gpu_bytes")} for name, row in plan.costs().items()},
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
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


class Measurements:
    """The measurements that are not in the records yet.  Each is recorded as soon as it is finished."""

    def __init__(
        self, subject: Subject, records: Records, request: Request, out: Path, progress: Progress | None, now: Clock
    ):
        self._subject, self._records, self._request, self._out, self._now = subject, records, request, out, now
        self._progress = progress or (lambda step: None)
        self._deadline = Deadline(request.time_limit)
        plan = subject.plan.configurations
        renders = () if subject.series is None else subject.series.renders
        masks = {r["configuration"] for r in records.of("masks")}
        self._masks_due = [c for c in plan if c.comparable and c.name not in masks]
        self._renders_due = [r for r in renders if r.name not in masks]
        columns = {r["configuration"] for r in records.of("columns")}
        grid = [c for c in plan if not c.comparable]
        self._columns_due = [c for c in ((plan[0], *grid) if grid else ()) if c.name not in columns]
        visits = len(due_visits(plan, request.repeats, records.of("time"))) + (not records.of("reference"))
        due = len(self._masks_due) + len(self._renders_due) + len(self._columns_due)
        self._done, self._total = 0, due + visits

    def run(self) -> None:
        """The reference, masks in the order of the plan, times in rounds, columns."""
        for measure in (self._measure_reference, self._measure_masks, self._measure_times, self._measure_columns):
            with suppress(OutOfTime):
                measure()

    @cached_property
    def _pairs(self) -> PairChannels:
        return PairChannels(self._subject, self._subject.baseline)

    def _measure_reference(self) -> None:
        subject, known = self._subject, self._records.of("reference")
        if subject.reference == PATH_TRACED:
            self._trace_reference(known[-1] if known else {"samples": 0, "seconds": 0.0})
        elif not known and subject.series is not None:
            self._report(f"reference: {subject.series.reference.name}")
            series = subject.series
            light = render_light(series.reference, subject.baseline, subject.sample.frames)
            found = {"samples": series.reference.samples, "words": pack(self._pairs.masks(light)), "halves": None}
            if series.second is not None:
                second = render_light(series.second, subject.baseline, subject.sample.frames)
                found["halves"] = [found["words"], pack(self._pairs.masks(second))]
            self._add("reference", found)
        elif not known:
            self._report("reference: highest quality")
            words = PairChannels(subject, subject.plan.highest, light=True).masks()
            self._add("reference", {"samples": None, "words": pack(words), "halves": None})

    def _trace_reference(self, known: Mapping[str, Any]) -> None:
        """Trace until the samples that were asked for, or the reference's share of the time, are reached.

        Without a given number each half has a power of two: a Sobol sequence is balanced there, and two runs of the
        same length usually end at the same number, with the same masks.
        """
        subject, limit = self._subject, self._request.time_limit
        total = subject.samples or (SAMPLES if limit is None else math.inf)
        wanted = math.ceil(0.5 * total) if total < math.inf else total  # of a half
        share = math.inf if limit is None else REFERENCE_SHARE * limit
        if known["samples"] and (known["samples"] >= 2 * wanted or known["seconds"] + known["next_seconds"] > share):
            return
        started = time.monotonic() - known["seconds"]
        self._report("reference: channels of the sampled pairs")
        traced = TracedPixels(subject, self._pairs, reference_light(subject.baseline))
        try:
            traced.load(self._out)
            count, seconds, ahead, series = 1, 0.0, 0.0, []  # count: samples of a half
            while count <= wanted and seconds + ahead <= share:
                ahead = 2.0 * self._trace_up_to(count, traced)
                halves = [pack(self._pairs.masks(traced.light(half))) for half in HALVES]
                series.append({"samples": traced.samples, "halves": halves})
                seconds = time.monotonic() - started
                count = min(2 * count, wanted) if count < wanted else math.inf
            found = series[-1] | {"seconds": seconds, "next_seconds": ahead, "before": series[-2:-1]}
            self._add("reference", found | {"words": pack(self._pairs.masks(traced.light()))})
        finally:
            traced.release()

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
            self._add("masks", self._masks_of_render(render))
        for configuration in self._masks_due:
            first = configuration.name == BASELINE  # without it there is no answer
            if not first and self._deadline.left(MASK_SHARE) < self._seconds_of_masks(configuration):
                continue
            self._report(f"masks: {configuration.name}")
            words = self._masks(configuration, (lambda: None) if first else partial(self._deadline.check, MASK_SHARE))
            self._add("masks", {"configuration": configuration.name, "words": pack(words)})

    def _seconds_of_masks(self, configuration: Configuration) -> float:
        """How long path-traced masks take, by the reference, which traces the same pixels; 0 of others."""
        known = self._records.of("reference")[-1]
        if not configuration.traced or not known.get("seconds"):
            return 0.0
        return configuration.settings.lighting.path_samples * known["seconds"] / known["samples"]

    def _masks(self, configuration: Configuration, check: Callable[[], None]) -> Any:
        subject = self._subject
        if configuration.on_cpu:
            return PairChannels(subject, configuration.settings, light=True, check=check).masks()
        if configuration.traced and self._subject.reference != HIGHEST_QUALITY:
            return traced_masks(subject, self._pairs, configuration.settings, check)
        return rendered_masks(subject, configuration.settings, configuration.without, check)

    def _masks_of_render(self, render: Render) -> dict[str, Any]:
        light = render_light(render, self._subject.baseline, self._subject.sample.frames)
        found = {"configuration": render.name, "words": pack(self._pairs.masks(light))}
        return found | {"samples": render.samples, "frame_ms": list(render.frame_ms), "clock": render.clock}

    def _measure_times(self) -> None:
        """The visits that are due, round by round, all configurations in turn, of those whose masks are known."""
        masks, subject = {r["configuration"] for r in self._records.of("masks")}, self._subject
        plan = [c for c in subject.plan.configurations if c.name in masks or not c.comparable]

        def open_one(c: Configuration) -> OpenConfiguration:
            return OpenConfiguration(subject.gpu, subject.scene, subject.camera, c, self._now, self._deadline.check)

        with subject.gpu, Pool(open_one, subject.gpu.software) as pool:
            for number, configuration in due_visits(plan, self._request.repeats, self._records.of("time")):
                self._deadline.check()
                if self._too_long(configuration):
                    continue
                self._report(f"round {number + 1} of {self._request.repeats}: {configuration.name}")
                with OtherWork() as work:
                    found = pool.visit(configuration)
                tag = {"configuration": configuration.name, "round": number}
                self._add("time", tag | {"seconds": work.seconds, "other_seconds": work.other_seconds} | found)

    def _too_long(self, configuration: Configuration) -> bool:
        """Whether a visit of path-traced light would take more than half of the time that is left, as far as other
        visits tell."""
        if not configuration.traced:
            return False
        known = {r["configuration"]: r["frame_ms"] for r in self._records.of("time")}
        counts = {c.name: c.settings.lighting.path_samples for c in self._subject.plan.configurations if c.traced}
        per_sample = [known[name] / n for name, n in counts.items() if name in known]
        ms = known.get(configuration.name, counts[configuration.name] * max(per_sample, default=0.0))
        frames = 2 if configuration.name in known else 4  # a first visit also compiles
        return 1e-3 * frames * ms > 0.5 * self._deadline.left()

    def _measure_columns(self) -> None:
        for configuration in self._columns_due:
            self._deadline.check()
            self._report(f"columns: {configuration.name}")
            check = self._deadline.check
            found = measure_columns(self._subject.scene, self._subject.camera, configuration.settings, check)
            self._add("columns", {"configuration": configuration.name} | found)

    def _add(self, kind: str, record: Mapping[str, Any]) -> None:
        self._records.add({"kind": kind, **record})

    def _report(self, what: str, count: bool = True) -> None:
        self._progress(Step(self._done, self._total, what))
        self._done += count
