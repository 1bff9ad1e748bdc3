"""Histogram of feature distances and the discard-versus-threshold curve it stands for (SPEC section 4)."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import (
    HISTOGRAM_BINS,
    HISTOGRAM_MANTISSA_BITS,
    HISTOGRAM_MAX_EXPONENT,
    HISTOGRAM_MIN_EXPONENT,
)

_FIRST_KEY = (127 + HISTOGRAM_MIN_EXPONENT) << HISTOGRAM_MANTISSA_BITS


def bin_of(distance: np.ndarray) -> np.ndarray:
    """Bin index of distances >= 0 (...) -> (...) int64.  Cut from float32 bits: twin of ``histogram_bin`` in GLSL."""
    key = np.asarray(distance, dtype=np.float32).view(np.uint32) >> (23 - HISTOGRAM_MANTISSA_BITS)
    return np.clip(key.astype(np.int64) - _FIRST_KEY + 1, 0, HISTOGRAM_BINS - 1)


def edges() -> np.ndarray:
    """Lower edge of every bin but bin 0 (whose lower edge is 0).  (HISTOGRAM_BINS - 1,) float64."""
    per_octave = 1 << HISTOGRAM_MANTISSA_BITS
    octave = np.arange(HISTOGRAM_MIN_EXPONENT, HISTOGRAM_MAX_EXPONENT)
    steps = 1.0 + np.arange(per_octave) / per_octave
    return np.append((2.0 ** octave[:, None] * steps).ravel(), 2.0**HISTOGRAM_MAX_EXPONENT)


def discarded_above(counts: np.ndarray) -> np.ndarray:
    """Pixels with a distance at or above each of ``edges()``.  (HISTOGRAM_BINS,) -> (HISTOGRAM_BINS - 1,)."""
    return np.cumsum(np.asarray(counts)[::-1])[::-1][1:]
