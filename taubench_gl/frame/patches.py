"""Surface patches: sample points that receive the light of lights without reflective shadow maps.  NumPy only.

Patches are chosen once, by area and by the light that falls on them over the whole animation; every frame moves them
with their triangles.  Each has two sides, and each side becomes a virtual point light (shaders/indirect/patches).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from taubench_gl.animation import FrameState, Poser, View, pose_vertices
from taubench_gl.effects.lighting import Sun
from taubench_gl.frame.geometry import Draw, instance_numbers
from taubench_gl.frame.materials import decoded_images, texels_at, transformed_uv
from taubench_gl.frame.records import Placement, RecordTable
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.math3d import normalize
from taubench_gl.metrics.color import srgb_decode
from taubench_gl.scene.model import Camera, Material, MorphTarget, Primitive, Texture

Array = np.ndarray

PATCH = Struct(
    "PatchRecord",
    Field("position", "vec4", "xyz: scene space, meters; w: area, m2, 0 = not drawn"),
    Field("normal", "vec4", "xyz: unit, world axes"),
    Field("albedo", "vec4", "xyz: diffuse albedo, linear"),
)

CANDIDATES = 8
"""Candidates, equal shares of all area, for each patch."""

BY_LIGHT = 0.75
"""Share of the patches that are chosen by the light they get; the others by area alone."""

MOST_LIGHTS = 256
"""Lights at one time that the choice looks at: every k-th of more."""


@dataclass(frozen=True, slots=True)
class Lamp:
    """A light at one time, for the choice of patches.  ``place``: world, None: directional, along ``direction``."""

    place: Array | None
    direction: Array
    strength: float  # candela or lux, largest channel
    reach: float = np.inf  # meters
    constant: bool = False  # with distance


@dataclass(frozen=True, slots=True)
class _Points:
    """Points on triangles of draws."""

    draw: Array  # (K,) int64
    corners: Array  # (K, 3) int64, vertices of the draw's primitive
    weights: Array  # (K, 3) barycentric


class Patches:
    """``count`` patches of everything that is drawn, fewer where a surface has none to give."""

    def __init__(self, poser: Poser, draws: tuple[Draw, ...], lamps: list[Lamp], count: int):
        """``lamps``: the lights that patches are for, at some times of the animation."""
        self._scene = poser.scene
        self._draws, self.count = draws, count
        self._copies = instance_numbers(draws)
        state, nowhere = poser.sample(0.0), View(np.zeros(3), np.eye(3), Camera())
        rest = state, RecordTable(draws).place(state, nowhere, np.zeros(len(draws), dtype=bool))
        points, total = self._candidates(*rest, CANDIDATES * count)
        albedo = self._albedos(points)
        self._posed = self._subsets(points)
        place, normal, _ = self._at(points, *rest)
        share = total / max(len(points.draw), 1)
        weight = np.where(albedo[:, 3] > 0.0, 1.0, 0.0)
        light = received(place, normal, share, lamps) * weight
        chance = weight / max(weight.sum(), 1e-30)
        if light.sum() > 0.0:
            chance = BY_LIGHT * light / light.sum() + (1.0 - BY_LIGHT) * chance
        taken = _systematic(chance, count)
        self._points = _Points(points.draw[taken], points.corners[taken], points.weights[taken])
        self._posed = self._subsets(self._points)
        self._albedo = albedo[taken, :3]
        # Area that a patch stands for, over that of its triangle at rest: it grows with the triangle.
        _, _, at_rest = self._at(self._points, *rest)
        self._share = share / (count * np.maximum(chance[taken], 1e-30)) / np.maximum(at_rest, 1e-30)

    def records(self, state: FrameState, placement: Placement, center: Array) -> Array:
        """(count,) PATCH records; ``center`` (3,) world: origin of scene space."""
        place, normal, area = self._at(self._points, state, placement)
        out = PATCH.zeros(max(self.count, 1))
        rows = out[: len(place)]
        rows["position"][:, :3] = place - center
        rows["position"][:, 3] = np.where(placement.visible[self._points.draw], area * self._share, 0.0)
        rows["normal"][:, :3], rows["albedo"][:, :3] = normal, self._albedo
        return out

    def _albedos(self, points: _Points) -> Array:
        """``albedos`` of all points, (K, 4); every image is decoded once."""
        out = np.zeros((len(points.draw), 4))
        runs: dict[int, list[tuple[int, slice]]] = {-1: []}  # by image, -1: none
        for d, of in _runs(points.draw):
            texture, primitive = self._material(d).base_color_texture, self._primitive(d)
            untextured = texture is None or primitive.texcoords[texture.texcoord] is None
            runs.setdefault(-1 if untextured else texture.image, []).append((d, of))
        for image, pixels in chain([(-1, None)], decoded_images(self._scene, [i for i in runs if i >= 0])):
            for d, of in runs[image]:
                place = points.corners[of], points.weights[of]
                out[of] = albedos(self._primitive(d), self._material(d), *place, pixels)
        return out

    def _material(self, draw: int) -> Material:
        material = self._draws[draw].material
        return self._scene.materials[material] if material >= 0 else Material()

    def _primitive(self, draw: int) -> Primitive:
        d = self._draws[draw]
        return self._scene.meshes[d.mesh].primitives[d.primitive]

    def _candidates(self, state: FrameState, placement: Placement, count: int) -> tuple[_Points, float]:
        """Points with equal shares of all area, and that area, m2."""
        areas = []
        for i, d in enumerate(self._draws):
            primitive = self._primitive(i)
            corners = self._world(i, primitive, state, placement)[primitive.triangles]
            areas.append(
                0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1)
            )
            assert len(areas[-1]) == d.index_count // 3
        ends = np.cumsum(np.concatenate([np.zeros(1), *areas]))
        total = float(ends[-1])
        if not total > 0.0:
            return _Points(*(np.zeros((0, *n), np.int64) for n in ((), (3,), (3,)))), 0.0
        first = np.cumsum([0, *(len(a) for a in areas)])
        k = np.arange(count)
        triangle = np.clip(np.searchsorted(ends, (k + 0.5) / count * total, side="right") - 1, 0, len(ends) - 2)
        draw = np.searchsorted(first, triangle, side="right") - 1
        corners = np.zeros((count, 3), np.int64)
        for d, of in _runs(draw):
            corners[of] = self._primitive(d).triangles[triangle[of] - first[d]]
        # Two additive recurrences (Roberts 2018), folded into the triangle.
        u, v = (0.5 + k * 0.7548776662466927) % 1.0, (0.5 + k * 0.5698402909980532) % 1.0
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        return _Points(draw, corners, np.stack([1.0 - u - v, u, v], axis=-1)), total

    def _world(self, i: int, primitive: Primitive, state: FrameState, placement: Placement) -> Array:
        """(V, 3) float64 world positions of draw ``i`` with the vertices of ``primitive``."""
        d = self._draws[i]
        if d.posed:
            return pose_vertices(self._scene, state, d.node, primitive, self._copies[i])
        world = placement.world[i]
        return primitive.positions.astype(np.float64) @ world[:3, :3].T + world[:3, 3]

    def _subsets(self, points: _Points) -> dict[int, tuple[Array, Primitive]]:
        """Posed draw -> its points, and its primitive with only their corners, three for each."""
        out = {}
        for d, of in _runs(points.draw):
            if self._draws[d].posed:
                out[d] = of, _subset(self._primitive(d), points.corners[of].reshape(-1))
        return out

    def _at(self, points: _Points, state: FrameState, placement: Placement) -> tuple[Array, Array, Array]:
        """World positions (K, 3), unit normals (K, 3) and areas of the triangles (K,)."""
        corners = np.zeros((len(points.draw), 3, 3))
        for d, of in _runs(points.draw):
            if not self._draws[d].posed:
                corners[of] = self._primitive(d).positions[points.corners[of]]
        world = placement.world[points.draw]
        corners = np.einsum("kij,kcj->kci", world[:, :3, :3], corners) + world[:, None, :3, 3]
        for d, (of, primitive) in self._posed.items():
            corners[of] = self._world(d, primitive, state, placement).reshape(-1, 3, 3)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(cross, axis=-1)
        return (np.einsum("kc,kci->ki", points.weights, corners), cross / np.maximum(length, 1e-30)[:, None],
                0.5 * length)  # fmt: skip


def lamps_of(poser: Poser, rows: list[int], times: Array, sun: Sun | None = None) -> list[Lamp]:
    """The lights of ``rows`` of the light table at ``times`` (seconds), at most MOST_LIGHTS at each.

    ``sun``: the light of the row after those of the scene's lights.
    """
    scene, out = poser.scene, []
    tried = rows[:: -(-len(rows) // MOST_LIGHTS)] if rows else []
    for t in times:
        state = poser.sample(float(t))
        for row in tried:
            if row == len(scene.light_nodes):
                out.append(Lamp(None, np.array(sun.direction), max(sun.irradiance)))
                continue
            node = int(scene.light_nodes[row])
            light, world = state.lights[int(scene.nodes.light[node])], state.world[node]
            if state.visible[node] and np.any(world[:3, :3]):
                place = None if light.kind == "directional" else world[:3, 3]
                strength = light.intensity * max(light.color)
                out.append(Lamp(place, -normalize(world[:3, 2]), strength, light.range, light.constant))
    return out


def received(place: Array, normal: Array, area: float, lamps: list[Lamp]) -> Array:
    """Irradiance of ``lamps`` on either side of patches, without occlusion.  (K, 3), (K, 3) -> (K,)."""
    out = np.zeros(len(place))
    for lamp in lamps:
        if lamp.place is None:
            out += lamp.strength * np.abs(normal @ lamp.direction)
            continue
        to_light = lamp.place - place
        d2 = np.einsum("ki,ki->k", to_light, to_light)
        window = np.clip(1.0 - (d2 / lamp.reach**2) ** 2, 0.0, 1.0)
        cosine = np.abs(np.einsum("ki,ki->k", normal, to_light)) / np.sqrt(np.maximum(d2, 1e-12))
        out += lamp.strength * window * cosine / (1.0 if lamp.constant else d2 + area / (2.0 * np.pi) + 1e-12)
    return out


def albedos(primitive: Primitive, m: Material, corners: Array, weights: Array, pixels: Array | None) -> Array:
    """Diffuse albedo, linear, and 1 where the surface is drawn, 0 where its alpha mask cuts it.  -> (K, 4).

    ``corners`` (K, 3): vertices; ``weights`` (K, 3); ``pixels``: of the base color's texture (None: it has none), read
    at the nearest texel.
    """
    rgba = np.tile(np.asarray(m.base_color, dtype=np.float64), (len(corners), 1))
    if pixels is not None:
        uv = primitive.texcoords[m.base_color_texture.texcoord]
        at = np.einsum("kc,kci->ki", weights, uv[corners].astype(np.float64))
        rgba *= _texels(pixels, m.base_color_texture, at)
    if primitive.colors is not None:
        rgba *= np.einsum("kc,kci->ki", weights, primitive.colors[corners].astype(np.float64))
    cutoff = {"MASK": m.alpha_cutoff, "BLEND": 0.5}.get(m.alpha_mode, 0.0)
    drawn = rgba[:, 3] >= cutoff
    diffuse = np.zeros_like(rgba) if m.unlit else rgba * (1.0 - 0.04 * m.specular)
    return np.concatenate([diffuse[:, :3], drawn[:, None]], axis=1)


def _texels(pixels: Array, texture: Texture, uv: Array) -> Array:
    """(K, 4) linear color and alpha."""
    column, row = texels_at(texture, transformed_uv(texture, uv), pixels.shape[1::-1])
    found = pixels[row, column] / 255.0
    return np.concatenate([srgb_decode(found[:, :3]), found[:, 3:]], axis=1)


def _subset(primitive: Primitive, vertices: Array) -> Primitive:
    """What moves ``vertices`` (V,) of a primitive."""

    def rows(values: Array | None) -> Array | None:
        return None if values is None else values[vertices]

    targets = tuple(MorphTarget(rows(t.positions)) for t in primitive.targets)
    triangles = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
    return replace(
        primitive, positions=primitive.positions[vertices], triangles=triangles, normals=None, tangents=None,
        texcoords=(None, None), colors=None, joints=rows(primitive.joints), weights=rows(primitive.weights),
        targets=targets,
    )  # fmt: skip


def _systematic(chance: Array, count: int) -> Array:
    """``count`` indices, index i about ``count`` x chance[i] times.  (K,) -> (count,), empty where all are 0."""
    total = chance.sum()
    if not total > 0.0:
        return np.zeros(0, dtype=np.int64)
    ends = np.cumsum(chance) / total
    return np.minimum(np.searchsorted(ends, (np.arange(count) + 0.5) / count), len(chance) - 1)


def _runs(draw: Array) -> list[tuple[int, slice]]:
    """Stretches of equal values of an ascending array."""
    starts = np.flatnonzero(np.diff(draw, prepend=-1))
    ends = [*starts[1:], *[len(draw)] * bool(len(draw))]
    return [(int(draw[a]), slice(int(a), int(b))) for a, b in zip(starts, ends, strict=True)]
