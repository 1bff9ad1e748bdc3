"""Session files: saved, restored, moved with their scene, and broken ones."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from click.testing import CliRunner
from viewer_tools import DEMO, QUIET

from taubench_gl.apps.cli import cli
from taubench_gl.errors import OutputError, SettingsError, TaubenchError
from taubench_gl.viewer.session_file import load, save_lesson


def reopened(drive, path):
    request = load(path)
    return drive(request.source, request.settings, restored=request.restored, given=request.given, run=request.run,
                 method=request.method)  # fmt: skip


def test_a_session_is_saved_and_restored(drive, tmp_path):
    scene = tmp_path / "here" / "scene.glb"
    scene.parent.mkdir()
    shutil.copy(DEMO, scene)
    first = drive(scene, QUIET.replace(thresholds={"normal": 0.3}))
    first.run("key F\nhold W 3\nhold L 2\nframe 12\nset channel normal\nset scale 0.5\nset reprojection motion")
    first.run("set probe 20,10\nset probe_pinned on\nset opacity 0.4\nset auto_range off")
    first.run(f"session {scene.parent / 'a.session.json'}")
    shutil.move(scene.parent, tmp_path / "there")
    second = reopened(drive, tmp_path / "there" / "a.session.json")
    second.run("expect frame == 12\nexpect channel == normal\nexpect scale == 0.5\nexpect reprojection == motion")
    second.run("expect probe == 20,10\nexpect probe_pinned == 1\nexpect opacity == 0.4")
    second.run("expect camera == fly\nexpect auto_range == 0\nexpect threshold.normal == 0.3")
    assert np.allclose(second.engine.user.position, first.engine.user.position)
    assert (second.engine.user.yaw, second.engine.user.pitch) == (first.engine.user.yaw, first.engine.user.pitch)
    first.viewer.reopen(first.viewer._request)


def test_a_method_of_the_user_moves_with_its_session(drive, tmp_path):
    here = tmp_path / "here"
    here.mkdir()
    assert CliRunner().invoke(cli, ["reuse", "new", str(here / "mine")]).exit_code == 0
    first = drive(method=str(here / "mine"))
    first.run(f"frame 4\nsession {here / 'a.session.json'}")
    shutil.move(here, tmp_path / "there")
    second = reopened(drive, tmp_path / "there" / "a.session.json")
    assert second.state.method == str(tmp_path / "there" / "mine") and second.state.against == "method"
    assert second.state.message == "restored"


def test_a_session_is_saved_by_key_and_dropped(drive, tmp_path):
    driven = drive()
    driven.run("frame 9\nset opacity 0.3\nkey CTRL+S\nset opacity 0.9\nframe 3")
    (path,) = tmp_path.glob("*.session.json")
    driven.run(f"drop {path}\nexpect frame == 9\nexpect opacity == 0.3")
    path.write_text("{nonsense")
    driven.run(f"frame 4\ndrop {path}\nexpect frame == 4")
    assert path.name in driven.state.message
    assert not driven.viewer.save_session(tmp_path / "none" / "x.session.json")


@pytest.mark.parametrize(
    "change",
    [
        {"schema": "taubench-gl/viewer/0"},
        {"values": {"opacity": [1]}},
        {"camera": {"position": [0, 0], "yaw": 0, "pitch": 0}},
        {"settings": {"width": "wide"}},
        {"path_traced": {"seed": "1"}},
        {"surprise": 1},
    ],
)
def test_invalid_session_files_are_one_line_errors(tmp_path, change):
    path = tmp_path / "a.session.json"
    save_lesson(path, str(DEMO), QUIET, {}, "")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises((OutputError, SettingsError)) as error:
        load(path)
    assert "\n" not in str(error.value)


def test_values_that_do_not_fit_are_left_out(drive, tmp_path):
    driven = drive()
    path = tmp_path / "a.session.json"
    driven.run(f"session {path}")
    stored = json.loads(path.read_text())
    stored["values"] |= {"channel": "direct", "nothing": 1, "opacity": 0.2}
    path.write_text(json.dumps(stored))
    again = reopened(drive, path)
    assert again.state.opacity == 0.2
    assert "channel" in again.state.message and "nothing" in again.state.message


def test_a_session_whose_scene_is_gone(drive, tmp_path):
    scene = tmp_path / "scene.glb"
    shutil.copy(DEMO, scene)
    drive(scene).run(f"session {tmp_path / 'a.session.json'}")
    scene.unlink()
    with pytest.raises(TaubenchError) as error:
        reopened(drive, tmp_path / "a.session.json")
    assert "scene.glb" in str(error.value)


def test_options_that_a_session_has_are_refused(tmp_path):
    from taubench_gl.apps import cli

    path = tmp_path / "a.session.json"
    path.write_text("{}")
    with pytest.raises(SystemExit) as exit_:
        cli.main(["view", str(path), "--size", "64x36"])
    assert exit_.value.code == 2
