"""The command ``taubench-gl report``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest


@pytest.fixture
def report(taubench):
    return partial(taubench, "report")


@pytest.mark.parametrize(
    ("arguments", "file", "runs"),
    [(("a",), "a/report.html", 1), (("a", "b", "--out", "both.html"), "both.html", 2), (("a", "a"), "report.html", 2)],
)
def test_where_a_report_goes(run, tmp_path, monkeypatch, report, arguments, file, runs):
    """Beside the summary of one run; of several into the current folder."""
    for name in ("a", "b"):
        run.save(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    code, out, _ = report(*arguments)
    assert code == 0 and file in out
    assert Path(file).read_text().count('class="figures"') == runs and len(list(tmp_path.rglob("*.html"))) == 1


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
