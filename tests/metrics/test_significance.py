"""The two-sample test of noisy images: levels, power, and the correction for many comparisons."""

from __future__ import annotations

import numpy as np
import pytest
from references.significance import Estimate, block_means, holm_rejected, relative_difference, welch_p_values
from scipy import stats

from taubench_gl.metrics.bootstrap import holm_adjusted

SHAPE = (14, 24, 3)


def samples(rng, count, scale=1.0, shape=SHAPE):
    """Block means of radiance 0.2 to 1.2 with a noise of 2 %, as a path tracer's at a few dozen samples."""
    truth = 0.2 + np.random.default_rng(1).random(shape)
    return scale * truth * (1.0 + 0.02 * rng.standard_normal((count, *shape)))


def test_p_values_are_those_of_scipy():
    rng = np.random.default_rng(2)
    a, b = rng.normal(1.0, 0.1, (16, 50)), rng.normal(1.02, 0.3, (6, 50))
    expected = stats.ttest_ind(a, b, equal_var=False).pvalue
    np.testing.assert_allclose(welch_p_values(Estimate.of(a), Estimate.of(b)), expected, rtol=1e-9)


def test_the_errors_that_equal_renderers_give_are_the_significance():
    """Over many images, some block is rejected in at most 1 % of them (99.9 % bound of 400 trials)."""
    rng = np.random.default_rng(3)
    false = sum(
        holm_rejected(welch_p_values(Estimate.of(samples(rng, 16)), Estimate.of(samples(rng, 8)))).any()
        for _ in range(400)
    )
    assert false <= stats.binom.ppf(0.999, 400, 0.01)


@pytest.mark.parametrize("scale", [0.98, 1.02])
def test_a_bias_of_two_percent_is_found(scale):
    rng = np.random.default_rng(4)
    a, b = Estimate.of(samples(rng, 16, scale)), Estimate.of(samples(rng, 8))
    difference, error = relative_difference(a, b)
    assert abs(difference - (scale - 1.0)) < 4 * error < 0.002


def test_a_wrong_block_is_found():
    rng = np.random.default_rng(5)
    a = samples(rng, 16)
    a[:, 3, 5] *= 1.2
    rejected = holm_rejected(welch_p_values(Estimate.of(a), Estimate.of(samples(rng, 8))))
    assert rejected[3, 5].all() and rejected.sum() == 3


def test_blocks_without_noise_are_compared_within_the_tolerance():
    one = np.ones((4, 3))
    a, b = Estimate.of(one * [1.0, 1.001, 1.1]), Estimate.of(one)
    np.testing.assert_array_equal(welch_p_values(a, b, tolerance=0.002), [1.0, 1.0, 0.0])


def test_holm_rejects_step_by_step():
    p = np.array([0.004, 0.0001, 0.9, 0.003])
    # Levels 0.0025, 0.00333, 0.005, 0.01 in order of p.
    np.testing.assert_array_equal(holm_rejected(p), [True, True, False, True])
    np.testing.assert_array_equal(holm_rejected(np.array([0.003, 0.9, 0.9, 0.9])), [False] * 4)
    assert holm_rejected(np.zeros((2, 2))).all() and not holm_rejected(np.zeros(0)).any()


def test_block_means_leave_out_incomplete_blocks():
    image = np.arange(5 * 7 * 1, dtype=np.float32).reshape(5, 7, 1)
    means = block_means(image, 2)
    assert means.shape == (2, 3, 1) and means[0, 0, 0] == np.mean([0, 1, 7, 8])
    assert block_means(np.zeros((4, 6, 8, 3)), 4).shape == (4, 1, 2, 3)


def test_holm_by_hand():
    # Sorted 0.005, 0.01, 0.03, 0.04 times 4, 3, 2, 1: 0.02, 0.03, 0.06, 0.04, the last not below the one before.
    p_values = np.array([[0.01, 0.04], [0.03, 0.005]])
    np.testing.assert_allclose(holm_adjusted(p_values), [[0.03, 0.06], [0.06, 0.02]])
    np.testing.assert_array_equal(holm_rejected(p_values, 0.05), [[True, False], [False, True]])
    np.testing.assert_allclose(holm_adjusted(np.array([0.6, 0.9])), [1.0, 1.0])
    assert holm_adjusted(np.array([0.2])) == 0.2


def test_holm_adjusted_values_reject_where_holm_does():
    p_values = np.random.default_rng(8).random(40) ** 6
    for significance in (0.001, 0.01, 0.05):
        np.testing.assert_array_equal(holm_adjusted(p_values) <= significance, holm_rejected(p_values, significance))
