"""The four scenes of demo 2, and where theory has their changes.  One camera, at the origin, for all of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from taubench_gl import math3d
from taubench_gl.conventions import DEFAULT_THRESHOLD
from taubench_gl.demos import theory
from taubench_gl.demos.props import BRICK, CHALK, SEA, Props
from taubench_gl.scene.model import Primitive, Scene
from taubench_gl.selftest.scenes import IDENTITY, turn, turn_x, turn_y

Array = np.ndarray
Size = tuple[int, int]
YFOV = np.radians(48.0)
TIMES = [0.0, 1.0]
WALL, FLOOR = -6.0, -1.5  # z of the back wall, y of the floor

BALL, BALL_AT = 0.75, ((-0.65, -0.1, -4.0), (0.55, -0.1, -4.0))
BLADES, TILT, FAN, FAN_AT = 12, 25.0, 1.35, (0.0, 0.0, -4.0)
SUN = np.array([[-0.75, -1.0, -0.55], [0.75, -1.0, -0.55]])  # where the light goes; it moves from right to left
SUN_LUX, SUN_BALL, SUN_AT = 4.0, 0.6, np.array([0.0, -0.55, -4.3])
PANEL = {"x": -1.5, "y": (-1.5, 0.3), "z": (-5.6, -3.2), "color": (0.85, 0.06, 0.04), "lux": 4.5}
PANEL_SUN = np.array([-1.0, -0.35, -0.25])


def _stage(reach: float = 5.0) -> Props:
    """Back wall and floor, ``2 reach`` wide, matt, and the camera.  A small stage has fine shadows."""
    b = Props()
    b.wall(reach, 0.5 * reach, CHALK, translation=(0, FLOOR + 0.5 * reach, WALL))
    b.wall(reach, 0.5 * reach, CHALK, translation=(0, FLOOR, WALL + 0.5 * reach), rotation=turn_x(-90))
    b.camera(yfov=YFOV, znear=0.05)
    return b


def aim(direction: Array) -> Array:
    """Quaternion xyzw that turns -Z along ``direction``.  (4,)"""
    x, y, z = math3d.normalize(np.asarray(direction, dtype=np.float64))
    return math3d.normalize(np.array([y, -x, 0.0, 1.0 - z]))


def moving_ball() -> Scene:
    b = _stage()
    ball = b.ball(BALL, BRICK, 64)
    b.animate(ball, "translation", TIMES, BALL_AT)
    b.light(kind="directional", intensity=3.0, rotation=aim(np.array([-0.5, -0.9, -1.0])))
    return b.build()


def turning_fan() -> Scene:
    b = _stage()
    fan = b.thing(fan_primitive(b.paint(SEA)), translation=FAN_AT)
    b.animate(fan, "rotation", TIMES, [IDENTITY, turn((0, 0, 1), 180.0 / BLADES)])
    b.light(kind="directional", intensity=6.0, rotation=aim(np.array([-1.0, -0.5, -0.8])))
    return b.build()


def fan_primitive(material: int, cuts: int = 8) -> Primitive:
    """A flat disc of BLADES sectors whose normals lean along the turn, by TILT to either side in turns."""
    edges = np.linspace(0.0, 2.0 * np.pi, BLADES * cuts + 1)
    positions, normals = [], []
    for i, (a, b) in enumerate(pairwise(edges)):
        blade = i // cuts
        middle = 2.0 * np.pi * (blade + 0.5) / BLADES
        lean = np.radians(TILT) * (1 if blade % 2 else -1)
        normal = [-np.sin(middle) * np.sin(lean), np.cos(middle) * np.sin(lean), np.cos(lean)]
        positions += [(0, 0, 0), (FAN * np.cos(a), FAN * np.sin(a), 0), (FAN * np.cos(b), FAN * np.sin(b), 0)]
        normals += [normal] * 3
    corners = np.array(positions, dtype=np.float32)
    triangles = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    return Primitive(corners, triangles, material, normals=np.array(normals, dtype=np.float32))


def moving_sun() -> Scene:
    b = _stage()
    b.ball(SUN_BALL, CHALK, 64, translation=SUN_AT)
    lamp = b.light(kind="directional", intensity=SUN_LUX)
    b.animate(lamp, "rotation", TIMES, [aim(d) for d in SUN], "STEP")
    return b.build()


def appearing_wall() -> Scene:
    b = _stage(9.0)
    (y0, y1), (z0, z1) = PANEL["y"], PANEL["z"]
    middle = (PANEL["x"], 0.5 * (y0 + y1), 0.5 * (z0 + z1))
    wall = b.wall(0.5 * (z1 - z0), 0.5 * (y1 - y0), PANEL["color"], translation=middle, rotation=turn_y(90))
    b.animate(wall, "visible", TIMES, [[0.0], [1.0]], "STEP")
    b.light(kind="directional", intensity=PANEL["lux"], rotation=aim(PANEL_SUN))
    return b.build()


def walls(direction: Array) -> tuple[Array, Array]:
    """Distance along view rays to floor or back wall, whichever comes first, and their normals.  (h, w), (h, w, 3)."""
    with np.errstate(divide="ignore"):
        floor = np.where(direction[..., 1] < 0, FLOOR / direction[..., 1], np.inf)
    back = WALL / direction[..., 2]
    on_floor = floor < back
    normal = np.where(on_floor[..., None], np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    return np.where(on_floor, floor, back), normal


def expected_ball(size: Size) -> dict[str, Array]:
    """(a) and (b) of the moving ball: f_pos and the order of distances, at every pixel."""
    rays = theory.pixel_rays(size, YFOV)
    behind, _ = walls(rays)
    before, now = (
        np.linalg.norm(rays, axis=-1) * np.minimum(behind, theory.hit_sphere(np.zeros(3), rays, np.array(at), BALL))
        for at in BALL_AT
    )
    return {"a": now - before > DEFAULT_THRESHOLD, "b": before - now > DEFAULT_THRESHOLD}


def expected_fan(size: Size) -> Array:
    """(c): pixels of the disc that another blade covers now."""
    rays = theory.pixel_rays(size, YFOV)
    x, y = rays[..., 0] * -FAN_AT[2], rays[..., 1] * -FAN_AT[2]
    angle = np.arctan2(y, x) % (2 * np.pi)
    blade, width = (lambda a: np.floor(a / width).astype(int) % BLADES), 2 * np.pi / BLADES
    return (np.hypot(x, y) < FAN) & (blade(angle) != blade(angle - 0.5 * width))


def expected_sun(size: Size) -> dict[str, Array]:
    """(d) to (g): Lambert's cosine and a shadow ray at every pixel, before and after."""
    rays = theory.pixel_rays(size, YFOV)
    ball = theory.hit_sphere(np.zeros(3), rays, SUN_AT, SUN_BALL)
    behind, normal = walls(rays)
    on_ball = ball < behind
    point = rays * np.where(on_ball, ball, behind)[..., None]
    normal = np.where(on_ball[..., None], (point - SUN_AT) / SUN_BALL, normal)
    bare, lit = [], []
    for way in SUN:
        to_light = -math3d.normalize(way)
        cosine = np.maximum(normal @ to_light, 0.0)
        free = np.isinf(theory.hit_sphere(point, np.broadcast_to(to_light, point.shape), SUN_AT, SUN_BALL * (1 - 1e-6)))
        radiance = SUN_LUX / np.pi * np.linalg.norm(CHALK) * cosine
        bare.append(radiance)
        lit.append(radiance * np.where(on_ball, 1.0, free))
    change, bare_change = lit[1] - lit[0], bare[1] - bare[0]
    came, went = change > DEFAULT_THRESHOLD, change < -DEFAULT_THRESHOLD
    bare_came, bare_went = bare_change > DEFAULT_THRESHOLD, bare_change < -DEFAULT_THRESHOLD
    return {"d": came & bare_came, "e": went & bare_went, "f": came & ~bare_came, "g": went & ~bare_went}


def expected_wall(size: Size) -> Array:
    """(h): one bounce off the lit red wall, on floor and back wall where they do not show the wall itself."""
    rays = theory.pixel_rays(size, YFOV)
    behind, normal = walls(rays)
    with np.errstate(divide="ignore"):
        hit = np.where(rays[..., 0] < 0, PANEL["x"] / rays[..., 0], np.inf)
    at = rays * np.where(np.isfinite(hit), hit, 0.0)[..., None]
    (y0, y1), (z0, z1) = PANEL["y"], PANEL["z"]
    shown = np.isfinite(hit) & (at[..., 1] > y0) & (at[..., 1] < y1) & (at[..., 2] > z0) & (at[..., 2] < z1)
    shown &= hit < behind
    point = rays * behind[..., None]
    x = PANEL["x"]
    corners = np.array([[x, y0, z0], [x, y1, z0], [x, y1, z1], [x, y0, z1]])
    factor = np.where(
        normal[..., 1] > 0.5,
        theory.form_factor(point, np.array([0.0, 1.0, 0.0]), corners),
        theory.form_factor(point, np.array([0.0, 0.0, 1.0]), corners),
    )
    before_it = point[..., 0] > x  # the red side
    light = (
        PANEL["lux"]
        * abs(math3d.normalize(PANEL_SUN)[0])
        * np.linalg.norm(np.array(PANEL["color"]) * np.array(CHALK))
        / np.pi
    )
    return before_it & ~shown & (light * factor > DEFAULT_THRESHOLD)
