"""Pixels that a frame shades, and the shaded pixels that replace the others.

Reference for shaders/common/shading_rate.glsl.  Arrays have row 0 at the top; the patterns count rows from the bottom,
as GL memory does.
"""

from __future__ import annotations

import numpy as np

from taubench_gl.metrics.shading_rate import phase

Array = np.ndarray


def shaded(rate: str, size: tuple[int, int], frame: int) -> Array:
    """(h, w) bool: pixels that frame ``frame`` shades."""
    w, h = size
    x, y = np.meshgrid(np.arange(w), np.arange(h - 1, -1, -1))
    p = phase(rate, frame)
    if rate == "half":
        return y % 2 == p
    if rate == "checkerboard":
        return (x + y) % 2 == p
    if rate == "quarter":
        return (x % 2 == p % 2) & (y % 2 == p // 2)
    return np.ones((h, w), dtype=bool)


def nearest_shaded(rate: str, size: tuple[int, int], frame: int) -> Array:
    """(h, w, 2) int: x and row (0 = top) of the shaded pixel nearest to each pixel; the pixel itself where shaded.

    Of two equally near pixels, the left or lower one; at the border the one inside.
    """
    w, h = size
    x, y = np.meshgrid(np.arange(w), np.arange(h - 1, -1, -1))
    p = phase(rate, frame)

    def neighbor(at: Array, odd: Array) -> Array:
        return np.where(odd, np.where(at > 0, at - 1, at + 1), at)

    if rate == "half":
        y = neighbor(y, y % 2 != p)
    elif rate == "checkerboard":
        x = neighbor(x, (x + y) % 2 != p)
    elif rate == "quarter":
        x, y = neighbor(x, x % 2 != p % 2), neighbor(y, y % 2 != p // 2)
    return np.stack([np.clip(x, 0, w - 1), h - 1 - np.clip(y, 0, h - 1)], axis=-1)
