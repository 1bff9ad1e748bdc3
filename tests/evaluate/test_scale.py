"""Notes on scenes whose unit or frame rate does not fit the position threshold or the camera."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl import evaluate
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.evaluation.scale import describe_scale
from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("fixed_light")

SMALL = {"width": 32, "height": 18, "frames": (0, 5), "columns": ("frustum", "position"), "camera": 0}


def wall(distance: float, step: float = 0.0, unit: float = 1.0) -> Scene:
    """A wall that fills the view, meters; the camera moves aside by ``step`` per frame.  ``unit``: units per meter."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(50 * distance * unit, 50 * distance * unit)), translation=(0, 0, -distance * unit))
    camera = b.camera(znear=1e-3 * distance * unit)
    b.animate(camera, "translation", [0.0, 1.0], [(0, 0, 0), (24 * step * unit, 0, 0)])
    return b.build()


def options(notes: list[str]) -> list[str]:
    """The option that each note on the scale gives."""
    words = ("--unit-scale 100 ", "--unit-scale 1000 ", "--unit-scale 0.001 ", "--threshold", "--fps")
    return [next(word.strip() for word in words if word in note) for note in notes if "median depth" in note]


@pytest.mark.parametrize(
    ("distance", "unit", "given", "expected"),
    [
        (5.0, 1.0, 1.0, []),
        (1.0, 1.0, 1.0, []),
        (50.0, 1.0, 1.0, []),
        (1.3, 100.0, 1.0, ["--unit-scale 100"]),
        (1.3, 100.0, 100.0, []),
        (10.0, 1000.0, 1.0, ["--unit-scale 1000"]),
        (10.0, 1000.0, 1000.0, []),
        (10.0, 0.001, 1.0, ["--unit-scale 0.001"]),
        (10.0, 0.001, 0.001, []),
        (5.0, 1.0, 100.0, ["--threshold"]),  # no usual unit gives 5 units a usual length but the meter
        (0.2, 1.0, 1.0, ["--threshold"]),
    ],
)
def test_the_unit_of_a_wall(distance, unit, given, expected):
    summary = evaluate_scene(wall(distance, unit=unit), fixed_settings(**SMALL, unit_scale=given)).summary
    assert summary["scale"]["frames"] == 3
    assert summary["scale"]["median_depth_m"] == pytest.approx(distance * unit / given, rel=1e-5)
    assert options(summary["notes"]) == expected


def test_a_given_threshold_and_columns_without_position_are_not_checked():
    far = wall(1.3, unit=100.0)
    for change in ({"thresholds": {"position": 0.1}}, {"columns": ("frustum", "normal")}):
        assert options(evaluate_scene(far, fixed_settings(**SMALL | change)).summary["notes"]) == []


@pytest.mark.parametrize("unit", [1.0, 100.0])
@pytest.mark.parametrize(("step", "expected"), [(0.9, []), (1.1, ["--fps"])])
def test_a_camera_that_moves_by_half_the_depth(step, expected, unit):
    run = evaluate_scene(wall(2.0, step, unit), fixed_settings(**SMALL, unit_scale=unit))
    assert options(run.summary["notes"]) == expected


def test_frames_of_a_folder_have_no_rate_to_choose():
    summary = {"camera": {"position": {"median": 3.0}}, "notes": [], "path_traced": {}}
    describe_scale(summary, [4.0], Settings())
    assert len(summary["notes"]) == 1 and options([n + " --fps" for n in summary["notes"]]) == ["--fps"]
    assert "--fps" not in summary["notes"][0]


def test_a_view_of_the_sky_has_no_scale():
    sky = wall(5.0)
    away = dataclasses.replace(
        sky.nodes, translation=np.where(sky.nodes.translation == -5.0, 5.0, sky.nodes.translation)
    )
    summary = evaluate_scene(dataclasses.replace(sky, nodes=away), fixed_settings(**SMALL)).summary
    assert summary["scale"] == {"frames": 0, "median_depth_m": None}
    assert options(summary["notes"]) == []


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("khronos/Fox/Fox.gltf", ["--unit-scale 100"]),
        ("khronos/CesiumMan/CesiumMan.glb", []),
        ("sponza/Sponza.gltf", []),
        ("godot/room/room.glb", []),
        ("tauray_test/test.glb", []),
    ],
)
def test_real_files(data, path, expected):
    settings = {"size": "64x36", "frames": "0:4", "columns": "frustum,position"}
    assert options(evaluate(data / path, **settings).summary["notes"]) == expected
