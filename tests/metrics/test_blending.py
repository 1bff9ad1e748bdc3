"""The bound of blending methods against closed forms and a search over weights."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.metrics.blending import blend, effective_weight, nearest_weight, on_segment, used_history

RNG = np.random.default_rng(11)
NOW, THEN = np.array([0.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("reference", "weight"),
    [((0.5, 0.0, 0.0), 0.25), ((0.5, 3.0, -1.0), 0.25), ((-1.0, 0.0, 0.0), 0.0), ((5.0, 1.0, 0.0), 1.0)],
)
def test_weight_is_the_clamped_projection(reference, weight):
    assert nearest_weight(np.array(reference), NOW, THEN) == pytest.approx(weight, abs=1e-15)


def test_equal_input_and_history_leave_no_choice():
    assert nearest_weight(np.ones(3), THEN, THEN) == 0.0
    np.testing.assert_array_equal(blend(THEN, THEN, np.array(0.0)), THEN)


def test_no_weight_of_a_search_is_better():
    now, history, reference = RNG.random((3, 50, 3)) * 4.0
    best = ((blend(now, history, nearest_weight(reference, now, history)) - reference) ** 2).sum(-1)
    for weight in np.linspace(0.0, 1.0, 101):
        error = ((blend(now, history, np.full(50, weight)) - reference) ** 2).sum(-1)
        assert (error >= best - 1e-12).all()


def test_blends_are_on_the_segment_and_other_colors_are_not():
    now, history = (RNG.random((2, 200, 3)) * 4.0).astype(np.float32)
    weight = RNG.random((200, 1)).astype(np.float32)
    assert on_segment(now + weight * (history - now), now, history).all()
    assert not on_segment(now + 1.01 * (history - now), now, history).any()  # beyond its end
    per_channel = now + RNG.random((200, 3)) * (history - now)
    assert np.count_nonzero(on_segment(per_channel, now, history)) < 10


def test_effective_weight_of_rectified_history():
    fetched, weight = np.array([4.0, 0.0, 0.0]), np.array(0.9)
    for used, expected in (
        (fetched, 0.9),  # not rectified
        (np.array([1.0, 0.0, 0.0]), 0.9 * 0.25),  # three quarters of the way to the input at 0
        (NOW, 0.0),  # replaced by the input
        (np.array([4.0, 9.0, 0.0]), 0.0),  # moved farther than the input is away
    ):
        assert effective_weight(weight, NOW, fetched, used) == pytest.approx(expected, abs=2e-5)
    assert effective_weight(weight, THEN, THEN, THEN) == pytest.approx(0.9)


def test_used_history_is_found_from_result_and_weight():
    now, used, fetched = RNG.random((3, 20, 3))
    weight = RNG.random(20) * 0.9 + 0.1
    np.testing.assert_allclose(used_history(blend(now, used, weight), now, fetched, weight), used, atol=1e-12)
    np.testing.assert_array_equal(used_history(now, now, fetched, np.zeros(20)), fetched)
