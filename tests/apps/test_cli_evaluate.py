"""``taubench-gl evaluate``: options reach Settings, results reach the folder, errors reach the exit code."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.apps.evaluate_command import out_folders
from taubench_gl.run import load_run
from taubench_gl.settings import Settings


def test_defaults_are_those_of_settings(taubench, evaluate):
    code, out, _ = taubench("evaluate", "walk.glb")
    assert code == 0
    assert evaluate.calls == [{"scene": "walk.glb", "settings": Settings(), "out": None, "save": (), "report": False}]
    assert "Table 4" in out and "25.00" in out and "Eternal Valley FPS" in out
    assert "a note about walk" in out


def test_every_option_arrives(taubench, evaluate, tmp_path):
    options = "--camera Cam --animation run --animation 2 --scene 1 --fps 30 --frames 2:-1 --size 64X32"
    options += " --reprojection motion --sampling bilinear --threshold normal=0.5 --threshold position=1e-3"
    options += " --unit-scale 100 --culling none --save masks,channels --backend osmesa --device 3"
    options += " --columns direct,frustum --effects all --sky 0.5,1,2e-1 --exposure 0.25 --tone-map aces"
    options += " --shadow-size 64 --shadow-lights 3 --shadow-filter hard --light-error 1e-4 --indirect rsm"
    code, _, err = taubench("evaluate", "walk.glb", *options.split(), "--out", tmp_path / "o")
    assert code == 0, err
    assert evaluate.calls[0]["settings"] == Settings.of(
        width=64, height=32, fps=30.0, frames=(2, -1), camera="Cam", scene="1", animation=("run", "2"),
        reprojection="motion", sampling="bilinear", thresholds={"normal": 0.5, "position": 1e-3},
        unit_scale=100.0, culling="none", backend="osmesa", device=3,
        columns=("direct", "frustum"), effects="all", sky=(0.5, 1.0, 0.2), exposure=0.25, tone_map="aces",
        shadow_size=64, shadow_lights=3, shadow_filter="hard", light_error=1e-4, indirect="rsm",
    )  # fmt: skip
    assert evaluate.calls[0]["out"] == tmp_path / "o"
    assert evaluate.calls[0]["save"] == ("masks", "channels")


def test_results_lie_in_the_folder(taubench, evaluate, tmp_path):
    code, out, _ = taubench("evaluate", "walk.glb", "--out", tmp_path)
    assert code == 0 and f"written to {tmp_path}" in out
    assert len(load_run(tmp_path).frames) == 4
    assert {file.name for file in tmp_path.iterdir()} == {"summary.json", "frames.csv"}


def test_backend_from_the_environment(taubench, evaluate, monkeypatch):
    monkeypatch.setenv("TAUBENCH_BACKEND", "osmesa")
    taubench("evaluate", "a.glb")
    taubench("evaluate", "a.glb", "--backend", "egl")
    assert [call["settings"].backend for call in evaluate.calls] == ["osmesa", "egl"]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--size", "wide"], "'wide' is not a size such as 1920x1080"),
        (["--size", "0x5"], "width is 0"),
        (["--frames", "7"], "'7' is not a range of frames"),
        (["--frames", "a:b"], "not a range of frames"),
        (["--threshold", "normal"], "'normal' is not a threshold"),
        (["--threshold", "shine=1"], "no feature is named 'shine'"),
        (["--threshold", "normal=-1"], "threshold of normal is -1.0"),
        (["--threshold", "color=1e39"], "threshold of color is 1e+39 with unit scale 1"),
        (["--unit-scale", "1e40"], "threshold of position is 1.2549e+39 with unit scale 1e+40"),
        (["--fps", "0"], "fps is 0.0"),
        (["--fps", "nan"], "fps is nan"),
        (["--save", "masks"], "--save needs --out"),
        (["--save", "music", "--out", "x"], "cannot save music; choose from masks, channels"),
        (["--columns", "direct,shine"], "cannot measure shine; choose from frustum, color"),
        (["--sky", "1,2"], "'1,2' is not a radiance such as 0.2,0.4,0.9"),
        (["--sky", "0,0,-1"], "sky is (0.0, 0.0, -1.0)"),
        (["--exposure", "0"], "exposure is 0.0"),
        (["--shadow-size", "8"], "shadow size is 8"),
        (["--shadow-lights", "-1"], "shadow lights is -1"),
        (["--light-error", "-1"], "light error is -1.0"),
        (["--tone-map", "film"], "'film' is not one of"),
        (["--reprojection", "both"], "'both' is not one of"),
        (["--nope"], "No such option"),
    ],
)
def test_options_that_cannot_be_meant(taubench, evaluate, options, complaint):
    code, out, err = taubench("evaluate", "a.glb", *options)
    assert code == 2 and complaint in err and out == ""
    assert "Traceback" not in err and evaluate.calls == []


def test_error_is_one_line_and_exit_code_2(taubench, evaluate):
    code, out, err = taubench("evaluate", "bad.glb")
    assert (code, out) == (2, "")
    assert err == "taubench-gl: error: bad.glb#/nodes/3: no such thing (mend it)\n"


def test_debug_shows_the_traceback(evaluate, monkeypatch):
    from taubench_gl.apps import cli
    from taubench_gl.errors import SceneError

    monkeypatch.setenv("TAUBENCH_DEBUG", "1")
    with pytest.raises(SceneError):
        cli.main(["evaluate", "bad.glb"])


def test_one_scene_that_fails_does_not_stop_the_others(taubench, evaluate, tmp_path):
    code, out, err = taubench("evaluate", "a.glb", "bad.glb", "bug.glb", "c.glb", "--out", tmp_path)
    assert code == 2
    assert [Path(call["scene"]).stem for call in evaluate.calls] == ["a", "bad", "bug", "c"]
    assert load_run(tmp_path / "a").frames and load_run(tmp_path / "c").frames
    assert "error: bad.glb#/nodes/3" in err and "ZeroDivisionError: oops" in err and "2 of 4 scenes failed" in err
    assert "a, % of all pixels" in out and "c, % of all pixels" in out


def test_interrupt_says_what_is_kept(taubench, evaluate, tmp_path):
    code, _, err = taubench("evaluate", "a.glb", "slow.glb", "c.glb", "--out", tmp_path)
    assert code == 130
    assert f"2 finished pairs are in {tmp_path / 'slow' / 'frames.csv'}" in err
    assert "1 finished scenes" in err and "Traceback" not in err
    assert len(evaluate.calls) == 2


@pytest.mark.parametrize(
    ("option", "complaint"), [("--out", "the name is empty"), ("--columns", "nothing to measure; choose from frustum")]
)
def test_options_that_are_empty(taubench, evaluate, option, complaint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = taubench("evaluate", "a.glb", option, "")
    assert code == 2 and complaint in err and not evaluate.calls and not list(tmp_path.iterdir())


def test_interrupt_without_a_folder(taubench, evaluate):
    code, _, err = taubench("evaluate", "slow.glb")
    assert code == 130 and "nothing was written" in err


def test_progress_in_a_pipe_is_a_few_plain_lines(taubench, evaluate):
    evaluate.pairs = 100
    _, _, err = taubench("evaluate", "walk.glb")
    lines = [line for line in err.splitlines() if "pairs" in line]
    assert len(lines) == 10
    assert lines[0].startswith("walk.glb: 10/100 pairs, 2.00 pairs/s, 45 s left") and "\x1b" not in err


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
    ("scenes", "options", "complaint"),
    [
        (["exr:renders"], ["--size", "1920x1080"], "--size does nothing here"),  # the default, but given
        (["exr:renders", "exr:more"], ["--size", "64x32"], "--size does nothing here"),
        (["exr:renders"], ["--camera", "Top"], "--camera does nothing here"),
        (["exr:renders"], ["--camera", "Top", "--camera-file", "camera.json"], "--camera does nothing here"),
        (["exr:renders"], [], None),
        (["exr:renders"], ["--camera", "Top", "--scene-file", "scene.glb"], None),
        (["exr:renders", "walk.glb"], ["--size", "64x32", "--camera", "Top"], None),
    ],
)
def test_what_path_traced_files_decide_is_refused(taubench, evaluate, scenes, options, complaint):
    code, _, err = taubench("evaluate", *scenes, *options)
    if complaint is None:
        assert code == 0 and len(evaluate.calls) == len(scenes), err
    else:
        assert code == 2 and complaint in err and err.count("\n") == 1 and not evaluate.calls


def test_the_size_of_a_preset_is_not_refused(taubench, evaluate, tmp_path):
    (tmp_path / "preset.toml").write_text('schema = "taubench-gl/preset/1"\n[settings]\nwidth = 64\nheight = 36\n')
    code, _, err = taubench("evaluate", "exr:renders", "--preset", tmp_path / "preset.toml")
    assert code == 0 and evaluate.calls[0]["settings"].width == 64, err
