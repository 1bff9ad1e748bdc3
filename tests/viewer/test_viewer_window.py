"""The command in a window on its own X display, and its errors."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from viewer_tools import DEMO, QUIET, evaluated, pixels

from taubench_gl.apps import view_command
from taubench_gl.viewer import session_file
from taubench_gl.viewer.layout import script_size, start_size

pytestmark = pytest.mark.usefixtures("coarse_light")

VIEW = [sys.executable, "-m", "taubench_gl", "view"]
ARGUMENTS = ["--size", "96x54", "--columns", "frustum,position,normal"]


def view(environment, *arguments):
    done = subprocess.run([*VIEW, *map(str, arguments)], capture_output=True, text=True, timeout=300, env=environment)
    assert "Traceback" not in done.stderr + done.stdout
    return done


def test_script_in_a_window(display, gpu, tmp_path):
    row = evaluated(6)
    script = tmp_path / "steps.txt"
    script.write_text(f"""
        frame 5
        key RIGHT
        expect count.position == {row["position"]}
        set opacity 1
        set show.normal off
        set show.frustum off
        screenshot {tmp_path / "a.png"}
        click @threshold.position 0.99
        expect count.position < {row["position"]}
        screenshot {tmp_path / "window.png"} window
        mouse 200 200
        expect probe.x >= 0
        resize 640 400
        expect window.width == 640
        minimize
        wait 2
        resize 800 500
        expect window.height == 500
        drop {DEMO}
        expect scene == demo
        bench 3
        quit
    """)
    done = view(display, DEMO, *ARGUMENTS, "--script", script, "--window", "700x500", "--screenshots", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "frames/s" in done.stdout
    image, window = pixels(tmp_path / "a.png"), pixels(tmp_path / "window.png")
    blue = (image == (0x00, 0x72, 0xB2)).all(axis=-1)
    assert image.shape == (54, 96, 3) and blue.sum() == row["position"]
    assert window.shape == (500, 700, 3) and window[:, 400:].mean() < 70


def test_the_window_of_a_restored_session_of_a_small_image_has_room_for_both_panels(display, tmp_path):
    """The monitor has 1280x800 points."""
    session, script = tmp_path / "a.session.json", tmp_path / "steps.txt"
    session_file.save_lesson(session, str(DEMO), QUIET, {"frame": 3}, "")
    script.write_text(
        "expect frame == 3\nexpect image.width == 96\nexpect window.width > 960\nexpect window.width <= 1280\n"
        "expect window.height >= 700\nexpect window.height <= 800\nquit\n"
    )
    done = view(display, session, "--script", script)
    assert done.returncode == 0, done.stderr


def test_a_new_window_fits_the_monitor(monkeypatch):
    glfw = pytest.importorskip("glfw", reason="the viewer extra is not installed")
    from taubench_gl.viewer import window

    monkeypatch.setattr(glfw, "get_primary_monitor", lambda: "monitor")
    monkeypatch.setattr(glfw, "get_monitor_workarea", lambda monitor: (0, 0, 1024, 600))
    for image in ((64, 36), (1920, 1080)):
        for size in (start_size(image), script_size(image)):
            width, height = window._fitting(size)
            assert 900 < width < 1024 and 500 < height < 600
    assert window._fitting((700, 500)) == (700, 500)


def test_a_failed_expectation_is_exit_code_2(display, tmp_path):
    script = tmp_path / "steps.txt"
    script.write_text("expect window.width > 960\nframe 3\nexpect frame == 4\n")
    done = view(display, DEMO, *ARGUMENTS, "--script", script)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and f"{script}:3" in done.stderr


def test_no_display(tmp_path):
    pytest.importorskip("glfw", reason="the viewer extra is not installed")
    if sys.platform != "linux":
        pytest.skip("other systems always have a display")
    environment = {n: v for n, v in os.environ.items() if n not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = view(environment, DEMO)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "window" in done.stderr
    for gone in (
        [tmp_path / "none.glb"],
        [f"exr:{tmp_path / 'none'}"],
        [DEMO, "--reference", f"exr:{tmp_path / 'none'}"],
    ):
        done = view(environment, *gone)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
        assert str(tmp_path / "none") in done.stderr and "window" not in done.stderr


def test_without_the_extra(monkeypatch, capsys):
    from taubench_gl.apps import cli

    monkeypatch.setattr(
        view_command, "LIBRARIES", {"glfw_that_is_not_there": "glfw", "imgui_not_there": "imgui-bundle"}
    )
    with pytest.raises(SystemExit) as exit_:
        cli.main(["view", str(DEMO)])
    err = capsys.readouterr().err
    assert exit_.value.code == 2 and err.count("\n") == 1
    assert "glfw and imgui-bundle" in err and "pip install 'taubench-gl[viewer]'" in err
