"""Camera tracks: a camera of the file, or a framing orbit for a scene without cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from pyrr import matrix44

from taubench_gl import math3d
from taubench_gl.animation.pose import Poser, is_skinned, pose_vertices
from taubench_gl.animation.state import FrameState, View
from taubench_gl.errors import SettingsError
from taubench_gl.scene.model import Camera, Scene

Array = np.ndarray

ORBIT_PERIOD = 10.0
"""Seconds per revolution of the framing orbit: 36 degrees a second, 1.5 degrees a frame at 24 fps."""

ORBIT_YFOV = math.radians(45.0)
ORBIT_ELEVATION = math.radians(20.0)
"""Radians above the horizon: shows the tops of objects; a look-at along +Y would be undefined."""

ORBIT_MARGIN = 1.1
"""The bounding sphere covers 1 / 1.1 of the image height."""

BOUNDS_SAMPLES = 5
"""Number of times, evenly spaced over the animation with both ends, at which the orbit's bounds are evaluated."""


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
        return f"camera '{self.name}' (node '{self.node_name or self.node}')"

    def view_at(self, state: FrameState) -> View:
        world_from_node = state.world[self.node]
        rotation = math3d.orthonormal(world_from_node[:3, :3])
        return View(world_from_node[:3, 3].copy(), rotation, state.cameras[self.index])


class OrbitCamera:
    """Orbits the scene about +Y, once in ``period`` seconds, from the +Z side towards +X.

    The orbit does not make a scene animated: a still scene has duration 0 and one frame.  A caller that needs motion
    uses ``period`` as the duration.
    """

    period = ORBIT_PERIOD
    name = "framing orbit"

    def __init__(self, scene: Scene, poser: Poser | None = None):
        poser = poser or Poser(scene)
        times = np.linspace(0.0, scene.duration, BOUNDS_SAMPLES) if scene.duration > 0 else [0.0]
        self.center, self.radius = bounding_sphere(poser, times)
        self.distance = ORBIT_MARGIN * self.radius / math.sin(0.5 * ORBIT_YFOV)
        # Half the gap in front of the sphere and the same behind it: the sphere is never clipped.
        gap = 0.5 * (self.distance - self.radius)
        self.camera = Camera(
            name=self.name,
            yfov=ORBIT_YFOV,
            znear=self.distance - self.radius - gap,
            zfar=self.distance + self.radius + gap,
        )

    def describe(self) -> str:
        return "framing orbit (the scene has no camera)"

    def view_at(self, state: FrameState) -> View:
        turn = 2.0 * math.pi * math.fmod(state.time, self.period) / self.period
        level = math.cos(ORBIT_ELEVATION)
        towards_camera = np.array([level * math.sin(turn), math.sin(ORBIT_ELEVATION), level * math.cos(turn)])
        # pyrr multiplies row vectors, so the upper left of its view matrix is world_from_view.  The eye is a unit
        # direction from the origin: pyrr's subtraction loses precision far from the origin.
        look_at = matrix44.create_look_at(towards_camera, np.zeros(3), np.array([0.0, 1.0, 0.0]), dtype=np.float64)
        return View(self.center + self.distance * towards_camera, look_at[:3, :3], self.camera)


def choose_camera(scene: Scene, requested: str | int | None = None) -> CameraTrack:
    """The requested camera.

    ``requested``: the name of a node, the name of a camera, or an index into ``scene.camera_nodes`` (a number, or its
    text if no name matches).  Names are tried in this order; the first match in file order is used.  None: the file's
    default (``Scene.default_camera``), else its first camera, or an ``OrbitCamera`` where there is none.  Raises
    SettingsError, which lists the cameras.
    """
    tracks = [FileCamera(scene, node) for node in scene.camera_nodes]
    if requested is None:
        named = [track for track in tracks if track.node_name == scene.default_camera]
        return (named or tracks)[0] if tracks else OrbitCamera(scene)
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
    listed = ", ".join(f"{i}: {track.describe()}" for i, track in enumerate(tracks))
    raise SettingsError(
        f"no camera {requested!r} in scene {scene.name!r}",
        hint=f"choose from {listed}" if tracks else "the scene has no camera; omit the option for a framing orbit",
    )


def bounding_sphere(poser: Poser, times: Sequence[float] | Array) -> tuple[Array, float]:
    """A sphere around everything visible at ``times``: center (3,) float64 and radius > 0, world, scene units.

    Centered on the axis-aligned bounding box.  Rigid meshes contribute the eight corners of their local box, so the
    sphere can be larger than necessary; skinned and morphed meshes contribute their posed vertices.  Points that are
    not finite are ignored.  Nothing visible: a unit sphere at the origin; a single point: radius 1 around it.
    """
    scene, clouds = poser.scene, []
    for t in times:
        state = poser.sample(t)
        clouds += [_drawn_points(scene, state, node) for node in scene.mesh_nodes if state.visible[node]]
    points = np.concatenate(clouds) if clouds else np.zeros((0, 3))
    points = points[np.all(np.isfinite(points), axis=-1)]
    if not len(points):
        return np.zeros(3), 1.0
    center = 0.5 * points.min(axis=0) + 0.5 * points.max(axis=0)
    radius = float(np.linalg.norm(points - center, axis=-1).max())
    return center, radius if radius > 0 else 1.0


def bounding_box(poser: Poser, times: Sequence[float] | Array) -> tuple[Array, Array]:
    """Low and high corner, world, (3,) each, of everything drawn at ``times``; a unit box where nothing is drawn."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for t in times:
        state = poser.sample(float(t))
        for node in poser.scene.mesh_nodes[state.visible[poser.scene.mesh_nodes]].tolist():
            points = _drawn_points(poser.scene, state, node)
            if len(points):
                low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    return (low, high) if np.all(np.isfinite(low)) else (np.full(3, -0.5), np.full(3, 0.5))


def _drawn_points(scene: Scene, state: FrameState, node: int) -> Array:
    """Points, world, whose convex hull contains the node's mesh.  -> (P, 3) float64."""
    clouds = [np.zeros((0, 3))]
    instances = scene.nodes.instances.get(int(node))
    for primitive in scene.meshes[scene.nodes.mesh[node]].primitives:
        if not len(primitive.triangles):
            continue
        if primitive.targets or is_skinned(scene, node, primitive):
            clouds.append(pose_vertices(scene, state, node, primitive))
            continue
        low, high = primitive.positions.min(axis=0), primitive.positions.max(axis=0)
        corners = np.array(np.meshgrid(*zip(low, high)), dtype=np.float64).reshape(3, 8).T
        if instances is None:
            clouds.append(math3d.transform_points(state.world[node], corners))
        else:
            world_from_instance = state.world[node] @ instances
            placed = np.einsum("kij,cj->kci", world_from_instance[:, :3, :3], corners)
            clouds.append((placed + world_from_instance[:, None, :3, 3]).reshape(-1, 3))
    return np.concatenate(clouds)
