"""Masks and counts of frame pairs, from any Source: the rasterizer or path-traced files."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection as reprojection_of
from taubench_gl.conventions import COLUMNS, FEATURES
from taubench_gl.evaluation.brightness import Brightness, checked_frames
from taubench_gl.evaluation.schedule import Schedule
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.frame.passes.masks import ComparedSource, Counts, MaskPass
from taubench_gl.frame.sources import Source
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.activity import camera_activity
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.run import Progress, RunWriter
from taubench_gl.settings import Settings

Textures = Mapping[str, Any]
"""Channel name -> GL texture."""


@dataclass(slots=True)
class ChannelPair:
    """Channels of two frames that no Source holds, such as uploaded arrays, in the form of a source."""

    size: tuple[int, int]  # width, height in pixels
    current: Textures = field(default_factory=dict)
    previous: Textures = field(default_factory=dict)
    reprojection: str = "camera"  # camera | motion; motion needs ``prev_position`` in ``current``
    radiance: tuple[str, ...] = ()  # of direct, indirect, color: those both frames have
    cuts: bool = False  # ``current`` has ``ids`` that mark surfaces without history


@dataclass(slots=True)
class EvaluatedPair:
    """A pair of frames that was submitted to the mask pass; ``counts`` once they are read back."""

    frame: int  # number of the current frame
    view: View  # of the current frame, through pixel centers
    views: tuple[View, View]  # previous and current, of the first sample
    started: float  # seconds of the monotonic clock
    ended: float = 0.0  # when the CPU had nothing left to do for the pair but read its counts
    run: int = 0  # of the mask pass, for ``MaskPass.read``
    counts: Counts | None = None

    @property
    def seconds(self) -> float:
        """Wall-clock time from drawing the frame to ``ended``."""
        return self.ended - self.started


class PairEvaluator:
    """Source -> mask pass -> counts: the one place where the channels of two frames are compared.

    ``step`` draws the frames of a source one after another and evaluates their pairs.  ``submit`` and ``compare``
    evaluate a pair of frames that the caller drew.  ``release`` frees the mask pass; ``context`` stays the caller's.
    """

    def __init__(
        self,
        context: GpuContext,
        source: Source | ComparedSource,
        settings: Settings,
        *,
        images: bool = False,
        reprojection: str | None = None,
        radiance: tuple[str, ...] | None = None,
    ):
        """``images``: write mask and motion images too.  ``reprojection``, ``radiance``: None: the source's."""
        self.source, self.settings = source, settings
        self._samples = settings.metrics.samples_per_pixel
        # Counts are read one pair late, while the GPU works on the next pair; at once where images go with them.
        self.deferred = self._samples == 1 and not images
        self._timer = context.timer
        self._thresholds = {f: settings.metrics.threshold(f) for f in FEATURES}
        self._masks = MaskPass.for_source(
            context,
            source,
            settings,
            reprojection=reprojection,
            radiance=radiance,
            write_mask=images,
            write_motion=images,
        )
        self._previous: list[View] = []  # views of the frame drawn last, one per sample within a pixel
        self._pending: deque[EvaluatedPair] = deque()

    def step(self, frame: int, evaluate: bool = True) -> tuple[View, list[EvaluatedPair]]:
        """Draw ``frame`` and, if ``evaluate``, submit its pair with the frame drawn before; read finished counts.

        Returns the view of the frame through pixel centers, and the pairs whose counts are read: with ``deferred`` the
        pair before this one, else this one, whose images stay valid until the next call.
        """
        started = time.perf_counter()
        evaluate = evaluate and bool(self._previous)
        views: list[View] = []
        counts: Counts | None = None
        run = 0
        for sample in range(self._samples):
            views.append(self._draw(frame, sample))
            if evaluate:
                run = self.submit(reprojection_of(views[-1], self._previous[sample], *self.source.size))
                if not self.deferred:
                    one = self._masks.read(run)
                    counts = one if counts is None else counts + one
        previous, self._previous = self._previous, views
        view = views[0].centered()
        if not evaluate:
            return view, []
        pair = EvaluatedPair(frame, view, (previous[0], views[0]), started, run=run, counts=counts)
        self._pending.append(pair)
        finished = self.finish(but=int(self.deferred))
        pair.ended = time.perf_counter()
        return view, finished

    def finish(self, but: int = 0) -> list[EvaluatedPair]:
        """Read the counts of submitted pairs, all but the last ``but`` of them, and return these pairs in order."""
        finished = []
        while len(self._pending) > but:
            pair = self._pending[0]
            if pair.counts is None:
                pair.counts = self._masks.read(pair.run)
            finished.append(self._pending.popleft())
        return finished

    def restart(self) -> None:
        """Forget the frame drawn last: the next one has no history.  Pairs not yet read are dropped."""
        self._previous = []
        self._pending.clear()

    def submit(
        self,
        pair: Reprojection,
        *,
        declared: int = 0,
        current: Textures | None = None,
        previous: Textures | None = None,
        thresholds: Mapping[str, float] | None = None,
    ) -> int:
        """Submit one pair to the mask pass; the number of the run, for ``read``.

        ``declared``: Reason.FIRST or CUT for the whole frame, else 0.  ``current``, ``previous``: None for what the
        source holds; a first frame, which has no previous textures, is bound twice.  ``thresholds``: a_B of every
        feature, position in scene units; None for those of the settings.
        """
        current = self.source.current if current is None else current
        previous = (self.source.previous if previous is None else previous) or current
        limits = self._thresholds if thresholds is None else thresholds
        with self._timer.measure("masks"):
            return self._masks.run(
                pair, limits, current, previous, int(declared), exposure=self.settings.lighting.exposure_factor
            )

    def read(self, run: int | None = None) -> Counts:
        """Wait for a run, the latest or the one before it, and read its counts."""
        return self._masks.read(run)

    def compare(self, pair: Reprojection, **how: Any) -> Counts:
        """``submit`` and ``read``."""
        return self.read(self.submit(pair, **how))

    @property
    def mask_texture(self) -> Any:
        """Mask words (r32ui); None without ``images``."""
        return self._masks.mask

    @property
    def motion_texture(self) -> Any:
        """Motion (rg32f), GL rows; None without ``images``."""
        return self._masks.motion

    def mask(self) -> np.ndarray:
        """Mask words of the pair submitted last.  (h, w) uint32, row 0 at the top."""
        return read_channel(self._masks.mask, "mask")[..., 0]

    def motion(self) -> np.ndarray:
        """Motion of the pair submitted last: previous - current, pixels, +x right, +y down.

        (h, w, 2) float32, row 0 at the top; 0 where the previous position is behind the camera.
        """
        return read_channel(self._masks.motion, "motion")

    def _draw(self, frame: int, sample: int) -> View:
        if self._samples == 1:
            return self.source.advance(frame)
        return self.source.advance_sample(frame, sample)

    def release(self) -> None:
        self._masks.release()


@dataclass(frozen=True, slots=True)
class Pair:
    """One evaluated pair, as ``Observers.on_pair`` gets it; its images are on the GPU until the callback returns."""

    frame: int  # number of the current frame
    row: dict[str, Any]  # its row of frames.csv
    view: View  # of the current frame, through pixel centers
    source: Source
    _evaluator: PairEvaluator

    def mask(self) -> np.ndarray:
        """Mask words, (h, w) uint32, row 0 at the top."""
        return self._evaluator.mask()

    def motion(self) -> np.ndarray:
        """Previous - current, pixels, +x right, +y down.  (h, w, 2) float32; 0 where behind the camera."""
        return self._evaluator.motion()


@dataclass(frozen=True, slots=True)
class Observers:
    """Receivers of every evaluated pair.  ``on_pair`` makes the mask pass write images and counts be read at once."""

    scene: str = ""  # its name, for ``progress``
    writer: RunWriter | None = None  # gets the row
    progress: Callable[[Progress], None] | None = None
    on_pair: Callable[[Pair], None] | None = None
    on_counts: Callable[[Counts], None] | None = None  # gets the exact counts


@dataclass(frozen=True, slots=True)
class PairResults:
    """Everything evaluated of one sequence."""

    rows: list[dict[str, Any]]  # of frames.csv, one per pair
    views: list[View]  # of all frames drawn, through pixel centers
    stats: SequenceStats  # sums over all pairs
    brightness: Brightness  # of the frames that were checked


def evaluate_pairs(
    context: GpuContext,
    source: Source,
    settings: Settings,
    schedule: Schedule,
    observers: Observers,
    checked: Collection[int] | None = None,
) -> PairResults:
    """Evaluate the pairs of ``schedule``.

    ``checked``: frames whose brightness is counted; None: ``checked_frames`` of ``schedule``, which is the whole run's.
    After a KeyboardInterrupt the pairs already submitted are still read and reported to the observers.
    """
    evaluator = PairEvaluator(context, source, settings, images=observers.on_pair is not None)
    unmeasured = dict(source.unmeasured)
    stats = SequenceStats(
        tuple(c for c in COLUMNS if c not in unmeasured),
        unmeasured,
    )
    results = PairResults([], [], stats, Brightness())
    checked = checked_frames(schedule) if checked is None else checked
    total = sum(evaluate for _, evaluate in schedule)
    try:
        for frame, evaluate in schedule:
            view, finished = evaluator.step(frame, evaluate)
            results.views.append(view)
            if evaluate and frame in checked and source.radiance:
                results.brightness.count(source, settings)
            for pair in finished:
                _report(pair, evaluator, results, observers, total)
        for pair in evaluator.finish():
            _report(pair, evaluator, results, observers, total)
    except KeyboardInterrupt:
        for pair in evaluator.finish():
            _report(pair, evaluator, results, observers, total)
        raise
    finally:
        evaluator.release()
    return results


def _report(
    pair: EvaluatedPair, evaluator: PairEvaluator, results: PairResults, observers: Observers, total: int
) -> None:
    """Add a pair to the results and hand it to the observers."""
    settings = evaluator.settings
    row = {"frame": pair.frame, "time_s": pair.frame / settings.sequence.fps, **results.stats.add(pair.counts)}
    row |= _camera_row(pair.views, settings.metrics.unit_scale)
    results.rows.append(row)
    if observers.on_counts is not None:
        observers.on_counts(pair.counts)
    if observers.writer is not None:
        observers.writer.write_row(row)
    if observers.on_pair is not None:
        observers.on_pair(Pair(pair.frame, row, pair.view, evaluator.source, evaluator))
        pair.ended = time.perf_counter()
    if observers.progress is not None:
        observers.progress(Progress(observers.scene, len(results.rows), total, pair.seconds))


def _camera_row(views: tuple[View, View], unit_scale: float) -> dict[str, Any]:
    """How the camera moved between two frames, as columns of frames.csv; ``unit_scale``: scene units per meter."""
    activity = camera_activity(np.array([v.position for v in views]), np.array([v.world_from_view for v in views]))
    return {
        "translation_m": float(activity.position[0]) / unit_scale,
        "yaw_deg": float(activity.yaw[0]),
        "pitch_deg": float(activity.pitch[0]),
        "roll_deg": float(activity.roll[0]),
        "angle_deg": float(activity.angle[0]),
        "gimbal": bool(activity.gimbal[0]),
    }
