"""Recorded cameras: one known path in every format, times and gaps, placement, notes, and errors that name the line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_scenes import make_scene
from scipy.spatial.transform import Rotation

from taubench_gl import math3d
from taubench_gl.animation import RecordedCamera, camera_of_run, sample
from taubench_gl.animation.recorded import COLUMNS
from taubench_gl.animation.recorded_camera import read_camera_path
from taubench_gl.errors import SceneError, SettingsError, TaubenchError
from taubench_gl.scene.model import Camera
from taubench_gl.settings import SequenceSettings

FILES = Path(__file__).parent / "camera_paths"
SHARE = np.linspace(0.0, 1.0, 4)
TURNED = Rotation.from_euler("YXZ", np.outer(SHARE, [-30, 20, 10]), degrees=True)
WALKED = np.outer(SHARE, [1.0, 0.5, -2.0])
"""Turn right 30, up 20, roll 10 degrees, walk (1, 0.5, -2) m, in the axes of glTF."""

FLIP = np.diag([1.0, -1.0, -1.0])
"""OpenGL axes of a camera from optical ones; and a world with +Y up from that of KITTI."""

Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""World with +Y up from one with +Z up."""

HEAD = ",".join(COLUMNS)


def options(path, **given):
    return SequenceSettings(camera_path=str(path), **{f"camera_path_{name}": value for name, value in given.items()})


def read(folder, text, name="path", **given):
    (folder / name).write_text(text)
    return read_camera_path(options(folder / name, **given))


def lines(rows):
    return "".join(" ".join(x if isinstance(x, str) else repr(float(x)) for x in row) + "\n" for row in rows)


def poses(world, view=FLIP):
    """Positions and rotations of the known path in a file's world and with its axes of the camera."""
    return WALKED @ world, world.T @ TURNED.as_matrix() @ view


def matrices(world, view=FLIP):
    out = np.tile(np.eye(4), (4, 1, 1))
    out[:, :3, 3], out[:, :3, :3] = poses(world, view)
    return out


def require_known(path, meters=1e-6, degrees=1e-5):
    np.testing.assert_allclose(path.position, WALKED, atol=meters)
    off = Rotation.from_quat(path.rotation).inv() * TURNED
    np.testing.assert_allclose(np.degrees(off.magnitude()), 0.0, atol=degrees)


# Files of the programs that own the formats


@pytest.mark.parametrize(
    ("name", "given", "duration"),
    [
        ("tum.txt", {"up": "-y"}, 1.0),
        ("kitti.txt", {"fps": 30.0}, 0.1),
        ("images.txt", {"up": "-y", "fps": 30.0}, 0.1),
        ("open3d.json", {"up": "-y", "fps": 30.0}, 0.1),
        ("open3d.log", {"up": "-y", "fps": 30.0}, 0.1),
        ("nerfstudio.json", {}, 6.0),
    ],
)
def test_files_of_the_programs_that_own_the_formats(name, given, duration):
    path = read_camera_path(options(FILES / name, **given))
    require_known(path)
    assert path.times[-1] == pytest.approx(duration, abs=1e-6) and not path.notes
    if name == "open3d.json":
        np.testing.assert_allclose(path.yfov, 2 * np.arctan2(240, 500))


def test_files_with_few_digits():
    """iwer writes three decimals; Open3D's TUM has six, loses its times, and its first pose is in the comment."""
    require_known(read_camera_path(options(FILES / "webxr.json")), 1e-3, 0.1)
    require_known(read_camera_path(options(FILES / "open3d-tum.txt", up="-y")), 1e-6, 2e-4)
    assert read_camera_path(options(FILES / "webxr.json")).times[-1] == pytest.approx(1.0023)


# The same path, written here


def test_euroc_camera_is_body_times_t_bs(tmp_path):
    body_from_camera = np.eye(4)
    body_from_camera[:3, :3] = Rotation.from_euler("xyz", [10, -80, 95], degrees=True).as_matrix()
    body_from_camera[:3, 3] = 0.1, -0.2, 0.05
    body = matrices(Z_UP) @ np.linalg.inv(body_from_camera)
    quaternions = Rotation.from_matrix(body[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
    names = ["p_RS_R_x [m]", "p_RS_R_y [m]", "p_RS_R_z [m]", *(f"q_RS_{c} []" for c in "wxyz"), "v_RS_R_x [m s^-1]"]
    text = ", ".join(["#timestamp", *names]) + "\n"
    start = 1403636579758555392
    for k in range(4):
        cells = [*body[k, :3, 3].tolist(), *quaternions[k].tolist(), 0.5]
        text += ",".join([str(start + 5_000_001 * k), *map(repr, cells)]) + "\n"
    numbers = ",".join(map(repr, body_from_camera.ravel().tolist()))
    (tmp_path / "sensor.yaml").write_text(
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{numbers.replace(',', chr(10), 1).replace(chr(10), ',' + chr(10))}]\n"
    )
    for given in (numbers, str(tmp_path / "sensor.yaml")):
        path = read(tmp_path, text, body=given)
        require_known(path)
        # Of nanoseconds since 1970 a float64 keeps no more than every 256th.
        np.testing.assert_allclose(path.times, 5_000_001e-9 * np.arange(4), rtol=1e-14)
    with pytest.raises(SettingsError, match="camera-path-body"):
        read(tmp_path, text)
    assert not np.allclose(read(tmp_path, text, axes="optical").position, WALKED, atol=0.05)  # of the body


def test_colmap_images_in_any_order_and_without_empty_lines(tmp_path):
    inverse = np.linalg.inv(matrices(Z_UP))
    q = Rotation.from_matrix(inverse[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
    names = ["im 2.png", "im 9.png", "im 10.png", "im 100.png"]
    rows = {k: (7 - k, *q[k], *inverse[k, :3, 3], 1, names[k]) for k in (3, 0, 2, 1)}
    image = {k: lines([row]) for k, row in rows.items()}
    for points in ("\n", "", "1.5 2.5 -1 3.0 4.0 17 5.0 6.0 1 7.0 8.0 -1\n"):
        path = read(tmp_path, "# Image list\n" + "".join(text + points for text in image.values()), up="+z", fps=5.0)
        require_known(path)
        assert path.times[-1] == pytest.approx(0.6) and "scale" in path.taken


def test_json_of_nerfstudio(tmp_path):
    by_rows = matrices(Z_UP, np.eye(3))
    frames = [
        {"file_path": f"./im_{n}.png", "transform_matrix": by_rows[k].tolist()} for k, n in enumerate((1, 2, 10, 11))
    ]
    data = {"fl_y": 500.0, "h": 480, "w": 640, "frames": [frames[k] for k in (2, 0, 3, 1)]}
    path = read(tmp_path, json.dumps(data), fps=10.0)
    require_known(path)
    np.testing.assert_allclose(path.yfov, 2 * np.arctan(240 / 500))
    cameras = [{"camera_to_world": m.ravel().tolist(), "fov": 50 + k, "aspect": 1.5} for k, m in enumerate(by_rows)]
    path = read(tmp_path, json.dumps({"camera_path": cameras, "fps": 24, "seconds": 0.125, "render_height": 9}))
    require_known(path)
    assert path.times[-1] == pytest.approx(3 / 24)
    np.testing.assert_allclose(np.degrees(path.yfov), [50, 51, 52, 53])


@pytest.mark.filterwarnings("ignore:Gimbal lock")
@pytest.mark.parametrize("order", ["XYZ", "ZXY", "YXZ", "ZYX"])
@pytest.mark.parametrize(("up", "world"), [("+y", np.eye(3)), ("+z", Z_UP)])
def test_chan_needs_order_and_up(tmp_path, order, up, world):
    position, rotation = poses(world, np.eye(3))
    angles = Rotation.from_matrix(rotation).as_euler(order.lower(), degrees=True)  # small letters: about fixed axes
    columns = angles[:, [order.index(axis) for axis in "XYZ"]]
    rows = [(k + 1, *position[k].tolist(), *columns[k].tolist(), 40.0) for k in range(4)]
    path = read(tmp_path, lines(rows), up=up, fps=25.0, order=order)
    require_known(path)
    assert path.times[-1] == pytest.approx(3 / 25) and path.yfov[0] == pytest.approx(np.radians(40))
    require_known(read(tmp_path, lines(row[:7] for row in rows), up=up, fps=25.0, order=order))
    for missing in ("up", "fps", "order"):
        given = {"up": up, "fps": 25.0, "order": order}
        del given[missing]
        with pytest.raises(SettingsError, match=f"--camera-path-{missing}"):
            read(tmp_path, lines(rows), **given)


def test_csv_of_any_columns(tmp_path):
    rows = [(100 * k, *WALKED[k].tolist(), *q) for k, q in enumerate(TURNED.as_quat()[:, [3, 0, 1, 2]].tolist())]
    head = "Timestamp [ms];Position.X;Position.Y;Position.Z;Rotation.W;Rotation.X;Rotation.Y;Rotation.Z;battery"
    text = head + "\n" + "".join(";".join(map(str, row)) + ";full\n" for row in rows)
    path = read(tmp_path, text, axes="opengl", up="+y")
    require_known(path)
    assert path.times[-1] == pytest.approx(0.3)
    for missing in ("axes", "up"):
        given = {"axes": "opengl", "up": "+y"}
        del given[missing]
        with pytest.raises(SettingsError, match=f"--camera-path-{missing}"):
            read(tmp_path, text, **given)
    bare = text.replace(" [ms]", "")
    with pytest.raises(SettingsError, match="--camera-path-fps"):
        read(tmp_path, bare, axes="opengl", up="+y")
    assert read(tmp_path, bare, axes="opengl", up="+y", fps=1e7).times[-1] == pytest.approx(3e-5)  # ticks of .NET


def test_csv_of_a_quaternion_alone_in_columns_w_x_y_z(tmp_path):
    """As a public set of head motion has it: separated by spaces, without positions, numbered frames."""
    rows = [(k + 1, 0, *q) for k, q in enumerate(TURNED.as_quat()[:, [3, 0, 1, 2]].tolist())]
    path = read(tmp_path, "frame viewpoint w x y z\n" + lines(rows), axes="opengl", up="+y", fps=60.0)
    off = Rotation.from_quat(path.rotation).inv() * TURNED
    np.testing.assert_allclose(off.magnitude(), 0.0, atol=1e-12)
    assert not np.any(path.position) and path.times[-1] == pytest.approx(3 / 60) and "no positions" in path.taken


@pytest.mark.parametrize(
    ("axes", "up", "world"),
    [
        ("unity", "+y", np.diag([1.0, 1, -1])),
        ("unreal", "+z", np.array([[0.0, 1, 0], [0, 0, 1], [-1, 0, 0]])),
        ("body", "+z", Z_UP),
    ],
)
def test_axes_of_engines_and_bodies(tmp_path, axes, up, world):
    """``world``: +Y up from the file's; of Unity and Unreal mirrored, whose quaternions are left-handed too."""
    view = {
        "unity": np.diag([1.0, 1, -1]),
        "unreal": [[0, 0, -1], [1, 0, 0], [0, 1, 0]],
        "body": [[0, 0, -1], [-1, 0, 0], [0, 1, 0]],
    }[axes]
    position, rotation = poses(world, np.array(view, dtype=float).T)
    q = Rotation.from_matrix(rotation).as_quat()  # raises for a mirror
    text = (
        HEAD.replace("time", "t_s")
        + "\n"
        + "".join(
            ",".join(map(repr, (float(k), *p, *r))) + "\n"
            for k, (p, r) in enumerate(zip(position.tolist(), q.tolist()))
        )
    )
    path = read(tmp_path, text, axes=axes, up=up)
    # Which horizontal axis of the file becomes -Z is a matter of definition: the first pose looks along it.
    turn = TURNED[0] * Rotation.from_quat(path.rotation[0]).inv()
    np.testing.assert_allclose(turn.apply(path.position), WALKED, atol=1e-12)
    off = (turn * Rotation.from_quat(path.rotation)).inv() * TURNED
    np.testing.assert_allclose(off.magnitude(), 0.0, atol=1e-12)


@pytest.mark.parametrize(("up", "world"), [("+y", np.eye(3)), ("+z", Z_UP)])
def test_angles_by_the_names_of_their_columns(tmp_path, up, world):
    """One public set names tilt "yaw", heading "pitch" and nod "roll"."""
    heading, pitch, roll = np.outer(SHARE, [-30, 20, 10]).T
    columns = zip(SHARE, *(WALKED @ world).T, roll, heading, -pitch)
    text = "time (s),px,py,pz,yaw,pitch,roll\n" + "".join(
        ",".join(repr(float(x)) for x in row) + "\n" for row in columns
    )
    require_known(read(tmp_path, text, up=up, order="pitch,-roll,yaw"))
    path = read(tmp_path, text, up=up, order="yaw,pitch,roll")  # taken by name
    assert not np.allclose(np.abs(path.rotation), np.abs(TURNED.as_quat()), atol=0.02)
    with pytest.raises(SettingsError, match="--camera-path-order"):
        read(tmp_path, text, up=up)
    with pytest.raises(SceneError, match="heading,pitch,roll"):
        read(tmp_path, text, up=up, order="heading,pitch,roll")


# Columns of this package


GOOD = [[10.0 + i / 90, 0.1 * i, 1.6, 0.0, 0.0, np.sin(0.02 * i), 0.0, np.cos(0.02 * i)] for i in range(40)]


def as_csv(rows, head=HEAD):
    return "\n".join([head, *(",".join(repr(float(v)) for v in row) for row in rows)]) + "\n"


def test_own_csv_and_both_json_forms_are_equivalent_and_need_no_option(tmp_path):
    names = HEAD.split(",")
    for text in (
        as_csv(GOOD),
        as_csv([[9.0, *row[::-1]] for row in GOOD], "fov," + ",".join(names[::-1])),
        json.dumps([dict(zip(names, row)) for row in GOOD]),
        json.dumps(
            {"time": [r[0] for r in GOOD], "position": [r[1:4] for r in GOOD], "rotation": [r[4:] for r in GOOD]}
        ),
    ):
        path = read(tmp_path, text)
        np.testing.assert_allclose(path.times, np.arange(40) / 90, atol=1e-12)
        np.testing.assert_array_equal(path.position, np.array(GOOD)[:, 1:4])
        np.testing.assert_allclose(path.rotation, np.array(GOOD)[:, 4:], atol=1e-15)
        assert path.fps == pytest.approx(90) and path.rate == pytest.approx(90)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "fewer than two"),
        ("time,x,y\n0,1,2\n", "path"),
        (as_csv(GOOD[:1]), "1 poses"),
        (f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0,oops,0,0,0,1\n", "path:3: 'oops'"),
        (f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0\n", "path:3: 3 of 8"),
        (f"{HEAD}\n0,0,0,0,0,0,0,1\n0,0,0,0,0,0,0,1\n", "1 poses"),
        (f"{HEAD}\n5,0,0,0,0,0,0,1\n4,0,0,0,0,0,0,1\n", "path:3: time 4 is before 5"),
        (f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0,nan,0,0,0,1\n", "path:3: 'nan'"),
        (f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0,0,0,0,0,2\n", "path:3: quaternion"),
        (f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0,0,0,0,0,1e300\n", "path:3: '1e300'"),
        (f"{HEAD}\n", "fewer than two"),
        ("{", "JSON"),
        ("[3]", "path#/0: "),
        ('[{"time": 0}, 4]', "path#/0: "),
        ('{"time": [0], "position": [], "rotation": []}', "time, position and rotation"),
        ('{"time": [0], "position": [[1]], "rotation": [[0, 0, 0, 1]]}', "path#/0: 6 of 8"),
        ('{"frames": []}', "path"),
        ("1 2 3\n4 5 6\n", "path:1: is none of TUM"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n" * 2, "path:1: matrix"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0\n", "path:2: 3 of 12"),
    ],
)
def test_errors_name_the_place_in_the_file(tmp_path, text, named):
    with pytest.raises(TaubenchError) as error:
        read(tmp_path, text, fps=10.0) if text[:1] == "1" else read(tmp_path, text)
    assert named in str(error.value) and "\n" not in str(error.value)


def test_file_that_is_not_utf8_and_options_without_effect(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00\x80")
    with pytest.raises(SceneError, match="UTF-8"):
        read_camera_path(options(tmp_path / "a.csv"))
    for order in ("XXZ", "Q", ",,", "rx,ry", "-,-,-"):
        with pytest.raises(SceneError, match="columns"):
            read(tmp_path, "1 0 0 0 1 2 3\n" * 2, fps=1.0, up="+y", order=order)
    for given in ({"fps": 30.0}, {"order": "XYZ"}, {"body": "1"}):
        with pytest.raises(SettingsError, match="no effect"):
            read(tmp_path, as_csv(GOOD), **given)


# Time


def turned_by(degrees):
    half = np.radians(degrees) / 2
    return [0.0, float(np.sin(half)), 0.0, float(np.cos(half))]


def camera(path, place="world", unit_scale=1.0, scene=None, base=None):
    scene = scene or eye_scene()
    base = base or camera_of_run(scene, SequenceSettings(camera="eye")).view_at(sample(scene, 0.0))
    return RecordedCamera(scene, path, place, base, unit_scale)


def eye_scene():
    """A camera at (1, 2, 3) that looks 40 degrees to the left and 25 down, on a node of scale 2 at (10, 0, 0)."""
    eye = Rotation.from_euler("YXZ", [40, -25, 0], degrees=True).as_quat()
    return make_scene(
        [-1, 0], cameras=[Camera("lens", yfov=0.6, znear=0.2)], camera=[-1, 0], names=["car", "eye"],
        translation=[(10, 0, 0), (-4.5, 1, 1.5)], rotation=[(0, 0, 0, 1), eye], scale=[(2, 2, 2), (1, 1, 1)],
    )  # fmt: skip


def at(track, scene, time):
    return track.view_at(sample(scene, time))


def test_rotation_by_the_shorter_arc_and_position_on_a_line(tmp_path):
    """Not by components, not by Euler angles and not by a screw motion, whose path bows."""
    rows = [[0, 0, 0, 0, *turned_by(0)], [1, 1, 0, 0, *(-x for x in turned_by(20))], [2, 1, 0, 0, *turned_by(190)]]
    path, scene = read(tmp_path, as_csv(rows)), eye_scene()
    assert "1 flips" in path.taken or "2 flips" in path.taken
    for share in (0.0, 0.3, 0.9):
        view = at(camera(path), scene, share)
        np.testing.assert_allclose(view.position, [share, 0, 0], atol=1e-14)
        np.testing.assert_allclose(
            view.world_from_view, math3d.mat3_from_quat(np.array(turned_by(20 * share))), atol=1e-14
        )
    np.testing.assert_allclose(
        at(camera(path), scene, 1.5).world_from_view, math3d.mat3_from_quat(np.array(turned_by(105))), atol=1e-14
    )
    np.testing.assert_allclose(
        at(camera(path), scene, 9.0).world_from_view, math3d.mat3_from_quat(np.array(turned_by(190))), atol=1e-14
    )


def test_of_two_samples_at_one_time_the_last_counts(tmp_path):
    rows = [
        [0, 0, 0, 0, *turned_by(0)],
        [1, 5, 0, 0, *turned_by(0)],
        [1, 7, 0, 0, *turned_by(0)],
        [2, 8, 0, 0, *turned_by(0)],
    ]
    path = read(tmp_path, as_csv(rows))
    np.testing.assert_array_equal(path.position[:, 0], [0, 7, 8])
    assert "1 superseded" in path.taken


@pytest.mark.parametrize("gaps", ["cut", "hold", "slerp"])
def test_gaps_above_four_median_steps(tmp_path, gaps):
    times = [0.0, 0.1, 0.2, 0.6, 0.7, 1.2, 1.3]  # 0.4 is no gap, 0.5 is one
    rows = [[t, 10 * t, 0, 0, *turned_by(100 * t)] for t in times]
    path, scene = read(tmp_path, as_csv(rows), gaps=gaps), eye_scene()
    track = camera(path)
    x = [float(at(track, scene, t).position[0]) for t in (0.4, 0.7, 0.95, 1.2 - 1e-3, 1.2, 1.25)]
    held = [4, 7, 9.5, 12 - 1e-2, 12, 12.5] if gaps == "slerp" else [4, 7, 7, 7, 12, 12.5]
    np.testing.assert_allclose(x, held, atol=1e-9)
    assert "1 gaps" in path.taken
    for fps, frame in ((10, 12), (24, 29), (90, 108)):
        assert track.cut_frames(range(200), fps) == ([frame] if gaps == "cut" else [])
    assert track.cut_frames(range(12, 14), 10) == []  # the first frame has no pair


def test_speed_scales_time_and_scale_positions(tmp_path):
    path = read(tmp_path, as_csv(GOOD), speed=2.0, scale=3.0)
    np.testing.assert_allclose(path.times, np.arange(40) / 180, atol=1e-12)
    np.testing.assert_allclose(path.position, 3 * np.array(GOOD)[:, 1:4])


# Place


@pytest.mark.parametrize("unit_scale", [1.0, 100.0])
def test_start_puts_position_and_heading_onto_the_cameras_and_keeps_the_tilt(unit_scale):
    first = Rotation.from_euler("YXZ", [-70, 15, 8], degrees=True)
    path = read_camera_path(options(FILES / "tum.txt", up="-y"))
    rotation = (first * Rotation.from_quat(path.rotation)).as_quat()
    moved = type(path)(*(getattr(path, n) if n != "rotation" else rotation for n in path.__dataclass_fields__))
    scene = eye_scene()
    track = camera(moved, "start", unit_scale)
    view = at(track, scene, 0.0)
    np.testing.assert_allclose(view.position, [1, 2, 3], atol=1e-14)
    np.testing.assert_allclose(
        Rotation.from_matrix(view.world_from_view).as_euler("YXZ", degrees=True), [40, 15, 8], atol=1e-9
    )
    turn = Rotation.from_euler("y", 110, degrees=True)
    for k, time in enumerate(moved.times):
        view = at(track, scene, float(time))
        np.testing.assert_allclose(view.position, [1, 2, 3] + unit_scale * turn.apply(path.position[k]), atol=1e-9)
        off = Rotation.from_matrix(view.world_from_view).inv() * turn * Rotation.from_quat(moved.rotation[k])
        assert off.magnitude() < 1e-7  # the file's times are rounded
    assert view.camera.yfov == 0.6 and view.camera.znear == 0.2


def test_world_and_node():
    path, scene = read_camera_path(options(FILES / "tum.txt", up="-y")), eye_scene()
    last = float(path.times[-1])
    np.testing.assert_allclose(at(camera(path), scene, last).position, [1, 0.5, -2], atol=1e-12)
    view = at(camera(path, "node:car"), scene, last)  # as a camera below the node
    np.testing.assert_allclose(view.position, [12, 1, -4], atol=1e-12)
    np.testing.assert_allclose(view.world_from_view, TURNED[3].as_matrix(), atol=1e-12)
    with pytest.raises(SettingsError, match="node:car"):
        camera(path, "node:cart")


def test_camera_of_a_run_has_place_and_lens_of_the_scenes_camera(tmp_path):
    scene = eye_scene()
    (tmp_path / "a.chan").write_text("1 0 0 0 0 0 0 50\n2 1 0 0 0 0 0 60\n")
    given = options(tmp_path / "a.chan", fps=1.0, order="ZXY", up="+y", place="world")
    track = camera_of_run(scene, given, 10.0)
    view = at(track, scene, 0.5)
    np.testing.assert_allclose(view.position, [5, 0, 0])
    assert np.degrees(view.camera.yfov) == pytest.approx(55) and view.camera.znear == 0.2
    assert isinstance(track, RecordedCamera) and track.duration == 1.0


# Notes


def notes(tmp_path, angles, fps=24.0, rate=90.0, **given):
    """Notes on a path of (heading, pitch, roll) in degrees, without the line that says what was taken."""
    rows = ["time,heading,pitch,roll", *(f"{k / rate},{a},{b},{c}" for k, (a, b, c) in enumerate(angles))]
    path = read(tmp_path, "\n".join(rows).replace("time", "time_s"), order="heading,pitch,roll", **given)
    return camera(path).notes(fps)[1:]


def test_notes_on_what_heads_rarely_do(tmp_path):
    wave = 10 * np.sin(np.arange(200) / 20)
    still = np.zeros(200)
    assert notes(tmp_path, np.stack([wave, wave, 0.2 * wave], 1)) == []
    assert "90 degrees" in notes(tmp_path, np.stack([wave + 100 * (np.arange(200) == 50), wave, still], 1))[0]
    assert "80 degrees" in notes(tmp_path, np.stack([wave, 85 * (np.arange(200) > 170), still], 1))[0]
    assert len(notes(tmp_path, np.stack([wave, 85 * (np.arange(200) > 185), still], 1))) == 0
    assert "rolls" in notes(tmp_path, np.stack([wave, 0.5 * wave, wave], 1))[0]


def test_note_where_frames_lie_between_distinct_samples(tmp_path):
    """A tracker of 24 Hz logged at 72 Hz has 24 distinct samples a second."""
    wave = np.repeat(10 * np.sin(np.arange(100) / 20), 3)
    angles = np.stack([wave, wave, 0 * wave], 1)
    assert notes(tmp_path, angles, rate=72.0) == []
    found = notes(tmp_path, angles, fps=72.0, rate=72.0)
    assert len(found) == 1 and "24 distinct" in found[0]
    assert notes(tmp_path, angles, fps=48.0, rate=72.0, speed=2.0) == []


def test_note_on_lengths_beside_one(tmp_path):
    rows = [[*row[:4], *(1.01 * x for x in row[4:])] for row in GOOD]
    path = read(tmp_path, as_csv(rows))
    assert "0.01" in path.notes[0]
    np.testing.assert_allclose(np.linalg.norm(path.rotation, axis=1), 1.0, atol=1e-14)
