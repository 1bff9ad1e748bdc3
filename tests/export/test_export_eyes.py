"""Export of both eyes: disparity against closed forms, cameras, masks, and files that are read again."""

from __future__ import annotations

import json

import numpy as np
import pytest
from fixed import fixed_settings

from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.export.run import export_scene
from taubench_gl.option_groups import ExportOptions
from taubench_gl.paths import ASSETS
from taubench_gl.pathtraced.cameras import read_camera_file
from taubench_gl.scene.builder import SceneBuilder, quad
from taubench_gl.settings import Settings

WIDTH, HEIGHT, YFOV, BASE, CONVERGENCE = 64, 36, 1.0, 0.1, 1.7
GIVEN = {"width": WIDTH, "height": HEIGHT, "history": "eye", "eyes": BASE, "camera": 0, "columns": ("position",)}
CHANNELS = ("position", "depth", "motion", "disparity", "mask")


def boards():
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(0.4, 0.5)), translation=(0.05, 0.0, -1.2))
    b.node(mesh=b.mesh(quad(90.0, 90.0)), translation=(0.0, 0.0, -3.0))
    b.camera(yfov=YFOV, znear=0.05)
    b.camera(translation=(BASE, 0.0, 0.0), yfov=YFOV, znear=0.05)
    return b.build()


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """exported(settings) -> folder, and arrays of both eyes; each export is made once."""
    made = {}

    def arrays(**more):
        key = tuple(sorted(more.items()))
        if key not in made:
            folder = tmp_path_factory.mktemp("eyes")
            export_scene(
                boards(), folder, fixed_settings(**GIVEN | more), ExportOptions(format="npz", channels=CHANNELS)
            )
            made[key] = folder, {eye: dict(np.load(folder / eye / "frame_00000.npz")) for eye in ("left", "right")}
        return made[key]

    return arrays


@pytest.mark.parametrize(
    "more",
    [
        pytest.param({}, marks=pytest.mark.long),
        {"convergence": CONVERGENCE},
        {"other_eye": 1},
        pytest.param({"eye": "right"}, marks=pytest.mark.long),
    ],
)
def test_disparity_is_f_b_over_z(exported, more):
    focal = 0.5 * HEIGHT / np.tan(0.5 * YFOV)
    for arrays in exported(**more)[1].values():
        seen = (arrays["mask"][..., 0] & int(FRUSTUM)) == 0
        expected = (
            focal * BASE * (1.0 / arrays["depth"][seen] - (1.0 / more["convergence"] if "convergence" in more else 0.0))
        )
        np.testing.assert_allclose(arrays["disparity"][seen], expected, atol=2e-4)
        assert (np.abs(arrays["motion"][seen][..., 1]) < 1e-4).all() and seen.mean() > 0.8


def test_the_eyes_see_the_same_points_but_for_hidden_ones(exported):
    """A point of the left eye is at x - disparity of the right one, which has it with the same disparity."""
    _, eyes = exported(convergence=CONVERGENCE)
    left, right = eyes["left"], eyes["right"]
    rows, columns = np.nonzero((left["mask"][..., 0]) == 0)
    there = np.floor(columns - left["disparity"][rows, columns, 0] + 0.5).astype(int)
    np.testing.assert_allclose(left["depth"][rows, columns], right["depth"][rows, there], atol=1e-5)
    np.testing.assert_allclose(left["disparity"][rows, columns], right["disparity"][rows, there], atol=1e-3)
    hidden = ((left["mask"] & np.uint32(Reason.DISOCCLUDED)) != 0, (right["mask"] & np.uint32(Reason.DISOCCLUDED)) != 0)
    assert abs(int(hidden[0].sum()) - int(hidden[1].sum())) <= HEIGHT  # one column
    strip = 0.5 * HEIGHT / np.tan(0.5 * YFOV) * BASE * (1 / 1.2 - 1 / 3.0)
    assert abs(hidden[0].sum(axis=1).max() - strip) <= 1.0


def test_cameras_of_both_eyes_are_in_the_files(exported):
    folder, eyes = exported(convergence=CONVERGENCE)
    for eye, arrays in eyes.items():
        view = read_camera_file(folder / eye / "camera.json").views[0]
        assert view.position[0] == pytest.approx(0.0 if eye == "left" else BASE)
        assert view.shift == pytest.approx(0.0 if eye == "left" else -BASE / CONVERGENCE)
        point = arrays["position"][20, 31].astype(np.float64) * [1.0, -1.0, -1.0]  # relative to the camera, +y down
        pixel = arrays["intrinsics"] @ (point / point[2])
        np.testing.assert_allclose(pixel, [31.0, 20.0, 1.0], atol=1e-4)
        assert json.loads((folder / eye / "export.json").read_text())["settings"]["eye"] == eye


def test_masks_are_those_that_evaluate_counts(tmp_path):
    given = Settings(width=WIDTH, height=HEIGHT, frames=(0, 2), history="eye", columns=("position",))
    export_scene(ASSETS / "demo.glb", tmp_path, given, ExportOptions(format="npz", channels=("mask",)))
    [row] = evaluate_scene(ASSETS / "demo.glb", given).frames
    with np.load(tmp_path / "left" / "frame_00001.npz") as arrays:
        assert np.count_nonzero(arrays["mask"] & np.uint32(Reason.POSITION)) == row["position"] > 0


def test_no_disparity_without_another_eye_and_no_export_of_two_histories(tmp_path):
    for settings, options in (({}, ("disparity",)), ({"history": "both"}, ())):
        with pytest.raises(SettingsError):
            export_scene(
                boards(),
                tmp_path / "out",
                fixed_settings(width=8, height=8, **settings),
                ExportOptions(channels=options),
            )
