"""The discards at any threshold, read from a histogram of distances."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.conventions import HISTOGRAM_BINS
from taubench_gl.features import MASK_WORDS
from taubench_gl.metrics.counts import Counts, bin_of, discarded_at, edges
from taubench_gl.metrics.sequence_stats import SequenceStats, sensitivity

DISTANCES = np.random.default_rng(2).lognormal(-2.0, 1.2, 20_000).astype(np.float32)
COUNTS = np.bincount(bin_of(DISTANCES), minlength=HISTOGRAM_BINS)


def test_the_curve_is_exact_at_its_edges():
    for edge in edges():
        assert discarded_at(COUNTS, edge) == pytest.approx((edge <= DISTANCES).sum(), abs=1e-6)


def test_between_edges_the_count_is_linear_in_the_logarithm_of_the_threshold():
    low, high = edges()[136:138]
    ends = [discarded_at(COUNTS, edge) for edge in (low, high)]
    assert ends[0] - ends[1] > 100
    assert discarded_at(COUNTS, np.sqrt(low * high)) == pytest.approx(np.mean(ends))
    assert discarded_at(COUNTS, low**0.9 * high**0.1) == pytest.approx(0.9 * ends[0] + 0.1 * ends[1])


def test_beyond_the_edges_nothing_is_known():
    assert discarded_at(COUNTS, 0.0) is None and discarded_at(COUNTS, edges()[0] / 2) is None
    assert discarded_at(COUNTS, edges()[-1] * 2) is None


def test_a_factor_of_the_exposure_scales_the_distances():
    """Distances of two pairs in the bins of ``direct``: half the exposure counts those above twice the threshold."""
    stats = SequenceStats(("direct",), {})
    words = np.zeros(MASK_WORDS, dtype=np.uint32)
    words[0] = 25_000
    histograms = np.zeros((5, HISTOGRAM_BINS), dtype=np.uint32)
    histograms[3, 1:] = COUNTS[1:]
    for _ in range(2):
        stats.add(Counts(words, histograms))
    found = sensitivity(stats.curves(), {"direct": 0.125, "indirect": 0.125}, stats.reuse.pixels)
    assert found["direct"] == pytest.approx({
        "at_half_exposure_percent": 100.0 * (0.5 * DISTANCES >= 0.125).sum() / 25_000,
        "at_twice_exposure_percent": 100.0 * (2.0 * DISTANCES >= 0.125).sum() / 25_000,
    })  # fmt: skip
    assert set(found["indirect"].values()) == {None}
    assert set(
        sensitivity(stats.curves(), {"direct": 0.0, "indirect": 0.0}, stats.reuse.pixels)["direct"].values()
    ) == {None}
