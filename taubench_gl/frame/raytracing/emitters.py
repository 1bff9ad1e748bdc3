"""The emitter table: every triangle of an emissive draw, its power, and where it is.

Power is area x mean luminance of the emission that the triangle shows, and a function of the scene: areas are the
largest over the animation, so that an emitter that grows is found from the start.  Reuse methods sample emitters by
power; the path tracer by what they bring to the cells of a grid (``metrics.stochastic.LightCells``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import FrameState, pose_vertices
from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.materials import texels_at, transformed_uv
from taubench_gl.frame.raytracing.hit_tables import HitOptions, hit_emission
from taubench_gl.frame.raytracing.instances import changing_nodes
from taubench_gl.frame.records import Placement
from taubench_gl.metrics.stochastic import LightCells, cell_choice
from taubench_gl.scene.model import Material, Primitive, Scene, Texture
from taubench_gl.srgb import LUMINANCE, srgb_decode

Array = np.ndarray
EMITTER = np.dtype(
    [
        ("draw", "u4"),
        ("triangle", "u4"),
        ("cumulative", "f4"),
        ("probability", "f4"),
        ("center", "f8", 3),
        ("extent", "f8"),
    ]
)
MOST_GROUPS = 1024
"""Groups of consecutive triangles that cells tell apart; more triangles are chosen by power within their group."""

SIDE = 4
"""A triangle's emission is taken at SIDE^2 points, from the texture at a size of about as many texels."""


def emitter_table(
    scene: Scene,
    draws: tuple[Draw, ...],
    states: Sequence[FrameState],
    options: HitOptions,
    pixels: Callable[[int], Array],
) -> Array:
    """Rows of EMITTER, the triangles of a draw in one run, draws ascending; (0,) without emitters.

    ``states``: poses over the animation.  ``pixels``: image -> (h, w, 4) uint8.  Probabilities are differences of the
    rounded cumulative ones, as the shader has them; 0 where only a ray finds the triangle's light, if there is any.
    ``center``: of the triangle, meters, in the space of its draw, of posed draws the mean over ``states`` in the world;
    ``extent``: square meters, its area and how far it moves in a posed draw.
    """
    materials = (Material(), *scene.materials)
    emits = [any(hit_emission(materials[d.material + 1], options)) and not d.repeats for d in draws]
    rows = np.flatnonzero(emits).tolist()
    if not rows:
        return np.zeros(0, EMITTER)
    # What changes may show at other times than those of ``states``.
    may_show = changing_nodes(scene) | np.any([s.visible for s in states], axis=0)
    shapes = _shapes(scene, [draws[i] for i in rows], states)
    brightness = _Brightness(scene, options, pixels)
    powers = [may_show[draws[i].node] * s.area * brightness.of(draws[i]) for i, s in zip(rows, shapes, strict=True)]
    power = np.nan_to_num(np.concatenate(powers), posinf=0.0)
    out = np.zeros(len(power), EMITTER)
    out["draw"] = np.repeat(rows, [len(p) for p in powers])
    out["triangle"] = np.concatenate([np.arange(len(p)) for p in powers])
    out["center"] = np.nan_to_num(np.concatenate([s.center for s in shapes]))
    out["extent"] = np.nan_to_num(np.concatenate([s.area + s.moved for s in shapes]))
    total = power.sum()
    if total > 0.0:
        cumulative = np.cumsum(power) / total
        cumulative[np.flatnonzero(power)[-1] :] = 1.0
        out["cumulative"] = cumulative
        out["probability"] = np.diff(out["cumulative"], prepend=np.float32(0))
    return out


def group_size(emitters: int) -> int:
    """Triangles of each of at most MOST_GROUPS groups of consecutive emitters."""
    return max(-(-emitters // MOST_GROUPS), 1)


class EmitterGroups:
    """Groups of consecutive emitters as the lights of a grid."""

    def __init__(self, emitters: Array, draws: Sequence[Draw]):
        self._emitters = emitters
        self.size = group_size(len(emitters))
        self._first = np.arange(0, len(emitters), self.size)
        self.count = len(self._first)
        self._posed = np.array([d.posed for d in draws], dtype=bool)[emitters["draw"]]
        self._placed: tuple[Array, ...] = ()
        self._choice: tuple[Array, Array] = cell_choice(np.zeros((0, 0)))

    def choice(self, grid: LightCells, placement: Placement) -> tuple[Array, Array]:
        """What ``cell_choice`` returns for the groups at ``placement``, by what each brings to each cell."""
        e = self._emitters
        power = e["probability"] * placement.visible[e["draw"]]
        world = placement.world[e["draw"]]
        moved = np.einsum("eij,ej->ei", world[:, :3, :3], e["center"]) + world[:, :3, 3]
        at = np.where(self._posed[:, None], e["center"], moved)
        if not (self._placed and all(map(np.array_equal, self._placed, (power, at)))):
            self._placed, total = (power, at), np.add.reduceat(power, self._first)
            centers = np.add.reduceat(power[:, None] * at, self._first) / np.maximum(total, 1e-30)[:, None]
            extents = np.add.reduceat(e["extent"], self._first)
            everywhere = np.full(self.count, True)
            self._choice = cell_choice(grid.importance(centers, total, np.zeros(self.count), everywhere, extents))
        return self._choice


@dataclass(frozen=True, slots=True)
class _Shape:
    """Triangles of a draw over the states that show it, (T,): largest ``area`` and squared way from their mean place
    that posed ones ``moved``, square meters; ``center`` (T, 3): as of ``emitter_table``."""

    area: Array
    center: Array
    moved: Array | float


def _shapes(scene: Scene, draws: Sequence[Draw], states: Sequence[FrameState]) -> list[_Shape]:
    across: dict[tuple[int, int], Array] = {}
    node = np.array([d.node for d in draws])
    local = np.stack([np.eye(4) if d.local is None else d.local for d in draws])
    linear = np.stack([(s.world[node] @ local)[:, :3, :3] for s in states])  # (S, K, 3, 3)
    still = np.ptp(linear, axis=0).max(axis=(1, 2)) <= 1e-9 * np.abs(linear).max(axis=(0, 2, 3))
    out = []
    for k, d in enumerate(draws):
        primitive = scene.meshes[d.mesh].primitives[d.primitive]
        shown = [i for i, s in enumerate(states) if s.visible[d.node]] or range(len(states))
        if d.posed:
            instance = _instance(scene, d)
            poses = [pose_vertices(scene, states[i], d.node, primitive, instance) for i in shown]
            vectors = [_across(p[primitive.triangles]) for p in poses]
            centers = np.stack([p[primitive.triangles].mean(axis=1) for p in poses])
            center = centers.mean(axis=0)
            moved = np.sum((centers - center) ** 2, axis=-1).max(axis=0)
        else:
            key, corners = (d.mesh, d.primitive), primitive.positions.astype(np.float64)[primitive.triangles]
            if key not in across:
                across[key] = _across(corners)
            vectors = [across[key] @ _cofactor(linear[i, k]).T for i in (shown[:1] if still[k] else shown)]
            center, moved = corners.mean(axis=1), 0.0
        out.append(_Shape(np.max([0.5 * np.linalg.norm(v, axis=-1) for v in vectors], axis=0), center, moved))
    return out


def _across(corners: Array) -> Array:
    """Cross products of the edges of triangles (T, 3, 3) -> (T, 3)."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _cofactor(m: Array) -> Array:
    """Cofactors (3, 3) of ``m`` (3, 3): they turn area vectors where ``m`` turns points."""
    return np.stack([np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])])


def _instance(scene: Scene, draw: Draw) -> int | None:
    if draw.local is None:
        return None
    return next(i for i, m in enumerate(scene.nodes.instances[draw.node]) if np.array_equal(m, draw.local))


class _Brightness:
    """Mean luminance of the emission of each triangle of a draw, each primitive once."""

    def __init__(self, scene: Scene, options: HitOptions, pixels: Callable[[int], Array]):
        self._scene, self._options, self._pixels = scene, options, pixels
        self._known: dict[tuple[int, int], Array] = {}
        self._pyramids: dict[tuple[int, tuple[float, float, float]], list[Array]] = {}

    def of(self, draw: Draw) -> Array:
        """Mean luminance of the emission of ``draw``'s triangles, (T,) float64; () where all of them have the same."""
        key = draw.mesh, draw.primitive
        if key not in self._known:
            primitive = self._scene.meshes[draw.mesh].primitives[draw.primitive]
            material = self._scene.materials[draw.material] if draw.material >= 0 else Material()
            self._known[key] = self._mean(primitive, material)
        return self._known[key]

    def _mean(self, primitive: Primitive, material: Material) -> Array:
        factor = hit_emission(material, self._options)
        texture = material.emissive_texture
        if texture is None:
            return np.asarray(np.dot(factor, LUMINANCE))
        uv = primitive.texcoords[texture.texcoord]
        if uv is None:
            uv = np.zeros((len(primitive.positions), 2))
        key = texture.image, factor
        if key not in self._pyramids:
            linear = srgb_decode(self._pixels(texture.image)[..., :3].astype(np.float32) / 255.0)
            self._pyramids[key] = pyramid(linear @ (LUMINANCE * factor))
        return texture_means(self._pyramids[key], transformed_uv(texture, uv)[primitive.triangles], texture)


def pyramid(values: Array) -> list[Array]:
    """Means over boxes of 1, 2, 4, ... texels a side.  (h, w) -> list of such, down to one texel."""
    out = [values]
    while values.size > 1:
        h, w = values.shape
        values = np.pad(values, ((0, h % 2 if h > 1 else 0), (0, w % 2 if w > 1 else 0)), mode="edge")
        if values.shape[0] > 1:
            values = 0.5 * (values[::2] + values[1::2])
        if values.shape[1] > 1:
            values = 0.5 * (values[:, ::2] + values[:, 1::2])
        out.append(values)
    return out


def texture_means(levels: Sequence[Array], uv: Array, texture: Texture) -> Array:
    """Mean over each triangle of a texture, about: SIDE^2 points at the level where it covers about as many texels.

    ``levels``: from ``pyramid``; ``uv`` (T, 3, 2) of the corners, transformed.  (T,).
    """
    h, w = levels[0].shape
    edges = (uv[:, 1:] - uv[:, :1]) * (w, h)
    area = 0.5 * np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
    level = np.ceil(0.5 * np.log2(np.maximum(np.nan_to_num(area), 1.0) / SIDE**2)).clip(0, len(levels) - 1).astype(int)
    u1, u2 = (x.ravel() for x in np.meshgrid(*[(np.arange(SIDE) + 0.5) / SIDE] * 2))
    weights = np.stack([1.0 - np.sqrt(u1), np.sqrt(u1) * (1.0 - u2), np.sqrt(u1) * u2], axis=-1)
    out = np.zeros(len(uv))
    for k in np.unique(level):
        rows = level == k
        x, y = texels_at(texture, weights @ uv[rows], levels[k].shape[::-1])  # (n, SIDE^2)
        out[rows] = levels[k][y, x].mean(axis=-1)
    return out
