"""Intervals of shares: closed forms, and how often they hold the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taubench_gl.metrics.pair_sample import PairSample, estimate, share_ends


def test_closed_forms():
    # At one half, logit(p) = 0: 1 / (1 + exp(-+ w / (p (1 - p)))).
    low, high = share_ends(50.0, 10.0)
    assert low == pytest.approx(100.0 / (1.0 + math.exp(0.4)), rel=1e-12)
    assert low + high == pytest.approx(100.0, rel=1e-12)
    # Odds are multiplied and divided by one factor.
    low, high = share_ends(20.0, 8.0)
    odds = [end / (100.0 - end) for end in (low, 20.0, high)]
    assert odds[2] / odds[1] == pytest.approx(math.exp(0.08 / 0.16), rel=1e-12)
    assert odds[1] / odds[0] == pytest.approx(odds[2] / odds[1], rel=1e-12)


def test_narrow_intervals_are_those_of_the_mean():
    for percent in (0.5, 30.0, 99.0):
        np.testing.assert_allclose(share_ends(percent, 1e-6), [percent - 1e-6, percent + 1e-6], rtol=0, atol=1e-9)


@pytest.mark.parametrize("percent", [1e-9, 0.1, 3.0, 50.0, 97.0, 99.999])
@pytest.mark.parametrize("half", [0.0, 1.0, 30.0, 1e6])
def test_ends_hold_the_estimate_within_0_and_100(percent, half):
    low, high = share_ends(percent, half)
    assert 0.0 <= low <= percent + 1e-9 and percent - 1e-9 <= high <= 100.0
    mirrored = share_ends(100.0 - percent, half)
    np.testing.assert_allclose([100.0 - mirrored[1], 100.0 - mirrored[0]], [low, high], rtol=0, atol=1e-6)


def test_shares_without_variance_and_unknown_ones():
    assert share_ends(0.0, 0.0) == [0.0, 0.0] and share_ends(100.0, 0.0) == [100.0, 100.0]
    assert share_ends(12.0, None) is None


def test_intervals_hold_the_mean_of_all_pairs_as_often_as_those_of_student():
    """Shares of pairs as a fast camera has them, near 0 and skewed: eight pairs of four strata."""
    rng, held, student = np.random.default_rng(3), 0, 0
    for _ in range(400):
        every = 100.0 * rng.beta(0.6, 6.0, 96)
        strata = tuple((24, tuple(sorted(24 * h + rng.choice(24, 2, replace=False)))) for h in range(4))
        sample = PairSample(96, strata)
        found = estimate(sample, every[list(sample.positions)])
        low, high = share_ends(found.mean, found.half_width)
        held += low <= every.mean() <= high
        student += abs(found.mean - every.mean()) <= found.half_width
    assert held >= student and held >= 0.9 * 400
