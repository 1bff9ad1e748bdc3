"""The time that units will take, measured on this machine: a few small frames of every input, and two parts of every
path-traced reference."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from taubench_gl.animation import Poser, camera_of_run
from taubench_gl.benchmark.scenes import scene_file
from taubench_gl.benchmark.suite import Case
from taubench_gl.benchmark.unit import BenchmarkUnit, applicable
from taubench_gl.conventions import COLUMNS
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import resolve_lighting
from taubench_gl.gpu.context import open_gpu
from taubench_gl.pathtraced.references import PART, References
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.path_traced import PREFIX, reference_samples
from taubench_gl.scene import load_scene

WIDTH = 160
"""Frames are measured at about this width; their time is taken to be proportional to the number of pixels."""

FRAMES = 3


@dataclass(frozen=True, slots=True)
class UnitTime:
    """``frames``: seconds of all frames, seeds and methods; ``reference``: of tracing what is not stored of it."""

    unit: BenchmarkUnit
    frames: float
    reference: float

    @property
    def seconds(self) -> float:
        return self.frames + self.reference


def estimate_units(units: Sequence[BenchmarkUnit], say: Callable[[str], None] = lambda line: None) -> list[UnitTime]:
    """One entry per unit, in their order, for one worker.

    What is traced for the estimate is stored and counts.  Raises TaubenchError.
    """
    of_kind: dict[tuple[object, ...], tuple[float, float]] = {}
    out = []
    for unit in units:
        case = unit.case
        kind = (case.scene.source, case.input, case.light_samples, case.vpl_samples, case.reference_samples)
        if kind not in of_kind:
            say(f"{case.id}: measuring {FRAMES} frames")
            of_kind[kind] = _measured(unit)
        start, pixel = of_kind[kind]
        frames = case.seeds * (start + pixel * case.size[0] * case.size[1] * case.frames)
        out.append(UnitTime(unit, frames, _tracing(case)))
    return out


def _measured(unit: BenchmarkUnit) -> tuple[float, float]:
    """Seconds to begin a seed, and per pixel of a frame, with all methods of ``unit`` that apply."""
    specs = applicable(unit.case, unit.entries)
    if not specs:
        return 0.0, 0.0
    case = _small(unit.case)
    pairs: list[float] = []
    started = time.perf_counter()
    evaluate_methods(
        scene_file(case.scene),
        specs,
        case.settings,
        progress=lambda done: pairs.append(done.frame_seconds),
        **{**case.request, "statistics": False},
    )
    start = (time.perf_counter() - started - sum(pairs)) / case.seeds
    # The last frames: a second seed has its reference in memory, and the shaders are compiled.
    return start, min(pairs[-(FRAMES - 1) :]) / (case.size[0] * case.size[1])


def _small(case: Case) -> Case:
    """A few small frames of a case; with random numbers, of two seeds."""
    traced = reference_samples(case.reference) is not None
    few = replace(
        case,
        frames=min(case.frames, FRAMES),
        warmup=1,
        cuts=(),
        seeds=2 if case.kind.noisy or case.kind.path_samples else 1,
        reference=f"{PREFIX}{PART}" if traced else case.reference,
    )
    factor = max(1, round(case.size[0] / WIDTH))
    if any(length % factor for length in case.size):
        return few
    small = replace(few, size=(case.size[0] // factor, case.size[1] // factor))
    try:
        small.kind.input_size(small.size)
    except SettingsError:
        return few
    return small


def _tracing(case: Case) -> float:
    """Seconds of what is not stored of a path-traced reference; 0 for other references."""
    samples = reference_samples(case.reference)
    if samples is None:
        return 0.0
    scene = load_scene(scene_file(case.scene))
    settings = case.settings
    camera = camera_of_run(scene, settings.sequence)
    settings = resolve_lighting(scene, settings.replace(columns=COLUMNS), camera).settings
    gpu = open_gpu(settings.device.backend, settings.device.device)
    with gpu:
        references = References.open(gpu, scene, camera, settings, samples, poser=Poser(scene), exact=True)
        try:
            return references.estimate(range(case.first, case.first + case.frames)).seconds or 0.0
        finally:
            references.release()
            gpu.collect()
