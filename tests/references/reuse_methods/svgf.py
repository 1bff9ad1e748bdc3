"""SVGF (Schied et al. 2017); sections and equations are those of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from references.reuse_methods.history import shifted
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

KERNEL = (3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0)
"""B3 spline: weights at distance 0, 1 and 2 (section 4.3)."""

DEPTH_FLOOR = 1e-3
"""Relative tolerance of Eq. (3) in inverse depth: keeps it finite on surfaces that face the camera."""

LUMINANCE_FLOOR = 1e-6


def moments_variance(first: Array, second: Array) -> Array:
    """Section 4.2: second moment - first moment^2, less a millionth of the second for rounding, at least 0."""
    return np.maximum(second - first**2 - 1e-6 * second, 0.0)


def inverse_depth(depth: Array) -> Array:
    """1 / depth, which is linear over the image of a plane as clip-space depth is; 0 = sky."""
    return np.where(depth > 0, 1.0 / np.where(depth > 0, depth, 1.0), 0.0)


def depth_slope(depth: Array) -> Array:
    """Change of a depth per pixel to the right and down: the smaller of both one-sided differences.  -> (h, w, 2)."""
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
        """(h, w, 2), ``depth_slope`` of the inverse depth."""
        return depth_slope(inverse_depth(self.depth))

    def geometry(self, other: Array, other_normal: Array, expected: Array) -> Array:
        """Eqs. (3) and (4) between each pixel and another of depth ``other``.

        ``expected``: change of inverse depth along the slope, at least 0.  (h, w), (h, w, 3), (h, w) -> (h, w).
        """
        depth, inverse = self.depth, inverse_depth(self.depth)
        with np.errstate(divide="ignore", invalid="ignore"):
            w_z = np.exp(-np.abs(inverse - inverse_depth(other)) / (self.sigma_z * expected + DEPTH_FLOOR * inverse))
        w_n = np.maximum((self.normal * other_normal).sum(axis=-1), 0.0) ** self.sigma_n
        surface = depth > 0
        return np.where(surface == (other > 0), np.where(surface, w_z * w_n, 1.0), 0.0)

    def geometry_weight(self, dx: int, dy: int) -> Array:
        """Eqs. (3) and (4) between each pixel and the one at offset (dx, dy); 0 where that is outside.  -> (h, w)."""
        other, exists = shifted(self.depth, dx, dy)
        expected = np.abs(self.slope @ np.array([dx, dy], dtype=np.float64))
        return np.where(exists, self.geometry(other, shifted(self.normal, dx, dy)[0], expected), 0.0)

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


def spatial_variance(moments: Array, edges: EdgeStopping) -> Array:
    """Section 4.2, for pixels with few frames: variance of 7x7 moments weighted by Eqs. (3) and (4).  -> (h, w)."""
    m, total = np.zeros_like(moments), np.zeros(edges.depth.shape)
    for dy in range(-3, 4):
        for dx in range(-3, 4):
            w = edges.geometry_weight(dx, dy)
            m += w[..., None] * shifted(moments, dx, dy)[0]
            total += w
    m /= total[..., None]
    return moments_variance(m[..., 0], m[..., 1])


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
