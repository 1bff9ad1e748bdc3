"""Each guard is switched off on purpose, and at least one case that names it must fail: not crash, fail."""

from __future__ import annotations

import pytest

from taubench_gl.gpu.context import open_gpu
from taubench_gl.selftest import cases, run_selftest
from taubench_gl.selftest.guards import GUARDS

NAMES = {c.name for c in cases()}


@pytest.mark.parametrize("guard", GUARDS, ids=lambda g: g.name)
def test_a_case_notices(guard):
    assert set(guard.noticed_by) <= NAMES
    gpu = open_gpu("egl")
    with guard.off():
        results = run_selftest(gpu, only=guard.noticed_by)
    noticed = [r.name for r in results if r.name in guard.noticed_by and not r.passed and r.failure is None]
    assert noticed, [(r.name, r.error, r.failure) for r in results]
    again = run_selftest(gpu, only=guard.noticed_by)
    assert all(r.passed for r in again), [(r.name, r.error, r.failure) for r in again]


def test_names_are_unique():
    assert len({g.name for g in GUARDS}) == len(GUARDS)
