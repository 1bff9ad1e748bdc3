"""Upsampling and checkerboard: frames of which only some pixels are shaded."""

from __future__ import annotations

import numpy as np

from references.reuse_methods.history import exponential_average, neighbors

Array = np.ndarray


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
