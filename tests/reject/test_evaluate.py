"""Evaluations of small scenes: closed forms, counts that add up, light that changes, the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from fixed import fixed_settings

from taubench_gl.apps.cli import cli
from taubench_gl.errors import SettingsError
from taubench_gl.paths import ASSETS
from taubench_gl.reject.evaluate import evaluate_tests
from taubench_gl.reject.output import fitted
from taubench_gl.reject.scores import OBJECTS, STRATA, TRUTHS, stratum_names
from taubench_gl.scene.builder import SceneBuilder, box, quad, turn_x
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

DEMO = str(ASSETS / "demo.glb")


def settings(**more) -> Settings:
    own = {"width": 64, "height": 36, "shadow_size": 64, "indirect": "none", "light": "raster"}
    return fixed_settings(**(own | more))


def board_and_wall():
    """A board in front of a wall, a camera that moves sideways: the strip behind the board must be rejected."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(0.4, 9.0)), translation=(0.0, 0.0, -2.0))
    b.node(mesh=b.mesh(quad(40.0, 40.0)), translation=(0.0, 0.0, -5.0))
    camera = b.camera(yfov=1.0, znear=0.1)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 0.0), (24.0, 0.0, 0.0)])
    return b.build()


def test_a_board_before_a_wall():
    """Board and wall are parallel to the image: every plane test tells them apart, and nothing else differs."""
    tests = ("footprint_plane", "relative_depth", "object_id", "position", "normal")
    found = evaluate_tests(board_and_wall(), tests, settings(fps=24.0, frames=(0, 5)))
    blocks = {name: entry["scores"]["visibility"] for name, entry in found.summary["tests"].items()}
    positive = found.summary["positive"]["visibility"]
    assert positive > 100
    for name in ("footprint_plane", "relative_depth", "object_id"):
        assert blocks[name]["recall"] >= 0.9 and blocks[name]["precision"] >= 0.9, name  # but for pixels on the edge
    # Normals of both are equal: this test sees nothing.
    assert blocks["normal"]["recall"] == 0.0 and blocks["normal"]["true_positive"] == 0
    # Half a pixel of the wall is less than 0.125 m, so the distance of positions is as good here.
    assert blocks["position"] == blocks["object_id"]


@pytest.fixture(scope="module")
def of_demo():
    """Several tests and a combination on two pairs of the demo."""
    tests = ("position", "footprint_plane", "object_id", "position+object_id", "svgf+object_id")
    return evaluate_tests(DEMO, tests, settings(frames=(20, 24)))


def test_counts_add_up(of_demo):
    s = of_demo.summary
    assert s["pairs"] == 2 and sum(s["pixels"].values()) == 2 * 64 * 36
    assert sum(s["percent"].values()) == pytest.approx(100.0)
    for entry in s["tests"].values():
        score = entry["scores"]["visibility"]
        kinds = [score[k] for k in ("true_positive", "false_positive", "false_negative", "true_negative")]
        assert sum(kinds) == s["pixels"]["surface"]
        assert kinds[0] + kinds[2] == s["positive"]["visibility"]
        assert set(entry["strata"]) == {*STRATA, "object", "reason"} and list(entry["strata"]["object"]) == list(
            OBJECTS
        )
        for name, rows in entry["strata"].items():
            assert list(rows) == list(stratum_names(name))
            assert sum(row["pixels"] for row in rows.values()) == s["pixels"]["surface"]
            assert sum(row["true_positive"] for row in rows.values()) == kinds[0]
    json.dumps(s, allow_nan=False)


def test_a_combination_rejects_what_any_part_rejects(of_demo):
    blocks = {name: entry["scores"]["visibility"] for name, entry in of_demo.summary["tests"].items()}
    for kind in ("true_positive", "false_positive"):
        both, one, other = (blocks[n][kind] for n in ("position+object_id", "position", "object_id"))
        assert max(one, other) <= both <= one + other


def lit(brighter: bool):
    """A room of matte walls with a lamp that doubles or stays, and a camera that moves."""
    b = SceneBuilder()
    matte = b.material(metallic=0.0, roughness=1.0)
    b.node(mesh=b.mesh(box((2.0, 1.5, 2.0), inside=True, material=matte)))
    lamp = b.light(translation=(0.0, 1.0, 0.0), intensity=40.0)
    camera = b.camera(translation=(0.0, 0.0, 1.2), yfov=1.0, znear=0.05)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 1.2), (0.6, 0.0, 1.2)])
    if brighter:
        b.animate(lamp, "translation", [0.0, 1.0], [(-1.5, 1.0, 0.0), (8.0, 1.0, 0.0)])
    return b.build()


@pytest.mark.parametrize("brighter", [False, True])
def test_changed_light_of_the_same_points(brighter):
    """Diffuse light of still surfaces does not depend on the camera: no pixel changes; a moving lamp changes many."""
    chosen = settings(fps=8.0, frames=(0, 4), shadow_lights=0)
    found = evaluate_tests(lit(brighter), ("color_clamp", "position"), chosen)
    assert tuple(found.summary["tests"]["position"]["scores"]) == TRUTHS
    changed, surface = found.summary["positive"]["changed_shading"], found.summary["pixels"]["surface"]
    assert (changed > 0.3 * surface) if brighter else (changed <= 0.002 * surface)


@pytest.mark.parametrize("recall", ["0", "1.5", "-1", "nan", "inf"])
def test_a_recall_that_is_no_share_is_one_line(recall):
    done = CliRunner().invoke(cli, ["reject", "fit", "nothing.glb", "--recall", recall])
    assert isinstance(done.exception, SettingsError)


def test_fit_reaches_the_recall(of_demo):
    fit = fitted(of_demo, 0.9)["tests"]
    assert fit["position"]["recall"] >= 0.9 and fit["footprint_plane"]["recall"] >= 0.9
    again = evaluate_tests(
        DEMO, (f"position={np.nextafter(fit['position']['threshold'], 0)}",), settings(frames=(20, 24))
    )
    score = again.summary["tests"]["position"]["scores"]["visibility"]
    assert score["recall"] == pytest.approx(fit["position"]["recall"]) and score["recall"] >= 0.9
    assert fitted(of_demo, 1.0)["tests"]["object_id"]["threshold"] is None


@pytest.mark.parametrize("more", [{"frames": (0, 2)}, {"pairs": "every:2"}, {"storage": "half"}])
def test_refused_settings(more):
    with pytest.raises(SettingsError):
        evaluate_tests(DEMO, ("position",), settings(**more))


def test_the_commands(tmp_path):
    run = CliRunner()
    listed = json.loads(run.invoke(cli, ["reject", "list", "--json"]).stdout)
    assert listed["position"]["kind"] == "geometry"
    shared = [DEMO, "--size", "48x27", "--frames", "20:23", "--tests", "position,footprint_plane"]
    done = run.invoke(cli, ["reject", "evaluate", *shared, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"reject.json", "report.html", "roc.png", "precision_recall.svg"} <= files
    summary = json.loads((tmp_path / "out" / "reject.json").read_text())
    assert summary["schema"] == "taubench-gl/reject/1" and set(summary["tests"]) == {"position", "footprint_plane"}
    fit = run.invoke(cli, ["reject", "fit", *shared, "--recall", "0.9", "--json"])
    assert json.loads(fit.stdout)["recall"] == 0.9
    assert run.invoke(cli, ["reject", "evaluate", DEMO, "--tests", "nothing"]).exit_code != 0


@pytest.mark.long
def test_both_browsers_open_the_page(tmp_path, both_browsers):
    shared = [DEMO, "--size", "48x27", "--frames", "20:23", "--tests", "position,footprint_plane"]
    assert CliRunner().invoke(cli, ["reject", "evaluate", *shared, "--out", str(tmp_path)]).exit_code == 0
    both_browsers(tmp_path / "report.html", "table tbody th")


def test_turned_floor_strata():
    """All pixels of a floor seen from above are at one distance, and none is grazing."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(50.0, 50.0)), rotation=turn_x(-90.0))
    camera = b.camera(translation=(0.0, 3.0, 0.0), rotation=turn_x(-90.0), yfov=0.5, znear=0.1)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 3.0, 0.0), (1.0, 3.0, 0.0)])
    found = evaluate_tests(b.build(), ("position",), settings(fps=24.0, frames=(0, 4)))
    strata = found.summary["tests"]["position"]["strata"]
    assert strata["distance"]["2 to 5"]["pixels"] == strata["angle"]["45 and more"]["pixels"] > 0
    assert strata["distance"]["2 to 5"]["pixels"] == found.summary["pixels"]["surface"]
