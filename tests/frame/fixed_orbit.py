"""An orbit whose images are stored: goldens and path-traced references.  It must not change."""

from __future__ import annotations

import math

import numpy as np

from taubench_gl.animation import FrameState, Poser, View, bounding_sphere, choose_camera
from taubench_gl.animation.views import FileCamera, _orbit_axes
from taubench_gl.scene.model import Camera, Scene


class FixedOrbit:
    """Orbits the bounding sphere of five times of the animation, once in 10 s, from the +Z side towards +X."""

    name = "fixed orbit"
    period = 10.0

    def __init__(self, scene: Scene):
        times = np.linspace(0.0, scene.duration, 5) if scene.duration > 0 else [0.0]
        self.center, radius = bounding_sphere(Poser(scene), times)
        self.distance = 1.1 * radius / math.sin(math.radians(22.5))
        gap = 0.5 * (self.distance - radius)
        near, far = self.distance - radius - gap, self.distance + radius + gap
        self.camera = Camera(name=self.name, yfov=math.radians(45.0), znear=near, zfar=far)

    def describe(self) -> str:
        return self.name

    def view_at(self, state: FrameState) -> View:
        axes = _orbit_axes(2.0 * math.pi * math.fmod(state.time, self.period) / self.period)
        return View(self.center + self.distance * axes[:, 2], axes, self.camera)


def file_camera_or_fixed_orbit(scene: Scene) -> FileCamera | FixedOrbit:
    return choose_camera(scene) if len(scene.camera_nodes) else FixedOrbit(scene)
