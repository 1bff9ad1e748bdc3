"""Fronts, differences and recommendations, on points whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from cost_tools import point

from taubench_gl.cost.analysis import ColumnError, choose, pareto_front, rises
from taubench_gl.cost.clock import Time, slower_by, time_of


def names(points):
    return [p.name for p in points]


def test_a_front_by_hand():
    points = [
        point("base", 0.5, 10.0, role="base"),
        point("cheap", 2.0, 2.0),
        point("worse", 2.5, 3.0),
        point("dear", 0.1, 40.0),
        point("wasteful", 0.6, 20.0),
        point("signed", -0.2, 15.0),
    ]
    assert names(pareto_front(points, "direct")) == ["cheap", "base", "signed", "dear"]


def test_noise_puts_nothing_on_the_front():
    # A hair faster and a hair worse: only noise speaks for the second.
    points = [point("base", 0.5, 10.0, 0.4, role="base"), point("twin", 0.6, 9.8, 0.4)]
    assert names(pareto_front(points, "direct")) == ["base"]
    sure = [point("base", 0.5, 10.0, 0.01, role="base"), point("twin", 0.6, 9.8, 0.01)]
    assert names(pareto_front(sure, "direct")) == ["twin", "base"]


def test_of_equals_the_first_stays_unless_another_is_really_faster():
    points = [point("base", 0.5, 10.0, 0.5, role="base"), point("other", 0.5, 9.9, 0.5)]
    assert names(pareto_front(points, "direct")) == ["base"]
    points[1] = point("other", 0.5, 5.0, 0.5)
    assert names(pareto_front(points, "direct")) == ["other"]


def test_questions_and_what_was_not_measured_are_not_on_the_front():
    points = [
        point("base", 0.5, 10.0, role="base"),
        point("fps=48", 0.0, 1.0, role="question"),
    ]
    missing = point("none", 0.0, 1.0)
    missing.columns["direct"] = ColumnError(None, reason="no indirect light")
    assert names(pareto_front([*points, missing], "direct")) == ["base"]


def test_a_sampled_run_is_judged_by_its_interval():
    lucky = point("sample", 0.01, 1.0, half_width=0.8)
    assert lucky.error("direct") == 0.8
    choice = choose([point("base", 0.5, 10.0, role="base"), lucky], ("direct",), within=0.6)
    assert choice.point.name == "base"


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
    assert slower_by(a, b) == sign


def test_rounds_see_through_drift():
    # The machine gets five times slower on the way; B costs 10 % more in every round.
    pace = [1.0, 1.4, 2.2, 3.1, 5.0]
    a, b = time_of([10.0 * p for p in pace]), time_of([11.0 * p for p in pace])
    assert slower_by(b, a) == 1 and slower_by(a, b) == -1
    assert slower_by(Time(a.median, a.spread, 5), Time(b.median, b.spread, 5)) == 0, "medians alone cannot tell"


def test_spread_is_that_of_the_repeats():
    told = time_of([10.0, 12.0, 11.0, 13.0, 50.0])
    assert (told.median, told.samples) == (12.0, 5)
    assert told.spread == pytest.approx(1.4826)
    assert time_of([1.0, 2.0]).spread is None


def test_within_takes_the_cheapest_and_says_what_the_next_step_costs():
    points = [
        point("base", 0.4, 18.0, role="base"),
        point("cheap", 2.0, 2.0),
        point("dear", 0.2, 37.8),
        point("twin", 0.0, 3.0, usable=False),
    ]
    choice = choose(points, ("direct",), within=0.5)
    assert choice.point.name == "base" and choice.next.name == "dear"
    assert choice.words.startswith("for the direct column within 0.5 points: base, 18 ")
    assert choice.words.endswith("the next step (dear) costs 2.1x for 0.20 points")


def test_a_dial_that_does_nothing_is_not_recommended_for_a_lucky_round():
    points = [point("base", 0.4, 18.0, 2.0, role="base"), point("bins", 0.4, 17.0, 2.0), point("dear", 0.2, 40.0)]
    for wish in ({"within": 0.5}, {"budget_ms": 21.0}):
        assert choose(points, ("direct",), **wish).point.name == "base"
    points = [point("cheap", 2.0, 2.0), *points[:2]]
    assert choose(points, ("direct",), within=3.0).next.name == "base"
    faster = [point("base", 0.4, 18.0, 0.1, role="base"), point("bins", 0.4, 10.0, 0.1)]
    assert choose(faster, ("direct",), within=0.5).point.name == "bins"


def test_few_rounds_prove_little():
    a, b = time_of([10.0, 10.0, 10.0]), time_of([10.2, 10.21, 9.9])
    assert slower_by(b, a) == 0, "two of three close together are chance"
    rng = np.random.default_rng(5)
    for rounds in (3, 5, 7):
        noise = rng.normal(0.0, 0.05, size=(400, 2, rounds))
        found = [slower_by(time_of(list(10 * np.exp(x))), time_of(list(10 * np.exp(y)))) for x, y in noise]
        assert np.count_nonzero(found) <= 24, "of 400 pairs of equals about 12 are told apart"


def test_a_budget_takes_the_most_exact_it_can_afford():
    points = [point("base", 0.4, 18.0, 1.0, role="base"), point("cheap", 2.0, 2.0), point("dear", 0.2, 37.8)]
    assert choose(points, ("direct",), budget_ms=19.5).point.name == "base"
    assert choose(points, ("direct",), budget_ms=18.5).point.name == "cheap", "the spread must fit too"
    assert choose(points, ("direct",), budget_ms=100.0).point.name == "dear"
    none = choose(points, ("direct",), budget_ms=1.0)
    assert none.point is None and "nothing measured is that fast" in none.words and "cheap" in none.words
    none = choose(points, ("direct",), within=0.1)
    assert none.point is None and "nothing measured is that exact" in none.words and "dear" in none.words


def test_several_columns_are_judged_by_their_worst():
    a = point("a", 0.1, 10.0, role="base")
    a.columns["normal"] = ColumnError(5.0, 3.0)
    assert choose([a], ("direct", "normal"), within=1.0).point is None
    assert choose([a], ("direct",), within=1.0).point is a


def test_a_front_of_several_columns_is_that_of_their_worst():
    a, b, c = (point("a", 0.1, 10.0, role="base"), point("b", 0.5, 5.0), point("c", 0.4, 7.0))
    for p, other in ((a, 0.2), (b, 0.1), (c, 0.6)):
        p.columns["normal"] = ColumnError(5.0, other)
    assert names(pareto_front([a, b, c], ("direct", "normal"))) == ["b", "a"], (
        "c's worst is 0.6, and slower than b's 0.5"
    )
    assert names(pareto_front([a, b, c], "direct")) == ["b", "c", "a"]
    del c.columns["normal"]
    assert names(pareto_front([a, b, c], ("direct", "normal"))) == ["b", "a"]


def test_rises_weighs_pairs():
    reference = {str(i): 5.0 for i in range(10)}
    near = {k: 5.1 for k in reference}
    far = {k: 5.5 + 0.01 * i for i, k in enumerate(reference)}
    mean, error = rises(near, far, reference)
    assert mean == pytest.approx(0.445) and mean > 2 * error
    mean, _ = rises(far, near, reference)
    assert mean < 0


def test_what_is_more_exact_but_not_surely_slower_is_named():
    # By its median 1.5x, within a spread that proves nothing: neither a free improvement nor a step with a price.
    points = [point("base", 0.4, 18.0, 4.0, role="base"), point("finer", 0.1, 27.0, 12.0)]
    words = choose(points, ("direct",), within=0.5).words
    assert words.endswith("finer (error 0.10 points) takes 1.5x by the median, within the spread")
