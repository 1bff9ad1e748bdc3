"""Timing: configurations held ready to draw and visited in turn, so that drift of the machine affects all alike."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from typing import Any

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.cost.errors import Twin
from taubench_gl.cost.plan import Setting
from taubench_gl.evaluation import PairEvaluator, frame_range, frame_schedule, sampled_pairs
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.memory import available_bytes
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.scene.model import Scene

TIMED, WARM = 4, 2
"""Frames timed in a visit, and frames drawn before them that are not."""

VISIT_MS, TURNS = 100.0, 16
"""A visit repeats its frames until the timed ones took this long together, at most this many times.  The fastest turn
counts: other load on the machine only adds to a time, and must not decide between configurations."""

MEMORY_SHARE = 0.4
"""Share of the free memory that open sessions may take together."""

UNKNOWN_MEMORY = 4 << 30


class Session:
    """One configuration, ready to draw.  ``visit`` draws the same frames every time.

    It times ``PairEvaluator.step``, the loop of an evaluation: pose, passes, masks, and counts read back one pair late.
    Sums over pairs are computed once at the end of a run and are not included.
    """

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        setting: Setting,
        timer: PassTimer,
        now: Callable[[], float] = time.perf_counter,
    ):
        """``now``: seconds of a clock that never goes back."""
        self._gpu, self._timer, self._now, settings = gpu, timer, now, setting.settings
        frames = frame_range(scene, camera, settings)
        schedule = frame_schedule(frames, sampled_pairs(frames, settings))
        start = max(0, (len(schedule) - TIMED - WARM) // 2)
        self._window = schedule[start : start + TIMED + WARM]
        if not any(evaluate for _, evaluate in self._window[WARM:]):
            self._window = schedule[-(TIMED + WARM) :]
        self._share = len(schedule) / len(frames)  # frames drawn per frame of the sequence
        self._context = GpuContext(gpu, timer=timer)
        self._twin = Twin(gpu, scene, camera, settings, timer=timer) if setting.twin else None
        self._source = self._twin.source if self._twin else RasterSource(
            gpu, scene, camera, settings, timer=timer, poser=Poser(scene)
        )  # fmt: skip
        self._evaluator = PairEvaluator(self._context, self._source, settings)
        self._passes: dict[str, float] | None = None

    @property
    def bytes(self) -> int:
        return self._source.describe()["memory"]["gpu_bytes"]

    def visit(self) -> dict[str, Any]:
        """``frame_ms``, milliseconds per frame of the whole sequence; ``drawn_ms`` of each frame of the fastest turn;
        ``passes``, milliseconds of each pass in a drawn frame.

        A sampled run draws fewer frames, or two for every pair: ``frame_ms`` is the time of the frames it draws divided
        by all frames.
        """
        if self._passes is None:
            self._passes = self._time_passes()
        turns: list[list[float]] = []
        while not turns or (len(turns) < TURNS and sum(map(sum, turns)) < VISIT_MS):
            turns.append(self._draw_window())
        fastest = min(turns, key=sum)
        return {
            "frame_ms": self._share * sum(fastest) / len(fastest),
            "drawn_ms": fastest,
            "passes": dict(self._passes),
        }

    def _time_passes(self) -> dict[str, float]:
        """Milliseconds of each pass in a drawn frame.

        The first turn of a session, which compiles the shaders in its warm frames.  Timing a pass waits for it, so the
        turns that time whole frames have the timer switched off.
        """
        self._timer.enabled = True
        count = len(self._draw_window())
        self._timer.enabled = False
        return {name: float(v.sum()) / count for name, v in self._timer.samples_ms().items()}

    def _draw_window(self) -> list[float]:
        """Milliseconds of each frame after the warm ones; the timer holds the passes of these frames alone.

        A time runs from the end of one step to the end of the next.  Steps do not wait for the frame they submit but
        for the one before, so only the sum over a turn is exact.
        """
        if self._twin is not None:
            self._twin.forget()
        self._evaluator.restart()
        warm = min(WARM, len(self._window) - 1)
        times: list[float] = []
        for i, (frame, evaluate) in enumerate(self._window):
            if i == warm:
                self._timer.reset()
                times.append(self._now())
            if self._twin is not None:
                self._twin.step(frame)
            else:
                self._evaluator.step(frame, evaluate)
            if i >= warm:
                times.append(self._now())
        self._gpu.finish()
        return [1e3 * (after - before) for before, after in itertools.pairwise(times)]

    def release(self) -> None:
        self._evaluator.release()
        self._source.release()
        self._context.release()
        self._gpu.collect()


class Pool:
    """Sessions kept open as far as memory goes.

    Settings are visited round after round in the same order; then the one visited last is the one needed latest, so it
    is the one closed for want of memory.
    """

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        timer: Callable[[], PassTimer],
        now: Callable[[], float] = time.perf_counter,
    ):
        self._make = lambda setting: Session(gpu, scene, camera, setting, timer(), now)
        free = available_bytes() if gpu.software else None
        self._budget = UNKNOWN_MEMORY if free is None else int(MEMORY_SHARE * free)
        self._open: dict[str, Session] = {}
        self._order: list[str] = []

    def session(self, setting: Setting) -> Session:
        """The session of ``setting``, opened if need be."""
        if setting.name not in self._open:
            self._open[setting.name] = self._make(setting)
        if setting.name in self._order:
            self._order.remove(setting.name)
        while self._order and sum(s.bytes for s in self._open.values()) > self._budget:
            self._open.pop(self._order.pop()).release()
        self._order.append(setting.name)
        return self._open[setting.name]

    def close(self) -> None:
        for session in self._open.values():
            session.release()
        self._open.clear()
        self._order.clear()
