"""Intervals for means over the frames of a sequence, a moving-block bootstrap; Holm's correction of p-values.

Neighboring frames are alike, so that the usual standard error of a mean over frames is too small.  The moving-block
bootstrap (Kunsch 1989) draws blocks of consecutive frames with replacement; within a block the dependence is kept.  The
block length is that of Politis and White 2004 (corrected by Patton, Politis and White 2009) for the circular bootstrap,
which has the same asymptotic variance.  Percentiles of a bootstrap over few units are too narrow; they are expanded as
Hesterberg 2015 (What Teachers Should Know About the Bootstrap, section 4.3) does, with the number of blocks in the
place of the sample size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

Array = np.ndarray

RESAMPLES = 4999
CONFIDENCE = 0.95
MIN_BLOCKS = 4
MIN_FRAMES = 2 * MIN_BLOCKS
"""Least number of frames that have an interval."""


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate, its confidence interval, and the two-sided p-value of 0."""

    estimate: float
    low: float
    high: float
    p_value: float


def block_length(series: Array) -> int:
    """Block length for the mean of a stationary series (n,), from 1 to n / MIN_BLOCKS.

    The autocovariance is summed under a flat-top window whose width is twice the lag from which on the autocorrelation
    is insignificant (Politis and White 2004, section 3.2).
    """
    x = np.asarray(series, dtype=np.float64)
    n, centered = len(x), np.asarray(series, dtype=np.float64) - np.mean(series)
    most = max(1, n // MIN_BLOCKS)
    variance = float(centered @ centered) / n
    if n < MIN_FRAMES or not variance > 1e-24 * float(np.abs(x).max()) ** 2:
        return 1
    covariance = np.correlate(centered, centered, "full")[n - 1 :] / n
    run = max(5, math.ceil(math.sqrt(math.log10(n))))
    small = np.abs(covariance) / variance < 2.0 * math.sqrt(math.log10(n) / n)
    lag = next((k for k in range(1, n - run) if small[k : k + run].all()), max(1, n - run))
    width = min(2 * lag, n - 1)
    lags = np.arange(1, width + 1)
    window = np.clip(2.0 * (1.0 - lags / width), 0.0, 1.0)
    spectrum = covariance[0] + 2.0 * float(window @ covariance[lags])
    slope = 2.0 * float(window @ (lags * covariance[lags]))
    if spectrum <= 0:
        return most
    length = (2.0 * slope**2 / (4.0 / 3.0 * spectrum**2)) ** (1.0 / 3.0) * n ** (1.0 / 3.0)
    return int(np.clip(2 * math.ceil(length), 1, most))


def resampled_means(series: Array, length: int, resamples: int = RESAMPLES) -> Array:
    """Means over frames of ``resamples`` bootstrap sequences.  (n, k) -> (resamples, k) float64.

    All k columns get the same frames: differences between them are paired.  ``length``: of the blocks, frames; the last
    block is cut so that every sequence has n frames.
    """
    x = np.asarray(series, dtype=np.float64)
    n = len(x)
    whole, remainder = divmod(n, length)
    starts = np.random.default_rng(0).integers(0, n - length + 1, size=(resamples, whole + (remainder > 0)))
    # Each block is a sum of its own: differences of cumulative sums lose small values beside large ones.
    sums = {of: sliding_window_view(x, of, axis=0).sum(axis=-1) for of in {length, remainder or length}}
    total = np.zeros((resamples, x.shape[1]))
    for block in range(starts.shape[1]):
        total += sums[length if block < whole else remainder][starts[:, block]]
    return total / n


def interval(
    series: Array, statistic: Callable[[Array], Array], length: int, *, resamples: int = RESAMPLES
) -> Interval | None:
    """The interval of ``statistic`` of the column means of ``series`` (n, k).  ``statistic``: (..., k) -> (...).

    None where it is not finite, of the series or of a sequence drawn from it.
    """
    x = np.asarray(series, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        estimate = float(statistic(x.mean(axis=0)))
        drawn = statistic(resampled_means(x, length, resamples))
    if not (math.isfinite(estimate) and np.isfinite(drawn).all()):
        return None
    blocks = len(x) / length
    error = float(np.std(drawn)) * math.sqrt(blocks / (blocks - 1.0))
    return _student(estimate, error, blocks - 1.0)


def _student(estimate: float, error: float, freedom: float) -> Interval:
    from scipy import stats  # imported late: 2 s

    half = float(stats.t.isf(0.5 * (1.0 - CONFIDENCE), freedom)) * error
    p_value = float(2.0 * stats.t.sf(abs(estimate) / error, freedom)) if error > 0 else float(estimate == 0.0)
    return Interval(estimate, estimate - half, estimate + half, p_value)


def student_interval(values: Array) -> Interval:
    """Mean of independent values (n,), two or more, and its interval by Student's t."""
    x = np.asarray(values, dtype=np.float64)
    error = float(x.std(ddof=1)) / math.sqrt(len(x))
    return _student(float(x.mean()), error, len(x) - 1.0)


def holm_adjusted(p_values: Array) -> Array:
    """Holm's adjusted p-values: Holm's method rejects at every significance from them on.  -> float64, same shape.

    The i-th smallest of m values becomes the largest of (m - j + 1) p_j over j <= i, at most 1 (Holm 1979).
    """
    flat = np.asarray(p_values, dtype=np.float64).ravel()
    order = np.argsort(flat, kind="stable")
    raised = np.maximum.accumulate(flat[order] * (len(flat) - np.arange(len(flat))))
    adjusted = np.empty(len(flat))
    adjusted[order] = np.minimum(raised, 1.0)
    return adjusted.reshape(np.shape(p_values))
