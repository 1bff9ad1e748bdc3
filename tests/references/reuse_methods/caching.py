"""Reverse reprojection cache and time warp."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


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
