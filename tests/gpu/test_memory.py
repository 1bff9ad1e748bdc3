"""An image larger than memory is refused before anything is allocated."""

from __future__ import annotations

import pytest

from taubench_gl.errors import GraphicsError
from taubench_gl.frame.targets import History
from taubench_gl.gpu import memory

pytestmark = pytest.mark.usefixtures("own_programs")


def test_history_that_does_not_fit(gpu, monkeypatch):
    if not gpu.software:
        pytest.skip("only software rendering lives in the machine's own memory")
    monkeypatch.setattr(memory, "available_bytes", lambda: 1_000_000)
    objects = len(gpu.ctx.objects)
    with pytest.raises(GraphicsError, match="256x256"):
        History(gpu, (256, 256), ("position", "normal"))
    assert len(gpu.ctx.objects) == objects
    History(gpu, (16, 16), ("position", "normal")).release()


def test_unknown_is_no_reason_to_refuse(gpu, monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: None)
    memory.require_memory(gpu, 10**15, "anything", "never mind")
