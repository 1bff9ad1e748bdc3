"""Interleaved timing: configurations are kept open and visited in turn, so that drift of the machine affects all alike.

A round visits all configurations once, A B C A B C.  A visit runs the evaluation loop (``evaluation.PairEvaluator``,
counts read one pair late) over the same few frames.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import psutil

from taubench_gl.animation import CameraTrack
from taubench_gl.cost.configurations import Configuration
from taubench_gl.evaluation import frame_range, frame_schedule
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.memory import available_bytes
from taubench_gl.scene.model import Scene

TIMED, WARM = 4, 2
"""Frames timed in a visit, and frames drawn before them that are not timed."""

VISIT_MS, TURNS = 100.0, 16
"""The frames of a visit are drawn repeatedly until they took this long, at most so often.  The fastest turn counts:
other work of the machine can only add time.  If a single frame takes longer, only one is timed, after one that is not:
visits scatter nearly as much with four (by 8 to 16 % instead of 9 to 17 % on llvmpipe), at three times the time."""

MEMORY_SHARE = 0.4
"""Share of the free memory that open configurations may use."""

UNKNOWN_MEMORY = 4 << 30

Clock = Callable[[], float]
"""Seconds of a monotonic clock."""


class OutOfTime(Exception):
    """A time limit passed in the middle of a measurement, which is abandoned."""


class Deadline:
    """``limit`` seconds from now; None: no limit."""

    def __init__(self, limit: float | None):
        self._started, self._limit = time.monotonic(), math.inf if limit is None else limit

    def left(self, share: float = 1.0) -> float:
        """Seconds until this share of the limit has passed; negative afterwards."""
        return self._started + share * self._limit - time.monotonic()

    def check(self, share: float = 1.0) -> None:
        """Raises OutOfTime once this share of the limit has passed.  Called between the frames of a measurement."""
        if self.left(share) < 0.0:
            raise OutOfTime


class OpenConfiguration(GpuOwner):
    """One configuration, ready to draw.  Every ``visit`` evaluates the same frames."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        configuration: Configuration,
        now: Clock = time.perf_counter,
        check: Callable[[], None] = lambda: None,
    ):
        """``check`` is called between frames and may raise."""
        settings = configuration.settings
        super().__init__(gpu)
        self._now, self._check = now, check
        frames = frame_range(scene, camera, settings)
        schedule = frame_schedule(frames, settings)
        start = max(0, (len(schedule) - TIMED - WARM) // 2)
        window = schedule[start : start + TIMED + WARM]
        if not any(evaluated for _, evaluated in window[WARM:]):
            window = schedule[-(TIMED + WARM) :]
        warm = min(WARM, len(window) - 1, len(window) // 2)
        self._warm, self._timed = window[:warm], window[warm:]
        self._every = all(evaluated for _, evaluated in window)
        self._drawn_share = len(schedule) / len(frames)
        self._source = self.open_source(AnimatedScene(scene, camera), settings, without=configuration.without)
        self._evaluator = self.open_evaluator(self._source, settings)
        self._compiled = False
        if configuration.traced:  # a frame always takes long
            self._shorten()

    @property
    def bytes(self) -> int:
        return self._source.describe()["memory"]["gpu_bytes"]

    def visit(self) -> float:
        """Milliseconds per frame of the sequence.

        Sampled pairs draw fewer frames than the sequence has, or two per pair: the mean time of a drawn frame times the
        share of frames that are drawn.
        """
        if not self._compiled:  # shaders are compiled at their first use, some in the second frame
            if self._turn(self._timed[:1]) > VISIT_MS:
                self._shorten()
            self._compiled = True
        turns: list[float] = []
        while not turns or (len(turns) < TURNS and sum(turns) < VISIT_MS):
            turns.append(self._turn(self._timed))
        return min(turns) / len(self._timed) * self._drawn_share

    def _shorten(self) -> None:
        """Time one frame; of sampled pairs all, as not every frame is evaluated."""
        if self._every:
            self._warm, self._timed = self._warm[-1:], self._timed[:1]

    def _turn(self, timed: list[tuple[int, bool]]) -> float:
        """Evaluate the warm frames and ``timed``; milliseconds of the latter.

        The time starts and ends with one pair not read yet, as in the middle of a long run.
        """
        self._evaluator.restart()
        for frame, evaluate in self._warm:
            self._check()
            self._evaluator.step(frame, evaluate)
        start = self._now()
        for frame, evaluate in timed:
            self._check()
            self._evaluator.step(frame, evaluate)
        return 1e3 * (self._now() - start)


class OtherWork:
    """CPU seconds that other processes of the machine take while this context is open.

    The load average would not do: it lags by minutes, and counts this process.
    """

    seconds = other_seconds = 0.0

    def __enter__(self) -> OtherWork:
        psutil.cpu_percent()  # the next call gives that since this one
        self._started = time.monotonic(), time.process_time()
        return self

    def __exit__(self, *_: Any) -> None:
        started, own = self._started
        self.seconds = time.monotonic() - started
        used = 0.01 * psutil.cpu_percent() * psutil.cpu_count() * self.seconds
        self.other_seconds = used - (time.process_time() - own)


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

    def visit(self, configuration: Configuration) -> dict[str, Any]:
        """Open ``configuration`` if it is not open, and visit it: ``frame_ms``, and ``bytes`` that it allocates."""
        name = configuration.name
        opened = self._open.pop(name, None) or self._open_one(configuration)
        while self._open and opened.bytes + sum(o.bytes for o in self._open.values()) > self._budget:
            self._open.popitem()[1].release()
        self._open[name] = opened
        return {"frame_ms": opened.visit(), "bytes": opened.bytes}


def due_visits(
    configurations: Iterable[Configuration], rounds: int, done: Iterable[Mapping[str, Any]]
) -> list[tuple[int, Configuration]]:
    """(round, configuration) still to be timed, interleaved.  ``done``: records of visits.

    Path-traced configurations, which take long, have their first visit when the others have the three rounds that
    separate times.  Their further visits, and those of other pixels or pairs, come last: the answer needs neither.
    """
    counted = Counter(record["configuration"] for record in done)

    def order(visit: tuple[int, Configuration]) -> tuple[bool, float]:
        number, c = visit
        last = not c.comparable or (c.slow and number > 0)
        return last, 2.5 if c.slow and not last else number

    due = [(r, c) for r in range(rounds) for c in configurations if not c.on_cpu and counted[c.name] <= r]
    return sorted(due, key=order)


def rounds_of(visits: Iterable[Mapping[str, Any]], name: str) -> list[Mapping[str, Any]]:
    """Visits of one configuration in the order of their rounds."""
    return sorted((v for v in visits if v["configuration"] == name), key=lambda v: v["round"])
