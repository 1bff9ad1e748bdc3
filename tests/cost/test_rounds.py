"""Rounds: the order of visits, where they are taken up, and what counts of them."""

from __future__ import annotations

from taubench_gl.cost.plan import Setting
from taubench_gl.cost.rounds import SWEEPS, due_visits, rounds_of
from taubench_gl.settings import Settings


def order(done=()):
    settings = [Setting(n, "one", {}, Settings()) for n in "abc"]
    return [(r, k, s.name) for r, k, s in due_visits(settings, 2, done)]


def test_visits_go_round_and_take_up_where_they_stopped():
    whole = order()
    assert whole == [(r, k, n) for r in range(2) for k in range(SWEEPS) for n in "abc"]
    for cut in (2, 7, 11, len(whole)):
        assert order([{"setting": n} for _, _, n in whole[:cut]]) == whole[cut:]


def visit(setting, number, ms, **more):
    return {"setting": setting, "round": number, "sweep": 0, "frame_ms": ms, "load": 1.0} | more


def test_of_a_round_the_median_of_its_visits_counts():
    assert SWEEPS == 3
    visits = [visit(n, r, ms) for r, k in enumerate([(4.0, 90.0, 5.0), (1.0, 3.0, 2.0)]) for ms in k for n in "ab"]
    found = rounds_of(visits)
    assert found == [{"setting": n, "round": r, "frame_ms": ms} for r, ms in ((0, 5.0), (1, 2.0)) for n in "ab"]


def test_a_round_that_was_cut_short_does_not_count_yet():
    visits = [visit("a", 0, 1.0), visit("b", 0, 1.0), visit("a", 0, 2.0), visit("b", 0, 2.0), visit("a", 0, 3.0)]
    assert rounds_of(visits) == [{"setting": "a", "round": 0, "frame_ms": 2.0}]


def test_passes_and_the_times_of_the_base_have_medians_of_their_own():
    passes = [{"masks": 1.0}, {"masks": 3.0, "color": 6.0}, {"masks": 2.0}]
    visits = [visit("a", 0, 9.0, base_ms=b, passes=p) for b, p in zip((3.0, 1.0, 2.0), passes)]
    told = {"frame_ms": 9.0, "base_ms": 2.0, "passes": {"color": 0.0, "masks": 2.0}}
    assert rounds_of(visits) == [{"setting": "a", "round": 0} | told]
