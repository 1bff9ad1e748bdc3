"""Running mean, variance, minimum and maximum, in one pass and constant memory."""

from __future__ import annotations

import math

import numpy as np


class Welford:
    """Count, mean, variance, minimum and maximum of values that come one by one, in float64.

    Welford (1962): no sums of squares, so a small variance around a large mean keeps its precision.
    NaN and Inf propagate: the caller removes invalid values first.
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

    @property
    def variance(self) -> float:
        """Population variance; NaN before a value is added."""
        if not self.count:
            return math.nan
        # Rounding can give -1e-30 for equal values.  np.maximum keeps NaN.
        return float(np.maximum(self._m2, 0.0)) / self.count
