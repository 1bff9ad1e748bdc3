"""The search that fills fronts: what it has measured, what it has timed, when it stops, on points whose answer is
known, and in whole studies by a clock of ours."""

from __future__ import annotations

import json
import math
import re

import pytest
from study_tools import SMALL, ModelClock, seen, situation_of

from taubench_gl.errors import SettingsError
from taubench_gl.settings import Settings
from taubench_gl.study import cost, load_preset, save_preset
from taubench_gl.study.forecast import Forecast
from taubench_gl.study.gaps import NOT_LOOKED_INTO, NOTHING, Gap
from taubench_gl.study.knobs import KNOBS, pair_samples
from taubench_gl.study.rounds import SWEEPS
from taubench_gl.study.search import ATTEMPTS, GAPS_A_LAP, Search
from taubench_gl.study.store import RECORDS_FILE


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


def test_samples_of_a_sequence_are_its_strata_and_its_steps():
    # Of 13 frames, two pairs from each of 4 stretches draw all; every fifth pair would be two pairs.
    assert pair_samples(situation_of(pairs=12)) == ["strata:2", "strata:3", "every:2", "every:3", "every:4"]
    assert len(pair_samples(situation_of(pairs=240))) < 80, "of those that cost the same one is enough"


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


def test_errors_are_measured_for_the_gaps_and_over_all_pairs():
    points = declared()
    known = {s.name for s in points}
    found = search().bodies(points, [], known, {}, 0.05)
    assert found and not known & {search().name(p.choice) for p in found}
    assert all("pairs" not in p.choice for p in found), "a full run tells the errors of every sample"
    assert {p.gap for p in found} <= {
        ("pairs=every:8", "base"), ("base", "samples_per_pixel=4"), ("samples_per_pixel=4", "best"),
    }  # fmt: skip
    last = next(p for p in found if p.gap == ("samples_per_pixel=4", "best"))
    assert last.choice == {"samples_per_pixel": 8}
    assert found == search().bodies(points, [], known, {}, 0.05), "the same records give the same proposals"


def test_nothing_is_measured_for_a_full_front_or_after_all_attempts():
    points = declared()
    known = {s.name for s in points}
    assert search(wanted=1).bodies(points, [], known, {}, 0.05) == []
    used = {("direct", a.name, b.name): ATTEMPTS for a in points for b in points}
    assert search().bodies(points, [], known, used, 0.05) == []
    assert search().bodies(points, [], known, {}, 3.0) == [], "no gap is wider than what the visits tell apart"


def test_a_front_that_is_expected_to_be_full_asks_for_no_errors():
    points = declared()
    room = [seen(f"x{i}", 2.0**i, 0.2 * 2.0**-i, {"scale": 0.9}, timed=False) for i in range(-3, 4)]
    assert search(wanted=3).bodies(points, room, set(), {}, 0.05) == []


def test_what_is_expected_on_a_front_is_timed_the_furthest_first():
    points = [seen("base", 1.0, 0.2), seen("best", 16.0, 0.0, {"samples_per_pixel": 16})]
    expected = [
        seen("near", 1.3, 0.19, {"samples_per_pixel": 2}, timed=False),
        seen("far", 4.0, 0.1, {"samples_per_pixel": 4}, timed=False),
        seen("beaten", 8.0, 0.15, {"samples_per_pixel": 8}, timed=False),
    ]
    found = search().tries(points, expected, 0.05)
    assert [p.choice["samples_per_pixel"] for p in found] == [4, 2]
    many = [seen(f"x{i}", 1.3**i, 0.2 - 0.01 * i, {"samples_per_pixel": i}, timed=False) for i in range(1, 9)]
    assert len(search(wanted=12).tries(points, many, 0.05)) == GAPS_A_LAP
    assert search().tries(points, [], 0.05) == []


def test_why_a_gap_of_a_finished_front_is_empty():
    gap = Gap("direct", seen("base", 1.0, 0.2), seen("best", 16.0, 0.0, {"samples_per_pixel": 16}))
    inside, beside = (seen("x", t, 0.1, {"samples_per_pixel": 4}, timed=False) for t in (4.0, 32.0))
    assert search().why(gap, [inside], 0.05) == NOT_LOOKED_INTO
    assert search().why(gap, [beside], 0.05) == NOTHING


def test_a_forecast_multiplies_times_and_adds_squares():
    forecast = Forecast(situation_of(pairs=40), DIALS, declared())
    both = {"scale": 0.5, "pairs": "every:8"}
    assert forecast.log_time(both) == pytest.approx(math.log(0.3 * 0.25))
    assert forecast.error(both, "direct") == pytest.approx(math.hypot(1.0, 0.8))
    # Half-way between 0.5 and 1 on the logarithmic scale of sizes.
    assert forecast.log_time({"scale": math.sqrt(0.5)}) == pytest.approx(0.5 * math.log(0.3))


def test_a_forecast_starts_from_the_nearest_that_was_timed():
    # Together the two dials save less than each alone would have it: 0.3 * 0.25 = 0.075.
    points = [*declared(), seen("both", 0.15, 1.3, {"scale": 0.5, "pairs": "every:8"})]
    forecast = Forecast(situation_of(pairs=40), DIALS, points)
    assert forecast.log_time({"scale": 0.5, "pairs": "every:8"}) == pytest.approx(math.log(0.15))
    assert forecast.log_time({"scale": 0.5}) == pytest.approx(math.log(0.3)), "what was timed is what it took"
    beside = {"scale": 0.51, "pairs": "every:8"}
    assert math.log(0.15) < forecast.log_time(beside) < math.log(0.16)


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
    order = re.findall(r'"kind": "time", "setting": "([^"]*)", "pass": 1, "round": (\d+), "sweep": (\d+)', text)
    settings = [name for name, *when in order if when == ["0", "0"]]
    assert len(settings) > len(studies[0].points), "what was found is among them"
    assert order == [(name, str(r), str(k)) for r in range(4) for k in range(SWEEPS) for name in settings]
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


def measured(text):
    """Records without what no clock of ours decides."""
    lines = (json.loads(line, parse_float=lambda digits: round(float(digits), 6)) for line in text.splitlines())
    return [{k: v for k, v in line.items() if k not in ("load", "passes")} for line in lines]


def test_a_search_that_was_killed_goes_on_and_ends_alike(filled, demo, tmp_path):
    out, _ = filled
    whole = (out / "10" / RECORDS_FILE).read_text().splitlines(keepends=True)
    kinds = [json.loads(line)["kind"] for line in whole]
    first, last = ({kind: i for i, kind in order} for order in (reversed([*enumerate(kinds)]), enumerate(kinds)))
    cuts = (first["screen"] + 2, first["lap"] + 2, last["lap"] + 1, len(whole) - 3)
    for cut in cuts:  # among the first errors, in the first lap, before the last, in the last round
        folder = tmp_path / str(cut)
        folder.mkdir()
        (folder / RECORDS_FILE).write_text("".join(whole[:cut]))
        clock = ModelClock()
        cost(demo, out=folder, **FILLED | {"now": clock, "progress": clock.listen})
        text = (folder / RECORDS_FILE).read_text()
        assert text.startswith("".join(whole[:cut])), "nothing is lost or measured again"
        assert measured(text) == measured("".join(whole))


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
