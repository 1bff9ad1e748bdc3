"""Masks and counts of every pair of frames, from any Source: the rasterizer's or path-traced files."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import COLUMNS, FEATURES
from taubench_gl.evaluation.schedule import Schedule, frame_schedule, sampled_pairs
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.frame.passes.masks import Counts, MaskPass
from taubench_gl.frame.sources import Source
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.activity import camera_activity
from taubench_gl.run import Progress, RunWriter
from taubench_gl.settings import Settings


@dataclass(frozen=True, slots=True)
class Pair:
    """One finished pair, while its images are still on the GPU."""

    frame: int
    row: dict[str, Any]
    view: View
    source: Source
    _masks: MaskPass

    def mask(self) -> np.ndarray:
        """Reason words, (h, w) uint32, row 0 at the top."""
        return read_channel(self._masks.mask, "mask")[..., 0]

    def motion(self) -> np.ndarray:
        """Previous - current, pixels, +x right, +y down.  (h, w, 2) float32; 0 where behind."""
        return read_channel(self._masks.motion, "motion")


def count_pairs(
    gpu: Gpu,
    source: Source,
    frames: range,
    settings: Settings,
    name: str,
    timer: PassTimer,
    writer: RunWriter | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_pair: Callable[[Pair], None] | None = None,
    *,
    schedule: Schedule | None = None,
    keep: list[Counts] | None = None,
) -> tuple[list[dict[str, Any]], list[View], SequenceStats]:
    """Masks and counts of every pair of a source: rows of frames.csv, views of all frames, sums over all pairs.

    ``schedule``: only these frames (as ``pair_schedule``); ``keep`` takes the exact counts of each pair.  What was
    judged before a KeyboardInterrupt is still counted, and told to all who listen.
    """
    if schedule is None:
        schedule = frame_schedule(frames, sampled_pairs(frames, settings))
    judge = _Judge(gpu, source, settings, timer, images=on_pair is not None)
    rows = _Rows(judge, name, sum(judged for _, judged in schedule), writer, progress, on_pair, keep)
    views: list[View] = []
    waiting: deque[_Judged] = deque()

    def finish(but: int = 0) -> None:
        while len(waiting) > but:
            rows.take(waiting.popleft())

    try:
        for frame, judged in schedule:
            view, pair = judge.step(frame, judged)
            views.append(view)
            if pair is None:
                continue
            waiting.append(pair)
            # Counts are read one pair late, when the GPU has the next one to do; at once where images go with them.
            finish(but=int(judge.late))
            if judge.late:
                pair.ended = time.perf_counter()
        finish()
    except KeyboardInterrupt:
        finish()  # judged, only not read yet
        raise
    finally:
        judge.release()
    return rows.rows, views, rows.stats


@dataclass(slots=True)
class _Judged:
    """A pair that the mask pass has been given."""

    frame: int
    view: View  # of the frame, pixel centres
    both: tuple[View, View]  # of the frame before and of this one
    found: Counts | int  # the number of the mask pass's run until the counts are read
    started: float  # seconds of the monotonic clock
    ended: float | None = None  # when the CPU was done with it, if that was before its counts were read


class _Judge:
    """Draws the frames of a source and submits each pair to the mask pass, once for every sample within a pixel."""

    def __init__(self, gpu: Gpu, source: Source, settings: Settings, timer: PassTimer, *, images: bool):
        """``images``: masks and motion are wanted too, so that they must be there when a pair is finished."""
        self.source, self.settings = source, settings
        self.late = settings.metrics.samples_per_pixel == 1 and not images
        self._timer = timer
        self._thresholds = {f: settings.metrics.threshold(f) for f in FEATURES}
        self._shaders = ShaderCache(gpu.ctx)
        self.masks = MaskPass(
            gpu,
            self._shaders,
            source.size,
            reprojection=source.reprojection,
            sampling=settings.metrics.sampling,
            radiance=source.radiance,
            cuts=source.cuts,
            write_mask=images,
            write_motion=images,
            histogram_bits=settings.metrics.histogram_bits,
        )
        self._last: list[View] = []  # per sample within a pixel, of the frame drawn before

    def step(self, frame: int, judged: bool) -> tuple[View, _Judged | None]:
        """Draw ``frame``: its view, and its pair with the frame drawn before where that is judged."""
        started = time.perf_counter()
        seen: list[View] = []
        found: Counts | int | None = None
        for sample in range(self.settings.metrics.samples_per_pixel):
            seen.append(self._draw(frame, sample))
            if judged:
                run = self._compare(seen[-1], self._last[sample])
                one = run if self.late else self.masks.read()
                found = one if found is None else found + one
        before, self._last = self._last, seen
        view = seen[0].centered()
        if found is None:
            return view, None
        return view, _Judged(frame, view, (before[0], seen[0]), found, started)

    def _draw(self, frame: int, sample: int) -> View:
        if self.settings.metrics.samples_per_pixel == 1:
            return self.source.advance(frame)
        return self.source.advance_sample(frame, sample)

    def _compare(self, view: View, before: View) -> int:
        """Submit the mask pass; the number of its run."""
        source = self.source
        with self._timer.measure("masks"):
            pair = reprojection(view, before, *source.size)
            return self.masks.run(
                pair, self._thresholds, source.current, source.previous, exposure=self.settings.lighting.exposure
            )

    def counts(self, judged: _Judged) -> Counts:
        """Of a pair; waits for the GPU where they have not been read yet."""
        return self.masks.read(judged.found) if isinstance(judged.found, int) else judged.found

    def release(self) -> None:
        self.masks.release()
        self._shaders.release()


class _Rows:
    """Takes in finished pairs: sums, rows of frames.csv, and whoever wants to hear of each."""

    def __init__(
        self,
        judge: _Judge,
        name: str,
        total: int,
        writer: RunWriter | None,
        progress: Callable[[Progress], None] | None,
        on_pair: Callable[[Pair], None] | None,
        keep: list[Counts] | None,
    ):
        self._judge, self._name, self._total = judge, name, total
        self._writer, self._progress, self._on_pair, self._keep = writer, progress, on_pair, keep
        unmeasured, settings = dict(judge.source.unmeasured), judge.settings
        self.stats = SequenceStats(
            tuple(c for c in COLUMNS if c not in unmeasured),
            unmeasured,
            summation=settings.metrics.summation,
            histogram_bits=settings.metrics.histogram_bits,
        )
        self.rows: list[dict[str, Any]] = []

    def take(self, pair: _Judged) -> None:
        """Read a pair's counts and tell of them."""
        judge, found = self._judge, self._judge.counts(pair)
        time_s = pair.frame / judge.settings.sequence.fps
        moved = _camera_row(pair.both, judge.settings.metrics.unit_scale)
        row = {"frame": pair.frame, "time_s": time_s, **self.stats.add(found), **moved}
        self.rows.append(row)
        if self._keep is not None:
            self._keep.append(found)
        if self._writer is not None:
            self._writer.write_row(row)
        if self._on_pair is not None:
            self._on_pair(Pair(pair.frame, row, pair.view, judge.source, judge.masks))
        if self._progress is not None:
            seconds = (pair.ended or time.perf_counter()) - pair.started
            self._progress(Progress(self._name, len(self.rows), self._total, seconds))


def _camera_row(views: tuple[View, View], unit_scale: float) -> dict[str, Any]:
    """How the camera moved between two frames, as columns of frames.csv; ``unit_scale``: scene units per metre."""
    activity = camera_activity(np.array([v.position for v in views]), np.array([v.world_from_view for v in views]))
    return {
        "translation_m": float(activity.position[0]) / unit_scale,
        "yaw_deg": float(activity.yaw[0]),
        "pitch_deg": float(activity.pitch[0]),
        "roll_deg": float(activity.roll[0]),
        "angle_deg": float(activity.angle[0]),
        "gimbal": bool(activity.gimbal[0]),
    }
