"""Recorded cameras: playback equals the log; errors name the line of an invalid log."""

from __future__ import annotations

import json

import numpy as np
import pytest

from taubench_gl import math3d
from taubench_gl.animation import Poser, choose_camera
from taubench_gl.datasets.recorded import read_recorded
from taubench_gl.datasets.stress import stress
from taubench_gl.errors import SceneError
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_metering", "fixed_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
HEAD = "time,x,y,z,qx,qy,qz,qw"
GOOD = [[10.0 + i / 90, 0.1 * i, 1.6, 0.0, 0.0, np.sin(0.02 * i), 0.0, np.cos(0.02 * i)] for i in range(40)]


def as_csv(rows, head=HEAD):
    return "\n".join([head, *(",".join(repr(float(v)) for v in row) for row in rows)]) + "\n"


def test_csv_and_both_json_forms_are_equivalent(tmp_path):
    names = HEAD.split(",")
    texts = {
        "a.csv": as_csv(GOOD),
        "b.csv": as_csv([[9.0, *row[::-1]] for row in GOOD], "fov," + ",".join(names[::-1])),
        "c.json": json.dumps([dict(zip(names, row, strict=True)) for row in GOOD]),
        "d.json": json.dumps({"time": [r[0] for r in GOOD], "position": [r[1:4] for r in GOOD],
                              "rotation": [r[4:] for r in GOOD]}),
    }  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        path = read_recorded(tmp_path / name)
        np.testing.assert_allclose(path.times, np.arange(40) / 90, atol=1e-12)
        np.testing.assert_array_equal(path.position, np.array(GOOD)[:, 1:4])
        np.testing.assert_allclose(path.rotation, np.array(GOOD)[:, 4:], atol=1e-15)
        assert path.fps == pytest.approx(90)


def test_playback_equals_the_log_for_either_quaternion_sign(tmp_path):
    rows = np.array(GOOD)
    rows[::3, 4:] *= -1
    (tmp_path / "log.csv").write_text(as_csv(rows))
    stress(DEMO, tmp_path / "out.glb", read_recorded(tmp_path / "log.csv"))
    scene = load_scene(tmp_path / "out.glb")
    poser, camera = Poser(scene), choose_camera(scene)
    for i, row in enumerate(rows):
        view = camera.view_at(poser.sample(i / 90))
        np.testing.assert_allclose(view.position, row[1:4], atol=1e-5)
        np.testing.assert_allclose(view.world_from_view, math3d.mat3_from_quat(row[4:]), atol=1e-5)


@pytest.mark.parametrize(
    ("name", "text", "named"),
    [
        ("a.csv", "", "time"),
        ("a.csv", "time,x,y\n0,1,2\n", "a.csv:1: "),
        ("a.csv", as_csv(GOOD[:1]), "1 poses"),
        ("a.csv", f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0,oops,0,0,0,1\n", "a.csv:3: 'oops'"),
        ("a.csv", f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0\n", "a.csv:3: 3 of 8"),
        ("a.csv", f"{HEAD}\n0,0,0,0,0,0,0,1\n0,0,0,0,0,0,0,1\n", "a.csv:3: time"),
        ("a.csv", f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0,nan,0,0,0,1\n", "a.csv:3: "),
        ("a.csv", f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0,0,0,0,0,2\n", "a.csv:3: quaternion"),
        ("a.json", "{", "JSON"),
        ("a.json", "3", "a.json"),
        ("a.json", '[{"time": 0}, 4]', "a.json#/0: "),
        ("a.json", '{"time": [0], "position": [], "rotation": []}', "time, position and rotation"),
        ("a.json", '{"time": [0], "position": [[1]], "rotation": [[0, 0, 0, 1]]}', "a.json#/0: "),
    ],
)
def test_errors_name_the_place_in_the_log(tmp_path, taubench, name, text, named):
    (tmp_path / name).write_text(text)
    with pytest.raises(SceneError) as error:
        read_recorded(tmp_path / name)
    assert named in str(error.value) and "\n" not in str(error.value)
    code, _, err = taubench("stress", DEMO, "--camera", tmp_path / name, "--out", tmp_path / "out.glb")
    assert code == 2 and named in err


def test_log_that_is_not_utf8(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(SceneError, match="UTF-8"):
        read_recorded(tmp_path / "a.csv")
