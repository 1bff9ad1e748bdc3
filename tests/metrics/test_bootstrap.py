"""The moving-block bootstrap: coverage of intervals of series with a known mean, and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.metrics.bootstrap import (
    MIN_BLOCKS,
    Interval,
    block_length,
    interval,
    resampled_means,
    student_interval,
)

TRIALS, FRAMES = 200, 96


def contains_zero(found: Interval) -> bool:
    return found.low <= 0.0 <= found.high


def autoregressive(rng: np.random.Generator, frames: int, correlation: float) -> np.ndarray:
    """x_t = correlation x_(t-1) + e_t, stationary, mean 0."""
    noise = rng.standard_normal(frames)
    x = np.empty(frames)
    x[0] = noise[0] / np.sqrt(1.0 - correlation**2)
    for t in range(1, frames):
        x[t] = correlation * x[t - 1] + noise[t]
    return x


def first(means: np.ndarray) -> np.ndarray:
    return means[..., 0]


@pytest.mark.parametrize("length", [1, 3, 4])
def test_small_values_beside_large_ones_keep_their_sums(length):
    """Whole sums of drawn frames, for values from 1e-17 to 0.1; the small ones come last."""
    x = np.array([0.15, 0.12, *[1.7e-17] * 9])
    means = resampled_means(x[:, None], length, 500)[:, 0]
    assert (means >= 1.7e-17 * (1.0 - 1e-12)).all()
    smallest = means[means < 1e-3]
    assert len(smallest) and smallest == pytest.approx(1.7e-17, rel=1e-12)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8])
def test_coverage_of_dependent_frames(correlation):
    # Of 200 intervals with 95 %: 0.95 +- 3 standard errors is 0.904 to 0.996; strong dependence of 96 frames, which
    # are some 10 independent ones, costs two percentage points.  Single frames as blocks would cover less than 0.65.
    rng = np.random.default_rng(7)
    series = [autoregressive(rng, FRAMES, correlation) for _ in range(TRIALS)]
    hits = sum(contains_zero(interval(x[:, None], first, block_length(x), resamples=300)) for x in series)
    assert hits / TRIALS >= (0.904 if correlation < 0.8 else 0.884)


def test_block_length_grows_with_dependence_and_is_bounded():
    rng = np.random.default_rng(5)
    lengths = [np.mean([block_length(autoregressive(rng, 200, c)) for _ in range(20)]) for c in (0.0, 0.5, 0.9)]
    assert lengths[0] < lengths[1] < lengths[2] <= 200 // MIN_BLOCKS
    assert block_length(np.full(50, 3.0)) == 1 and block_length(np.arange(4.0)) == 1


def test_block_length_of_autoregressive_series_is_near_its_closed_form():
    # Politis and White: (2 G^2 / D)^(1/3) n^(1/3), of AR(1) with correlation c: G = 2 v c / (1 - c)^2,
    # g = v (1 + c) / (1 - c), v the variance, D = 4/3 g^2; ours is twice that.
    n, c = 4000, 0.5
    slope, spectrum = 2.0 * c / (1.0 - c) ** 2, (1.0 + c) / (1.0 - c)
    expected = 2.0 * (2.0 * slope**2 / (4.0 / 3.0 * spectrum**2) * n) ** (1.0 / 3.0)
    rng = np.random.default_rng(9)
    found = np.mean([block_length(autoregressive(rng, n, c)) for _ in range(12)])
    assert found == pytest.approx(expected, rel=0.25)


def test_resampled_means_are_means_of_blocks():
    series = np.arange(6.0)[:, None] * [1.0, 10.0]
    means = resampled_means(series, 6, resamples=3)
    np.testing.assert_allclose(means, np.tile(series.mean(axis=0), (3, 1)))  # one block: the series itself
    means = resampled_means(series, 3, resamples=500)
    sums = {a + b for a in (3, 6, 9, 12) for b in (3, 6, 9, 12)}
    assert {round(6 * v) for v in means[:, 0]} <= sums
    np.testing.assert_allclose(means[:, 1], 10.0 * means[:, 0])  # all columns get the same blocks
    cut = resampled_means(series, 4, resamples=500)[:, 0] * 6
    assert {round(v) for v in cut} <= {a + b for a in (6, 10, 14) for b in (1, 3, 5, 7, 9)}


def test_interval_and_p_value_agree():
    rng = np.random.default_rng(2)
    for shift in (0.0, 0.3, 0.6, 3.0):
        found = interval(rng.standard_normal((40, 1)) + shift, first, 2)
        assert contains_zero(found) == (found.p_value > 0.05)
    assert interval(np.full((12, 1), 2.0), first, 1).p_value == 0.0


def test_student_interval_of_three_values():
    found = student_interval(np.array([1.0, 2.0, 3.0]))
    assert found.estimate == 2.0 and found.high - 2.0 == pytest.approx(4.302653 / np.sqrt(3.0), rel=1e-6)
