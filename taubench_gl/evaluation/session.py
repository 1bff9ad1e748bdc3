"""A session: everything that the evaluation of one scene or sequence owns, opened and closed together.

    with open_session("scene.glb", settings, Wants(images=True)) as session:
        for pair in session.pairs():
            pair.row, pair.mask
        summary = session.summary()

What a session evaluates is a SceneInput or, for path-traced files, a PathTracedInput.  ``evaluate`` is the one loop
over all pairs.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from taubench_gl.animation import View
from taubench_gl.evaluation.brightness import Brightness, checked_frames, describe_brightness
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.pairs import EvaluatedPair, Observers, Pair
from taubench_gl.evaluation.sampled_light import LightVisits, SampledLight, decides_light
from taubench_gl.evaluation.scale import describe_scale, median_depths
from taubench_gl.evaluation.schedule import Schedule, frame_schedule
from taubench_gl.evaluation.summary import assemble_summary, finish_run
from taubench_gl.features import COLUMNS
from taubench_gl.frame.sources import RasterSource, Source
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.activity import camera_activity
from taubench_gl.metrics.sequence_stats import SequenceStats
from taubench_gl.provenance import provenance
from taubench_gl.run import Progress, Run, RunWriter
from taubench_gl.run_schema import FRAME_COLUMNS, SAMPLED_COLUMNS
from taubench_gl.settings import Settings

TIMED_FIRST, TIMED_EVERY = 16, 16
"""Frames whose passes are timed; timing a pass waits for it, so the passes of all other frames overlap."""


@dataclass(frozen=True, slots=True)
class Wants:
    """What is read of every pair besides its counts.

    ``images``: mask, motion and channels of ``Pair``, so counts are read at once; ``channels``: to draw for it besides
    those the columns need; ``distances``: of every pixel; ``lobes``: of direct and indirect, to measure apart;
    ``sampled``: columns of light by path tracing at random pixels, with light method ``auto``.
    """

    images: bool = False
    channels: tuple[str, ...] = ()
    distances: bool = False
    lobes: tuple[str, ...] = ()
    sampled: bool = False

    @classmethod
    def of(cls, observers: Observers, lobes: Collection[str] = (), sampled: bool = False) -> Wants:
        """Those of ``observers``."""
        return cls(observers.on_pair is not None, observers.channels, observers.distances, tuple(lobes), sampled)


class ColumnAdder(Protocol):
    """Adds ``columns`` to the row of every pair, before the pair is counted, and blocks to the summary."""

    columns: tuple[str, ...]
    distances: bool  # whether it reads those of every pixel

    def complete(self, pair: Pair) -> None: ...

    def blocks(self, session: Session) -> dict[str, Any]:
        """Blocks of summary.json over ``session.rows``."""


class Input(Protocol):
    """What a session evaluates: scene or files, camera and frames, with resolved settings."""

    @property
    def name(self) -> str: ...

    @property
    def settings(self) -> Settings: ...

    @property
    def frames(self) -> range: ...

    animated: AnimatedScene | None  # None: files

    def open_source(self, owner: GpuOwner, timer: PassTimer, wants: Wants) -> Source:
        """Owned by ``owner``."""

    def adders(self, session: Session) -> Iterator[ColumnAdder]:
        """Those that the settings and ``session.wants`` call for."""

    def facts(self, session: Session) -> dict[str, Any]:
        """The parts of the summary that need no pair (``summary.scene_facts``)."""

    def views(self, session: Session) -> list[View]:
        """Of all frames, drawn or not."""

    def amend(self, summary: dict[str, Any], session: Session) -> None:
        """Add what only this kind of input has."""

    def sampled_light(self, session: Session) -> SampledLight | None:
        """Of the columns of light that are sampled, if any."""


class Session(GpuOwner):
    """Context, source, mask pass and column adders of ``given``, and what its pairs add up to.

    ``rows``, ``views``, ``stats``, ``brightness`` and ``depths`` are those of the last ``pairs``.  The GPU context is
    current while a pair is drawn, not while the caller has it.
    """

    def __init__(
        self, given: Input, wants: Wants = Wants(), *, every: int = TIMED_EVERY, shaders: ShaderCache | None = None
    ):
        """``every``: the passes of one in so many frames are timed; ``shaders``: programs to share, as of ``GpuOwner``.

        Raises TaubenchError.
        """
        self.given, self.wants, self.settings = given, wants, given.settings
        gpu = open_gpu(self.settings.device.backend, self.settings.device.device)
        self.timer = PassTimer(gpu, first=TIMED_FIRST, every=every)
        super().__init__(gpu, self.timer, shaders)
        with gpu, self.opening():
            self.source = given.open_source(self, self.timer, wants)
            self.adders = list(given.adders(self))
            self._images = wants.images or bool(self.adders)
            distances = wants.distances or any(adder.distances for adder in self.adders)
            how = {"images": self._images, "distances": distances}
            self.evaluator = self.open_evaluator(self.source, self.settings, **how)
        self._last: tuple[int, View] | None = None  # the frame that ``pairs`` drew last
        self._begin()

    def variant(self, settings: Settings, **how: Any) -> RasterSource:
        """Another source of the session's scene with its camera, poses and programs.  ``how``: as of ``RasterSource``.

        ``settings``: those of the session with what differs, so that their lighting is resolved.
        """
        return self.open_source(self.given.animated, settings, **how)

    def _begin(self) -> None:
        self.rows: list[dict[str, Any]] = []
        self.drawn: list[View] = []  # of the frames drawn, through pixel centers
        unmeasured = dict(self.source.unmeasured)
        self.stats = SequenceStats(tuple(c for c in COLUMNS if c not in unmeasured), unmeasured)
        self.brightness, self.depths = Brightness(), []
        self.sampled = self.given.sampled_light(self)

    def pairs(
        self, schedule: Schedule | None = None, checked: Collection[int] | None = None, *, continued: bool = False
    ) -> Iterator[Pair]:
        """Draw, compare and count the pairs of ``schedule``, one after another; None: those of the settings.

        ``checked``: frames whose brightness and depth are measured; None: ``checked_frames`` of ``schedule``.  Without
        images a pair arrives while the next one is drawn, and has its row and counts only.  ``continued``: a schedule
        that begins with the frame drawn last does not draw it again; nobody else has drawn with the source meanwhile.
        """
        schedule = frame_schedule(self.given.frames, self.settings) if schedule is None else schedule
        if self.settings.metrics.stereo and any(
            evaluate for _, evaluate in schedule
        ):  # no frame before is anyone's history
            schedule = [(frame, evaluate) for frame, evaluate in schedule if evaluate]
        checked = checked_frames(schedule) if checked is None else checked
        self._begin()
        if continued and self._last is not None and schedule and schedule[0] == (self._last[0], False):
            self.drawn.append(self._last[1])
            schedule = schedule[1:]
        else:
            self.evaluator.restart()
        self._last = None
        for frame, evaluate in schedule:
            with self.gpu:
                view, finished = self.evaluator.step(frame, evaluate)
                self.drawn.append(view)
                if evaluate and frame in checked:
                    self._check()
            yield from self._completed(finished)
        yield from self.finish()
        self._last = (schedule[-1][0], self.drawn[-1]) if schedule else None

    def finish(self) -> Iterator[Pair]:
        """The pairs that are submitted and not read yet, also after an interrupt."""
        with self.gpu:
            finished = self.evaluator.finish()
        yield from self._completed(finished)

    def sample_light(self, watch: Callable[[str], None] = lambda text: None) -> None:
        """After ``pairs``: path-traced light at random pixels, in rounds; ``watch`` gets a line about each."""
        if self.sampled is None or self.sampled.done:
            return
        self.sampled.run(self.open_light().visit, watch)

    def open_light(self) -> LightVisits:
        """What decides pixels of the session's pairs under path-traced light."""
        with self.gpu:
            return LightVisits(self, self.variant, self.settings, self.given.frames, self.sampled.estimate)

    @property
    def columns(self) -> tuple[str, ...]:
        """Of frames.csv."""
        return frame_columns(self.added_columns, self.sampled is not None)

    @property
    def added_columns(self) -> tuple[str, ...]:
        """Those of the column adders."""
        return tuple(column for adder in self.adders for column in adder.columns)

    def _check(self) -> None:
        """Measure brightness and depth of the current frame."""
        self.depths.extend(median_depths(self.source))
        if self.source.radiance:
            self.brightness.count(self.source, self.settings)

    def _completed(self, finished: list[EvaluatedPair]) -> Iterator[Pair]:
        for one in finished:
            row = {"frame": one.frame, "time_s": one.frame / self.settings.sequence.fps}
            with contextlib.closing(Pair(one, row, self.evaluator)) as pair:
                if self._images:
                    with self.gpu:
                        for adder in self.adders:
                            adder.complete(pair)
                    one.ended = 0.0  # the CPU is done with it when the caller is
                else:
                    pair.close()  # the source holds other frames
                if self.sampled is not None:
                    self.sampled.add(one.frame - 1 - self.given.frames[0], one.counts)
                row |= self.stats.add(one.counts) | camera_row(self._path(one), self.settings.metrics.unit_scale)
                self.rows.append(row)
                yield pair

    def _path(self, one: EvaluatedPair) -> tuple[View, View]:
        """Views of the camera in the frame before and in that of the pair, whatever its history is."""
        if not self.settings.metrics.stereo:
            return one.views
        return self.given.animated.view_at((one.frame - 1) / self.settings.sequence.fps), one.view

    def summary(self) -> dict[str, Any]:
        """summary.json of the pairs."""
        with self.gpu:
            self.gpu.check("evaluation")
            views = self.given.views(self)
            columns = () if self.sampled is None else self.sampled.estimate.columns
            facts, frames = self.given.facts(self), self.given.frames
            summary = assemble_summary(facts, frames, self.settings, views, self.stats, columns)
            described = self.source.describe()
            summary["notes"] += described.pop("notes", [])
            summary |= described
            of_images = self.sampled is None and not decides_light(self.settings)
            describe_brightness(summary, self.brightness, self.settings, of_images)
            describe_scale(summary, self.depths, self.settings)
            for adder in self.adders:
                summary |= adder.blocks(self)
            if self.sampled is not None:
                self.sampled.finish(summary, self.rows, self.given.frames)
            self.given.amend(summary, self)
            summary["timing"] = self.timer.summary()
            summary["provenance"] = provenance(self.gpu, self.timer.clock)
        return summary


def evaluate(session: Session, observers: Observers, out: str | Path | None = None) -> Run:
    """Evaluate every pair of ``session``, opened with ``Wants.of(observers)``.

    ``out`` receives frames.csv row by row and summary.json at the end.  After a KeyboardInterrupt the pairs already
    submitted are still read, written and reported.
    """
    observers = replace(observers, scene=session.given.name)
    with contextlib.ExitStack() as stack:
        if out is not None:
            writer = stack.enter_context(RunWriter(out, session.columns))
            observers = replace(observers, writer=writer)
        with session.gpu:
            total = sum(evaluate for _, evaluate in frame_schedule(session.given.frames, session.settings))
            try:
                for pair in session.pairs():
                    _report(pair, observers, len(session.rows), total)
            except KeyboardInterrupt:
                for pair in session.finish():
                    _report(pair, observers, len(session.rows), total)
                raise

            def watch(text: str) -> None:
                if observers.progress is not None:
                    observers.progress(Progress(observers.scene, total, total, 0.0, text))

            session.sample_light(watch)
            summary = session.summary()
        return finish_run(summary, session.rows, observers)


def frame_columns(added: Sequence[str], sampled: bool) -> tuple[str, ...]:
    """Columns of frames.csv; ``added``: of column adders; ``sampled``: of a run with sampled light."""
    return (*FRAME_COLUMNS, *added, *SAMPLED_COLUMNS * sampled)


def _report(pair: Pair, observers: Observers, done: int, total: int) -> None:
    """Hand a pair to the observers, its row to the file first."""
    if observers.writer is not None:
        observers.writer.write_row(pair.row)
    if observers.on_counts is not None:
        observers.on_counts(pair.evaluated.counts)
    if observers.on_pair is not None:
        observers.on_pair(pair)
    if observers.progress is not None:
        observers.progress(Progress(observers.scene, done, total, pair.evaluated.seconds))


def camera_row(views: tuple[View, View], unit_scale: float) -> dict[str, Any]:
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
