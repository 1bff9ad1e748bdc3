"""Without a guard at least one of the cases that it names fails, and raises nothing."""

from __future__ import annotations

import pytest
from guards import GUARDS

from taubench_gl.gpu.context import open_gpu
from taubench_gl.selftest import cases, run_selftest

NAMES = {c.name for c in cases()}


@pytest.mark.parametrize("guard", GUARDS, ids=lambda g: g.name)
def test_a_case_fails_without_the_guard(guard):
    assert set(guard.detected_by) <= NAMES
    gpu = open_gpu("egl")
    with guard.disabled():
        results = run_selftest(gpu, only=guard.detected_by)
    failed = [r.name for r in results if r.name in guard.detected_by and not r.passed and r.failure is None]
    assert failed, [(r.name, r.error, r.failure) for r in results]
