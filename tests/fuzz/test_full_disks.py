"""File systems that are full or read-only: one line, exit code 2, nothing half-written; the folder works later."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from repeated import few

from taubench_gl.paths import PACKAGE
from taubench_gl.reuse import load_evaluation

DEMO = PACKAGE.parent / "assets" / "demo.glb"
SMALL = ("--size", "48x27", "--frames", "0:3", "--light-unit", "candela", "--exposure", "1", "--environment", "none",
         "--indirect", "none", "--light", "preview")  # fmt: skip
COMMANDS = {
    "evaluate": ("evaluate", str(DEMO), "--save", "masks", *SMALL),
    "export": ("export", str(DEMO), "--channels", "gbuffer,flow", *SMALL),
    "reuse": ("reuse", "evaluate", str(DEMO), "--methods", "accumulate", "--input", "full", "--video", "none",
              "--metrics", "psnr", *SMALL),
}  # fmt: skip


@pytest.fixture
def disk(tmp_path) -> Iterator[Path]:
    """An empty file system of 32 KiB; skips without the right to mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=32k", "tmpfs", str(folder)]
    if sys.platform != "linux" or os.geteuid() or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("no right to mount a file system")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def remount(disk: Path, options: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{options}", str(disk)], check=True)


def run(name: str, out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "taubench_gl", *COMMANDS[name], "--out", str(out)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=600, env=os.environ | {"LP_NUM_THREADS": "1"}
    )


@pytest.mark.parametrize("name", few(["export", "evaluate", "reuse"]))
def test_a_full_and_a_read_only_disk(disk, name):
    out = disk / "out"
    for state in ("size=32k", "ro"):
        remount(disk, state)
        done = run(name, out)
        lines = [line for line in done.stderr.splitlines() if "error" in line]
        assert done.returncode == 2 and len(lines) == 1 and "Traceback" not in done.stderr, done.stderr
        assert str(disk) in lines[0]
        left = {path.name for path in out.rglob("*")}
        assert not any("partial" in one for one in left) and not left & {"summary.json", ".lock"}
        if "reuse.json" in left:  # numbers are written before images, whole
            assert load_evaluation(out).rows
    remount(disk, "rw,size=64m")
    assert run(name, out).returncode == 0
