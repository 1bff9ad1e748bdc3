"""The suite on disk, its truth and its scorer: without OpenGL, except for the control, which draws the cases."""

from __future__ import annotations

import json
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner
from engine_frames import SIZE, right_frames, scored, truth_of

from taubench_gl.apps.cli import cli
from taubench_gl.conformance.cases import CASES, FPS
from taubench_gl.conformance.frames import EngineFrames
from taubench_gl.conformance.score import NO_PLACE, NOT_JUDGED, RIGHT
from taubench_gl.conformance.truth import CLASSES, Truth
from taubench_gl.conventions import Visibility
from taubench_gl.errors import PathTracedError
from taubench_gl.paths import PACKAGE


def run(*arguments: str):
    return CliRunner().invoke(cli, ["conformance", *map(str, arguments)], standalone_mode=False)


def test_right_frames_are_right_in_every_case():
    scores = scored(lambda truth, frames: frames, *CASES)
    assert {name: score.status for name, score in scores.items()} == dict.fromkeys(CASES, RIGHT)
    assert not any(each.wrong for score in scores.values() for each in score.classes)


@pytest.mark.parametrize("name", ["behind", "line", "leaf", "skin-morph", "shadow", "sky"])
def test_a_case_shows_what_it_is_about(name):
    truth, case = Truth(CASES[name], (128, 72)), CASES[name]
    counts = dict.fromkeys((*CLASSES, NO_PLACE), 0)
    for frame in truth.frames()[1:]:
        where = frame.edge if case.edges else ~frame.edge
        for number, kind in enumerate(CLASSES):
            counts[kind] += int((where & (frame.kind == number) & np.isfinite(frame.motion).all(axis=-1)).sum())
        counts[NO_PLACE] += int((where & (frame.visibility == Visibility.BEHIND)).sum())
    assert all(counts[kind] >= 200 for kind in case.about)


def test_closed_forms():
    """Motion of a yaw, of a pan before a parallel camera and of a translated box, at one pixel each."""
    yaw, frame = truth_of("yaw"), truth_of("yaw").frame(1)
    width, height = SIZE
    focal = 0.5 * height / np.tan(np.radians(25.0))
    # At the center of the image, level with the camera's axis, a turn by a about the vertical, pitched by 8 degrees.
    a, pitch = np.radians(1.3), np.radians(-8.0)
    ray = np.array([0.5 / focal, 0.5 / focal, -1.0])
    tilt = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    spin = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    before = tilt.T @ spin @ tilt @ ray
    expected = focal * (before[:2] / -before[2] - ray[:2]) * [1, -1]
    np.testing.assert_allclose(frame.motion[height // 2 - 1, width // 2], expected, atol=1e-6)  # float32 keys
    assert yaw.frame(0).exact.all()

    pan = truth_of("orthographic").frame(1)
    surface = pan.node >= 0
    step = np.array([0.06, -0.03]) * height / 3.0  # 3 m are the height of the image
    np.testing.assert_allclose(pan.motion[surface], np.broadcast_to(step, pan.motion[surface].shape), atol=1e-6)


@pytest.mark.parametrize("name", ["visibility", "zero-scale", "teleport", "cut"])
def test_jumps_lie_before_the_frame_that_shows_them(name):
    """A jump on a frame would come a frame late in an engine that compares double times with rounded float32 keys."""
    for channel in truth_of(name).scene.animations[0].channels:
        assert channel.interpolation == "STEP"
        late = channel.times[1:].astype(float) * FPS - np.arange(1, len(channel.times))
        assert (late > -0.5).all() and (late < -0.1).all()


def test_visibility_of_the_previous_frame():
    frame = truth_of("visibility").frame(2)
    names = truth_of("visibility").scene.nodes.names
    assert (frame.visibility[frame.node == names.index("appearing box")] == Visibility.NEW).all()
    assert (frame.visibility == Visibility.OCCLUDED).sum() > 100
    assert (truth_of("light").frame(2).visibility == Visibility.VISIBLE).all()
    assert not truth_of("cut").frame(2).valid.any()


def test_engine_frames_of_both_formats_are_read(tmp_path):
    from taubench_gl.pathtraced.exr import write_exr

    truth = truth_of("jitter")
    for k, frame in enumerate(right_frames(truth)):
        motion = frame.motion + truth.jitter_motion(k)
        stored = {"v": motion * [-1, 1] / np.array(SIZE) + 0.5, "n": np.where(frame.sky[..., None], 0, frame.normal)}
        stored["p"] = np.where(frame.sky[..., None], 0.0, frame.points + truth.view(k).position)
        stored = {name: value.astype(np.float32) for name, value in stored.items()}
        (tmp_path / "npz" / "jitter").mkdir(parents=True, exist_ok=True)
        np.savez(tmp_path / "npz" / "jitter" / f"f{k}.npz", **stored)
        planes = {f"{name}.{'XYZ'[i]}": value[..., i] for name, value in stored.items() for i in range(value.shape[2])}
        write_exr(tmp_path / "exr" / "jitter" / f"f{k}.exr", planes)
    mapping = tmp_path / "engine.toml"
    mapping.write_text(
        'up = "y"\n[motion]\nunit = "uv"\ndirection = "current-previous"\ny = "up"\nzero = "0.5"\njitter = "included"\n'
        '[passes]\nmotion = "v"\nposition = "p"\nnormal = "n"\n'
    )
    for kind in ("exr", "npz"):
        result = run("score", f"{kind}:{tmp_path / kind}", "--mapping", mapping, "--only", "jitter", "--json")
        assert result.return_value == 0, result.output
        mapping.write_text(mapping.read_text().replace('"included"', '"excluded"'))
        result = run("score", f"{kind}:{tmp_path / kind}", "--mapping", mapping, "--only", "jitter", "--out", tmp_path)
        assert result.return_value == 1
        summary = json.loads((tmp_path / "conformance.json").read_text())
        assert {each["cause"] for each in summary["cases"][0]["classes"]} == {None, "the jitter is left in"}
        mapping.write_text(mapping.read_text().replace('"excluded"', '"included"'))
        suite = ElementTree.parse(tmp_path / "junit.xml").getroot()
        assert (suite.get("tests"), suite.get("failures")) == ("1", "1")
        page = (tmp_path / "conformance.html").read_text()
        assert "the jitter is left in" in page and page.index("worst pixel") < page.index("All cases")
    result = run("score", f"npz:{tmp_path / 'npz'}", "--mapping", mapping)
    assert result.return_value == 3
    assert run("score", f"npz:{tmp_path / 'npz'}", "--mapping", mapping, "--allow-unjudged").return_value == 0


def test_rejection_is_scored():
    from dataclasses import replace

    def exact(truth, frames):
        # Wrong where nothing is scored, at outlines.
        return [replace(f, rejected=~truth.frame(k).valid ^ truth.frame(k).edge) for k, f in enumerate(frames)]

    def none(truth, frames):
        return [replace(f, rejected=np.zeros_like(f.sky)) for f in frames]

    assert scored(exact, "disocclusion-object")["disocclusion-object"].precision_recall == (1.0, 1.0)
    assert scored(none, "cut")["cut"].precision_recall == (None, 0.0)


def test_rejection_is_read_from_files(tmp_path):
    truth = truth_of("disocclusion-camera")
    (tmp_path / "disocclusion-camera").mkdir()
    for k, (frame, right) in enumerate(zip(right_frames(truth), truth.frames(), strict=True)):
        arrays = {"v": frame.motion, "d": right.depth, "w": np.where(right.valid, 0.9, 0.0)}
        path = tmp_path / "disocclusion-camera" / f"f{8 + k}.npz"  # 8, 9, 10, 11: in order of numbers, not of letters
        np.savez(path, **{name: values.astype(np.float32) for name, values in arrays.items()})
    names = {"motion": ["v.X", "v.Y"], "depth": ["d.X"], "history_weight": ["w.X"]}
    passes = {name: {"channels": channels} for name, channels in names.items()}
    mapping = tmp_path / "engine.json"
    mapping.write_text(json.dumps({"up": "y", "motion": {"y": "down"}, "passes": passes}))
    result = run("score", f"npz:{tmp_path}", "--mapping", mapping, "--only", "disocclusion-camera", "--json")
    case = json.loads(result.output[result.output.index("{") :])["cases"][0]
    assert case["status"] == RIGHT and case["rejection"] == {"precision": 1.0, "recall": 1.0}


def written_npz(folder, name, arrays_of):
    """NPZ files of a case in ``folder``, with the arrays of ``arrays_of(truth, number, frame as an engine has it)``."""
    truth = truth_of(name)
    (folder / name).mkdir()
    for k, frame in enumerate(right_frames(truth)):
        np.savez(folder / name / f"f{k}.npz", v=frame.motion.astype(np.float32), **arrays_of(truth, k, frame))


def test_normals_in_view_axes_show_the_scene(tmp_path):
    def view_normals(truth, k, frame):
        normal = np.where(frame.sky[..., None], 0.0, frame.normal) @ truth.view(k).world_from_view
        return {"n": normal.astype(np.float32)}

    written_npz(tmp_path, "yaw", view_normals)
    mapping = tmp_path / "engine.toml"
    mapping.write_text('up = "y"\nnormals = "view"\n[motion]\ny = "down"\n[passes]\nmotion = "v"\nnormal = "n"\n')
    truth, frames = EngineFrames(f"npz:{tmp_path}", mapping).open(CASES["yaw"])
    for frame, right in zip(frames, truth.frames(), strict=True):
        np.testing.assert_allclose(frame.normal, right.normal, atol=1e-6)
    assert run("score", f"npz:{tmp_path}", "--mapping", mapping, "--only", "yaw").return_value == 0


def test_depth_beside_half_positions_sets_the_tolerance(tmp_path):
    """Points come from the finer depth, so that a step of half positions, a meter here, is none of theirs."""

    def coarse(truth, k, frame):
        position = np.where(frame.sky[..., None], 0.0, frame.points + truth.view(k).position)
        return {"p": position.astype(np.float16), "d": truth.frame(k).depth.astype(np.float32)[..., None]}

    written_npz(tmp_path, "kilometer", coarse)
    mapping = tmp_path / "engine.json"
    passes = {"motion": ["v.X", "v.Y"], "position": ["p.X", "p.Y", "p.Z"], "depth": ["d.X"]}
    passes = {name: {"channels": channels} for name, channels in passes.items()}
    mapping.write_text(json.dumps({"up": "y", "motion": {"y": "down"}, "passes": passes}))
    _, frames = EngineFrames(f"npz:{tmp_path}", mapping).open(CASES["kilometer"])
    assert max(np.max(frame.step_m) for frame in frames) < 1e-4
    assert not any(frame.world for frame in frames)


def test_written_scenes_are_small_and_listed(tmp_path):
    assert run("write", tmp_path / "suite", "--only", "grid", "--only", "sk").exception is None
    listed = json.loads((tmp_path / "suite" / "suite.json").read_text())
    assert {case["name"] for case in listed["cases"]} == {"grid", "skin", "skin-morph", "sky"}
    for case in listed["cases"]:
        assert (tmp_path / "suite" / case["scene"]).stat().st_size < 100_000
        assert [frame["time_s"] for frame in case["frames"]] == [k / 24 for k in range(4)]
    assert run("list").exception is None and CASES["far"].text in run("show", "far").output


def test_missing_and_damaged_frames_are_not_judged(tmp_path):
    (tmp_path / "yaw").mkdir()
    (tmp_path / "yaw" / "f0.exr").write_bytes(b"no image")
    result = run("score", f"exr:{tmp_path}", "--only", "still", "--only", "yaw", "--json")
    assert result.return_value == 3
    cases = json.loads(result.output[result.output.index("{") :])["cases"]
    assert [case["status"] for case in cases] == [NOT_JUDGED] * 2 and "f0.exr" in cases[1]["reason"]
    assert isinstance(run("score", str(tmp_path)).exception, PathTracedError)


def test_writing_and_scoring_need_no_opengl(tmp_path):
    code = """
import sys
for name in ("moderngl", "glfw", "glcontext"):
    sys.modules[name] = None
from taubench_gl.apps.cli import main
for words, code in ((["write", sys.argv[1] + "/s"], 0), (["score", "npz:" + sys.argv[1]], 3)):
    try:
        main(["conformance", *words, "--only", "still"])
    except SystemExit as done:
        assert done.code == code, words
"""
    done = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and (tmp_path / "s" / "suite.json").is_file(), done.stderr


def test_the_control_is_right_in_every_case(tmp_path, monkeypatch):
    """This project's rasterizer, through the files of its export."""
    monkeypatch.setattr("taubench_gl.conformance.frames.Truth", lambda case, _: truth_of(case.name))
    sys.path.insert(0, str(PACKAGE.parent / "tools" / "engines"))
    try:
        from conformance_taubench import main
    finally:
        sys.path.pop(0)
    run("write", tmp_path / "suite", "--size", "64x36")
    main(tmp_path / "suite", tmp_path / "frames", [])
    result = run("score", f"exr:{tmp_path / 'frames'}", "--json")
    assert result.return_value == 0, result.output
    cases = json.loads(result.output[result.output.index("{") :])["cases"]
    assert len(cases) == len(CASES)
    assert all(each["wrong_percent"] == 0 for case in cases for each in case["classes"])
