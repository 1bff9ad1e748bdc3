"""Mask errors, comparison of times, the Pareto front and the recommendation, on points with a known answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cost_tools import point

from taubench_gl.cost.analysis import (
    SAME_TIME,
    choose,
    compare_errors,
    compare_times,
    mask_errors,
    noise_floor,
    pareto_front,
    time_of,
)
from taubench_gl.option_groups import OVERALL


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


def floor_of(q):
    """The noise floor of two independent halves that each discard a pixel with probability ``q``; of 200 000."""
    rng = np.random.default_rng(3)
    return noise_floor(*({"direct": rng.random(200_000) < q} for _ in range(2)))["direct"]


@pytest.mark.parametrize("p", [0.01, 0.1, 0.3])
def test_floor_is_the_error_of_a_half(p):
    """Two decisions that are wrong with probability p, independently, differ with 2p(1 - p)."""
    assert floor_of(p) == pytest.approx(100.0 * p * (1.0 - p), rel=0.03)


def test_the_floor_of_rarely_found_light_rises_until_half_of_the_pixels_have_it():
    """Light that a path finds with probability 1/1000: of n some do with q = 1 - 0.999^n; the floor is q(1 - q)."""
    floors = [floor_of(1.0 - 0.999**n) for n in (64, 256, 693, 4096)]
    assert floors[0] < floors[1] < floors[2] > floors[3]
    assert floors[2] == pytest.approx(25.0, rel=0.03), "at n = 1000 ln 2"


def test_the_floor_of_very_bright_paths_does_not_fall():
    """P(X > x) = 1/x: some of n paths exceed n/8 with 1 - exp(-8), for every n.  Bounded brightness averages out."""
    rng = np.random.default_rng(11)

    def halves(draw, n):  # whether the mean of n paths is above 1.125 times its median over 2000 pixels
        means = [draw((2000, n)).mean(axis=1) for _ in range(2)]
        return noise_floor(*({"direct": m > 1.125 * np.median(m)} for m in means))["direct"]

    bright = [halves(lambda shape: 1.0 / np.maximum(rng.random(shape), 1e-9), n) for n in (64, 1024)]
    bounded = [halves(rng.random, n) for n in (64, 1024)]
    assert bright[1] > 0.6 * bright[0] > 5.0 and bounded[1] < 0.1 * bounded[0]


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
    # One more wrong pixel is within the noise of the sample.
    assert names(pareto_front([point("baseline", 50, 10.0), point("b", 49, 12.0)], "direct")) == ["baseline"]


def test_of_times_that_count_as_equal_the_most_exact_is_on_the_front():
    points = [point("fast", 60, 10.0), point("baseline", 40, 11.4)]
    assert names(pareto_front(points, "direct")) == ["baseline"]
    points = [point("fast", 60, 10.0), point("baseline", 40, 11.6)]
    assert names(pareto_front(points, "direct")) == ["fast", "baseline"]
    chain = [point("a", 300, 10.0), point("b", 200, 11.0), point("c", 100, 12.0), point("d", 100, 13.0)]
    assert names(pareto_front(chain, "direct")) == ["b", "c"], "c is more than 15 % slower than a, d no more exact"


def test_of_equal_errors_the_first_is_on_the_front():
    first, second = point("baseline", 40, 10.2), point("cheaper", 40, 10.0)
    assert names(pareto_front([first, second], "direct")) == ["baseline"]
    assert names(pareto_front([second, first], "direct")) == ["cheaper"]
    assert names(pareto_front([point("baseline", 40, 12.0), second], "direct")) == ["cheaper"], "20 % slower"


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
        budget = limits.get("budget_ms", 1e9)
        fitting = [p for p in points if p.time.median + p.time.spread <= budget]
        assert best is None or best in pareto_front(fitting, OVERALL, 0.5)
        for p in points if best is not None else ():
            as_exact = max(p.error(), 0.5) <= max(best.error(), 0.5)
            assert not (as_exact and SAME_TIME * p.time.median < best.time.median), "nothing is as exact and faster"


def test_unmeasured_points_are_not_on_the_front():
    untimed = point("untimed", 0, 1.0)
    object.__setattr__(untimed, "time", None)
    other = point("grid", 0, 1.0)
    object.__setattr__(other, "masks", {})
    assert names(pareto_front([point("baseline", 50, 10.0), untimed, other], "direct")) == ["baseline"]


def test_rounds_cancel_drift():
    # The machine becomes five times slower; B takes 10 % longer in every round.
    pace = [1.0, 1.4, 2.2, 3.1, 5.0]
    a, b = time_of([10.0 * p for p in pace]), time_of([11.0 * p for p in pace])
    assert compare_times(b, a) == 1 and compare_times(a, b) == -1
    assert compare_times(time_of([55.0, 24.2, 11.0, 34.1, 15.4]), a) == 0, "the same times in another order"


def test_times_are_compared_in_the_rounds_that_both_have():
    a = [10.0, 14.0, 22.0, 31.0, 50.0]
    assert compare_times(time_of([1.1 * t for t in a[:4]]), time_of(a)) == 1
    assert compare_times(time_of([9.0 * t for t in a[:2]]), time_of(a)) == 0, "two rounds are too few"
    assert compare_times(time_of([9.0 * t for t in a], interleaved=False), time_of(a)) == 0, "no rounds in common"


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


def test_budget_includes_the_spread():
    assert choose(POINTS, budget_ms=19.5).point.name == "baseline"
    assert choose(POINTS, budget_ms=18.5).point.name == "cheap"
    assert choose(POINTS, budget_ms=100.0).point.name == "exact"


def test_a_budget_takes_what_fits_it_although_the_front_has_a_slower_point():
    points = [point("a", 300, 10.0), point("fits", 120, 44.0), point("exact", 100, 50.0)]
    assert names(pareto_front(points, OVERALL)) == ["a", "exact"], "44 and 50 ms count as equal"
    choice = choose(points, budget_ms=45.0)
    assert (choice.point.name, choice.faster.name, choice.finer.name) == ("fits", "a", "exact")
    assert choose(points, budget_ms=51.0).point.name == "exact"
    assert choose(points, within=12.0).point.name == "exact"


def test_without_limits_the_fastest_with_at_most_twice_the_least_error():
    assert choose(POINTS).point.name == "exact", "four times the least error is too much"
    for wrong, expected in ((21, "baseline"), (20, "baseline"), (19, "exact")):
        choice = choose([*POINTS[:2], point("exact", wrong, 37.8)])
        assert (choice.point.name, choice.good_enough) == (expected, pytest.approx(0.2 * wrong))


def test_errors_below_the_noise_floor_are_no_measure():
    assert choose(POINTS, floor=2.5).point.name == "baseline", "4 % is less than twice the floor"


def test_the_least_error_needs_no_time_and_is_not_that_of_path_traced_light():
    untimed = replace(point("finest", 9, 1.0), time=None)
    assert choose([*POINTS[:2], untimed]).good_enough == pytest.approx(1.8)
    assert choose([*POINTS[:2], untimed]).point.name == "baseline", "the most exact one of the front"
    traced = replace(point("light=path-traced@64", 4, 3000.0), role="path_traced")
    assert choose([*POINTS[:2], point("exact", 25, 37.8), traced]).point.name == "baseline"


def test_a_few_pixels_are_no_measure():
    """3 pixels do not differ from none: of 0 and 3 wrong ones the faster point is recommended."""
    points = [point("baseline", 0, 20.0), point("half", 3, 15.0)]
    assert names(pareto_front(points, OVERALL)) == ["half"]
    choice = choose(points)
    assert choice.point.name == "half" and choice.good_enough == pytest.approx(2 * 0.1 * 1.96**2)


def test_without_limits_something_is_recommended_once_it_is_timed():
    assert choose([]).point is None
    assert choose([replace(POINTS[0], time=None)]).point is None
    traced = replace(POINTS[2], role="path_traced")
    assert choose([traced]).point.name == "exact"
    assert choose([point("baseline", 0, 5.0)]).point.name == "baseline"


@pytest.mark.parametrize(
    ("configurations", "scatter", "expected"),
    [
        # wrong pixels, milliseconds; 5 % of the pixels is the noise floor
        ({"draft": (500, 10.0), "fast": (230, 20.0), "baseline": (200, 60.0), "accurate": (180, 200.0)}, 0.1, "fast"),
        (
            {"draft": (230, 10.0), "fast": (210, 10.2), "baseline": (210, 10.1), "accurate": (200, 10.0)},
            0.03,
            "accurate",
        ),
        ({"draft": (230, 20.0), "fast": (230, 20.3), "baseline": (500, 20.0)}, 0.03, "draft"),
    ],
    ids=["far apart", "equal times", "equal errors"],
)
def test_the_recommendation_is_kept_when_noisy_times_are_measured_again(configurations, scatter, expected):
    """Rounds that scatter by 3 %, and times by ``scatter`` from run to run: the same point is chosen in every run."""
    rng = np.random.default_rng(7)
    found = set()
    for _ in range(50):
        points = [
            replace(
                point(n, wrong, ms),
                time=time_of(list(ms * np.exp(rng.normal(0.0, scatter) + rng.normal(0.0, 0.03, 5)))),
            )
            for n, (wrong, ms) in configurations.items()
        ]
        found.add(choose(points, floor=5.0).point.name)
    assert found == {expected}


@pytest.mark.parametrize("limits", [{"budget_ms": 1.0}, {"within": 0.1}])
def test_nothing_meets_the_limits(limits):
    choice = choose(POINTS, **limits)
    assert choice.point is None and (choice.faster.name, choice.finer.name) == ("cheap", "exact")
