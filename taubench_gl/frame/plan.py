"""What a frame will consist of, for a scene and what is asked of it: passes, textures, shaders, bytes.  No OpenGL.

The renderer asks here which channels and lights it needs, so what ``inspect`` prints is what an evaluation does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser, bounding_box, choose_camera
from taubench_gl.animation.pose import is_skinned
from taubench_gl.channels import CHANNELS, stored_dtype
from taubench_gl.effects.decide import Effect, decide, indirect_method
from taubench_gl.frame.flow import SUMMED, channels_of, frame_flow
from taubench_gl.frame.indirect_layout import CHANNEL_NAMES, indirect_bytes
from taubench_gl.frame.material_slots import SRGB_SLOTS, has_plain_uv, tests_alpha, texture_of, wanted_slots
from taubench_gl.frame.shadow_faces import faces_of, pack
from taubench_gl.metrics.lighting import ALBEDO_TABLE
from taubench_gl.scene.model import Material, Primitive, Scene
from taubench_gl.settings import Settings

Array = np.ndarray

TILE = 16
"""Pixels along a side of the tiles that have light lists."""

BOUND_TIMES = 9
"""Times, evenly over the animation with both ends, at which bounds and the significance of lights are taken."""


def frame_channels(effects: Mapping[str, Effect], extra: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Every channel of a frame, in the order of the channel table."""
    return channels_of(frame_flow(effects, extra), extra)


def bound_times(scene: Scene) -> Array:
    return np.linspace(0.0, scene.duration, BOUND_TIMES) if scene.duration > 0 else np.zeros(1)


def significant_lights(scene: Scene, poser: Poser, camera: CameraTrack, times: Array) -> list[int]:
    """Rows of the light table, most significant first: the largest irradiance each gives at the camera's place.

    Taken over the whole animation, so that no light gains or loses its shadow in the middle of it.
    """
    nodes = scene.light_nodes
    index = scene.nodes.light[nodes]
    best = np.zeros(len(nodes))
    for t in times:
        state = poser.sample(float(t))
        view = camera.view_at(state)
        for row, node in enumerate(nodes.tolist()):
            light = state.lights[int(index[row])]
            if not state.visible[node]:
                continue
            strength = max(light.color) * light.intensity
            if light.kind != "directional":
                d2 = float(np.sum((state.world[node, :3, 3] - view.position) ** 2))
                strength /= max(d2, 1.0)
            best[row] = max(best[row], strength)
    return [int(i) for i in np.argsort(-best, kind="stable")]


@dataclass(frozen=True, slots=True)
class Needs:
    """A frame's parts.  ``memory``: what is allocated, by name, in bytes."""

    passes: tuple[str, ...]
    shaders: frozenset[str]
    memory: dict[str, int]

    def beyond(self, other: Needs) -> Needs:
        """What this frame has and ``other`` lacks, or has more of."""
        more = {n: b - other.memory.get(n, 0) for n, b in self.memory.items() if b > other.memory.get(n, 0)}
        passes = tuple(p for p in self.passes if p not in other.passes)
        return Needs(passes, self.shaders - other.shaders, more)


class FramePlan:
    """Plans frames of one scene; ``needs`` may be asked about any set of effects."""

    def __init__(self, scene: Scene, settings: Settings, camera: CameraTrack | None = None, poser: Poser | None = None):
        self.scene, self.settings = scene, settings
        self.effects = decide(scene, settings)
        poser, times = poser or Poser(scene), bound_times(scene)
        lights = significant_lights(scene, poser, camera or choose_camera(scene, settings.sequence.camera), times)
        self._shadowed = sorted(lights[: settings.lighting.shadow_lights])
        self._box = bounding_box(poser, times)
        self._drawn = [
            (node, p)
            for node in scene.mesh_nodes.tolist()
            for p in scene.meshes[scene.nodes.mesh[node]].primitives
            if len(p.triangles)
        ]

    def costs(self) -> dict[str, dict[str, Any]]:
        """Per effect: ``on``, ``reason``, and the passes, textures, shaders and bytes that a frame has because it is
        on, or would have besides if it were.  Values fit for JSON."""
        out = {}
        for name, effect in self.effects.items():
            with_it, without = (self.needs(self.effects | {name: replace(effect, enabled=on)}) for on in (True, False))
            adds = with_it.beyond(without)
            out[name] = {
                "on": effect.enabled,
                "reason": effect.reason,
                "passes": list(adds.passes),
                "textures": sorted(adds.memory),
                "shaders": sorted(adds.shaders),
                "gpu_bytes": sum(adds.memory.values()),
            }
        return out

    def needs(self, effects: Mapping[str, Effect]) -> Needs:
        on = {name for name, effect in effects.items() if effect.enabled}
        if "direct" not in on:  # whatever rests on it falls with it
            on -= {"shadows", "light_culling", "indirect", "sky", "glossy"}
        if not len(self.scene.light_nodes):
            on -= {"shadows", "light_culling", "indirect"}
        if "shadows" not in on:
            on.discard("indirect")
        channels = frame_channels({name: replace(effect, enabled=name in on) for name, effect in effects.items()})
        passes, shaders = ["gbuffer", "masks"], {"masks/masks.comp.glsl"}
        memory = {name: 2 * self._channel_bytes(name) for name in channels} | {"depth": 4 * self._pixels}
        memory |= self._images(on, channels)
        shaders |= self._geometry_shaders("gbuffer", on, channels)
        posed = [(node, p) for node, p in self._drawn if self._is_posed(node, p, on)]
        if posed:
            passes.insert(0, "deform")
            shaders.add("deform/deform.comp.glsl")
            if any(p.normals is None for _, p in posed):
                shaders.add("deform/flat_normals.comp.glsl")
            if "previous_pose" in on:
                memory["previous vertices"] = 12 * sum(_vertices(p) for _, p in posed)
        self._light(on, channels, passes, shaders, memory)
        return Needs(tuple(passes), frozenset(shaders), memory)

    def _channel_bytes(self, name: str) -> int:
        """Of one frame: every sample within a pixel is stored."""
        per_pixel = CHANNELS[name].components * int(stored_dtype(name, self.settings.device.storage)[1])
        return per_pixel * self._pixels * self.settings.metrics.samples_per_pixel

    @property
    def _pixels(self) -> int:
        return self.settings.sequence.width * self.settings.sequence.height

    def _light(
        self, on: set[str], channels: tuple[str, ...], passes: list[str], shaders: set[str], memory: dict[str, int]
    ) -> None:
        scene, settings = self.scene, self.settings
        size = settings.sequence.width, settings.sequence.height
        if "direct" in on:
            passes.append("direct")
            switches = ("glossy", "sky", "shadows", "point_lights", "spot_lights", "directional_lights")
            shaders.add(_variant("lighting/lighting.comp.glsl", *(s for s in switches if s in on)))
            if {"sky", "glossy"} <= on:
                memory["albedo table"] = 16 * ALBEDO_TABLE**2
        if "light_culling" in on:
            passes.append("light lists")
            shaders.add("lighting/cull.comp.glsl")
            tiles = -(-size[0] // TILE) * -(-size[1] // TILE)
            memory["light lists"] = 4 * tiles * (len(scene.light_nodes) + 1)
        if "shadows" in on:
            passes.append("shadows")
            shaders |= self._geometry_shaders("shadow", on, channels)
            faces = faces_of(scene, None, self._shadowed, (np.zeros(3), 1.0), settings.lighting.shadow_size)
            width, height = pack(faces)[1]
            memory["shadow atlas"] = 4 * width * height
        if "indirect" in on:
            rung = indirect_method(settings)
            passes.append("indirect")
            shaders |= self._geometry_shaders("gbuffer", on, CHANNEL_NAMES)
            shaders |= {"indirect/vpl.comp.glsl", "indirect/apply.comp.glsl"}
            shaders |= (
                {
                    "indirect/probes.comp.glsl",
                    _variant("indirect/probes.comp.glsl", "FIRST_BOUNCE"),
                    "indirect/bounce.comp.glsl",
                    "indirect/sight.comp.glsl",
                    "indirect/bricks.comp.glsl",
                    _variant("indirect/bricks.comp.glsl", "DISTANCES"),
                    "indirect/voxelize.frag.glsl",
                }
                if rung == "probes"
                else {"indirect/gather.comp.glsl"}
            )
            memory["indirect buffers"] = indirect_bytes(scene, self._shadowed, self._box, size, settings, rung)
        if "color" in on:
            passes.append("color")
            shaders.add(_variant("color/color.comp.glsl", *(n for n in SUMMED if n in on)))

    def _is_posed(self, node: int, p: Primitive, on: set[str]) -> bool:
        skinned, morphed = is_skinned(self.scene, node, p), bool(p.targets)
        return (skinned and "skinning" in on) or (morphed and "morphing" in on)

    def _material(self, p: Primitive) -> Material:
        return self.scene.materials[p.material] if p.material >= 0 else Material()

    def _slots(self, p: Primitive, on: set[str], channels: tuple[str, ...]) -> tuple[str, ...]:
        material = self._material(p)
        if "alpha_mask" not in on:
            material = replace(material, alpha_mode="OPAQUE")
        drawn = tuple(n for n in channels if CHANNELS[n].attachment)
        return wanted_slots(drawn, material, normal_maps="normal_maps" in on)

    def _images(self, on: set[str], channels: tuple[str, ...]) -> dict[str, int]:
        """Textures with their mipmaps; one that is used both as colour and as data is there twice."""
        used = {
            (texture_of(self._material(p), slot).image, slot in SRGB_SLOTS)
            for _, p in self._drawn
            for slot in self._slots(p, on, channels)
        }
        out = {}
        for image, srgb in used:
            width, height = self.scene.images[image].size
            out[f"image {image}{' (sRGB)' if srgb else ''}"] = width * height * 4 * 4 // 3
        return out

    def _geometry_shaders(self, kind: str, on: set[str], channels: tuple[str, ...]) -> set[str]:
        out = set()
        for node, p in self._drawn:
            flags = ["POSED"] if self._is_posed(node, p, on) else []
            alpha = tests_alpha(self._material(p)) and "alpha_mask" in on
            slots = self._slots(p, on, channels)
            if kind == "shadow":
                slots = tuple(s for s in slots if s == "base_color" and alpha)
            flags += ["ALPHA_TEST"] if alpha else []
            flags += [f"{slot.upper()}_MAP" for slot in slots]
            flags += ["PLAIN_UV"] if kind == "gbuffer" and slots and has_plain_uv(self._material(p), slots) else []
            if kind == "gbuffer":
                flags += [name for name in channels if CHANNELS[name].attachment]
            out.add(_variant(f"gbuffer/gbuffer.vert.glsl + {kind}/{kind}.frag.glsl", *flags))
        return out


def _vertices(p: Primitive) -> int:
    """As drawn: flat primitives have three vertices to each triangle."""
    return 3 * len(p.triangles) if p.normals is None else len(p.positions)


def _variant(entry: str, *flags: str) -> str:
    return f"{entry} [{' '.join(flags)}]" if flags else entry
