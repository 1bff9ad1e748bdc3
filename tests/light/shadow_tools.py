"""A box on a plane and what light reaches the plane, by exact ray casting in float64."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from light_tools import Shot, facing, floor, lambert, look_down, opened, shoot

from taubench_gl.gpu.context import Gpu
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.scene.model import Scene

Array = np.ndarray
ALBEDO = 0.5


@dataclass(frozen=True)
class Case:
    """A light that shines on the box ``half`` about ``center`` from ``elevation`` and ``azimuth``, degrees.

    A ``wide spot`` looks aside, so that the box's foot is ``off_axis`` degrees from its axis, of 85 that it lights.
    """

    kind: str
    elevation: float
    azimuth: float = 0.0
    half: tuple[float, float, float] = (0.5, 0.5, 0.5)
    center: tuple[float, float, float] = (0.0, 0.5, 0.0)
    distance: float = 6.0
    ground: float = 4.0
    off_axis: float = 83.0

    @property
    def towards(self) -> Array:
        """Unit vector from the box's foot to the light."""
        e, a = np.radians(self.elevation), np.radians(self.azimuth)
        return np.array([np.cos(e) * np.cos(a), np.sin(e), np.cos(e) * np.sin(a)])

    @property
    def place(self) -> Array:
        return self.distance * self.towards + np.array([0.0, 0.5 * self.center[1], 0.0])

    @property
    def axis(self) -> Array:
        """Unit vector along which the light shines."""
        if self.kind != "wide spot":
            return -self.towards
        a, off = np.radians([self.azimuth, self.off_axis])
        return np.sin(off) * np.array([-np.sin(a), 0.0, np.cos(a)]) - np.cos(off) * self.towards

    def scene(self, *, with_box: bool = True, parts: int = 1) -> Scene:
        """``parts``: lights at one place that share the intensity."""
        b = SceneBuilder()
        material = lambert(b, ALBEDO)
        floor(b, self.ground, material=material)
        if with_box:
            b.node(mesh=b.mesh(box(self.half, material=material)), translation=self.center)
        outer = {"spot": 50.0, "wide spot": 85.0}.get(self.kind)
        fields = {} if outer is None else {"outer_cone": np.radians(outer), "inner_cone": np.radians(outer - 1.0)}
        fields |= {"kind": self.kind.removeprefix("wide "), "intensity": 10.0 / parts}
        for _ in range(parts):
            b.light(translation=self.place, rotation=facing(self.axis), **fields)
        look_down(b, self.ground)
        return b.build()

    def texel(self, shadow_size: int, points: Array) -> Array:
        """Size of a texel across the light's rays where they hit the plane, meters.  (..., 3) -> (...)."""
        if self.kind == "directional":
            radius = np.sqrt(2) * self.ground + 1.0  # at least the scene's bounding sphere with its margin
            return np.full(points.shape[:-1], 2.0 * radius * 1.05 / (4 * shadow_size))
        offset = points - self.place
        if self.kind == "spot":
            return 2.0 * np.tan(np.radians(50.0)) * 1.02 * (offset @ -self.towards) / shadow_size
        return 2.0 * np.abs(offset).max(axis=-1) / shadow_size

    def band(self, points: Array, texels: float, shadow_size: int) -> tuple[Array, Array]:
        """Points of the plane that are surely lit, and surely dark, for a map whose texels are what they are.

        A map may answer for any ray within ``texels`` of the point's own: surely lit is a point with no blocked ray
        among eight such neighbors where they meet the plane (under the box counts as blocked), surely dark one with
        no open ray.  (..., 3) -> (...), (...) bool.
        """
        size = texels * self.texel(shadow_size, points)[..., None]
        ray = np.broadcast_to(self.towards, points.shape) if self.kind == "directional" else self.place - points
        ray = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        side = np.cross(ray, [0.0, 1.0, 0.0]) + 1e-9 * np.array([1.0, 0.0, 0.0])
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        above = np.cross(side, ray)
        blocked = self.blocked(points)
        some, every = blocked.copy(), blocked.copy()
        for a in np.radians(np.arange(0, 360, 45)):
            q = points + size * (np.cos(a) * side + np.sin(a) * above)
            d = ray if self.kind == "directional" else self.place - q
            q = q - d * (q[..., 1:2] / d[..., 1:2])
            blocked = self.blocked(q)
            some, every = some | blocked, every & blocked
        return ~some, every

    def blocked(self, points: Array) -> Array:
        """Whether the box lies between each point and the light (or around the point)."""
        if self.kind == "directional":
            d = np.broadcast_to(self.towards, points.shape)
            reach = np.inf
        else:
            d, reach = self.place - points, 1.0
        low, high = np.array(self.center) - self.half, np.array(self.center) + self.half
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - points) / d, (high - points) / d
            outside = (points < low) | (points > high)
            near = np.where(d == 0, np.where(outside, np.inf, -np.inf), np.minimum(a, b)).max(axis=-1)
            far = np.where(d == 0, np.inf, np.maximum(a, b)).min(axis=-1)
        return (far > np.maximum(near, 0.0)) & (near < reach)


def visibility(gpu: Gpu, shadowed: Scene, **settings) -> tuple[Shot, Array]:
    """The frame, and the share of each pixel's light that its shadow map lets through.  (h, w), NaN where unlit."""
    settings = {"width": 160, "height": 160} | settings
    with opened(gpu, shadowed, **settings) as source:
        shot = shoot(source)
    with opened(gpu, shadowed, **(settings | {"shadow_lights": 0})) as source:
        bare = shoot(source)
    lit = bare.direct[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return shot, np.where(lit > 0, shot.direct[..., 0] / lit, np.nan)


def on_plane(shot: Shot) -> Array:
    """(h, w) bool: pixels that show the plane y = 0."""
    return shot.surface & (np.abs(shot.points[..., 1]) < 1e-4)
