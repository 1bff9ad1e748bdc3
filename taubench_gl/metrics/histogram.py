"""Histogram of feature distances and the discard-versus-threshold curve it stands for (docs/conventions.md)."""

from __future__ import annotations

import numpy as np

from taubench_gl.conventions import (
    HISTOGRAM_MANTISSA_BITS,
    HISTOGRAM_MAX_EXPONENT,
    HISTOGRAM_MIN_EXPONENT,
    histogram_bins,
)


def bin_of(distance: np.ndarray, mantissa_bits: int = HISTOGRAM_MANTISSA_BITS) -> np.ndarray:
    """Bin index of distances >= 0 (...) -> (...) int64.  Cut from float32 bits: twin of ``histogram_bin`` in GLSL.

    ``mantissa_bits``: 2^bits equal bins per octave.
    """
    key = np.asarray(distance, dtype=np.float32).view(np.uint32) >> (23 - mantissa_bits)
    first = (127 + HISTOGRAM_MIN_EXPONENT) << mantissa_bits
    return np.clip(key.astype(np.int64) - first + 1, 0, histogram_bins(mantissa_bits) - 1)


def edges(mantissa_bits: int = HISTOGRAM_MANTISSA_BITS) -> np.ndarray:
    """Lower edge of every bin but bin 0 (whose lower edge is 0).  (histogram_bins - 1,) float64."""
    per_octave = 1 << mantissa_bits
    octave = np.arange(HISTOGRAM_MIN_EXPONENT, HISTOGRAM_MAX_EXPONENT)
    steps = 1.0 + np.arange(per_octave) / per_octave
    return np.append((2.0 ** octave[:, None] * steps).ravel(), 2.0**HISTOGRAM_MAX_EXPONENT)


def discarded_above(counts: np.ndarray) -> np.ndarray:
    """Pixels with a distance at or above each of ``edges()``.  (HISTOGRAM_BINS,) -> (HISTOGRAM_BINS - 1,)."""
    return np.cumsum(np.asarray(counts)[::-1])[::-1][1:]
