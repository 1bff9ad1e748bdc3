"""Steps per frame with exactly a given mean, variance and maximum.

The steps are quantiles of a Weibull distribution at evenly spaced ranks, clamped to the maximum.  The exponent
determines the variance, the scale the mean.  Both are solved for on the finite list, so there is no sampling error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taubench_gl.errors import SettingsError

Array = np.ndarray

CORRELATION = 0.92
"""Correlation of successive step sizes: motion grows and fades over about ten frames, as of a hand or head."""

_SLACK = 1e-9


@dataclass(frozen=True, slots=True)
class MotionStats:
    """Absolute change per frame of one quantity, in meters or degrees, as in Tables 2 and 3 of the paper.

    ``variance`` is the population variance.  ``maximum``, if given, is attained; ``usual_maximum`` then bounds all
    other steps, so that the largest one is a jump.  Raises SettingsError for impossible values.
    """

    mean: float
    variance: float = 0.0
    maximum: float | None = None
    usual_maximum: float | None = None

    def __post_init__(self) -> None:
        values = [self.mean, self.variance, *(v for v in (self.maximum, self.usual_maximum) if v is not None)]
        if not all(math.isfinite(v) for v in values):
            raise SettingsError(f"statistics {self} are not finite")
        if self.mean < 0 or self.variance < 0:
            name = "mean" if self.mean < 0 else "variance"
            raise SettingsError(f"{name} of a motion is {getattr(self, name):g}", hint="give a number of at least 0")
        if self.mean == 0 and self.variance > 0:
            raise SettingsError(f"mean 0 with variance {self.variance:g}: steps are lengths, never below 0")
        if self.maximum is not None and self.maximum < self.mean:
            raise SettingsError(f"max {self.maximum:g} is below the mean {self.mean:g}")

    def __str__(self) -> str:
        most = "" if self.maximum is None else f", max {self.maximum:g}"
        return f"mean {self.mean:g}, variance {self.variance:g}{most}"

    @property
    def still(self) -> bool:
        """Whether the mean is 0, so that nothing moves."""
        return self.mean == 0


def sorted_steps(stats: MotionStats, count: int, cap: float = math.inf) -> Array:
    """Steps of at most ``cap`` with exactly these statistics.  -> (count,) float64, ascending, >= 0; ``count`` >= 1.

    Raises SettingsError with the reason if there is no such list.
    """
    if count < 1:
        raise SettingsError("a motion needs at least two frames")
    if stats.still:
        return np.zeros(count)
    total, squares = count * stats.mean, count * (stats.variance + stats.mean**2)
    if stats.maximum is None:
        return _solve(total, squares, count, cap, stats)
    if stats.maximum > cap:
        raise SettingsError(f"max {stats.maximum:g} is above the limit of {cap:g} per frame")
    high = stats.maximum if stats.usual_maximum is None else min(stats.usual_maximum, stats.maximum)
    other_steps = _solve(total - stats.maximum, squares - stats.maximum**2, count - 1, high, stats)
    return np.append(other_steps, stats.maximum)


def ordered_steps(stats: MotionStats, count: int, rng: np.random.Generator, cap: float = math.inf) -> Array:
    """The steps of ``sorted_steps`` in an order of slowly changing sizes (``CORRELATION``).  -> (count,) float64."""
    steps = sorted_steps(stats, count, cap)
    noise = rng.standard_normal(count)
    slow = np.empty(count)
    slow[0] = noise[0]
    for i in range(1, count):
        slow[i] = CORRELATION * slow[i - 1] + math.sqrt(1.0 - CORRELATION**2) * noise[i]
    steps = steps[np.argsort(np.argsort(slow))]
    if stats.usual_maximum is not None:  # the jump is in the middle of the path
        middle, jump = count // 2, int(np.argmax(steps))
        steps[[middle, jump]] = steps[[jump, middle]]
    return steps


def _solve(total: float, squares: float, count: int, high: float, stats: MotionStats) -> Array:
    """Ascending values in [0, high] with this sum and sum of squares.  -> (count,) float64.  Raises SettingsError."""
    if count == 0:
        if abs(total) > _SLACK * stats.mean or abs(squares) > _SLACK * stats.mean**2:
            raise SettingsError(f"one step cannot have {stats}", hint="one step has variance 0 and is its own max")
        return np.zeros(0)
    # With a given sum, the sum of squares is least if all steps are equal, and most if as many as fit are at the limit.
    mean = total / count
    least = count * mean**2
    if stats.maximum is None and mean > high:
        raise SettingsError(f"mean {mean:g} is above the limit of {high:g} per frame")
    if mean < 0 or mean > high * (1 + _SLACK) or squares < least - _SLACK * max(squares, least):
        raise SettingsError(f"no {count + (stats.maximum is not None)} steps have {stats}", hint=_why(stats, count))
    if high < math.inf:
        full = min(math.floor(total / high), count)
        most = full * high**2 + (total - full * high) ** 2
        if squares > most * (1 + _SLACK):
            bound = f"at most {high:g} each" if stats.maximum is None or stats.usual_maximum else "the max"
            hint = "give less variance or a larger max"
            raise SettingsError(f"no {count} steps with {bound} have {stats}", hint=hint)
    elif squares > total**2 * (1 + _SLACK):
        raise SettingsError(f"no {count} steps have {stats}", hint="give less variance or more frames")
    if squares - least <= 1e-12 * least:
        return np.full(count, min(mean, high))
    if mean == 0:
        return np.zeros(count)
    ranks = (np.arange(count) + 0.5) / count
    log_rank = np.log(-np.log1p(-ranks))  # logarithm of Weibull quantiles with exponent 1

    def values(exponent: float) -> Array:
        shape = exponent * (log_rank - log_rank[-1])
        low, top = math.log(mean), math.log(mean * count) if high == math.inf else math.log(high) - shape[0]

        def below(log_scale: float) -> bool:
            return float(np.exp(np.minimum(shape + log_scale, math.log(high))).sum()) < total

        scale = _bisect(below, low, top + 1.0)
        return np.minimum(np.exp(np.minimum(shape + scale, math.log(high))), high)  # exp(log(x)) may exceed x

    exponent = _bisect(lambda p: float(np.sum(values(p) ** 2)) < squares, 0.0, 2000.0)
    return _polish(values(exponent), total, squares, high)


def _polish(values: Array, total: float, squares: float, high: float) -> Array:
    """Correct rounding errors of sum and sum of squares by an affine map, unless it would leave the range."""
    count, mean = len(values), total / len(values)
    spread = math.sqrt(float(np.mean((values - values.mean()) ** 2)))
    required = math.sqrt(max(squares / count - mean**2, 0.0))
    if spread == 0:
        return values
    corrected = mean + (values - values.mean()) * (required / spread)
    return corrected if corrected.min() >= 0 and corrected.max() <= high else values


def _bisect(below: Callable[[float], bool], low: float, high: float) -> float:
    """The number in [low, high] up to which ``below`` holds."""
    for _ in range(90):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if below(middle) else (low, middle)
    return 0.5 * (low + high)


def _why(stats: MotionStats, count: int) -> str:
    """What to change in statistics that ``count`` steps beside the largest cannot have."""
    if stats.maximum is None:
        return "give other statistics"
    # With a given maximum, the variance is smallest if all other steps are equal.
    least = (stats.maximum - stats.mean) ** 2 / count
    if stats.variance < least * (1 + _SLACK):
        return f"with this max the variance is at least {least:.3g}"
    needed = math.ceil((stats.maximum**2) / (stats.variance + stats.mean**2))
    return f"with this max at least {needed} steps are needed"
