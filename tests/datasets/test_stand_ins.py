"""The stand-ins have the paper's Table 1 to 3 rows, are labeled as stand-ins, and are valid glTF."""

from __future__ import annotations

import pytest
from click.testing import CliRunner
from fixed import fixed_settings
from make_stand_ins import RECIPES as RECIPES_BY_NAME
from repeated import few
from validator import errors

from taubench_gl.apps.cli import cli
from taubench_gl.apps.scenes_command import STAND_IN_NAMES, describe
from taubench_gl.datasets.stand_ins import STAND_INS
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import evaluate_scene, resolve_lighting
from taubench_gl.report.paper import paper_numbers
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("fixed_light")

PAPER = {scene["name"].replace(" ", ""): scene for scene in paper_numbers()["scenes"]}
RECIPES = list(RECIPES_BY_NAME.values())
each = pytest.mark.parametrize("recipe", few(RECIPES), ids=list(RECIPES_BY_NAME))


KNOWN_DEPARTURES = {("eternal-valley-vr", "position"): 6.0, ("eternal-valley-vr", "color"): 2.5}
"""Accepted factors to the paper's Table 4 that exceed 2.  The VR camera rotates in place, so position depends on the
size of a pixel on the ground (12 % at 960x540, less at 1920x1080), and few colors change (4.3 % at 960x540)."""


def assert_rows(camera, recipe):
    """Tables 2 and 3: means within 2 %, variances and the max within 5 %, zeros as zeros."""
    paper = PAPER[recipe.stands_for]
    for key, tolerance in (("mean", 0.02), ("variance", 0.05), ("max", 0.05)):
        assert camera["position"][key] == pytest.approx(paper["position"][key], rel=tolerance), key
        if key == "max":
            continue
        for axis in ("pitch", "yaw", "roll"):
            expected = paper["rotation"][f"{axis}_{key}"]
            assert camera[axis][key] == pytest.approx(expected, rel=tolerance, abs=1e-12), (axis, key)


@each
@pytest.mark.long
def test_file_has_the_papers_rows(recipe):
    found = describe(load_scene(STAND_INS[recipe.name]), 60.0)
    paper = PAPER[recipe.stands_for]["census"]
    for key in ("dynamic_rigid_objects", "armatures", "static_point_lights", "dynamic_point_lights"):
        assert found["census"][key] == paper[key], key
    assert found["census"]["bones"] == 52 * paper["armatures"]
    lights = found["census"]["lights_per_frame"]
    assert all(sum(lights[key]) > 300 for key in ("born", "moved", "killed"))
    assert found["pairs"] == 360
    assert_rows(found["camera"], recipe)


@each
def test_scene_is_labeled_as_stand_in(recipe):
    scene = load_scene(STAND_INS[recipe.name])
    assert "stand-in" in scene.name and recipe.stands_for in scene.stand_in and "not the dataset" in scene.stand_in
    assert STAND_INS[recipe.name].stat().st_size < 30e6


@each
def test_exposure_is_recorded_and_taken(recipe):
    """By ``auto`` only, and only for intensities as written."""
    scene = load_scene(STAND_INS[recipe.name])
    assert scene.exposure == recipe.exposure
    auto = fixed_settings(exposure="auto", light_unit="auto", environment="auto")
    found = resolve_lighting(scene, auto)
    assert found.settings.lighting.exposure == recipe.exposure and "recorded" in found.reasons["exposure"]
    assert resolve_lighting(scene, auto.replace(exposure=2.0)).settings.lighting.exposure == 2.0
    assert resolve_lighting(scene, auto.replace(light_unit="watt")).settings.lighting.exposure == 1.0


@each
def test_khronos_validator(recipe):
    assert errors(STAND_INS[recipe.name]) == []


def test_summary_is_labeled_as_stand_in(gpu):
    columns = ("frustum", "position", "normal", "direct")
    settings = fixed_settings(
        width=160, height=90, fps=60.0, frames=(178, 184), columns=columns, indirect="none", shadow_lights=1
    )
    run = evaluate_scene(STAND_INS["eternal-valley-vr"], settings)
    assert "EternalValleyVR" in run.summary["scene"]["stand_in"]
    assert run.summary["camera"]["cuts"] == [181]
    for name in columns:
        assert 0.5 < run.summary["discard"][name]["mean_percent"] < 90, name
    assert all(row["invalid"] == 0 for row in run.frames)


@pytest.mark.long
@each
@pytest.mark.parametrize(
    ("fps", "columns", "light"),
    [(60.0, ("position", "normal"), {}), (24.0, ("color", "direct"), {"indirect": "none", "shadow_lights": 1})],
    ids=["geometry", "light"],
)
def test_table_4_is_within_a_factor_of_the_papers(recipe, fps, columns, light, gpu):
    """A few pairs at half the paper's size, within a factor of 2 except for KNOWN_DEPARTURES.

    Position depends on the image size: on the distance between the points of adjacent pixels.  Light is that of the
    recorded exposure, at the rate of the paper's images.
    """
    last = int(6 * fps) - 10
    windows = [(f, f + 2) for f in range(int(fps / 6), last, last // 10)]
    found = dict.fromkeys(columns, 0.0)
    for frames in windows:
        own = {"fps": fps, "frames": frames, "columns": columns, "exposure": recipe.exposure, **light}
        settings = fixed_settings(width=960, height=540, **own)
        run = evaluate_scene(STAND_INS[recipe.name], settings)
        for name in columns:
            found[name] += run.summary["discard"][name]["mean_percent"] / len(windows)
    paper = PAPER[recipe.stands_for]["discard"]
    for name in columns:
        factor = KNOWN_DEPARTURES.get((recipe.name, name), 2.0)
        assert paper[name] / factor < found[name] < paper[name] * factor, (name, found)


@pytest.mark.long
def test_command_prints_tables_with_the_papers_rows(tmp_path):
    out = tmp_path / "valley.glb"
    done = CliRunner().invoke(cli, ["scenes", "make", "eternal-valley-vr", str(out)])
    assert done.exit_code == 0, done.output
    assert out.is_file() and "stand-in for EternalValleyVR" in done.output
    for text in ("491", "626", "8.222", "Eternal Valley VR"):
        assert text in done.output


def test_names_are_known_and_other_suffixes_are_refused(tmp_path):
    assert tuple(STAND_INS) == tuple(RECIPES_BY_NAME) == STAND_IN_NAMES
    done = CliRunner().invoke(cli, ["scenes", "make", "eternal-valley-fps", str(tmp_path / "x.obj")])
    assert isinstance(done.exception, SettingsError) and not list(tmp_path.iterdir())
