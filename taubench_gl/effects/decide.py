"""Which effects a scene needs, and why.  A disabled effect is not compiled, not allocated and not rendered.

An effect is enabled if the scene contains what it shows *and* some requested column depends on it.  ``effects="all"``
enables every effect that can be simulated; counts stay the same (tests run both on every scene), only time is lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.animation.pose import is_skinned, moved_nodes
from taubench_gl.effects.lighting import environment_of
from taubench_gl.effects.path_tracing import (
    GLASS,
    REPLACED,
    cost_text,
    emissive_surfaces,
    glass_counts,
    traced_sources,
)
from taubench_gl.features import COLUMNS, LIGHT_FEATURES
from taubench_gl.scene.model import Material, Scene
from taubench_gl.settings import Settings


@dataclass(frozen=True, slots=True)
class Effect:
    """A part of the renderer that is simulated on demand: whether it is, and why."""

    enabled: bool
    reason: str


def decide(scene: Scene, settings: Settings) -> dict[str, Effect]:
    """Effects by name, for this scene and these settings."""
    effects = _geometry(scene, settings) | _light(scene, settings)
    if settings.lighting.effects == "all":
        return force(effects, FORCEABLE, "forced on by --effects all")
    return effects


def force(effects: dict[str, Effect], names: Iterable[str], why: str = "forced on") -> dict[str, Effect]:
    """``effects`` with ``names`` enabled; the reason is ``why`` and the reason against it.

    What path tracing replaces stays disabled.
    """
    out = dict(effects)
    replaced = {name for by, raster in REPLACED.items() if by in effects and effects[by].enabled for name in raster}
    for name in effects.keys() & set(names) - replaced:
        if not effects[name].enabled:
            out[name] = Effect(True, f"{why} ({effects[name].reason})")
    return out


SWITCHABLE = ("normal_maps", "direct", "glossy", "shadows", "indirect", "color", "emission")
"""Effects that can be disabled and enabled while looking at a scene."""


def disable(
    effects: dict[str, Effect], names: Iterable[str], depends: Mapping[str, frozenset[str]]
) -> dict[str, Effect]:
    """``effects`` without ``names`` and without what depends on them.

    ``depends``: effect -> effects without which it has nothing to work on.
    """
    out, waiting = dict(effects), [(name, "switched off") for name in names if name in effects]
    while waiting:
        name, why = waiting.pop()
        if out[name].enabled:
            out[name] = Effect(False, why)
        dependents = [other for other, needed in depends.items() if name in needed and other in out]
        waiting += [(other, f"{name} is switched off") for other in dependents]
    return out


FORCEABLE = {
    "normal_maps",
    "previous_pose",
    "direct",
    "point_lights",
    "spot_lights",
    "directional_lights",
    "glossy",
    "sky",
    "color",
    "emission",
    "shadows",
    "light_culling",
}
"""Effects that can be simulated although nothing needs them.  The others have nothing to work on."""


def unmeasured(effects: dict[str, Effect], settings: Settings) -> dict[str, str]:
    """Column that is null -> why nothing can measure it."""
    out = {}
    for column in COLUMNS:
        if column not in settings.metrics.columns:
            out[column] = "not requested"
        elif column in effects and not effects[column].enabled:
            out[column] = effects[column].reason
    return out


def as_summary(effects: dict[str, Effect]) -> dict[str, Any]:
    """The ``effects`` block of summary.json: effect -> whether it is on, and the reason."""
    return {name: {"on": e.enabled, "reason": e.reason} for name, e in effects.items()}


def _geometry(scene: Scene, settings: Settings) -> dict[str, Effect]:
    primitives = scene.drawn()
    skins = {int(scene.nodes.skin[n]) for n, p in primitives if is_skinned(scene, n, p)}
    morphed = {n for n, p in primitives if p.targets}
    drawn = drawn_materials(scene)
    masked, blended = (sum(m.alpha_mode == mode for m in drawn) for mode in ("MASK", "BLEND"))
    mapped = sum(m.normal_texture is not None and m.normal_scale != 0 for m in drawn)
    alpha = _count(masked, "masked primitive", "masked primitives")
    if blended:
        stochastic = settings.sequence.blend == "stochastic"
        alpha += f", {blended} blended (drawn {'with a probability of alpha' if stochastic else 'where alpha >= 0.5'})"
    seen = bool({"normal", *LIGHT_FEATURES} & set(settings.metrics.columns))
    maps, cuts = _count(mapped, "primitive has one", "primitives have one"), len(scene.replacements)
    return {
        "skinning": Effect(bool(skins), _count(len(skins), "skin deforms drawn meshes", "skins deform drawn meshes")),
        "morphing": Effect(bool(morphed), _count(len(morphed), "drawn mesh has targets", "drawn meshes have targets")),
        "alpha_mask": Effect(bool(masked + blended), alpha),
        "normal_maps": Effect(bool(mapped) and seen, maps if seen or not mapped else f"{maps}, no column needs them"),
        "previous_pose": _previous_pose(scene, settings),
        "cuts": Effect(bool(cuts), _count(cuts, "surface replaces another", "surfaces replace others")),
    }


def _previous_pose(scene: Scene, settings: Settings) -> Effect:
    if settings.metrics.stereo:
        return Effect(False, "both eyes see the scene at the same time")
    if moves_by_itself(scene):
        return Effect(True, "surfaces move by themselves")
    return Effect(False, "no surface moves by itself")


def _light(scene: Scene, settings: Settings) -> dict[str, Effect]:
    """The effects of light.  ``direct`` comes first of those that light up surfaces: the others start from it."""
    kinds = [scene.lights[i].kind for i in scene.nodes.light[scene.light_nodes]]
    columns = set(settings.metrics.columns)
    environment, traced = environment_of(settings), traced_sources(scene, settings)
    lights = len(kinds) + (environment.sun is not None)
    lit = bool(kinds) or environment.shines or bool(traced)
    # Indirect light starts from what the lights give directly.
    needs_direct = bool(columns & {"direct", "color"}) or (
        "indirect" in columns and settings.lighting.indirect != "none"
    )
    effects = {
        f"{kind}_lights": Effect(
            kinds.count(kind) > 0 and needs_direct, _count(kinds.count(kind), f"{kind} light", f"{kind} lights")
        )
        for kind in ("point", "spot", "directional")
    }
    effects |= _path_traced(scene, settings, traced, needs_direct)
    # Raster light of what paths carry would be counted twice.
    replaced = {name for by, names in REPLACED.items() if effects[by].enabled for name in names}
    in_place = f"path tracing replaces it ({environment.reason})"
    has_sky = Effect(environment.shines and needs_direct, environment.reason)
    effects["sky"] = Effect(False, in_place) if "sky" in replaced and environment.shines else has_sky
    has_sun = "the default environment has a sun" if environment.sun is not None else "the environment has no sun"
    effects["sun"] = Effect(environment.sun is not None and needs_direct, has_sun)
    source = "lights, emitters or sky to scatter" if lit else "no light and no sky in the scene"
    effects["direct"] = direct = Effect(lit and needs_direct, source if needs_direct else "no column needs it")
    materials = drawn_materials(scene)
    of_default = len(scene.drawn()) - len(materials)  # glTF's default material is a rough metal
    shiny = sum(m.specular > 0 or m.metallic > 0 for m in materials) + of_default
    effects["glossy"] = Effect(
        direct.enabled and shiny > 0,
        _count(shiny, "primitive has a glossy lobe", "primitives have a glossy lobe") if lit else source,
    )
    effects["shadows"] = _shadows(settings, lights, direct.enabled, "shadows" in replaced, of_sun=not kinds)
    effects["light_culling"] = Effect(
        lights > MANY_LIGHTS and direct.enabled and "light_culling" not in replaced,
        "path-traced light needs no tile lists"
        if "light_culling" in replaced
        else f"{lights} lights, tile lists save time above {MANY_LIGHTS}",
    )
    effects["indirect"] = _indirect(effects, traced, direct.enabled and lights > 0, settings)
    emitters = sum(any(m.emissive) or m.unlit for m in materials)
    effects["emission"] = Effect(
        emitters > 0 and "color" in columns,
        _count(emitters, "primitive is emissive or unlit", "primitives are emissive or unlit"),
    )
    shows = lit or emitters > 0
    reaches = "light reaches the camera" if shows else "no light, no sky and no emissive surface in the scene"
    effects["color"] = Effect(shows, reaches) if "color" in columns else Effect(False, "no column needs it")
    return effects


def _shadows(settings: Settings, lights: int, direct: bool, replaced: bool, *, of_sun: bool) -> Effect:
    """Shadow maps of punctual ``lights``, the sun among them; ``of_sun``: there is no other."""
    most = settings.lighting.shadow_lights
    if replaced:
        return Effect(False, "path-traced light needs no shadow maps")
    if not direct or not lights:
        return Effect(False, "no punctual light to cast them")
    if most == 0:
        return Effect(False, "no light has shadows (--shadow-lights 0)")
    which = "the sun gets" if of_sun else f"{min(most, lights)} of {lights} lights get"
    return Effect(True, f"{which} shadow maps of {settings.lighting.shadow_size} texels")


def _path_traced(scene: Scene, settings: Settings, traced: frozenset[str], wanted: bool) -> dict[str, Effect]:
    """The effects that trace paths: all light, or with ``auto`` what ``traced_sources`` names."""
    method, cost = settings.lighting.light, cost_text(settings.lighting)
    surfaces = _count(emissive_surfaces(scene, settings), "emissive surface", "emissive surfaces")
    whole = Effect(False, f"the light method is {method}")
    by_source = {"emitter_light": ("emitters", surfaces), "environment_light": ("environment", "the environment")}
    if method == "path-traced":
        whole = Effect(wanted and bool(traced), f"all light by path tracing: {cost}" if traced else "no light")
        parts = dict.fromkeys(by_source, Effect(False, "part of path_traced"))
    else:
        parts = {
            name: Effect(
                wanted and source in traced,
                f"{light} by path tracing: {cost}" if source in traced else _not_traced(source, light, settings),
            )
            for name, (source, light) in by_source.items()
        }
    return {"path_traced": whole, **parts, **_glass(scene, whole)}


def _glass(scene: Scene, path_traced: Effect) -> dict[str, Effect]:
    """The effects of surfaces that path-traced light alone has."""
    counts, out = glass_counts(drawn_materials(scene)), {}
    for name, effect in GLASS.items():
        counted = _count(counts[name], effect.one, effect.many) if counts[name] else effect.absent
        on = path_traced.enabled and counts[name] > 0
        left_out = "" if on or not counts[name] else ", path-traced light alone has it"
        out[name] = Effect(on, f"{counted}{left_out}")
    return out


def _not_traced(source: str, light: str, settings: Settings) -> str:
    """Why the preview, or the raster method, traces no paths for ``light`` of ``source``."""
    if settings.lighting.light == "raster":
        return f"{light}, the light method is raster"
    if source == "emitters":
        return "no emissive surface of strength above 1"
    return f"{light} has raster light, as punctual lights" if environment_of(settings).shines else "no environment"


def _indirect(effects: Mapping[str, Effect], traced: frozenset[str], lit: bool, settings: Settings) -> Effect:
    """The effect of indirect light.  ``lit``: whether punctual lights shine."""
    if not {"indirect", "color"} & set(settings.metrics.columns):
        return Effect(False, "no column needs it")
    if settings.lighting.indirect == "none":
        return Effect(False, "indirect light is switched off (--indirect none)")
    if traced and settings.lighting.bounces == 1 and not lit:
        return Effect(False, "paths have one bounce (--bounces 1)")
    if effects["path_traced"].enabled:
        return Effect(True, f"indirect light by path tracing, up to {settings.lighting.bounces} bounces")
    if traced and not lit:
        return Effect(True, f"indirect light of {' and '.join(sorted(traced))} by path tracing")
    if not lit:
        return Effect(False, "no punctual light to start from")
    method = indirect_method(settings)
    ignores = "no occlusion between surfaces, one bounce" if method == "rsm" else "coarse occlusion, four bounces"
    paths = f", of {' and '.join(sorted(traced))} by path tracing" if traced and settings.lighting.bounces > 1 else ""
    return Effect(True, f"indirect light by {method} ({ignores}){paths}")


def indirect_method(settings: Settings) -> str:
    """Method of indirect light; ``auto`` is the most accurate."""
    return "probes" if settings.lighting.indirect == "auto" else settings.lighting.indirect


MANY_LIGHTS = 16
"""Up to this many lights every pixel evaluates every light: tile lists would cost more than they save."""


def drawn_materials(scene: Scene) -> list[Material]:
    """The material of every drawn primitive that names one."""
    return [scene.materials[p.material] for _, p in scene.drawn() if p.material >= 0]


def moves_by_itself(scene: Scene) -> bool:
    """Whether any channel can move a drawn surface: transforms above a mesh or joint, or morph weights."""
    carriers = np.concatenate([scene.mesh_nodes, scene.joint_nodes])
    moves = moved_nodes(scene, scene.channels)[carriers].any()
    return bool(moves) or any(c.target == "node" and c.path == "weights" for c in scene.channels)


def _count(n: int, one: str, many: str) -> str:
    return f"no {many}" if n == 0 else f"{n} {one if n == 1 else many}"
