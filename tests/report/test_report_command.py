"""The command ``taubench-gl report``."""

from __future__ import annotations

from pathlib import Path

import pytest

from taubench_gl.apps.cli import main


@pytest.fixture
def run(stored_run):
    return stored_run


def report(*arguments: object) -> int:
    with pytest.raises(SystemExit) as done:
        main(["report", *map(str, arguments)])
    return done.value.code


def test_one_run_gets_its_report_next_to_its_summary(run, tmp_path, capsys):
    run.save(tmp_path / "run")
    assert report(tmp_path / "run") == 0
    assert (tmp_path / "run" / "report.html").read_text().startswith("<!DOCTYPE html>")
    assert "report.html" in capsys.readouterr().out


def test_several_runs_with_out(run, tmp_path):
    for name in ("a", "b"):
        run.save(tmp_path / name)
    assert report(tmp_path / "a", tmp_path / "b", "--out", tmp_path / "both.html") == 0
    text = (tmp_path / "both.html").read_text()
    assert text.count('class="figures"') == 2
    assert not (tmp_path / "a" / "report.html").exists()


def test_several_runs_without_out_go_to_the_current_folder(run, tmp_path, monkeypatch):
    run.save(tmp_path / "a")
    monkeypatch.chdir(tmp_path)
    assert report("a", "a") == 0
    assert Path("report.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("missing",), "missing"),
        (("run", "--out", "none/report.html"), "none/report.html"),
        (("run", "--out", ""), "--out"),
        (("run", "--images", "0"), "--images"),
        ((), "RUN..."),
    ],
)
def test_errors_are_one_line_with_exit_code_2(run, tmp_path, monkeypatch, capsys, arguments, named):
    run.save(tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    assert report(*arguments) == 2
    printed = capsys.readouterr().err
    assert named in printed and "Traceback" not in printed
    assert not list(tmp_path.rglob("*.html"))


def test_evaluate_report_needs_a_folder(capsys):
    with pytest.raises(SystemExit) as done:
        main(["evaluate", "scene.glb", "--report"])
    assert done.value.code == 2
    printed = capsys.readouterr().err
    assert "--report" in printed and "--out" in printed
