"""A selftest bench on EGL for the tests of this folder."""

from __future__ import annotations

import pytest

from taubench_gl.gpu.context import open_gpu
from taubench_gl.selftest.bench import Bench


@pytest.fixture(scope="module")
def bench():
    gpu = open_gpu("egl")
    with gpu:
        made = Bench(gpu, (64, 40))
        yield made
        made.release()
        gpu.check("property tests")
