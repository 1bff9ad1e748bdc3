"""Sampled pairs: the estimator against textbook formulas, and its intervals against full runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from repeated import few
from scipy import stats

from taubench_gl.metrics.pair_sample import PairSample, estimate, sample_pairs

RESAMPLINGS = 200


def test_interval_of_a_random_sample():
    values = np.array([3.0, 7.0, 4.0, 6.0])
    found = estimate(PairSample(20, ((20, (1, 5, 9, 17)),)), values)
    half = stats.t.ppf(0.975, 3) * values.std(ddof=1) / 2 * math.sqrt(1 - 4 / 20)
    assert found.mean == 5.0
    assert found.half_width == pytest.approx(half, rel=1e-12)


def test_strata_are_weighted_by_their_size():
    sample = PairSample(10, ((8, (0, 4)), (2, (8, 9))))
    found = estimate(sample, np.array([1.0, 3.0, 10.0, 20.0]))
    assert found.mean == pytest.approx(0.8 * 2.0 + 0.2 * 15.0)
    # The second stratum is complete: only the two pairs of the first have an error, with one degree of freedom.
    assert found.half_width == pytest.approx(stats.t.ppf(0.975, 1) * 0.8 * math.sqrt((1 - 2 / 8) * 2.0 / 2))


def test_complete_samples_have_no_error():
    values = np.arange(7.0)
    assert estimate(sample_pairs(7, "all"), values).half_width == 0.0
    assert estimate(sample_pairs(7, "strata", 7), values).half_width == 0.0
    assert estimate(sample_pairs(9, "every", 3), np.array([1e-90, 2e-90, 4e-90])).half_width == pytest.approx(
        0.0, abs=1e-80
    )


def test_one_pair_has_no_interval():
    assert estimate(sample_pairs(5, "every", 5), np.array([2.0])).half_width is None


@pytest.mark.parametrize("total", [1, 2, 3, 10, 47])
@pytest.mark.parametrize(
    ("scheme", "number"), [("every", 1), ("every", 4), ("every", 100), ("strata", 3), ("strata", 60)]
)
def test_samples_are_valid_and_reproducible(total, scheme, number):
    sample = sample_pairs(total, scheme, number)
    assert len(set(sample.positions)) == len(sample.positions) > 0
    assert set(sample.positions) <= set(range(total))
    assert sum(size for size, _ in sample.strata) == sample.total == total
    assert sample_pairs(total, scheme, number) == sample


def coverage(values: np.ndarray, scheme: str, numbers: range) -> float:
    """Share of RESAMPLINGS random samples whose interval contains the mean of all pairs; ``numbers`` to choose from."""
    rng = np.random.default_rng(7)
    hits = 0
    for _ in range(RESAMPLINGS):
        sample = sample_pairs(len(values), scheme, int(rng.choice(numbers)), rng)
        found = estimate(sample, values[list(sample.positions)])
        hits += abs(found.mean - values.mean()) <= found.half_width + 1e-12
    return hits / RESAMPLINGS


def populations() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(11)
    walk = np.cumsum(rng.normal(size=400))
    return {
        "independent": rng.gamma(2.0, 3.0, size=300),
        "drifting": walk - walk.min(),
        "trend": np.linspace(0.0, 20.0, 250) + rng.normal(size=250),
    }


SCHEMES = [("strata", range(6, 7)), ("strata", range(8, 9)), ("strata", range(20, 21)), ("every", range(3, 13))]
"""Every k-th pair allows only k samples for one k, so resampling also varies k."""


MADE = ("independent", "drifting", "trend")


@pytest.mark.parametrize("name", few(MADE))
@pytest.mark.parametrize(("scheme", "numbers"), SCHEMES)
def test_coverage_for_synthetic_populations(name, scheme, numbers):
    assert coverage(populations()[name], scheme, numbers) >= 0.9
