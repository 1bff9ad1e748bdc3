"""Small studies over the demo scene, and what must be equal between two runs of one."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from taubench_gl.batch.study import Study, read_study
from taubench_gl.paths import PACKAGE

DEMO = PACKAGE.parent / "assets" / "demo.glb"
SMALL = 'size = "48x27"\ncolumns = ["frustum", "position", "normal"]\n'
FINAL = ("summary.json", "frames.parquet", "tables.txt", "tables.csv", "tables.md", "tables.tex")


def write_study(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def study_of(folder: Path, text: str) -> Study:
    return read_study(write_study(folder, text))


def final_files(out: Path) -> dict[str, bytes]:
    """Everything that must not depend on how it was computed."""
    files = [out / name for name in FINAL]
    files += sorted(out.glob("jobs/*/summary.json")) + sorted(out.glob("jobs/*/frames.csv"))
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def batch_process(*arguments: str | Path, **environment: str) -> subprocess.Popen[str]:
    """``taubench-gl batch`` as a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "taubench_gl", "batch", *(str(a) for a in arguments)],
        env=os.environ | {"LP_NUM_THREADS": "1"} | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_until(happened: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Until files or processes are as the test wants them; fails if ``process`` ends before."""
    while not happened():
        try:
            process.wait(timeout=0.02)
        except subprocess.TimeoutExpired:
            continue
        assert happened(), f"it ended first: {process.communicate()}"
