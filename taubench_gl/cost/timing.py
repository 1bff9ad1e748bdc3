"""Interleaved timing: configurations are kept open and visited in turn, so that drift of the machine affects all alike.

A round visits all configurations once, A B C A B C.  A visit
runs the evaluation loop (``evaluation.PairEvaluator``, counts read one pair late) over the same few frames.
"""

from __future__ import annotations

import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.cost.configurations import Configuration
from taubench_gl.evaluation import PairEvaluator, frame_range, frame_schedule
from taubench_gl.frame.sources import RasterSource, SourceOptions
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.memory import available_bytes
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer, TimerVerdict
from taubench_gl.scene.model import Scene

GPU_CLOCK = "GPU timer query, checked against the wall clock"

TIMED, WARM = 4, 2
"""Frames timed in a visit, and frames drawn before them that are not timed."""

VISIT_MS, TURNS = 100.0, 16
"""The frames of a visit are drawn repeatedly until they took this long, at most so often.  The fastest turn counts:
other work of the machine can only add time."""

MEMORY_SHARE = 0.4
"""Share of the free memory that open configurations may use."""

UNKNOWN_MEMORY = 4 << 30

Clock = Callable[[], float]
"""Seconds of a monotonic clock."""


class StudyTimer(PassTimer):
    """Times passes only while ``enabled``, so that frames are timed without waits between passes.

    Uses the GPU's timer queries where ``verdict`` found them usable, else ``finish()`` and the wall clock.
    """

    def __init__(self, gpu: Gpu, verdict: TimerVerdict):
        super().__init__(gpu, enabled=False)
        self._queries = verdict.usable
        if verdict.usable:
            self.clock = GPU_CLOCK

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        if not (self.enabled and self._queries):
            with super().measure(name):
                yield
        else:
            query = self._gpu.ctx.query(time=True)
            with query:
                yield
            self._samples[name].append(query.elapsed * 1e-6)  # nanoseconds; reading it waits for the pass


class OpenConfiguration:
    """One configuration, ready to draw.  Every ``visit`` evaluates the same frames."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        configuration: Configuration,
        timer: StudyTimer,
        now: Clock = time.perf_counter,
    ):
        settings = configuration.settings
        self._gpu, self._timer, self._now = gpu, timer, now
        frames = frame_range(scene, camera, settings)
        schedule = frame_schedule(frames, settings)
        start = max(0, (len(schedule) - TIMED - WARM) // 2)
        window = schedule[start : start + TIMED + WARM]
        if not any(evaluated for _, evaluated in window[WARM:]):
            window = schedule[-(TIMED + WARM) :]
        if configuration.traced:  # a frame takes long, and always the same
            window = window[WARM - 1 : WARM + 1]
        warm = min(WARM, len(window) - 1, len(window) // 2)
        self._warm, self._timed = window[:warm], window[warm:]
        self._drawn_share = len(schedule) / len(frames)
        self._context = GpuContext(gpu, timer=timer)
        options = SourceOptions(without=configuration.without)
        self._source = RasterSource(gpu, scene, camera, settings, options, timer=timer, poser=Poser(scene))
        self._evaluator = PairEvaluator(self._context, self._source, settings)
        self._compiled = False

    @property
    def bytes(self) -> int:
        return self._source.describe()["memory"]["gpu_bytes"]

    def visit(self, passes: bool = False) -> dict[str, Any]:
        """``frame_ms``: milliseconds per frame of the sequence; ``passes``: milliseconds per drawn frame by pass.

        Sampled pairs draw fewer frames than the sequence has, or two per pair: ``frame_ms`` is the mean time of a drawn
        frame times the share of frames that are drawn.  ``passes``: time one more turn, pass by pass.
        """
        if not self._compiled:  # shaders are compiled at their first use, some in the second frame
            self._turn()
            self._compiled = True
        turns: list[float] = []
        while not turns or (len(turns) < TURNS and sum(turns) < VISIT_MS):
            turns.append(self._turn())
        found: dict[str, Any] = {"frame_ms": min(turns) / len(self._timed) * self._drawn_share}
        if passes:
            self._timer.reset()
            self._turn(passes=True)
            samples = self._timer.samples_ms()
            found["passes"] = {name: float(ms.sum()) / len(self._timed) for name, ms in samples.items()}
        return found

    def _turn(self, passes: bool = False) -> float:
        """Evaluate the warm and the timed frames; milliseconds of the timed ones.

        The time starts and ends with one pair not read yet, as in the middle of a long run.
        """
        self._evaluator.restart()
        for frame, evaluate in self._warm:
            self._evaluator.step(frame, evaluate)
        self._timer.enabled = passes
        start = self._now()
        for frame, evaluate in self._timed:
            self._evaluator.step(frame, evaluate)
        milliseconds = 1e3 * (self._now() - start)
        self._timer.enabled = False
        return milliseconds

    def release(self) -> None:
        self._evaluator.release()
        self._context.release()
        self._source.release()
        self._gpu.collect()


class Pool:
    """Configurations kept open as far as memory allows.

    All are visited in the same order again and again, so the one visited last is needed last and is closed first.
    """

    def __init__(self, open_one: Callable[[Configuration], OpenConfiguration], software: bool):
        free = available_bytes() if software else None
        self._budget = UNKNOWN_MEMORY if free is None else int(MEMORY_SHARE * free)
        self._open_one = open_one
        self._open: dict[str, OpenConfiguration] = {}  # the one visited last is last

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: Any) -> None:
        while self._open:
            self._open.popitem()[1].release()

    def visit(self, configuration: Configuration, passes: bool = False) -> dict[str, Any]:
        """Open ``configuration`` if it is not open, and visit it."""
        name = configuration.name
        opened = self._open.pop(name, None) or self._open_one(configuration)
        while self._open and opened.bytes + sum(o.bytes for o in self._open.values()) > self._budget:
            self._open.popitem()[1].release()
        self._open[name] = opened
        return opened.visit(passes)

    def bytes_of(self, configuration: Configuration) -> int:
        """Allocated by the configuration visited last."""
        return self._open[configuration.name].bytes


def due_visits(
    configurations: Iterable[Configuration], rounds: int, done: Iterable[Mapping[str, Any]]
) -> list[tuple[int, Configuration]]:
    """(round, configuration) still to be timed, interleaved.  ``done``: records of visits."""
    counted = Counter(record["configuration"] for record in done)
    timed = [c for c in configurations if not c.on_cpu]
    return [(r, c) for r in range(rounds) for c in timed if counted[c.name] <= r]


def rounds_of(visits: Iterable[Mapping[str, Any]], name: str) -> list[Mapping[str, Any]]:
    """Visits of one configuration in the order of their rounds: ``frame_ms``, and ``passes`` of the first."""
    return sorted((v for v in visits if v["configuration"] == name), key=lambda v: v["round"])


def median_passes(rounds: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Milliseconds of a drawn frame by pass, medians over rounds; 0 where a round lacks the pass."""
    timed = [r["passes"] for r in rounds if r.get("passes")]
    names = sorted({name for passes in timed for name in passes})
    return {n: statistics.median(passes.get(n, 0.0) for passes in timed) for n in names}
