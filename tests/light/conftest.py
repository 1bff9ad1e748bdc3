"""The GL context of the light tests; a clean GL error state is part of passing each of them."""

from __future__ import annotations

import pytest

from taubench_gl.gpu.context import Gpu, open_gpu


@pytest.fixture(scope="session")
def session_gpu() -> Gpu:
    return open_gpu()


@pytest.fixture
def gpu(session_gpu: Gpu):
    with session_gpu:
        assert session_gpu.ctx.error == "GL_NO_ERROR"
        yield session_gpu
        session_gpu.check("the test")
