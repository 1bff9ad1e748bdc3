"""``taubench-gl demo``: list, run, invalid names, scenes."""

from __future__ import annotations

import dataclasses
import re
from functools import partial

import pytest

from taubench_gl.demos import texts
from taubench_gl.demos.demo import Expected
from taubench_gl.demos.lessons import DEMOS, find_demo
from taubench_gl.scene import load_scene


@pytest.fixture
def run(taubench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return partial(taubench, "demo")


@pytest.mark.parametrize("arguments", [(), ("--list",), ("--list", "--all")])
def test_without_a_name_the_demos_are_listed(run, arguments, tmp_path):
    code, out, _ = run(*arguments)
    assert code == 0 and len(out.splitlines()) == len(DEMOS)
    assert re.match(r" 1  rotations +\w+", out) and "11  cost" in out
    assert list(tmp_path.iterdir()) == []


def test_runs_by_number_and_name(run, tmp_path):
    code, out, _ = run("5", "sampling", "--size", "160x90", "--out", "lecture")
    assert code == 0, out
    names = {path.name for path in (tmp_path / "lecture").iterdir()}
    assert names == {"05-half.png", "05-half.html", "06-sampling.png", "06-sampling.html"}
    findings = [line for line in out.splitlines() if line.startswith(("  PASS", "  FAIL"))]
    assert len(findings) == 5 and all(line.startswith("  PASS") for line in findings)
    one = find_demo("half")
    assert f"5. {one.text.title}" in out and all(item[:60] in out for item in one.text.look_for)
    assert "lecture" in out.splitlines()[-1]
    assert "all demos" not in (tmp_path / "lecture" / "05-half.html").read_text(encoding="utf-8")


def test_a_lecture_is_pages_in_order_with_an_index(run, monkeypatch, tmp_path):
    parts = tuple(part for part in texts.TEXTS.lecture if part.demo in ("occlusion", "ground"))
    monkeypatch.setattr(texts, "TEXTS", texts.Texts(texts.TEXTS.lesson, parts))
    code, out, _ = run("--lecture", "--size", "160x90", "--out", "talk")
    assert code == 0 and "index.html" in out.splitlines()[-1]
    pages = (tmp_path / "talk" / name for name in ("07-occlusion.html", "13-ground.html"))
    first, second = (page.read_text(encoding="utf-8") for page in pages)
    assert '"next":"13-ground.html"' in first and '"previous":"07-occlusion.html"' in second
    assert "<title>1. " in first and "<title>2. " in second, "a page has its place in the lecture"
    assert parts[1].figure in second and "Lesson 2 of 2, minutes 3 to 6" in second


def test_a_wrong_number_is_exit_code_1(run, monkeypatch):
    one = find_demo("half")

    def wrong(stage, lesson):
        measured = one.measure(stage, lesson)
        name, (number, _) = next(iter(measured.numbers.items()))
        return dataclasses.replace(measured, numbers=measured.numbers | {name: (number, Expected.near(99.0, 0.5))})

    monkeypatch.setitem(DEMOS, "half", dataclasses.replace(one, measure=wrong))
    code, out, _ = run("half", "--size", "160x90")
    assert code == 1 and "  FAIL" in out and "half" in out.splitlines()[-1]


INVALID = {
    "ghost-busters": "ghost-busters", f"{len(DEMOS) + 1}": f"{len(DEMOS)}", "r": "rotations", "--all half": "--all",
    "--all --lecture": "--lecture", "--lecture --scene x.glb": "7", "half --size 16x9": "160x90",
    "half --size big": "big", "half noise --scene x.glb": "--scene", "half --scene x.glb --view": "--scene",
    "--scene x.glb": "--scene", "--view": "--view", "half --scene x.txt": ".glb", "half --scene ": "--scene",
    "half --out file": "file", "half --scene file/x.glb": "file",
}  # fmt: skip
"""Arguments -> what the message names."""


@pytest.mark.parametrize("arguments", INVALID)
def test_invalid_arguments_are_exit_code_2_and_named(run, tmp_path, arguments):
    (tmp_path / "file").write_text("")
    code, out, err = run(*arguments.split(" "))
    assert code == 2 and INVALID[arguments] in err and "Traceback" not in err
    assert out == "" and [p.name for p in tmp_path.iterdir()] == ["file"]


def test_scene_is_written_for_other_commands(run, tmp_path):
    code, out, _ = run("occlusion", "--scene", "board.glb")
    assert code == 0 and "taubench-gl view board.glb" in out
    scene = load_scene(tmp_path / "board.glb")
    assert scene.duration == 1.0 and len(scene.camera_nodes) == 1 and len(scene.light_nodes) == 1


def test_view_opens_the_scene(run, monkeypatch, tmp_path):
    """Only the call: tests/viewer/test_viewer_lessons.py opens it."""
    from taubench_gl.apps import view_command

    load = pytest.importorskip("taubench_gl.viewer.session_file", reason="the viewer extra is not installed").load

    seen = []

    def instead(args, standalone_mode):
        request = load(args[0])
        seen.append((load_scene(request.source).duration, request.settings, request.restored, args[1:]))

    monkeypatch.setattr(view_command.view, "main", instead)
    code, _, _ = run("7", "--view", "--size", "320x180")
    ((duration, settings, restored, more),) = seen
    assert code == 0 and duration == 1.0 and more == []
    assert settings.sequence.width == 320 and settings.metrics.reprojection == "motion"
    assert restored.values["frame"] == 1 and restored.lesson.startswith("7. Disocclusion")
