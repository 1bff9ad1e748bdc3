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


def coverage(correlation: float, blocks: bool) -> float:
    """Share of 95 % intervals of the mean that contain it."""
    rng = np.random.default_rng(7)
    hits = 0
    for _ in range(TRIALS):
        x = autoregressive(rng, FRAMES, correlation)
        length = block_length(x) if blocks else 1
        hits += contains_zero(interval(x[:, None], first, length, resamples=300))
    return hits / TRIALS


@pytest.mark.parametrize("length", [1, 3, 4])
def test_small_values_beside_large_ones_keep_their_sums(length):
    """Whole sums of drawn frames, for values from 1e-17 to 0.1; the small ones come last."""
    x = np.array([0.15, 0.12, *[1.7e-17] * 9])
    means = resampled_means(x[:, None], length, 500)[:, 0]
    assert (means >= 1.7e-17 * (1.0 - 1e-12)).all()
    smallest = means[means < 1e-3]
    assert len(smallest) and smallest == pytest.approx(1.7e-17, rel=1e-12)


def test_a_statistic_that_is_not_finite_has_no_interval():
    x = np.array([1.0, 2.0, *[0.0] * 10])[:, None]
    assert interval(x, lambda means: np.log10(means[..., 0]), 2) is None
    assert interval(x, first, 2) is not None


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.8])
def test_coverage_of_dependent_frames(correlation):
    # Of 200 intervals with 95 %: 0.95 +- 3 standard errors is 0.904 to 0.996; strong dependence of 96 frames, which
    # are some 10 independent ones, costs two percentage points.
    assert coverage(correlation, True) >= (0.904 if correlation < 0.8 else 0.884)


def test_single_frames_instead_of_blocks_cover_too_little():
    assert coverage(0.8, False) < 0.65
    assert coverage(0.0, False) >= 0.904


def test_coverage_of_a_paired_difference_with_shared_frames():
    # Two methods share the content of the frame, which cancels; the difference is AR(1) around 0.3.
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(TRIALS):
        content, own = 5.0 * autoregressive(rng, FRAMES, 0.9), autoregressive(rng, FRAMES, 0.5)
        pair = np.stack([content + 0.3 + own, content], axis=-1)
        found = interval(pair, lambda m: m[..., 0] - m[..., 1], block_length(pair[:, 0] - pair[:, 1]), resamples=300)
        hits += found.low <= 0.3 <= found.high
    assert hits / TRIALS >= 0.904


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
