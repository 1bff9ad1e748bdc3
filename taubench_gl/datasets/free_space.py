"""Free space of a scene: a voxel grid of its triangles, and the distance of each voxel from them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import Poser, choose_camera
from taubench_gl.animation.pose import is_skinned, pose_vertices
from taubench_gl.animation.state import FrameState
from taubench_gl.animation.views import OrbitCamera
from taubench_gl.metrics.activity import euler_yxz
from taubench_gl.scene.model import Scene

Array = np.ndarray

VOXELS = 1_500_000
SAMPLES = 3_000_000
"""Approximate number of points on triangles: about two per voxel face even for large surfaces."""

ENOUGH = 4
"""Distance from surfaces, voxels, at which the clearance is 1."""

EYE_HEIGHT = 1.7
"""Meters above the ground, in scenes of sufficient height."""

WALKABLE = 3.0
"""Smallest extent along x and z, meters, of a scene to walk in; the camera circles smaller objects."""

CANDIDATES = 24
INSIDE = 0.5
"""Winding number above which a point lies inside a solid, such as a wall or a statue."""

TIMES_PER_SECOND = 12.0
MAX_TIMES = 73
"""Times at which moving triangles are sampled: 6 s at the rate above; longer animations are sampled less often."""

MOVING_DENSITY, MOVING_SAMPLES = 4.0, 400_000
"""Points on moving triangles at each time: per voxel face of their area, and in total."""

MAX_BETWEEN = 12
"""Interpolated positions of a fast object between two times, which close gaps along its path."""


class VoxelSpace:
    """``FreeSpace`` of any scene: the voxels without triangles at all times of its animation.

    The camera moves in a horizontal plane.  If there is ground below its start, it stays above ground.  Otherwise it
    moves around the scene and looks at it.
    """

    def __init__(self, scene: Scene, voxels: int = VOXELS):
        poser = Poser(scene)
        state = poser.sample(0.0)
        triangles = world_triangles(scene, state)
        points = surface_points(triangles)
        self._low, self._high = np.quantile(points, 0.002, axis=0), np.quantile(points, 0.998, axis=0)
        self.center = 0.5 * (self._low + self._high)
        self.radius = max(0.5 * float(np.linalg.norm(self._high - self._low)), 1e-6)
        self._build(points, 0.0, voxels, moving_triangles(scene, poser))
        self._around = False
        start = self._from_camera(scene, state) or self._from_ground(triangles)
        if start is None:
            # No ground: move around the scene, at most three radii away.
            self._around = True
            self._build(points, 2.0 * self.radius, voxels, moving_triangles(scene, poser))
            at = self.center + self.radius * np.array([0.0, 0.25, 1.6])
            start = at, 0.0
        self._start = start

    def start(self) -> tuple[Array, float]:
        return self._start

    def resolution(self) -> float:
        return self.size

    def look_at(self) -> Array | None:
        return self.center if self._around else None

    def step(self, position: Array, angles: Array, length: float) -> Array:
        level = np.stack([-np.sin(angles), np.zeros_like(angles), -np.cos(angles)], axis=-1)
        return position + length * level

    def clearance(self, points: Array) -> Array:
        cell = np.floor((np.asarray(points) - self._origin) / self.size).astype(np.int64)
        shape = np.array(self._room.shape)
        inside = np.all((cell >= 0) & (cell < shape), axis=-1)
        x, y, z = np.moveaxis(np.clip(cell, 0, shape - 1), -1, 0)
        room = self._room[x, y, z].astype(np.float64)
        if not self._around:
            inside &= self._grounded[x, y, z]
        return np.where(inside, room / ENOUGH, -1.0)

    def _build(self, points: Array, pad: float, voxels: int, moving: Iterator[tuple[Array, Array]]) -> None:
        from scipy.ndimage import maximum_filter  # imported late: 0.6 s

        low, high = self._low - [pad, 0.5 * pad, pad], self._high + [pad, 0.5 * pad, pad]
        extent = np.maximum(high - low, 1e-3 * self.radius)
        self.size = max(float(np.prod(extent) / voxels) ** (1 / 3), float(extent.max()) / 1024)
        self._origin = low - 2 * self.size
        shape = np.ceil(extent / self.size).astype(int) + 4
        filled = np.zeros(shape, dtype=bool)
        self._fill(filled, points)
        self._grounded = np.logical_or.accumulate(filled, axis=1)  # moving objects are not ground
        for before, after in moving:
            longest = float(np.linalg.norm(after - before, axis=-1).max(initial=0.0))
            count = min(int(longest / self.size) + 1, MAX_BETWEEN)
            samples = MOVING_DENSITY * float(areas(after).sum()) / self.size**2
            for part in np.arange(1, count + 1) / count:
                self._fill(filled, surface_points(before + part * (after - before), int(min(samples, MOVING_SAMPLES))))
        self._room = np.zeros(shape, dtype=np.uint8)
        for _ in range(ENOUGH):
            self._room += ~filled
            filled = maximum_filter(filled, size=3, mode="constant")  # grown by one voxel, diagonals included

    def _fill(self, filled: Array, points: Array) -> None:
        # Axis by axis, which takes a third of the time of rows of three.
        cells = [np.floor((points[:, k] - self._origin[k]) / self.size).astype(np.int64) for k in range(3)]
        inside = np.logical_and.reduce([(c >= 0) & (c < n) for c, n in zip(cells, filled.shape, strict=True)])
        filled[tuple(c[inside] for c in cells)] = True

    def _from_camera(self, scene: Scene, state: FrameState) -> tuple[Array, float] | None:
        camera = choose_camera(scene)
        if isinstance(camera, OrbitCamera):
            return None
        view = camera.view_at(state)
        yaw = math.degrees(float(euler_yxz(view.world_from_view)[0]))
        return (view.position, yaw) if self.clearance(view.position) > 0 else None

    def _from_ground(self, triangles: Array) -> tuple[Array, float] | None:
        """Near the middle, at eye height over the lowest ground, where there is most room; None: no such place."""
        if min((self._high - self._low)[[0, 2]]) < WALKABLE:
            return None
        height = float(self._high[1] - self._low[1])
        eye = EYE_HEIGHT if height > 2 * EYE_HEIGHT else 0.4 * height
        spots = np.argwhere((self._room >= 2) & self._grounded)
        if not len(spots):
            return None
        points = self._origin + (spots + 0.5) * self.size
        ground = self._origin[1] + self.size * np.argmax(self._grounded, axis=1)[spots[:, 0], spots[:, 2]]
        level = np.abs(points[:, 1] - ground - eye) <= self.size
        points, spots = points[level], spots[level]
        if len(points) < 8:
            return None
        away = np.linalg.norm((points - self.center)[:, [0, 2]], axis=1) / self.radius
        ranked = np.argsort(away - self._room[tuple(spots.T)] / ENOUGH, kind="stable")
        # Adjacent candidates are similar, so they are spread over the better half.
        for i in ranked[: max(len(ranked) // 2, 1) : max(len(ranked) // (2 * CANDIDATES), 1)]:
            if winding_number(triangles, points[i]) < INSIDE:
                return points[i], 0.0
        return None


def world_triangles(scene: Scene, state: FrameState) -> Array:
    """Corners of every drawn triangle, world meters.  -> (T, 3, 3) float64, finite."""
    corners = [c for node in scene.mesh_nodes.tolist() if state.visible[node] for c in _triangles(scene, state, node)]
    triangles = np.concatenate([np.zeros((0, 3, 3)), *corners])
    return triangles[np.all(np.isfinite(triangles), axis=(1, 2))]


def moving_triangles(scene: Scene, poser: Poser) -> Iterator[tuple[Array, Array]]:
    """Triangles that move, appear or deform between successive times of the animation, at both times.

    Yields pairs of (T, 3, 3) float64, world meters; a triangle that is invisible at the earlier time is the same twice.
    """
    before = poser.sample(0.0)
    for t in _times(scene)[1:].tolist():
        after = poser.sample(t)
        pairs = []
        for node in scene.mesh_nodes[after.visible[scene.mesh_nodes]].tolist():
            if not _changed(scene, node, before, after):
                continue
            now = _triangles(scene, after, node)
            then = _triangles(scene, before, node) if before.visible[node] else now
            pairs += zip(then, now, strict=True)
        if pairs:
            then, now = (np.concatenate(side) for side in zip(*pairs, strict=True))
            finite = np.all(np.isfinite(then), axis=(1, 2)) & np.all(np.isfinite(now), axis=(1, 2))
            yield then[finite], now[finite]
        before = after


def _times(scene: Scene) -> Array:
    """Seconds, ascending: evenly over the animation, and its key times if they are few, as motion changes there."""
    count = min(int(scene.duration * TIMES_PER_SECOND) + 2, MAX_TIMES) if scene.channels else 1
    times = np.linspace(0.0, scene.duration, count)
    keys = np.unique(np.concatenate([times[:1], *(c.times for c in scene.channels)]))
    return np.union1d(times, keys[keys >= 0.0]) if len(keys) <= MAX_TIMES else times


def _changed(scene: Scene, node: int, before: FrameState, after: FrameState) -> bool:
    skin = int(scene.nodes.skin[node])
    moved = scene.skins[skin].joints if skin >= 0 else [node]
    if not before.visible[node] or np.any(before.world[moved] != after.world[moved]):
        return True
    return node in after.weights and bool(np.any(before.weights[node] != after.weights[node]))


def surface_points(triangles: Array, budget: int = SAMPLES) -> Array:
    """Points on triangles (T, 3, 3) by area, corners included; without triangles: of a unit box.  -> (P, 3) float64."""
    if not len(triangles):
        return np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])
    area = areas(triangles)
    count = np.floor(area / max(float(area.sum()), 1e-300) * budget).astype(np.int64)
    u, v = np.random.default_rng(0).random((int(count.sum()), 2)).T
    beyond = u + v > 1
    u, v = np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)
    corners = 3 * len(triangles)
    points = np.empty((corners + len(u), 3))
    points[:corners] = triangles.reshape(-1, 3)
    a, b, c = np.moveaxis(triangles, 1, 0)
    for k in range(3):  # axis by axis, which takes a third of the time of rows of three
        start, along, across = (np.repeat(side[:, k], count) for side in (a, b - a, c - a))
        points[corners:, k] = start + u * along + v * across
    return points


def areas(triangles: Array) -> Array:
    """Areas of triangles.  (T, 3, 3) -> (T,)."""
    return 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)


def winding_number(triangles: Array, point: Array) -> float:
    """Winding number of triangles (T, 3, 3) around a point, by the solid angles of Van Oosterom and Strackee (1983).

    1 inside a closed surface that faces outwards, 0 outside, -1 in a room whose walls face inwards.
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", *pair) for pair in ((a, b), (b, c), (c, a))]
    angle = 2.0 * np.arctan2(volume, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    return float(angle.sum() / (4.0 * np.pi))


def _triangles(scene: Scene, state: FrameState, node: int) -> list[Array]:
    """World corners (T, 3, 3) of each primitive of a node and of each instance."""
    out = []
    instances = scene.nodes.instances.get(int(node))
    for primitive in scene.primitives(node):
        if instances is None or is_skinned(scene, node, primitive):
            out.append(pose_vertices(scene, state, node, primitive)[primitive.triangles])
            continue
        for place in state.world[node] @ instances:
            out.append(math3d.transform_points(place, primitive.positions.astype(np.float64))[primitive.triangles])
    return out
