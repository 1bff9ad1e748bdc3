"""The paper's tables as a preset of a batch: its jobs, and their runs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.batch.merge import job_folder
from taubench_gl.batch.spec import BatchSpec, Job, job_id
from taubench_gl.batch.study import batch_store, run_batch
from taubench_gl.option_groups import PaperOptions
from taubench_gl.paper.scenes import RENDER_FPS, PaperScene
from taubench_gl.run import Run, load_run
from taubench_gl.settings import Settings

RUNS = "runs"
"""The batch, in the folder of the results."""

CAMERA = "camera"
QUICK_PAIRS = "strata:4"
ONE_PAIR = "every:9999999"
"""A sample of one pair: the counts and the camera's activity need no image, and are of all frames."""

CAMERA_SIZE = (160, 90)
UNIT_SECONDS = 60.0
"""Most seconds of a unit of work, as far as pairs can be split: what a killed run loses."""


@dataclass(frozen=True, slots=True)
class SceneJobs:
    """The jobs of one scene: its camera (Tables 1 to 3), and its images (Table 4) by ``image_name``."""

    scene: PaperScene
    camera: Job
    images: dict[str, Job]

    @property
    def all(self) -> tuple[Job, ...]:
        return (self.camera, *self.images.values())


@dataclass(slots=True)
class SceneResult:
    """Finished runs of one scene; ``failed``: the others, CAMERA or the light -> why, one line."""

    scene: PaperScene
    camera: Run | None = None
    images: dict[str, Run] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)


def image_name(light: str, fps: float) -> str:
    """Of images: the light, with the rate where it is not the paper's."""
    return light if fps == RENDER_FPS else f"{light}, {fps:g} fps"


def plan(scenes: Sequence[PaperScene], options: PaperOptions) -> list[SceneJobs]:
    """The jobs of every scene.  Raises SettingsError for settings that are out of range."""
    width, height = options.size
    jobs = []
    for scene in scenes:
        activity = {"width": CAMERA_SIZE[0], "height": CAMERA_SIZE[1], "columns": ("frustum",), "pairs": ONE_PAIR}
        camera = _job(scene, "tables 1 to 3", scene.camera_settings | activity)
        images = {}
        for light, fps in itertools.product(options.lights, options.fps):
            own: dict[str, Any] = {"width": width, "height": height, "light": light, "fps": fps}
            own |= {"pairs": QUICK_PAIRS if options.quick else "all"}
            traced = light == "path-traced"
            own |= {"spp": options.spp} if traced and options.spp is not None else {}
            name = image_name(light, fps)
            images[name] = _job(scene, f"table 4, {name}", scene.settings | own, options.lobes)
        jobs.append(SceneJobs(scene, camera, images))
    return jobs


def _job(scene: PaperScene, part: str, settings: dict[str, Any], lobes: tuple[str, ...] = ()) -> Job:
    checked = Settings(**settings)
    # Lobes are no settings: without them here, two jobs would share an id and a folder.
    return Job(
        job_id(f"{scene.name}-{scene.kind}-{'+'.join(lobes)}", checked),
        scene.path,
        checked,
        {"part": part},
        lobes=lobes,
    )


def run_jobs(jobs: Sequence[SceneJobs], out: Path, seconds: float | None, **how: Any) -> list[SceneResult]:
    """Run what is not finished in the batch of ``out``.  Raises TaubenchError.

    ``seconds``: of the slowest pair, which limits the pairs of a unit; ``how``: arguments of ``run_batch``.
    """
    if how.get("chunk") is None and seconds is not None:
        how["chunk"] = max(1, min(32, int(UNIT_SECONDS / max(seconds, 1e-3))))
    spec = BatchSpec("paper", tuple(job for scene in jobs for job in scene.all))
    failed = run_batch(spec, out / RUNS, **how).failed
    store, results = batch_store(out / RUNS), []
    for scene in jobs:
        result = SceneResult(scene.scene)
        for part, job in ((CAMERA, scene.camera), *scene.images.items()):
            if job.id in failed:
                result.failed[part] = failed[job.id]
            elif part == CAMERA:
                result.camera = load_run(job_folder(store, job.id))
            else:
                result.images[part] = load_run(job_folder(store, job.id))
        results.append(result)
    return results
