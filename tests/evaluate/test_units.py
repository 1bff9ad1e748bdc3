"""Lengths are reported in meters for every unit scale of a scene."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest

from taubench_gl.apps.inspect_command import describe
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.metrics.feature_errors import FeatureErrors
from taubench_gl.paths import ASSETS
from taubench_gl.report.paper import paper_tables
from taubench_gl.report.run_page import ReportRun, report_data
from taubench_gl.report.run_plots import plot_thresholds
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.settings import Settings

DEMO = ASSETS / "demo.glb"
SMALL = Settings(width=48, height=27, frames=(0, 5), columns=("frustum", "position", "normal"))
SCALE = 128.0  # a power of two: division keeps every bit


@pytest.fixture(scope="module")
def runs():

    same_limit = SMALL.replace(unit_scale=SCALE, thresholds={"position": 32 / 255 / SCALE})
    return evaluate_scene(DEMO, SMALL), evaluate_scene(DEMO, same_limit)


def test_camera_translations_are_in_meters(runs):
    plain, scaled = runs
    for key in ("mean", "max", "median", "p95"):
        assert plain.summary["camera"]["position"][key] > 0
        assert scaled.summary["camera"]["position"][key] == plain.summary["camera"]["position"][key] / SCALE
    variance = scaled.summary["camera"]["position"]["variance"]
    assert variance == pytest.approx(plain.summary["camera"]["position"]["variance"] / SCALE**2, rel=1e-12)
    steps = [[row["translation_m"] for row in run.frames] for run in runs]
    np.testing.assert_array_equal(np.array(steps[1]), np.array(steps[0]) / SCALE)
    assert scaled.summary["camera"]["angle"] == plain.summary["camera"]["angle"]


def test_masks_compare_scene_units_and_the_summary_reports_meters(runs):
    """A threshold in scene units discards the same pixels in any unit; it is reported in meters, as curve edges are."""
    plain, scaled = (run.summary for run in runs)
    assert plain["settings"]["thresholds"]["position"] == 32 / 255
    assert scaled["settings"]["thresholds"]["position"] == 32 / 255 / SCALE
    assert scaled["discard"] == plain["discard"]
    curves = [copy.deepcopy(summary["curves"]) for summary in (plain, scaled)]
    edges = [np.array(curve["position"].pop("edges")) for curve in curves]
    np.testing.assert_array_equal(edges[1], edges[0] / SCALE)
    assert edges[0][0] == 2.0**-20
    assert curves[1] == curves[0]


@pytest.mark.usefixtures("plots")
def test_tables_plots_and_report_page_show_meters(runs, tmp_path: Path):
    scaled = runs[1]
    shown = [" ".join(paper_tables([run.summary])[3].notes) for run in runs]
    assert "position 0.1255 m" in shown[0] and f"position {32 / 255 / SCALE:.4g} m" in shown[1]
    assert f"at {32 / 255 / SCALE:.3g} m" in _svg_text(plot_thresholds(scaled.summary, tmp_path / "a"))
    pages = [report_data([ReportRun(run.summary, run.frames)], ["a"])["runs"][0] for run in runs]
    assert pages[1]["thresholds"]["position"] == pages[0]["thresholds"]["position"] / SCALE
    edges = [np.array(page["curves"]["position"]["edges"]) for page in pages]
    np.testing.assert_array_equal(edges[1], edges[0] / SCALE)
    assert pages[1]["curves"]["normal"] == pages[0]["curves"]["normal"]


def _svg_text(files: list[Path]) -> str:
    import re

    return " ".join(re.findall(r"<!-- (.*?) -->", files[1].read_text(encoding="utf-8")))  # matplotlib's own, per text


def test_inspect_shows_meters():
    scene = load_scene(DEMO)
    plain, scaled = (describe(scene, Settings(unit_scale=unit, columns=("frustum",))) for unit in (1.0, SCALE))
    assert scaled["bounds"]["radius_m"] == plain["bounds"]["radius_m"] / SCALE
    assert scaled["bounds"]["center"] == [x / SCALE for x in plain["bounds"]["center"]]
    assert [c["near_m"] * SCALE for c in scaled["cameras"]] == [c["near_m"] for c in plain["cameras"]]


def test_inspect_predicts_the_evaluated_camera():
    """A still scene with a camera is seen from an orbit; a camera that is requested is used."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(box()))
    b.light(kind="point", intensity=5.0, translation=(0.0, 2.0, 0.0))
    b.camera(translation=(0.0, 0.0, 4.0))
    for requested in (None, "orbit", "0"):
        settings = Settings(camera=requested, width=16, height=9, columns=("frustum",), fps=2.0)
        facts, run = describe(b.build(), settings), evaluate_scene(b.build(), settings)
        assert facts["camera"] == run.summary["camera"]["source"]
        assert ("orbit" in facts["camera"]) == (requested != "0")
        assert facts["frames"] == run.summary["settings"]["last_frame"] + 1


def test_position_errors_are_in_millimeters():
    one = {"position": np.ones((2, 2, 4)), "camera_position": np.zeros(3)}
    other = {"position": np.ones((2, 2, 4)), "camera_position": np.array([0.5, 0.0, 0.0])}
    errors = FeatureErrors(same_place_m=0.1, unit_scale=100.0)
    errors.add(one, other)
    assert errors.summary()["position_mm"]["median"] == pytest.approx(5.0)
