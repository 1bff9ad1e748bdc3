"""Which light is path-traced: the sources, the surfaces that emit, and what a pixel costs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.effects.lighting import counts_as_light, emits, environment_of
from taubench_gl.scene.model import Material, Note, Scene
from taubench_gl.scene.notes import listed
from taubench_gl.settings import PREVIEWED, LightingSettings, Settings

SOURCES = ("punctual", "emitters", "environment")

REPLACED = {
    "path_traced": frozenset({"shadows", "light_culling", "sky"}),
    "environment_light": frozenset({"sky"}),
}
"""Effect that traces paths -> effects of the raster method that it replaces."""


def emitters(scene: Scene, settings: Settings) -> frozenset[int]:
    """Drawn materials whose surfaces are path-traced lights; without path tracing, those that light nothing.

    With ``path-traced`` all that emit, else those that count as light.
    """
    used = {p.material for _, p in scene.drawn()} - {-1}
    is_light = emits if settings.lighting.light == "path-traced" else counts_as_light
    return frozenset(m for m in used if is_light(scene.materials[m]))


def emissive_surfaces(scene: Scene, settings: Settings) -> int:
    """Number of drawn primitives with a material of ``emitters``."""
    found = emitters(scene, settings)
    return sum(p.material in found for _, p in scene.drawn())


def traced_sources(scene: Scene, settings: Settings) -> frozenset[str]:
    """Which ``SOURCES`` of light the scene has and the method of resolved ``settings`` traces paths for.

    The preview has raster light of an environment beside punctual lights: unoccluded, without noise, a better control
    of sampled light and faster than few samples.  Alone it would have no indirect light, so then it is path-traced.
    """
    method, environment = settings.lighting.light, environment_of(settings)
    if method == "raster":
        return frozenset()
    whole, punctual = method == "path-traced", bool(len(scene.light_nodes) or environment.sun is not None)
    present = {
        "punctual": whole and punctual,
        "emitters": bool(emitters(scene, settings)),
        "environment": environment.shines and (whole or not punctual),
    }
    return frozenset(name for name, there in present.items() if there)


def has_dielectric(material: Material) -> bool:
    """Whether the dielectric lobe of ``material`` has a color, a texture or an index of refraction, or light goes
    through.
    """
    textured = material.specular_texture is not None or material.specular_color_texture is not None
    changed = textured or material.ior != 1.5 or material.specular_color != (1.0, 1.0, 1.0)
    lobe = material.specular > 0.0 and changed
    return not material.unlit and (lobe or transmits(material))


def transmits(material: Material) -> bool:
    """Whether light goes through ``material``; an infinite index of refraction (0) reflects all of it."""
    return not material.unlit and material.transmission > 0.0 and material.ior > 0.0


def absorbs(material: Material) -> bool:
    """Whether light that goes through ``material`` is absorbed on its way inside."""
    dark = material.attenuation_distance < np.inf and min(material.attenuation_color) < 1.0
    return transmits(material) and material.thick and dark


@dataclass(frozen=True, slots=True)
class GlassEffect:
    """An effect of surfaces that path-traced light alone has."""

    needed_by: Callable[[Material], bool]
    one: str  # what one primitive with such a material does
    many: str  # what more primitives do
    absent: str  # reason against the effect, in a scene without such a material


GLASS: dict[str, GlassEffect] = {
    "dielectrics": GlassEffect(
        has_dielectric,
        "primitive has a dielectric lobe of its own",
        "primitives have a dielectric lobe of their own",
        "no primitives have a dielectric lobe of their own",
    ),
    "transmission": GlassEffect(
        transmits, "primitive lets light through", "primitives let light through", "no surface lets light through"
    ),
    "volume": GlassEffect(
        absorbs, "primitive absorbs light inside", "primitives absorb light inside", "no primitives absorb light inside"
    ),
}
"""Effects of surfaces that path-traced light alone has, by name: those of a lobe (``lobes.TABLE``) and others."""


def glass_counts(materials: Iterable[Material]) -> dict[str, int]:
    """Effect of ``GLASS`` -> number of ``materials`` that need it."""
    every = list(materials)
    return {name: sum(map(effect.needed_by, every)) for name, effect in GLASS.items()}


def traced_effects(enabled: Mapping[str, Any] | frozenset[str]) -> frozenset[str]:
    """Effects among ``enabled`` that trace paths."""
    return frozenset({"path_traced", "emitter_light", "environment_light"} & set(enabled))


def cost_text(lighting: LightingSettings) -> str:
    """Samples, bounces and rays of a pixel: each bounce has a ray to a light and a ray to the next surface.

    Bidirectional paths also have one from a light, and one from each vertex but the last to where that ends.
    """
    spp, bounces = lighting.path_samples, lighting.bounces
    paths = f"{spp} {lighting.pattern} sample{'s' * (spp > 1)} of up to {bounces} bounce{'s' * (bounces > 1)}"
    both = lighting.bidirectional and lighting.light == "path-traced"  # other methods trace no punctual lights
    paths += ", bidirectional" * both
    return f"{paths}, up to {(2 + both) * spp * bounces:,} rays a pixel"


def notes(scene: Scene, settings: Settings, enabled: frozenset[str]) -> list[str]:
    """What is path-traced beside the raster method and at what cost, or what the raster method leaves out.

    ``enabled``: effects.  Nothing where no column depends on light.
    """
    surfaces = emissive_surfaces(scene, settings)
    text = f"{surfaces} emissive surface{'s' * (surfaces != 1)}"
    if settings.lighting.light == "raster":
        lights = {"direct", "color"} & enabled
        return [f"{text} light{'s' * (surfaces == 1)} nothing: the light method is raster"] * bool(surfaces and lights)
    parts = {"emitter_light": text, "environment_light": "the environment"}
    named = [part for effect, part in parts.items() if effect in enabled]
    return [f"light of {' and '.join(named)} is path-traced: {cost_text(settings.lighting)}"] if named else []


def left_out(scene: Scene, settings: Settings) -> list[Note]:
    """What raster light leaves out of surfaces that path-traced light has."""
    if settings.lighting.light == "path-traced":
        return []
    used = {n: {p.material for p in scene.primitives(n)} for n in scene.mesh_nodes.tolist()}
    preview = "preview: " if settings.lighting.light in PREVIEWED else ""
    out = []
    for need, what, consequence in _LEFT_OUT:
        materials = sorted(i for i in set().union(*used.values()) if i >= 0 and need(scene.materials[i]))
        if materials:
            objects = sum(not found.isdisjoint(materials) for found in used.values())
            names = listed(scene.materials[i].name or f"number {i}" for i in materials)
            text = (
                f"{preview}{what} is not simulated: {consequence}; {objects} of {len(used)} objects, "
                f"material{'s' * (len(materials) > 1)} {names}; --light path-traced has it"
            )
            out.append(Note(text, kind="glass", count=objects, materials=frozenset(materials)))
    return out


_LEFT_OUT: tuple[tuple[Callable[[Material], bool], str, str], ...] = (
    (transmits, "transmission (KHR_materials_transmission)", "drawn opaque"),
    (absorbs, "absorption (KHR_materials_volume)", "drawn without attenuation inside"),
    (
        lambda m: has_dielectric(m) and not transmits(m),
        "the dielectric lobe (KHR_materials_ior, specular)",
        "drawn with an index of refraction of 1.5 and a white lobe",
    ),
)
