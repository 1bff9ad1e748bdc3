"""Cases: points behind the previous camera, sky, jitter, and the edge of the screen."""

from __future__ import annotations

import dataclasses

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import View
from taubench_gl.animation import pairs as pairing
from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.scene.builder import SceneBuilder, box, quad, turn, turn_y
from taubench_gl.scene.model import Camera, Primitive
from taubench_gl.selftest.bench import Bench, MovingCamera, pixel_grid, rays, still_pair, to_pixels
from taubench_gl.selftest.case import Outcome, case, count, field

Array = np.ndarray
RIGHT_ANGLE = np.radians(90.0)
EXACT = "exact: an unsigned count on the GPU"


def _room(**lens) -> tuple[SceneBuilder, int]:
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((4.0, 2.0, 4.0), inside=True)))
    return b, b.camera(**lens)


def _nothing_in_view(b: SceneBuilder) -> None:
    b.node(translation=(0.0, -500.0, 0.0), mesh=b.mesh(quad()))


@case("turn-180", source=EXACT)
def turn_180(bench: Bench) -> Outcome:
    """A camera in a closed room turns by 180 degrees: every point was behind the previous camera.

    Division by a negative w mirrors the point onto the screen, and it counts as reusable.
    """
    b, camera = _room(yfov=np.radians(60.0))
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(180.0)])
    images = bench.pair(b.build())
    bad = int((~np.isfinite(images.motion)).any(axis=-1).sum())
    pixels = images.mask.size
    outcome = count(pixels, images.counts["behind"])
    return outcome if not bad else Outcome(pixels, f"{bad} pixels of motion are NaN or Inf", float(bad))


@case("turn-180-sky", source=EXACT)
def turn_180_sky(bench: Bench) -> Outcome:
    """A camera with only sky in view turns by 180 degrees: every pixel was behind the previous camera.

    Sky at a large finite distance passes the w test and projects to the opposite side.
    """
    b = SceneBuilder()
    _nothing_in_view(b)
    camera = b.camera(yfov=np.radians(60.0))
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(180.0)])
    images = bench.pair(b.build())
    return count(images.mask.size, int((images.mask == (Reason.SKY | Reason.BEHIND)).sum()))


def _floor(bench: Bench, backwards: float):
    """One triangle of floor, 1 m below a camera that moves backwards; its near corners lie behind both cameras."""
    corners = np.float32([[-50, -1, 30], [50, -1, 30], [0, -1, -100]])
    floor = Primitive(corners, np.uint32([[0, 1, 2]]), normals=np.tile(np.float32([0, 1, 0]), (3, 1)))
    b = SceneBuilder()
    b.node(mesh=b.mesh(floor))
    camera = b.camera(yfov=RIGHT_ANGLE, znear=0.1, zfar=1000.0)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (0.0, 0.0, backwards)])
    images = bench.pair(b.build())
    ray = rays(bench.size, Camera(yfov=RIGHT_ANGLE))
    with np.errstate(divide="ignore"):
        depth = np.where(ray[..., 1] < 0, -1.0 / ray[..., 1], np.inf)
    with np.errstate(invalid="ignore"):
        point = ray * depth[..., None] + [0.0, 0.0, backwards]
    return images, point, images.surface


@case(
    "near-plane-crossing",
    source="closed form per pixel in float64; pixels within 0.01 px of the edge of the screen are excluded",
)
def near_plane_crossing(bench: Bench) -> Outcome:
    """A floor below a camera that moves backwards by 4 m: part of it was behind the previous camera.

    Points behind the camera appear upside down above the horizon.
    """
    images, point, floor = _floor(bench, 4.0)
    behind = -point[..., 2] <= 0.1
    at = to_pixels(point, bench.size, Camera(yfov=RIGHT_ANGLE))
    last = np.array(bench.size) - 1
    margin = np.abs(np.stack([at, at - last])).min(axis=(0, -1))
    outside = np.any((at < 0) | (at > last), axis=-1)
    tested = floor & (behind | (margin > 0.01))
    right = (images.has(Reason.BEHIND) == behind) & (images.has(FRUSTUM) == (behind | outside))
    return count(0, int((tested & ~right).sum()))


@case(
    "near-crossing-motion",
    tolerance=0.01,
    source="raster rule: corners are snapped to 1/256 px (error of half a step), magnified by the motion",
)
def near_crossing_motion(bench: Bench) -> Outcome:
    """Motion on a floor below a camera that moves backwards: one triangle with two corners behind the previous camera.

    A vertex shader divides by w, and the interpolation of the quotient is meaningless.
    """
    images, point, floor = _floor(bench, 4.0)
    shown = floor & (-point[..., 2] > 2.0) & ~images.has(Reason.BEHIND)
    expected = to_pixels(point, bench.size, Camera(yfov=RIGHT_ANGLE)) - pixel_grid(bench.size)
    return field("closed form, px", (images.motion - expected)[shown])


@case("w-exactly-zero", source=EXACT)
def w_exactly_zero(bench: Bench) -> Outcome:
    """Points exactly in the plane of the previous camera, w = 0.

    0/0 and x/0 are NaN and Inf; comparisons with NaN are false, so the pixel counts as reusable.
    """
    wall = bench.wall(bench.size)
    view = View(np.zeros(3), np.eye(3), Camera())
    before = View(np.array([0.0, 0.0, -1.0]), np.eye(3), Camera())
    images = bench.compare({}, wall, pairing.reprojection(view, before, *bench.size))
    good = images.has(Reason.BEHIND) & (images.motion == 0).all(axis=-1)
    return count(good.size, int(good.sum()))


@case("sky-rotation", tolerance=1e-3, source="px; float32 rounding of coordinates up to 100 px is 1e-5 px")
def sky_rotation(bench: Bench) -> Outcome:
    """Motion of the sky while the camera turns by 7 degrees about a skew axis.

    Sky has no motion vectors, so camera rotation smears it.
    """
    b = SceneBuilder()
    _nothing_in_view(b)
    camera = b.camera(yfov=np.radians(60.0))
    rotation = turn((1.0, 2.0, 0.5), 7.0)
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(0.0), rotation])
    images = bench.pair(b.build())
    lens = Camera(yfov=np.radians(60.0))
    then = rays(bench.size, lens) @ math3d.mat3_from_quat(rotation).T
    expected = to_pixels(then, bench.size, lens) - pixel_grid(bench.size)
    return field("closed form, px", images.motion - expected)


@case("sky-translation", source="exact: the same direction is transformed by the same matrix twice")
def sky_translation(bench: Bench) -> Outcome:
    """Sky while the camera moves by 40 m: no motion and no discard.

    Sky at a finite distance moves against the camera.
    """
    b = SceneBuilder()
    _nothing_in_view(b)
    camera = b.camera(yfov=np.radians(60.0))
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (40.0, 3.0, -10.0)])
    images = bench.pair(b.build())
    discarded = int(images.has(FRUSTUM | Reason.POSITION | Reason.NORMAL).sum())
    return field("0 px, no discard", np.append(images.motion.ravel(), discarded))


@case("still-jitter", tolerance=1e-3, source="px; float32 rounding of coordinates up to 100 px is 1e-5 px")
def still_jitter(bench: Bench) -> Outcome:
    """A still camera with sub-pixel jitter: motion after subtraction of the jitter.

    The jitter stays in the motion vectors, so a still image is resampled every frame.
    """
    b, _ = _room()
    lens = Camera(yfov=np.radians(60.0))
    jitters = {0.0: (0.375, -0.25), 1.0: (-0.125, 0.4375)}
    camera = MovingCamera(lambda t: View(np.array([0.1, 0.2, 1.0]), np.eye(3), lens, np.array(jitters[t])))
    images = bench.pair(b.build(), camera=camera)
    between = (np.array(jitters[1.0]) - np.array(jitters[0.0])) * [1.0, -1.0]
    return field("0 px", images.motion - between)


def _cockpit(bench: Bench):
    b = SceneBuilder()
    ship = b.node()
    b.node(ship, mesh=b.mesh(box((4.0, 2.0, 4.0), inside=True, cells=2)))
    b.camera(ship, translation=(0.3, 0.1, 0.7), rotation=turn((1.0, 3.0, 2.0), 33.0), yfov=np.radians(60.0))
    b.animate(ship, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (13.7, 2.3, -5.1)])
    b.animate(ship, "rotation", [0.0, 1.0], [turn_y(10.0), turn((2.0, 1.0, 0.3), 71.0)])
    return bench.pair(b.build(), reprojection="motion")


@case("screen-edge", source=EXACT + "; rounding is 1000 times smaller than the tolerance")
def screen_edge(bench: Bench) -> Outcome:
    """A camera inside a turning ship: the image is still, and edge pixels lie exactly on the limit of Eq. (3).

    Rounding by 1e-6 px moves part of the border outside: 0.1 % to 3 % of the image.
    """
    images = _cockpit(bench)
    return count(0, images.counts["frustum"])


@case("screen-edge-motion", tolerance=1e-3, source="float32: 32 ulps of 60 px")
def screen_edge_motion(bench: Bench) -> Outcome:
    """Motion of the pixels that a camera inside a turning ship sees: 0.

    Rounding of world-space positions leaves motion of several 1e-3 px in a still image.
    """
    return field("0 px", _cockpit(bench).motion)


@case("on-the-near-plane", source=EXACT + "; the tolerance is 80 float ulps")
def on_the_near_plane(bench: Bench) -> Outcome:
    """A still wall exactly on the near plane of a turned camera.

    Half of its pixels have depth near - 1 ulp and count as behind the camera.
    """
    b = SceneBuilder()
    camera = b.camera(rotation=turn((1.0, 3.0, 2.0), 33.0), yfov=RIGHT_ANGLE, znear=0.1, zfar=100.0)
    wall = quad(0.3, 0.2, cells=(12, 8))
    b.node(camera, translation=(0.0, 0.0, -0.1 * (1 + 1e-7)), mesh=b.mesh(wall))
    images = bench.pair(b.build())
    none = 0 if images.surface.any() else images.mask.size
    return count(0, images.counts["frustum"] + none)


@case("declared-first-frame", source=EXACT)
def first_frame(bench: Bench) -> Outcome:
    """The first frame, which has no history: every pixel has reason FIRST.

    History textures are uninitialized, so the first pair is undefined or all reusable.
    """
    garbage = {"position": np.full((bench.size[1], bench.size[0], 4), np.nan)}
    images = bench.compare({}, garbage, still_pair(bench.size), declared=int(Reason.FIRST))
    return count(images.mask.size, int((images.mask == Reason.FIRST).sum()))


@case("cut-of-a-surface", source="exact: the pixels of the surface")
def cut_of_a_surface(bench: Bench) -> Outcome:
    """A surface that replaces another one in half of the image: pixels without CUT there, or with a feature bit.

    The new surface is compared with the old one: the cut is a discard by position.
    """
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(4.0, 8.0)), translation=(-4.0, 0.0, -4.0))
    old = b.node(mesh=b.mesh(quad(4.0, 8.0)), translation=(4.0, 0.0, -4.0))
    new = b.node(mesh=b.mesh(quad(4.0, 8.0)), translation=(4.0, 0.0, -3.0))
    b.animate(old, "visible", [0.0, 1.0], [[1.0], [0.0]], "STEP")
    b.animate(new, "visible", [0.0, 1.0], [[0.0], [1.0]], "STEP")
    b.camera(yfov=1.0, znear=0.1)
    scene = dataclasses.replace(b.build(), replacements=frozenset({new}))
    images = bench.pair(scene, (0.0, 1.0))
    replaced = np.zeros_like(images.mask, dtype=bool)
    replaced[:, images.mask.shape[1] // 2 :] = True
    # The border between both halves is a pixel column wide and belongs to neither.
    inner = np.abs(np.arange(images.mask.shape[1]) - (images.mask.shape[1] - 1) / 2) > 1
    wrong = (images.mask == np.where(replaced, Reason.CUT, 0)) ^ True
    return count(0, int((wrong & inner).sum()))
