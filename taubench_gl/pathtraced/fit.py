"""Fits a pinhole camera to a position pass: world points against the pixels that show them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import View
from taubench_gl.errors import PathTracedError
from taubench_gl.scene.model import Camera

Array = np.ndarray
MAX_POINTS = 20_000
MIN_POINTS = 32
MAX_MEDIAN_PX = 0.25
"""Largest accepted median residual, pixels.  Distortion, shift, orthographic cameras and other spaces exceed it."""

_ROUNDS, _STEPS = 3, 8


@dataclass(frozen=True, slots=True)
class CameraFit:
    """The fitted camera and its residuals."""

    view: View
    median_px: float  # residual, pixels
    p95_px: float  # residual, pixels
    points: int  # pixels used

    def describe(self) -> str:
        return (
            f"estimated from the position pass ({self.points} pixels, residual median {self.median_px:.2g} px, "
            f"95 % below {self.p95_px:.2g} px)"
        )


@np.errstate(divide="ignore", invalid="ignore", over="ignore")  # a fit that diverges is refused
def fit_camera(
    position: Array, sky: Array, depth: Array | None = None, where: str | None = None, center: tuple[int, int] = (0, 0)
) -> CameraFit:
    """Least squares on pixel coordinates, float64, seven unknowns: position, rotation, field of view.

    ``position`` (h, w, 3): world points at pixel centers.  ``sky`` (h, w) bool.  ``depth`` (h, w): planar, meters; it
    makes the initial guess linear.  Pixels are square; the principal point is ``center`` pixels right and down of the
    image center, and in the center of the view that is returned.  ``where``: prefix of error messages.  Raises
    PathTracedError if the points are too few, too flat, or fit no pinhole camera.
    """
    h, w = sky.shape
    usable = ~sky & np.isfinite(position).all(axis=-1)
    if depth is not None:
        usable &= np.isfinite(depth) & (depth > 0)
    rows, columns = np.nonzero(usable)
    if len(rows) < MIN_POINTS:
        raise _no_camera(f"only {len(rows)} pixels see a surface", where)
    step = max(1, len(rows) // MAX_POINTS)
    rows, columns = rows[::step], columns[::step]
    points = position[rows, columns].astype(np.float64)
    screen = screen_of(columns - center[0], rows - center[1], w, h)
    origin_m = points.mean(axis=0)
    points -= origin_m  # far from the origin, the normal equations lose precision
    try:
        if depth is not None:
            guess = _from_depth(points, screen, depth[rows, columns].astype(np.float64))
        else:
            guess = _from_points(points, screen)
        inliers = np.ones(len(points), dtype=bool)
        for _ in range(_ROUNDS):
            guess = _refine(guess, points[inliers], screen[inliers])
            error = np.linalg.norm(_project(guess, points) - screen, axis=-1) * (0.5 * h)
            # Leave out filtered positions at edges, and pixels with motion blur.
            inliers = error <= max(0.01, 4.0 * float(np.median(error)))
    except (np.linalg.LinAlgError, OverflowError):
        raise _no_camera("the points it shows are too flat", where) from None
    rotation, origin, tangent = guess
    median, p95 = float(np.median(error)), float(np.percentile(error, 95))
    if not (math.isfinite(median) and median <= MAX_MEDIAN_PX):
        raise _no_camera(f"the best pinhole is {median:.3g} px off in the median", where)
    near = float(((points - origin) @ -rotation[:, 2]).min())
    camera = Camera(yfov=2.0 * math.atan(tangent), znear=max(1e-4, min(0.1, 0.1 * near)))
    return CameraFit(View(origin + origin_m, rotation, camera), median, p95, int(inliers.sum()))


def screen_of(columns: Array, rows: Array, width: int, height: int) -> Array:
    """Pixel centers on a screen of half-height 1, +x right, +y up.  (N,), (N,) -> (N, 2) float64."""
    x = (2.0 * np.asarray(columns, dtype=np.float64) + 1.0 - width) / height
    y = (height - 1.0 - 2.0 * np.asarray(rows, dtype=np.float64)) / height
    return np.stack([x, y], axis=-1)


Guess = tuple[Array, Array, float]
"""world_from_view rotation (3, 3), position (3,), tangent of half the vertical field of view."""


def _from_depth(points: Array, screen: Array, depth: Array) -> Guess:
    """First guess from planar depth z: P = c + z R (t x, t y, -1) is linear in R diag(t, t, 1) and c.  Points in a
    plane: ``_from_plane``.
    """
    rays = np.column_stack([screen, -np.ones(len(screen))]) * depth[:, None]
    solution, _, rank, _ = np.linalg.lstsq(np.column_stack([rays, np.ones(len(rays))]), points, rcond=1e-9)
    if rank < 4:  # all points lie in one plane
        return _from_plane(points, rays)
    axes = solution[:3].T  # columns t r1, t r2, r3 of the rotation R: their lengths give t
    lengths = np.linalg.norm(axes, axis=0)
    return _rotation(axes / lengths), solution[3], float(0.5 * (lengths[0] + lengths[1]) / lengths[2])


def _from_plane(points: Array, rays: Array) -> Guess:
    """First guess from points in a plane, the best of fixed fields of view: rigid alignment of unprojected depths with
    the points (Kabsch 1976).
    """
    best: tuple[float, Guess] | None = None
    center = points.mean(axis=0)
    for tangent in np.geomspace(0.02, 10.0, 160):
        unprojected = rays * [tangent, tangent, 1.0]
        unprojected_center = unprojected.mean(axis=0)
        rotation = _rotation((points - center).T @ (unprojected - unprojected_center))
        error = float(np.sum((points - center - (unprojected - unprojected_center) @ rotation.T) ** 2))
        if best is None or error < best[0]:
            best = error, (rotation, center - rotation @ unprojected_center, float(tangent))
    return best[1]


def _from_points(points: Array, screen: Array) -> Guess:
    """First guess by direct linear transform: x = (a P) / (c P), y = (b P) / (c P), homogeneous rows a, b, c."""
    scale = float(np.abs(points).max()) or 1.0
    thinned = slice(None, None, max(1, len(points) // 4000))
    p = np.column_stack([points[thinned] / scale, np.ones(len(points[thinned]))])
    x, y = screen[thinned, :1], screen[thinned, 1:]
    zero = np.zeros_like(p)
    _, values, vectors = np.linalg.svd(np.vstack([np.hstack([p, zero, -x * p]), np.hstack([zero, p, -y * p])]), False)
    if values[-2] < 1e-7 * values[0]:
        raise np.linalg.LinAlgError("flat")
    a, b, c = vectors[-1].reshape(3, 4)
    size = np.linalg.norm(c[:3])
    sign = 1.0 if np.median(p @ c) > 0 else -1.0  # visible points are in front of the camera
    a, b, c = (sign * row / size for row in (a, b, c))
    # With c scaled to unit length, |a| and |b| are both 1 / t for square pixels.
    tangent = 2.0 / (np.linalg.norm(a[:3]) + np.linalg.norm(b[:3]))
    world_from_view = _rotation(np.stack([a[:3] * tangent, b[:3] * tangent, -c[:3]], axis=1))
    origin = -np.linalg.solve(np.stack([a[:3], b[:3], c[:3]]), np.array([a[3], b[3], c[3]]))
    return world_from_view, origin * scale, float(tangent)


def _rotation(matrix: Array) -> Array:
    """The rotation nearest to a 3x3 matrix in the Frobenius norm; of a covariance, the best alignment (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def _project(guess: Guess, points: Array) -> Array:
    rotation, origin, tangent = guess
    view = (points - origin) @ rotation
    return view[:, :2] / (-view[:, 2:] * tangent)


def _refine(guess: Guess, points: Array, screen: Array) -> Guess:
    """Improve a guess by Gauss-Newton with the analytic Jacobian, in view axes: rotation w, translation d, log
    tangent.
    """
    for _ in range(_STEPS):
        rotation, origin, tangent = guess
        view = (points - origin) @ rotation
        x, y, z = view.T
        inverse = 1.0 / (-z * tangent)
        u, v = x * inverse, y * inverse
        zero = np.zeros_like(x)
        # view changes by -(w x view) - d, and d(u) = dx / (-z t) + u dz / (-z); likewise v.
        du_dview = np.stack([inverse, zero, -u / z], axis=-1)
        dv_dview = np.stack([zero, inverse, -v / z], axis=-1)
        jacobian = np.concatenate(
            [np.column_stack([np.cross(d, view), -d, -value]) for d, value in ((du_dview, u), (dv_dview, v))]
        )
        residual = np.concatenate([screen[:, 0] - u, screen[:, 1] - v])
        if not np.isfinite(residual).all():
            raise np.linalg.LinAlgError("diverged")
        scale = np.linalg.norm(jacobian, axis=0)
        step, _, rank, _ = np.linalg.lstsq(jacobian / scale, residual, rcond=1e-10)
        if rank < 7:
            raise np.linalg.LinAlgError("flat")
        step /= scale
        angle = float(np.linalg.norm(step[:3]))
        turn = math3d.mat3_from_quat(math3d.quat_from_axis_angle(step[:3], angle)) if angle > 0 else np.eye(3)
        guess = rotation @ turn, origin + rotation @ step[3:6], tangent * math.exp(step[6])
    return guess


def _no_camera(why: str, where: str | None) -> PathTracedError:
    hint = "give --camera-file or --scene-file"
    return PathTracedError(f"no camera can be estimated from the position pass: {why}", where=where, hint=hint)
