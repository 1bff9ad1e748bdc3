"""Fronts while they are being filled: what stands on them, their gaps and what is said of them, answers by hand."""

from __future__ import annotations

import pytest
from study_tools import seen

from taubench_gl.study import gaps
from taubench_gl.study.forecast import Seen
from taubench_gl.study.gaps import Gap, closed, rough_front, spread_of, spread_out, told, worth_keeping


def names(found):
    return [s.name for s in found]


def test_a_rough_front_by_hand():
    points = [seen("a", 1.0, 4.0), seen("b", 2.0, 2.0), seen("c", 2.1, 2.5), seen("d", 1.98, 1.9), seen("e", 9.0, 0.0)]
    assert names(rough_front(points, "direct", 0.0)) == ["a", "d", "e"]
    # b and d are within the margin of each other; the more exact one stays.
    points = [p for p in points if p.name != "d"] + [seen("d", 2.02, 1.9)]
    assert names(rough_front(points, "direct", 0.05)) == ["a", "d", "e"]
    assert names(rough_front(points, "direct", 0.0)) == ["a", "b", "d", "e"]


def test_of_equal_errors_the_fastest_is_on_the_rough_front():
    assert names(rough_front([seen("slow", 2.0, 1.0), seen("fast", 1.0, 1.0)], "direct", 0.1)) == ["fast"]
    assert names(rough_front([seen("base", 1.02, 1.0), seen("lucky", 1.0, 1.0)], "direct", 0.1)) == ["base"]


def test_only_what_stands_on_a_front_is_kept():
    points = [seen("base", 1.0, 1.0), seen("good", 0.5, 2.0), seen("bad", 0.9, 3.0), seen("noise", 1.01, 1.5)]
    assert worth_keeping(points, ["direct"], ["good", "bad", "noise"], 0.05) == ["good"]


def test_a_front_is_thinned_where_it_is_densest():
    # Doublings, and one setting just beside "c".
    steps = [("a", 1, 9), ("b", 2, 7), ("c", 4, 5), ("d", 4.4, 4), ("e", 8, 2), ("f", 16, 0)]
    there = [seen(*s, timed=False) for s in steps]
    assert names(spread_out(there, "direct", 6, 0.0)) == ["a", "b", "c", "d", "e", "f"]
    assert names(spread_out(there, "direct", 5, 0.0)) == ["a", "b", "c", "e", "f"], "d leaves the narrowest room"
    assert names(spread_out(there, "direct", 1, 0.0)) == ["a", "f"], "the ends stay"
    there[3] = seen(*steps[3])
    assert names(spread_out(there, "direct", 5, 0.0)) == ["a", "b", "d", "e", "f"], "what was timed stays"


def test_what_is_not_told_apart_in_error_is_not_looked_for():
    steps = [("a", 1, 9), ("b", 2, 4.01), ("c", 4, 4), ("d", 8, 0)]
    there = [seen(*s, timed=False) for s in steps]
    assert names(spread_out(there, "direct", 9, 0.1)) == ["a", "c", "d"]
    there[1] = seen(*steps[1])
    assert names(spread_out(there, "direct", 9, 0.1)) == ["a", "b", "c", "d"], "it was timed already"


@pytest.mark.parametrize(
    ("fast", "fine", "why"),
    [
        (seen("a", 1.0, 1.0), seen("b", 2.0, 0.5), None),
        (seen("a", 1.0, 1.0), seen("b", 1.05, 0.5), gaps.NARROW_TIME),
        (seen("a", 1.0, 0.51), seen("b", 2.0, 0.5), gaps.NARROW_ERROR),
        (Seen("1 spp", None, 0.0, {"direct": 1.0}), seen("b", 2.0, 0.5), gaps.RENDERED),
    ],
)
def test_why_a_gap_is_closed(fast, fine, why):
    assert closed(Gap("direct", fast, fine), 0.04, 0.01) == why


def test_margins_are_those_of_the_visits():
    # Five rounds with a median absolute deviation of 0.1: 1.5 * 1.4826 * 0.1.
    assert spread_of([[0.0, 0.1, -0.1, 0.3, -0.3]] * 3) == pytest.approx(1.5 * 1.4826 * 0.1)
    assert spread_of([[0.0, 0.0, 0.0]]) == gaps.NARROW == spread_of([])


def test_a_front_says_how_full_it_is():
    between = [
        Gap("direct", seen("a", 1.0, 2.0), seen("b", 2.0, 1.0)),
        Gap("direct", seen("b", 2.0, 1.0), seen("c", 4.0, 0)),
    ]
    assert told(between, 3, lambda gap: "x", 0) == "3 settings, 3 were wanted"
    assert told(between, 12, lambda gap: gaps.NOTHING, 0).endswith(f"2 gaps between them 2 {gaps.NOTHING}")
    assert told(between[:1], 12, lambda gap: gaps.NARROW_TIME, 0).endswith(f"the gap between them {gaps.NARROW_TIME}")
    assert "nothing to pay time for" in told([], 12, lambda gap: "", 0)
    assert "none of the 3 less exact ones is faster" in told([], 12, lambda gap: "", 3)
