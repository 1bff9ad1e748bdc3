"""Comparison of times, Pareto fronts and recommendations, on points with a known answer."""

from __future__ import annotations

import numpy as np
import pytest
from cost_tools import point

from taubench_gl.cost.analysis import (
    ColumnError,
    Time,
    choose,
    compare_times,
    error_increase,
    no_slower,
    pareto_front,
    time_of,
)


def names(points):
    return [p.name for p in points]


def test_front_by_hand():
    points = [
        point("baseline", 0.5, 10.0),
        point("cheap", 2.0, 2.0),
        point("dominated", 2.5, 3.0),
        point("exact", 0.1, 40.0),
        point("slow", 0.6, 20.0),
        point("signed", -0.2, 15.0),
    ]
    assert names(pareto_front(points, "direct")) == ["cheap", "baseline", "signed", "exact"]


def test_front_ignores_timing_noise():
    noisy = [point("baseline", 0.5, 10.0, 0.4), point("other", 0.6, 9.8, 0.4)]
    assert names(pareto_front(noisy, "direct")) == ["baseline"]
    precise = [point("baseline", 0.5, 10.0, 0.01), point("other", 0.6, 9.8, 0.01)]
    assert names(pareto_front(precise, "direct")) == ["other", "baseline"]


def test_equal_errors_keep_the_first_unless_another_is_faster():
    points = [point("baseline", 0.5, 10.0, 0.5), point("other", 0.5, 9.9, 0.5)]
    assert names(pareto_front(points, "direct")) == ["baseline"]
    points[1] = point("other", 0.5, 5.0, 0.5)
    assert names(pareto_front(points, "direct")) == ["other"]


def test_tie_with_a_noisy_time_does_not_keep_a_slow_baseline():
    # The baseline ties with "noisy", but "precise" is faster than the baseline.
    points = [point("baseline", 0.5, 10.0, 0.1), point("precise", 0.5, 8.0, 0.1), point("noisy", 0.5, 7.0, 6.0)]
    assert compare_times(points[0].time, points[2].time) == 0
    assert names(pareto_front(points, "direct")) == ["precise"]
    assert choose(points, ("direct",), within=1.0).point.name == "precise"


def test_noisy_exact_point_does_not_replace_a_faster_one():
    # 27 ± 12 ms does not differ from 18 ± 4 ms, but cannot replace it at no cost.
    points = [point("baseline", 0.4, 18.0, 4.0), point("finer", 0.1, 27.0, 12.0)]
    assert not no_slower(points[1].time, points[0].time)
    assert names(pareto_front(points, "direct")) == ["baseline", "finer"]
    choice = choose(points, ("direct",), within=0.5)
    assert (choice.point.name, choice.next.name) == ("baseline", "finer")


@pytest.mark.parametrize("seed", range(20))
def test_recommendation_is_on_the_front(seed):
    rng = np.random.default_rng(seed)
    points = [
        point(
            "baseline" if i == 0 else f"p{i}", float(rng.choice([0.0, 0.1, 0.5, 1.0])), *rng.uniform([5, 0.1], [30, 9])
        )
        for i in range(12)
    ]
    for within in (0.05, 0.3, 2.0):
        choice = choose(points, ("direct",), within=within)
        if choice.point is not None:
            assert choice.point in pareto_front(points, "direct")


def test_definitions_and_unmeasured_points_are_not_on_the_front():
    points = [point("baseline", 0.5, 10.0), point("fps=48", 0.0, 1.0, role="definition")]
    missing = point("none", 0.0, 1.0)
    missing.columns["direct"] = ColumnError(None, reason="no indirect light")
    assert names(pareto_front([*points, missing], "direct")) == ["baseline"]


def test_error_of_a_sample_is_at_least_its_half_width():
    sample = point("sample", 0.01, 1.0, half_width=0.8)
    assert sample.error("direct") == 0.8
    choice = choose([point("baseline", 0.5, 10.0), sample], ("direct",), within=0.6)
    assert choice.point.name == "baseline"


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


def test_within_chooses_the_fastest_and_the_next():
    points = [
        point("baseline", 0.4, 18.0),
        point("cheap", 2.0, 2.0),
        point("exact", 0.2, 37.8),
        point("render", 0.0, 3.0, usable=False),
    ]
    choice = choose(points, ("direct",), within=0.5)
    assert choice.point.name == "baseline" and choice.next.name == "exact"


def test_parameter_without_effect_is_not_recommended_for_timing_noise():
    points = [point("baseline", 0.4, 18.0, 2.0), point("other", 0.4, 17.0, 2.0), point("exact", 0.2, 40.0)]
    for limits in ({"within": 0.5}, {"budget_ms": 21.0}):
        assert choose(points, ("direct",), **limits).point.name == "baseline"
    points = [point("cheap", 2.0, 2.0), *points[:2]]
    assert choose(points, ("direct",), within=3.0).next.name == "baseline"


def test_budget_includes_the_spread():
    points = [point("baseline", 0.4, 18.0, 1.0), point("cheap", 2.0, 2.0), point("exact", 0.2, 37.8)]
    assert choose(points, ("direct",), budget_ms=19.5).point.name == "baseline"
    assert choose(points, ("direct",), budget_ms=18.5).point.name == "cheap"
    assert choose(points, ("direct",), budget_ms=100.0).point.name == "exact"


@pytest.mark.parametrize(("limits", "nearest"), [({"budget_ms": 1.0}, "cheap"), ({"within": 0.1}, "exact")])
def test_nothing_meets_the_limits(limits, nearest):
    points = [point("baseline", 0.4, 18.0, 1.0), point("cheap", 2.0, 2.0), point("exact", 0.2, 37.8)]
    choice = choose(points, ("direct",), **limits)
    assert choice.point is None and nearest in choice.words


def test_several_columns_count_by_their_worst_error():
    a = point("baseline", 0.1, 10.0)
    a.columns["normal"] = ColumnError(5.0, 3.0)
    assert choose([a], ("direct", "normal"), within=1.0).point is None
    assert choose([a], ("direct",), within=1.0).point is a


def test_front_of_several_columns():
    a, b, c = (point("baseline", 0.1, 10.0), point("b", 0.5, 5.0), point("c", 0.4, 7.0))
    for p, other in ((a, 0.2), (b, 0.1), (c, 0.6)):
        p.columns["normal"] = ColumnError(5.0, other)
    assert names(pareto_front([a, b, c], ("direct", "normal"))) == ["b", "baseline"]
    assert names(pareto_front([a, b, c], "direct")) == ["b", "c", "baseline"]
    del c.columns["normal"]
    assert names(pareto_front([a, b, c], ("direct", "normal"))) == ["b", "baseline"]


def test_error_increase_over_pairs():
    reference = {str(i): 5.0 for i in range(10)}
    near = {k: 5.1 for k in reference}
    far = {k: 5.5 + 0.01 * i for i, k in enumerate(reference)}
    mean, error = error_increase(near, far, reference)
    assert mean == pytest.approx(0.445) and mean > 2 * error
    assert error_increase(far, near, reference)[0] < 0
