"""Demo 2, the paper's figure 2: which feature detects which change.  Letters are placed by the masks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taubench_gl import math3d
from taubench_gl.conventions import DEFAULT_THRESHOLD, Reason
from taubench_gl.demos import theory
from taubench_gl.demos.demo import Array, Expected, Lesson, Measured, beyond, percent
from taubench_gl.demos.sheet import as_bytes, gray_image, inset, letter, note, overlay
from taubench_gl.demos.stage import BRICK, CHALK, SEA, LitPair, Props, Stage, built
from taubench_gl.scene.builder import IDENTITY, turn, turn_x, turn_y
from taubench_gl.scene.model import Primitive

MIN_PIXELS = 8  # smallest region with a letter

# Scenes, all with the camera at the origin, and their regions in theory

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


def _stage(b: Props, reach: float = 5.0) -> None:
    """Add camera, diffuse back wall and floor, 2 ``reach`` meters wide.  A small stage has sharper shadows."""
    b.wall(reach, 0.5 * reach, CHALK, translation=(0, FLOOR + 0.5 * reach, WALL))
    b.wall(reach, 0.5 * reach, CHALK, translation=(0, FLOOR, WALL + 0.5 * reach), rotation=turn_x(-90))
    b.camera(yfov=YFOV, znear=0.05)


def aim(direction: Array) -> Array:
    """Quaternion xyzw that turns -Z along ``direction``.  (4,)"""
    x, y, z = math3d.normalize(np.asarray(direction, dtype=np.float64))
    return math3d.normalize(np.array([y, -x, 0.0, 1.0 - z]))


@built
def scene(b: Props) -> None:
    """A ball that moves in front of the wall; the scene of the first panel."""
    _stage(b)
    ball = b.ball(BALL, BRICK, 64)
    b.animate(ball, "translation", TIMES, BALL_AT)
    b.light(kind="directional", intensity=3.0, rotation=aim(np.array([-0.5, -0.9, -1.0])))


@built
def turning_fan(b: Props) -> None:
    """A fan that turns by half of a blade in its own plane."""
    _stage(b)
    fan = b.thing(fan_primitive(b.paint(SEA)), translation=FAN_AT)
    b.animate(fan, "rotation", TIMES, [IDENTITY, turn((0, 0, 1), 180.0 / BLADES)])
    b.light(kind="directional", intensity=6.0, rotation=aim(np.array([-1.0, -0.5, -0.8])))


def fan_primitive(material: int, cuts: int = 8) -> Primitive:
    """A flat disc of BLADES sectors; their normals tilt along the rotation by TILT, with alternating sign."""
    edges, blade = np.linspace(0.0, 2.0 * np.pi, BLADES * cuts + 1), np.arange(BLADES)
    rim = FAN * np.stack([np.cos(edges), np.sin(edges), np.zeros(len(edges))], axis=-1)
    corners = np.stack([np.zeros((len(edges) - 1, 3)), rim[:-1], rim[1:]], axis=1).reshape(-1, 3).astype(np.float32)
    middle, lean = 2.0 * np.pi * (blade + 0.5) / BLADES, np.radians(TILT) * np.where(blade % 2, 1, -1)
    normals = np.stack([-np.sin(middle) * np.sin(lean), np.cos(middle) * np.sin(lean), np.cos(lean)], axis=-1)
    triangles = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    return Primitive(corners, triangles, material, normals=normals.repeat(3 * cuts, axis=0).astype(np.float32))


@built
def moving_sun(b: Props) -> None:
    """A still ball, and a directional light that jumps from the right to the left."""
    _stage(b)
    b.ball(SUN_BALL, CHALK, 64, translation=SUN_AT)
    lamp = b.light(kind="directional", intensity=SUN_LUX)
    b.animate(lamp, "rotation", TIMES, [aim(d) for d in SUN], "STEP")


@built
def appearing_wall(b: Props) -> None:
    """A lit red wall that appears at the side of the stage and reflects red light on it."""
    _stage(b, 9.0)
    (y0, y1), (z0, z1) = PANEL["y"], PANEL["z"]
    middle = (PANEL["x"], 0.5 * (y0 + y1), 0.5 * (z0 + z1))
    wall = b.wall(0.5 * (z1 - z0), 0.5 * (y1 - y0), PANEL["color"], translation=middle, rotation=turn_y(90))
    b.animate(wall, "visible", TIMES, [[0.0], [1.0]], "STEP")
    b.light(kind="directional", intensity=PANEL["lux"], rotation=aim(PANEL_SUN))


def walls(direction: Array) -> tuple[Array, Array]:
    """Distance along view rays to the nearer of floor and back wall, and its normal.  (h, w), (h, w, 3)."""
    with np.errstate(divide="ignore"):
        floor = np.where(direction[..., 1] < 0, FLOOR / direction[..., 1], np.inf)
    back = WALL / direction[..., 2]
    on_floor = floor < back
    normal = np.where(on_floor[..., None], np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    return np.where(on_floor, floor, back), normal


def ball_distance(size: Size, at: Array) -> Array:
    """Distance from the camera to the surface at each pixel with the ball at ``at`` (3,).  (h, w) meters."""
    rays = theory.pixel_rays(size, YFOV)
    depth = np.minimum(walls(rays)[0], theory.hit_sphere(np.zeros(3), rays, at, BALL))
    return np.linalg.norm(rays, axis=-1) * depth


def expected_ball(size: Size) -> dict[str, Array]:
    """The regions (a) and (b) of the moving ball: discards by position, by the sign of the change in distance."""
    before, now = (ball_distance(size, np.array(at)) for at in BALL_AT)
    return {"a": now - before > DEFAULT_THRESHOLD, "b": before - now > DEFAULT_THRESHOLD}


def expected_fan(size: Size) -> dict[str, Array]:
    """The region (c): pixels of the disc that another blade covers now."""
    rays = theory.pixel_rays(size, YFOV)
    x, y = rays[..., 0] * -FAN_AT[2], rays[..., 1] * -FAN_AT[2]
    angle = np.arctan2(y, x) % (2 * np.pi)
    blade, width = (lambda a: np.floor(a / width).astype(int) % BLADES), 2 * np.pi / BLADES
    return {"c": (np.hypot(x, y) < FAN) & (blade(angle) != blade(angle - 0.5 * width))}


def sun_change(size: Size) -> tuple[Array, Array]:
    """Change of the norm of direct radiance, with and without shadows: cosine law, shadow rays.  (h, w) each."""
    rays = theory.pixel_rays(size, YFOV)
    ball = theory.hit_sphere(np.zeros(3), rays, SUN_AT, SUN_BALL)
    behind, normal = walls(rays)
    on_ball = ball < behind
    point = rays * np.where(on_ball, ball, behind)[..., None]
    normal = np.where(on_ball[..., None], (point - SUN_AT) / SUN_BALL, normal)
    bare, lit = [], []
    for direction in SUN:
        to_light = -math3d.normalize(direction)
        cosine = np.maximum(normal @ to_light, 0.0)
        free = np.isinf(theory.hit_sphere(point, np.broadcast_to(to_light, point.shape), SUN_AT, SUN_BALL * (1 - 1e-6)))
        radiance = SUN_LUX / np.pi * np.linalg.norm(CHALK) * cosine
        bare.append(radiance)
        lit.append(radiance * np.where(on_ball, 1.0, free))
    return lit[1] - lit[0], bare[1] - bare[0]


def by_light(came: Array, went: Array, bare_came: Array, bare_went: Array) -> dict[str, Array]:
    """The regions (d) to (g): light that comes or goes, with shadows only or already without them (``bare``)."""
    return {"d": came & bare_came, "e": went & bare_went, "f": came & ~bare_came, "g": went & ~bare_went}


def expected_wall(size: Size) -> dict[str, Array]:
    """The region (h): red light of one bounce on floor and back wall, outside the red wall itself."""
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
    return {"h": before_it & ~shown & (light * factor > DEFAULT_THRESHOLD)}


# Figure


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel of the figure.  ``measured`` and ``expected``: letter -> region (h, w) bool, measured and in theory."""

    title: str
    pair: LitPair
    reasons: tuple[Reason, ...]
    measured: Mapping[str, Array]
    expected: Mapping[str, Array]


def panels(stage: Stage, ball: LitPair) -> list[Panel]:
    """The panels of position, normal, direct and indirect.  ``ball``: the pair of the moving ball."""
    fan = stage.pair(turning_fan(), columns=("frustum", "normal", "color"))
    # The same pair without shadows: changes that remain are due to the light's angle, the others to shadows.
    columns = ("frustum", "direct", "color")
    sun, bare = (stage.pair(moving_sun(), columns=columns, **given) for given in ({}, {"shadow_lights": 0}))
    wall = stage.pair(
        appearing_wall(), columns=("frustum", "position", "indirect", "color"), indirect="rsm",
        indirect_samples=4096, width=4 * stage.size[1] // 3,
    )  # fmt: skip
    by_ball = {"a": ball.has(Reason.DISOCCLUDED), "b": ball.has(Reason.OCCLUDING)}
    by_wall = {"h": wall.has(Reason.INDIRECT) & ~wall.has(Reason.POSITION)}
    moved, light = (Reason.DISOCCLUDED, Reason.OCCLUDING), (Reason.LIT, Reason.SHADOWED)
    by_sun = by_light(*(pair.has(reason) for pair in (sun, bare) for reason in light))
    expected_sun = by_light(*(s * c > DEFAULT_THRESHOLD for c in sun_change(stage.size) for s in (1.0, -1.0)))
    return [
        Panel("position: a ball moves", ball, moved, by_ball, expected_ball(stage.size)),
        Panel("normal: a fan turns", fan, (Reason.NORMAL,), {"c": fan.has(Reason.NORMAL)}, expected_fan(stage.size)),
        Panel("direct: a light moves", sun, light, by_sun, expected_sun),
        Panel("indirect: a red wall appears", wall, (Reason.INDIRECT,), by_wall, expected_wall(wall.mask.shape[::-1])),
    ]


def run(stage: Stage, lesson: Lesson) -> Measured:
    """One panel per feature, with letters on the regions that it detects."""
    numbers, shown = {}, panels(stage, lesson.pair)
    for place, panel in enumerate(shown):
        marked = widened(overlay(panel.pair.mask, panel.pair.now["color"], *panel.reasons), stage.size[0])
        aside = (stage.size[0] - panel.pair.mask.shape[1]) // 2
        axes = lesson.sheet.panel(place % 2, place // 2, marked, panel.title)
        inset(axes, widened(as_bytes(panel.pair.before["color"][..., :3]), stage.size[0]), "previous frame")
        for name, region in panel.measured.items():
            if region.sum() >= MIN_PIXELS:
                x, row = theory.innermost_pixel(region)
                letter(axes, (x + aside, row), name)
            numbers[name] = percent(region), Expected.share(panel.expected[name])
        shares = (f"{name} {percent(region):.2f} %" for name, region in panel.measured.items())
        note(axes, ", ".join(shares) + " of the image")
    sun = shown[2].pair
    theory_at = beyond(np.abs(sun_change(stage.size)[0]))
    return Measured(numbers, lesson.threshold(sun.change("direct"), gray_image(sun), theory_at, Reason.DIRECT))


def widened(image: Array, width: int) -> Array:
    """``image`` (h, w, 3) uint8 in the middle of an image that is ``width`` pixels wide."""
    left = (width - image.shape[1]) // 2
    return np.pad(image, ((0, 0), (left, width - image.shape[1] - left), (0, 0)), constant_values=251)
