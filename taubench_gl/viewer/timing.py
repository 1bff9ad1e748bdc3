"""Milliseconds of the passes that ran last, for the panel; costs nothing while nobody looks."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from taubench_gl.gpu.context import Gpu

SMOOTH = 0.2


class LiveTimer:
    """Stands in for ``gpu.timing.PassTimer``: the latest times, smoothed, and only while ``enabled``."""

    clock = "finish + monotonic clock"

    def __init__(self, gpu: Gpu):
        self._gpu, self.enabled = gpu, False
        self.ms: dict[str, float] = {}

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        if not self.enabled:
            yield
            return
        self._gpu.finish()
        start = time.perf_counter()
        yield
        self._gpu.finish()
        taken = (time.perf_counter() - start) * 1e3
        self.ms[name] = taken + (1.0 - SMOOTH) * (self.ms.get(name, taken) - taken)
