"""Means over frames."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def exponential_average(now: Array, history: Array, alpha: Array | float) -> Array:
    """Yang et al. 2020, Eq. (1): alpha now + (1 - alpha) history."""
    return history + alpha * (now - history)


def running_mean(now: Array, mean: Array, count: Array, cap: int) -> tuple[Array, Array]:
    """Welford's update: adds one frame to a mean of ``count`` frames; the count is limited to ``cap``.

    (h, w, 3), (h, w, 3), (h, w) -> mean, count.  The variance of stationary noise decreases as 1 / count.
    """
    count = np.minimum(count, cap - 1) + 1.0
    return exponential_average(now, mean, 1.0 / count[..., None]), count
