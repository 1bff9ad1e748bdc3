"""World bounding spheres of all draws at one instant, conservative, without a loop over vertices per frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import FrameState, skin_matrices
from taubench_gl.frame.geometry import Draw
from taubench_gl.math3d import bounds
from taubench_gl.scene.model import Primitive, Scene

Array = np.ndarray

LARGEST = 1e30
"""Half extent of a box around what has no bounds."""


@dataclass(frozen=True, slots=True)
class _Skinned:
    """The draws of one skin, with their joint spheres in one list."""

    draws: Array  # (n,) rows of the draws
    starts: Array  # (n,) first sphere of each
    owner: Array  # (R,) row of the draw of each sphere
    joints: Array  # (R,)
    centers: Array  # (R, 3) in bind space
    radii: Array  # (R,)


class DrawBounds:
    """World bounding spheres of draws.  Those of fixed draws move with their matrix.  A skinned vertex is a weighted
    mean of its positions under each joint, so it lies in the hull of the joints' spheres (each around the bind
    positions that joint moves).  Morph displacements widen a sphere by their largest length.
    """

    def __init__(self, scene: Scene, draws: tuple[Draw, ...]):
        self._scene, self._draws = scene, draws
        self._posed = [i for i, d in enumerate(draws) if d.posed]
        primitives = [scene.meshes[d.mesh].primitives[d.primitive] for d in draws]
        found: dict[int, tuple[Array, float, Array]] = {}  # key: identity of the vertices, which primitives can share
        for primitive in primitives:
            if id(points := primitive.positions) not in found:
                low, high = bounds(points)
                found[id(points)] = *bounding_sphere_of(points), 0.5 * np.subtract(high, low, dtype=np.float64)
        rows = [found[id(p.positions)] for p in primitives]
        self._centers = np.array([center for center, _, _ in rows]).reshape(-1, 3)
        self._radii = np.array([radius for _, radius, _ in rows]).reshape(-1)
        self._halves = np.array([half for _, _, half in rows]).reshape(-1, 3)
        self._reach = {i: _morph_reach(primitives[i]) for i in self._posed if primitives[i].targets}
        jointed = [i for i in self._posed if scene.nodes.skin[draws[i].node] >= 0 and primitives[i].joints is not None]
        self._rigid = sorted(set(self._posed) - set(jointed))  # draws that only morph
        self._skinned = _skinned(scene, draws, primitives, jointed)

    def at(self, state: FrameState, world: Array) -> tuple[Array, Array]:
        """Centers (D, 3) and radii (D,), world; ``world`` (D, 4, 4) float64 world_from_object."""
        centers, radii = _moved(world, self._centers, self._radii)
        reach = np.zeros(len(self._draws))
        for i in self._reach:
            reach[i] = self._morph_length(state, i)
        moved = self._rigid
        centers[moved], radii[moved] = _moved(world[moved], self._centers[moved], self._radii[moved] + reach[moved])
        for skin, s in self._skinned.items():
            palette = skin_matrices(self._scene, state, skin)
            c, r = _moved(palette[s.joints], s.centers, s.radii + reach[s.owner])
            low = np.minimum.reduceat(c - r[:, None], s.starts)
            high = np.maximum.reduceat(c + r[:, None], s.starts)
            centers[s.draws] = 0.5 * (low + high)
            radii[s.draws] = [0.5 * np.linalg.norm(extent) for extent in high - low]
        return centers, radii

    def boxes(self, state: FrameState, world: Array) -> tuple[Array, Array]:
        """Centers and half extents (D, 3) of world boxes around the draws; arguments of ``at``."""
        centers, radii = self.at(state, world)
        return centers, self.halves(world, radii)

    def halves(self, world: Array, radii: Array) -> Array:
        """Half extents (D, 3) of world boxes around draws in spheres of ``radii`` (D,); finite."""
        turned = np.einsum("dij,dj->di", np.abs(world[:, :3, :3]), self._halves)
        turned[self._posed] = LARGEST
        return np.minimum(turned, np.minimum(radii, LARGEST)[:, None])

    def of_fixed(self, world: Array) -> tuple[Array, Array]:
        """Centers (D, 3) and radii (D,), world, of fixed draws; posed draws get infinite radii."""
        centers, radii = _moved(world, self._centers, self._radii)
        centers[self._posed], radii[self._posed] = 0.0, np.inf
        return centers, radii

    def _morph_length(self, state: FrameState, i: int) -> float:
        weights = state.weights.get(self._draws[i].node)
        reach = self._reach[i]
        if weights is None:
            return 0.0
        return float(np.sum(np.abs(weights[: len(reach)]) * reach[: len(weights)]))

    def poses(self, state: FrameState, world: Array) -> list[bytes]:
        """Bytes per draw that are equal exactly while its geometry is in the same place."""
        out, skins = [], {}
        for draw, matrix in zip(self._draws, world, strict=True):
            if not draw.posed:
                out.append(matrix.tobytes())
                continue
            skin = int(self._scene.nodes.skin[draw.node])
            if skin >= 0 and skin not in skins:
                skins[skin] = state.world[self._scene.skins[skin].joints].tobytes()
            weights = state.weights.get(draw.node)
            rigid = matrix.tobytes() if skin < 0 else skins[skin]
            out.append(rigid + (b"" if weights is None else np.asarray(weights).tobytes()))
        return out


def in_view(clip_from_relative: Array, centers: Array, radii: Array, offsets: Array) -> Array:
    """Which spheres may reach into the view volume, (D,) bool; spheres that are not finite are always in.

    ``centers`` (D, 3), ``radii`` (D,) and ``clip_from_relative`` (4, 4) relative to the camera; ``offsets`` (D,): how
    far the origins of the draws are from it.  The rounding of a plane is no larger than the distance of a sphere which
    touches it.
    """
    x, y, z, w = clip_from_relative
    planes = np.stack([w + x, w - x, w + y, w - y, w - z, z])  # reversed Z in [0, 1]
    steepness = np.linalg.norm(planes[:, :3], axis=1)
    slack = rounding(centers, radii, offsets)
    depth = centers @ planes[:, :3].T + planes[:, 3]
    with np.errstate(invalid="ignore"):
        reach = (radii + slack)[:, None] * steepness
        return ~(depth < -reach).any(axis=1)


def rounding(centers: Array, radii: Array, offsets: Array) -> Array:
    """By how much float32 on the GPU may displace vertices of draws, (D,) meters; arguments of ``in_view``.

    It grows with the largest of the terms that are added up.
    """
    return 1e-4 * (np.linalg.norm(centers, axis=1) + radii) + 1e-5 * offsets


def bounding_sphere_of(points: Array) -> tuple[Array, float]:
    """A sphere around points (P, 3), centered on their box: (3,) and radius."""
    points = np.asarray(points, dtype=np.float64)
    low, high = bounds(points)
    center = 0.5 * (low + high)
    return center, float(np.linalg.norm(points - center, axis=1).max())


def _skinned(
    scene: Scene, draws: tuple[Draw, ...], primitives: list[Primitive], rows: list[int]
) -> dict[int, _Skinned]:
    """Skin -> the skinned draws among ``rows``, with the spheres of their joints."""
    spheres: dict[tuple[int, ...], tuple[Array, Array, Array]] = {}
    by_skin: dict[int, list[int]] = {}
    for row in rows:
        p = primitives[row]
        if (key := _skinning(p)) not in spheres:
            spheres[key] = _joint_spheres(p)
        by_skin.setdefault(int(scene.nodes.skin[draws[row].node]), []).append(row)
    out = {}
    for skin, members in by_skin.items():
        joints, centers, radii = zip(*(spheres[_skinning(primitives[row])] for row in members), strict=True)
        counts = [len(j) for j in joints]
        out[skin] = _Skinned(
            np.array(members), np.cumsum([0, *counts[:-1]]), np.repeat(members, counts),
            np.concatenate(joints), np.concatenate(centers), np.concatenate(radii),
        )  # fmt: skip
    return out


def _skinning(primitive: Primitive) -> tuple[int, ...]:
    """Equal for primitives that share their vertices and skin weights."""
    return id(primitive.positions), id(primitive.joints), id(primitive.weights)


def _joint_spheres(primitive: Primitive) -> tuple[Array, Array, Array]:
    """Joints that move any vertex (J,), and a sphere around the bind positions of each: (J, 3), (J,)."""
    weighted = primitive.weights > 0
    used = np.unique(primitive.joints[weighted])
    spheres = [
        bounding_sphere_of(primitive.positions[np.any(weighted & (primitive.joints == j), axis=1)]) for j in used
    ]
    return used, np.array([c for c, _ in spheres]), np.array([r for _, r in spheres])


def _morph_reach(primitive: Primitive) -> Array:
    """The longest displacement of every target, meters.  (M,)."""
    return np.array(
        [0.0 if t.positions is None else float(np.linalg.norm(t.positions, axis=1).max()) for t in primitive.targets]
    )


def _moved(matrices: Array, centers: Array, radii: Array) -> tuple[Array, Array]:
    """Spheres through affine matrices: (K, 4, 4), (K, 3), (K,) -> (K, 3), (K,)."""
    out = np.einsum("kij,kj->ki", matrices[:, :3, :3], centers) + matrices[:, :3, 3]
    # Largest stretch: the root of the largest eigenvalue of M^T M, which no row sum of magnitudes is below
    # (Gershgorin); exact for rotations with scale, where other norms would make the sphere up to 1.7 times as large.
    m = matrices[:, :3, :3]
    squares = np.abs(np.einsum("kji,kjl->kil", m, m)).sum(axis=2).max(axis=1)
    return out, radii * np.sqrt(squares)
