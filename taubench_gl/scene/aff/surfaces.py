"""Triangles of AFF's surfaces, and meshes that collect them by node and material.

Round surfaces are tessellated: a sphere has 32 x 16 faces, a cone or cylinder 32 sides and no caps (as in NFF).
Their normals are those of the exact surface.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from taubench_gl.math3d import normalize
from taubench_gl.scene.model import Mesh, MorphTarget, Primitive
from taubench_gl.scene.polygons import cut_polygons

Array = np.ndarray

AROUND = 32
"""Sides of spheres, cones and cylinders."""
RINGS = 16
"""Bands of a sphere from pole to pole."""


@dataclass(frozen=True, slots=True)
class Surface:
    """Triangles with every attribute per vertex; ``normals`` None: flat."""

    positions: Array  # (V, 3) float64
    triangles: Array  # (T, 3) int64
    normals: Array | None = None  # (V, 3) float64, unit
    texcoords: Array | None = None  # (V, 2) float64
    outline: bool = False  # one polygon, its corners in order


def polygon(positions: Array, normals: Array | None = None, texcoords: Array | None = None) -> Surface:
    """A polygon (n, 3), n >= 3, as a fan around its first corner; ``Collector.mesh`` replaces fans that do not fit."""
    i = np.arange(1, len(positions) - 1)
    triangles = np.stack([np.zeros_like(i), i, i + 1], axis=1)
    return Surface(positions, triangles, usable_normals(normals), texcoords, outline=len(positions) > 3)


def usable_normals(normals: Array | None) -> Array | None:
    """Unit normals; None (flat) if one of them has length 0."""
    if normals is None:
        return None
    normals = normalize(normals)
    return normals if np.all(np.any(normals != 0.0, axis=1)) else None


def sphere(center: Array, radius: float) -> Surface:
    """A sphere of ``AROUND`` x ``RINGS`` faces, poles along Y; the sign of the radius does not matter."""
    theta = np.linspace(0.0, np.pi, RINGS + 1)
    y, r = np.cos(theta), np.sin(theta)
    r[[0, -1]] = 0.0
    x, z = _circle()
    normals = np.stack([np.outer(r, x), np.repeat(y[:, None], AROUND, axis=1), np.outer(r, z)], axis=-1)
    quads = np.concatenate([_band(k) for k in range(RINGS)])
    normals = normals.reshape(-1, 3)
    return Surface(center + abs(radius) * normals, quads[_not_flat(quads, RINGS)], normals)


def cone(base: Array, base_radius: float, apex: Array, apex_radius: float) -> Surface:
    """The side of a cone (a cylinder where the radii are equal), open at both ends.  ``base`` differs from ``apex``."""
    axis = apex - base
    height = float(np.linalg.norm(axis))
    w = axis / height
    u = normalize(np.cross(w, np.eye(3)[int(np.argmin(np.abs(w)))]))
    v = np.cross(w, u)
    x, z = _circle()
    spokes = np.outer(x, u) + np.outer(z, v)
    base_radius, apex_radius = abs(base_radius), abs(apex_radius)
    # The radius decreases by (base - apex) over the height, which is the slope of the normal.
    normals = normalize(spokes * height + w * (base_radius - apex_radius))
    positions = np.concatenate([base + base_radius * spokes, apex + apex_radius * spokes])
    # If one end is a point, half of the triangles have area 0.
    triangles = _band(0)[AROUND if base_radius == 0.0 else 0 : AROUND if apex_radius == 0.0 else None]
    return Surface(positions, triangles, np.concatenate([normals, normals]))


def _circle() -> tuple[Array, Array]:
    angle = np.arange(AROUND) * (2.0 * np.pi / AROUND)
    return np.cos(angle), np.sin(angle)


def _band(row: int) -> Array:
    """Triangles between vertex rows ``row`` and ``row + 1``.  (2 AROUND, 3)."""
    i = np.arange(AROUND)
    a, b = row * AROUND + i, row * AROUND + (i + 1) % AROUND
    return np.concatenate([np.stack([a, b, b + AROUND], axis=1), np.stack([a, b + AROUND, a + AROUND], axis=1)])


def _not_flat(triangles: Array, rows: int) -> Array:
    """Triangles with at most one corner on each pole.  -> (T,) bool."""
    north = np.count_nonzero(triangles < AROUND, axis=1)
    south = np.count_nonzero(triangles >= rows * AROUND, axis=1)
    return (north < 2) & (south < 2)


@dataclass
class Collector:
    """Surfaces of one node by material; ``moving``: animated triangles by material and key times in seconds.

    ``crossing``: polygons of ``mesh`` whose outline crosses itself.
    """

    still: dict[tuple[int, bool, bool], list[Surface]] = field(default_factory=dict)
    moving: dict[tuple[int, tuple[float, ...]], list[Array]] = field(default_factory=dict)

    crossing: int = 0

    def add(self, surface: Surface, material: int) -> None:
        key = (material, surface.normals is not None, surface.texcoords is not None)
        self.still.setdefault(key, []).append(surface)

    def add_moving(self, times: tuple[float, ...], frames: Array, material: int) -> None:
        """One animated triangle: ``frames`` (K, 3, 6) position and normal of each corner at each of K ``times``."""
        self.moving.setdefault((material, times), []).append(frames)

    def mesh(self, name: str) -> Mesh | None:
        """All static surfaces as one mesh with a primitive per material."""
        primitives = tuple(_joined(self._cut(surfaces), key[0]) for key, surfaces in self.still.items())
        return Mesh(name, primitives) if primitives else None

    def _cut(self, surfaces: list[Surface]) -> list[Surface]:
        """``surfaces`` with the triangles of ``cut_polygons``: of all polygons at once, because one takes 0.3 ms."""
        outlines = [i for i, surface in enumerate(surfaces) if surface.outline]
        if not outlines:
            return surfaces
        sizes = np.array([len(surfaces[i].positions) for i in outlines])
        fans, drawn, crossing = cut_polygons(np.concatenate([surfaces[i].positions for i in outlines]), sizes)
        self.crossing += len(crossing)
        if drawn is fans:
            return surfaces
        ends, out = np.cumsum(sizes), list(surfaces)
        owner = np.searchsorted(ends, drawn[:, 0], side="right")
        for i, start, triangles in zip(outlines, ends - sizes, np.split(drawn, np.flatnonzero(np.diff(owner)) + 1)):
            out[i] = replace(out[i], triangles=triangles - start)
        return out

    def moving_meshes(self, name: str) -> list[tuple[tuple[float, ...], Mesh]]:
        """(times, mesh) of animated triangles: the base is the shape at time 0, target k that at time k + 1."""
        return [(times, Mesh(name, (_morphing(parts, m),), np.zeros(len(times) - 1)))
                for (m, times), parts in self.moving.items()]  # fmt: skip


def _joined(surfaces: list[Surface], material: int) -> Primitive:
    offsets = np.cumsum([0, *(len(s.positions) for s in surfaces[:-1])])
    first = surfaces[0]
    uv = None if first.texcoords is None else _f32([s.texcoords for s in surfaces])
    return Primitive(
        positions=_f32([s.positions for s in surfaces]),
        triangles=np.concatenate([s.triangles + o for s, o in zip(surfaces, offsets)]).astype(np.uint32),
        material=material,
        normals=None if first.normals is None else _f32([s.normals for s in surfaces]),
        texcoords=(uv, None),
    )


def _morphing(parts: list[Array], material: int) -> Primitive:
    frames = np.concatenate(parts, axis=1)  # (K, V, 6)
    positions, normals = frames[..., :3], normalize(frames[..., 3:])
    flat = not np.all(np.any(normals != 0.0, axis=2))
    targets = tuple(
        MorphTarget(_f32([p - positions[0]]), None if flat else _f32([n - normals[0]]))
        for p, n in zip(positions[1:], normals[1:])
    )
    triangles = np.arange(positions.shape[1], dtype=np.uint32).reshape(-1, 3)
    return Primitive(_f32([positions[0]]), triangles, material, None if flat else _f32([normals[0]]), targets=targets)


def _f32(parts: list[Array]) -> Array:
    return np.concatenate(parts).astype(np.float32)
