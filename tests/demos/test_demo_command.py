"""``taubench-gl demo`` from the outside: list, run, wrong names, scenes."""

from __future__ import annotations

import re

import pytest

from taubench_gl.apps import cli
from taubench_gl.demos import demo as record
from taubench_gl.demos.demo import Expected
from taubench_gl.demos.lessons import find_demo
from taubench_gl.scene import load_scene


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as exit_:
            cli.main(["demo", *arguments])
        out, err = capsys.readouterr()
        return exit_.value.code, out, err

    return run


@pytest.mark.parametrize("arguments", [(), ("--list",), ("--list", "--all")])
def test_without_a_name_it_says_what_there_is(run, arguments, tmp_path):
    code, out, _ = run(*arguments)
    assert code == 0 and len(out.splitlines()) == 11
    assert re.match(r" 1  rotations +A turn", out) and "11  cost" in out
    assert list(tmp_path.iterdir()) == []


def test_runs_by_number_and_name(run, tmp_path):
    code, out, _ = run("9", "occlusion", "--size", "160x90", "--out", "lecture")
    assert code == 0, out
    names = {path.name for path in (tmp_path / "lecture").iterdir()}
    assert names == {"09-thresholds.png", "09-thresholds.html", "07-occlusion.png", "07-occlusion.html"}
    assert "BAD" not in out and out.count("ok ") == 10
    assert "9. A threshold is a point on a curve" in out and "  - Each key moved" in out
    assert "lecture" in out.splitlines()[-1]
    assert "all demos" not in (tmp_path / "lecture" / "09-thresholds.html").read_text(encoding="utf-8")


def test_a_wrong_number_is_exit_code_1(run, monkeypatch):
    one = find_demo("thresholds")

    def wrong(stage, out):
        import dataclasses

        result = one.run(stage, out)
        bad = dataclasses.replace(result.findings[0], expected=Expected.near(99.0, 0.5, "nowhere"))
        return dataclasses.replace(result, findings=(bad, *result.findings[1:]))

    import dataclasses

    monkeypatch.setitem(record.REGISTRY, "thresholds", dataclasses.replace(one, run=wrong))
    code, out, _ = run("thresholds", "--size", "160x90")
    assert code == 1 and "BAD" in out and out.splitlines()[-1] == "not what theory says: thresholds"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("ghost-busters",), "no demo is 'ghost-busters'"),
        (("12",), "no demo is '12'"),
        (("r",), "several demos begin with 'r'"),
        (("--all", "half"), "--all and names were given"),
        (("half", "--size", "16x9"), "160x90"),
        (("half", "--size", "big"), "not a size"),
        (("half", "noise", "--scene", "x.glb"), "--scene and --view take one"),
        (("half", "--notebook", "--view"), "exclude each other"),
        (("--scene", "x.glb"), "no demo was named"),
        (("--view",), "no demo was named"),
        (("half", "--scene", "x.txt"), "x.txt does not end in .glb"),
        (("half", "--scene", ""), "the name is empty"),
        (("half", "--out", "file"), "is not a folder"),
        (("half", "--scene", "file/x.glb"), "file"),
    ],
)
def test_what_cannot_be_meant_is_one_line(run, tmp_path, arguments, said):
    (tmp_path / "file").write_text("")
    code, out, err = run(*arguments)
    assert code == 2 and said in err and "Traceback" not in err
    assert out == ""
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_scene_is_written_for_every_other_command(run, tmp_path):
    code, out, _ = run("occlusion", "--scene", "board.glb")
    assert code == 0 and "taubench-gl view board.glb" in out
    scene = load_scene(tmp_path / "board.glb")
    assert scene.duration == 1.0 and len(scene.camera_nodes) == 1 and len(scene.light_nodes) == 1


def test_view_opens_that_scene(run, monkeypatch, tmp_path):
    """The viewer itself has tests of its own; here only that it is asked for the demo's scene."""
    from taubench_gl.apps import view_command

    seen = []

    def instead(args, standalone_mode):
        seen.append((load_scene(args[0]).duration, args[1:]))

    monkeypatch.setattr(view_command.view, "main", instead)
    code, _, _ = run("7", "--view", "--size", "320x180")
    assert code == 0 and seen == [(1.0, ["--light", "--size", "320x180"])]
