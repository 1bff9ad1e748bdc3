"""Equations of the built-in reuse methods, in float64.

References for taubench_gl/reuse/methods and shaders/common/reuse.glsl.  Images are (h, w, ...) with row 0 at the top,
colors linear radiance (h, w, 3); outside the image the edge pixels are repeated.  ``at_px`` (h, w, 2) is (column, row)
of a point's previous position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taubench_gl.conventions import GUARD_PX
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray


def previous_px(motion_px: Array) -> Array:
    """Previous position of each pixel, (column, row) + motion (previous - current, +y down).  (h, w, 2) -> same."""
    h, w = motion_px.shape[:2]
    return np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1) + np.asarray(motion_px, dtype=np.float64)


def inside(at_px: Array, size: tuple[int, int]) -> Array:
    """Eq. (3) of TauBench: inside [0, w-1] x [0, h-1], with a guard of GUARD_PX.  ``size`` (width, height).

    -> (h, w) bool.
    """
    last = np.array(size) - 1
    return np.all((at_px >= -GUARD_PX) & (at_px <= last + GUARD_PX), axis=-1)


def nearest_surface(depth: Array) -> Array:
    """Karis 2014: the pixel of each 3x3 neighborhood that is nearest to the camera.

    ``depth`` (h, w) planar, 0 = sky.  -> (h, w, 2) int (column, row).  Ties: the pixel itself, then the lower, then the
    left one.
    """
    h, w = depth.shape
    rows, columns = np.mgrid[:h, :w]
    best, found = np.where(depth > 0, depth, 1e30), np.stack([columns, rows], axis=-1)
    for dy in (1, 0, -1):
        for dx in (-1, 0, 1):
            row, column = np.clip(rows + dy, 0, h - 1), np.clip(columns + dx, 0, w - 1)
            other = depth[row, column]
            nearer = (other > 0) & (other < best)
            best = np.where(nearer, other, best)
            found[nearer] = np.stack([column, row], axis=-1)[nearer]
    return found


def catmull_rom_weights(f: Array) -> Array:
    """Keys 1981, a = -1/2: weights of the taps at -1, 0, 1, 2 for points ``f`` in [0, 1).  (...) -> (..., 4)."""
    f = np.asarray(f, dtype=np.float64)
    return np.stack(
        [
            -0.5 * f**3 + f**2 - 0.5 * f,
            1.5 * f**3 - 2.5 * f**2 + 1.0,
            -1.5 * f**3 + 2.0 * f**2 + 0.5 * f,
            0.5 * f**3 - 0.5 * f**2,
        ],
        axis=-1,
    )


def _fetch(values: Array, column: Array, up: Array) -> Array:
    """Pixels by column and by row from the bottom; the image edge is repeated."""
    h, w = values.shape[:2]
    return values[h - 1 - np.clip(up, 0, h - 1), np.clip(column, 0, w - 1)]


def sample_history(values: Array, at_px: Array, filtering: str = "bilinear") -> Array:
    """``values`` (h, w, c) at ``at_px``: nearest (floor(x + 0.5), y up), bilinear or catmull_rom.  -> (h, w, c)."""
    values = np.asarray(values, dtype=np.float64)
    x, y = at_px[..., 0], (values.shape[0] - 1) - at_px[..., 1]
    if filtering == "nearest":
        return _fetch(values, np.floor(x + 0.5).astype(np.int64), np.floor(y + 0.5).astype(np.int64))
    base_x, base_y = np.floor(x), np.floor(y)
    fx, fy = x - base_x, y - base_y
    if filtering == "bilinear":
        wx, wy, first = np.stack([1 - fx, fx], -1), np.stack([1 - fy, fy], -1), 0
    else:
        wx, wy, first = catmull_rom_weights(fx), catmull_rom_weights(fy), -1
    out = np.zeros((*x.shape, values.shape[-1]))
    for j in range(wy.shape[-1]):
        for i in range(wx.shape[-1]):
            tap = _fetch(values, (base_x + first + i).astype(np.int64), (base_y + first + j).astype(np.int64))
            out += (wx[..., i] * wy[..., j])[..., None] * tap
    return out


def consistent_blend(values: Array, at_px: Array, accept: Callable[[Array, Array], Array]) -> tuple[Array, Array]:
    """Schied 2017, section 4.1; Koskela 2019: bilinear blend of accepted taps inside the image, weights renormalized.

    ``accept``: (h, w) int, (h, w) int -> (h, w) bool.  -> blend (h, w, c), 0 without an accepted tap, and the sum of
    the weights before renormalization (h, w).
    """
    values = np.asarray(values, dtype=np.float64)
    h, w = values.shape[:2]
    base = np.floor(at_px).astype(np.int64)
    f = at_px - base
    sums, total = np.zeros((*at_px.shape[:2], values.shape[-1])), np.zeros(at_px.shape[:2])
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        column, row = base[..., 0] + dx, base[..., 1] + dy
        weight = (f[..., 0] if dx else 1 - f[..., 0]) * (f[..., 1] if dy else 1 - f[..., 1])
        good = (weight > 0) & (column >= 0) & (column < w) & (row >= 0) & (row < h)
        row, column = np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)
        weight = np.where(good & accept(row, column), weight, 0.0)
        sums += weight[..., None] * values[row, column]
        total += weight
    return sums / np.where(total > 0, total, 1.0)[..., None], total


def exponential_average(now: Array, history: Array, alpha: Array | float) -> Array:
    """Yang et al. 2020, Eq. (1): alpha now + (1 - alpha) history."""
    return history + alpha * (now - history)


def running_mean(now: Array, mean: Array, count: Array, cap: int) -> tuple[Array, Array]:
    """Welford's update: adds one frame to a mean of ``count`` frames; the count is limited to ``cap``.

    (h, w, 3), (h, w, 3), (h, w) -> mean, count.  The variance of stationary noise decreases as 1 / count.
    """
    count = np.minimum(count, cap - 1) + 1.0
    return exponential_average(now, mean, 1.0 / count[..., None]), count


def cache_hit(expected: Array, cached_depth: Array, threshold: float) -> Array:
    """Nehab et al. 2007: the cached planar depth equals the expected one within a relative threshold; 0 is sky."""
    near = np.abs(cached_depth - expected) <= threshold * expected
    return np.where(expected > 0, near, cached_depth <= 0)


def refresh_due(index: int, size: tuple[int, int], block: int, refresh: int) -> Array:
    """Nehab et al. 2007: pixels that frame ``index`` recomputes; each block is recomputed once in ``refresh`` frames.

    -> (h, w) bool.
    """
    w, h = size
    x, up = np.meshgrid(np.arange(w) // block, np.arange(h - 1, -1, -1) // block)
    return (5 * x + 3 * up + index) % refresh == 0


def timewarp_px(clip_from_view: Array, key_from_view: Array, size: tuple[int, int]) -> Array:
    """Position of each pixel's view ray in an image from the same position with another rotation.

    Homography K R_key^T R_now K^-1; Hartley and Zisserman 2004, section 8.4.

    ``clip_from_view`` (4, 4) of both cameras (perspective); ``key_from_view`` (3, 3) rotation from this camera's axes
    to the key camera's.  -> (h, w, 2) (column, row); NaN where the ray points behind the key camera.
    """
    w, h = size
    # Pixel indices, y up, from view axes: ndc = -K x / z, index = (ndc + 1) size / 2 - 1/2.
    to_index = np.array([[0.5 * w, 0, 0.5 * w - 0.5], [0, 0.5 * h, 0.5 * h - 0.5], [0, 0, 1]])
    intrinsic = to_index @ clip_from_view[np.ix_([0, 1, 3], [0, 1, 2])]
    homography = intrinsic @ key_from_view @ np.linalg.inv(intrinsic)
    x, up = np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h - 1, -1, -1, dtype=np.float64))
    q = np.stack([x, up, np.ones_like(x)], axis=-1) @ homography.T
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.where(q[..., 2:] > 0, q[..., :2] / q[..., 2:], np.nan)
    return np.stack([at[..., 0], (h - 1) - at[..., 1]], axis=-1)


def new_samples(radiance: Array, jitter_px: Array, reach: float) -> tuple[Array, Array, Array]:
    """Yang et al. 2020, section 5: shaded samples of 5x5 pixels under a tent of half width ``reach`` pixels.

    ``radiance`` (h, w, 4), alpha 1 where shaded; ``jitter_px`` (2,) +y down.  -> weighted mean (h, w, 3), sum of
    weights (h, w), largest weight (h, w).
    """
    h, w = radiance.shape[:2]
    # Outside the image alpha is 0: not shaded.
    wide = np.pad(np.asarray(radiance, dtype=np.float64), ((2, 2), (2, 2), (0, 0)))
    sums, total, best = np.zeros((h, w, 3)), np.zeros((h, w)), np.zeros((h, w))
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            tap = wide[2 + dy : 2 + dy + h, 2 + dx : 2 + dx + w]
            tent = np.maximum(1.0 - np.abs(np.array([dx, dy]) + jitter_px) / reach, 0.0)
            weight = np.where(tap[..., 3] >= 0.5, tent.prod(), 0.0)
            sums += weight[..., None] * tap[..., :3]
            total += weight
            best = np.maximum(best, weight)
    return sums / np.where(total > 0, total, 1.0)[..., None], total, best


def upsample_blend(
    now: Array, confidence: Array, history: Array, gathered: Array, alpha: float
) -> tuple[Array, Array, Array]:
    """Yang et al. 2020, section 5: f_n = a b s_n + (1 - a b) f_(n-1), a = max(alpha, 1 / confidence gathered).

    ``now``, ``history`` (..., 3); ``confidence`` b and ``gathered`` (...).  -> color, gathered, weight of history.
    """
    gathered = gathered + confidence
    share = np.where(
        gathered > 0, np.maximum(confidence / np.where(gathered > 0, gathered, 1.0), alpha * confidence), 0.5
    )
    return exponential_average(now, history, share[..., None]), np.minimum(gathered, 1.0 / alpha), 1.0 - share


_YCOCG_FROM_RGB = np.array([[0.25, 0.5, 0.25], [0.5, 0.0, -0.5], [-0.25, 0.5, -0.25]])
_RGB_FROM_YCOCG = np.array([[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]])
_CROSS = tuple((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx == 0 or dy == 0)


def ycocg_from_rgb(rgb: Array) -> Array:
    """Y, Co, Cg (Malvar and Sullivan 2003, the real-valued transform).  (..., 3) -> (..., 3)."""
    return np.asarray(rgb, dtype=np.float64) @ _YCOCG_FROM_RGB.T


def rgb_from_ycocg(ycocg: Array) -> Array:
    """The inverse.  (..., 3) -> (..., 3)."""
    return np.asarray(ycocg, dtype=np.float64) @ _RGB_FROM_YCOCG.T


def neighbors(image: Array) -> dict[tuple[int, int], Array]:
    """The 3x3 neighborhood: (row offset, column offset) -> (h, w, c)."""
    h, w = image.shape[:2]
    wide = np.pad(np.asarray(image, dtype=np.float64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    return {(dy, dx): wide[1 + dy : 1 + dy + h, 1 + dx : 1 + dx + w] for dy in (-1, 0, 1) for dx in (-1, 0, 1)}


def neighborhood_box(rgb: Array, rounded: bool = True) -> tuple[Array, Array]:
    """Karis 2014: minimum and maximum YCoCg of 3x3 pixels.  ``rounded``: averaged with those of the plus-shaped subset.

    -> low, high (h, w, 3).
    """
    around = neighbors(ycocg_from_rgb(rgb))
    every, cross = np.stack(list(around.values())), np.stack([around[k] for k in _CROSS])
    low, high = every.min(axis=0), every.max(axis=0)
    if not rounded:
        return low, high
    return 0.5 * (low + cross.min(axis=0)), 0.5 * (high + cross.max(axis=0))


def variance_box(rgb: Array, gamma: float = 1.0, keep_own: bool = True) -> tuple[Array, Array]:
    """Salvi 2016: mean +- gamma standard deviations of 3x3 pixels in YCoCg.

    ``keep_own``: extended to the pixel's color.  -> low, high (h, w, 3).
    """
    around = neighbors(ycocg_from_rgb(rgb))
    every = np.stack(list(around.values()))
    mean, sigma = every.mean(axis=0), every.std(axis=0)
    low, high = mean - gamma * sigma, mean + gamma * sigma
    own = around[0, 0]
    return (np.minimum(low, own), np.maximum(high, own)) if keep_own else (low, high)


def clip_to_box(low: Array, high: Array, color: Array) -> Array:
    """Pedersen 2016: moves a color towards the center of the box until it is inside.  All (..., 3)."""
    middle, extent = 0.5 * (high + low), 0.5 * (high - low) + 1e-7
    offset = color - middle
    farthest = (np.abs(offset) / extent).max(axis=-1, keepdims=True)
    return np.where(farthest > 1.0, middle + offset / np.maximum(farthest, 1.0), color)


def karis_blend(now: Array, history: Array, alpha: float, weighting: bool = True) -> tuple[Array, Array]:
    """Karis 2014: colors weighted by 1 / (1 + luminance).  -> color (..., 3), weight of history (..., 1)."""
    w_now, w_history = np.array(alpha), np.array(1.0 - alpha)
    if weighting:
        w_now = alpha / (1.0 + np.maximum(now @ LUMINANCE, 0.0))
        w_history = (1.0 - alpha) / (1.0 + np.maximum(history @ LUMINANCE, 0.0))
    kept = np.broadcast_to(w_history / (w_now + w_history), now.shape[:-1])[..., None]
    return now + kept * (history - now), kept


def shaded_neighbors(radiance: Array) -> tuple[Array, Array, Array, Array]:
    """Mean and range of those of the four neighbors that are shaded in this frame (alpha 1).

    (h, w, 4) -> mean, low, high (h, w, 3) and their number (h, w); without one, mean 0 and an inverted box.
    """
    around = neighbors(radiance)
    taps = np.stack([around[k] for k in ((0, 1), (0, -1), (-1, 0), (1, 0))])
    shaded = (taps[..., 3] >= 0.5)[..., None]
    count = shaded.sum(axis=0)
    mean = np.where(shaded, taps[..., :3], 0.0).sum(axis=0) / np.maximum(count, 1)
    low = np.where(shaded, taps[..., :3], np.inf).min(axis=0)
    high = np.where(shaded, taps[..., :3], -np.inf).max(axis=0)
    return mean, low, high, count[..., 0]


KERNEL = (3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0)
"""B3 spline: weights at distance 0, 1 and 2 (section 4.3)."""

DEPTH_FLOOR = 1e-3
"""Relative depth tolerance of Eq. (3): keeps it finite on surfaces that face the camera."""

LUMINANCE_FLOOR = 1e-6


def moments_variance(first: Array, second: Array) -> Array:
    """Section 4.2: second moment - first moment^2, at least 0."""
    return np.maximum(second - first**2, 0.0)


def shifted(values: Array, dx: int, dy: int) -> tuple[Array, Array]:
    """``values`` at pixel (column + dx, row + dy), and whether that pixel exists.  -> (h, w, ...), (h, w) bool."""
    h, w = values.shape[:2]
    row, column = np.mgrid[:h, :w]
    row, column = row + dy, column + dx
    exists = (row >= 0) & (row < h) & (column >= 0) & (column < w)
    return values[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)], exists


def depth_slope(depth: Array) -> Array:
    """Depth change per pixel to the right and down: the smaller of both one-sided differences.  -> (h, w, 2)."""
    slope = np.zeros((*depth.shape, 2))
    for axis, (dx, dy) in enumerate(((1, 0), (0, 1))):
        after, there = shifted(depth, dx, dy)
        before, was = shifted(depth, -dx, -dy)
        forward = np.where(there & (after > 0), after - depth, np.inf)
        backward = np.where(was & (before > 0), depth - before, np.inf)
        least = np.where(np.abs(forward) < np.abs(backward), forward, backward)
        slope[..., axis] = np.where(np.isfinite(least), least, 0.0)
    return slope


@dataclass(frozen=True)
class EdgeStopping:
    """Edge-stopping functions of section 4.4 over one G-buffer.

    ``depth`` (h, w) planar, meters, 0 = sky; ``normal`` (h, w, 3) unit; sigmas as in Eqs. (3) to (5).
    """

    depth: Array
    normal: Array
    sigma_z: float = 1.0
    sigma_n: float = 128.0
    sigma_l: float = 4.0

    @cached_property
    def slope(self) -> Array:
        """(h, w, 2), ``depth_slope`` of the depth."""
        return depth_slope(self.depth)

    def geometry_weight(self, dx: int, dy: int) -> Array:
        """Eqs. (3) and (4) between each pixel and the one at offset (dx, dy); 0 where that is outside.  -> (h, w)."""
        depth = self.depth
        other, exists = shifted(depth, dx, dy)
        other_normal, _ = shifted(self.normal, dx, dy)
        expected = np.abs(self.slope @ np.array([dx, dy], dtype=np.float64))
        with np.errstate(divide="ignore", invalid="ignore"):
            w_z = np.exp(-np.abs(depth - other) / (self.sigma_z * expected + DEPTH_FLOOR * depth))
        w_n = np.maximum((self.normal * other_normal).sum(axis=-1), 0.0) ** self.sigma_n
        surface = depth > 0
        return np.where(exists & (surface == (other > 0)), np.where(surface, w_z * w_n, 1.0), 0.0)

    def weight(self, color: Array, variance: Array, dx: int, dy: int) -> Array:
        """w = w_z w_n w_l between each pixel and the one at offset (dx, dy).  -> (h, w).

        ``variance``: smoothed variance of the luminance (h, w), Eq. (5).
        """
        l_p = color @ LUMINANCE
        l_q, _ = shifted(l_p, dx, dy)
        w_l = np.exp(-np.abs(l_p - l_q) / (self.sigma_l * np.sqrt(np.maximum(variance, 0.0)) + LUMINANCE_FLOOR))
        return self.geometry_weight(dx, dy) * w_l


def smoothed_variance(variance: Array) -> Array:
    """Separable 3x3 Gaussian (1/4, 1/2, 1/4) of Eq. (5); the image edge is repeated."""
    out = np.zeros_like(variance)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            out += (0.5 if dx == 0 else 0.25) * (0.5 if dy == 0 else 0.25) * shifted(variance, dx, dy)[0]
    return out


def spatial_estimate(color: Array, moments: Array, edges: EdgeStopping, count: Array) -> tuple[Array, Array]:
    """Section 4.2, for pixels with few frames: 7x7 means weighted by Eqs. (3) and (4), variance times 4 / ``count``.

    -> color (h, w, 3), variance (h, w).
    """
    sums, m, total = np.zeros_like(color), np.zeros_like(moments), np.zeros(edges.depth.shape)
    for dy in range(-3, 4):
        for dx in range(-3, 4):
            w = edges.geometry_weight(dx, dy)
            sums += w[..., None] * shifted(color, dx, dy)[0]
            m += w[..., None] * shifted(moments, dx, dy)[0]
            total += w
    m /= total[..., None]
    return sums / total[..., None], moments_variance(m[..., 0], m[..., 1]) * 4.0 / count


def atrous_level(color: Array, variance: Array, edges: EdgeStopping, level: int) -> tuple[Array, Array]:
    """Section 4.3: c' = sum h w c / sum h w and var' = sum h^2 w^2 var / (sum h w)^2, step 2^level.

    -> color (h, w, 3), variance (h, w).
    """
    smooth, step = smoothed_variance(variance), 1 << level
    own = KERNEL[0] ** 2
    sums, variances, total = own * color, own**2 * variance, np.full(edges.depth.shape, own)
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            if dx == dy == 0:
                continue
            w = edges.weight(color, smooth, step * dx, step * dy) * (KERNEL[abs(dx)] * KERNEL[abs(dy)])
            sums = sums + w[..., None] * shifted(color, step * dx, step * dy)[0]
            variances = variances + w**2 * shifted(variance, step * dx, step * dy)[0]
            total = total + w
    return sums / total[..., None], variances / total**2
