"""Renders light_transport_scenes.py with Cycles and stores what the tests compare, for tools/cycles_references."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from light_transport import (
    BLOCK,
    BLOCKS_FILE,
    BOUNCES,
    FOLDER,
    FPS,
    FRAMES,
    GLASS,
    GLASS_LOBES,
    GLASS_SEEDS,
    LOBES,
    SCENES_FILE,
    SEEDS,
    SIZE,
    references,
)
from light_transport_scenes import SAMPLES, SCENES, make
from references.significance import Estimate, block_means

from taubench_gl.animation import CameraTrack, choose_camera
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.blender.job import FRAME_NAME, Quality, make_job, write_resampled
from taubench_gl.pathtraced.blender.process import blender_python, require_blender, run_script
from taubench_gl.pathtraced.cameras import CAMERA_FILE, camera_file_text
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene


def quality_of(name: str, path: Path, samples: int | None = None) -> Quality:
    """Cycles as the path tracer renders: pixel centers, no clamping, light in watts.

    Cycles counts the bounces after the first: at 11, its longest path scatters 12 times, as ours.
    """
    environment = SCENES[name].environment
    sky = environment if isinstance(environment, tuple) else (0.0, 0.0, 0.0)
    image = str(path.with_suffix(".exr")) if environment == "image" else None
    return Quality(
        samples=samples or SAMPLES.get(name, 128),
        bounces=BOUNCES - 1,
        seed_per_frame=False,
        crisp=True,
        sky=sky,
        image=image,
        light_unit="watt",
    )


def render_seeds(
    scene: Scene, camera: CameraTrack, out: Path, seeds: range, quality: Quality, python: str | None = None
) -> dict[tuple[int, int], float]:
    """Render FRAMES once with each of ``seeds``, in one process: ``out``/seed_NNNN/frame_NNNN.exr, camera.json.

    -> (seed, frame) -> CPU seconds of all threads, with the synchronization of the scene.  The seed of ``quality`` is
    not used.  Raises PathTracedError if bpy is missing or Blender fails.
    """
    job, views, _ = make_job(scene, camera, FRAMES, FPS, SIZE, quality)
    python = python or blender_python()
    require_blender(python)
    folders = [out.resolve() / f"seed_{seed:04d}" for seed in seeds]
    seconds: dict[tuple[int, int], float] = {}

    def on_event(event: dict[str, Any]) -> None:
        if event["event"] == "frame":
            seconds[seeds[len(seconds) // len(FRAMES)], event["frame"]] = event["cpu_seconds"]

    for folder in folders:
        folder.mkdir()
        (folder / CAMERA_FILE).write_text(camera_file_text(views, FPS, SIZE))
    path = write_resampled(scene, range(FRAMES[0] - 1, FRAMES[-1] + 2), FPS, out)
    job |= {"scene": str(path), "folders": [str(folder) for folder in folders], "seeds": list(seeds)}
    failure = run_script(python, "render_script.py", job, out.resolve(), on_event)
    if failure is not None:
        raise PathTracedError(failure)
    return seconds


def render(name: str, python: str | None = None) -> str:
    """Write the references of one scene.  -> a line about it."""
    FOLDER.mkdir(exist_ok=True)
    path = make(name, FOLDER)
    scene = load_scene(path)
    camera = choose_camera(scene)
    quality = quality_of(name, path)
    with tempfile.TemporaryDirectory(prefix="taubench-") as temporary:
        out = Path(temporary)
        seeds = GLASS_SEEDS if name in GLASS else SEEDS
        seconds = render_seeds(scene, camera, out, seeds, quality, python)
        folders = sorted(out.glob("seed_*"))
        target = FOLDER / name
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir()
        shutil.copy(folders[0] / CAMERA_FILE, target / CAMERA_FILE)
        for frame in FRAMES:
            store(folders, frame, target, GLASS_LOBES if name in GLASS else LOBES)
    size = sum(p.stat().st_size for p in [path, *target.iterdir()])
    return f"{name}: {size / 1024:.0f} KiB, {sum(seconds.values()):.1f} CPU s"


def store(folders: list[Path], frame: int, target: Path, kept: tuple[str, ...]) -> None:
    """The mean over the seeds as an EXR; the statistics of blocks of lobes ``kept``, which each frame overwrites."""
    names = sorted({lobe.partition("_")[0] for lobe in kept})
    frames = [PathTracedSequence.open(f"exr:{folder}").read(frame, names) for folder in folders]
    lobes = np.array([[f.lobes[lobe] for lobe in kept] for f in frames], dtype=np.float64)  # seed, lobe, h, w, rgb
    half = len(kept) // 2
    direct, indirect = lobes[:, :half].sum(axis=1), lobes[:, half:].sum(axis=1)
    channels = {"Depth.Z": frames[0].depth}
    for bounce, radiance in (("Direct", direct.mean(axis=0)), ("Indirect", indirect.mean(axis=0))):
        for i, letter in enumerate("RGB"):
            channels[f"{bounce}.{letter}"] = np.ascontiguousarray(radiance[..., i], dtype=np.float16)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(target / (FRAME_NAME % frame)))
    kinds = np.concatenate([lobes, direct[:, None], indirect[:, None]], axis=1)
    blocks = Estimate.of(block_means(kinds, BLOCK))
    values = {"mean": blocks.mean.astype(np.float32), "variance": blocks.variance.astype(np.float32)}
    np.savez_compressed(target / BLOCKS_FILE, **values, count=blocks.count)


def write_index() -> None:
    """List the stored scenes, with what a run of them needs to know."""
    index = {
        name: {"environment": scene.environment, "samples": SAMPLES.get(name, 128)}
        for name, scene in SCENES.items()
        if (FOLDER / f"{name}.glb").is_file()
    }
    (FOLDER / SCENES_FILE).write_text(json.dumps(index, indent=1) + "\n")


def columns(name: str) -> str:
    discard = references()[name].evaluate().summary["discard"]
    return ", ".join(f"{column} {discard[column]['mean_percent']:.2f} %" for column in ("direct", "indirect"))
