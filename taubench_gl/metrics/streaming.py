"""Running mean, variance, minimum and maximum, in one pass and constant memory."""

from __future__ import annotations

import math

import numpy as np

Array = np.ndarray


class Welford:
    """Count, mean, variance, minimum and maximum of values that come one by one, in float64.

    Welford (1962) for single values; Chan, Golub and LeVeque (1979) for merging.  No sums of squares, so a small
    variance around a large mean keeps its precision.  NaN and Inf propagate: the caller removes invalid values first.
    """

    __slots__ = ("_m2", "count", "max", "mean", "min")

    def __init__(self) -> None:
        self.count = 0
        self.mean = math.nan  # NaN until a value is added
        self.min = math.nan
        self.max = math.nan
        self._m2 = 0.0  # sum of squared deviations from the mean

    def add(self, value: float) -> None:
        """Add one value to the statistics."""
        value = float(value)
        self.count += 1
        if self.count == 1:
            self.mean = self.min = self.max = value
            self._m2 = value - value  # 0, or NaN where the value is not finite
            return
        delta = value - self.mean
        self.mean += delta / self.count
        self._m2 += delta * (value - self.mean)
        # np.fmin / fmax would drop a NaN silently
        self.min = float(np.minimum(self.min, value))
        self.max = float(np.maximum(self.max, value))

    def add_many(self, values: Array) -> None:
        """Add every element of an array of any shape: two passes over the array, then one merge."""
        values = np.asarray(values, dtype=np.float64).ravel()
        if not len(values):
            return
        block = Welford()
        block.count = len(values)
        block.min, block.max = float(values.min()), float(values.max())
        # Differences to the first value: the mean is not rounded at the size of the values.
        offset = float(values[0])
        block.mean = offset + float(np.mean(values - offset))
        deviation = values - block.mean
        # The second term is 0 in exact arithmetic and corrects the rounding of the mean.
        block._m2 = float(np.sum(deviation * deviation) - np.sum(deviation) ** 2 / len(values))
        self.merge(block)

    def merge(self, other: Welford) -> None:
        """Add all values that were added to ``other``."""
        if not other.count:
            return
        if not self.count:
            self.count, self.mean, self._m2 = other.count, other.mean, other._m2
            self.min, self.max = other.min, other.max
            return
        total = self.count + other.count
        delta = other.mean - self.mean
        self._m2 += other._m2 + delta * delta * (self.count * other.count / total)
        self.mean += delta * (other.count / total)
        self.count = total
        self.min = float(np.minimum(self.min, other.min))
        self.max = float(np.maximum(self.max, other.max))

    @property
    def variance(self) -> float:
        """Population variance; NaN before a value is added."""
        if not self.count:
            return math.nan
        # Rounding can give -1e-30 for equal values.  np.maximum keeps NaN.
        return float(np.maximum(self._m2, 0.0)) / self.count
