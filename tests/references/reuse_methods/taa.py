"""Temporal anti-aliasing: color boxes and weights."""

from __future__ import annotations

import numpy as np

from references.reuse_methods.history import neighbors
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

_YCOCG_FROM_RGB = np.array([[0.25, 0.5, 0.25], [0.5, 0.0, -0.5], [-0.25, 0.5, -0.25]])
_RGB_FROM_YCOCG = np.array([[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]])
_CROSS = tuple((dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx == 0 or dy == 0)


def ycocg_from_rgb(rgb: Array) -> Array:
    """Y, Co, Cg (Malvar and Sullivan 2003, the real-valued transform).  (..., 3) -> (..., 3)."""
    return np.asarray(rgb, dtype=np.float64) @ _YCOCG_FROM_RGB.T


def rgb_from_ycocg(ycocg: Array) -> Array:
    """The inverse.  (..., 3) -> (..., 3)."""
    return np.asarray(ycocg, dtype=np.float64) @ _RGB_FROM_YCOCG.T


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


def clip_towards(low: Array, high: Array, target: Array, color: Array) -> Array:
    """Karis 2014: the first color inside the box on the ray from ``color`` to ``target``, inside it.  All (..., 3)."""
    edge = np.clip(color, low, high)
    entry = np.where(edge != color, (edge - color) / np.where(edge != color, target - color, 1.0), 0.0)
    entry = np.minimum(entry.max(axis=-1, keepdims=True), 1.0)
    return color + entry * (target - color)


def neighborhood_mean(rgb: Array) -> Array:
    """Mean YCoCg of 3x3 pixels.  (h, w, 3) -> (h, w, 3)."""
    return np.mean(list(neighbors(ycocg_from_rgb(rgb)).values()), axis=0)


def windowed(rgb: Array, jitter: Array) -> Array:
    """Karis 2014: 3x3 samples, weighted by a Blackman-Harris window of their distances d, as exp(-2.29 d^2).

    ``jitter`` (2,): pixels, +x right, +y up.  (h, w, 3) -> (h, w, 3).
    """
    around = neighbors(np.asarray(rgb, dtype=np.float64))
    weights = {(dy, dx): np.exp(-2.29 * ((dx + jitter[0]) ** 2 + (jitter[1] - dy) ** 2)) for dy, dx in around}
    return sum(weights[k] * around[k] for k in around) / sum(weights.values())


def karis_blend(now: Array, history: Array, alpha: float, weighting: bool = True) -> tuple[Array, Array]:
    """Karis 2014: colors weighted by 1 / (1 + luminance).  -> color (..., 3), weight of history (..., 1)."""
    w_now, w_history = np.array(alpha), np.array(1.0 - alpha)
    if weighting:
        w_now = alpha / (1.0 + np.maximum(now @ LUMINANCE, 0.0))
        w_history = (1.0 - alpha) / (1.0 + np.maximum(history @ LUMINANCE, 0.0))
    kept = np.broadcast_to(w_history / (w_now + w_history), now.shape[:-1])[..., None]
    return now + kept * (history - now), kept
