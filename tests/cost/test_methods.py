"""Reuse methods in a study: configurations, points and recommendations with known answers, and one small run."""

from __future__ import annotations

import json

import pytest

from taubench_gl.cost import cost
from taubench_gl.cost.analysis import pareto_front, time_of
from taubench_gl.cost.methods import (
    MethodPoint,
    method_configurations,
    method_points,
    recommend,
    split_parameters,
)
from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.report.cost_page import cost_html
from taubench_gl.report.cost_tables import tables


def test_parameters_and_methods_are_split():
    assert split_parameters(None) == (None, [])
    assert split_parameters(["storage", "method:svgf"]) == (["storage"], ["svgf"])
    assert split_parameters(["method:svgf@alpha=0.1"]) == ([], ["svgf@alpha=0.1"])
    assert method_configurations([]) == ()


def test_ranges_and_lists_make_a_grid_after_no_reuse():
    found = method_configurations(["taa_variance@gamma=0.5:2:4@dilate=true/false", "accumulate"], ["full", "half"])
    here = [c for c in found if c.input == "full"]
    assert [c.input for c in found] == ["full"] * 10 + ["half"] * 10
    assert here[0].spec.label == "none"
    assert [c.spec.label for c in here][1:3] == [
        "taa_variance@gamma=0.5@dilate=true",
        "taa_variance@gamma=0.5@dilate=false",
    ]
    assert {c.spec.settings.get("gamma") for c in here[1:9]} == {"0.5", "1", "1.5", "2"}
    assert len({c.name for c in found}) == len(found)


@pytest.mark.parametrize(
    ("methods", "inputs", "error"),
    [
        (["nothing_like_it"], ["full"], MethodError),
        (["taa_variance@speed=2"], ["full"], MethodError),
        (["taa_variance@gamma=-3"], ["full"], MethodError),
        (["taa_variance@gamma=2:1:3"], ["full"], SettingsError),
        (["taa_variance@gamma"], ["full"], SettingsError),
        (["svgf"], ["fully"], SettingsError),
        (["svgf"], ["exr:somewhere"], SettingsError),
        (["svgf"], ["noisy", "half"], SettingsError),
        (["taa_variance@gamma=0.5:2:60"], ["full"], SettingsError),
    ],
)
def test_invalid_methods_are_refused(methods, inputs, error):
    with pytest.raises(error):
        method_configurations(methods, inputs)


def made(label, flip, ms, kind="full"):
    errors = {str(i): e for i, e in enumerate(flip)}
    both = {"flip": errors, "relmse": errors}
    return MethodPoint(f"method:{label}", f"{label} on {kind}", kind, both, time_of(ms), ms[0], 0.0, 1)


NONE = made("no reuse", [0.40, 0.41, 0.42], [1.0, 1.1, 1.2])


def test_recommendation_names_the_best_and_a_faster_equal():
    best = made("best", [0.10, 0.12, 0.11], [8.0, 8.8, 9.6])
    alike = made("alike", [0.101, 0.118, 0.112], [4.0, 4.4, 4.8])
    worse = made("worse", [0.12, 0.14, 0.13], [2.0, 2.2, 2.4])
    words = recommend([NONE, best, alike, worse], "flip")
    assert words.index("best on full") < words.index("alike on full") and "worse on full" not in words
    assert "2x" in words and "0.41, 1.1 ms" in words
    assert "worse on full" not in recommend([NONE, best, worse], "flip"), "larger in every frame"


def test_recommendation_without_a_better_method():
    bad = made("bad", [0.5, 0.5, 0.5], [1.0, 1.1, 1.2])
    words = recommend([NONE, bad], "flip")
    assert "no reuse on full" in words and "bad" not in words
    assert recommend([], "flip")


def test_front_of_methods():
    exact, cheap = made("exact", [0.1] * 3, [9.0, 9.9, 10.8]), made("cheap", [0.2] * 3, [3.0, 3.3, 3.6])
    dominated = made("dominated", [0.3] * 3, [5.0, 5.5, 6.0])
    assert pareto_front([NONE, exact, cheap, dominated], "flip") == [NONE, cheap, exact]


def test_points_from_records():
    chosen = method_configurations(["svgf", "accumulate"], ["full"])
    errors = {"flip": {"1": 0.2, "2": 0.4}, "relmse": {"1": 1.0, "2": 3.0}}
    images = {
        "kind": "images", "input": "full", "errors": {"none": errors, "svgf": errors},
        "failed": {"accumulate": "does not compile"}, "bytes": {"none": 1, "svgf": 7}, "settings": {}, "reference": "r",
    }  # fmt: skip
    times = {"kind": "image_time", "input": "full", "method_ms": {"none": 0.5, "svgf": 2.0}, "clock": "c"}
    rounds = [times | {"shading_ms": s} for s in (10.0, 12.0, 11.0, 99.0)]
    points = {p.label: p for p in method_points(chosen, [images, *rounds], 3)}
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
        shadow_lights=1, shadow_size=64, columns=("frustum", "position"), parameters=("method:accumulate@cap=1/4",),
        method_inputs=("full", "half"), repeats=1,
    )  # fmt: skip
    study.save()
    return study


@pytest.mark.long
def test_study_of_methods_alone(study):
    values = json.loads((study.out / "study.json").read_text())
    assert [p["name"] for p in values["points"]] == ["baseline"], "no parameter was varied"
    assert not values["points"][0]["masks"] and len(study.answer()) == 3 and "reuse" in study.answer()[0]
    methods = values["methods"]
    assert len(methods["points"]) == 6 and all(p["failed"] is None for p in methods["points"])
    named = {p["label"]: p for p in methods["points"]}
    exact, partial = named["no reuse on full"], named["no reuse on half"]
    assert exact["errors"]["flip"] < partial["errors"]["flip"], "unshaded rows are an error"
    for p in methods["points"]:
        assert p["ms"]["samples"] == 1 and p["shading_ms"] > 0 and p["method_ms"] > 0 and p["clock"]
    assert set(methods["fronts"]) == {"flip", "relmse"} and all(methods["fronts"].values())
    titles = [table.title for table in tables(values)]
    assert sum("methods" in title for title in titles) == 1
    for measure in ("flip", "relmse"):
        assert (study.out / f"methods_{measure}.png").stat().st_size > 5000
    assert '"measures":["flip","relmse"]' in cost_html(values)
