"""Confusion, curves and thresholds against direct counting."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.reject.scores import Confusion, Curve


def data(count=4000, seed=3):
    rng = np.random.default_rng(seed)
    positive = rng.random(count) < 0.2
    values = np.where(positive, rng.lognormal(0.0, 1.0, count), rng.lognormal(-2.0, 1.0, count))
    values[:5] = np.inf
    return values, positive


def test_confusion_by_counting():
    values, positive = data()
    c = Confusion()
    for part in np.array_split(np.arange(len(values)), 7):
        c.add(values[part] > 0.4, positive[part])
    rejected = values > 0.4
    block = c.block()
    assert c.pixels == len(values)
    assert block["precision"] == pytest.approx(positive[rejected].mean())
    assert block["recall"] == pytest.approx(rejected[positive].mean())
    assert block["false_positive_rate"] == pytest.approx(rejected[~positive].mean())


def test_without_pixels_rates_are_null():
    block = Confusion().block()
    assert [block[k] for k in ("precision", "recall", "false_positive_rate", "rejected_percent")] == [None] * 4
    assert Curve().area() is None and Curve().threshold_for(0.5) is None


def test_curves_are_rates_at_or_above_each_edge():
    values, positive = data()
    curve = Curve()
    curve.add(values.astype(np.float32), positive)
    thresholds, recall, wrong = curve.rates()
    for i in range(40, len(thresholds), 25):
        at = values.astype(np.float32) >= np.float32(thresholds[i])
        assert recall[i] == pytest.approx(at[positive].mean())
        assert wrong[i] == pytest.approx(at[~positive].mean())


def test_the_area_is_the_chance_that_a_positive_ranks_higher():
    values, positive = data(600)
    curve = Curve()
    curve.add(values, positive)
    a, b = values[positive][:, None], values[~positive][None]
    assert curve.area() == pytest.approx(((a > b) + 0.5 * (a == b)).mean(), abs=0.01)  # ties within a bin count half


@pytest.mark.parametrize("wanted", [0.5, 0.9, 1.0])
def test_the_largest_threshold_for_a_recall(wanted):
    values, positive = data()
    values, positive = values[5:], positive[5:]
    curve = Curve()
    curve.add(values, positive)
    found = curve.threshold_for(wanted)
    assert (values[positive] >= found).mean() >= wanted
    assert (values[positive] >= found * 1.14).mean() < wanted  # the next edge, 1/8 octave or less above
