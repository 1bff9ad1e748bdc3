"""The commands of the tour run as written."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def commands() -> list[str]:
    """Lines of the tour's shell blocks, with continued lines joined, without the viewer, which needs a screen."""
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "docs" / "tour.md").read_text(encoding="utf-8"), re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [line for line in lines if not line.startswith("taubench-gl view")]


def test_the_tour_covers_every_part():
    text = " ".join(commands())
    for word in ("inspect", "evaluate", "reuse evaluate", "cost", "--preset", "selftest", "stress", "batch report"):
        assert f" {word} " in f"{text} ", word


@pytest.mark.long
def test_the_tour_runs(tmp_path: Path):
    shutil.copytree(ROOT / "assets", tmp_path / "assets")
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    program = bin_folder / "taubench-gl"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m taubench_gl "$@"\n')
    program.chmod(0o755)
    environment = os.environ | {"PATH": f"{bin_folder}{os.pathsep}{os.environ['PATH']}"}
    for line in commands():
        done = subprocess.run(
            ["bash", "-c", line], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=900
        )
        assert done.returncode == 0, f"{line}: {done.stderr}"
    made = ("results/report.html", "reuse/reuse.json", "study/cost.json", "hard.glb", "batch/summary.json")
    assert [name for name in made if not (tmp_path / name).is_file()] == []
