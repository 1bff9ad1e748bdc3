"""Generated frames of surfaces that face the camera, in float64: where they are, and the area of holes."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def accelerated(acceleration: float, time: float) -> float:
    """Position in pixels of a surface that starts at rest: a t^2 / 2."""
    return acceleration * time * time / 2.0


def extrapolation_error(acceleration: float, interval: float, time: float) -> float:
    """Pixels by which the position at ``time`` after the last of two frames ``interval`` apart is extrapolated wrongly:
    x(T) + t (x(T) - x(0)) / T against x(T + t), that is a t (t + T) / 2."""
    return acceleration * time * (time + interval) / 2.0


def interpolation_error(acceleration: float, interval: float, time: float) -> float:
    """The same for the straight line between both frames, ``time`` after the first: a t (T - t) / 2."""
    return acceleration * time * (interval - time) / 2.0


def disk(size: tuple[int, int], center: tuple[float, float], radius: float) -> Array:
    """Pixels (h, w) bool whose centers are in a disk; ``center`` x, y."""
    x, y = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in size))
    return (x - center[0]) ** 2 + (y - center[1]) ** 2 <= radius**2
