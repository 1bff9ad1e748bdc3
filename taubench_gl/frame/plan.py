"""The frame on one page: every pass in order for the enabled effects, and the resources of a frame.  No OpenGL.

The renderer makes the passes that this page declares, so what ``inspect`` prints is what an evaluation does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypedDict

from taubench_gl.channels import CHANNELS
from taubench_gl.effects.decide import Effect, decide, disable
from taubench_gl.effects.decide import force as force_on
from taubench_gl.effects.path_tracing import traced_effects
from taubench_gl.frame.materials import image_bytes, images_of, with_blend
from taubench_gl.frame.passes.deform import deform
from taubench_gl.frame.passes.gbuffer import attachments, channel_pass
from taubench_gl.frame.passes.indirect import indirect_light
from taubench_gl.frame.passes.lighting import color, direct_light, light_lists, stochastic_light
from taubench_gl.frame.passes.masks import masks
from taubench_gl.frame.passes.pathtracing import path_traced_light
from taubench_gl.frame.passes.shadows import shadow_maps
from taubench_gl.frame.passes.visibility import visibility
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.spec import EXACT, ON_GPU, AnimatedScene, FrameSpec
from taubench_gl.frame.targets import history_bytes
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.declare import Pass, RasterPass, dependencies, order_faults, stage, without_dependents
from taubench_gl.settings import Settings


@stage(options=("normal_maps", "alpha_mask", "previous_pose", "cuts", "skinning", "morphing"))
def geometry(spec: FrameSpec) -> Sequence[Pass]:
    """The geometry pass writes what the passes after it read, and ``spec.extra``."""
    return _geometry(spec, _after_geometry(spec))


def _after_geometry(spec: FrameSpec) -> list[Pass]:
    return [p for declare in AFTER_GEOMETRY for p in declare(spec)]


def _geometry(spec: FrameSpec, after: Iterable[Pass]) -> Sequence[Pass]:
    """``geometry`` before the passes ``after``."""
    channels = {name for p in after for name in (*p.reads, *p.history)} | set(spec.extra)
    if "emission" in channels:
        channels.add("base_color")  # an unlit surface emits its base color
    snapped = spec.tuning.snapped_corners
    return (channel_pass("gbuffer", attachments(channels), spec, at_centers=snapped),)


LIGHT = (shadow_maps, light_lists, direct_light, indirect_light, stochastic_light, path_traced_light, color)
"""Stages that light a frame."""

AFTER_GEOMETRY = (visibility, *LIGHT, masks)
FRAME = (deform, geometry, *AFTER_GEOMETRY)
"""All stages of a frame, in order."""

DEPENDS = dependencies(FRAME)
"""Effect -> effects without which it has nothing to work on."""

LIGHT_BOUND = frozenset(e for declare in (shadow_maps, light_lists, indirect_light) for e in declare.effects[:1])
"""Effects that need a light."""


class FrameOptions(TypedDict, total=False):
    """Keywords of ``frame_spec`` that the code which opens a source passes on."""

    effects: Mapping[str, Effect] | None
    force: Iterable[str]
    without: Iterable[str]
    shading: Shading
    extra: Iterable[str]
    pixel_list: bool
    given_directions: bool


def frame_spec(
    animated: AnimatedScene,
    settings: Settings,
    effects: Mapping[str, Effect] | None = None,
    *,
    force: Iterable[str] = (),
    without: Iterable[str] = (),
    shading: Shading = EXACT,
    extra: Iterable[str] = (),
    tuning: Tuning = ON_GPU,
    pixel_list: bool = False,
    given_directions: bool = False,
) -> FrameSpec:
    """What the passes of a frame are declared from.

    ``effects``: None: those that scene and settings need; ``force``, ``without``: effects to simulate although nothing
    needs them, and not to simulate, with those that depend on them; the other keywords are fields of ``FrameSpec``.  An
    effect that has nothing to work on is left out.
    """
    if effects is None:
        effects = decide(with_blend(animated.scene, settings.sequence.blend), settings)
    effects = disable(force_on(effects, force), without, DEPENDS)
    if not shading.exact:
        # Emission stays: it is part of the radiance of such frames (reuse.inputs).
        effects = {**effects, "color": Effect(False, "not every pixel has its exact light")}
    enabled = {name for name, effect in effects.items() if effect.enabled}
    # Without a punctual light there is nothing to cast shadows, to cull, or to start raster indirect light from; paths
    # that trace emitters or an environment still write the column indirect.
    if not len(animated.scene.light_nodes) and "sun" not in enabled:
        enabled -= LIGHT_BOUND - {"indirect"} if traced_effects(enabled) else LIGHT_BOUND
    enabled = without_dependents(enabled, DEPENDS)
    return FrameSpec(animated, settings, enabled, effects, shading, tuple(extra), tuning, pixel_list, given_directions)


def frame_passes(spec: FrameSpec) -> tuple[Pass, ...]:
    """Every pass of a frame in order.  ValueError where one would read what no pass has written."""
    after = _after_geometry(spec)
    passes = (*deform(spec), *_geometry(spec, after), *after)
    faults = order_faults(passes)
    if faults:
        raise ValueError("; ".join(faults))
    return passes


def frame_channels(spec: FrameSpec) -> tuple[str, ...]:
    """Every channel of a frame, in the order of the channel table."""
    return _channels_of(frame_passes(spec), spec)


def _channels_of(passes: Iterable[Pass], spec: FrameSpec) -> tuple[str, ...]:
    named = {name for p in passes for name in (*p.reads, *p.writes, *p.history)}
    named |= {name for name in spec.extra if CHANNELS[name].attachment}
    return tuple(name for name in CHANNELS if name in named and name not in ("mask", "motion"))


@dataclass(frozen=True, slots=True)
class FrameResources:
    """Passes, shader variants and allocations of a frame.

    ``memory``: bytes by name; ``images``: the names that are images of the scene.
    """

    passes: tuple[str, ...]
    shaders: frozenset[str]
    memory: dict[str, int]
    images: frozenset[str] = frozenset()

    def added_to(self, other: FrameResources) -> FrameResources:
        """What this frame has and ``other`` lacks, or has more of."""
        memory = {n: b - other.memory.get(n, 0) for n, b in self.memory.items() if b > other.memory.get(n, 0)}
        passes = tuple(p for p in self.passes if p not in other.passes)
        return FrameResources(passes, self.shaders - other.shaders, memory)


def frame_resources(spec: FrameSpec) -> FrameResources:
    """Passes, shader variants and memory of a frame."""
    passes = frame_passes(spec)
    sequence, storage = spec.settings.sequence, spec.settings.device.storage
    size = sequence.width, sequence.height
    # Every sample position within a pixel has a history.
    samples = spec.settings.metrics.samples_per_pixel
    memory = {name: samples * n for name, n in history_bytes(size, _channels_of(passes, spec), storage).items()}
    for p in passes:
        for resource in p.resources:
            memory[resource.label] = memory.get(resource.label, 0) + resource.bytes
    drawn = next(tuple(o[0] for o in p.outputs) for p in passes if isinstance(p, RasterPass) and p.name == "gbuffer")
    used = ((spec.material(p), spec.material_key(p, drawn).slots) for _, p in spec.draw_kinds)
    images = {
        f"image {image}{' (sRGB)' if srgb else ''}": image_bytes(spec.scene.images[image].size)
        for image, srgb in images_of(used)
    }
    names = tuple(dict.fromkeys(p.name for p in passes))
    return FrameResources(names, frozenset(v for p in passes for v in p.variants()), memory | images, frozenset(images))


def effect_costs(animated: AnimatedScene, settings: Settings) -> dict[str, dict[str, Any]]:
    """Per effect: ``on``, ``reason``, and what a frame has because the effect is enabled, or would have if it were.

    That is ``passes``, ``textures``, ``shaders`` and ``gpu_bytes``.  JSON values.
    """
    spec = frame_spec(animated, settings)
    out, effects, decided = {}, spec.effects, frame_resources(spec)
    for name, effect in effects.items():
        changed = effects | {name: replace(effect, enabled=not effect.enabled)}
        other = frame_resources(frame_spec(animated, settings, changed))
        adds = decided.added_to(other) if effect.enabled else other.added_to(decided)
        out[name] = {
            "on": effect.enabled,
            "reason": effect.reason,
            "passes": list(adds.passes),
            "textures": sorted(adds.memory),
            "shaders": sorted(adds.shaders),
            "gpu_bytes": sum(adds.memory.values()),
        }
    return out
