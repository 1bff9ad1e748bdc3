"""Every hard case on EGL, and all cases on OSMesa in another process."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from taubench_gl.gpu.context import OSMESA_LIBRARIES, open_gpu, open_library
from taubench_gl.selftest import cases
from taubench_gl.selftest.bench import Bench
from taubench_gl.selftest.runner import run_case

CASES = cases()


@pytest.fixture(scope="module")
def bench():
    gpu = open_gpu("egl")
    with gpu:
        made = Bench(gpu)
        yield made
        made.release()
        gpu.check("the cases")


@pytest.mark.parametrize("name", [c.name for c in CASES])
def test_case(bench, name):
    result = run_case(next(c for c in CASES if c.name == name), bench)
    assert result.failure is None, result.failure
    assert result.passed, f"error {result.error} of {result.case.tolerance}: {result.expected} / {result.measured}"


@pytest.mark.long
@pytest.mark.parametrize("size", [(97, 61), (48, 32)])
def test_cases_pass_at_other_sizes(size):
    gpu = open_gpu("egl")
    with gpu:
        made = Bench(gpu, size)
        results = [run_case(c, made) for c in CASES if c.name != "more-than-2^24-pixels"]
        made.release()
    failed = [f"{r.name}: {r.error} {r.measured} {r.failure}" for r in results if not r.passed]
    assert not failed, "\n".join(failed)


@pytest.mark.long  # tests/drivers runs the quick cases on this driver
@pytest.mark.skipif(open_library(OSMESA_LIBRARIES) is None, reason="libOSMesa is not installed")
def test_all_cases_on_osmesa():
    """All cases run in another process, since a process can use only one backend."""
    command = [sys.executable, "-m", "taubench_gl", "selftest", "--backend", "osmesa", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode in (0, 1), done.stderr
    report = json.loads(done.stdout)
    assert report["provenance"]["backend"] == "osmesa"
    assert [c["name"] for c in report["cases"]] == [c.name for c in CASES]
    failed = [f"{c['name']}: {c['error']} {c['measured']} {c['failure']}" for c in report["cases"] if not c["passed"]]
    assert not failed and done.returncode == 0, "\n".join(failed)
