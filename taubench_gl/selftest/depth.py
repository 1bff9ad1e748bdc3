"""Cases: depth precision over the whole range, and planes seen at grazing angles."""

from __future__ import annotations

import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Reason
from taubench_gl.scene.builder import SceneBuilder, quad, turn
from taubench_gl.scene.model import Camera
from taubench_gl.selftest.bench import Bench, pixel_grid, to_pixels
from taubench_gl.selftest.case import Outcome, case, count, field

RIGHT_ANGLE = np.radians(90.0)
EXACT = "exact: an unsigned count on the GPU"


@case(
    "depth-{0}",
    source="2e-6 is 17 float ulps of depth = near / z; " + EXACT,
    each=(("1m", 1.0, 1e6), ("1km", 1e3, 1e6), ("100km", 1e5, 1e6), ("infinite-far", 1e7, np.inf)),
)
def depth(bench: Bench, name: str, distance: float, zfar: float) -> Outcome:
    """Near 1e-4, far {2:g}: pixels of the nearer of two walls at {1:g} m, 2e-6 of that apart, drawn last.

    Both walls have the same 24-bit fixed-point depth, and the one drawn first stays visible.
    """
    znear = 1e-4
    b = SceneBuilder()
    camera = Camera(yfov=RIGHT_ANGLE)
    for far_away in (distance * (1 + 2e-6), distance):
        half = 1.5 * far_away * bench.size[0] / bench.size[1]
        b.node(translation=(0.0, 0.0, -far_away), mesh=b.mesh(quad(half, 1.5 * far_away)))
    b.camera(yfov=camera.yfov, znear=znear, zfar=zfar)
    frame, _ = bench.frame(b.build(), extra=("ids",))
    right = int((frame["ids"][..., 0] == 2).sum())
    return count(frame["ids"][..., 0].size, right)


@case("far-plane", source=EXACT)
def far_plane(bench: Bench) -> Outcome:
    """Near 1e-4, far 1e6: a wall at 0.9999 far is visible, a wall at 1.0001 far is not.

    The quotient far / (far - near) rounds to 1, so nothing or everything is clipped.
    """
    seen = []
    for factor in (0.9999, 1.0001):
        b = SceneBuilder()
        b.node(translation=(0.0, 0.0, -1e6 * factor), mesh=b.mesh(quad(5e6, 5e6)))
        b.camera(yfov=RIGHT_ANGLE, znear=1e-4, zfar=1e6)
        frame, _ = bench.frame(b.build())
        seen.append(int((frame["position"][..., 3] > 0).sum()))
    return count(bench.size[0] * bench.size[1], seen[0] - seen[1])


def _grazing(bench: Bench, degrees: float):
    """A plane 10 m ahead, its normal ``degrees`` from the view axis: (normal, point on it, positions, frame)."""
    b = SceneBuilder()
    tilt = turn((1.0, 0.0, 0.0), -degrees)
    b.node(translation=(0.0, 0.0, -10.0), rotation=tilt, mesh=b.mesh(quad(200.0, 200.0)))
    b.camera(yfov=RIGHT_ANGLE, znear=1e-3, zfar=1e4)
    frame, _ = bench.frame(b.build())
    a = np.radians(degrees)
    normal, anchor = np.array([0.0, np.sin(a), np.cos(a)]), np.array([0.0, 0.0, -10.0])
    return normal, anchor, frame["position"].astype(np.float64), frame


@case(
    "grazing-{0:g}",
    tolerance=1e-6,
    source="relative to the distance from the camera: 16 float ulps (transform, clipping, interpolation)",
    each=((80.0,), (89.0,), (89.9,)),
)
def grazing(bench: Bench, degrees: float) -> Outcome:
    """A plane seen at {0:g} degrees from its normal: distance of the stored points from the plane.

    Points stored as half floats or reconstructed from 24-bit depth do not lie on the plane.
    """
    normal, anchor, position, _ = _grazing(bench, degrees)
    surface = position[..., 3] > 0
    points = position[surface][:, :3]
    off = (points - anchor) @ normal / np.linalg.norm(points, axis=-1)
    return field(f"{int(surface.sum())} points on the plane", off)


@case(
    "grazing-own-pixel",
    tolerance=1.0 / 64.0,
    source="raster rule: corners snapped to 1/256 px, and again after clipping; the other half is float rounding",
)
def grazing_own_pixel(bench: Bench) -> Outcome:
    """Points of a plane seen at 89.9 degrees, projected again: distance from their pixel centers.

    Mixed pixel-center conventions: every point is off by half a pixel.
    """
    _, _, position, _ = _grazing(bench, 89.9)
    surface = position[..., 3] > 0
    at = to_pixels(position[..., :3], bench.size, Camera(yfov=RIGHT_ANGLE))
    return field("own pixel center, px", (at - pixel_grid(bench.size))[surface])


@case("previous-near-plane", source=EXACT)
def previous_near_plane(bench: Bench) -> Outcome:
    """A wall at 1 m, near plane 0.1 now and 2 before, then 0.1 before: pixels that were behind the previous camera.

    The near plane of the current camera decides: history that was clipped is read.
    """

    def behind(previous_near: float) -> int:
        now, then = (View(np.zeros(3), np.eye(3), Camera(znear=near)) for near in (0.1, previous_near))
        pair = reprojection(now, then, *bench.size)
        return int(bench.compare({}, {}, pair).has(Reason.BEHIND).sum())

    pixels = bench.size[0] * bench.size[1]
    counts = behind(2.0), behind(0.1)
    return Outcome(f"{pixels}, 0", f"{counts[0]}, {counts[1]}", float(pixels - counts[0] + counts[1]))
