"""Light unit, exposure, environment, samples and pairs of a run, resolved once, before the run is split into parts.

Every entry point calls ``scene.plan_scene``; everything below it sees only concrete values.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack
from taubench_gl.data_files import hashed
from taubench_gl.effects.lighting import Environment, environment_for, environment_of, light_unit_of, unit_divisor
from taubench_gl.effects.path_tracing import traced_sources
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.evaluation.exposure import exposure_of
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.report.labels import GIVEN
from taubench_gl.scene.environment import EnvironmentImage, read_environment
from taubench_gl.scene.model import Scene
from taubench_gl.settings import AUTO, PREVIEWED, Settings

Array = np.ndarray

MOST_FRAMES = 145
"""Frames that ``auto`` draws at most: the paper's animations have 6 s at 24 fps."""

SAMPLE_BUDGET = 1 << 23
"""Samples of path-traced light that ``auto`` takes at most in a run: about half a minute of two CPU cores."""

LEAST_PAIRS = 4
"""Pairs that ``auto`` evaluates at least, whatever their light costs."""

MAX_LIGHT = 1e30
"""Most radiance or intensity times exposure: sums over lights and the inverse square of a distance stay in float32."""


class LightPlan(enum.Enum):
    """How the light columns of a run are measured."""

    PREVIEW = "images of the preview, whose light is approximate"
    FIXED = "images of the raster method, of a fixed number of samples per pixel, or of files"
    SAMPLED = "path-traced at random pixels, with intervals; images show the preview"
    DECIDED = "path-traced at every pixel, with as many samples as each needs; images show the preview"


def light_plan(settings: Settings, sampled: bool) -> LightPlan:
    """How light columns are measured; ``sampled``: at single pixels where ``settings`` allow it, else by images."""
    lighting = settings.lighting
    if sampled and settings.metrics.decidable:
        if lighting.light == AUTO:
            return LightPlan.SAMPLED
        if lighting.decides:
            return LightPlan.DECIDED
    return LightPlan.PREVIEW if lighting.light in PREVIEWED else LightPlan.FIXED


@dataclass(frozen=True, slots=True)
class ResolvedLighting:
    """Settings with concrete light unit, exposure and environment, and why: a phrase for each of the three."""

    settings: Settings
    reasons: dict[str, str] = field(default_factory=dict)


def resolve_lighting(
    scene: Scene,
    settings: Settings,
    camera: CameraTrack | None = None,
    owner: GpuOwner | None = None,
) -> ResolvedLighting:
    """Choose what ``light_unit``, ``exposure`` and ``environment`` leave open.  Draws only to meter an exposure.

    ``owner``: whose programs the metered frames share.  Settings that are resolved come back unchanged.  Raises
    TaubenchError.
    """
    lighting, reasons = settings.lighting, dict.fromkeys(("light_unit", "exposure", "environment"), GIVEN)
    chosen: dict[str, Any] = {}
    if lighting.light_unit == AUTO:
        unit = light_unit_of(scene)
        chosen["light_unit"], reasons["light_unit"] = unit.value, unit.reason
    if lighting.environment == AUTO:
        choice = environment_for(scene)
        chosen["environment"], reasons["environment"] = choice.value, choice.reason
    settings = settings.replace(**chosen)
    environment = environment_of(settings)
    if environment.kind == "image":
        width, height = read_environment(environment.path).size
        reasons["environment"] += f", an image of {width}x{height} pixels"
    require_float32(scene, settings, environment)  # also before an exposure is metered
    if lighting.exposure == AUTO:
        exposure, reasons["exposure"] = 1.0, "no column depends on light"
        if settings.metrics.lit:
            exposure, reasons["exposure"] = exposure_of(scene, settings, camera, owner)
        settings = settings.replace(exposure=exposure)
        require_float32(scene, settings, environment)
    return ResolvedLighting(settings, reasons)


def require_float32(scene: Scene, settings: Settings, environment: Environment) -> None:
    """Raises SceneError or SettingsError where light times exposure may leave float32, the numbers of the renderer.

    Also for a light that no key animates to such a value, and for one that is hidden.  Checks nothing where no column
    depends on light.  ``settings``: light unit and ``environment`` are resolved; without an exposure, it is 1.
    """
    if not settings.metrics.lit:
        return
    exposure = settings.lighting.exposure
    factor = 1.0 if isinstance(exposure, str) else max(exposure, 1.0)
    hint = f"light times exposure goes up to {MAX_LIGHT:g}"
    if not max(environment.radiance) * factor <= MAX_LIGHT:
        message = f"the environment {settings.lighting.environment} is too bright at exposure {exposure}"
        raise SettingsError(message, hint=hint, setting="environment")
    where, at = str(scene.path or scene.name), f" at exposure {exposure}"
    divisor = unit_divisor(settings.lighting.light_unit)
    keyed: dict[int, dict[str, float]] = {}
    for channel in scene.channels:
        if channel.target == "light" and channel.path in ("intensity", "color"):
            keyed.setdefault(channel.index, {})[channel.path] = float(np.max(np.abs(channel.values), initial=0.0))
    for index, light in enumerate(scene.lights):
        most = {"intensity": light.intensity, "color": max(light.color)}
        brightest = np.prod([max(most[name], keyed.get(index, {}).get(name, 0.0)) for name in most])
        if not brightest / divisor * factor <= MAX_LIGHT:
            raise SceneError(f"light {light.name or index!r} is too bright{at}: {brightest:g}", where=where, hint=hint)
    for index, material in enumerate(scene.materials):
        if not max(material.emissive) * factor <= MAX_LIGHT:
            message = (
                f"the emission of material {material.name or index!r} is too bright{at}: {max(material.emissive):g}"
            )
            raise SceneError(message, where=where, hint=hint)


def environment_image(settings: Settings) -> EnvironmentImage | None:
    """The environment image of resolved settings, read; None if there is none.  Raises SettingsError."""
    environment = environment_of(settings)
    return read_environment(environment.path) if environment.kind == "image" else None


def file_hashes(scene: Scene, settings: Settings) -> dict[str, str | None]:
    """``sha256`` of the scene's files, of an environment image ``environment_sha256``, and of a recorded camera
    ``camera_path_sha256``."""
    image, path = environment_image(settings), settings.sequence.camera_path
    others = {} if image is None else {"environment_sha256": image.sha256}
    others |= {} if path is None else {"camera_path_sha256": hashed(path, SceneError).hexdigest()}
    return {"sha256": scene.sha256, **others}


def files_identity(hashes: Mapping[str, Any]) -> str | None:
    """One text for all of ``file_hashes``; None where there are none: the scene was made in memory."""
    every = (hashes.get(f"{name}sha256") for name in ("", "environment_", "camera_path_"))
    return " ".join(filter(None, every)) or None


def with_samples(settings: Settings) -> Settings:
    """``settings`` with the samples per pixel of path-traced light, if a pixel of the images can have any."""
    lighting = settings.lighting
    return settings if lighting.light == "raster" else settings.replace(spp=lighting.path_samples)


def with_pairs(scene: Scene, settings: Settings, frames: range) -> Settings:
    """``settings``, whose lighting is resolved, with the pairs that ``auto`` stands for.

    All of at most MOST_FRAMES frames, else two from each of H strata.  Where the preview traces paths
    (``traced_sources``), at most SAMPLE_BUDGET samples are taken, but LEAST_PAIRS pairs evaluated.  Methods and pairs
    that the user names are kept.
    """
    if settings.metrics.pairs != AUTO:
        return settings
    most = MOST_FRAMES
    lighting, sequence = settings.lighting, settings.sequence
    if _auto_traces(scene, settings):
        # What the user names (size, samples, seeds) is never changed: the budget limits how many frames are drawn.
        samples = sequence.width * sequence.height * lighting.path_samples * settings.metrics.samples_per_pixel
        most = min(max(SAMPLE_BUDGET // samples, 2 * LEAST_PAIRS), MOST_FRAMES)
    if len(frames) <= most:
        return settings.replace(pairs="all")
    return settings.replace(pairs=f"strata:{most // 4}")  # two pairs of each, and each pair draws two frames


def _auto_traces(scene: Scene, settings: Settings) -> bool:
    """Whether the preview traces paths for a column."""
    return settings.lighting.light in PREVIEWED and settings.metrics.lit and bool(traced_sources(scene, settings))
