"""Time of passes: by a GPU timer only where a probe has proven it, else by finish() and the monotonic clock.

Timer queries on llvmpipe are meaningless (a 100 ms pass reads 1 ns), so every sample carries the name of its clock.
"""

from __future__ import annotations

import statistics
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner

WALL_CLOCK = "finish + monotonic clock"
MAX_SAMPLES = 4096
"""Samples kept per pass, the latest: memory does not grow with the number of frames."""

_PROBE_SOURCE = """#version 450
layout(local_size_x = 64) in;
layout(std430, binding = 0) buffer Sink { uint sink[]; };
uniform uint rounds;
void main() {
    uint x = gl_GlobalInvocationID.x;
    for (uint i = 0u; i < rounds; ++i) x = x * 1664525u + 1013904223u;
    sink[gl_GlobalInvocationID.x] = x;
}
"""


@dataclass(frozen=True, slots=True)
class TimerVerdict:
    usable: bool
    why: str
    gpu_ms: float
    wall_ms: float


@contextmanager
def wall_time(gpu: Gpu, record: Callable[[float], None]) -> Iterator[None]:
    """Call ``record`` with the milliseconds of the block by WALL_CLOCK: waits for the GPU before and after it."""
    gpu.finish()
    start = time.perf_counter()
    yield
    gpu.finish()
    record((time.perf_counter() - start) * 1e3)


def probe_timer(gpu: Gpu) -> TimerVerdict:
    """Run one pass of known weight under both clocks; the GPU timer is usable if it sees most of the wall time."""
    with Owner() as owner:
        owner.own(gpu.ctx.buffer(reserve=4 * 64 * 1024)).bind_to_storage_buffer(0)
        program = owner.own(gpu.ctx.compute_shader(_PROBE_SOURCE))
        program["rounds"] = 2000 if gpu.software else 200_000
        program.run(16)
        query, times = gpu.ctx.query(time=True), []
        with wall_time(gpu, times.append), query:
            program.run(1024)
        wall_ms, gpu_ms = times[0], query.elapsed * 1e-6
    usable = 0.5 * wall_ms <= gpu_ms <= 1.5 * wall_ms
    why = f"a pass of {wall_ms:.2f} ms by the wall clock reads {gpu_ms:.2f} ms"
    return TimerVerdict(usable, why, gpu_ms, wall_ms)


class PassTimer:
    """Milliseconds by pass name, the latest MAX_SAMPLES.  Waits before and after each pass: exact, without overlap.

    A long run therefore times only some passes: the first ``first`` calls of each name and every ``every``-th after
    them (default: all).  Otherwise, and with ``enabled=False``, it costs nothing and never waits.
    """

    clock = WALL_CLOCK

    def __init__(self, gpu: Gpu, enabled: bool = True, *, first: int = 0, every: int = 1):
        self._gpu, self.enabled = gpu, enabled
        self._first, self._every = first, every
        self._samples: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=MAX_SAMPLES))
        self._calls: dict[str, int] = defaultdict(int)

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        call = self._calls[name]
        self._calls[name] += 1
        if not self.enabled or (call >= self._first and call % self._every):
            yield
            return
        with wall_time(self._gpu, self._samples[name].append):
            yield

    def median_ms(self, skip: int = 1) -> dict[str, float]:
        """Median per pass without the first ``skip`` samples (shader compilation, first touch of memory)."""
        return {k: statistics.median(list(v)[skip:] or v) for k, v in self._samples.items()}

    def reset(self) -> None:
        """Discard the samples of all passes."""
        self._samples.clear()

    def summary(self) -> dict[str, Any]:
        """The block ``timing`` of summary.json: the clock, medians in ms, and the number of samples of each."""
        samples = {name: len(values) for name, values in self._samples.items()}
        return {"clock": self.clock, "unit": "ms", "passes": self.median_ms(), "samples": samples}

    def samples_ms(self) -> dict[str, np.ndarray]:
        return {k: np.array(v) for k, v in self._samples.items()}
