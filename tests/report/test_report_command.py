"""The command ``taubench-gl report``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest


@pytest.fixture
def run(stored_run):
    return stored_run


@pytest.fixture
def report(taubench):
    return partial(taubench, "report")


def test_one_run_gets_its_report_next_to_its_summary(run, tmp_path, report):
    run.save(tmp_path / "run")
    code, out, _ = report(tmp_path / "run")
    assert code == 0 and "report.html" in out
    assert (tmp_path / "run" / "report.html").read_text().startswith("<!DOCTYPE html>")


def test_several_runs_with_out(run, tmp_path, report):
    for name in ("a", "b"):
        run.save(tmp_path / name)
    assert report(tmp_path / "a", tmp_path / "b", "--out", tmp_path / "both.html")[0] == 0
    text = (tmp_path / "both.html").read_text()
    assert text.count('class="figures"') == 2
    assert not (tmp_path / "a" / "report.html").exists()


def test_several_runs_without_out_go_to_the_current_folder(run, tmp_path, monkeypatch, report):
    run.save(tmp_path / "a")
    monkeypatch.chdir(tmp_path)
    assert report("a", "a")[0] == 0
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
def test_errors_are_one_line_with_exit_code_2(run, tmp_path, monkeypatch, report, arguments, named):
    run.save(tmp_path / "run")
    monkeypatch.chdir(tmp_path)
    code, _, err = report(*arguments)
    assert code == 2 and named in err and "Traceback" not in err
    assert not list(tmp_path.rglob("*.html"))


def test_evaluate_report_needs_a_folder(taubench):
    code, _, err = taubench("evaluate", "scene.glb", "--report")
    assert code == 2 and "--report" in err and "--out" in err
