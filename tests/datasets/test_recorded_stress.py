"""Recorded cameras in glTF, as ``stress --camera`` and ``convert --camera-path`` write them, and in evaluations."""

from __future__ import annotations

import json

import numpy as np
import pytest

from taubench_gl.animation import Poser, choose_camera, sample
from taubench_gl.animation.views import camera_of_run
from taubench_gl.batch.spec import read_spec
from taubench_gl.datasets.stress import stress
from taubench_gl.errors import SettingsError
from taubench_gl.metrics.activity import euler_yxz
from taubench_gl.paths import PACKAGE
from taubench_gl.pathtraced.evaluation import require_supported
from taubench_gl.scene import load_scene
from taubench_gl.settings import SequenceSettings, Settings

pytestmark = pytest.mark.usefixtures("coarse_metering", "fixed_light")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
HEAD = "time,x,y,z,qx,qy,qz,qw"


def rows_of(times, degrees=1.0):
    half = np.radians(degrees) / 2 * np.arange(len(times))
    zero = np.zeros(len(times))
    return np.stack(
        [times, 0.1 * np.arange(len(times)), zero + 1.6, zero, zero, np.sin(half), zero, np.cos(half)], axis=1
    )


def write(path, rows):
    path.write_text("\n".join([HEAD, *(",".join(repr(float(v)) for v in row) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize("given", [{"camera_path_speed": 0.5}, {"camera_path_gaps": "slerp"}])
def test_gltf_and_direct_playback_are_the_same_camera(tmp_path, given):
    rows = rows_of(np.concatenate([np.arange(12), np.arange(20, 26)]) / 30, 4.0)
    rows[::3, 4:] *= -1  # quaternions of either sign
    path = write(tmp_path / "head.csv", rows)
    sequence = SequenceSettings(camera_path=str(path), **given)
    stress(DEMO, tmp_path / "out.glb", sequence)
    demo, written = load_scene(DEMO), load_scene(tmp_path / "out.glb")
    direct, camera = camera_of_run(demo, sequence), choose_camera(written)
    assert len(direct.cut_frames(range(60), 24.0)) == (0 if given.get("camera_path_gaps") else 1)
    poser = Poser(written)
    for frame in range(24 * 2):
        state = poser.sample(frame / 24)
        expected, got = direct.view_at(sample(demo, frame / 24)), camera.view_at(state)
        np.testing.assert_allclose(got.position, expected.position, atol=1e-5)
        np.testing.assert_allclose(got.world_from_view, expected.world_from_view, atol=1e-5)


def test_commands_write_the_same_animation(tmp_path, taubench):
    path = write(tmp_path / "head.csv", rows_of(np.arange(10) / 30))
    given = ("--camera-path-place", "start", "--camera-path-speed", "2")
    code, out, _ = taubench("stress", DEMO, "--camera", path, *given, "--out", tmp_path / "a.glb")
    assert code == 0 and "head.csv: columns" in out
    code, out, _ = taubench("convert", DEMO, "--camera-path", path, *given, tmp_path / "b.glb")
    assert code == 0 and "head.csv: columns" in out
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()
    scene = load_scene(tmp_path / "a.glb")
    view, demo = choose_camera(scene).view_at(sample(scene, 0.0)), load_scene(DEMO)
    expected = choose_camera(demo).view_at(sample(demo, 0.0))
    np.testing.assert_allclose(view.position, expected.position, atol=1e-6)
    headings = [euler_yxz(v.world_from_view)[0] for v in (view, expected)]
    assert headings[0] == pytest.approx(headings[1], abs=1e-6)
    assert taubench("convert", DEMO, "--camera-path", path, "--take", "x", tmp_path / "c.glb")[0] == 2


def test_errors_of_files_are_one_line_of_the_command(tmp_path, taubench):
    (tmp_path / "a.csv").write_text(f"{HEAD}\n0,0,0,0,0,0,0,1\n1,0,0,oops,0,0,0,1\n")
    for command in (("stress", DEMO, "--camera", tmp_path / "a.csv", "--out", tmp_path / "o.glb"),
                    ("evaluate", DEMO, "--camera-path", tmp_path / "a.csv")):  # fmt: skip
        code, _, err = taubench(*command)
        assert code == 2 and "a.csv:3: 'oops'" in err and "Traceback" not in err
    code, _, err = taubench("stress", DEMO, "--camera", tmp_path / "none.csv", "--out", tmp_path / "o.glb")
    assert code == 2 and "none.csv" in err


def test_evaluation_plays_the_path_and_flags_its_gaps(tmp_path, taubench):
    times = np.concatenate([np.arange(12), np.arange(20, 30)]) / 24
    path = write(tmp_path / "head.csv", rows_of(times, 2.0))
    yaw = {}
    for gaps in ("cut", "hold", "slerp"):
        out = tmp_path / gaps
        given = ("--camera-path", path, "--camera-path-gaps", gaps, "--out", out)
        code, _, err = taubench("evaluate", DEMO, "--size", "32x18", "--columns", "frustum", *given)
        assert code == 0, err
        summary = json.loads((out / "summary.json").read_text())
        assert summary["pairs"] == 29 and summary["camera"]["cuts"] == ([20] if gaps == "cut" else [])
        assert "head.csv" in summary["camera"]["source"] and "1 gaps" in summary["notes"][0]
        assert summary["scene"]["selection"]["camera_path"] == str(path)
        assert len(summary["scene"]["camera_path_sha256"]) == 64
        yaw[gaps] = summary["camera"]["yaw"]
    assert yaw["cut"]["mean"] == pytest.approx(2 * 21 / 29, abs=1e-9)
    assert yaw["cut"]["variance"] == yaw["hold"]["variance"] > yaw["slerp"]["variance"]
    assert yaw["slerp"]["mean"] == pytest.approx(2 * 21 / 29, abs=1e-9)


def test_other_eye_of_the_scene_does_not_follow(tmp_path):
    from taubench_gl.animation.eyes import other_eye

    path = write(tmp_path / "head.csv", rows_of(np.arange(10) / 30))
    scene, settings = load_scene(DEMO), Settings(camera_path=str(path), history="eye", other_eye=0)
    with pytest.raises(SettingsError):
        other_eye(scene, camera_of_run(scene, settings.sequence), settings)


def test_batch_specs_name_the_file_relative_to_themselves(tmp_path):
    jobs = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write(tmp_path / folder / "head.csv", rows_of(np.arange(10) / 30))
        spec = tmp_path / folder / "spec.toml"
        spec.write_text(f'scenes = ["{DEMO}"]\ncamera-path = ["head.csv", "other.csv"]\ncamera-path-speed = 2\n')
        jobs.append(read_spec(spec).jobs)
        assert [job.settings.sequence.camera_path for job in jobs[-1]] == [
            str(tmp_path / folder / name) for name in ("head.csv", "other.csv")
        ]
        assert jobs[-1][0].settings.sequence.camera_path_speed == 2.0
    assert [job.id for job in jobs[0]] == [job.id for job in jobs[1]]  # the same on every machine


def test_path_traced_files_have_their_own_camera(tmp_path):
    with pytest.raises(SettingsError, match="camera path"):
        require_supported("exr:frames", Settings(camera_path="head.csv"))


def test_exposure_is_metered_along_the_recorded_camera_once(tmp_path, monkeypatch):
    """The key of a stored exposure holds the path and its place: another path has another exposure."""
    from taubench_gl.evaluation import exposure

    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    scene, settings, files = load_scene(DEMO), Settings(environment="none"), set()
    for degrees, place in ((1.0, "start"), (2.0, "start"), (1.0, "world"), (1.0, "start")):
        path = write(tmp_path / "head.csv", rows_of(np.arange(10) / 30, degrees))
        camera = camera_of_run(scene, SequenceSettings(camera_path=str(path), camera_path_place=place))
        files.add(exposure._cache_file(scene, exposure._metering(settings), camera))
        assert exposure._times(scene, camera)[-1] == camera.duration
    assert len(files) == 3 and None not in files
