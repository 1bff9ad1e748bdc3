"""Cases: shadow maps against exact ray casting, in all six directions of a lamp, at edges, contacts and creases."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl import math3d
from taubench_gl.scene.builder import SceneBuilder, box, quad, turn, turn_x, turn_y
from taubench_gl.scene.model import Image, Scene, Texture
from taubench_gl.selftest.bench import Bench, Shot
from taubench_gl.selftest.case import Outcome, case, count, field
from taubench_gl.selftest.direct import ALBEDO, lambert, lambert_wall, off_peak
from taubench_gl.selftest.geometry import one_metre_per_pixel

Array = np.ndarray
EXACT = "exact: pixels within 2 texels of a shadow's edge, seen from the light, are not counted"
TEXELS = 256


@dataclass(frozen=True, slots=True)
class Block:
    """A box that casts a shadow: center and half extents (3,), world."""

    center: Array
    half: Array

    def hit(self, start: Array, end: Array, margin: Array) -> Array:
        """Whether segments (..., 3) meet the box, grown by ``margin`` (...); not the one they end on."""
        away = end - start
        with np.errstate(divide="ignore", invalid="ignore"):
            half = np.maximum(self.half + margin[..., None], np.minimum(self.half, 1e-3))
            reach = half * np.sign(away)
            enter, leave = ((self.center - start + sign * reach) / away for sign in (-1.0, 1.0))
        enter, leave = (np.where(np.isfinite(x), x, flat) for x, flat in ((enter, -np.inf), (leave, np.inf)))
        first, last = enter.max(axis=-1), leave.min(axis=-1)
        outside = (away == 0.0) & (np.abs(start - self.center) > half)
        nearest = 1e-3 / np.linalg.norm(away, axis=-1)  # 1 mm from either end
        return (first < np.minimum(last, 1.0 - nearest)) & (last > nearest) & ~outside.any(axis=-1)


def wrong_pixels(shot: Shot, blocks: Sequence[Block], lamp: Array, texel: float, *, where: Array | None = None) -> int:
    """Pixels that are dark where a ray reaches the lamp, or lit where none does.

    ``lamp``: (3,) place, far away for a parallel light; ``texel``: size of a texel at 1 m from it.  -1 where no pixel
    is dark or none is lit.
    """
    points = shot.points
    distance = np.linalg.norm(points - lamp, axis=-1)
    margin = 2.0 * texel * distance
    wide = np.any([b.hit(points, np.broadcast_to(lamp, points.shape), margin) for b in blocks], axis=0)
    narrow = np.any([b.hit(points, np.broadcast_to(lamp, points.shape), -margin) for b in blocks], axis=0)
    on_block = np.any([np.all(np.abs(points - b.center) <= b.half + 1e-3, axis=-1) for b in blocks], axis=0)
    counted = shot.surface & ~on_block if where is None else where & ~on_block
    dark, lit = counted & narrow, counted & ~wide
    got = shot.direct[..., 0] > 0.0
    return int((dark & got).sum() + (lit & ~got).sum()) if dark.any() and lit.any() else -1


AXES = ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0))
"""Axis and side of the faces of a cube."""


def _plates() -> list[Block]:
    """A plate in each of the six directions from the origin, each with a place and a shape of its own."""
    out = []
    for k, (axis, side) in enumerate(AXES):
        center, half = np.zeros(3), np.full(3, 0.01)
        u, v = (axis + 1) % 3, (axis + 2) % 3
        center[axis] = 2.0 * side
        center[u], center[v] = 0.5 - 0.1 * k, 0.3 + 0.1 * k
        half[u], half[v] = 0.6, 0.25 + 0.05 * k
        out.append(Block(center, half))
    return out


def _six_views(lamps: int) -> Scene:
    """A closed room around lamps at the origin, whose camera looks along another axis each second."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((4.0, 4.0, 4.0), inside=True, material=lambert(b))))
    for plate in _plates():
        b.node(mesh=b.mesh(box(plate.half, material=lambert(b))), translation=plate.center)
    for _ in range(lamps):
        b.light(intensity=50.0 / lamps)
    eye = b.camera(translation=(1.0, 1.25, 0.75), yfov=np.radians(100.0), znear=0.05)
    turns = [turn_y(-90), turn_y(90), turn_x(90), turn_x(-90), turn_y(180), turn_y(0)]
    b.animate(eye, "rotation", np.arange(6.0), turns, "STEP")
    return b.build()


@case(
    "six-faces-of-{0}",
    source=EXACT,
    each=(("a-lamp", 1, "One lamp"), ("ten-lamps", 10, "Ten lamps at one place")),
)
def cube(bench: Bench, name: str, lamps: int, lights: str) -> Outcome:
    """{2} amid six plates in a closed room, seen in six directions: pixels wrongly lit or dark.

    Cube-map faces swapped, mirrored or rotated; axes that the API flips; seams between faces.
    """
    shots = bench.shots(_six_views(lamps), range(6), shadow_size=TEXELS, shadow_filter="hard", shadow_lights=lamps)
    wrong = [wrong_pixels(shot, _plates(), np.zeros(3), 2.0 / TEXELS) for shot in shots]
    return count(0, -1 if min(wrong) < 0 else sum(wrong))


def _on_a_floor() -> SceneBuilder:
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(12.0, 12.0, material=lambert(b))), rotation=turn_x(-90.0))
    return b


def _table(bench: Bench, **light) -> tuple[SceneBuilder, list[Block]]:
    """A floor with a box standing on it, plates low and high above it, and one light."""
    blocks = [
        Block(np.array([-2.0, 0.75, 0.5]), np.array([1.0, 0.75, 0.5])),
        Block(np.array([3.0, 2.0, -1.0]), np.array([1.5, 0.05, 1.0])),
        Block(np.array([1.0, 0.4, 3.0]), np.array([1.0, 0.02, 0.75])),
    ]
    if "translation" in light:  # a leaf in front of the lamp
        blocks.append(Block(np.array(light["translation"]) + [0.4, -0.6, -0.5], np.array([0.2, 0.005, 0.2])))
    b = _on_a_floor()
    for block in blocks:
        b.node(mesh=b.mesh(box(block.half, material=lambert(b))), translation=block.center)
    b.camera(translation=(0.0, 6.0, 8.0), rotation=turn_x(-38.0), yfov=np.radians(60.0), znear=0.05)
    b.light(**light)
    return b, blocks


_SPOT = {
    "kind": "spot", "intensity": 50.0, "translation": (0.5, 6.0, 0.25), "rotation": turn_x(-90.0), "inner_cone": 0.1,
    "outer_cone": np.radians(50.0),
}  # fmt: skip
_SUN_AT = np.array([np.sin(np.radians(30.0)), np.cos(np.radians(30.0)), 0.0])
_SUN = {
    "kind": "directional", "intensity": 3.0,
    "rotation": math3d.quat_multiply(turn((0.0, 0.0, 1.0), -30.0), turn_x(-90.0)),
}  # fmt: skip


@case(
    "shadow-of-a-{0}",
    source=EXACT,
    each=(
        ("lamp", (0.5, 5.0, 0.25), 2.0 / TEXELS, {"translation": (0.5, 5.0, 0.25), "intensity": 50.0}),
        ("spot", (0.5, 6.0, 0.25), 2.5 / TEXELS, _SPOT), ("sun", tuple(1e5 * _SUN_AT), 36.0 / (4 * TEXELS) / 1e5, _SUN),
    ),
)  # fmt: skip
def table(bench: Bench, name: str, lamp: tuple[float, float, float], texel: float, light: dict[str, Any]) -> Outcome:
    """A {0} over a box that stands on a floor and plates above it: pixels wrongly lit or dark.

    A constant bias detaches shadows from what casts them, or surfaces shadow themselves.
    """
    b, blocks = _table(bench, **light)
    wrong = 0
    for shadow_filter in ("hard", "bilinear"):
        shot = bench.shots(b.build(), shadow_size=TEXELS, shadow_filter=shadow_filter)[0]
        on_floor = shot.surface & (np.abs(shot.points[..., 1]) < 1e-3)
        pixels = wrong_pixels(shot, blocks, np.array(lamp), texel, where=on_floor & _in_cone(shot, lamp, light))
        wrong = -1 if min(pixels, wrong) < 0 else wrong + pixels
    return count(0, wrong)


def _in_cone(shot: Shot, lamp: Sequence[float], light: dict) -> Array:
    """Pixels well inside the cone of a spot that shines down; all for other lights."""
    if light.get("kind") != "spot":
        return shot.surface
    to_point = shot.points - np.array(lamp)
    return -to_point[..., 1] > np.cos(0.95 * light["outer_cone"]) * np.linalg.norm(to_point, axis=-1)


@case("grazing-plane", source="exact: nothing else can cast")
def grazing_plane(bench: Bench) -> Outcome:
    """A wall under a sun 2 degrees above its plane and a lamp close to it: pixels that shadow themselves.

    A bias large enough for 45 degrees leaves stripes at 2.
    """
    wrong = 0
    for light in (
        {"kind": "directional", "rotation": turn_y(88.0), "intensity": 30.0},
        {"translation": (3.3, 4.7, -7.5), "intensity": 3.0},
    ):
        b = lambert_wall(bench)
        b.light(**light)
        for shadow_filter in ("hard", "bilinear"):
            maps = {"shadow_size": 64, "shadow_filter": shadow_filter}
            with_maps, without = (bench.shots(b.build(), shadow_lights=n, **maps)[0].direct for n in (1, 0))
            darker = (with_maps < (1.0 - 1e-5) * without).any(axis=-1)
            wrong += int(darker.sum()) if without.max() > 0.0 else -10_000
    return count(0, wrong)


@case("creases-in-a-room", source="exact: the room is convex, so nothing in it casts")
def creases_in_a_room(bench: Bench) -> Outcome:
    """A lamp in a room of eight sides with 16-texel maps: pixels darker than without shadow maps.

    The texel beside a crease shows the nearer wall, and a dark line runs along every edge of the room.
    """
    b = SceneBuilder()
    for i in range(8):
        wall = b.mesh(quad(2.0, 2.0, material=lambert(b, double_sided=True)))
        angle = np.radians(45.0 * i)
        reach = 2.0 / np.tan(np.pi / 8)
        b.node(mesh=wall, translation=(-reach * np.sin(angle), 0.0, -reach * np.cos(angle)), rotation=turn_y(45.0 * i))
    b.camera(translation=(0.0, 0.0, 1.0), yfov=np.radians(80.0), znear=0.05)
    b.light(translation=(0.4, 0.2, -0.3), intensity=20.0)
    maps = {"shadow_size": 16, "shadow_filter": "hard"}
    with_maps, without = (bench.shots(b.build(), shadow_lights=n, **maps)[0].direct[..., 0] for n in (1, 0))
    return count(0, int((with_maps < 0.99 * without).sum()) if without.max() > 0.0 else -1)


@case("filter-weights", tolerance=1e-4, source="of the peak; float32 weights")
def filter_weights(bench: Bench) -> Outcome:
    """The corner of a shadow in a map of 16 texels: every pixel against the bilinear weights of its four texels.

    Weights or texels in another order, or a filter half a texel off: blurred edges that are shifted.
    """
    side, height, edge = 16, 32.0, np.array([5.75, 4.5])  # of the plate, half way to the lamp: its shadow is twice that
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(80, 80, material=lambert(b))), translation=(0.0, 0.0, -height))
    b.node(mesh=b.mesh(quad(40, 40, material=lambert(b))), translation=(*(edge - 40.0), -0.5 * height))
    b.light(intensity=5e3)
    one_metre_per_pixel(b, bench, translation=(0.0, 0.0, 10.0))
    shot = bench.shots(b.build(), shadow_size=side, shadow_filter="bilinear")[0]
    wall = (shot.points[..., 2] < -height + 1e-3) & (np.abs(shot.points[..., :2]) < 0.85 * height).all(axis=-1)
    texel = (shot.points[..., :2] / height * 0.5 + 0.5) * side - 0.5
    low = np.clip(np.floor(texel), 0, side - 2)
    weight = np.clip(texel - low, 0.0, 1.0)
    lit = np.zeros(wall.shape)
    for x in (0, 1):
        for y in (0, 1):
            place = ((low + [x, y] + 0.5) / side * 2.0 - 1.0) * height
            open_ = (place >= 2.0 * edge).any(axis=-1)
            lit += open_ * np.abs(1 - x - weight[..., 0]) * np.abs(1 - y - weight[..., 1])
    d2 = np.sum(shot.points**2, axis=-1)
    full = ALBEDO / np.pi * 5e3 * height / np.where(wall, d2, 1.0) ** 1.5
    return field("bilinear weights", off_peak(shot.direct[..., 0][wall], (lit * full)[wall]))


@case("shadow-of-a-masked-leaf", source=EXACT)
def shadow_of_a_masked_leaf(bench: Bench) -> Outcome:
    """A leaf whose alpha mask cuts out every other column: pixels of its shadow wrongly lit or dark.

    The shadow of the whole quad: foliage casts blocks.
    """
    texels = np.full((1, 4, 4), 255, np.uint8)
    texels[0, 1::2, 3] = 100  # below the cutoff of 0.5
    nearest = dataclasses.replace(Texture(0).sampler, mag_filter=9728, min_filter=9728)
    b = SceneBuilder()
    leaf = lambert(b, alpha_mode="MASK", double_sided=True, base_color_texture=Texture(0, nearest))
    uv = np.float32([[0, 0], [1, 0], [0, 1], [1, 1]])
    b.node(mesh=b.mesh(quad(12.0, 12.0, material=lambert(b))), rotation=turn_x(-90.0))
    plate = dataclasses.replace(quad(2.0, 2.0, material=leaf), texcoords=(uv, None))
    b.node(mesh=b.mesh(plate), translation=(0.0, 2.0, 0.0), rotation=turn_x(-90.0))
    b.camera(translation=(0.0, 9.0, 0.0), rotation=turn_x(-90.0), yfov=np.radians(75.0), znear=0.05)
    b.light(translation=(6.0, 6.0, 0.0), intensity=50.0)
    scene = dataclasses.replace(b.build(), images=(Image("leaf", (4, 1), lambda: texels),))
    shot = bench.shots(scene, shadow_size=TEXELS, shadow_filter="hard")[0]
    columns = [Block(np.array([x, 2.0, 0.0]), np.array([0.5, 1e-4, 2.0])) for x in (-1.5, 0.5)]
    on_floor = shot.surface & (np.abs(shot.points[..., 1]) < 1e-3)
    wrong = wrong_pixels(shot, columns, np.array([6.0, 6.0, 0.0]), 2.0 / TEXELS, where=on_floor)
    return count(0, wrong)


@case("shadow-cache", source="exact: the same texels")
def shadow_cache(bench: Bench) -> Outcome:
    """A plate that moves and one that vanishes and returns: direct light against that of maps drawn from scratch.

    A cached map keeps the shadow of where the object was, or of a part of it.
    """
    b = _on_a_floor()
    plate = b.node(mesh=b.mesh(box((1.0, 0.1, 1.0), material=lambert(b))), translation=(-3.0, 2.0, 0.0))
    b.node(mesh=b.mesh(box((0.5, 0.1, 0.5), material=lambert(b))), translation=(0.5, 1.0, 0.0))
    other = b.node(mesh=b.mesh(box((0.4, 0.1, 0.4), material=lambert(b))), translation=(-2.0, 1.5, -1.5))
    b.animate(plate, "translation", [0.0, 1.0, 2.0], [(-3.0, 2.0, 0.0), (1.0, 2.0, 0.5), (1.0, 2.0, 0.5)])
    b.animate(other, "visible", [0.0, 3.0, 4.0], [[1.0], [0.0], [1.0]], "STEP")
    b.camera(translation=(0.0, 9.0, 0.0), rotation=turn_x(-90.0), yfov=np.radians(75.0), znear=0.05)
    b.light(translation=(0.0, 5.0, 0.0), intensity=50.0)
    scene = b.build()
    cached = bench.shots(scene, range(5), shadow_size=128)[1:]
    fresh = [bench.shots(scene, (n,), shadow_size=128)[0] for n in range(1, 5)]
    different = sum(int((a.direct != c.direct).any(axis=-1).sum()) for a, c in zip(cached, fresh, strict=True))
    moved = int((bench.shots(scene, (0,), shadow_size=128)[0].direct != fresh[0].direct).any(axis=-1).sum())
    return count(0, different if moved else -1)
