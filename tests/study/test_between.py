"""The search between neighbours on a front: gaps, what it proposes, when it stops, on points whose answer is known."""

from __future__ import annotations

import math
import re

import pytest
from study_tools import SMALL, ModelClock, situation_of

from taubench_gl.errors import SettingsError
from taubench_gl.settings import Settings
from taubench_gl.study import between, cost, load_preset, save_preset
from taubench_gl.study.between import Forecast, Gap, Search, Seen, closed, rough_front, spread_of, told, worth_keeping
from taubench_gl.study.knobs import KNOBS
from taubench_gl.study.store import RECORDS_FILE


def seen(name, time, error, choice=None, **errors):
    return Seen(name, {} if choice is None else choice, math.log(time), {"direct": error} | errors)


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


@pytest.mark.parametrize(
    ("fast", "fine", "tries", "why"),
    [
        (seen("a", 1.0, 1.0), seen("b", 2.0, 0.5), 0, None),
        (seen("a", 1.0, 1.0), seen("b", 2.0, 0.5), between.ATTEMPTS, between.TRIED),
        (seen("a", 1.0, 1.0), seen("b", 1.05, 0.5), 0, between.NARROW_TIME),
        (seen("a", 1.0, 0.51), seen("b", 2.0, 0.5), 0, between.NARROW_ERROR),
        (Seen("1 spp", None, 0.0, {"direct": 1.0}), seen("b", 2.0, 0.5), 0, between.RENDERED),
    ],
)
def test_why_a_gap_is_closed(fast, fine, tries, why):
    gap = Gap("direct", fast, fine)
    assert closed(gap, 0.04, 0.01, {gap.key: tries}) == why


def test_margins_are_those_of_the_visits():
    # Five rounds with a median absolute deviation of 0.1: 1.5 * 1.4826 * 0.1.
    assert spread_of([[0.0, 0.1, -0.1, 0.3, -0.3]] * 3) == pytest.approx(1.5 * 1.4826 * 0.1)
    assert spread_of([[0.0, 0.0, 0.0]]) == between.NARROW == spread_of([])


def test_a_front_says_how_full_it_is():
    gaps = [
        Gap("direct", seen("a", 1.0, 2.0), seen("b", 2.0, 1.0)),
        Gap("direct", seen("b", 2.0, 1.0), seen("c", 4.0, 0)),
    ]
    assert told(gaps, 3, lambda gap: "x", 0) == "3 settings, 3 were wanted"
    assert told(gaps, 12, lambda gap: between.TRIED, 0).endswith(f"2 gaps between them 2 {between.TRIED}")
    assert told(gaps[:1], 12, lambda gap: between.NARROW_TIME, 0).endswith(
        f"the gap between them {between.NARROW_TIME}"
    )
    assert "nothing to pay time for" in told([], 12, lambda gap: "", 0)
    assert "none of the 3 less exact ones is faster" in told([], 12, lambda gap: "", 3)


@pytest.mark.parametrize(
    ("dial", "a", "b", "middle"),
    [
        ("scale", 0.25, 1.0, 0.5),
        ("scale", 0.5, 0.51, None),
        ("samples_per_pixel", 1, 4, 2),
        ("samples_per_pixel", 4, 16, 8),
        ("samples_per_pixel", 1, 2, None),
        ("shadow_size", 256, 1024, 512),
        ("shadow_lights", 1, 4, 2),
        ("indirect_samples", 256, 4096, 1024),
        ("storage", "half", "float", None),
    ],
)
def test_dials_are_bisected(dial, a, b, middle):
    situation = situation_of(pairs=40)
    for low, high in ((a, b), (b, a)):
        assert KNOBS[dial].between(situation, low, high) == middle


def test_samples_are_bisected_over_grids_that_are_nearly_square():
    situation = situation_of()
    found = {KNOBS["samples_per_pixel"].between(situation, a, b) for a in range(1, 17) for b in range(a, 17)}
    assert found - {None} <= {2, 4, 6, 8, 9, 12, 15, 16} and 9 in found


def test_pairs_are_bisected_by_the_frames_they_draw():
    situation = situation_of(pairs=40)
    place = KNOBS["pairs"].place
    middle = KNOBS["pairs"].between(situation, "every:8", "all")
    assert place(situation, "every:8") < place(situation, middle) < place(situation, "all") == 0.0
    assert place(situation, middle) == pytest.approx(0.5 * place(situation, "every:8"), abs=0.15)
    assert KNOBS["pairs"].between(situation, middle, middle) is None


DIALS = ("scale", "pairs", "samples_per_pixel", "storage", "summation", "histogram_bits")


def search(wanted=6, dials=DIALS):
    best = {"samples_per_pixel": 16}
    return Search(situation_of(pairs=40), dials, ("direct",), wanted, {"direct": 1e-4}, best)


def declared():
    one = [("scale", 0.5, 0.3, 1.0), ("pairs", "every:8", 0.25, 0.8), ("samples_per_pixel", 4, 4.0, 0.05),
           ("storage", "half", 1.0, 0.3), ("summation", "plain", 0.97, 0.2)]  # fmt: skip
    found = [seen("base", 1.0, 0.2), seen("best", 16.0, 0.0, {"samples_per_pixel": 16})]
    return found + [seen(f"{d}={v}", t, e, {d: v}) for d, v, t, e in one]


def test_dials_that_do_not_trade_are_left_alone():
    # Half floats are neither faster nor better here; sums over pairs cost nothing in a frame.
    assert search().turned(declared(), 0.05) == ["scale", "pairs", "samples_per_pixel"]
    assert search().cheapest(declared(), 0.05) == {"scale": 0.5, "pairs": "every:8"}


def test_proposals_lie_in_the_gaps_and_are_new():
    points = declared()
    known = {s.name for s in points}
    found = search().propose(points, known, {}, 0.05)
    assert found and not known & {search().name(p.choice) for p in found}
    assert found[0].choice == {"scale": 0.5, "pairs": "every:8"} and found[0].gap == (), "beyond the fast end"
    assert {p.gap for p in found[1:]} == {
        ("pairs=every:8", "base"), ("base", "samples_per_pixel=4"), ("samples_per_pixel=4", "best"),
    }  # fmt: skip
    last = next(p for p in found if p.gap == ("samples_per_pixel=4", "best"))
    assert last.choice == {"samples_per_pixel": 8}
    assert found == search().propose(points, known, {}, 0.05), "the same records give the same proposals"


def test_nothing_is_proposed_for_a_full_front_or_after_all_tries():
    points = declared()
    known = {s.name for s in points}
    assert search(wanted=2).propose(points, known, {}, 0.05) == []
    assert search().propose(points, known, {("direct",): between.TRIES_A_FRONT * 6}, 0.05) == []
    assert search().propose(points, known, {}, 3.0) == [], "no gap is wider than what the visits tell apart"


def test_a_forecast_multiplies_times_and_adds_squares():
    points = declared()
    forecast = Forecast(situation_of(pairs=40), DIALS, points)
    both = {"scale": 0.5, "pairs": "every:8"}
    assert forecast._time(both) == pytest.approx(math.log(0.3 * 0.25))
    assert forecast._error(both, "direct") == pytest.approx(math.hypot(1.0, 0.8))
    # Half-way between 0.5 and 1 on the logarithmic scale of sizes.
    assert forecast._time({"scale": math.sqrt(0.5)}) == pytest.approx(0.5 * math.log(0.3))


FILLED = SMALL | {
    "width": 32, "height": 18, "frames": (20, 33), "columns": ("frustum", "position"), "choose_for": ("frustum",),
    "knobs": ("scale", "pairs", "samples_per_pixel"), "repeats": 4, "front": 10, "within": 2.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def filled(tmp_path_factory, demo):
    """A study by a clock of ours, a 1 % jitter in it, with and without the search."""
    out = tmp_path_factory.mktemp("filled")
    studies = {}
    for front in (0, FILLED["front"]):
        clock = ModelClock()
        more = FILLED | {"front": front, "now": clock, "progress": clock.listen}
        studies[front] = cost(demo, out=out / str(front), **more)
    return out, studies


def test_the_search_fills_a_front(filled):
    _, studies = filled
    before, after = (len(studies[f].front("frustum")) for f in (0, 10))
    assert before < 10 <= after, "as many as were wanted"
    assert studies[0].search is None
    report = studies[10].search
    assert report["fronts"]["frustum"] == f"{after} settings, 10 were wanted"
    assert "was not asked for" in report["fronts"]["position"]
    kept = {t["setting"] for t in report["tried"] if t["kept"]}
    assert kept == {p.name for p in studies[10].points if p.role == "between"} and report["kept"] == len(kept)
    assert kept & {p.name for p in studies[10].front("frustum")}


def test_all_settings_of_a_filled_study_were_timed_in_turn(filled):
    out, studies = filled
    text = (out / "10" / RECORDS_FILE).read_text()
    order = re.findall(r'"kind": "time", "setting": "([^"]*)", "pass": 1, "round": (\d+)', text)
    settings = [name for name, r in order if r == "0"]
    assert len(settings) > len(studies[0].points), "what was found is among them"
    assert order == [(name, str(r)) for r in range(4) for name in settings]
    assert all(p.time.samples == 4 and p.features for p in studies[10].points)


def test_a_preset_may_be_one_that_was_found(filled):
    _, studies = filled
    chosen = {f: studies[f].chosen.point for f in (0, 10)}
    assert chosen[10].time.median <= chosen[0].time.median * 1.02, "more to choose from is never slower"
    assert studies[10].checked["errors_kept"] and studies[10].checked["setting"] == chosen[10].name


def test_every_setting_that_was_found_can_be_a_preset(filled, tmp_path):
    _, studies = filled
    found = [s for s in studies[10].plan.settings if s.role == "between"]
    for setting in found:
        save_preset(tmp_path / "preset.toml", setting.settings, {})
        again = Settings(**load_preset(tmp_path / "preset.toml"), frames=setting.settings.frames)
        assert again == setting.settings
    assert found


def test_a_search_that_was_killed_goes_on_and_ends_alike(filled, demo, tmp_path):
    out, _ = filled
    whole = (out / "10" / RECORDS_FILE).read_text().splitlines(keepends=True)
    laps = [i for i, line in enumerate(whole) if '"kind": "lap"' in line]
    for cut in (laps[0] + 2, laps[-1] + 1, len(whole) - 3):  # in the first lap, before the last, in the last round
        folder = tmp_path / str(cut)
        folder.mkdir()
        (folder / RECORDS_FILE).write_text("".join(whole[:cut]))
        clock = ModelClock()
        study = cost(demo, out=folder, **FILLED | {"now": clock, "progress": clock.listen})
        text = (folder / RECORDS_FILE).read_text()
        assert text.startswith("".join(whole[:cut])), "nothing is lost or measured again"
        assert len(study.front("frustum")) >= 10
        errors = re.findall(r'"kind": "error", "setting": "([^"]*)"', text)
        assert len(errors) == len(set(errors))


def test_progress_ends_at_its_total(demo, tmp_path):
    clock, steps = ModelClock(), []

    def said(step):
        clock.listen(step)
        steps.append(step)

    more = {"knobs": ("scale", "samples_per_pixel"), "frames": (20, 24), "front": 6, "check": False, "within": None}
    study = cost(demo, out=tmp_path, **FILLED | more | {"now": clock, "progress": said})
    assert study.search["kept"] > 0, "there was a second pass"
    assert all(step.done < step.total for step in steps) and steps[-1].done == steps[-1].total - 1


def test_a_finished_study_measures_nothing_more(filled, demo):
    out, _ = filled
    said = []
    study = cost(demo, out=out / "10", **FILLED | {"progress": lambda step: said.append(step.what), "check": False})
    assert said == [] and len(study.front("frustum")) >= 10


def test_a_negative_front_is_refused(demo, tmp_path):
    with pytest.raises(SettingsError, match="front is -1"):
        cost(demo, out=tmp_path / "x", **FILLED | {"front": -1})


def test_with_too_few_visits_nothing_is_tried(demo, tmp_path):
    more = {"knobs": ("storage",), "repeats": 1, "frames": (20, 22), "check": False, "within": None}
    study = cost(demo, out=tmp_path, **FILLED | more)
    assert study.search["laps"] == 0 and "no two times apart" in study.search["fronts"]["frustum"]
    assert all(p.role != "between" for p in study.points)
