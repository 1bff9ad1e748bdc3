"""Two-sample tests of noisy images: is the difference of two renderers more than their noise?

An image is cut into blocks; each renderer gives independent samples (seeds) of a block's mean radiance.  Welch's t-test
compares the two means of a block by the variances that the samples themselves have.
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
    sides = (excess, np.sqrt(a.variance), a.count), (np.zeros_like(excess), np.sqrt(b.variance), b.count)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = stats.ttest_ind_from_stats(*sides[0], *sides[1], equal_var=False).pvalue
    return np.where(a.error2 + b.error2 > 0, p, np.where(excess > 0, 0.0, 1.0))


def relative_difference(a: Estimate, b: Estimate) -> tuple[float, float]:
    """(mean of a) / (mean of b) - 1 over all elements, and its standard error from the elements' variances.

    The standard error takes the elements for independent.
    """
    reference = float(b.mean.mean())
    difference = float(a.mean.mean()) / reference - 1.0
    return difference, float(np.sqrt((a.error2 + b.error2).sum())) / a.mean.size / abs(reference)
