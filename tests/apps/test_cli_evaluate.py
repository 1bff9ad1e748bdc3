"""``taubench-gl evaluate``: options become Settings, results are written, errors become exit codes."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.apps.screen import out_folders
from taubench_gl.run import load_run, read_frames
from taubench_gl.settings import Settings


def test_defaults_are_those_of_settings(taubench, evaluate):
    code, out, _ = taubench("evaluate", "walk.glb")
    assert code == 0
    assert evaluate.calls == [
        {"scene": "walk.glb", "settings": Settings(), "out": None, "save": (), "report": False, "lobes": ()}
    ]
    assert "Table 4" in out and "25.00" in out and "Eternal Valley FPS" not in out
    assert "a note about walk" in out and len(out.splitlines()) <= 50
    _, everything, _ = taubench("evaluate", "walk.glb", "--verbose")
    assert all(f"Table {number}" in everything for number in range(1, 5)) and "Eternal Valley FPS" in everything


def test_every_option_becomes_a_setting(taubench, evaluate, tmp_path):
    options = "--camera Cam --animation run --animation 2 --scene 1 --fps 30 --frames 2:-1 --size 64X32"
    options += " --reprojection motion --sampling bilinear --threshold normal=0.5 --threshold position=1e-3"
    options += " --unit-scale 100 --culling none --save masks,channels --backend osmesa --device 3"
    options += " --columns direct,frustum --effects all --environment 0.5,1,2e-1 --exposure 0.25 --tone-map aces"
    options += " --shadow-size 64 --shadow-lights 3 --shadow-filter hard --light-error 1e-4 --indirect rsm"
    code, _, err = taubench("evaluate", "walk.glb", *options.split(), "--out", tmp_path / "o")
    assert code == 0, err
    assert evaluate.calls[0]["settings"] == Settings(
        width=64, height=32, fps=30.0, frames=(2, -1), camera="Cam", scene="1", animation=("run", "2"),
        reprojection="motion", sampling="bilinear", thresholds={"normal": 0.5, "position": 1e-3},
        unit_scale=100.0, culling="none", backend="osmesa", device=3,
        columns=("direct", "frustum"), effects="all", environment=(0.5, 1.0, 0.2), exposure=0.25, tone_map="aces",
        shadow_size=64, shadow_lights=3, shadow_filter="hard", light_error=1e-4, indirect="rsm",
    )  # fmt: skip
    assert evaluate.calls[0]["out"] == tmp_path / "o"
    assert evaluate.calls[0]["save"] == ("masks", "channels")


def test_results_are_written_to_the_folder(taubench, evaluate, tmp_path):
    code, out, _ = taubench("evaluate", "walk.glb", "--out", tmp_path)
    assert code == 0 and f"written to {tmp_path}" in out
    assert len(load_run(tmp_path).frames) == 4
    assert {file.name for file in tmp_path.iterdir()} == {"summary.json", "frames.csv"} and "report.html" not in out
    assert str(tmp_path / "report.html") in taubench("evaluate", "walk.glb", "--out", tmp_path, "--report")[1]


@pytest.mark.parametrize(
    ("options", "duration", "way_out"),
    [
        (["--camera", "Main"], 0.0, "--camera orbit"),
        (["--frames", "3:4"], 1.0, "--frames"),
        ([], 0.01, "--fps"),
    ],
)
def test_a_run_without_a_pair_is_exit_code_2_with_the_way_out(taubench, evaluate, options, duration, way_out):
    evaluate.pairs, evaluate.duration = 0, duration
    code, out, err = taubench("evaluate", "walk.glb", *options)
    assert code == 2 and way_out in err and err.strip().count("\n") == 0 and not out


def test_backend_from_the_environment(taubench, evaluate, monkeypatch):
    monkeypatch.setenv("TAUBENCH_BACKEND", "osmesa")
    taubench("evaluate", "a.glb")
    taubench("evaluate", "a.glb", "--backend", "egl")
    assert [call["settings"].device.backend for call in evaluate.calls] == ["osmesa", "egl"]


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--size", "wide"], "--size"),
        (["--frames", "7"], "--frames"),
        (["--threshold", "normal"], "--threshold"),
        (["--threshold", "shine=1"], "shine"),
        (["--fps", "nan"], "nan"),
        (["--save", "masks"], "--out"),
        (["--report"], "--out"),
        (["--save", "music", "--out", "x"], "music"),
        (["--columns", ""], "--columns"),
        (["--out", ""], "--out"),
        (["--environment", "0,0,-1"], "environment"),
        (["--reprojection", "both"], "both"),
        (["--nope"], "--nope"),
    ],
)
def test_invalid_options_are_exit_code_2_and_named(taubench, evaluate, options, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = taubench("evaluate", "a.glb", *options)
    assert code == 2 and named in err and out == ""
    assert "Traceback" not in err and evaluate.calls == [] and not list(tmp_path.iterdir())


def test_debug_shows_the_traceback(evaluate, monkeypatch):
    from taubench_gl.apps import cli
    from taubench_gl.errors import SceneError

    monkeypatch.setenv("TAUBENCH_DEBUG", "1")
    with pytest.raises(SceneError):
        cli.main(["evaluate", "bad.glb"])


def test_a_failed_scene_does_not_stop_the_others(taubench, evaluate, tmp_path):
    code, out, err = taubench("evaluate", "a.glb", "bad.glb", "bug.glb", "c.glb", "--out", tmp_path)
    assert code == 2
    assert [Path(call["scene"]).stem for call in evaluate.calls] == ["a", "bad", "bug", "c"]
    assert load_run(tmp_path / "a").frames and load_run(tmp_path / "c").frames
    assert "bad.glb#/nodes/3" in err and "ZeroDivisionError: oops" in err and "2 of 4" in err
    assert "Table 4" in out


def test_an_interrupt_names_the_kept_results(taubench, evaluate, tmp_path):
    code, _, err = taubench("evaluate", "a.glb", "slow.glb", "c.glb", "--out", tmp_path)
    assert code == 130
    assert str(tmp_path / "slow" / "frames.csv") in err and "Traceback" not in err
    assert len(read_frames(tmp_path / "slow" / "frames.csv")) == 2
    assert len(evaluate.calls) == 2
    code, _, err = taubench("evaluate", "slow.glb")
    assert code == 130 and "frames.csv" not in err


def test_progress_in_a_pipe_is_ten_plain_lines(taubench, evaluate):
    evaluate.pairs = 100
    _, _, err = taubench("evaluate", "walk.glb")
    lines = [line for line in err.splitlines() if "pairs" in line]
    assert len(lines) == 10
    assert "10/100" in lines[0] and "2.00 pairs/s" in lines[0] and "\x1b" not in err


@pytest.mark.parametrize(
    ("scenes", "names"),
    [
        (["a/x.glb"], ["."]),
        (["a/x.glb", "b/x.gltf", "b/X.glb"], ["x", "x-2", "X-3"]),
        (["x.glb", "q/x.glb", "x-2.glb"], ["x", "x-3", "x-2"]),
    ],
)
def test_folders_are_unique(scenes, names):
    assert out_folders(scenes, Path("out")) == [Path("out") / name for name in names]


@pytest.mark.parametrize(
    ("scenes", "options", "unused"),
    [
        (["exr:renders"], ["--size", "1920x1080"], "--size"),  # the default, but given
        (["exr:renders", "exr:more"], ["--size", "64x32"], "--size"),
        (["exr:renders"], ["--camera", "Top"], "--camera"),
        (["exr:renders"], ["--camera", "Top", "--camera-file", "camera.json"], "--camera"),
        (["exr:renders"], [], None),
        (["exr:renders"], ["--camera", "Top", "--scene-file", "scene.glb"], None),
        (["walk.glb"], ["--camera-file", "cameras.json"], "--camera-file"),
        (["walk.glb"], ["--mapping", "blender"], "--mapping"),
        (["exr:renders", "walk.glb"], ["--size", "64x32", "--camera", "Top", "--mapping", "blender"], None),
    ],
)
def test_options_without_effect_on_their_scenes_are_errors(taubench, evaluate, scenes, options, unused):
    code, _, err = taubench("evaluate", *scenes, *options)
    if unused is None:
        assert code == 0 and len(evaluate.calls) == len(scenes), err
    else:
        assert code == 2 and unused in err and err.count("\n") == 1 and not evaluate.calls


@pytest.mark.parametrize("option", ["--eyes 0.1", "--eye right", "--convergence 2", "--other-eye b"])
def test_options_of_the_other_eye_need_its_history(taubench, evaluate, option):
    code, printed, errors = taubench("evaluate", "walk.glb", *option.split())
    assert code == 2 and not printed and option.split()[0] in errors and len(errors.strip().splitlines()) == 1
    assert not evaluate.calls
    assert taubench("evaluate", "walk.glb", "--history", "eye", *option.split())[0] == 0 and evaluate.calls


def test_a_preset_says_that_camera_and_frames_are_not_in_it(taubench, evaluate, tmp_path):
    preset = tmp_path / "preset.toml"
    preset.write_text('schema = "taubench-gl/preset/1"\n[settings]\nwidth = 16\nheight = 9\n')
    code, _, errors = taubench("evaluate", "walk.glb", "--preset", preset)
    assert code == 0 and str(preset) in errors and evaluate.calls[0]["settings"].sequence.width == 16
    code, _, errors = taubench("evaluate", "walk.glb", "--preset", preset, "--frames", "0:2")
    assert code == 0 and str(preset) not in errors
    code, _, errors = taubench("evaluate", "exr:renders", "--preset", preset)  # its size has no effect there
    assert code == 0, errors
