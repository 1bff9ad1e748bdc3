"""Cost studies: their files, resumption, and what they refuse.  Most with evaluations whose results are given."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from fixed import fixed_settings

from taubench_gl.cost import configurations, cost
from taubench_gl.cost import study as study_module
from taubench_gl.cost.study import EvaluationUnit
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.preset import load_preset
from taubench_gl.report.cost import write_cost
from taubench_gl.study.store import json_bytes

DEMO = Path(__file__).resolve().parents[2] / "assets" / "demo.glb"
TINY = {"light": "auto", "size": "8x5", "frames": (0, 2), "columns": "frustum,direct,indirect"}
REQUEST = {"repeats": 1, "clock": "cpu", "time": None}
OFF = {"light_unit": "candela", "exposure": 1.0, "environment": "none"}
LACKING = "--light preview --indirect none"
TRUE = {"frustum": 3.0, "direct": 20.0, "indirect": 6.0}


def evaluated(unit: EvaluationUnit) -> dict:
    """The record of an evaluation on a machine whose seconds and errors follow from the settings.

    A preview takes 1 s and is 3 points off, N samples take N s and are 8 / sqrt(N) points off, decided samples within W
    take 16 / W^2 s and are W points off at most.
    """
    lighting, percents, seconds, half = unit.settings.lighting, dict(TRUE), 1.0, None
    if lighting.light == "preview":
        percents["direct"] += 3.0
        percents["indirect"] = None if lighting.indirect == "none" else 6.5
    elif lighting.spp is not None:
        seconds, percents["indirect"] = float(lighting.spp), 6.0 + 8.0 / math.sqrt(lighting.spp)
    elif lighting.light == "auto":
        half = lighting.light_within
        seconds = 16.0 / half**2
    sampled = {} if half is None else {name: p for name, p in percents.items() if name != "frustum" and p is not None}
    ends = dict.fromkeys(percents) | {name: [p - half, p + half] for name, p in sampled.items()}
    wanted = {name: percents[name] for name in unit.settings.metrics.columns}
    columns = {n: {"percent": p, "interval95": ends[n], "reason": None if p else "off"} for n, p in wanted.items()}
    light = None if half is None else {"samples": 1000, "pixels": 10}
    made = {"renderer": "none", "driver": "none", "version": "0"}
    return {"seconds": 2 * seconds, "cpu_seconds": seconds, "first_pair_seconds": 1.0, "first_pair_cpu_seconds": 0.5,
            "repeats": 1, "pairs": 1,
            "sampled_light": light, "decided_light": None, "provenance": made, "columns": columns}  # fmt: skip


@pytest.fixture
def names(monkeypatch):
    """Names of the evaluated units, filled by ``evaluated``; before unit number ``names.stop`` the user interrupts."""

    class Names(list):
        stop = None

    every = Names()

    def run(self, worker):
        if len(every) == every.stop:
            raise KeyboardInterrupt
        every.append(self.name)
        return json_bytes(evaluated(self))

    monkeypatch.setattr(EvaluationUnit, "run", run)
    monkeypatch.setattr(study_module, "write_cost", lambda values, folder: [])
    return every


@pytest.mark.usefixtures("plots")
def test_a_study_from_units_to_page(tmp_path, names):
    study = cost(DEMO, out=tmp_path, **TINY, **OFF, **REQUEST)
    assert len(names) == len(set(names)) == len(study["points"]) + 1
    points = {point["name"]: point for point in study["points"]}
    errors = {"default": 1.0, "--light-within 0.5": 0.5, "--light preview": 3.25, "--light path-traced --spp 4": 4.25}
    assert {name: points[name]["error"] for name in errors} == pytest.approx(errors)
    assert points["--light path-traced"]["error"] == pytest.approx(0.25), "as exact as the truth is known"
    assert study["front"] == ["--light path-traced"], "in a second, and nothing is more exact"
    assert study["truth"]["half_width"] == pytest.approx(0.25) and study["truth"]["evaluations"] == 1

    kept = json.loads((tmp_path / "cost.json").read_text())
    assert kept["front"] == study["front"] and kept["lines"] == study["lines"] and len(kept["lines"]) >= 5
    files = write_cost(kept, tmp_path)
    assert all(file.stat().st_size > 200 for file in files) and (tmp_path / "cost.png").stat().st_size > 5000
    page = (tmp_path / "cost.html").read_text()
    assert all(name in page for name in points)
    for use in study["recommendations"]:
        assert use["reached"] and load_preset(tmp_path / use["preset"])["width"] == 8
        command = tomllib.loads((tmp_path / use["preset"]).read_text())["measured"]["command"]
        assert command == points[use["configuration"]]["command"] and "--frames" in command, "those of the study"
    with pytest.raises(OutputError):  # another table
        cost(DEMO, out=tmp_path, **TINY | {"columns": "direct"}, **OFF, **REQUEST)


def test_a_configuration_that_lacks_a_wanted_column_is_shown_and_not_recommended(tmp_path, names):
    study = cost(DEMO, out=tmp_path, **TINY, **OFF, **REQUEST)
    lacking = next(point for point in study["points"] if point["name"] == LACKING)
    assert lacking["error"] is None and tuple(lacking["lacking"]) == ("indirect",)
    named = [use["configuration"] for use in study["recommendations"]]
    assert LACKING not in [*named, *study["front"], study["preview_enough"], study["deciding_wins"]]
    study = cost(DEMO, out=tmp_path / "b", **TINY | {"columns": "frustum,direct"}, **OFF, **REQUEST)
    assert study["points"] and all(not point["lacking"] for point in study["points"] if point["name"] != LACKING)


@pytest.mark.parametrize("stop", [1, 15])
def test_an_interrupted_study_goes_on_and_evaluates_nothing_twice(tmp_path, names, stop):
    whole = cost(DEMO, out=tmp_path / "whole", **TINY, **OFF, **REQUEST)
    expected = list(names)
    names.clear()
    names.stop = stop
    with pytest.raises(KeyboardInterrupt):
        cost(DEMO, out=tmp_path / "part", **TINY, **OFF, **REQUEST)
    names.stop = None
    assert cost(DEMO, out=tmp_path / "part", **TINY, **OFF, **REQUEST) == whole and names == expected
    assert cost(DEMO, out=tmp_path / "part", **TINY, **OFF, **REQUEST) == whole and names == expected


@pytest.fixture
def wide_truth(monkeypatch):
    """Evaluations of the truth are within 1 point, in 16 s."""

    def wide(unit):
        settings = unit.settings.replace(light_within=1.0) if unit.job == "truth" else unit.settings
        return evaluated(replace(unit, settings=settings))

    monkeypatch.setattr(EvaluationUnit, "run", lambda self, worker: json_bytes(wide(self)))


def test_the_truth_has_as_many_evaluations_as_its_interval_needs(tmp_path, names, wide_truth):
    study = cost(DEMO, out=tmp_path, **TINY, **OFF, **REQUEST, truth_within=0.4)
    assert study["truth"]["evaluations"] == 7  # 1 / sqrt(7) = 0.378
    assert study["truth"]["half_width"] == pytest.approx(1.0 / math.sqrt(7.0))


def test_what_does_not_fit_the_time_is_left_out_with_a_reason(tmp_path, names):
    """The truth takes 256 s, 1, 4 and 16 samples 21 s, decided samples 1 + 4 + 16 s, a preview 1 s: each with 0.5 s
    for its first pair."""
    limited = REQUEST | {"time": 256.5 + 22.5 + 22.5 + 3.2}
    study = cost(DEMO, out=tmp_path, **TINY, **OFF, **limited)
    left = {"--light path-traced --spp 64", "--light-within 0.5", "--light path-traced"}
    assert left <= study["left_out"].keys() and not left & set(names)
    assert {"--light path-traced --spp 16", "default", "--light preview"} <= set(names)
    assert sum(name.startswith("--light preview") for name in names) == 2
    longer = cost(DEMO, out=tmp_path, **TINY, **OFF, **REQUEST)
    assert longer["left_out"].keys() < study["left_out"].keys() - left
    assert len(longer["points"]) - len(study["points"]) == len(study["left_out"]) - len(longer["left_out"])


def test_the_truth_takes_half_of_the_time(tmp_path, names, wide_truth):
    """16.5 s each: seven for an interval of 0.4 points, three of them in 50 s."""
    study = cost(DEMO, out=tmp_path, **TINY, **OFF, **REQUEST | {"time": 100.0}, truth_within=0.4)
    assert study["truth"]["evaluations"] == 3
    assert study["truth"]["half_width"] == pytest.approx(1.0 / math.sqrt(3.0))


REFUSED = [
    ("light", {"light": "raster"}), ("spp", {"spp": 4}), ("columns", {"columns": "position"}),
    ("columns", {"samples_per_pixel": 4}), ("truth_within", {"truth_within": 0}), ("clock", {"clock": "sun"}),
]  # fmt: skip


@pytest.mark.parametrize(("setting", "options"), REFUSED)
def test_settings_of_the_configurations_are_refused(tmp_path, setting, options):
    with pytest.raises(SettingsError) as error:
        cost(DEMO, out=tmp_path / "study", **TINY | options)
    assert error.value.setting == setting and not (tmp_path / "study").exists()


@pytest.mark.parametrize(
    ("wrong", "named"),
    [(("--truth-within", "no"), "--truth-within"), (("--time", "soon"), "--time"), (("--frames", "0:1"), "pair"),
     (("--spp", "4"), "--spp"), (("--columns", "position"), "column"), (("--camera", "nobody"), "nobody")],
)  # fmt: skip
def test_wrong_input_is_one_line(taubench, tmp_path, wrong, named):
    given = ["--exposure", "1", "--environment", "none", "--size", "8x5"]
    code, _, err = taubench("cost", DEMO, "--out", tmp_path / "study", *given, *wrong)
    lines = [line for line in err.splitlines() if "rror" in line]
    assert code == 2 and len(lines) == 1 and named in lines[0]
    assert not (tmp_path / "study").exists()


def test_a_table_without_light_is_refused(tmp_path, names, monkeypatch):
    monkeypatch.setitem(TRUE, "direct", None)
    monkeypatch.setitem(TRUE, "indirect", None)
    monkeypatch.setattr(configurations, "PREVIEWS", ())
    monkeypatch.setattr(configurations, "SAMPLES", ())
    with pytest.raises(SettingsError) as error:
        cost(DEMO, out=tmp_path, **TINY, **OFF, **REQUEST)
    assert error.value.where == str(DEMO)


@pytest.mark.usefixtures("plots")
def test_columns_are_those_of_evaluate(tmp_path, monkeypatch):
    monkeypatch.setattr(configurations, "PREVIEWS", ({"indirect": "rsm"},))
    monkeypatch.setattr(configurations, "SAMPLES", (1,))
    monkeypatch.setattr(configurations, "WITHIN", (50.0,))
    study = cost(DEMO, out=tmp_path, **TINY, **OFF, **REQUEST, truth_within=99.0)
    assert study["truth"]["evaluations"] == 1 and study["truth"]["columns"]["frustum"]["half_width"] == 0.0
    assert (tmp_path / "cost.html").exists()
    changes = {
        "--light preview --indirect rsm": {"light": "preview", "indirect": "rsm"},
        "--light path-traced --spp 1": {"light": "path-traced", "spp": 1},
        "--light path-traced": {"light": "path-traced"},
        "--light-within 50": {"light_within": 50.0},
    }
    assert {point["name"] for point in study["points"]} == changes.keys()
    for point in study["points"]:
        settings = fixed_settings(**TINY | OFF | changes[point["name"]])
        discard = evaluate_scene(DEMO, settings, sampled=True).summary["discard"]
        for name, column in point["columns"].items():
            assert column["percent"] == discard[name]["mean_percent"]
            assert column["interval95"] == discard[name].get("interval95_percent")
        assert point["seconds"] == point["cpu_seconds"] > 0.0 < point["wall_seconds"]
