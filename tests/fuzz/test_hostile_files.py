"""Hostile files of every kind: each ends with a result or one line, and touches nothing outside its own folder.

Every case runs in a process of its own, with limits (``hostile_server``).  TAUBENCH_FUZZ_SEED and TAUBENCH_FUZZ_CASES
choose another series of the long test.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from hostile_cases import Case, make_case, make_seeds

from taubench_gl.errors import MOST_CHARACTERS

SERVER = Path(__file__).with_name("hostile_server.py")
MOST_BYTES = 2 << 30
REASON = re.compile(r"memory|GiB|MiB", re.IGNORECASE)
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
CASES = 42
LONG_CASES = int(os.environ.get("TAUBENCH_FUZZ_CASES", "1000"))
SEED = int(os.environ.get("TAUBENCH_FUZZ_SEED", "1"))


@pytest.fixture(scope="module")
def seeds(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("seeds")
    make_seeds(folder)
    return folder


@pytest.fixture
def server(tmp_path) -> Iterator[subprocess.Popen[str]]:
    caches = {"NUMBA_CACHE_DIR": str(tmp_path / "numba"), "MESA_SHADER_CACHE_DIR": str(tmp_path / "mesa"),
              "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
    threads = {"LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, str(SERVER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | caches | threads | {"MPLCONFIGDIR": str(tmp_path / "mpl")},
    ) as process:  # fmt: skip
        yield process
        process.stdin.close()
        process.wait(timeout=600)


def state(folder: Path) -> dict[str, tuple]:
    """Everything in the folder but the output and the program's own folders: kind, size, time and content."""
    out = {}
    for root, folders, files in os.walk(folder):
        if Path(root) == folder:
            folders[:] = [name for name in folders if name not in ("out", "own")]
            files = [name for name in files if not name.startswith(("out.", ".out."))]
        for name in (*folders, *files):
            path = os.path.join(root, name)
            about = os.lstat(path)
            content = None
            if stat.S_ISREG(about.st_mode) and about.st_size < 1 << 24:
                content = sha256(Path(path).read_bytes()).hexdigest()
            out[os.path.relpath(path, folder)] = (about.st_mode, about.st_size, about.st_mtime_ns, content)
    return out


def faults(case: Case, before: dict, after: dict, ended: dict[str, Any]) -> list[str]:
    """What a case did that no input may cause."""
    out = [f"touched: {one}" for one in ended["touched"]]
    out += [f"changed: {name}" for name in before.keys() | after.keys() if before.get(name) != after.get(name)]
    lines = [line for line in ended["errors"].splitlines() if line.strip()]
    if ended["hung"]:
        out.append("hangs")
    elif ended["code"] not in ((0, 1, 2, 3) if case.kind == "exr" else (0, 2)):  # wrong, not judged
        out.append(f"exit code {ended['code']}")
    if "Traceback" in ended["errors"]:
        out.append("traceback")
    if ended["code"] == 2:
        errors = [line for line in lines if "error:" in line[:40]]
        if len(errors) != 1 or not lines[-1].startswith("taubench-gl: error: "):
            out.append(f"{len(errors)} lines of errors")
        elif len(lines[-1]) > 4 * MOST_CHARACTERS:
            out.append(f"a line of {len(lines[-1])} characters")
    out += [f"warning: {line}" for line in lines if re.search(r"\.py:\d+: \w*Warning", line)]
    if ended["bytes"] > MOST_BYTES and not REASON.search(ended["errors"]):
        out.append(f"{ended['bytes'] >> 20} MiB")
    if CONTROL.search(ended["printed"] + ended["errors"]):
        out.append("control characters")
    return out


def run_series(server: Any, folder: Path, seeds: Path, seed: int, numbers: range) -> Counter:
    """Run the cases; fails with all that did what none may.  -> how the cases of each kind ended."""
    found, ends = [], Counter()
    for number in numbers:
        inputs = folder / f"case{number}"
        case = make_case(number, seed, inputs, seeds)
        before = state(inputs)
        request = {"command": case.command, "folder": str(inputs), "named": str(case.named)}
        server.stdin.write(json.dumps(request) + "\n")
        server.stdin.flush()
        ended = json.loads(server.stdout.readline())
        wrong = faults(case, before, state(inputs), ended)
        ends[case.kind, {0: "read", 1: "read", 2: "refused", 3: "read"}.get(ended["code"], "fault")] += 1
        if wrong:
            what = f"case {number} ({' '.join(case.command)[:200]!r}): {'; '.join(wrong)}"
            found.append(f"{what}\n{ended['errors'][-1500:]}")
            print(found[-1], flush=True)
        shutil.rmtree(inputs)
    assert not found, f"{len(found)} of {len(numbers)} cases:\n" + "\n".join(found)
    return ends


def test_hostile_files(server, seeds, tmp_path):
    """A fixed series of cases, a few of which draw."""
    ends = run_series(server, tmp_path, seeds, 1, range(CASES))
    for kind in {kind for kind, _ in ends}:
        assert ends[kind, "refused"], f"every file of kind {kind} was read: the cases test nothing"
    assert sum(n for (_, end), n in ends.items() if end == "read") > CASES // 12, ends


@pytest.mark.long
def test_a_thousand_hostile_files(server, seeds, tmp_path):
    print(run_series(server, tmp_path, seeds, SEED, range(LONG_CASES)))
