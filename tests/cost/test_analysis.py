"""Mask errors, comparison of times, the Pareto front and the recommendation, on points with a known answer."""

from __future__ import annotations

import numpy as np
import pytest
from cost_tools import point

from taubench_gl.cost.analysis import (
    OVERALL,
    Time,
    choose,
    compare_errors,
    compare_times,
    error_increase,
    mask_errors,
    pareto_front,
    time_of,
)


def names(points):
    return [p.name for p in points]


def test_errors_do_not_cancel():
    reference = {"direct": np.array([1, 1, 0, 0], bool), "normal": np.array([0, 0, 0, 1], bool)}
    found = {"direct": np.array([1, 0, 1, 0], bool), "normal": np.array([0, 0, 0, 1], bool)}
    errors = mask_errors(found, reference)
    assert (errors["direct"].false_positive, errors["direct"].false_negative) == (25.0, 25.0)
    assert errors["direct"].percent == 50.0 and errors["direct"].points == 0.0, "the column's difference cancels"
    assert errors["normal"].percent == 0.0
    assert errors[OVERALL].percent == 50.0 and list(errors[OVERALL].wrong) == [False, True, True, False]


def test_signs():
    more = mask_errors({"direct": np.ones(4, bool)}, {"direct": np.zeros(4, bool)})["direct"]
    assert (more.false_positive, more.false_negative, more.points) == (100.0, 0.0, 100.0), "discarded is positive"


def test_errors_of_the_same_pixels_are_compared_pixel_by_pixel():
    a, b = point("a", 100, 1.0), point("b", 120, 1.0)
    assert compare_errors(b, a, "direct") == 1, "20 pixels are wrong in one only"
    apart = point("c", slice(500, 620), 1.0)
    assert compare_errors(apart, a, "direct") == 0, "120 and 100 pixels, all different: within the noise of the sample"
    assert compare_errors(b, a, "direct", floor=12.0) == 0, "below the noise floor nothing is ranked"


def test_front_by_hand():
    points = [
        point("baseline", 50, 10.0),
        point("cheap", 200, 2.0),
        point("beaten", 250, 3.0),
        point("exact", 10, 40.0),
        point("slow", 60, 20.0),
    ]
    assert names(pareto_front(points, "direct")) == ["cheap", "baseline", "exact"]
    assert names(pareto_front(points, "direct", floor=6.0)) == ["cheap", "baseline"]


def test_front_ignores_noise():
    # One more wrong pixel is within the noise of the sample, 0.2 ms within that of the times.
    assert names(pareto_front([point("baseline", 50, 10.0), point("b", 49, 12.0)], "direct")) == ["baseline"]
    points = [point("fast", 60, 9.8, 0.4), point("baseline", 40, 10.0, 0.4)]
    assert names(pareto_front(points, "direct")) == ["baseline"], "no slower beyond noise, and more exact"
    points = [point("fast", 60, 9.8, 0.01), point("baseline", 40, 10.0, 0.01)]
    assert names(pareto_front(points, "direct")) == ["fast", "baseline"]


def test_noisy_exact_point_does_not_replace_a_faster_one():
    # 27 ± 12 ms does not differ from 18 ± 4 ms, but cannot replace it at no cost.
    points = [point("baseline", 40, 18.0, 4.0), point("finer", 10, 27.0, 12.0)]
    assert names(pareto_front(points, "direct")) == ["baseline", "finer"]


@pytest.mark.parametrize("seed", range(20))
def test_recommendation_is_on_the_front_and_not_beaten(seed):
    rng = np.random.default_rng(seed)
    points = [
        point(
            "baseline" if i == 0 else f"p{i}",
            rng.random(1000) < rng.choice([0.0, 0.01, 0.1]),
            *rng.uniform([5, 0.1], [30, 9]),
        )
        for i in range(12)
    ]
    for limits in ({}, {"within": 5.0}, {"budget_ms": 25.0}):
        best = choose(points, OVERALL, 0.5, **limits).point
        assert best is None or best in pareto_front(points, OVERALL, 0.5)
        for p in points if best is not None else ():
            as_exact = max(p.error(), 0.5) <= max(best.error(), 0.5)
            assert not (as_exact and p.time.median < best.time.median), "nothing is as exact and faster"


def test_unmeasured_points_are_not_on_the_front():
    untimed = point("untimed", 0, 1.0)
    object.__setattr__(untimed, "time", None)
    other = point("grid", 0, 1.0)
    object.__setattr__(other, "masks", {})
    assert names(pareto_front([point("baseline", 50, 10.0), untimed, other], "direct")) == ["baseline"]


@pytest.mark.parametrize(
    ("a", "b", "sign"),
    [
        (Time(10.0, 1.0, 5), Time(12.0, 1.0, 5), -1),
        (Time(12.0, 1.0, 5), Time(10.0, 1.0, 5), 1),
        (Time(10.0, 1.0, 5), Time(11.0, 1.0, 5), 0),
        (Time(10.0, None, 2), Time(50.0, 1.0, 5), 0),
    ],
)
def test_times_without_common_rounds(a, b, sign):
    assert compare_times(a, b) == sign


def test_rounds_cancel_drift():
    # The machine becomes five times slower; B takes 10 % longer in every round.
    pace = [1.0, 1.4, 2.2, 3.1, 5.0]
    a, b = time_of([10.0 * p for p in pace]), time_of([11.0 * p for p in pace])
    assert compare_times(b, a) == 1 and compare_times(a, b) == -1
    assert compare_times(Time(a.median, a.spread, 5), Time(b.median, b.spread, 5)) == 0, "medians alone"


def test_median_and_spread_of_rounds():
    found = time_of([10.0, 12.0, 11.0, 13.0, 50.0])
    assert (found.median, found.samples) == (12.0, 5)
    assert found.spread == pytest.approx(1.4826)
    assert time_of([1.0, 2.0]).spread is None


def test_rate_of_false_differences():
    a, b = time_of([10.0, 10.0, 10.0]), time_of([10.2, 10.21, 9.9])
    assert compare_times(b, a) == 0, "two of three rounds close together are chance"
    rng = np.random.default_rng(5)
    for rounds in (3, 5, 7):
        noise = rng.normal(0.0, 0.05, size=(400, 2, rounds))
        found = [compare_times(time_of(list(10 * np.exp(x))), time_of(list(10 * np.exp(y)))) for x, y in noise]
        assert np.count_nonzero(found) <= 24, "about 12 of 400 equal pairs are expected"


POINTS = [point("baseline", 40, 18.0, 1.0), point("cheap", 200, 2.0), point("exact", 10, 37.8)]


def test_within_chooses_the_fastest():
    choice = choose([*POINTS, point("render", 0, 3.0, usable=False)], within=5.0)
    assert (choice.point.name, choice.faster.name, choice.finer.name) == ("baseline", "cheap", "exact")
    assert "baseline" in choice.words and "exact" in choice.words


def test_budget_includes_the_spread():
    assert choose(POINTS, budget_ms=19.5).point.name == "baseline"
    assert choose(POINTS, budget_ms=18.5).point.name == "cheap"
    assert choose(POINTS, budget_ms=100.0).point.name == "exact"


def test_without_limits_the_last_that_pays():
    assert choose(POINTS).point.name == "exact", "twice the time leaves a quarter of the error"
    little = [POINTS[0], POINTS[1], point("exact", 35, 37.8)]
    assert choose(little).point.name == "baseline", "twice the time leaves 88 % of the error"


def test_what_pays_is_the_error_above_the_noise_floor():
    """2.2 times the time leaves 80 % of the error, but 68 % of what is above a floor of 5.8 %."""
    points = [point("baseline", 156, 29.5), point("middle", 125, 63.8)]
    assert choose(points).point.name == "baseline"
    assert choose(points, floor=5.8).point.name == "middle"


@pytest.mark.parametrize(("limits", "nearest"), [({"budget_ms": 1.0}, "cheap"), ({"within": 0.1}, "exact")])
def test_nothing_meets_the_limits(limits, nearest):
    choice = choose(POINTS, **limits)
    assert choice.point is None and nearest in choice.words


def test_error_increase_over_pairs():
    reference = {str(i): 5.0 for i in range(10)}
    near = {k: 5.1 for k in reference}
    far = {k: 5.5 + 0.01 * i for i, k in enumerate(reference)}
    mean, error = error_increase(near, far, reference)
    assert mean == pytest.approx(0.445) and mean > 2 * error
    assert error_increase(far, near, reference)[0] < 0
