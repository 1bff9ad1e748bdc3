"""Light unit, exposure and environment of a run, resolved once, before the run is split into parts.

Every entry point calls ``resolve_lighting``; everything below it sees only concrete values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser, camera_of_run
from taubench_gl.effects.decide import MANY_LIGHTS
from taubench_gl.effects.lighting import environment_for, environment_of, light_unit_of, own_light
from taubench_gl.evaluation.schedule import frame_range
from taubench_gl.frame.environment import image_of
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import open_gpu
from taubench_gl.metrics.exposure import metered_exposure, rounded, surface_luminance
from taubench_gl.report.labels import GIVEN
from taubench_gl.scene.environment import EnvironmentImage
from taubench_gl.scene.model import Scene
from taubench_gl.settings import AUTO, MAX_EXPOSURE, Settings

Array = np.ndarray

SMALLER = 8
"""Factor by which the image is smaller that is metered without culling."""

LIGHT_COLUMNS = frozenset({"direct", "indirect", "color"})


@dataclass(frozen=True, slots=True)
class ResolvedLighting:
    """``settings``: with concrete light unit, exposure and environment; ``reasons``: why, by setting, phrases."""

    settings: Settings
    reasons: dict[str, str] = field(default_factory=dict)


def resolve_lighting(
    scene: Scene,
    settings: Settings,
    camera: CameraTrack | None = None,
    *,
    frames: range | None = None,
    poser: Poser | None = None,
) -> ResolvedLighting:
    """Choose what ``light_unit``, ``exposure`` and ``environment`` leave open.  Draws only to meter an exposure.

    ``frames``: of the run, metered are its first, middle and last; None: those of ``settings``.  Settings that are
    resolved come back unchanged.  Raises TaubenchError.
    """
    lighting, reasons = settings.lighting, dict.fromkeys(("light_unit", "exposure", "environment"), GIVEN)
    chosen: dict[str, Any] = {}
    if lighting.light_unit == AUTO:
        unit = light_unit_of(scene)
        chosen["light_unit"], reasons["light_unit"] = unit.value, unit.reason
    if lighting.environment == AUTO:
        environment = environment_for(scene)
        chosen["environment"], reasons["environment"] = environment.value, environment.reason
    settings = settings.replace(**chosen)
    if (image := environment_image(settings)) is not None:
        reasons["environment"] += f", an image of {image.size[0]}x{image.size[1]} pixels"
    if lighting.exposure == AUTO:
        exposure, reasons["exposure"] = _exposure(scene, settings, camera, frames, poser)
        settings = settings.replace(exposure=exposure)
    return ResolvedLighting(settings, reasons)


def environment_image(settings: Settings) -> EnvironmentImage | None:
    """The environment image of resolved settings, read; None if there is none.  Raises SettingsError."""
    environment = environment_of(settings)
    return image_of(environment) if environment.kind == "image" else None


def file_hashes(scene: Scene, settings: Settings) -> dict[str, str | None]:
    """``sha256`` of the scene's files and, where there is an environment image, ``environment_sha256``."""
    image = environment_image(settings)
    return {"sha256": scene.sha256, **({} if image is None else {"environment_sha256": image.sha256})}


def files_identity(hashes: Mapping[str, Any]) -> str | None:
    """One identity of ``file_hashes``; that of the scene alone where there is no environment image."""
    return " ".join(filter(None, (hashes["sha256"], hashes.get("environment_sha256")))) or None


def _exposure(
    scene: Scene, settings: Settings, camera: CameraTrack | None, frames: range | None, poser: Poser | None
) -> tuple[float, str]:
    """The exposure that ``auto`` stands for, and why."""
    if not LIGHT_COLUMNS & set(settings.metrics.columns):
        return 1.0, "no column depends on light"
    if settings.lighting.light_unit == "watt" and len(scene.light_nodes):
        return 1.0, "the light unit is watt"
    if own_light(scene) is None and settings.lighting.environment == "none":
        return 1.0, "the scene has no light"
    camera = camera or camera_of_run(scene, settings.sequence)
    frames = frame_range(scene, camera, settings) if frames is None else frames
    metered = metered_frames(frames)
    exposed = _culled(scene, settings, camera, metered[0], poser)
    factor = metered_exposure(direct_luminance(scene, exposed, camera, metered, poser))
    numbers = " and ".join([", ".join(map(str, metered[:-1])), str(metered[-1])]) if len(metered) > 1 else metered[0]
    if factor is None:
        return 1.0, f"no surface reflects light in frame{'s' * (len(metered) > 1)} {numbers}"
    factor = min(max(rounded(factor), 1.0 / MAX_EXPOSURE), MAX_EXPOSURE)
    return factor, f"metered in frame{'s' * (len(metered) > 1)} {numbers}"


def _culled(scene: Scene, settings: Settings, camera: CameraTrack, frame: int, poser: Poser | None) -> Settings:
    """``settings`` with which to meter: many lights are culled at the exposure of a small image without culling.

    The culling is thus the same whatever the scale of the lights.
    """
    exact = settings.replace(exposure=1.0, light_error=0.0)
    if len(scene.light_nodes) <= MANY_LIGHTS:
        return exact
    width, height = (max(side // SMALLER, 1) for side in (settings.sequence.width, settings.sequence.height))
    first = metered_exposure(
        direct_luminance(scene, exact.replace(width=width, height=height), camera, (frame,), poser)
    )
    return exact if first is None else settings.replace(exposure=min(max(first, 1.0 / MAX_EXPOSURE), MAX_EXPOSURE))


def metered_frames(frames: range) -> tuple[int, ...]:
    """First, middle and last of ``frames``, ascending, without duplicates."""
    return tuple(sorted({frames[0], frames[len(frames) // 2], frames[-1]}))


def direct_luminance(
    scene: Scene, settings: Settings, camera: CameraTrack, frames: tuple[int, ...], poser: Poser | None = None
) -> list[Array]:
    """Luminance of direct light, without exposure, of the surface pixels of each frame: (n,) float64.

    By the raster method, at the size of ``settings``, which are resolved; exposure and light error cull lights.  Empty
    where the scene has no direct light.
    """
    metering = settings.replace(columns=("direct",), samples_per_pixel=1, storage="float", pairs="all")
    with open_gpu(settings.device.backend, settings.device.device) as gpu:
        source = RasterSource(gpu, scene, camera, metering, poser=poser)
        try:
            if "direct" in source.unmeasured:
                return []
            out = []
            for frame in frames:
                source.advance(frame)
                out.append(surface_luminance(source.read("direct"), source.read("position")))
            gpu.check("metering")
            return out
        finally:
            source.release()
