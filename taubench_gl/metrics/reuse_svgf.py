"""SVGF's equations (Schied et al. 2017) in float64: twins of taubench_gl/reuse/methods/svgf.

Arrays are (h, w, ...), row 0 at the top; ``depth`` is planar, metres, 0 = sky.
"""

from __future__ import annotations

import numpy as np

from taubench_gl.metrics.reuse_color import LUMINANCE

Array = np.ndarray

KERNEL = (3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0)
"""B3 spline: weights at distance 0, 1 and 2 (section 4.3)."""

DEPTH_FLOOR = 1e-3
"""Relative depth difference that Eq. (3) always forgives; keeps it finite on surfaces that face the camera."""

LUMINANCE_FLOOR = 1e-6


def moments_variance(first: Array, second: Array) -> Array:
    """Section 4.2: second moment - first moment^2, never below 0."""
    return np.maximum(second - first**2, 0.0)


def shifted(values: Array, dx: int, dy: int) -> tuple[Array, Array]:
    """``values`` of pixel (column + dx, row + dy), and where that pixel exists.  -> (h, w, ...), (h, w) bool."""
    h, w = values.shape[:2]
    row, column = np.mgrid[:h, :w]
    row, column = row + dy, column + dx
    exists = (row >= 0) & (row < h) & (column >= 0) & (column < w)
    return values[np.clip(row, 0, h - 1), np.clip(column, 0, w - 1)], exists


def depth_slope(depth: Array) -> Array:
    """Change of depth per pixel to the right and down: of the two one-sided differences the smaller.  -> (h, w, 2)."""
    slope = np.zeros((*depth.shape, 2))
    for axis, (dx, dy) in enumerate(((1, 0), (0, 1))):
        after, there = shifted(depth, dx, dy)
        before, was = shifted(depth, -dx, -dy)
        forward = np.where(there & (after > 0), after - depth, np.inf)
        backward = np.where(was & (before > 0), depth - before, np.inf)
        least = np.where(np.abs(forward) < np.abs(backward), forward, backward)
        slope[..., axis] = np.where(np.isfinite(least), least, 0.0)
    return slope


def geometry_weight(
    depth: Array, normal: Array, dx: int, dy: int, sigma_z: float, sigma_n: float, slope: Array
) -> Array:
    """Eqs. (3) and (4) between each pixel and the one (dx, dy) away; 0 where there is none.  -> (h, w)."""
    other, exists = shifted(depth, dx, dy)
    other_normal, _ = shifted(normal, dx, dy)
    expected = np.abs(slope @ np.array([dx, dy], dtype=np.float64))
    with np.errstate(divide="ignore", invalid="ignore"):
        w_z = np.exp(-np.abs(depth - other) / (sigma_z * expected + DEPTH_FLOOR * depth))
    w_n = np.maximum((normal * other_normal).sum(axis=-1), 0.0) ** sigma_n
    surface = depth > 0
    return np.where(exists & (surface == (other > 0)), np.where(surface, w_z * w_n, 1.0), 0.0)


def luminance_weight(l_p: Array, l_q: Array, variance: Array, sigma_l: float) -> Array:
    """Eq. (5), ``variance`` that of the luminance at p (smoothed)."""
    return np.exp(-np.abs(l_p - l_q) / (sigma_l * np.sqrt(np.maximum(variance, 0.0)) + LUMINANCE_FLOOR))


def edge_weight(
    color: Array,
    depth: Array,
    normal: Array,
    dx: int,
    dy: int,
    variance: Array,
    sigma_z: float,
    sigma_n: float,
    sigma_l: float,
    slope: Array,
) -> Array:
    """w = w_z w_n w_l (section 4.4) between each pixel and the one (dx, dy) away.  -> (h, w)."""  # fmt: skip
    l_p = color @ LUMINANCE
    l_q, _ = shifted(l_p, dx, dy)
    w = geometry_weight(depth, normal, dx, dy, sigma_z, sigma_n, slope)
    return w * luminance_weight(l_p, l_q, variance, sigma_l)


def smoothed_variance(variance: Array) -> Array:
    """The 3x3 Gaussian (1/4, 1/2, 1/4) both ways under Eq. (5); the outermost pixels repeat."""
    out = np.zeros_like(variance)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            out += (0.5 if dx == 0 else 0.25) * (0.5 if dy == 0 else 0.25) * shifted(variance, dx, dy)[0]
    return out


def spatial_estimate(
    color: Array, moments: Array, depth: Array, normal: Array, count: Array, sigma_z: float, sigma_n: float
) -> tuple[Array, Array]:
    """Section 4.2 for pixels with few frames: 7x7 means under Eqs. (3), (4), variance times 4 / ``count``.

    -> colour (h, w, 3), variance (h, w).
    """
    slope = depth_slope(depth)
    sums, m, total = np.zeros_like(color), np.zeros_like(moments), np.zeros(depth.shape)
    for dy in range(-3, 4):
        for dx in range(-3, 4):
            w = geometry_weight(depth, normal, dx, dy, sigma_z, sigma_n, slope)
            sums += w[..., None] * shifted(color, dx, dy)[0]
            m += w[..., None] * shifted(moments, dx, dy)[0]
            total += w
    m /= total[..., None]
    return sums / total[..., None], moments_variance(m[..., 0], m[..., 1]) * 4.0 / count


def atrous_level(
    color: Array,
    variance: Array,
    depth: Array,
    normal: Array,
    level: int,
    sigma_z: float,
    sigma_n: float,
    sigma_l: float,
) -> tuple[Array, Array]:
    """Section 4.3: c' = sum h w c / sum h w and var' = sum h^2 w^2 var / (sum h w)^2, step 2^level.

    -> colour (h, w, 3), variance (h, w).
    """  # fmt: skip
    slope, smooth, step = depth_slope(depth), smoothed_variance(variance), 1 << level
    own = KERNEL[0] ** 2
    sums, variances, total = own * color, own**2 * variance, np.full(depth.shape, own)
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            if dx == dy == 0:
                continue
            w = edge_weight(
                color, depth, normal, step * dx, step * dy, smooth, sigma_z, sigma_n, sigma_l, slope
            ) * (KERNEL[abs(dx)] * KERNEL[abs(dy)])  # fmt: skip
            sums = sums + w[..., None] * shifted(color, step * dx, step * dy)[0]
            variances = variances + w**2 * shifted(variance, step * dx, step * dy)[0]
            total = total + w
    return sums / total[..., None], variances / total**2
