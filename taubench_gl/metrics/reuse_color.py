"""Colour boxes of temporal anti-aliasing, float64: twins of shaders/common/reuse.glsl and of the TAA methods' shaders.

Pictures are (h, w, 3) linear radiance; beyond their edge the outermost pixels repeat.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Rec. 709."""

_YCOCG_FROM_RGB = np.array([[0.25, 0.5, 0.25], [0.5, 0.0, -0.5], [-0.25, 0.5, -0.25]])
_RGB_FROM_YCOCG = np.array([[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]])
_CROSS = tuple((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx == 0 or dy == 0)


def ycocg_from_rgb(rgb: Array) -> Array:
    """Y, Co, Cg (Malvar and Sullivan 2003, the real-valued transform).  (..., 3) -> (..., 3)."""
    return np.asarray(rgb, dtype=np.float64) @ _YCOCG_FROM_RGB.T


def rgb_from_ycocg(ycocg: Array) -> Array:
    """The inverse.  (..., 3) -> (..., 3)."""
    return np.asarray(ycocg, dtype=np.float64) @ _RGB_FROM_YCOCG.T


def neighbours(picture: Array) -> dict[tuple[int, int], Array]:
    """The 3x3 neighbourhood: (row offset, column offset) -> (h, w, c)."""
    h, w = picture.shape[:2]
    wide = np.pad(np.asarray(picture, dtype=np.float64), ((1, 1), (1, 1), (0, 0)), mode="edge")
    return {(dy, dx): wide[1 + dy : 1 + dy + h, 1 + dx : 1 + dx + w] for dy in (-1, 0, 1) for dx in (-1, 0, 1)}


def neighbourhood_box(rgb: Array, rounded: bool = True) -> tuple[Array, Array]:
    """Karis 2014: smallest and largest YCoCg of 3x3 pixels; ``rounded``: averaged with those of the cross.

    -> low, high (h, w, 3).
    """
    around = neighbours(ycocg_from_rgb(rgb))
    every, cross = np.stack(list(around.values())), np.stack([around[k] for k in _CROSS])
    low, high = every.min(axis=0), every.max(axis=0)
    if not rounded:
        return low, high
    return 0.5 * (low + cross.min(axis=0)), 0.5 * (high + cross.max(axis=0))


def variance_box(rgb: Array, gamma: float = 1.0, keep_own: bool = True) -> tuple[Array, Array]:
    """Salvi 2016: mean +- gamma standard deviations of 3x3 pixels in YCoCg.  ``keep_own``: grown to hold the pixel too.

    -> low, high (h, w, 3).
    """
    around = neighbours(ycocg_from_rgb(rgb))
    every = np.stack(list(around.values()))
    mean, sigma = every.mean(axis=0), every.std(axis=0)
    low, high = mean - gamma * sigma, mean + gamma * sigma
    own = around[0, 0]
    return (np.minimum(low, own), np.maximum(high, own)) if keep_own else (low, high)


def clip_to_box(low: Array, high: Array, color: Array) -> Array:
    """Pedersen 2016: towards the middle of the box until inside it.  All (..., 3)."""
    middle, extent = 0.5 * (high + low), 0.5 * (high - low) + 1e-7
    offset = color - middle
    farthest = (np.abs(offset) / extent).max(axis=-1, keepdims=True)
    return np.where(farthest > 1.0, middle + offset / np.maximum(farthest, 1.0), color)


def karis_blend(now: Array, history: Array, alpha: float, weighting: bool = True) -> tuple[Array, Array]:
    """Karis 2014: both colours weighed by 1 / (1 + luminance).  -> colour (..., 3), weight of history (..., 1)."""
    w_now, w_history = np.array(alpha), np.array(1.0 - alpha)
    if weighting:
        w_now = alpha / (1.0 + np.maximum(now @ LUMINANCE, 0.0))
        w_history = (1.0 - alpha) / (1.0 + np.maximum(history @ LUMINANCE, 0.0))
    kept = np.broadcast_to(w_history / (w_now + w_history), now.shape[:-1])[..., None]
    return now + kept * (history - now), kept


def shaded_neighbours(radiance: Array) -> tuple[Array, Array, Array, Array]:
    """Of the four neighbours those shaded this frame (alpha 1).  (h, w, 4) ->

    mean (h, w, 3), low, high (h, w, 3) and how many (h, w); mean 0 and an inverted box where there are none.
    """
    around = neighbours(radiance)
    taps = np.stack([around[k] for k in ((0, 1), (0, -1), (-1, 0), (1, 0))])
    shaded = (taps[..., 3] >= 0.5)[..., None]
    count = shaded.sum(axis=0)
    mean = np.where(shaded, taps[..., :3], 0.0).sum(axis=0) / np.maximum(count, 1)
    low = np.where(shaded, taps[..., :3], np.inf).min(axis=0)
    high = np.where(shaded, taps[..., :3], -np.inf).max(axis=0)
    return mean, low, high, count[..., 0]
