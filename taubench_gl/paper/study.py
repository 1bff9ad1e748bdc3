"""The paper's tables as a preset of a batch: its jobs, and their runs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.batch.merge import job_folder
from taubench_gl.batch.spec import BatchSpec, Job, job_id
from taubench_gl.batch.study import MIN_CHUNK_PAIRS, batch_store, run_batch
from taubench_gl.option_groups import PaperOptions
from taubench_gl.paper.scenes import RENDER_FPS, PaperScene
from taubench_gl.run import Run, load_run
from taubench_gl.settings import Settings
from taubench_gl.study.progress import Listener

RUNS = "runs"
"""The batch, in the folder of the results."""

CAMERA = "camera"
QUICK_PAIRS = "strata:4"
ONE_PAIR = "every:9999999"
"""A sample of one pair: the counts and the camera's activity need no image, and are of all frames."""

CAMERA_SIZE = (160, 90)


@dataclass(frozen=True, slots=True)
class SceneJobs:
    """The jobs of one scene: its camera (Tables 1 to 3), and its images (Table 4) by ``image_name``."""

    scene: PaperScene
    camera: Job
    images: dict[str, Job]

    @property
    def parts(self) -> dict[str, Job]:
        """All jobs of the scene: CAMERA, then its images."""
        return {CAMERA: self.camera, **self.images}


@dataclass(slots=True)
class SceneResult:
    """The finished runs of one scene; ``failed``: CAMERA or the name of images -> why they failed, one line."""

    scene: PaperScene
    camera: Run | None = None
    images: dict[str, Run] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)


def image_name(light: str, fps: float) -> str:
    """The name of images: their light, and their rate where it is not the paper's."""
    return light if fps == RENDER_FPS else f"{light}, {fps:g} fps"


def plan(scenes: Sequence[PaperScene], options: PaperOptions) -> list[SceneJobs]:
    """The jobs of every scene.  Raises SettingsError for settings that are out of range."""
    size = dict(zip(("width", "height"), options.size, strict=True))
    camera_size = dict(zip(("width", "height"), CAMERA_SIZE, strict=True))
    jobs = []
    for scene in scenes:
        activity = scene.camera_settings | camera_size | {"columns": ("frustum",), "pairs": ONE_PAIR}
        images = {}
        for light, fps in itertools.product(options.lights, options.fps):
            settings = scene.settings | size | {"light": light, "fps": fps}
            settings["pairs"] = QUICK_PAIRS if options.quick else "all"
            if light == "path-traced" and options.spp is not None:
                settings["spp"] = options.spp
            name = image_name(light, fps)
            images[name] = _job(scene, f"table 4, {name}", settings, options.lobes)
        jobs.append(SceneJobs(scene, _job(scene, "tables 1 to 3", activity), images))
    return jobs


def _job(scene: PaperScene, part: str, settings: dict[str, Any], lobes: tuple[str, ...] = ()) -> Job:
    checked = Settings(**settings)
    # Lobes are no settings: without them here, two jobs would share an id and a folder.
    written = f"{scene.name}-{scene.kind}-{'+'.join(lobes)}"
    return Job(job_id(written, checked), scene.path, checked, {"part": part}, lobes=lobes)


def run_jobs(
    jobs: Sequence[SceneJobs],
    out: Path,
    *,
    workers: int = 0,
    chunk: int | None = None,
    listener: Listener | None = None,
) -> list[SceneResult]:
    """Run what is not finished in the batch of ``out``.  Raises TaubenchError.

    ``workers``, ``chunk``: as of ``run_batch``; path-traced images have few pairs in a unit by default.
    """
    if chunk is None and any(
        job.settings.lighting.light == "path-traced" for scene in jobs for job in scene.images.values()
    ):
        chunk = MIN_CHUNK_PAIRS  # a pair takes minutes, and a killed run loses its unit
    spec = BatchSpec("paper", tuple(job for scene in jobs for job in scene.parts.values()))
    failed = run_batch(spec, out / RUNS, workers=workers, chunk=chunk, listener=listener).failed
    store, results = batch_store(out / RUNS), []
    for scene in jobs:
        done = {part: load_run(job_folder(store, j.id)) for part, j in scene.parts.items() if j.id not in failed}
        why = {part: failed[job.id] for part, job in scene.parts.items() if job.id in failed}
        results.append(SceneResult(scene.scene, done.pop(CAMERA, None), done, why))
    return results
