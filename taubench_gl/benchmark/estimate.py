"""The time that units will take, measured on this machine: a few small frames of every input, and two parts of every
path-traced reference."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

from taubench_gl.benchmark.scenes import scene_file
from taubench_gl.benchmark.suite import Case
from taubench_gl.benchmark.unit import BenchmarkUnit, applicable
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import plan_scene
from taubench_gl.evaluation.owner import opened_gpu
from taubench_gl.features import COLUMNS
from taubench_gl.pathtraced.references import PART, References
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.references import PREFIX, reference_samples
from taubench_gl.scene import load_scene
from taubench_gl.study.progress import Estimate

WIDTH = 160
"""Frames are measured at about this width; their time is taken to be proportional to the number of pixels."""

FRAMES = 3


@dataclass(frozen=True, slots=True)
class Cost:
    """Seconds of the parts of a unit."""

    begin: float = 0.0  # to begin the unit
    seed: float = 0.0  # to begin each further seed
    first: float = 0.0  # per pixel of a frame of the first seed, which makes the reference and the exact masks
    pixel: float = 0.0  # per pixel of a frame of further seeds, which have them

    def of(self, case: Case, traced: float = 0.0) -> Estimate:
        """The time of all frames of a case; ``traced``: seconds for the path-traced reference."""
        seeds = case.request.seeds
        frame = (self.first + (seeds - 1) * self.pixel) / seeds * case.size[0] * case.size[1]
        begin = self.begin + (seeds - 1) * self.seed + traced
        return Estimate(case.id, seeds * case.evaluated_frames, frame, begin=begin)


def estimate_units(units: Sequence[BenchmarkUnit], say: Callable[[str], None] = lambda line: None) -> list[Estimate]:
    """The time of each unit, in their order, with one worker.  ``say`` prints a line about what is measured.

    What is traced for the estimate is stored and counts.  Raises TaubenchError.
    """
    of_kind: dict[tuple[object, ...], Cost] = {}
    estimates = []
    for unit in units:
        case = unit.case
        kind = (case.scene.source, case.kind, case.request.reference_samples)
        if kind not in of_kind:
            say(f"{case.id}: measuring a few frames")
            if not of_kind:
                _measured(unit)  # a worker loads libraries once, not for every unit
            of_kind[kind] = _measured(unit)
        cost = of_kind[kind] if applicable(case, unit.entries) else Cost()
        estimates.append(cost.of(case, _tracing(case)))
    return estimates


def _measured(unit: BenchmarkUnit) -> Cost:
    """The costs of all methods of ``unit`` that apply, from a few small frames."""
    specs = applicable(unit.case, unit.entries)
    if not specs:
        return Cost()
    case = _small(unit.case)
    times = [time.perf_counter()]
    evaluate_methods(
        scene_file(case.scene),
        specs,
        case.settings,
        on_frame=lambda frame: times.append(time.perf_counter()),
        **asdict(case.request),
    )
    return cost_of(times, time.perf_counter(), case)


def cost_of(times: Sequence[float], end: float, case: Case) -> Cost:
    """The costs of ``case``, a small one, by a clock in seconds.

    ``times``: when the evaluation began, and when each frame of each seed was done; ``end``: when it ended.
    """
    spent = [after - before for before, after in itertools.pairwise(times)]
    # Of the later frames of a seed: shaders are compiled.
    count = case.evaluated_frames
    first, frame = min(spent[1:count]), min(spent[-(count - 1) :])
    seed = spent[count] - frame if case.request.seeds > 1 else 0.0
    begin, pixels = spent[0] - first + end - times[-1], case.size[0] * case.size[1]
    return Cost(max(begin, 0.0), max(seed, 0.0), first / pixels, frame / pixels)


def _small(case: Case) -> Case:
    """A few small frames of a case; with random numbers, of two seeds."""
    traced = reference_samples(case.request.reference) is not None
    request = replace(
        case.request,
        warmup=1,
        cuts=(),
        seeds=2 if case.kind.noisy or case.kind.path_samples else 1,
        reference=f"{PREFIX}{PART}" if traced else case.request.reference,
    )
    frames = min(case.frames, 3 * case.request.render_every if case.generated else FRAMES)
    few = replace(
        case, frames=frames, request=request, settings=case.settings.replace(frames=(case.first, case.first + frames))
    )
    factor = max(1, round(case.size[0] / WIDTH))
    if any(length % factor for length in case.size):
        return few
    width, height = (length // factor for length in case.size)
    try:
        few.kind.input_size((width, height))
    except SettingsError:
        return few
    return replace(few, settings=few.settings.replace(width=width, height=height))


def _tracing(case: Case) -> float:
    """Seconds of the part of a path-traced reference that is not stored yet; 0 for other references."""
    samples = reference_samples(case.request.reference)
    if samples is None:
        return 0.0
    opened = plan_scene(load_scene(scene_file(case.scene)), case.settings.replace(columns=COLUMNS))
    with opened_gpu(opened.settings) as owner:
        references = References.open(owner, opened.animated, opened.settings, samples, exact=True)
        return references.estimate(range(case.first, case.first + case.frames)).seconds or 0.0
