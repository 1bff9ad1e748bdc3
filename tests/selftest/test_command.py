"""``taubench-gl selftest``: rows, verdict, exit code, JSON."""

from __future__ import annotations

import json
from functools import partial

import pytest

from taubench_gl.selftest import camera
from taubench_gl.selftest.case import REGISTRY, Case, Outcome
from taubench_gl.selftest.runner import run_case


@pytest.fixture
def run(taubench):
    return partial(taubench, "selftest")


@pytest.fixture
def broken(monkeypatch):
    """Three more cases: a wrong answer, an exception, and NaN."""
    assert camera

    def raises(bench):
        raise ZeroDivisionError("oops")

    texts = ("test", "failure", 0.5, "source")
    monkeypatch.setitem(
        REGISTRY, "made-up-wrong", Case("made-up-wrong", "camera", *texts, lambda b: Outcome(1.0, 2.0, 1.0))
    )
    monkeypatch.setitem(REGISTRY, "made-up-raises", Case("made-up-raises", "camera", *texts, raises))
    monkeypatch.setitem(
        REGISTRY, "made-up-nan", Case("made-up-nan", "camera", *texts, lambda b: Outcome(1.0, "NaN", float("nan")))
    )


def test_rows_and_verdict(run):
    code, out, _ = run("--backend", "egl", "--only", "camera")
    assert code == 0
    assert "pass  angle-wrap" in out and "cases passed" in out


def test_failed_case_gives_exit_code_1_and_does_not_stop_the_others(run, broken):
    code, out, _ = run("--backend", "egl", "--only", "made-up-", "--only", "angle-wrap")
    assert code == 1
    assert "FAIL  made-up-wrong" in out and "FAIL  made-up-nan" in out and "pass  angle-wrap" in out
    assert "ZeroDivisionError: oops" in out and out.count("common failure: failure") == 3
    assert "3 of 4 cases FAILED" in out


@pytest.mark.parametrize("size", ["8x8", "16x16", "4097x64", "64x99999"])
def test_invalid_sizes(run, size):
    code, out, err = run("--only", "angle-wrap", "--size", size)
    assert code == 2 and out == "" and f"size is {size}" in err


def test_json(run, broken):
    code, out, _ = run("--backend", "egl", "--json", "--only", "made-up-", "--only", "pitch-through-90")
    assert code == 1
    report = json.loads(out)
    rows = {row["name"]: row for row in report["cases"]}
    assert rows["pitch-through-90"]["passed"]
    assert rows["made-up-nan"]["error"] is None and not rows["made-up-nan"]["passed"]
    assert rows["made-up-raises"]["failure"] == "ZeroDivisionError: oops"
    assert report["failed"] == 3 and report["passed"] == 1
    assert {"backend", "renderer", "driver", "version"} <= report["provenance"].keys()
    for row in rows.values():
        assert {"name", "description", "expected", "measured", "error", "tolerance", "passed"} <= row.keys()


def test_unknown_names(run):
    code, _, err = run("--only", "no-such-case")
    assert code == 2 and "--list" in err


def test_list_runs_nothing(run):
    code, out, _ = run("--list", "--only", "offsets")
    assert code == 0 and out.count("\n") == 8 and "offset-1e9" in out


def test_gl_error_fails_the_case():
    class Gpu:
        def check(self, where):
            raise RuntimeError(f"GL_INVALID_OPERATION after {where}")

    class Bench:
        gpu = Gpu()

    one = Case("x", "camera", "w", "e", 0.0, "s", lambda b: Outcome(0, 0, 0.0))
    result = run_case(one, Bench())
    assert not result.passed and "GL_INVALID_OPERATION" in result.failure
