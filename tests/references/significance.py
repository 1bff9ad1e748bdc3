"""Two-sample tests of noisy images: is the difference of two renderers more than their noise?

An image is cut into blocks; each renderer gives independent samples (seeds) of a block's mean radiance.  Welch's t-test
compares the two means of a block by the variances that the samples themselves have; Holm's method holds the probability
of any false rejection in all blocks and channels together at the significance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Estimate:
    """Mean and variance of ``count`` independent samples of the same quantities.  All arrays have one shape."""

    mean: Array
    variance: Array  # of one sample, unbiased
    count: int

    @classmethod
    def of(cls, samples: Array) -> Estimate:
        """``samples``: (count, ...), two or more."""
        values = np.asarray(samples, dtype=np.float64)
        return cls(values.mean(axis=0), values.var(axis=0, ddof=1), len(values))

    @property
    def error2(self) -> Array:
        """Squared standard error of the mean."""
        return self.variance / self.count


def block_means(image: Array, side: int) -> Array:
    """Means of ``side`` x ``side`` pixels.  (..., h, w, c) -> (..., h // side, w // side, c) float64.

    Rows and columns that fill no block are left out.
    """
    *lead, h, w, c = image.shape
    rows, columns = h // side, w // side
    cut = np.asarray(image[..., : rows * side, : columns * side, :], dtype=np.float64)
    return cut.reshape(*lead, rows, side, columns, side, c).mean(axis=(-4, -2))


def welch_p_values(a: Estimate, b: Estimate, tolerance: Array | float = 0.0) -> Array:
    """Two-sided p-value of |mean of a - mean of b| <= ``tolerance``, per element.  -> float64, shape of the means.

    Where neither has variance, p is 1 if the means agree within the tolerance, else 0.
    """
    excess = np.maximum(np.abs(a.mean - b.mean) - tolerance, 0.0)
    squared = a.error2 + b.error2
    noisy = squared > 0
    safe = np.where(noisy, squared, 1.0)
    denominator = a.error2**2 / max(a.count - 1, 1) + b.error2**2 / max(b.count - 1, 1)
    freedom = np.where(noisy, safe**2 / np.where(noisy, np.maximum(denominator, 1e-300), 1.0), 1.0)
    p = 2.0 * stats.t.sf(excess / np.sqrt(safe), freedom)
    return np.where(noisy, p, np.where(excess > 0, 0.0, 1.0))


def holm_rejected(p_values: Array, significance: float = 0.01) -> Array:
    """Hypotheses that Holm's step-down method rejects.  -> bool, same shape.

    ``significance``: largest probability of any false rejection among them all (family-wise error rate).
    """
    flat = np.asarray(p_values, dtype=np.float64).ravel()
    order = np.argsort(flat, kind="stable")
    passed = flat[order] > significance / (len(flat) - np.arange(len(flat)))
    first_kept = int(np.argmax(passed)) if passed.any() else len(flat)
    rejected = np.zeros(len(flat), dtype=bool)
    rejected[order[:first_kept]] = True
    return rejected.reshape(np.shape(p_values))


def relative_difference(a: Estimate, b: Estimate) -> tuple[float, float]:
    """(mean of a) / (mean of b) - 1 over all elements, and its standard error from the elements' variances.

    The standard error takes the elements for independent.
    """
    reference = float(b.mean.mean())
    difference = float(a.mean.mean()) / reference - 1.0
    return difference, float(np.sqrt((a.error2 + b.error2).sum())) / a.mean.size / abs(reference)
