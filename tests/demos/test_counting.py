"""Sums and histograms of demo 12 against integers, and against each other."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.demos.lessons.counting import compensated_sum, plain_sums, rounded_sum
from taubench_gl.metrics.counts import bin_of, edges


def test_plain_float32_sum_loses_counts_and_the_compensated_sum_does_not():
    rng = np.random.default_rng(3)
    counts = rng.integers(1, 2_000_001, size=4000)  # a run of 4000 pairs at 1920x1080
    exact = int(counts.sum())
    plain = abs(float(plain_sums(counts)[-1]) - exact) / exact
    assert plain > 2.0**-24 >= abs(compensated_sum(counts) - exact) / exact


def test_float32_counter_stops_at_2_to_the_24():
    counts = np.append([1 << 24], np.ones(2000, dtype=int))
    assert plain_sums(counts)[-1] == 1 << 24
    assert compensated_sum(counts) == (1 << 24) + 2000
    assert compensated_sum(np.array([], dtype=int)) == 0.0


@pytest.mark.parametrize("term", [1, 3, 13841, 129600, 2_073_600])
def test_rounded_integer_sum_equals_the_float32_sum(term):
    assert rounded_sum(term, 5000) == plain_sums(np.full(5000, term))[-1]


@pytest.mark.parametrize("bits", [0, 1])
def test_coarse_bins_are_sums_of_fine_bins(bits):
    distance = np.random.default_rng(5).lognormal(-2.0, 2.0, size=5000).astype(np.float32)
    coarse, fine = (np.bincount(bin_of(distance, b), minlength=len(edges(b)) + 1) for b in (bits, 3))
    inner = fine[1:-1].reshape(-1, 1 << (3 - bits)).sum(axis=1)
    assert np.array_equal(coarse, [fine[0], *inner, fine[-1]])
