"""Scripts: mouse, keys and panels through the real handlers, drawn without a window; files that come and go."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from fixed import fixed_settings
from viewer_tools import DEMO, ROOT, pixels

from taubench_gl.errors import SettingsError
from taubench_gl.settings import Settings
from taubench_gl.viewer import prefs
from taubench_gl.viewer.layout import BAR, SIDE
from taubench_gl.viewer.state import CONTROLS

FAULTS = (
    "frame", "frame 1 2", "frobnicate 3", "set opacity 'half", "frame x", "set nothing 1", "key HYPER+X",
    "hold HYPER+X 2", "action dance", "mouse a b", "click @nowhere", "wait some", "expect frame ~ 3",
    "expect nothing == 3", "frame 3; expect frame == 4", "expect camera > 4", "screenshot x.png desktop",
    "set against reference", "set method nothing", "set selection nothing", "session a.json",
)  # fmt: skip


def test_errors_name_their_line(drive):
    driven = drive()
    for fault in FAULTS:
        lines = fault.split("; ")
        with pytest.raises(SettingsError) as error:
            driven.run("\n".join(["# comment", "", *lines]))
        assert error.value.where.endswith(f"script.txt:{2 + len(lines)}"), fault


def test_unreadable_scripts(tmp_path):
    pytest.importorskip("imgui_bundle")
    from taubench_gl.viewer.script import parse

    (tmp_path / "bytes").write_bytes(b"\xff\xfe\xfd")
    for name in ("none.txt", "bytes"):
        with pytest.raises(SettingsError) as error:
            parse(tmp_path / name)
        assert error.value.where == str(tmp_path / name)


def test_panels_work_by_mouse(drive):
    driven = drive()
    driven.run("frame 8\nset threshold.normal 0.01")
    many = driven.engine.counts["normal"]
    driven.run("click @threshold.normal 0.9\nexpect threshold.normal > 0.5\nexpect feature == normal")
    assert driven.engine.counts["normal"] < many
    driven.run("expect show.normal == 1\nclick @show.normal\nexpect show.normal == 0")
    driven.run("click @opacity 0.1\nexpect opacity < 0.2")
    driven.run("mouse @frame 0.5\ndrag @frame 0.9\nexpect frame > 50")
    driven.run("click @button.play\nexpect playing == 1\nwait 2\nclick @button.play\nexpect playing == 0")
    driven.run("click @section.masks\nexpect section.masks == 0\nclick @camera.orbit\nexpect camera == orbit")


def test_every_control_of_a_section_has_a_widget(drive):
    driven = drive(window=(1280, 2000))
    for comparison in ("error", "split", "flicker"):
        driven.run(f"set against method\nset comparison {comparison}\nwait 1")
        names = {c.name for c in CONTROLS.values() if c.section and c.visible(driven.state)}
        assert names <= set(driven.viewer.panels.widgets) and len(names) > 15


def test_toggling_an_effect_by_mouse_and_by_key(drive):
    driven = drive(settings=fixed_settings(width=48, height=27, indirect="none"), light=False)
    driven.run(
        "expect effect.direct == 0\nset effect direct\nkey ENTER\nexpect effect.direct == 1\nexpect overlay.direct >= 0"
    )
    driven.run("click @effect.direct\nexpect effect.direct == 0")


def test_mouse_on_the_image(drive):
    driven = drive()
    x, y, width, height = driven.viewer.layout.image
    driven.run(f"mouse {x + width * 0.5} {y + height * 0.5}\nexpect probe.x == 48\nexpect probe.y == 27")
    driven.run(f"key P\nmouse {x + 2} {y + 2}\nexpect probe.x == 48\nkey CTRL+LEFT\nexpect probe.x == 47")
    driven.run("key P\nmouse 690 5\nexpect probe.x == -1")
    before = driven.engine.user.view().world_from_view
    driven.run(f"key F\nmouse {x + 60} {y + 60}\ndrag {x + 90} {y + 60}")
    forward = -driven.engine.user.view().world_from_view[:, 2]
    assert forward @ before[:, 0] > 0.05, "dragging to the right turns to the right"
    place = driven.engine.user.position.copy()
    driven.run(f"key O\nmouse {x + 60} {y + 60}\nscroll 3")
    assert np.linalg.norm(driven.engine.user.position - place) > 0.1
    driven.run("mouse 690 5\nscroll 3\nkey ESCAPE")
    driven.run(f"set comparison split\nmouse {x + width * 0.5} {y + 30}\ndrag {x + width * 0.75} {y + 30}")
    assert driven.state.split == pytest.approx(0.75, abs=0.01)


def test_keys_while_help_is_shown(drive, tmp_path):
    driven = drive()
    driven.run(f"screenshot {tmp_path / 'a.png'} window\nkey ?\nscreenshot {tmp_path / 'b.png'} window\nkey ESCAPE")
    driven.run("expect help == 0\nkey TAB\nexpect panels == 0")
    a, b = pixels(tmp_path / "a.png"), pixels(tmp_path / "b.png")
    assert a.shape == b.shape == (500, 700, 3) and (a != b).mean() > 0.2


def test_the_window_shows_the_image_beside_the_panels(drive, tmp_path):
    driven = drive(window=(96 * 4 + SIDE, 54 * 4 + BAR))
    driven.run(f"frame 5\nscreenshot {tmp_path / 'w.png'} window")
    window, image = pixels(tmp_path / "w.png"), driven.engine.image()
    x, y, width, height = driven.viewer.layout.image
    assert (width, height) == (384, 216)
    assert (window[y : y + height : 4, x : x + width : 4] == image).all()
    side = window[:, -300:]
    assert side.mean() < 70 and side.max() > 180, "dark panels, light text"


def test_resizing_and_minimizing(drive):
    driven = drive()
    driven.run("minimize\nwait 2\nresize 320 200\nwait 1\nresize 1200 700\nwait 1\nexpect window.width == 1200")
    driven.viewer.gpu.check("resizing")


def test_dropping_files(drive, tmp_path):
    driven = drive()
    (tmp_path / "bad.glb").write_bytes(b"glTF nonsense")
    (tmp_path / "text.txt").write_text("hello")
    for bad in ("bad.glb", "text.txt", "none.glb"):
        driven.run(f"frame 4\ndrop {tmp_path / bad}\nexpect frame == 4\nexpect scene == demo")
        assert bad in driven.state.message
    driven.run(f"set opacity 0.3\nset frame 9\ndrop {DEMO}\nexpect opacity == 0.3 0.001")
    driven.viewer.drop([])


def test_a_deleted_scene_stays_open(drive, tmp_path):
    scene = tmp_path / "here.glb"
    shutil.copy(DEMO, scene)
    driven = drive(scene)
    scene.unlink()
    driven.run("frame 3\nkey F5\nexpect frame == 3\nkey RIGHT\nexpect frame == 4")
    driven.run("key F5\nexpect overlay.position >= 0")
    assert "here.glb" in driven.state.message
    shutil.copy(DEMO, scene)
    driven.run("key F5")
    assert driven.state.message == "reloaded from disk"


def test_path_traced_files_deleted_while_open(drive, tmp_path):
    from taubench_gl.pathtraced.evaluation import PathTracedOptions

    renders = tmp_path / "renders"
    shutil.copytree(ROOT / "tests" / "pathtraced" / "references" / "rigid", renders)
    options = PathTracedOptions(camera_file=renders / "camera.json")
    driven = drive(f"exr:{renders}", Settings(), options=options)
    for file in renders.glob("*.exr"):
        file.unlink()
    driven.run("frame 20\nwait 1\nframe 21\nwait 1")
    assert ".exr" in driven.state.message


def test_screenshots_by_key_and_to_a_missing_folder(drive, tmp_path):
    driven = drive()
    driven.run("frame 7\nkey F12\nkey F12\nkey SHIFT+F12")
    names = sorted(p.name for p in tmp_path.glob("*.png"))
    assert names == ["demo-00007-1.png", "demo-00007-2.png", "demo-00007-window-1.png"]
    assert (pixels(tmp_path / names[0]) == driven.engine.image()).all()
    assert not driven.viewer.screenshot(tmp_path / "none" / "x.png")
    assert "x.png" in driven.state.message


def test_clips(drive, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    driven = drive()
    driven.run("frame 3\nset overlays off\nkey F9\nkey RIGHT\nkey RIGHT\nwait 3\nkey F9")
    (clip,) = tmp_path.glob("*.mp4")
    reader = imageio_ffmpeg.read_frames(str(clip))
    meta = next(reader)
    frames = [np.frombuffer(f, np.uint8).reshape(54, 96, 3) for f in reader]
    assert meta["size"] == (96, 54) and len(frames) == 3
    assert np.abs(frames[-1].astype(float) - driven.engine.image()).mean() < 6
    assert not list(tmp_path.glob(".*partial*"))


def test_clips_without_the_library_name_it(drive, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    driven = drive()
    driven.run("key F9")
    assert "imageio-ffmpeg" in driven.state.message


def test_preferences_are_stored_and_restored(drive, tmp_path):
    first = drive(folder=tmp_path / "prefs")
    first.run("set opacity 0.4\nset show.sky on\nset section.camera off\nresize 777 555")
    first.viewer.close()
    first.viewer.close = lambda: None
    assert prefs.load(tmp_path / "prefs")[0].window == (777, 555)
    second = drive(folder=tmp_path / "prefs", window=(777, 555))
    assert second.state.opacity == 0.4 and second.state.shown["sky"] and not second.state.sections["camera"]
    (tmp_path / "prefs" / "viewer.json").write_text("{nonsense")
    third = drive(folder=tmp_path / "prefs")
    assert "viewer.json" in third.state.message and third.state.opacity == 0.7


def test_the_benchmark_renders_every_frame(drive):
    driven = drive()
    before = driven.engine.drawn.pairs
    driven.run("bench 5\nexpect bench > 0")
    for count in ("0", "-3"):
        with pytest.raises(SettingsError):
            driven.run(f"bench {count}")
    assert driven.engine.drawn.pairs >= before + 8 and "frames/s" in driven.lines[-1]
