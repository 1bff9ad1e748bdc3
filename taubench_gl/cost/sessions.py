"""Timing: settings held ready to draw, visited in turn, so that drift of the machine hits all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import FEATURES
from taubench_gl.cost.errors import Twin
from taubench_gl.cost.plan import Setting
from taubench_gl.evaluation import frame_range, frame_schedule, sampled_pairs
from taubench_gl.frame.passes.masks import MaskPass
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.memory import available_bytes
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.scene.model import Scene

TIMED, WARM = 4, 2
"""Frames timed in a visit, and frames drawn before them that are not."""

VISIT_MS, TURNS = 100.0, 16
"""Short frames are drawn over and over until they have taken this long together, at most so many times.  Of each frame
the fastest turn counts: what else a machine does only adds to a time, and must not decide between settings."""

MEMORY_SHARE = 0.4
"""Of the memory that is free, what settings held ready may take together."""

UNKNOWN_MEMORY = 4 << 30


class Session:
    """One setting, ready to draw.  ``visit`` draws the same frames every time.

    What is timed is a frame as an evaluation has it: pose, passes, masks, and the counts' way back.  Summing the counts
    over pairs comes once at the end of a run and is not in it.
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
        self._settings = settings
        frames = frame_range(scene, camera, settings)
        schedule = frame_schedule(frames, sampled_pairs(frames, settings))
        start = max(0, (len(schedule) - TIMED - WARM) // 2)
        self._window = schedule[start : start + TIMED + WARM]
        if not any(judged for _, judged in self._window[WARM:]):
            self._window = schedule[-(TIMED + WARM) :]
        # Per frame of the sequence: how many frames are drawn, judged or only as history.
        self._share = {kind: sum(j is kind for _, j in schedule) / len(frames) for kind in (True, False)}
        self._twin = Twin(gpu, scene, camera, settings, timer=timer) if setting.twin else None
        self._source = self._twin.source if self._twin else RasterSource(
            gpu, scene, camera, settings, timer=timer, poser=Poser(scene)
        )  # fmt: skip
        self._shaders = ShaderCache(gpu.ctx)
        self._masks = MaskPass(
            gpu,
            self._shaders,
            self._source.size,
            reprojection=self._source.reprojection,
            sampling=settings.metrics.sampling,
            radiance=self._source.radiance,
            cuts=self._source.cuts,
        )
        self._thresholds = {f: settings.metrics.threshold(f) for f in FEATURES}
        self._fresh = True

    @property
    def bytes(self) -> int:
        return self._source.describe()["memory"]["gpu_bytes"]

    def visit(self) -> dict[str, Any]:
        """Times of one visit: ``frame_ms``, milliseconds per frame of the whole sequence, and of a drawn frame by pass.

        A sampled run draws fewer frames, or two for every pair: ``frame_ms`` counts what it draws, over all frames.
        """
        if self._fresh:  # shaders are compiled at their first draw, some only at their second frame
            self._draw_window()
            self._fresh = False
        drawn = self._draw_repeatedly()
        means = {kind: [ms for judged, ms in drawn if judged is kind] for kind in (True, False)}
        cost = 0.0
        for kind, share in self._share.items():
            cost += share * float(np.mean(means[kind] or means[not kind]))
        passes = {name: float(v.sum()) / len(drawn) for name, v in self._timer.samples_ms().items()}
        return {"frame_ms": cost, "drawn_ms": [ms for _, ms in drawn], "passes": passes}

    def _draw_repeatedly(self) -> list[tuple[bool, float]]:
        """(judged, milliseconds) of every frame, the least of as many turns as ``VISIT_MS`` asks for."""
        turns: list[list[tuple[bool, float]]] = []
        while not turns or (len(turns) < TURNS and sum(ms for turn in turns for _, ms in turn) < VISIT_MS):
            turns.append(self._draw_window())
        least = np.min([[ms for _, ms in turn] for turn in turns], axis=0)
        return [(judged, float(ms)) for (judged, _), ms in zip(turns[0], least, strict=True)]

    def _draw_window(self) -> list[tuple[bool, float]]:
        """(judged, milliseconds) of the frames after the warm ones; the timer holds their passes alone."""
        if self._twin is not None:
            self._twin.forget()
        warm = min(WARM, len(self._window) - 1)
        last: list[Any] = []
        out = []
        for i, (frame, judged) in enumerate(self._window):
            if i == warm:
                self._timer.reset()
            self._gpu.finish()
            start = self._now()
            last = self._draw(frame, judged and bool(last), last)
            self._gpu.finish()
            if i >= warm:
                out.append((judged, 1e3 * (self._now() - start)))
        return out

    def _draw(self, frame: int, judged: bool, last: list[Any]) -> list[Any]:
        if self._twin is not None:
            self._twin.step(frame)
            return [True]
        seen = []
        for sample in range(self._settings.metrics.samples_per_pixel):
            one = self._settings.metrics.samples_per_pixel == 1
            seen.append(self._source.advance(frame) if one else self._source.advance_sample(frame, sample))
            if judged:
                with self._timer.measure("masks"):
                    pair = reprojection(seen[-1], last[sample], *self._source.size)
                    current, previous = self._source.current, self._source.previous
                    self._masks.run(
                        pair, self._thresholds, current, previous, exposure=self._settings.lighting.exposure
                    )
                    self._masks.read()
        return seen

    def release(self) -> None:
        self._masks.release()
        self._shaders.release()
        self._source.release()
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
