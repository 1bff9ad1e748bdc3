"""Camera sidecars, and cameras fitted to a position pass."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from taubench_gl import math3d
from taubench_gl.animation import View
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.cameras import CAMERA_SCHEMA, camera_file_text, read_camera_file
from taubench_gl.pathtraced.exr import read_exr
from taubench_gl.pathtraced.fit import fit_camera, screen_of
from taubench_gl.pathtraced.passes import ChannelIndex, load_mapping, read_frame
from taubench_gl.scene.model import Camera

IDENTITY = np.eye(4).tolist()


def turn(axis, degrees):
    return math3d.mat3_from_quat(math3d.quat_from_axis_angle(np.asarray(axis, float), math.radians(degrees)))


def wall(rotation, origin, yfov, width=96, height=54, bumps=1.0):
    """Positions (h, w, 3) and planar depths (h, w) of an uneven wall in front of a camera."""
    rows, columns = np.mgrid[:height, :width]
    screen = screen_of(columns.ravel(), rows.ravel(), width, height)
    depth = 6.0 + bumps * np.sin(3.1 * screen[:, 0]) + bumps * np.cos(2.3 * screen[:, 1] + screen[:, 0])
    rays = np.column_stack([screen * math.tan(0.5 * yfov), -np.ones(len(screen))])
    points = origin + (rays * depth[:, None]) @ rotation.T
    return points.reshape(height, width, 3), depth.reshape(height, width)


def write(tmp_path, values):
    path = tmp_path / "camera.json"
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return path


def test_sidecars_are_read_back_as_written(tmp_path):
    views = {
        3: View(np.array([1.5, -2.0, 1e6]), turn((1, 2, 3), 40), Camera(yfov=0.7, znear=0.01)),
        4: View(np.zeros(3), np.eye(3), Camera(kind="orthographic", ymag=2.5, znear=0.0, zfar=50.0)),
    }
    file = read_camera_file(write(tmp_path, camera_file_text(views, 24.0, (320, 180))))
    assert (file.fps, file.size) == (24.0, (320, 180))
    for frame, view in views.items():
        got = file.views[frame]
        np.testing.assert_array_equal(got.position, view.position)
        np.testing.assert_allclose(got.world_from_view, view.world_from_view, atol=1e-15)
        for name in ("kind", "znear", "zfar"):
            assert getattr(got.camera, name) == getattr(view.camera, name)
    assert file.views[3].camera.yfov == 0.7 and file.views[4].camera.ymag == 2.5


def test_quaternions_shared_lens_and_overrides(tmp_path):
    frames = {"7": {"position": [1, 2, 3], "rotation": [0, math.sqrt(0.5), 0, math.sqrt(0.5)]},
              "8": {"world_from_view": IDENTITY, "yfov": 0.5}}  # fmt: skip
    file = read_camera_file(write(tmp_path, {"schema": CAMERA_SCHEMA, "camera": {"yfov": 1.0}, "frames": frames}))
    np.testing.assert_allclose(file.views[7].world_from_view, turn((0, 1, 0), 90), atol=1e-12)
    assert (file.views[7].camera.yfov, file.views[8].camera.yfov, file.fps, file.size) == (1.0, 0.5, None, None)


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        *((text, "") for text in ("", "{", "[]", "3")),
        ({"schema": "x"}, ""),
        ({"frames": {}}, ""),
        ({"frames": {"a": {}}}, ""),
        ({"frames": {"1": 3}}, ""),
        ({"frames": {"1": {"yfov": 1}}}, "#/frames/1"),
        ({"frames": {"1": {"world_from_view": [[1]], "yfov": 1}}}, "#/frames/1"),
        ({"frames": {"1": {"world_from_view": (2 * np.eye(4)).tolist(), "yfov": 1}}}, "#/frames/1"),
        ({"frames": {"1": {"world_from_view": np.diag([-1.0, 1, 1, 1]).tolist(), "yfov": 1}}}, "#/frames/1"),
        ({"frames": {"1": {"world_from_view": IDENTITY}}}, "#/frames/1"),
        ({"frames": {"1": {"world_from_view": IDENTITY, "yfov": 4}}}, "#/frames/1"),
        ({"frames": {"1": {"world_from_view": IDENTITY, "yfov": "1"}}}, "#/frames/1"),
        ({"frames": {"1": {"world_from_view": IDENTITY, "kind": "fish"}}}, "#/frames/1"),
        ({"frames": {"1": {"world_from_view": IDENTITY, "yfov": 1, "znear": 2, "zfar": 1}}}, "#/frames/1"),
    ],
)
def test_faulty_sidecars_name_the_entry(tmp_path, change, pointer):
    good = {"schema": CAMERA_SCHEMA, "frames": {"1": {"world_from_view": IDENTITY, "yfov": 1}}}
    read_camera_file(write(tmp_path, good))
    with pytest.raises(PathTracedError) as error:
        read_camera_file(write(tmp_path, change if isinstance(change, str) else good | change))
    assert error.value.where == f"{tmp_path / 'camera.json'}{pointer}"


@pytest.mark.parametrize("with_depth", [True, False])
@pytest.mark.parametrize(
    ("rotation", "origin", "yfov"),
    [
        (np.eye(3), (0, 0, 0), 0.8),
        (turn((1, 1, 0), 130), (3, -2, 8), 1.9),
        (turn((0, 1, 0), 180), (1e4, 50, -2e4), 0.3),
        (turn((1, 0, 0), -89.9), (0, 900, 0), 1.2),
    ],
)
def test_the_fit_finds_the_camera(rotation, origin, yfov, with_depth):
    position, depth = wall(rotation, np.asarray(origin, float), yfov)
    fit = fit_camera(position, np.zeros(depth.shape, bool), depth if with_depth else None)
    np.testing.assert_allclose(fit.view.world_from_view, rotation, atol=1e-8)
    np.testing.assert_allclose(fit.view.position, origin, atol=1e-7)
    assert fit.view.camera.yfov == pytest.approx(yfov, abs=1e-8) and fit.median_px < 1e-6


def test_one_plane_is_enough_with_depth():
    rotation, origin = turn((1, 0, 0), -25), np.array([1.0, 2.0, 3.0])
    rows, columns = np.mgrid[:54, :96]
    rays = np.column_stack([screen_of(columns.ravel(), rows.ravel(), 96, 54) * 0.4, -np.ones(54 * 96)])
    world = rays @ rotation.T
    depth = np.where(world[:, 1] < -0.02, -origin[1] / np.minimum(world[:, 1], -0.02), 0.0)
    position = (origin + world * depth[:, None]).reshape(54, 96, 3)
    depth = depth.reshape(54, 96)
    fit = fit_camera(position, depth == 0, depth)
    np.testing.assert_allclose(fit.view.position, origin, atol=1e-6)
    np.testing.assert_allclose(fit.view.world_from_view, rotation, atol=1e-8)


def test_the_fit_tolerates_noise_sky_and_outliers():
    rng = np.random.default_rng(1)
    rotation = turn((0, 1, 0), 30)
    position, depth = wall(rotation, np.array([1.0, 2.0, 3.0]), 0.9)
    position = (position + rng.normal(scale=1e-4, size=position.shape)).astype(np.float32)
    sky = np.zeros(depth.shape, bool)
    sky[:20] = True
    wrong = rng.random(depth.shape) < 0.03
    position[wrong] += rng.normal(size=(int(wrong.sum()), 3))
    fit = fit_camera(position, sky)
    np.testing.assert_allclose(fit.view.position, [1, 2, 3], atol=5e-3)
    np.testing.assert_allclose(fit.view.world_from_view, rotation, atol=1e-3)


def test_positions_of_no_pinhole_are_refused():
    position, depth = wall(np.eye(3), np.zeros(3), 0.8)
    sky = np.zeros(depth.shape, bool)
    bent = position.copy()
    bent[..., 0] += 0.4 * np.sin(5 * bent[..., 1])
    flat, straight = wall(np.eye(3), np.zeros(3), 0.8, bumps=0.0)
    random = np.random.default_rng(13).normal(size=position.shape)  # without a camera the fit's field of view overflows
    for arguments in ((position, ~sky), (flat, sky), (flat, sky, straight), (bent, sky), (random, sky)):
        with pytest.raises(PathTracedError) as error:
            fit_camera(*arguments, where="frame 3")
        assert error.value.where == "frame 3" and "--camera-file" in error.value.hint


def test_the_fit_on_cycles_files(data):
    """The fit against the matrices that Blender wrote with the render."""
    info = json.loads((data / "cycles" / "sponza_man" / "sponza_man_info.json").read_text())["frames"]
    for number in ("12", "13"):
        image = read_exr(data / "cycles" / "sponza_man" / f"sponza_man_f00{number}.exr")
        frame = read_frame(image, ChannelIndex(image.names, load_mapping(None)))
        matrix = np.array(info[number]["camera_to_world_gltf"])
        for depth in (frame.depth, None):
            fit = fit_camera(frame.position, frame.sky, depth)
            assert np.linalg.norm(fit.view.position - matrix[:3, 3]) < 2e-5
            assert np.abs(fit.view.world_from_view - matrix[:3, :3]).max() < 1e-5
            assert abs(fit.view.camera.yfov - info[number]["yfov"]) < 1e-5 and fit.median_px < 1e-3
