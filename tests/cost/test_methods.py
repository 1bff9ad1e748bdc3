"""Reuse methods in a study: what is asked for, points and words with known answers, and one small run."""

from __future__ import annotations

import json

import pytest

from taubench_gl.cost import cost
from taubench_gl.cost.analysis import pareto_front
from taubench_gl.cost.clock import time_of
from taubench_gl.cost.methods import MethodPoint, candidates, method_points, recommend, split_knobs
from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.report.study_html import study_html
from taubench_gl.report.study_tables import study_text


def test_methods_are_told_from_dials():
    assert split_knobs(None) == (None, [])
    assert split_knobs(["storage", "method:svgf"]) == (["storage"], ["svgf"])
    assert split_knobs(["method:svgf@alpha=0.1"]) == ([], ["svgf@alpha=0.1"])
    assert candidates([]) == ()


def test_ranges_and_lists_make_a_grid_and_no_reuse_comes_first():
    found = candidates(["taa_variance@gamma=0.5:2:4@dilate=true/false", "accumulate"], ["full", "half"])
    here = [c for c in found if c.input == "full"]
    assert [c.input for c in found] == ["full"] * 10 + ["half"] * 10
    assert [c.label for c in here][:1] == ["no reuse on full"]
    assert [c.spec.label for c in here][1:3] == [
        "taa_variance@gamma=0.5@dilate=true",
        "taa_variance@gamma=0.5@dilate=false",
    ]
    assert {c.spec.settings.get("gamma") for c in here[1:9]} == {"0.5", "1", "1.5", "2"}
    assert len({c.name for c in found}) == len(found)


@pytest.mark.parametrize(
    ("methods", "inputs", "error", "complaint"),
    [
        (["nothing_like_it"], ["full"], MethodError, "nothing_like_it"),
        (["taa_variance@speed=2"], ["full"], MethodError, "speed"),
        (["taa_variance@gamma=-3"], ["full"], MethodError, "gamma"),
        (["taa_variance@gamma=2:1:3"], ["full"], SettingsError, "range of gamma"),
        (["taa_variance@gamma"], ["full"], SettingsError, "names no method"),
        (["svgf"], ["fully"], SettingsError, "no input is named"),
        (["svgf"], ["exr:somewhere"], SettingsError, "no time to shade"),
        (["svgf"], ["noisy", "half"], SettingsError, "cannot stand beside"),
        (["taa_variance@gamma=0.5:2:60"], ["full"], SettingsError, "more than 48"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_said(methods, inputs, error, complaint):
    with pytest.raises(error, match=complaint):
        candidates(methods, inputs)


def made(label, flip, ms, kind="full"):
    errors = {str(i): e for i, e in enumerate(flip)}
    both = {"flip": errors, "relmse": errors}
    return MethodPoint(f"method:{label}", f"{label} on {kind}", kind, both, time_of(ms), ms[0], 0.0, 1)


NONE = made("no reuse", [0.40, 0.41, 0.42], [1.0, 1.1, 1.2])


def test_words_name_the_least_error_what_is_as_good_and_no_reuse():
    best = made("best", [0.10, 0.12, 0.11], [8.0, 8.8, 9.6])
    alike = made("alike", [0.101, 0.118, 0.112], [4.0, 4.4, 4.8])
    worse = made("worse", [0.12, 0.14, 0.13], [2.0, 2.2, 2.4])
    words = recommend([NONE, best, alike, worse], "flip")
    assert words.startswith("flip: least error by best on full (0.11,")
    assert "2x as fast: alike on full" in words and "worse" not in words.replace("no worse", "")
    assert words.endswith("without reuse 0.41, 1.1 ms")
    assert "as fast" not in recommend([NONE, best, worse], "flip"), "worse in every frame is worse"


def test_no_reuse_may_win():
    bad = made("bad", [0.5, 0.5, 0.5], [1.0, 1.1, 1.2])
    assert recommend([NONE, bad], "flip").endswith("no method measured is better than none")
    assert recommend([], "flip") == "flip: nothing was measured"


def test_a_front_of_methods():
    dear, cheap = made("dear", [0.1] * 3, [9.0, 9.9, 10.8]), made("cheap", [0.2] * 3, [3.0, 3.3, 3.6])
    useless = made("useless", [0.3] * 3, [5.0, 5.5, 6.0])
    assert pareto_front([NONE, dear, cheap, useless], "flip") == [NONE, cheap, dear]


def test_points_out_of_records():
    chosen = candidates(["svgf", "accumulate"], ["full"])
    errors = {"flip": {"1": 0.2, "2": 0.4}, "relmse": {"1": 1.0, "2": 3.0}}
    picture = {
        "kind": "quality", "input": "full", "errors": {"none": errors, "svgf": errors},
        "failed": {"accumulate": "does not compile"}, "bytes": {"none": 1, "svgf": 7}, "settings": {}, "reference": "r",
    }  # fmt: skip
    visits = [
        {
            "kind": "quality_time",
            "input": "full",
            "shading_ms": s,
            "method_ms": {"none": 0.5, "svgf": 2.0},
            "clock": "c",
        }
        for s in (10.0, 12.0, 11.0, 99.0)
    ]
    points = {p.label: p for p in method_points(chosen, [picture, *visits], 3)}
    svgf = points["svgf on full"]
    assert (svgf.error("flip"), svgf.error("relmse")) == (pytest.approx(0.3), 2.0)
    assert svgf.time.rounds == (12.0, 14.0, 13.0) and (svgf.shading_ms, svgf.method_ms) == (11.0, 2.0)
    failed = points["accumulate on full"]
    assert failed.failed == "does not compile" and failed.time is None and failed.error("flip") is None


@pytest.fixture(scope="module")
def study(demo, tmp_path_factory):
    """Two methods on two inputs of the demo scene, without indirect light."""
    study = cost(
        demo, out=tmp_path_factory.mktemp("methods"), width=24, height=14, frames=(20, 22), indirect="none",
        shadow_lights=1, shadow_size=64, columns=("frustum", "position"), knobs=("method:accumulate@cap=1/4",),
        method_inputs=("full", "half"), repeats=1, check=False,
    )  # fmt: skip
    study.save()
    return study


@pytest.mark.long
def test_a_study_of_methods_alone(study):
    values = json.loads((study.out / "study.json").read_text())
    assert [p["name"] for p in values["points"]] == ["base", "best"], "no dial was turned"
    quality = values["quality"]
    assert len(quality["points"]) == 6 and all(p["failed"] is None for p in quality["points"])
    named = {p["label"]: p for p in quality["points"]}
    exact, lazy = named["no reuse on full"], named["no reuse on half"]
    assert exact["errors"]["flip"] < lazy["errors"]["flip"], "unshaded rows are seen"
    for p in quality["points"]:
        assert p["ms"]["samples"] == 1 and p["shading_ms"] > 0 and p["method_ms"] > 0 and p["clock"]
    assert set(quality["fronts"]) == {"flip", "relmse"} and all(quality["fronts"].values())
    text = study_text(values)
    assert "Front of the methods' flip" in text and "another quantity" in text
    for measure in ("flip", "relmse"):
        assert (study.out / f"methods_{measure}.png").stat().st_size > 5000
    assert "flip" in study_html(values) and '"measures": ["flip", "relmse"]' in study_html(values)
