"""Welford and Chan against NumPy's two-pass algorithm."""

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


@settings(deadline=None)
@given(finite, finite, finite)
def test_blocks_and_merges(a, b, c):
    blocks = Welford()
    for part in (a, b, c):
        blocks.add_many(np.array(part))
    agrees(blocks, a + b + c)
    right = added(b)
    right.merge(added(c))
    left = added(a)
    left.merge(right)
    agrees(left, a + b + c)


def test_merge_does_not_change_its_argument():
    a, b = added([1, 2]), added([3, 4])
    a.merge(b)
    b.add(100)
    agrees(a, [1, 2, 3, 4])


def test_a_small_variance_around_1000_over_a_million_samples():
    values = 1000 + 0.01 * np.tile([-1.0, 1.0], 500_000)
    w = Welford()
    for block in np.split(values, 100):
        w.add_many(block)
    exact = np.var(values - 1000)
    assert w.variance == pytest.approx(exact, rel=1e-9)
    assert w.mean == pytest.approx(1000, rel=1e-15)
    one = added(values[:100_000])
    assert one.variance == pytest.approx(exact, rel=1e-9)
    # Sums of squares lose it completely, in float32 here, in float64 around 1e8.
    single = values.astype(np.float32)
    assert abs(float(np.mean(single * single) - np.mean(single) ** 2) - exact) > exact
    big = values + 1e8
    assert abs(float(np.mean(big * big) - np.mean(big) ** 2) - exact) >= exact
    shifted = Welford()
    shifted.add_many(big)
    assert shifted.variance == pytest.approx(exact, rel=1e-5)


def test_equal_values_have_variance_exactly_zero():
    w = Welford()
    for _ in range(7):
        w.add_many(np.full(13, 1 / 3))
        w.add(1 / 3)
    assert w.variance == 0.0 and w.mean == 1 / 3


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_invalid_values_propagate(bad):
    for w in (added([1.0, bad, 2.0]), added([bad, 1.0])):
        assert not math.isfinite(w.mean) and math.isnan(w.variance)
    block = Welford()
    with np.errstate(invalid="ignore"):
        block.add_many(np.array([1.0, bad, 2.0]))
    assert not math.isfinite(block.mean) and math.isnan(block.variance)


def test_arrays_of_any_shape():
    w = Welford()
    w.add_many(np.arange(24, dtype=np.float32).reshape(2, 3, 4))
    agrees(w, list(range(24)))
