"""Interactive cameras: fly, as in games, and orbit about a point.  Float64, no OpenGL."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from taubench_gl.animation import View
from taubench_gl.scene.model import Camera

Array = np.ndarray
MAX_PITCH = math.radians(89.0)
LOOK = math.radians(0.25)
"""Radians per pixel of mouse movement."""
TURN = math.radians(75.0)
"""Radians per second while a turning key is held."""
FAST = 5.0


def rotation(yaw: float, pitch: float) -> Array:
    """world_from_view (3, 3): yaw about +Y, then pitch about the camera's X; 0, 0 looks along -Z."""
    cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    return np.array([[cy, sy * sp, sy * cp], [0.0, cp, -sp], [-sy, cy * sp, cy * cp]])


def angles(world_from_view: Array) -> tuple[float, float]:
    """Yaw and pitch of a view, radians, without its roll."""
    back = world_from_view[:, 2]
    pitch = math.asin(float(np.clip(-back[1], -1.0, 1.0)))
    return math.atan2(float(back[0]), float(back[2])), float(np.clip(pitch, -MAX_PITCH, MAX_PITCH))


class UserCamera:
    """Position and direction for fly and orbit.  ``center`` (3,), ``radius``: bounding sphere of the scene."""

    def __init__(self, view: View, center: Array, radius: float):
        self.center, self.radius = np.asarray(center, dtype=np.float64), float(radius)
        self.reset(view)

    def reset(self, view: View) -> None:
        """Start from ``view``; the orbit keeps its distance to the center of the scene."""
        self.position = np.array(view.position, dtype=np.float64)
        self.yaw, self.pitch = angles(view.world_from_view)
        self.camera: Camera = view.camera

    def view(self) -> View:
        """The view of this camera."""
        return View(self.position.copy(), rotation(self.yaw, self.pitch), self.camera)

    def look(self, dx_px: float, dy_px: float) -> None:
        """Turn in place: a mouse movement to the right turns right, down turns down."""
        self._turn(-LOOK * dx_px, -LOOK * dy_px)

    def turn_about(self, dx_px: float, dy_px: float) -> None:
        """Orbit: the scene follows the mouse."""
        self._orbit(-LOOK * dx_px, -LOOK * dy_px)

    def zoom(self, steps: float) -> None:
        """Orbit: approach by 10 % per step, never past the center."""
        forward = -rotation(self.yaw, self.pitch)[:, 2]
        pivot, distance = self._pivot()
        self.position = pivot - forward * max(distance * 0.9**steps, 1e-3 * self.radius)

    def move(self, keys: Collection[str], seconds: float, mode: str) -> None:
        """Move by ``keys`` for ``seconds``: W A S D Q E (orbit: W S zoom); I J K L turn; SHIFT: FAST times as fast."""
        fast = FAST if "SHIFT" in keys else 1.0
        axis = {n: (a in keys) - (b in keys) for n, a, b in (
            ("x", "D", "A"), ("y", "E", "Q"), ("z", "S", "W"), ("yaw", "J", "L"), ("pitch", "I", "K"))}  # fmt: skip
        turn = TURN * seconds
        if mode == "orbit":
            self._orbit((axis["yaw"] + axis["x"]) * turn, (axis["pitch"] - axis["y"]) * turn)
            if axis["z"]:
                self.zoom(-8.0 * axis["z"] * seconds * fast)
            return
        self._turn(axis["yaw"] * turn, axis["pitch"] * turn)
        step = 0.4 * self.radius * seconds * fast
        world_from_view = rotation(self.yaw, self.pitch)
        self.position = self.position + step * (world_from_view @ np.array([axis["x"], 0.0, axis["z"]], np.float64))
        self.position[1] += step * axis["y"]

    def _turn(self, yaw: float, pitch: float) -> None:
        self.yaw = math.remainder(self.yaw + yaw, 2.0 * math.pi)
        self.pitch = min(max(self.pitch + pitch, -MAX_PITCH), MAX_PITCH)

    def _pivot(self) -> tuple[Array, float]:
        """The point on the view axis nearest to the center of the scene, (3,), and its distance."""
        forward = -rotation(self.yaw, self.pitch)[:, 2]
        distance = max(float((self.center - self.position) @ forward), 0.1 * self.radius)
        return self.position + distance * forward, distance

    def _orbit(self, yaw: float, pitch: float) -> None:
        pivot, distance = self._pivot()
        self._turn(yaw, pitch)
        self.position = pivot + distance * rotation(self.yaw, self.pitch)[:, 2]


def frustum_lines(view: View, aspect: float, reach: float) -> Array:
    """Edges of a view's frustum from the near plane to depth ``reach``, as pairs of points in world space.  (24, 3)."""
    c = view.camera
    corners = []
    for depth in (c.znear, max(reach, 2.0 * c.znear)):
        half = depth * math.tan(0.5 * c.yfov) if c.kind == "perspective" else c.ymag
        for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            corners.append(view.position + view.world_from_view @ np.array([x * half * aspect, y * half, -depth]))
    edges = [(i, (i + 1) % 4) for i in range(4)] + [(4 + i, 4 + (i + 1) % 4) for i in range(4)]
    edges += [(i, i + 4) for i in range(4)]
    return np.array([corners[i] for edge in edges for i in edge])
