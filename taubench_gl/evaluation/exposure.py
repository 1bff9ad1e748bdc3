"""Exposure of a scene: one number for scene, camera, light unit and environment, whatever a run measures of them.

Image size, frames, frame rate, columns, light method and seed of a run have no influence, so that runs can be compared.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import logging
import math
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, FileCamera, OrbitCamera, RecordedCamera, camera_of_run, is_still
from taubench_gl.animation.jitter import radical_inverse
from taubench_gl.conventions import DEFINITIONS
from taubench_gl.data_files import read_json
from taubench_gl.effects.lighting import environment_of, own_light
from taubench_gl.errors import OutputError
from taubench_gl.evaluation.owner import GpuOwner, opened_gpu
from taubench_gl.evaluation.schedule import duration_of
from taubench_gl.frame.environment import image_of
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.metrics.exposure import metered_exposure, rounded
from taubench_gl.outputs import write_atomically
from taubench_gl.paths import cache_folder
from taubench_gl.scene.model import Scene
from taubench_gl.settings import MAX_EXPOSURE, Settings
from taubench_gl.stage_log import lasting, progressed

log = logging.getLogger(__name__)

METERED_FRAMES = 9
"""Number of metered frames, evenly spread over the whole animation of scene and camera; one where both are still."""

METERED_SIZE, METERED_PIXELS = (256, 144), 16384
"""Width and height of the metered frames, and the surface pixels that are traced in all of them together, if there are
as many.  A quarter of them leaves errors of 5 % where the brightest twentieth of the pixels decides."""

TRACED = {"light": "path-traced", "bounces": 1, "spp": 64, "pattern": "independent", "seed": 0}
"""Settings of the direct light of a metered pixel: 64 samples; punctual lights exactly, up to 1,024 around a point.

With 16 samples the logarithm of their noise makes exposures up to 30 % wrong, with 64 up to 2 %.
"""

FOLDER = "exposures"
"""Folder of the cache with one file for each exposure."""


def exposure_of(
    scene: Scene, settings: Settings, camera: CameraTrack | None = None, owner: GpuOwner | None = None
) -> tuple[float, str]:
    """The exposure that ``auto`` stands for, and why, as a phrase.

    ``settings``: light unit and environment are resolved; besides them, only what selects the camera and the machine
    counts.  ``camera``: None: that of ``settings``; ``owner``: whose programs metered frames share.  Raises
    TaubenchError.
    """
    has_light = own_light(scene) is not None
    if settings.lighting.light_unit == "watt" and has_light:
        return 1.0, "the light unit is watt"
    if scene.exposure is not None:
        return scene.exposure, "recorded in the file"
    if not has_light and settings.lighting.environment == "none":
        return 1.0, "the scene has no light"
    metered, where = meter(scene, settings, camera, owner)
    return (1.0, f"no surface reflects light {where}") if metered is None else (metered, f"metered {where}")


def meter(
    scene: Scene, settings: Settings, camera: CameraTrack | None = None, owner: GpuOwner | None = None
) -> tuple[float | None, str]:
    """The metered exposure, None if no surface reflects light, and in which frames.  Arguments of ``exposure_of``."""
    metering = _metering(settings)
    camera = _camera(scene, metering, camera)
    times = _times(scene, camera)
    where = f"in {len(times)} frames of the whole animation" if len(times) > 1 else "in the only frame"
    file = _cache_file(scene, metering, camera)
    exposure = None if file is None else _cached(file)
    if exposure is None:
        exposure = _metered(AnimatedScene(scene, camera), metering, times, owner)
        if exposure is not None and file is not None:
            with suppress(OutputError, OSError):  # a cache that cannot be written costs time, not the result
                write_atomically(file, json.dumps(exposure), parents=True)
    return exposure, where


def _metering(settings: Settings) -> Settings:
    """Settings of the metered frames: defaults, and the light unit, environment, camera and machine of ``settings``."""
    lighting, sequence, device = settings.lighting, settings.sequence, settings.device
    return Settings(
        size=METERED_SIZE, exposure=1.0, columns=("direct",), light_unit=lighting.light_unit,
        environment=lighting.environment, camera=sequence.camera, backend=device.backend, device=device.device,
        **TRACED,
    )  # fmt: skip


def _camera(scene: Scene, metering: Settings, camera: CameraTrack | None) -> CameraTrack:
    """The camera of the metered frames: an orbit frames its subject in their size."""
    if camera is None:
        return camera_of_run(scene, metering.sequence)
    if isinstance(camera, OrbitCamera):
        return OrbitCamera(scene, size=(metering.sequence.width, metering.sequence.height), reason=camera.reason)
    return camera


def _times(scene: Scene, camera: CameraTrack) -> np.ndarray:
    """Seconds of the metered frames, (n,) float64."""
    duration = duration_of(scene, camera)
    if duration == 0.0 or (isinstance(camera, FileCamera) and is_still(scene, [camera.node])):
        return np.zeros(1)
    return np.linspace(0.0, duration, METERED_FRAMES)


def _metered(animated: AnimatedScene, metering: Settings, times: np.ndarray, owner: GpuOwner | None) -> float | None:
    """The exposure of direct light at ``times``; None if there is none."""
    log.info("metering the exposure in %d frame%s", len(times), "s" * (len(times) > 1))
    if len(times) > 1:
        metering = metering.replace(fps=1.0 / times[1])
    with opened_gpu(metering, owner) as opened:
        source = opened.open_source(animated, metering, pixel_list=True)
        if "direct" in source.unmeasured:
            return None
        frames = []
        with lasting(log, "metering the exposure"):
            for frame in range(len(times)):
                frames.append(surface_light(source, frame, METERED_PIXELS // len(times)))
                progressed((frame + 1) / len(times))
        opened.gpu.check("metering")
    radiance, weights = (np.concatenate(each) for each in zip(*frames, strict=True))
    exposure = metered_exposure(radiance, weights)
    return None if exposure is None else min(max(rounded(exposure), 1.0 / MAX_EXPOSURE), MAX_EXPOSURE)


@lru_cache
def pixel_order() -> np.ndarray:
    """Columns and rows of all pixels of a metered frame, (n, 2) int64, in the order of a Halton sequence."""
    index = np.arange(8 * math.prod(METERED_SIZE))  # which meets nearly every pixel
    columns, rows = (
        (radical_inverse(index, base) * side).astype(np.int64) for base, side in zip((2, 3), METERED_SIZE, strict=True)
    )
    _, first = np.unique(rows * METERED_SIZE[0] + columns, return_index=True)
    return np.stack([columns, rows], axis=1)[np.sort(first)]


def surface_light(source: RasterSource, frame: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Direct light of ``most`` surface pixels of ``frame``, or of all: (n, 3) float64, linear radiance.

    Also how many surface pixels each stands for, (n,) float64, so that frames count by the surfaces that they show.
    """
    source.draw(frame)
    at = pixel_order()
    at = at[source.read("position")[at[:, 1], at[:, 0], 3] > 0.0]
    if not len(at):
        return np.zeros((0, 3)), np.zeros(0)
    weight, at = len(at) / min(len(at), most), at[:most]
    direct = [k for k, lobe in enumerate(source.listed_lobes) if lobe.startswith("direct")]

    def traced(samples: range) -> np.ndarray:
        light = source.listed_light(frame, at, at, samples, drawn=samples.start == 0)
        return light[:, :, direct].astype(np.float64).sum(axis=2)

    light = traced(range(2))
    if not np.array_equal(light[:, 0], light[:, 1]):  # else every light has a shadow ray, and samples have no noise
        light = np.concatenate([light, traced(range(2, TRACED["spp"]))], axis=1)
    radiance = light.mean(axis=1)
    finite = np.all(np.isfinite(radiance), axis=1)
    return radiance[finite], np.full(np.count_nonzero(finite), weight)


def _cache_file(scene: Scene, metering: Settings, camera: CameraTrack) -> Path | None:
    """The cache's file of an exposure, named by a hash of all that it depends on.

    None for a scene made in memory and for a camera that only the caller knows.
    """
    if scene.sha256 is None or not isinstance(camera, FileCamera | OrbitCamera | RecordedCamera):
        return None
    environment = environment_of(metering)
    image = image_of(environment).sha256 if environment.kind == "image" else None
    place = camera.node if isinstance(camera, FileCamera) else camera.name
    if isinstance(camera, RecordedCamera):
        place = camera.path, *camera.placed(), camera.node, camera.base
    digest = hashlib.sha256()
    # The files, and what a selection of scene and animations, a repair or a caller makes of them.
    selected = scene.nodes, scene.materials, scene.skins, scene.cameras, scene.lights, scene.channels
    metered = metering.sequence, metering.metrics, metering.lighting, image
    _feed(digest, (scene.sha256, selected, place, metered, DEFINITIONS))
    return cache_folder() / FOLDER / f"{digest.hexdigest()[:24]}.json"


def _feed(digest: Any, value: Any) -> None:
    """Add ``value``, of records, tuples, mappings, arrays and plain values, to a hash."""
    if dataclasses.is_dataclass(value):
        value = tuple(getattr(value, field.name) for field in dataclasses.fields(value))
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        _feed(digest, tuple(value.items()))
    elif isinstance(value, tuple):
        digest.update(f"({len(value)}".encode())
        for item in value:
            _feed(digest, item)
    else:
        digest.update(repr(value).encode() + b"\0")


def _cached(file: Path) -> float | None:
    """The exposure of an earlier run; None if there is none that can be read."""
    with suppress(OutputError):
        exposure = read_json(file, float)
        return exposure if 1.0 / MAX_EXPOSURE <= exposure <= MAX_EXPOSURE else None
    return None
