"""Cases: precision of stored positions and motion, and GPU results against float64 references."""

from __future__ import annotations

import itertools

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Reason
from taubench_gl.features import FEATURES
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.metrics.reprojection import reproject
from taubench_gl.scene.builder import SceneBuilder, quad, turn, turn_y
from taubench_gl.scene.model import Camera
from taubench_gl.selftest.bench import Bench, limits, pixel_grid, rays, to_pixels
from taubench_gl.selftest.case import Outcome, case, count, field, worst
from taubench_gl.selftest.scenes import busy_room

Array = np.ndarray


def _fast_turn(bench: Bench):
    b = SceneBuilder()
    b.node(translation=(0.0, -500.0, 0.0), mesh=b.mesh(quad()))
    camera = b.camera(yfov=np.radians(10.0))
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(0.0), turn_y(-80.0)])
    images = bench.pair(b.build())
    lens = Camera(yfov=np.radians(10.0))
    then = rays(bench.size, lens) @ math3d.mat3_from_quat(turn_y(-80.0)).T
    return images, to_pixels(then, bench.size, lens) - pixel_grid(bench.size)


@case(
    "motion-storage",
    tolerance=1e-5,
    source="relative; float32: matrices, and a quotient near its pole, which magnifies rounding by 6",
)
def motion_storage(bench: Bench) -> Outcome:
    """Motion of 1200 to 8000 px (a fast turn, 10-degree lens): relative error of the stored motion.

    Half floats have steps of 1 px above 1024 and 2 px above 2048.
    """
    images, expected = _fast_turn(bench)
    size = np.abs(expected[..., 0])
    return field(f"{size.min():.0f} to {size.max():.0f} px", (images.motion - expected)[..., 0] / size)


@case(
    "position-storage",
    tolerance=1e-5,
    source="relative; raster rule: corners snapped to 1/256 px move a point along its ray by less than this",
)
def position_storage(bench: Bench) -> Outcome:
    """Stored positions on the back wall of the busy room: distance from the wall, relative to the camera distance.

    Half-float positions are off by 1/2048: 2 mm at 4 m, 5 cm at 100 m, as large as many thresholds.
    """
    frame, view = bench.frame(busy_room(), 0.3)
    position = frame["position"].astype(float)
    # Points of the back wall z = -4, whose distance from it is known.
    world = position[..., :3] + view.position
    wall = (np.abs(world[..., 2] + 4.0) < 0.01) & (np.abs(frame["normal"][..., 2]) > 0.99)
    points, distance = world[wall], np.linalg.norm(position[wall][:, :3], axis=-1)
    return field("the wall z = -4", (points[:, 2] + 4.0) / distance if wall.any() else np.nan)


@case("masks-in-half-floats", source="exact: an unsigned count on the GPU")
def masks_in_half_floats(bench: Bench) -> Outcome:
    """A wall 100 m away that moves sideways by 1 mm per frame, threshold 1 cm: position discards.

    Half-float positions have steps of 6 cm at 100 m, so the wall is discarded.
    """
    wall = bench.wall(bench.size)
    position = wall["position"] * [100.0, 100.0, 100.0, 100.0]
    moved = position + [0.001, 0.0, 0.0, 0.0]
    # The motion is no multiple of the half-float step, so only rounding differs.
    now, then = {**wall, "position": moved}, {**wall, "position": position}
    return count(0, bench.compare(now, then, thresholds={"position": 0.01}).counts["position"])


@case(
    "motion-reference",
    tolerance=1e-3,
    source="px; float32: 64 ulps of coordinates up to 100 px, near the screen's edge",
)
def motion_reference(bench: Bench) -> Outcome:
    """The busy room: motion on the GPU against float64.

    Differences of projected world-space positions lose three digits.
    """
    images = bench.pair(busy_room(), (0.5, 0.75), reprojection="motion")
    position, before = (images.current[n].astype(np.float64) for n in ("position", "prev_position"))
    exact = reproject(images.pair, position, before)
    seen = ~exact.behind & ~exact.outside
    return field("float64 reference", (images.motion - exact.motion_px)[seen])


def _euler(yaw: float, pitch: float, roll: float) -> Array:
    """Quaternion of Ry Rx Rz, degrees."""
    y, x, z = turn((0.0, 1.0, 0.0), yaw), turn((1.0, 0.0, 0.0), pitch), turn((0.0, 0.0, 1.0), roll)
    return math3d.quat_multiply(math3d.quat_multiply(np.array(y), np.array(x)), np.array(z))


def _synthetic(view: View, size: tuple[int, int], rng: np.random.Generator) -> dict[str, Array]:
    """Channels of surfaces at smooth depths along the pixels' own rays, a tenth of it sky, the others random."""
    width, height = size
    x, y = np.meshgrid(
        (np.arange(width) - (width - 1) / 2) * 2 / height, ((height - 1) / 2 - np.arange(height)) * 2 / height
    )
    tangent = np.tan(view.camera.yfov / 2)
    rays = np.stack([x * tangent, y * tangent, -np.ones_like(x)], axis=-1)
    depth = 3.0 + np.sin(3.0 * x) + np.cos(5.0 * y)
    depth[(x - 0.4) ** 2 + y**2 < 0.2] = 1.2
    depth[rng.random(depth.shape) < 0.1] = 0.0
    position = np.concatenate([(rays * depth[..., None]) @ view.world_from_view.T, depth[..., None]], axis=-1)
    leaning = rng.normal([0.0, 0.0, 2.0], 0.2, (height, width, 3))
    channels = {
        "position": position, "normal": leaning / np.linalg.norm(leaning, axis=-1, keepdims=True),
        "prev_position": position[..., :3] + rng.normal(0.0, 0.1, (height, width, 3)),
        "direct": rng.exponential(0.1, (height, width, 3)), "indirect": rng.exponential(0.1, (height, width, 3)),
        "color": rng.random((height, width, 3)) * 0.3,
    }  # fmt: skip
    channels["direct"][rng.random((height, width)) < 0.02] = np.nan
    return {name: values.astype(np.float32).astype(np.float64) for name, values in channels.items()}


@case(
    "masks-{0}-{1}",
    tolerance=1e-3,
    source="float32: pixels whose distance or position is within rounding of its limit",
    each=tuple(itertools.product(("camera", "motion"), ("nearest", "bilinear"))),
)
def masks(bench: Bench, reprojected: str, sampling: str) -> Outcome:
    """Random channels of all features, {0} reprojection, {1} history: masks and motion against the float64 reference.

    One term of one feature is wrong, which a scene with a known answer may not show.
    """
    size, rng = (131, 77), np.random.default_rng(5)
    lens = Camera(yfov=1.1, znear=0.5, zfar=50.0)
    then = View(np.array([10.0, 2.0, -3.0]), math3d.mat3_from_quat(_euler(30.0, 0.0, 0.0)), lens)
    now = View(then.position + (0.3, -0.1, 0.6), math3d.mat3_from_quat(_euler(37.0, 0.0, 3.0)), lens)
    current, history = _synthetic(now, size, rng), _synthetic(then, size, rng)
    pair = reprojection(now, then, *size)
    modes = {"reprojection": reprojected, "sampling": sampling}
    images = bench.compare(current, history, pair, exposure=2.0, **modes)
    expected = pair_masks(current, history, pair, limits(None), exposure=2.0, **modes)
    off = [float((images.mask != expected.mask).mean())]
    for measured, feature in zip(images.counted.histograms.astype(np.int64), FEATURES, strict=True):
        tails = [np.cumsum(counts[:0:-1]) for counts in (measured, expected.histogram(feature))]
        off.append(worst(tails[0] - tails[1]) / images.mask.size)
    moved = np.abs(expected.motion_px).max(axis=-1)
    seen = (moved < 500.0) & ((expected.mask & Reason.INVALID) == 0)
    off.append(worst((images.motion - expected.motion_px)[seen]))
    return field("the reference", off)
