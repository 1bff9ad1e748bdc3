"""Counts, percentages (Eq. 4) and distance histograms.  Exact integers first, float64 last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taubench_gl.conventions import (
    FRUSTUM,
    HISTOGRAM_MANTISSA_BITS,
    HISTOGRAM_MAX_EXPONENT,
    HISTOGRAM_MIN_EXPONENT,
    Reason,
    histogram_bins,
)
from taubench_gl.features import MASK_WORDS
from taubench_gl.metrics.reuse_rate import RATE_BITS, occupied

Array = np.ndarray

WORDS = np.arange(MASK_WORDS, dtype=np.uint32)
CLASSES = ("first", "cut", "invalid", "frustum", "comparable")
"""Disjoint classes that cover all pixels: their counts add up to w * h."""

_CLASS_BITS = (Reason.FIRST, Reason.CUT, Reason.INVALID, FRUSTUM, Reason(0))
_CLASS_OF_WORD = {  # a word belongs to the first class with one of its bits; to the last without any
    name: (((WORDS & bits) != 0) | (bits == 0)) & ((WORDS & sum(_CLASS_BITS[:i])) == 0)
    for i, (name, bits) in enumerate(zip(CLASSES, _CLASS_BITS, strict=True))
}

_MEMBERS = {"pixels": WORDS >= 0}
_MEMBERS |= {f"reusable_{rate}": (WORDS & (bits | Reason.SKY)) == 0 for rate, bits in RATE_BITS.items()}
_MEMBERS |= _CLASS_OF_WORD
_MEMBERS |= {bit.name.lower(): (WORDS & bit) != 0 for bit in Reason if bit.name.lower() not in _MEMBERS}
_MEMBER_TABLE = np.stack(list(_MEMBERS.values()), axis=-1)  # (words, counts): one product instead of a sum per count


@dataclass(frozen=True, slots=True)
class Counts:
    """Exact pixel counts of one pair."""

    mask_histogram: np.ndarray  # (MASK_WORDS,) pixels per mask word; uint32 as read back, int64 once added
    histograms: np.ndarray  # (features, HISTOGRAM_BINS) pixels per bin of each feature's distance
    other: np.ndarray | None = None  # as ``mask_histogram``, under the other reprojection; None: not counted

    def __add__(self, other: Counts) -> Counts:
        """Exact sum of both, as of several samples per pixel."""
        words, distances = (np.asarray(x, dtype=np.int64) for x in (self.mask_histogram, self.histograms))
        of_other = None if self.other is None else np.asarray(self.other, dtype=np.int64) + other.other
        return Counts(words + other.mask_histogram, distances + other.histograms, of_other)


def counts_of(mask_histogram: Array) -> dict[str, int]:
    """Pixel counts by class and reason from the mask histogram.  (MASK_WORDS,) pixels per reason word -> {name: int}.

    Bits that are never set count 0, also for features that were not measured.
    """
    words, pixels = occupied(mask_histogram)
    return dict(zip(_MEMBERS, (pixels @ _MEMBER_TABLE[words]).tolist(), strict=True))


def percent(counts: Mapping[str, int], column: str) -> float:
    """Eq. (4): percentage of all w * h pixels."""
    return 100.0 * counts[column] / counts["pixels"]


def comparable_percent(counts: Mapping[str, int], column: str) -> float | None:
    """Percentage of comparable pixels (for frustum: comparable plus frustum pixels); None where there are none."""
    base = counts["comparable"] + (counts["frustum"] if column == "frustum" else 0)
    return 100.0 * counts[column] / base if base else None


def bin_of(distance: np.ndarray, mantissa_bits: int = HISTOGRAM_MANTISSA_BITS) -> np.ndarray:
    """Bin index of distances >= 0, from their float32 bits.  (...) -> (...) int64.

    Reference for ``histogram_bin`` in GLSL.

    ``mantissa_bits``: 2^bits equal bins per octave.
    """
    key = np.asarray(distance, dtype=np.float32).view(np.uint32) >> (23 - mantissa_bits)
    first = (127 + HISTOGRAM_MIN_EXPONENT) << mantissa_bits
    return np.clip(key.astype(np.int64) - first + 1, 0, histogram_bins(mantissa_bits) - 1)


def edges(mantissa_bits: int = HISTOGRAM_MANTISSA_BITS) -> np.ndarray:
    """Lower edge of every bin except bin 0, whose lower edge is 0.  (histogram_bins - 1,) float64."""
    per_octave = 1 << mantissa_bits
    octave = np.arange(HISTOGRAM_MIN_EXPONENT, HISTOGRAM_MAX_EXPONENT)
    steps = 1.0 + np.arange(per_octave) / per_octave
    return np.append((2.0 ** octave[:, None] * steps).ravel(), 2.0**HISTOGRAM_MAX_EXPONENT)


def discarded_above(counts: np.ndarray) -> np.ndarray:
    """Pixels with a distance at or above each of ``edges()``.  (HISTOGRAM_BINS,) -> (HISTOGRAM_BINS - 1,)."""
    return np.cumsum(np.asarray(counts)[::-1])[::-1][1:]


def discarded_at(counts: np.ndarray, threshold: float) -> float | None:
    """Pixels with a distance above ``threshold``, from a histogram of distances.  (HISTOGRAM_BINS,) -> float.

    Exact at the edges of the bins; between two edges the count is linear in the logarithm of the threshold.  None
    beyond the edges, where a histogram tells nothing.
    """
    bounds = edges()
    if not bounds[0] <= threshold <= bounds[-1]:
        return None
    return float(np.interp(np.log2(threshold), np.log2(bounds), discarded_above(counts)))
