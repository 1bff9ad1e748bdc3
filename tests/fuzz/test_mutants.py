"""Damaged glTF, AFF, OBJ and EXR files in a limited process: one TaubenchError, or a consistent result."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from mutants import write_exr_mutants, write_gltf_mutants
from repeated import few
from text_mutants import write_text_mutants

WORKER = Path(__file__).with_name("workers.py")
SECONDS_A_FILE = 2  # of processor time, on average; the seed takes 0.05
GIBIBYTES = 4  # of address space; llvmpipe's own code and stacks take 2


def verdicts(kind: str, folder: Path, count: int) -> dict[str, dict]:
    """Verdict of every file.  Fails with the file that ended the process, and its error output."""
    seconds = 30 + SECONDS_A_FILE * count
    command = [sys.executable, str(WORKER), kind, str(folder), str(seconds), str(GIBIBYTES)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120 + 4 * seconds)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    last = lines[-1]["file"] if lines else "nothing"
    assert done.returncode == 0, f"{last} ended the process with {done.returncode}: {done.stderr[-3000:]}"
    return {line["file"]: line for line in lines if "verdict" in line}


def check(found: dict[str, dict], count: int, undamaged: str) -> None:
    assert len(found) == count + 1
    assert found[undamaged]["verdict"] == "read", found[undamaged]
    rejected = [v for v in found.values() if v["verdict"] == "rejected"]
    assert count // 10 < len(rejected) < count, "some mutants must be rejected, and some must not"
    beside = ("device", "a.mtl:", "a1.obj:", "part.aff:")  # other files that an error may name
    unclear = [v for v in rejected if not any(name in v["error"] for name in (v["file"], *beside))]
    assert len(unclear) <= len(rejected) // 4, f"errors that do not name their file: {unclear[:5]}"


def test_gltf(tmp_path):
    write_gltf_mutants(tmp_path, 60, seed=3)
    check(verdicts("gltf", tmp_path, 60), 60, "000000.gltf")


def test_exr(tmp_path):
    write_exr_mutants(tmp_path, 150, seed=5)
    check(verdicts("exr", tmp_path, 150), 150, "000000.exr")


@pytest.mark.parametrize(("kind", "count"), few([("aff", 20), ("obj", 20)]))
def test_text_formats(tmp_path, kind, count):
    write_text_mutants(tmp_path, kind, count, seed=7)
    check(verdicts(kind, tmp_path, count), count, f"000000.{kind}")


@pytest.mark.long
@pytest.mark.parametrize("kind", ["aff", "obj"])
@pytest.mark.parametrize("seed", range(5))
def test_text_formats_long(tmp_path, kind, seed):
    write_text_mutants(tmp_path, kind, 500, seed=100 + seed)
    check(verdicts(kind, tmp_path, 500), 500, f"000000.{kind}")


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_gltf_long(tmp_path, seed):
    write_gltf_mutants(tmp_path, 500, seed=100 + seed)
    check(verdicts("gltf", tmp_path, 500), 500, "000000.gltf")


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5))
def test_exr_long(tmp_path, seed):
    write_exr_mutants(tmp_path, 2000, seed=100 + seed)
    check(verdicts("exr", tmp_path, 2000), 2000, "000000.exr")
