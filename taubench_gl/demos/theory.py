"""Theoretical values of the demos' numbers: closed forms in float64, independent of the engine.

View space unless stated otherwise: the camera is at the origin and looks along -Z; images have row 0 at the top.
"""

from __future__ import annotations

import math

import numpy as np

from taubench_gl.scene.model import Camera
from taubench_gl.selftest.bench import rays

Array = np.ndarray
Size = tuple[int, int]


def screen(yfov: float, size: Size, *, centers: bool = False) -> Array:
    """Corners of the image on the plane z = -1, counterclockwise.  (4, 2).

    ``centers``: corners of the rectangle through the outermost pixel centers, the valid range of Eq. (3).
    """
    width, height = size
    x, y = math.tan(0.5 * yfov) * width / height, math.tan(0.5 * yfov)
    if centers:
        x, y = x * (1 - 1 / width), y * (1 - 1 / height)
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


def frustum_share(prev_from_now: Array, yfov: float, size: Size) -> tuple[float, float]:
    """Percent of the image without history after a camera rotation, and the tolerance of a pixel count, percent.

    ``prev_from_now`` (3, 3): rotation of view directions.  Both cameras see a convex polygon: the current image
    clipped by the four frustum planes of the previous one.  A count of pixel centers differs from its area by about
    half of the pixels on the edges of the polygon.
    """
    polygon = screen(yfov, size)
    old = screen(yfov, size, centers=True)
    for i in range(4):
        a, b = np.append(old[i], -1.0), np.append(old[(i + 1) % 4], -1.0)
        inward = np.cross(a, b)  # plane through the previous eye and an edge of its image
        inward = prev_from_now.T @ (inward * np.sign(inward @ [0.0, 0.0, -1.0]))
        polygon = clip(polygon, lambda p, n=inward: p @ n[:2] - n[2])
    whole = screen(yfov, size)
    pixel = (whole[1, 0] - whole[0, 0]) / size[0]
    edge = np.linalg.norm(np.diff(polygon, axis=0, append=polygon[:1]), axis=1).sum() / pixel if len(polygon) else 0.0
    common = area(polygon) / area(whole)
    return 100.0 * (1.0 - common), 100.0 * 0.5 * edge / (size[0] * size[1])


def clip(polygon: Array, inside: object) -> Array:
    """The part of a convex polygon (N, 2) where the linear function ``inside`` is at least 0 (Sutherland, Hodgman)."""
    out: list[Array] = []
    for i, q in enumerate(polygon):
        p = polygon[i - 1]
        at_p, at_q = inside(p), inside(q)
        if (at_p < 0) != (at_q < 0):
            out.append(p + (q - p) * at_p / (at_p - at_q))
        if at_q >= 0:
            out.append(q)
    return np.array(out).reshape(-1, 2)


def area(polygon: Array) -> float:
    """Area of a simple polygon (N, 2) by the shoelace formula."""
    if len(polygon) < 3:
        return 0.0
    x, y = polygon.T
    return abs(0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


def pixel_rays(size: Size, yfov: float) -> Array:
    """View directions through the pixel centers, z = -1.  (h, w, 3)."""
    return rays(size, Camera(yfov=yfov))


def hit_sphere(origin: Array, direction: Array, center: Array, radius: float) -> Array:
    """Distance along rays to a sphere in lengths of ``direction``, inf for a miss.  (..., 3) -> (...)."""
    away = np.asarray(origin) - center
    a = np.sum(direction * direction, axis=-1)
    b = np.sum(direction * away, axis=-1)
    c = np.sum(away * away, axis=-1) - radius**2
    root = b * b - a * c
    with np.errstate(invalid="ignore"):
        near = (-b - np.sqrt(root)) / a
    return np.where((root > 0) & (near > 1e-9), near, np.inf)


def edge_pixels(region: Array) -> int:
    """Number of pixels on both sides of the edge of a region (h, w) bool, where rounding may change the result."""
    from scipy.ndimage import binary_dilation, binary_erosion  # imported late: 0.2 s

    return int(np.sum(binary_dilation(region) ^ binary_erosion(region, border_value=1)))


def shares_above(values: Array, thresholds: Array) -> Array:
    """The percentage of ``values`` (h, w) above each of ``thresholds`` (n,).  (n,)."""
    return 100.0 * (1.0 - np.searchsorted(np.sort(values.ravel()), thresholds, side="right") / values.size)


def share_deviation(share: float, count: float) -> float:
    """The standard deviation of a share (0 to 1) that is counted over ``count`` independent pixels or rows."""
    return math.sqrt(share * (1.0 - share) / count)


def normal_change(threshold: float, sigma: Array, samples: float) -> float:
    """Percent of the pixels in which two means of many samples differ by more than ``threshold``.

    ``sigma``: standard deviation of one sample in each pixel; means are normal by the central limit theorem, and their
    difference has sqrt(2 / ``samples``) times that.
    """
    with np.errstate(divide="ignore"):
        x = threshold * math.sqrt(samples) / (2.0 * sigma)
    return 100.0 * float(np.mean([math.erfc(v) for v in np.minimum(x, 30.0).ravel()]))


def maxwell_tail(threshold: float, sigma: float) -> float:
    """P(|v| > threshold) of a vector of three independent normal variables with standard deviation ``sigma``."""
    x = threshold / (math.sqrt(2.0) * sigma)
    return math.erfc(x) + 2.0 * x / math.sqrt(math.pi) * math.exp(-x * x)


def form_factor(points: Array, normal: Array, polygon: Array) -> Array:
    """Form factor from points to a polygon (Lambert's contour integral).

    ``points`` (..., 3) on a plane with unit ``normal`` (3,); ``polygon`` (N, 3), entirely above the plane.  -> (...).
    """
    to = polygon - points[..., None, :]
    to = to / np.linalg.norm(to, axis=-1, keepdims=True)
    after = np.roll(to, -1, axis=-2)
    cross = np.cross(to, after)
    length = np.linalg.norm(cross, axis=-1)
    angle = np.arctan2(length, np.sum(to * after, axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.where(length > 0, angle / length, 0.0) * (cross @ normal)
    return np.abs(sides.sum(axis=-1)) / (2.0 * np.pi)


def innermost_pixel(region: Array) -> tuple[float, float]:
    """The pixel (x, row) of a region that is farthest from its edge.  Raises ValueError for an empty region."""
    if not region.any():
        raise ValueError("an empty region has no innermost pixel")
    from scipy.ndimage import distance_transform_cdt

    depth = distance_transform_cdt(np.pad(region, 1), "taxicab")[1:-1, 1:-1]
    rows, columns = np.nonzero(depth == depth.max())
    nearest = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
    return float(columns[nearest]), float(rows[nearest])


def ground_distance(size: Size, eye: float, focal: float, step: float) -> Array:
    """Distance from level ground under a camera that moves forward to that at the nearest previous pixel.  (h, w) m.

    0 above the horizon.  ``eye``: height of the camera, meters; ``focal``: focal length, pixels; ``step``: meters
    between frames.  Ground y pixels below the horizon is z = eye * focal / y away and was at eye * focal / (z + step)
    pixels; the pixel center nearest to there shows ground at another distance.
    """
    width, height = size
    below = (np.arange(height) + 0.5 - height / 2)[:, None]
    aside = (np.arange(width) + 0.5 - width / 2)[None]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(below > 0, eye * focal / below, np.nan)
        then = far + step
        across = aside * far / focal
        row = nearest_center(eye * focal / then, height)
        column = nearest_center(focal * across / then, width)
        distance = eye * focal / row
        away = np.hypot(distance - then, column * distance / focal - across)
    return np.nan_to_num(away)


def nearest_center(place: Array, count: int) -> Array:
    """The pixel center nearest to ``place`` along an axis of ``count`` pixels, both from the middle of the image."""
    return np.floor(place + count / 2) + 0.5 - count / 2
