"""Seconds that the jobs of the paper will take: of pairs that were counted before, else of a few frames drawn now."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from taubench_gl.animation import camera_of_run
from taubench_gl.batch.merge import job_positions
from taubench_gl.batch.spec import Job
from taubench_gl.batch.study import batch_store, stored_pairs
from taubench_gl.batch.units import head_key, resolved_job
from taubench_gl.evaluation import Observers, evaluate_scene, frame_range, frame_schedule, sampled_pairs
from taubench_gl.paper.pixels import PixelRun
from taubench_gl.paper.study import PIXELS, RUNS, SceneJobs
from taubench_gl.pathtraced.references import duration_text
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import AUTO, Settings
from taubench_gl.study.store import Store

SMALLER = 8
"""Factor by which the images are smaller in which path-traced light is timed."""

LEAST = (160, 90)
"""They are no smaller than this, or than the images: in fewer pixels the time is that of starting the work."""

PROBES = (4, 12)
"""Samples per pixel at which it is timed: the difference is the time of the samples alone."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """``pairs`` that are left of a job, and the seconds of one."""

    label: str
    pairs: int
    seconds: float
    reason: str

    @property
    def total(self) -> float:
        return self.pairs * self.seconds


def estimate(jobs: Iterable[SceneJobs], out: Path) -> list[Estimate]:
    """What is left of the images (Table 4).  Tables 1 to 3 take seconds and are left out.  Raises TaubenchError."""
    store, found = batch_store(out / RUNS), []
    for scene in jobs:
        loaded: Scene | None = None
        raster: float | None = None
        for light, job in scene.images.items():
            label = f"{scene.scene.label}, {light}"
            if job is scene.at_pixels:
                found += _at_pixels(label, PixelRun(job, scene.pixels, out / PIXELS))
                continue
            counted = _counted(store, job)
            if counted is not None and counted.pairs == 0:
                continue
            if counted is not None and counted.seconds is not None:
                found.append(Estimate(label, counted.pairs, counted.seconds, "measured in the pairs counted before"))
                continue
            loaded = loaded or load_scene(job.scene, **job.settings.sequence.reading)
            settings, frames = _timed(loaded, job.settings)
            every = len(sampled_pairs(frames, job.settings).positions)
            pairs = every if counted is None else counted.pairs
            drawn = len(frame_schedule(frames, job.settings)) / max(every, 1)  # frames of a pair
            window = settings.replace(frames=_middle(frames), pairs="all")
            if raster is None:
                raster = _slowest(loaded, window.replace(light="raster", spp=None))
            seconds, reason = raster, "timed in three frames"
            if light != "raster":
                small = _probe_size(window)
                seconds += _samples(loaded, window, small)
                reason = f"timed at {small[0]}x{small[1]} with {PROBES[0]} and {PROBES[1]} samples"
            found.append(Estimate(label, pairs, drawn * seconds, reason))
    return found


def _at_pixels(label: str, pairs: PixelRun) -> list[Estimate]:
    """Of the pairs counted before; else some are counted now, and kept."""
    if pairs.missing and not pairs.seconds:
        pairs.count(pairs.missing[0])
    left = sum(map(len, pairs.missing))
    if not left:
        return []
    return [Estimate(label, left, sum(pairs.seconds) / len(pairs.seconds), "measured in counted pairs")]


@dataclass(frozen=True, slots=True)
class _Counted:
    pairs: int  # that are left
    seconds: float | None  # of a pair, of those that are counted


def _counted(store: Store, job: Job) -> _Counted | None:
    """None before the job's head is known."""
    head = store.load(head_key(job.id))
    if head is None:
        return None
    reports, pairs = stored_pairs(store, job.id, head)
    left = len([p for p in job_positions(resolved_job(job, head), head) if p not in pairs])
    done = sum(len(report["positions"]) for report in reports)
    spent = sum(report["provenance"]["seconds"] for report in reports)
    return _Counted(left, spent / done if done else None)


def _timed(scene: Scene, settings: Settings) -> tuple[Settings, range]:
    """``settings`` without an exposure to meter, which takes as long as what is timed; and the frames of the run."""
    exposure = settings.lighting.exposure
    if exposure == AUTO:
        settings = settings.replace(exposure=1.0 if scene.exposure is None else scene.exposure)
    return settings, frame_range(scene, camera_of_run(scene, settings.sequence), settings)


def _middle(frames: range) -> tuple[int, int]:
    """Three frames in the middle of the run, or all of a shorter one."""
    start = frames[max(len(frames) // 2 - 1, 0)]
    return start, min(start + 3, frames.stop)


def _slowest(scene: Scene, settings: Settings) -> float:
    """Seconds of the last frame of ``settings``; the first ones compile shaders and fill caches."""
    seconds: list[float] = []
    started = time.perf_counter()
    evaluate_scene(scene, settings, Observers(progress=lambda progress: seconds.append(progress.frame_seconds)))
    return seconds[-1] if seconds else time.perf_counter() - started


def _probe_size(settings: Settings) -> tuple[int, int]:
    width, height = settings.sequence.width, settings.sequence.height
    return max(width // SMALLER, min(width, LEAST[0])), max(height // SMALLER, min(height, LEAST[1]))


def _samples(scene: Scene, settings: Settings, small: tuple[int, int]) -> float:
    """Seconds of a frame for the samples of path-traced light, timed in images of the size ``small``."""
    width, height = settings.sequence.width, settings.sequence.height
    few, more = (_slowest(scene, settings.replace(spp=spp, width=small[0], height=small[1])) for spp in PROBES)
    of_one = max(more - few, 0.0) / (PROBES[1] - PROBES[0]) / (small[0] * small[1])
    return of_one * width * height * settings.lighting.path_samples


def announce(found: list[Estimate], workers: int | None, say: Callable[[str], None]) -> None:
    """Print the estimate, one line per job and the sum."""
    for one in found:
        say(f"{one.label}: {one.pairs} pairs of about {one.seconds:.2g} s, {duration_text(one.total)} ({one.reason})")
    total = sum(one.total for one in found)
    if found:
        several = f" in one process; with {workers} workers about {duration_text(total / workers)}" if workers else ""
        say(f"estimated time: {duration_text(total)}{several}")
