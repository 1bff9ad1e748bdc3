"""Input of pass declarations: scene, settings, enabled effects.  No OpenGL."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View, bounding_box, bounding_sphere, choose_camera
from taubench_gl.animation.pose import is_skinned
from taubench_gl.channels import CHANNELS, stored_dtype
from taubench_gl.conventions import DEFAULT_FPS
from taubench_gl.effects.decide import Effect, indirect_method
from taubench_gl.effects.lighting import Environment, Sun, environment_of
from taubench_gl.effects.path_tracing import GLASS, emitters, traced_effects, traced_sources
from taubench_gl.frame.lights import KINDS, light_kinds, significant_lights
from taubench_gl.frame.materials import MaterialKey, material_key, with_blend
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.shadow_faces import Face, faces_of, map_sizes
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.declare import IMAGE, READ, TEXTURE, WRITE, ComputePass, Use
from taubench_gl.scene.model import Material, Primitive, Scene
from taubench_gl.settings import PREVIEWED, Settings

Array = np.ndarray
BOUND_TIMES = 9
"""Times, evenly over the animation with both ends, at which bounds and the significance of lights are taken."""

TO_CAMERA = "to_camera"
"""Texture (rgba32f, xyz: unit, world axes) of the directions towards which a spec with ``given_directions`` lights."""

BOUND_MARGIN = 1.05
"""Factor on the radius of the scene's bounds: what moves between those times."""

EXACT, ON_GPU = Shading(), Tuning()
_FORMATS = {("f4", 4): "rgba32f", ("f2", 4): "rgba16f", ("f4", 2): "rg32f", ("u4", 1): "r32ui", ("u4", 2): "rg32ui"}


def bound_times(scene: Scene) -> Array:
    """Times at which facts of the whole animation are taken, (T,) seconds."""
    return np.linspace(0.0, scene.duration, BOUND_TIMES) if scene.duration > 0 else np.zeros(1)


def ranked_with_sun(ranked: list[int], sun: Sun | None) -> list[int]:
    """``ranked``: rows of all lights of the scene; with ``sun``, its row precedes them."""
    return ranked if sun is None else [len(ranked), *ranked]


class AnimatedScene:
    """A scene with its camera and poses, and facts of the whole animation, each found when first needed.

    All sources that draw the scene in one session share it.
    """

    def __init__(
        self, scene: Scene, camera: CameraTrack | None = None, poser: Poser | None = None, fps: float = DEFAULT_FPS
    ):
        """``camera``: None: the scene's own (``choose_camera``); ``poser``: None: a new one for the rate ``fps``."""
        self.scene, self.camera = scene, camera or choose_camera(scene)
        self.poser = poser or Poser(scene, fps)

    def at_rate(self, fps: float) -> AnimatedScene:
        """This scene with its camera, posed for a run of ``fps`` frames per second."""
        return self if self.poser.fps == fps else AnimatedScene(self.scene, self.camera, fps=fps)

    def view_at(self, time: float) -> View:
        """The camera's view at ``time`` seconds."""
        return self.camera.view_at(self.poser.sample(time))

    @cached_property
    def times(self) -> Array:
        """Times of ``bound_times``, (T,) seconds."""
        return bound_times(self.scene)

    @cached_property
    def ranked_lights(self) -> list[int]:
        """Rows of the scene's lights in the light table, the most significant first."""
        return significant_lights(self.scene, self.poser, self.camera, self.times)

    @cached_property
    def bounds(self) -> tuple[Array, float]:
        """Center (3,) and radius of everything that casts or receives light, world."""
        center, radius = bounding_sphere(self.poser, self.times)
        return center, radius * BOUND_MARGIN

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Low and high corner (3,) of all geometry, world."""
        return bounding_box(self.poser, self.times)

    @cached_property
    def triangles(self) -> int:
        """Triangles of everything that is drawn, every instance counted."""
        instances = self.scene.nodes.instances
        return sum(len(p.triangles) * len(instances.get(node, (None,))) for node, p in self.drawn)

    @cached_property
    def drawn(self) -> list[tuple[int, Primitive]]:
        """``Scene.drawn``, made once."""
        return self.scene.drawn()


SHADOW_TRIANGLES = 24_000_000
"""Triangles that shadow maps draw for a frame of a preview: a light draws all of the scene.  In a scene of more than a
million, fewer lights than asked for have shadows there; path-traced light has the shadows of all."""


@dataclass(frozen=True)
class FrameSpec:
    """One way to render a scene; ``frame.plan.frame_spec`` makes it."""

    animated: AnimatedScene
    settings: Settings
    enabled: frozenset[str]  # effects, less those that another disabled one leaves nothing to work on
    effects: Mapping[str, Effect] = field(default_factory=dict)  # all effects by name, with reasons
    shading: Shading = EXACT
    extra: tuple[str, ...] = ()  # channels besides those that passes read
    tuning: Tuning = ON_GPU
    pixel_list: bool = False  # path-traced light for listed pixels only
    given_directions: bool = False  # light towards the directions of the texture ``to_camera``, not to the camera

    @cached_property
    def scene(self) -> Scene:
        """The scene with its blended materials as they are drawn."""
        return with_blend(self.animated.scene, self.settings.sequence.blend)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.settings.sequence.width, self.settings.sequence.height

    def declare_directions(self, p: ComputePass) -> ComputePass:
        """``p`` with the lookup of the direction to the camera (``shaders/common/to_camera.glsl``) declared."""
        p.define(GIVEN_DIRECTIONS=self.given_directions)
        return p.texture(TO_CAMERA, filled=True) if self.given_directions else p

    @property
    def indirect_method(self) -> str:
        return indirect_method(self.settings)

    # --- path-traced light
    @cached_property
    def path_traced_sources(self) -> frozenset[str]:
        """Which effects.path_tracing.SOURCES the path tracer simulates; empty: it has nothing to do."""
        effects = traced_effects(self.enabled)
        if self.shading.stochastic or "direct" not in self.enabled or not effects:
            return frozenset()
        sources = traced_sources(self.scene, self.settings)
        if self.settings.lighting.light == "path-traced":
            return sources if self.light_kinds else sources - {"punctual"}
        wanted = {"emitters": "emitter_light", "environment": "environment_light"}
        return frozenset(source for source, effect in wanted.items() if effect in effects and source in sources)

    @property
    def raster_direct(self) -> bool:
        """Whether a raster pass writes ``direct``; path-traced light is added to it, or written where none does."""
        lit = bool(self.light_kinds) or "sky" in self.enabled
        return "direct" in self.enabled and not self._replaces_raster and (lit or not self.path_traced_sources)

    @property
    def raster_indirect(self) -> bool:
        """Whether a raster pass writes ``indirect``; path-traced light is added to it, or written where none does."""
        needed = {"indirect", "direct"} <= self.enabled
        return needed and bool(self.light_kinds) and not self._replaces_raster

    @property
    def _replaces_raster(self) -> bool:
        return self.settings.lighting.light == "path-traced" and bool(self.path_traced_sources)

    @property
    def glass(self) -> dict[str, bool]:
        """Macros of the effects of surfaces that path-traced light alone has."""
        traced = bool(self.path_traced_sources)
        return {name.upper(): traced and name in self.enabled for name in GLASS}

    @cached_property
    def emitters(self) -> frozenset[int]:
        """Materials whose surfaces are path-traced lights."""
        return emitters(self.scene, self.settings) if "emitters" in self.path_traced_sources else frozenset()

    @property
    def spp(self) -> int:
        """Samples per pixel of path-traced light."""
        return self.settings.lighting.path_samples

    @property
    def bounces(self) -> int:
        """Most bounces of a path, at least 1."""
        return self.settings.lighting.bounces

    @property
    def pattern(self) -> str:
        """Pattern of path samples: fixed | independent."""
        return self.settings.lighting.pattern

    @property
    def seed(self) -> int:
        return self.settings.lighting.seed

    @property
    def bidirectional(self) -> bool:
        """Whether paths are connected with light subpaths: asked for, two bounces, and a light at a place."""
        lights = set(self.light_kinds) - {KINDS.index("directional")} if "punctual" in self.path_traced_sources else ()
        return self.settings.lighting.bidirectional and self.bounces > 1 and bool(lights)

    @cached_property
    def environment(self) -> Environment:
        return environment_of(self.settings)

    @property
    def sun(self) -> Sun | None:
        """The environment's sun: the last row of the light table."""
        return self.environment.sun if "sun" in self.enabled else None

    @cached_property
    def light_kinds(self) -> tuple[int, ...]:
        """``LIGHT.direction.w`` of every row of the light table."""
        return light_kinds(self.scene, self.sun)

    @cached_property
    def shadowed(self) -> list[int]:
        """Rows of the light table that get shadow maps, ascending; none without shadows.  The sun comes first."""
        return sorted(self.ranked_shadows)

    @cached_property
    def map_sizes(self) -> dict[int, int]:
        """Row of ``shadowed`` -> texels along its shadow maps (``shadow_faces.map_sizes``)."""
        texels, limit = self.settings.lighting.shadow_size, self.tuning.texture_limit
        return map_sizes(self.scene, self.ranked_shadows, texels, limit, self.sun)

    @property
    def ranked_shadows(self) -> list[int]:
        """Rows of the lights that get shadow maps, the most significant first."""
        if "shadows" not in self.enabled:
            return []
        lighting, most = self.settings.lighting, self.settings.lighting.shadow_lights
        if lighting.light in PREVIEWED:
            most = min(most, max(1, SHADOW_TRIANGLES // max(self.animated.triangles, 1)))
        return ranked_with_sun(self.animated.ranked_lights, self.sun)[:most]

    def light_faces(self, resolution: int | Mapping[int, int], rows: list[int] | None = None) -> list[Face]:
        """Faces of the shadowed lights at ``resolution`` texels: their number, owners and sizes, not their places.

        ``resolution``: of all lights or by row.  ``rows``: of the lights, instead of the shadowed ones.
        """
        rows = self.shadowed if rows is None else rows
        return faces_of(self.scene, None, rows, (np.zeros(3), 1.0), resolution, self.sun)

    # --- channels
    def channels(self, *names: str, images: bool = False, history: bool = False) -> list[Use]:
        """Channels that a pass reads, through samplers or as ``images``; with ``history`` as history_<name>."""
        out = []
        for name in names:
            dtype, components = stored_dtype(name, self.settings.device.storage), CHANNELS[name].components
            sampler = "usampler2D" if dtype == "u4" else "sampler2D"
            kind = _FORMATS[dtype, components] if images else sampler
            prefix = "history_" if history else ""
            out.append(Use(IMAGE if images else TEXTURE, prefix + name, kind, READ, name, history))
        return out

    def outputs(self, *names: str) -> list[Use]:
        """Channels that a pass writes, as <name>_out."""
        out = []
        for name in names:
            dtype = stored_dtype(name, self.settings.device.storage)
            out.append(Use(IMAGE, f"{name}_out", _FORMATS[dtype, CHANNELS[name].components], WRITE, name))
        return out

    # --- what is drawn
    def material(self, primitive: Primitive) -> Material:
        material = self.scene.materials[primitive.material] if primitive.material >= 0 else Material()
        masked = "alpha_mask" in self.enabled or material.alpha_mode == "OPAQUE"
        return material if masked else dataclasses.replace(material, alpha_mode="OPAQUE")

    def material_key(self, primitive: Primitive, channels: Iterable[str]) -> MaterialKey:
        return material_key(self.material(primitive), channels, normal_maps="normal_maps" in self.enabled)

    def material_keys(self, channels: Iterable[str]) -> list[MaterialKey]:
        """Keys of glTF's default material and then of every material of the scene, as MaterialTable orders them."""
        channels, maps = tuple(channels), "normal_maps" in self.enabled
        return [material_key(m, channels, normal_maps=maps) for m in (Material(), *self.scene.materials)]

    def is_posed(self, node: int, p: Primitive) -> bool:
        """Whether the deform pass moves the vertices: skinned or morphed, where that is enabled."""
        skinned, morphed = is_skinned(self.scene, node, p), bool(p.targets)
        return (skinned and "skinning" in self.enabled) or (morphed and "morphing" in self.enabled)

    @cached_property
    def draw_kinds(self) -> list[tuple[bool, Primitive]]:
        """(posed, primitive) of what is drawn, one for each pair of posed and material."""
        kinds = {(self.is_posed(node, p), p.material): p for node, p in self.animated.drawn}
        return [(posed, p) for (posed, _), p in kinds.items()]

    @cached_property
    def colored(self) -> frozenset[int]:
        """Materials (-1: default) of primitives with vertex colors."""
        return frozenset(p.material for m in self.scene.meshes for p in m.primitives if p.colors is not None)
