"""Holm's correction for many comparisons, and the references of two-sample tests that use it."""

from __future__ import annotations

import numpy as np
from references.significance import Estimate, block_means, welch_p_values

from taubench_gl.metrics.bootstrap import holm_adjusted


def test_holm_by_hand():
    # Sorted 0.005, 0.01, 0.03, 0.04 times 4, 3, 2, 1: 0.02, 0.03, 0.06, 0.04, the last not below the one before.
    np.testing.assert_allclose(holm_adjusted(np.array([[0.01, 0.04], [0.03, 0.005]])), [[0.03, 0.06], [0.06, 0.02]])
    np.testing.assert_allclose(holm_adjusted(np.array([0.6, 0.9])), [1.0, 1.0])
    assert holm_adjusted(np.array([0.2])) == 0.2 and not len(holm_adjusted(np.zeros(0)))


def test_holm_rejects_step_by_step():
    """Levels 0.0025, 0.00333, 0.005, 0.01 in order of p; after the first p above its level none is rejected."""
    for p, rejected in (([0.004, 0.0001, 0.9, 0.003], [1, 1, 0, 1]), ([0.003, 0.9, 0.9, 0.9], [0] * 4),
                        ([0.0001, 0.0034, 0.0034, 0.0034], [1, 0, 0, 0])):  # fmt: skip
        np.testing.assert_array_equal(holm_adjusted(np.array(p)) <= 0.01, np.array(rejected, bool))


def test_blocks_without_noise_are_compared_within_the_tolerance():
    one = np.ones((4, 3))
    a, b = Estimate.of(one * [1.0, 1.001, 1.1]), Estimate.of(one)
    np.testing.assert_array_equal(welch_p_values(a, b, tolerance=0.002), [1.0, 1.0, 0.0])


def test_block_means_leave_out_incomplete_blocks():
    image = np.arange(5 * 7 * 1, dtype=np.float32).reshape(5, 7, 1)
    means = block_means(image, 2)
    assert means.shape == (2, 3, 1) and means[0, 0, 0] == np.mean([0, 1, 7, 8])
