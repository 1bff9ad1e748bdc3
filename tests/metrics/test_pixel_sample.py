"""The difference estimator at random pixels of random pairs: its expectation and its coverage."""

from __future__ import annotations

import numpy as np
import pytest
from repeated import few

from taubench_gl.metrics.pair_sample import PairSample, estimate, sample_pairs
from taubench_gl.metrics.pixel_sample import (
    NORMAL_95,
    PixelStrata,
    SampledPair,
    estimate_share,
    pair_differences,
    stratum_variances,
)

SHAPE, STRATA = (24, 32), 3


def population(pairs: int, rng: np.random.Generator):
    """Strata, x and y of every pixel of ``pairs`` pairs, (pairs, h, w): they disagree by stratum, and more in later
    pairs.
    """
    strata = rng.integers(-1, STRATA, (pairs, *SHAPE))
    x = rng.random((pairs, *SHAPE)) < 0.2 + 0.5 * (np.arange(pairs) / pairs)[:, None, None]
    rate = np.array([0.0, 0.01, 0.05, 0.3])[strata + 1] * (0.5 + np.arange(pairs) / pairs)[:, None, None]
    y = np.where(rng.random(x.shape) < rate, ~x, x)
    return strata, x, y


def estimated(strata, x, y, rng, *, visits: int, pixels: int, scheme=("all", 1)):
    """The interval of one sample of ``visits`` random pairs among those of ``scheme``, and the true share."""
    sample = sample_pairs(len(x), *scheme, rng=rng)
    known = np.array(sample.positions)
    rows = rng.permutation(len(known))[:visits]
    drawn = []
    for row in rows:
        pair = known[row]
        of = PixelStrata.of(strata[pair], STRATA, rng.integers(1 << 30, size=2))
        flat, stratum = of.take(0, of.counts(np.array([0.15, 0.3, 0.5]), pixels))
        d = y[pair].ravel()[flat].astype(float) - x[pair].ravel()[flat]
        drawn.append(SampledPair(x[pair].size, of.sizes, stratum, d[:, None]))
    differences, within = pair_differences(drawn)
    control = x[known].mean(axis=(1, 2))
    return estimate_share(sample, control, rows.tolist(), differences[:, 0], within[:, 0]), float(y.mean())


@pytest.mark.parametrize(
    ("visits", "pixels", "scheme"), few([(6, 96, ("strata", 4)), (4, 96, ("all", 1)), (12, 96, ("all", 1))])
)
def test_intervals_hold_at_least_as_often_as_they_say(visits, pixels, scheme):
    rng = np.random.default_rng(visits + pixels)
    strata, x, y = population(12, rng)
    ends, means = [], []
    for _ in range(600):
        found, truth = estimated(strata, x, y, rng, visits=visits, pixels=pixels, scheme=scheme)
        ends.append(found.ends[0] <= truth <= found.ends[1])
        means.append(found.mean)
    # A share of 600 that is 95 % is above 92.2 % with a probability of 99.9 %.
    assert np.mean(ends) > 0.922
    if scheme == ("all", 1):  # y = x + d is unbiased: its mean over samples has their spread / sqrt(600)
        assert abs(np.mean(means) - truth) < 4.0 * np.std(means) / np.sqrt(600)


def test_every_pixel_of_every_pair_has_no_error():
    rng = np.random.default_rng(1)
    strata, x, y = population(3, rng)
    y = np.where(strata < 0, x, y)  # known without a sample
    found, truth = estimated(strata, x, y, rng, visits=3, pixels=10**9)
    assert found.mean == pytest.approx(truth, abs=1e-12) and found.half_width == pytest.approx(0.0, abs=1e-9)


def test_a_rate_is_a_total_over_a_total():
    """A rate of surface pixels, whose number differs from pair to pair, is exact where every pixel is sampled."""
    rng = np.random.default_rng(4)
    strata, x, y = population(3, rng)
    y = np.where(strata < 0, x, y)
    base = np.array([0.9, 0.4, 0.1])
    drawn = [
        SampledPair(x[k].size, np.bincount(strata[k][strata[k] >= 0], minlength=STRATA), strata[k][strata[k] >= 0],
                    (y[k].astype(float) - x[k])[strata[k] >= 0][:, None])
        for k in range(3)
    ]  # fmt: skip
    differences, within = pair_differences(drawn)
    sample, control = sample_pairs(3, "all", 1), x.mean(axis=(1, 2))
    found = estimate_share(sample, control, [0, 1, 2], differences[:, 0], within[:, 0], base)
    assert found.mean == pytest.approx(y.mean(axis=(1, 2)).sum() / base.sum(), abs=1e-12)
    few = estimate_share(sample, control, [0, 1], differences[:2, 0], np.full(2, 1e-4), base)
    same = estimate_share(sample, control, [0, 1], differences[:2, 0], np.full(2, 1e-4))
    assert few.half_width == pytest.approx(same.half_width / base.mean(), rel=1e-9) and same.half_width > 0.0


def test_a_rate_that_all_pairs_share_is_known_from_some_of_them():
    """The error of a ratio is that of control - rate x base, not of the control alone (Cochran, section 6.11)."""
    sample = PairSample(20, ((20, (1, 5, 9, 17)),))
    base, none = np.array([0.2, 0.9, 0.5, 0.7]), np.zeros(4)
    found = estimate_share(sample, 0.3 * base, [0, 1, 2, 3], none, none, base)
    assert found.mean == pytest.approx(0.3) and found.half_width == pytest.approx(0.0, abs=1e-12)
    share = estimate_share(sample, 0.3 * base, [0, 1, 2, 3], none, none)
    assert share.half_width == pytest.approx(estimate(sample, 0.3 * base).half_width) and share.half_width > 0.05


def test_a_stratum_without_a_difference_has_the_interval_of_the_rule_of_three():
    pair = SampledPair(1000, np.array([1000]), np.zeros(300, np.int64), np.zeros((300, 1)))
    _, variance = stratum_variances([pair])
    assert NORMAL_95 * np.sqrt(variance[0, 0] / 300) == pytest.approx(3.0 / 300)


def test_visits_of_a_pair_have_other_pixels():
    of = PixelStrata.of(np.random.default_rng(2).integers(-1, 3, SHAPE), 3, (1, 2))
    counts = of.counts(np.array([0.2, 0.2, 0.9]), 100)
    taken = np.concatenate([of.take(k, counts)[0] for k in range(20)])
    assert len(np.unique(taken)) == len(taken) == of.sizes.sum()
    assert counts[2] > 3 * counts[0] * of.sizes[2] / of.sizes[0]


def test_pixels_beyond_the_known_pairs_widen_the_interval():
    rng = np.random.default_rng(5)
    strata, x, y = population(12, rng)
    every, _ = estimated(strata, x, y, rng, visits=6, pixels=60)
    some, _ = estimated(strata, x, y, rng, visits=6, pixels=60, scheme=("strata", 3))
    assert every.of_pixels == every.half_width and some.of_pixels < some.half_width
