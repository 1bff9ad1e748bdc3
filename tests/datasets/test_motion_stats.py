"""Lists of steps have the requested statistics up to rounding, or the error names the reason."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taubench_gl.datasets.motion_stats import MotionStats, ordered_steps, sorted_steps
from taubench_gl.errors import SettingsError


def check(steps, stats):
    assert np.all(np.diff(steps) >= 0) and steps[0] >= 0
    np.testing.assert_allclose(np.mean(steps), stats.mean, rtol=1e-9)
    np.testing.assert_allclose(np.var(steps), stats.variance, rtol=1e-6, atol=1e-12 * stats.mean**2)


@given(
    mean=st.floats(1e-3, 50), spread=st.floats(0, 3), count=st.integers(20, 400), cap=st.sampled_from([math.inf, 170.0])
)
@settings(max_examples=60, deadline=None)
def test_mean_and_variance_are_exact(mean, spread, count, cap):
    stats = MotionStats(mean, (spread * mean) ** 2)
    if cap < math.inf and stats.variance > 0.8 * mean * (cap - mean):
        return  # near or above the largest variance of values in [0, cap]
    steps = sorted_steps(stats, count, cap)
    assert len(steps) == count and steps[-1] <= cap
    check(steps, stats)


@pytest.mark.parametrize(
    "row", [(1.892, 0.826, 5.475), (0.055, 0.001, 0.143), (0.154, 0.004, 0.248), (0.041, 0.160, 7.163)]
)
def test_the_rows_of_table_2(row):
    stats = MotionStats(*row)
    steps = sorted_steps(stats, 360)
    check(steps, stats)
    assert steps[-1] == row[2]


def test_the_vr_row_needs_more_samples_than_6_s_at_24_fps():
    stats = MotionStats(0.041, 0.160, 7.163)
    assert len(sorted_steps(stats, 319)) == 319
    with pytest.raises(SettingsError, match="144"):
        sorted_steps(stats, 144)  # 6 s at 24 fps


@pytest.mark.parametrize(
    ("numbers", "named"),
    [
        ((-1.0, 1.0), "mean .*-1"),
        ((1.0, -1.0), "variance .*-1"),
        ((0.0, 1.0), "variance 1"),
        ((2.0, 1.0, 1.0), "max 1"),
        ((math.nan, 1.0), "nan"),
        ((1.0, math.inf), "inf"),
    ],
)
def test_impossible_statistics_are_refused(numbers, named):
    with pytest.raises(SettingsError, match=named):
        MotionStats(*numbers)


@pytest.mark.parametrize(
    ("stats", "count", "named"),
    [
        (MotionStats(1.0, 0.0, 2.0), 100, "variance"),
        (MotionStats(1.0, 500.0), 100, "100 steps"),
        (MotionStats(1.0, 5.0, 3.0), 100, "max"),
        (MotionStats(400.0), 100, "175"),
        (MotionStats(1.0, 0.5, 200.0), 100, "175"),
    ],
)
def test_statistics_that_are_impossible_for_the_length(stats, count, named):
    with pytest.raises(SettingsError, match=named):
        sorted_steps(stats, count, cap=175.0 if "175" in named else math.inf)


def test_order_is_a_slowly_varying_permutation_that_depends_on_the_seed():
    stats = MotionStats(3.365, 8.887)
    orders = [ordered_steps(stats, 360, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(orders[0], orders[1])
    assert not np.array_equal(orders[0], orders[2])
    np.testing.assert_array_equal(np.sort(orders[0]), sorted_steps(stats, 360))
    assert np.corrcoef(orders[0][:-1], orders[0][1:])[0, 1] > 0.6
