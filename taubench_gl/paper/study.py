"""The jobs of the paper's tables as one batch, and their results: what is finished is kept, whatever ends the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.batch.merge import job_folder
from taubench_gl.batch.spec import BatchSpec, Job, job_id
from taubench_gl.batch.study import batch_store, run_batch
from taubench_gl.errors import SettingsError, TaubenchError
from taubench_gl.paper.pixels import PixelRun
from taubench_gl.paper.scenes import Found, PaperScene
from taubench_gl.run import Run, load_run
from taubench_gl.settings import PAPER_SIZE, Settings
from taubench_gl.study.progress import Listener

RUNS = "runs"
"""The batch, in the folder of the results."""

PIXELS = "pixels"
"""The pairs at random pixels, there too."""

LIGHTS = ("raster", "path-traced")
CAMERA = "camera"
QUICK_PAIRS = "strata:4"
ONE_PAIR = "every:9999999"
"""A sample of one pair: the counts and the camera's activity need no image, and are of all frames."""

CAMERA_SIZE = (160, 90)
UNIT_SECONDS = 60.0
"""Most seconds of a unit of work, as far as pairs can be split: what a killed run loses."""


@dataclass(frozen=True, slots=True)
class PaperOptions:
    """``lights``: of LIGHTS; ``spp``: of path-traced light, None: the default; ``quick``: QUICK_PAIRS of the pairs.

    ``pixels``: random ones of each pair with path-traced light; None: whole images.
    """

    size: tuple[int, int] = PAPER_SIZE
    lights: tuple[str, ...] = ("raster",)
    spp: int | None = None
    lobes: tuple[str, ...] = ()
    quick: bool = False
    pixels: int | None = None

    def __post_init__(self) -> None:
        for light in self.lights:
            if light not in LIGHTS:
                raise SettingsError(f"no light is named {light!r:.60}", hint=f"choose from {', '.join(LIGHTS)}")
        if not self.lights:
            raise SettingsError("no light is given", hint=f"choose from {', '.join(LIGHTS)}")
        if self.spp is not None and "path-traced" not in self.lights:
            raise SettingsError("samples per pixel are of path-traced light", hint="give --light path-traced")
        if self.pixels is not None:
            if "path-traced" not in self.lights:
                raise SettingsError("random pixels are of path-traced light", hint="give --light path-traced")
            if self.pixels < 2:
                raise SettingsError(
                    f"{self.pixels} random pixels have no interval", hint="give at least 2, such as 256"
                )
            if self.lobes:
                raise SettingsError("lobes are measured in whole images", hint="leave out --lobe or --pixels")


@dataclass(frozen=True, slots=True)
class SceneJobs:
    """The jobs of one scene: its camera (Tables 1 to 3), and its images (Table 4) by light.

    ``pixels``: of path-traced light, which is then no part of the batch.
    """

    scene: PaperScene
    camera: Job
    images: dict[str, Job]
    pixels: int | None = None

    @property
    def all(self) -> tuple[Job, ...]:
        return (self.camera, *self.images.values())

    @property
    def at_pixels(self) -> Job | None:
        """The job at random pixels."""
        return None if self.pixels is None else self.images["path-traced"]

    @property
    def batch(self) -> tuple[Job, ...]:
        """The jobs of whole images."""
        return tuple(job for job in self.all if job is not self.at_pixels)


@dataclass(slots=True)
class SceneResult:
    """Finished runs of one scene; ``failed``: the others, CAMERA or the light -> why, one line."""

    scene: PaperScene
    camera: Run | None = None
    images: dict[str, Run] = field(default_factory=dict)
    jobs: dict[str, str] = field(default_factory=dict)  # CAMERA or the light -> id of its job
    failed: dict[str, str] = field(default_factory=dict)


def jobs_of(scene: PaperScene, options: PaperOptions) -> SceneJobs:
    """Raises SettingsError for settings that are out of range."""
    width, height = CAMERA_SIZE
    activity = Settings(**scene.camera_settings | {
        "width": width, "height": height, "columns": ("frustum",), "pairs": ONE_PAIR,
    })  # fmt: skip
    width, height = options.size
    images = {}
    for light in options.lights:
        own: dict[str, Any] = {"width": width, "height": height, "light": light}
        own |= {"pairs": QUICK_PAIRS if options.quick else "all"}
        own |= {"spp": options.spp} if light == "path-traced" and options.spp is not None else {}
        of_pixels = options.pixels if light == "path-traced" else None
        images[light] = _job(scene, f"table 4, {light}", Settings(**scene.settings | own), options.lobes, of_pixels)
    return SceneJobs(scene, _job(scene, "tables 1 to 3", activity), images, options.pixels)


def _job(
    scene: PaperScene, part: str, settings: Settings, lobes: tuple[str, ...] = (), pixels: int | None = None
) -> Job:
    written = f"{scene.name}-{scene.kind}-{'+'.join(lobes)}" + ("" if pixels is None else f"{pixels}-pixels")
    return Job(job_id(written, settings), scene.path, settings, {"part": part}, lobes=lobes)


def spec_of(jobs: list[SceneJobs]) -> BatchSpec:
    return BatchSpec("paper", tuple(job for scene in jobs for job in scene.batch))


def run_jobs(jobs: list[SceneJobs], out: Path, seconds: float | None, **how: Any) -> dict[str, str]:
    """Run what is not finished in the batch of ``out``.  -> job -> why it failed.  Raises TaubenchError.

    ``seconds``: of the slowest pair, which limits the pairs of a unit; ``how``: arguments of ``run_batch``.
    """
    if how.get("chunk") is None and seconds is not None:
        how["chunk"] = max(1, min(32, int(UNIT_SECONDS / max(seconds, 1e-3))))
    return run_batch(spec_of(jobs), out / RUNS, **how).failed


def run_pixels(jobs: list[SceneJobs], out: Path, listener: Listener) -> tuple[dict[str, Run], dict[str, str]]:
    """Count what is missing of the jobs at random pixels, in this process.  -> job -> run, job -> why it failed."""
    runs: dict[str, Run] = {}
    failed: dict[str, str] = {}
    for scene in jobs:
        job = scene.at_pixels
        if job is None:
            continue
        try:
            pairs = PixelRun(job, scene.pixels, out / PIXELS)
            missing = pairs.missing
            listener.job_known(job.id, job.label, pairs.total - sum(map(len, missing)), pairs.total)
            for part in missing:
                pairs.count(part)
                listener.advanced(job.id, len(part))
            runs[job.id] = pairs.result()
        except TaubenchError as error:
            failed[job.id] = str(error)
            listener.job_failed(job.id, job.label, failed[job.id])
        else:
            listener.job_finished(job.id)
    return runs, failed


def results_of(
    jobs: list[SceneJobs], out: Path, failed: Mapping[str, str], runs: Mapping[str, Run]
) -> list[SceneResult]:
    """The finished runs of ``jobs``: those at random pixels are ``runs``, the others are in the batch of ``out``.

    Raises OutputError for a damaged one.
    """
    store, results = batch_store(out / RUNS), []
    for scene in jobs:
        result = SceneResult(scene.scene)
        for part, job in ((CAMERA, scene.camera), *scene.images.items()):
            result.jobs[part] = job.id
            if job.id in failed:
                result.failed[part] = failed[job.id]
                continue
            run = runs[job.id] if job.id in runs else load_run(job_folder(store, job.id))
            if part == CAMERA:
                result.camera = run
            else:
                result.images[part] = run
        results.append(result)
    return results


def plan(found: Found, options: PaperOptions) -> list[SceneJobs]:
    return [jobs_of(scene, options) for scene in found.scenes]
