"""Sub-pixel sample offsets of frames, in pixels, +x right, +y up (``View.jitter_px``)."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray

HALTON_PERIOD = 16
"""Length of the sequence in frames, as in temporal anti-aliasing (Karis 2014: 8 or 16)."""


def radical_inverse(index: Any, base: int) -> Any:
    """Radical inverse of ``index`` in ``base`` (Halton 1960), in [0, 1), of the shape of ``index``."""
    index, value, scale = np.asarray(index), np.zeros(np.shape(index)), 1.0 / base
    while np.any(index):
        index, digit = np.divmod(index, base)
        value += digit * scale
        scale /= base
    return value[()]


def halton_jitter(frame: int, period: int = HALTON_PERIOD) -> Array:
    """Sample offset of ``frame``: elements 1 .. ``period`` of the Halton sequence (2, 3), repeated. (2,) float64,
    pixels, in [-0.5, 0.5).
    """
    index = frame % period + 1  # element 0 is the corner of the pixel in both bases
    return np.array([radical_inverse(index, 2), radical_inverse(index, 3)]) - 0.5


def grid_offsets(samples: int) -> Array:
    """Cell centers of a grid over the pixel, as square as ``samples`` allows: the midpoint rule for a box filter.

    -> (samples, 2) float64 in (-0.5, 0.5), mean 0 up to rounding; one sample is the pixel center.
    """
    across = max(n for n in range(1, int(np.sqrt(samples)) + 1) if samples % n == 0)
    x, y = ((np.arange(n) + 0.5) / n - 0.5 for n in (samples // across, across))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
