"""A study whose process is killed (SIGKILL) again and again ends like one that was left alone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from taubench_gl.cost.records import RECORDS_FILE
from taubench_gl.cost.reference import SUMS_FILE

REQUEST = (
    "--size", "48x27", "--frames", "20:24", "--parameters", "shadow_size,shadow_filter",
    "--reference", "path-traced@16", "--repeats", "3", "--time-limit", "none", "--clock", "cpu",
)  # fmt: skip


def start(demo: Path, out: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "taubench_gl", "cost", str(demo), "--out", str(out), *REQUEST]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ)


def lines(out: Path) -> list[str]:
    path = out / RECORDS_FILE
    return path.read_text().splitlines() if path.exists() else []


def kill_when(process: subprocess.Popen[bytes], reached: Callable[[], bool]) -> None:
    while not reached():
        with suppress(subprocess.TimeoutExpired):
            pytest.fail(f"it ended before it was killed: {process.wait(timeout=0.02)}")
    process.kill()
    process.wait()


@pytest.mark.long
def test_a_killed_study_resumes_to_the_same_errors(demo, tmp_path):
    """Errors are equal pixel by pixel; times, and so the front, are those of two runs."""
    whole, out = tmp_path / "whole", tmp_path / "killed"
    assert start(demo, whole).wait() == 0
    kill_when(start(demo, out), (out / SUMS_FILE).exists)  # in the reference
    for share in (0.2, 0.4, 0.8):
        before = lines(out)
        kill_when(start(demo, out), lambda share=share: len(lines(out)) > share * len(lines(whole)))
        assert lines(out)[: len(before)] == before
    assert start(demo, out).wait() == 0
    assert len(lines(out)) == len(lines(whole)), "nothing is measured twice"
    a, b = (json.loads((folder / "study.json").read_text()) for folder in (whole, out))
    assert a["reference"] == b["reference"] and a["reference"]["samples"] == 16
    assert [(p["name"], p["masks"], p["wrong"]) for p in a["points"]] == [
        (p["name"], p["masks"], p["wrong"]) for p in b["points"]
    ]
