"""Time that the images of the paper will take: of pairs that were counted before, else of a few frames drawn now."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

from taubench_gl.animation import camera_of_run
from taubench_gl.batch.merge import job_positions
from taubench_gl.batch.spec import Job
from taubench_gl.batch.study import batch_store, stored_pairs
from taubench_gl.batch.units import head_key, resolved_job
from taubench_gl.evaluation import (
    LightPlan,
    Observers,
    evaluate_scene,
    frame_range,
    frame_schedule,
    light_plan,
    sampled_pairs,
)
from taubench_gl.evaluation.decided_pixels import decided_light
from taubench_gl.evaluation.sampled_light import ROUND_SIZES
from taubench_gl.metrics.path_samples import LIMIT
from taubench_gl.outputs import duration_text
from taubench_gl.paper.study import RUNS, SceneJobs
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import AUTO, Settings
from taubench_gl.study.progress import Estimate
from taubench_gl.study.store import Store

SMALLER = 8
"""Factor by which the images are smaller in which path-traced light is timed."""

LEAST = (160, 90)
"""Smallest size of timed images, unless the images are smaller: in fewer pixels the time is that of starting work."""

PROBES = (4, 12)
"""Samples per pixel at which path-traced light is timed: the difference is the time of the samples alone."""


def estimate(jobs: Iterable[SceneJobs], out: Path) -> list[Estimate]:
    """The time of the images (Table 4) that are left.  Tables 1 to 3 take seconds.  Raises TaubenchError."""
    store, estimates = batch_store(out / RUNS), []
    for scene in jobs:
        loaded: Scene | None = None
        for light, job in scene.images.items():
            left, seconds = _counted(store, job)
            reason, rounds = "measured in the pairs counted before", 0.0
            if seconds is None:
                loaded = loaded or load_scene(job.scene, **job.settings.sequence.reading)
                left, seconds, reason, rounds = _timed(loaded, job)
            if left:
                estimates.append(Estimate(f"{scene.scene.label}, {light}", left, seconds, reason, rounds))
    return estimates


def _counted(store: Store, job: Job) -> tuple[int, float | None]:
    """Pairs of a job that are left, and the seconds of a counted pair; None where no pair is counted."""
    head = store.load(head_key(job.id))
    if head is None:
        return 0, None
    reports, pairs = stored_pairs(store, job.id, head)
    spent = sum(report["provenance"]["seconds"] for report in reports)
    left = [p for p in job_positions(resolved_job(job, head), head) if p not in pairs]
    return len(left), spent / len(pairs) if pairs else None


def _timed(scene: Scene, job: Job) -> tuple[int, float, str, float]:
    """Pairs of a job, the seconds of one, how they were timed, and the seconds of all samples at random pixels."""
    settings, light, plan = job.settings, job.settings.lighting, light_plan(job.settings, sampled=True)
    if light.exposure == AUTO:  # metering takes as long as what is timed
        settings = settings.replace(exposure=1.0 if scene.exposure is None else scene.exposure)
    frames = frame_range(scene, camera_of_run(scene, settings.sequence, settings.metrics.unit_scale), settings)
    pairs = len(sampled_pairs(frames, settings).positions)
    drawn = len(frame_schedule(frames, settings)) / max(pairs, 1)  # frames of a pair
    start = frames[max(len(frames) // 2 - 1, 0)]
    window = settings.replace(frames=(start, min(start + 3, frames.stop)), pairs="all")
    seconds, reason = drawn * _slowest(scene, window.replace(light="raster", spp=None)), "timed in three frames"
    rounds = 0.0
    if light.light != "raster":
        samples = drawn * light.path_samples  # of a pixel and a pair
        if plan is LightPlan.DECIDED:  # at most, in two frames
            window, samples = decided_light(window), 2 * LIMIT
        seconds += _of_a_sample(scene, window) * settings.sequence.width * settings.sequence.height * samples
        width, height = _probe_size(settings)
        reason = f"timed at {width}x{height} with {PROBES[0]} and {PROBES[1]} samples"
    if plan is LightPlan.SAMPLED:
        rounds = ROUND_SIZES.samples * _of_a_sample(scene, decided_light(window))
        reason += f"; at most {duration_text(rounds)} of it at random pixels"
    return pairs, seconds, reason, rounds


def _of_a_sample(scene: Scene, settings: Settings) -> float:
    """Seconds of one sample of one pixel."""
    width, height = _probe_size(settings)
    few, many = (_slowest(scene, settings.replace(spp=spp, width=width, height=height)) for spp in PROBES)
    return max(many - few, 0.0) / (PROBES[1] - PROBES[0]) / (width * height)


def _slowest(scene: Scene, settings: Settings) -> float:
    """Seconds of the last frame of ``settings``; the first ones compile shaders and fill caches."""
    seconds: list[float] = []
    started = time.perf_counter()
    evaluate_scene(scene, settings, Observers(progress=lambda progress: seconds.append(progress.frame_seconds)))
    return seconds[-1] if seconds else time.perf_counter() - started


def _probe_size(settings: Settings) -> tuple[int, int]:
    """Width and height of the images in which path-traced light is timed."""
    width, height = settings.sequence.width, settings.sequence.height
    return max(width // SMALLER, min(width, LEAST[0])), max(height // SMALLER, min(height, LEAST[1]))
