"""Camera tracks: a camera of the file, or a framing orbit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

import numpy as np
from pyrr import matrix44

from taubench_gl import math3d
from taubench_gl.animation.curves import varies
from taubench_gl.animation.pose import Poser, is_skinned, moved_nodes, pose_once
from taubench_gl.animation.recorded_camera import RecordedCamera, read_camera_path
from taubench_gl.animation.state import FrameState, View
from taubench_gl.errors import SettingsError, printable
from taubench_gl.scene.model import Camera, Primitive, Scene
from taubench_gl.settings import SequenceSettings

Array = np.ndarray

ORBIT = "orbit"
"""The request for a framing orbit.  It takes precedence over a camera of this name, which has an index."""

ORBIT_YFOV = math.radians(45.0)
ORBIT_ELEVATION = math.radians(20.0)
"""Radians above the horizon: shows the tops of objects; a look-at along +Y would be undefined."""

ORBIT_FILL = 0.95
"""Share of the image height within which the subject stays, or of the width where that is the tighter limit."""

FOLLOW_SECONDS = 1.0
"""The position of a subject that travels is averaged over this time, so that its steps do not shake the camera."""

CLOSED = 0.75
"""Share of the directions from the middle of the scene in which a front face is the nearest surface, from which on it
is a room."""

ROOM_RADIUS = 0.8
"""Distance of the camera in a room from its middle, as a share of that of the nearest walls; the height likewise."""

ROOM_DIRECTIONS, ROOM_TRIANGLES, NEAR_WALLS = 256, 20_000, 10.0
"""Rays that look for walls; triangles that they meet, the largest as seen from the middle; percentile of the distances
of the walls that counts as the nearest: a pillar does not bring the camera to the middle."""

ORBIT_STEP = 0.02
"""Distance that the camera moves per frame at ORBIT_FPS, as a share of the subject's size."""

ORBIT_FPS = 24.0

STILL_SECONDS = 2.0
"""Duration of a still scene under the framing orbit or a caller's camera; a camera of the file gives one frame."""

NO_CAMERA = "the scene has no camera"
UNUSED_CAMERAS = "no node refers to the cameras of the file"
ALL_STILL = "the scene and its camera are still"
REQUESTED = "requested"
"""Reason for a framing orbit that the user asked for; the constants above are the other reasons."""

_HULL_POINTS = 32
"""Number of points below which a subject keeps them all, without a convex hull."""


class CameraTrack(Protocol):
    """A view for every state of the scene, as a pure function of that state."""

    name: str

    def describe(self) -> str:
        """Short description of the camera, for messages."""

    def view_at(self, state: FrameState) -> View:
        """The view at ``state.time``."""


class FileCamera:
    """Camera on node ``node``.  Scale, shear and mirror of the node's transform do not affect the view."""

    def __init__(self, scene: Scene, node: int):
        self.node = int(node)
        self.index = int(scene.nodes.camera[node])
        self.node_name = scene.nodes.names[self.node]
        self.name = scene.cameras[self.index].name or self.node_name or f"camera {self.index}"

    def describe(self) -> str:
        return printable(f"camera '{self.name}' (node '{self.node_name or self.node}')")

    def view_at(self, state: FrameState) -> View:
        world_from_node = state.world[self.node]
        rotation = math3d.orthonormal(world_from_node[:3, :3])
        return View(world_from_node[:3, 3].copy(), rotation, state.cameras[self.index])


class OrbitCamera:
    """Orbits the subject, everything that is drawn, about +Y, from the +Z side towards +X.

    Framing: over the animation, the projection of the subject fills ORBIT_FILL of the image height, or of the width
    where the subject is wider than the image, and is centered.  Exact for the posed vertices at ``times``.  A subject
    whose center travels by more than its own size is followed: the orbit is about that center, averaged over
    FOLLOW_SECONDS.  Around the middle of a closed room, whose surfaces face it on all sides, the camera moves inside
    the bounds and looks across.

    Motion: the camera moves ``step`` = ORBIT_STEP of ``subject_size`` per frame at ORBIT_FPS around the subject, both
    in scene units.  ``subject_size`` is the diagonal of the box that contains the subject over the animation, about
    the followed center, or in a room the diameter of the orbit.  The rotation per frame follows from the radius of the
    orbit, so it depends on the shape of the subject and of the image.

    ``size``: width and height of the image, pixels.  ``duration``: seconds; at least STILL_SECONDS if the scene is
    still.  The view is a pure function of the time.
    """

    name = "framing orbit"

    def __init__(self, scene: Scene, size: tuple[int, int] = (16, 9), reason: str = NO_CAMERA):
        self.reason = reason
        still, subject = is_still(scene), _Subject(Poser(scene))
        self.duration = max(scene.duration, STILL_SECONDS) if still else scene.duration
        self.times = np.linspace(0.0, self.duration, int(np.clip(12.0 * self.duration, 24, 96)) + 1)
        clouds = [subject.at(0.0)] * len(self.times) if still else [subject.at(t) for t in self.times]
        self._targets = _targets(self.times, clouds)  # world, one for each time
        relative = [cloud - target for cloud, target in zip(clouds, self._targets, strict=True)]
        points = np.concatenate(relative)
        self.center, half = self._targets[0], 0.5 * np.ptp(points, axis=0) if len(points) else np.zeros(3)
        self.subject_size = 2.0 * float(np.linalg.norm(half))
        if self.subject_size == 0.0:  # nothing, or a single point
            relative = [np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])] * len(self.times)
            self.subject_size = float(np.linalg.norm(np.ptp(relative[0], axis=0)))
        room = subject.room_around(self.center)
        if room is not None:
            self._stand_in_room(*room, 2.0 * float(np.linalg.norm(half)))
        else:
            self.step = ORBIT_STEP * self.subject_size
            self._frame(relative, size[0] / size[1])

    def _stand_in_room(self, walls: float, ceiling: float, far: float) -> None:
        """Orbit inside ``walls`` and ``ceiling``, distances from the center; ``far``: the longest that can be seen."""
        radius = ROOM_RADIUS * walls
        self.subject_size, self.step = 2.0 * radius, 2.0 * ORBIT_STEP * radius
        self.rate = ORBIT_FPS * 2.0 * math.asin(ORBIT_STEP)
        height = min(radius * math.tan(ORBIT_ELEVATION), ROOM_RADIUS * ceiling)
        up, back = math.sin(ORBIT_ELEVATION), math.cos(ORBIT_ELEVATION)
        self._offset = np.array([0.0, height * back - radius * up, height * up + radius * back])
        self.camera = Camera(name=self.name, yfov=ORBIT_YFOV, znear=1e-3 * far, zfar=far)

    def _frame(self, clouds: list[Array], aspect: float) -> None:
        """Find the rotation per second, the offset of the camera and the clipping planes."""
        slopes = ORBIT_FILL * math.tan(0.5 * ORBIT_YFOV) * np.array([aspect, 1.0])

        def framing(rate: float) -> tuple[Array, float, float]:
            """The camera in the rotating frame, (3,) scene units, and the range of planar depths, for a rotation of
            ``rate`` radians per second.
            """
            # The camera at (sx, sy, d) sees (x, y, z) inside the limits if |x - sx| <= slope_x (d - z), and so for y.
            upper, lower, depth = np.full(2, -np.inf), np.full(2, -np.inf), np.array([np.inf, -np.inf])
            for t, cloud in zip(self.times, clouds, strict=True):
                if not len(cloud):
                    continue
                turned = cloud @ _orbit_axes(rate * t)
                upper = np.maximum(upper, (turned[:, 2:] + turned[:, :2] / slopes).max(axis=0))
                lower = np.maximum(lower, (turned[:, 2:] - turned[:, :2] / slopes).max(axis=0))
                depth = np.array([min(depth[0], turned[:, 2].min()), max(depth[1], turned[:, 2].max())])
            distance = max(float((0.5 * (upper + lower)).max()), depth[1] + 0.02 * self.subject_size)
            shift = 0.5 * slopes * (upper - lower)
            return np.array([*shift, distance]), distance - depth[1], distance - depth[0]

        def surplus(rate: float) -> float:
            """How much faster than ``rate`` the camera must rotate to move by ``step`` per frame."""
            (sx, sy, d), _, _ = framing(rate)
            radius = math.hypot(sx, d * math.cos(ORBIT_ELEVATION) - sy * math.sin(ORBIT_ELEVATION))
            return ORBIT_FPS * 2.0 * math.asin(min(0.5 * self.step / radius, 1.0)) - rate

        # The framing depends on the rotation, and the rotation on the distance: a root exists between the two ends.
        from scipy.optimize import brentq  # imported late: 0.7 s

        self.rate = float(brentq(surplus, 0.0, ORBIT_FPS * math.pi, xtol=1e-12))
        self._offset, near, far = framing(self.rate)
        self.camera = Camera(name=self.name, yfov=ORBIT_YFOV, znear=0.5 * near, zfar=far + 0.5 * near)

    @property
    def period(self) -> float:
        """Seconds that one revolution of the orbit takes."""
        return 2.0 * math.pi / self.rate

    def describe(self, unit_scale: float | None = None) -> str:
        """Short description; with ``unit_scale``, scene units per meter, also the motion in meters."""
        if unit_scale is None:
            return f"{self.name} ({self.reason})"
        step = f"{self.step / unit_scale:.4g} m per frame at {ORBIT_FPS:g} fps"
        return f"{self.name} ({self.reason}): moves {step}, {100 * ORBIT_STEP:g} % of the subject's size"

    def view_at(self, state: FrameState) -> View:
        axes = _orbit_axes(self.rate * math.fmod(state.time, self.period))
        target = np.array([np.interp(state.time, self.times, along) for along in self._targets.T])
        return View(target + axes @ self._offset, axes, self.camera)


def _targets(times: Array, clouds: list[Array]) -> Array:
    """What the orbit is about at each of ``times``: the middle of the subject, (n, 3), world; see ``OrbitCamera``."""
    boxes = np.array([(c.min(axis=0), c.max(axis=0)) if len(c) else np.full((2, 3), np.nan) for c in clouds])
    there = np.isfinite(boxes[:, 0, 0])
    if not there.any():
        return np.zeros((len(times), 3))
    centers, sizes = boxes[there].mean(axis=1), np.linalg.norm(np.ptp(boxes[there], axis=1), axis=1)
    if np.linalg.norm(np.ptp(centers, axis=0)) <= np.median(sizes):
        return np.tile(0.5 * (boxes[there, 0].min(axis=0) + boxes[there, 1].max(axis=0)), (len(times), 1))
    from scipy.ndimage import uniform_filter1d  # imported late

    path = np.stack([np.interp(times, times[there], along) for along in centers.T], axis=1)
    return uniform_filter1d(path, max(round(FOLLOW_SECONDS / times[1]), 1), axis=0, mode="nearest")


def _orbit_axes(angle: float) -> Array:
    """world_from_view of the orbit at ``angle``, radians from +Z towards +X.  (3, 3) float64."""
    # pyrr multiplies row vectors, so the upper left of its view matrix is world_from_view.  The eye is a unit
    # direction from the origin: pyrr's subtraction loses precision far from the origin.
    level = math.cos(ORBIT_ELEVATION)
    eye = np.array([level * math.sin(angle), math.sin(ORBIT_ELEVATION), level * math.cos(angle)])
    return matrix44.create_look_at(eye, np.zeros(3), np.array([0.0, 1.0, 0.0]), dtype=np.float64)[:3, :3]


def is_still(scene: Scene, cameras: Iterable[int] = ()) -> bool:
    """Whether no animation that plays moves or changes anything drawn, any light or the cameras on nodes ``cameras``.

    Over the whole animation, whichever frames are evaluated.
    """
    nodes, cameras = scene.nodes, list(cameras)
    changing = [c for c in scene.channels if varies(c)]
    shown = np.concatenate([scene.mesh_nodes, scene.light_nodes, scene.joint_nodes, np.array(cameras, np.int64)])
    used = {
        "node": set(scene.mesh_nodes.tolist()),  # by morph weights
        "camera": set(nodes.camera[cameras].tolist()),
        "light": set(nodes.light[scene.light_nodes].tolist()),
    }
    return not (moved_nodes(scene, changing)[shown].any() or any(c.index in used[c.target] for c in changing))


def choose_camera(
    scene: Scene, requested: str | int | None = None, size: tuple[int, int] = (16, 9)
) -> FileCamera | OrbitCamera:
    """The requested camera.

    ``requested``: ORBIT, the name of a node, the name of a camera, or an index into ``scene.camera_nodes`` (a number,
    or its text if no name matches).  Names are tried in this order; the first match in file order is used.  None: the
    file's default (``Scene.default_camera``), else its first camera, or an ``OrbitCamera`` where there is none.
    ``size``: of the image that an orbit frames, pixels.  Raises SettingsError, which lists the cameras.
    """
    tracks = [FileCamera(scene, node) for node in scene.camera_nodes]
    without = UNUSED_CAMERAS if scene.cameras else NO_CAMERA
    if requested is None:
        named = [track for track in tracks if track.node_name == scene.default_camera]
        return (named or tracks)[0] if tracks else OrbitCamera(scene, size=size, reason=without)
    if requested == ORBIT:
        return OrbitCamera(scene, size=size, reason=REQUESTED if tracks else without)
    if isinstance(requested, str) and requested:
        for track in tracks:
            if track.node_name == requested:
                return track
        for track in tracks:
            if scene.cameras[track.index].name == requested:
                return track
    if isinstance(requested, int) or requested.isdecimal():
        index = int(requested)
        if 0 <= index < len(tracks):
            return tracks[index]
    listed = ", ".join([*(f"{i}: {track.describe()}" for i, track in enumerate(tracks)), f"{ORBIT}: a framing orbit"])
    raise SettingsError(f"no camera {requested!r} in scene {scene.name!r}", hint=f"choose from {listed}")


def camera_of_run(
    scene: Scene, sequence: SequenceSettings, unit_scale: float = 1.0
) -> FileCamera | OrbitCamera | RecordedCamera:
    """The camera of an evaluation: as requested; an orbit where none is and the file's camera sees nothing move.

    ``unit_scale``: scene units per meter, for a recorded camera.  Raises SceneError, SettingsError.
    """
    size = (sequence.width, sequence.height)
    camera = choose_camera(scene, sequence.camera, size)
    if sequence.camera_path is not None:
        base = camera.view_at(Poser(scene, sequence.fps).sample(0.0))
        return RecordedCamera(scene, read_camera_path(sequence), sequence.camera_path_place, base, unit_scale)
    if sequence.camera is None and isinstance(camera, FileCamera) and is_still(scene, [camera.node]):
        return OrbitCamera(scene, size=size, reason=ALL_STILL)
    return camera


def bounding_sphere(poser: Poser, times: Sequence[float] | Array) -> tuple[Array, float]:
    """A sphere around everything visible at ``times``: center (3,) float64 and radius > 0, world, scene units.

    Centered on the axis-aligned bounding box.  Rigid meshes contribute the eight corners of their local box, so the
    sphere can be larger than necessary; skinned and morphed meshes contribute their posed vertices.  Points that are
    not finite are ignored.  Nothing visible: a unit sphere at the origin; a single point: radius 1 around it.
    """
    points = np.concatenate([np.zeros((0, 3)), *_drawn_clouds(poser, times)])
    points = points[np.all(np.isfinite(points), axis=-1)]
    if not len(points):
        return np.zeros(3), 1.0
    center = 0.5 * points.min(axis=0) + 0.5 * points.max(axis=0)
    radius = float(np.linalg.norm(points - center, axis=-1).max())
    return center, radius if radius > 0 else 1.0


def bounding_box(poser: Poser, times: Sequence[float] | Array) -> tuple[Array, Array]:
    """Low and high corner, world, (3,) each, of everything drawn at ``times``; a unit box where nothing is drawn."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for points in _drawn_clouds(poser, times):
        if len(points):
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    return (low, high) if np.all(np.isfinite(low)) else (np.full(3, -0.5), np.full(3, 0.5))


def _drawn_clouds(poser: Poser, times: Sequence[float] | Array) -> Iterator[Array]:
    """``_drawn_points`` of every node that is drawn at one of ``times``; of those that nothing moves, once."""
    scene, boxes = poser.scene, {}
    nodes = scene.mesh_nodes
    morphed = [any(p.targets for p in scene.primitives(node)) for node in nodes.tolist()]
    changes = moved_nodes(scene, scene.channels)[nodes] | (scene.nodes.skin[nodes] >= 0) | np.array(morphed, dtype=bool)
    for number, t in enumerate(times):
        state = poser.sample(float(t))
        at = nodes[changes] if number else nodes
        for node in at[state.visible[at]].tolist():
            yield _drawn_points(scene, state, node, boxes)


def _drawn_points(scene: Scene, state: FrameState, node: int, boxes: dict[int, Array]) -> Array:
    """Points, world, whose convex hull contains the node's mesh.  -> (P, 3) float64.

    ``boxes``: corners of the boxes of rigid primitives that were needed before, by their id.
    """
    clouds, posed = [np.zeros((0, 3))], {}
    instances = scene.nodes.instances.get(int(node))
    for primitive in scene.primitives(node):
        if primitive.targets or is_skinned(scene, node, primitive):
            clouds.append(pose_once(posed, scene, state, node, primitive))
            continue
        if id(primitive) not in boxes:
            boxes[id(primitive)] = math3d.box_corners(primitive.positions)
        corners = boxes[id(primitive)]
        if instances is None:
            clouds.append(math3d.transform_points(state.world[node], corners))
        else:
            world_from_instance = state.world[node] @ instances
            placed = np.einsum("kij,cj->kci", world_from_instance[:, :3, :3], corners)
            clouds.append((placed + world_from_instance[:, None, :3, 3]).reshape(-1, 3))
    return np.concatenate(clouds)


class _Subject:
    """Everything drawn, as vertices that have the same convex hull."""

    def __init__(self, poser: Poser):
        self._poser = poser
        self._hulls: dict[int, Array] = {}  # of rigid primitives, by id
        self._used: dict[int, Array] = {}  # vertices of posed primitives, by the id of their triangles

    def at(self, time: float) -> Array:
        """Vertices of the subject at ``time`` seconds, world, scene units; those that are not finite are left out.  ->
        (P, 3) float64.
        """
        scene, state, clouds = self._poser.scene, self._poser.sample(float(time)), [np.zeros((0, 3))]
        posed: dict[tuple, Array] = {}
        for node in scene.mesh_nodes[state.visible[scene.mesh_nodes]].tolist():
            instances = scene.nodes.instances.get(node, np.eye(4)[None])
            for primitive in scene.primitives(node):
                if primitive.targets or is_skinned(scene, node, primitive):
                    clouds.append(pose_once(posed, scene, state, node, primitive)[self._used_by(primitive.triangles)])
                else:
                    local = self._hull_of(primitive)
                    clouds += [math3d.transform_points(state.world[node] @ instance, local) for instance in instances]
        points = np.concatenate(clouds)
        return _hull(points[np.all(np.isfinite(points), axis=-1)])

    def room_around(self, point: Array) -> tuple[float, float] | None:
        """Distances of the walls and of the ceiling around ``point`` (3,); None where it is not in a closed room.

        Of still surfaces at time 0, by rays in all directions (Moeller and Trumbore 1997) to the largest triangles.
        """
        a, b, c = np.moveaxis(self._still_triangles() - point, 1, 0)
        normal = np.cross(b - a, c - a)
        away = np.einsum("ij,ij->i", a, normal)  # > 0: a back face
        distance = np.linalg.norm((a + b + c) / 3.0, axis=1)
        size = np.abs(away) / np.maximum(distance, 1e-30) ** 3
        kept = np.argsort(size)[-ROOM_TRIANGLES:]
        a, b, c, normal, away = (each[kept] for each in (a, b, c, normal, away))
        found = []
        for ray in _directions(ROOM_DIRECTIONS):
            slope = normal @ ray
            with np.errstate(divide="ignore", invalid="ignore"):
                reach = away / slope
                hit = reach[:, None] * ray
                sides = [np.einsum("ij,ij->i", np.cross(q - p, hit - p), normal) for p, q in ((a, b), (b, c), (c, a))]
                inside = (reach > 0.0) & np.isfinite(reach) & (np.minimum.reduce(sides) >= 0.0)
            nearest = np.argmin(np.where(inside, reach, np.inf)) if inside.any() else None
            found.append((*ray, reach[nearest], slope[nearest] < 0.0) if nearest is not None else (*ray, np.inf, False))
        rays = np.array(found)
        front = rays[:, 4] == 1.0
        level, upward = front & (np.abs(rays[:, 1]) < 0.5), front & (rays[:, 1] > 0.9)
        if front.mean() < CLOSED or not level.any():
            return None
        walls = float(np.percentile(rays[level, 3] * np.hypot(rays[level, 0], rays[level, 2]), NEAR_WALLS))
        return walls, float(rays[upward, 3].min()) if upward.any() else walls

    def _still_triangles(self) -> Array:
        """Corners of the triangles of what no skin and no morph deforms, at time 0, front faces counter-clockwise.

        (T, 3, 3) float64, world; instances are left out.
        """
        scene, state, corners = self._poser.scene, self._poser.sample(0.0), [np.zeros((0, 3, 3))]
        for node in scene.mesh_nodes[state.visible[scene.mesh_nodes]].tolist():
            world_from_node = state.world[node]
            order = [0, 1, 2] if np.linalg.det(world_from_node[:3, :3]) > 0.0 else [0, 2, 1]
            for primitive in scene.primitives(node):
                if not (primitive.targets or is_skinned(scene, node, primitive) or node in scene.nodes.instances):
                    points = math3d.transform_points(world_from_node, primitive.positions.astype(np.float64))
                    corners.append(points[primitive.triangles[:, order]])
        return np.concatenate(corners)

    def _used_by(self, triangles: Array) -> Array:
        if id(triangles) not in self._used:
            self._used[id(triangles)] = np.unique(triangles)
        return self._used[id(triangles)]

    def _hull_of(self, primitive: Primitive) -> Array:
        if id(primitive) not in self._hulls:
            used = primitive.positions[np.unique(primitive.triangles)].astype(np.float64)
            self._hulls[id(primitive)] = _hull(used)
        return self._hulls[id(primitive)]


def _directions(count: int) -> Array:
    """Unit directions spread evenly over the sphere, (count, 3): a Fibonacci lattice."""
    y = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    return np.stack([np.sqrt(1.0 - y * y) * np.cos(angle), y, np.sqrt(1.0 - y * y) * np.sin(angle)], axis=1)


def _hull(points: Array) -> Array:
    """The vertices of the convex hull; all points where there are few or the hull has no volume."""
    if len(points) < _HULL_POINTS:
        return points
    from scipy.spatial import ConvexHull, QhullError  # imported late

    try:
        return points[ConvexHull(points - points.mean(axis=0)).vertices]
    except QhullError:
        return points
