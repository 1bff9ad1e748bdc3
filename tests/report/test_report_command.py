"""``taubench-gl report`` as people type it."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.apps.cli import main


def report(*arguments: object) -> int:
    with pytest.raises(SystemExit) as done:
        main(["report", *map(str, arguments)])
    return done.value.code


def test_one_run_gets_its_report_beside_its_summary(run, tmp_path, capsys):
    run.save(tmp_path / "run")
    assert report(tmp_path / "run") == 0
    assert (tmp_path / "run" / "report.html").read_text().startswith("<!DOCTYPE html>")
    assert "report.html (0." in capsys.readouterr().out


def test_several_runs_in_a_named_file(run, tmp_path):
    for name in ("a", "b"):
        run.save(tmp_path / name)
    assert report(tmp_path / "a", tmp_path / "b", "--out", tmp_path / "both.html") == 0
    text = (tmp_path / "both.html").read_text()
    assert text.count('class="figures"') == 2
    assert not (tmp_path / "a" / "report.html").exists()


def test_several_runs_without_a_name_go_to_the_working_folder(run, tmp_path, monkeypatch):
    run.save(tmp_path / "a")
    monkeypatch.chdir(tmp_path)
    assert report("a", "a") == 0
    assert Path("report.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("missing",), "missing: does not exist"),
        (("run", "--out", "none/report.html"), "none/report.html: cannot be written"),
        (("run", "--out", ""), "the name is empty"),
        (("run", "--pictures", "0"), "--pictures"),
        ((), "RUN..."),
    ],
)
def test_one_line_for_what_cannot_be(run, tmp_path, monkeypatch, capsys, arguments, told):
    run.save(tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    assert report(*arguments) == 2
    told_lines = capsys.readouterr().err
    assert told in told_lines and "Traceback" not in told_lines
    assert not list(tmp_path.rglob("*.html"))


def test_evaluate_report_needs_a_folder(capsys):
    with pytest.raises(SystemExit) as done:
        main(["evaluate", "scene.glb", "--report"])
    assert done.value.code == 2
    assert "--report needs --out DIR" in capsys.readouterr().err
