"""Small batches of the demo scene, and the files that must be equal in two runs of one batch."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from taubench_gl.batch.spec import BatchSpec, read_spec
from taubench_gl.paths import PACKAGE

DEMO = PACKAGE.parent / "assets" / "demo.glb"
LIGHTING = 'light = "raster"\nlight_unit = "candela"\nexposure = 1\nenvironment = "none"\n'
SMALL = f'size = "48x27"\ncolumns = ["frustum", "position", "normal"]\n{LIGHTING}'
FINAL = ("summary.json", "frames.parquet", "tables.txt", "tables.csv", "tables.md", "tables.tex")


def write_spec(folder: Path, text: str) -> Path:
    path = folder / "spec.toml"
    path.write_text(text, encoding="utf-8")
    return path


def spec_of(folder: Path, text: str) -> BatchSpec:
    return read_spec(write_spec(folder, text))


def final_files(out: Path) -> dict[str, bytes]:
    """Contents of every file that must not depend on engine, chunks or interruptions."""
    files = [out / name for name in FINAL]
    files += sorted(out.glob("jobs/*/summary.json")) + sorted(out.glob("jobs/*/frames.csv"))
    return {str(path.relative_to(out)): path.read_bytes() for path in files}


def batch_process(*arguments: str | Path, **environment: str) -> subprocess.Popen[str]:
    """Start ``taubench-gl batch`` in another process."""
    return subprocess.Popen(
        [sys.executable, "-m", "taubench_gl", "batch", *(str(a) for a in arguments)],
        env=os.environ | {"LP_NUM_THREADS": "1"} | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_until(happened: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Wait for a condition; fails if ``process`` ends before it holds."""
    while not happened():
        try:
            process.wait(timeout=0.02)
        except subprocess.TimeoutExpired:
            continue
        assert happened(), f"it ended first: {process.communicate()}"
