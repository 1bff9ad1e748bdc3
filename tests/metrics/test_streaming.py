"""Welford's statistics against NumPy's two-pass algorithm."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taubench_gl.metrics.streaming import Welford

finite = st.lists(st.floats(-1e6, 1e6), max_size=30)


def added(values) -> Welford:
    w = Welford()
    for v in values:
        w.add(v)
    return w


def agrees(w: Welford, values) -> None:
    assert w.count == len(values)
    if not len(values):
        assert math.isnan(w.mean) and math.isnan(w.variance) and math.isnan(w.min) and math.isnan(w.max)
        return
    scale = max(1.0, float(np.abs(values).max()))
    assert w.mean == pytest.approx(np.mean(values), rel=1e-12, abs=1e-12 * scale)
    assert w.variance == pytest.approx(np.var(values), rel=1e-9, abs=1e-13 * scale**2)
    assert (w.min, w.max) == (min(values), max(values))


@settings(deadline=None)
@given(finite)
def test_single_values(values):
    agrees(added(values), values)


def test_a_small_variance_around_1000_over_many_samples():
    values = 1000 + 0.01 * np.tile([-1.0, 1.0], 50_000)
    exact = np.var(values - 1000)
    w = added(values)
    assert w.variance == pytest.approx(exact, rel=1e-9)
    assert w.mean == pytest.approx(1000, rel=1e-15)
    assert added(values + 1e8).variance == pytest.approx(exact, rel=1e-5)  # sums of squares lose it


def test_equal_values_have_variance_exactly_zero():
    w = added([1 / 3] * 98)
    assert w.variance == 0.0 and w.mean == 1 / 3


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_invalid_values_propagate(bad):
    for w in (added([1.0, bad, 2.0]), added([bad, 1.0])):
        assert not math.isfinite(w.mean) and math.isnan(w.variance)
