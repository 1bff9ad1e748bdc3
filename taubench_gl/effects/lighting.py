"""Light unit and environment of a run: what ``auto`` stands for in a scene, and what the lighting passes read.

glTF gives point and spot lights in candela and directional lights in lux (KHR_lights_punctual).  Blender's exporter
multiplies watts by 683 lm/W since it has lighting modes (glTF-Blender-IO pull request 1760; docs/light.md), so the
radiance of such a file in W/(sr m2), as Cycles renders it, needs the intensities divided by 683.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from taubench_gl.errors import printable
from taubench_gl.scene.gltf.blender import LUMENS_PER_WATT, exporter_version
from taubench_gl.scene.model import Material, Scene
from taubench_gl.settings import AUTO, FIXED_LIGHTING, Settings

WATT_SINCE = (3, 4)
"""First version of Blender's glTF exporter that writes 683 lm for each watt: 3.4.40, released with Blender 3.4."""


@dataclass(frozen=True, slots=True)
class Sun:
    """A directional light of the environment, which is no light of the scene.

    ``direction``: unit, where it shines, world; ``irradiance``: of a surface that faces it, linear RGB.
    """

    direction: tuple[float, float, float]
    irradiance: tuple[float, float, float]


DEFAULT_RADIANCE = (0.4, 0.4, 0.4)
"""Radiance of the default environment's uniform sky, linear RGB; the exposure of a file that gets it is metered."""

DEFAULT_SUN = Sun((-0.4, -0.8, -math.sqrt(0.2)), (2.0 * math.pi,) * 3)
"""Sun of the default environment, 53 degrees above the horizon, 42 degrees from +Z (where glTF models face) to +X.  A
white diffuse surface that faces it reflects five times the radiance of the sky, about the ratio of a clear day."""


@dataclass(frozen=True, slots=True)
class Environment:
    """Light from all around.  ``radiance``: of the uniform sky, linear RGB; black for ``none`` and ``image``."""

    kind: str  # none | default | uniform | image
    radiance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    path: str | None = None  # of the image, equirectangular
    reason: str = ""
    sun: Sun | None = None

    @property
    def shines(self) -> bool:
        return self.kind == "image" or any(self.radiance)


@dataclass(frozen=True, slots=True)
class Choice:
    """A resolved value of a setting, and why it was chosen, as a phrase."""

    value: Any
    reason: str


def environment_of(settings: Settings) -> Environment:
    """The environment of resolved settings.  Raises ValueError if ``environment`` is ``auto``."""
    value = settings.lighting.environment
    if value == AUTO:
        raise ValueError("environment is auto: call evaluation.resolve_lighting first")
    if value == "none":
        return Environment("none", reason="the environment is none")
    if value == "default":
        return Environment("default", DEFAULT_RADIANCE, reason="the default environment", sun=DEFAULT_SUN)
    if isinstance(value, str):
        return Environment("image", path=value, reason=f"an image, {value}")
    return Environment("uniform", (value[0], value[1], value[2]), reason="a uniform sky is set")


def light_unit_in(settings: Settings) -> str:
    """Light unit of resolved settings, watt or candela.  Raises ValueError for ``auto``."""
    unit = settings.lighting.light_unit
    if unit == AUTO:
        raise ValueError("light unit is auto: call evaluation.resolve_lighting first")
    return unit


def unit_divisor(unit: str) -> float:
    """Divisor of punctual light intensities: 683 for watt, 1 for candela."""
    return LUMENS_PER_WATT if unit == "watt" else 1.0


def light_unit_of(scene: Scene) -> Choice:
    """The light unit that ``auto`` stands for in ``scene``, and why."""
    version = exporter_version(scene.generator)
    if version is not None and version >= WATT_SINCE:
        return Choice("watt", f"written by {_named(scene)}: {LUMENS_PER_WATT:g} lm for each watt")
    if version is not None:
        return Choice("candela", f"written by {_named(scene)}, older than {WATT_SINCE[0]}.{WATT_SINCE[1]}")
    return Choice("candela", f"written by {_named(scene)}" if scene.generator else "the file names no generator")


def _named(scene: Scene) -> str:
    return " ".join(printable(scene.generator).split())[:60]


def emits(material: Material) -> bool:
    """Whether surfaces of ``material`` emit light; unlit ones show their base color and light nothing."""
    return any(c > 0.0 for c in material.emissive) and not material.unlit


def counts_as_light(material: Material) -> bool:
    """Whether KHR_materials_emissive_strength is above 1, so that the surface is a light, not only bright in the
    image.
    """
    return emits(material) and material.emissive_strength > 1


def own_light(scene: Scene) -> str | None:
    """What light the file has, as a phrase; None if it has none.

    A file has light if it has a punctual or image-based light, an environment, or a drawn material with
    KHR_materials_emissive_strength above 1.
    """
    lights = len(scene.light_nodes)
    if lights:
        return f"the file has {lights} light{'s' if lights > 1 else ''}"
    if scene.environment is not None:
        return "the file has an environment"
    if scene.image_based_light:
        return "the file has an image-based light, which is not simulated"
    if any(counts_as_light(scene.materials[p.material]) for _, p in scene.drawn() if p.material >= 0):
        return "the file has emissive materials of strength above 1"
    return None


def environment_for(scene: Scene) -> Choice:
    """The environment that ``auto`` stands for in ``scene``, and why."""
    if scene.environment is not None:
        return Choice(scene.environment, "of the file")
    light = own_light(scene)
    return Choice("default", "the file has no light") if light is None else Choice("none", light)


def as_rendered(settings: Settings) -> Settings:
    """``settings`` for path-traced files, where ``auto`` stands for: exposure 1, no environment, unit as rendered, all
    pairs."""
    fixed = FIXED_LIGHTING | {"pairs": "all"}
    return settings.replace(**{name: value for name, value in fixed.items() if settings.get(name) == AUTO})


def without_auto(scene: Scene, settings: Settings) -> Settings:
    """``settings`` with light unit and environment chosen for ``scene``; ``exposure`` may still be ``auto``."""
    chosen = {}
    if settings.lighting.light_unit == AUTO:
        chosen["light_unit"] = light_unit_of(scene).value
    if settings.lighting.environment == AUTO:
        chosen["environment"] = environment_for(scene).value
    return settings.replace(**chosen)
