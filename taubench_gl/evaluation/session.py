"""A session: everything that the evaluation of one scene or sequence owns, opened and closed together.

    with open_session("scene.glb", settings, Readback(images=True)) as session:
        for pair in session.pairs():
            pair.row, pair.mask
        summary = session.summary()

What a session evaluates is a ScenePlan or, for path-traced files, a PathTracedPlan.  ``run_session`` is the one loop
over all pairs.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from taubench_gl.animation import View
from taubench_gl.conventions import COUNTED
from taubench_gl.evaluation.brightness import checked_frames
from taubench_gl.evaluation.lighting import LightPlan
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.pairs import EvaluatedPair, Observers, Pair
from taubench_gl.evaluation.sampled_light import LightVisits, Previews
from taubench_gl.evaluation.scale import median_depths
from taubench_gl.evaluation.schedule import Schedule, frame_schedule
from taubench_gl.evaluation.summary import finish_run
from taubench_gl.evaluation.tally import Tally
from taubench_gl.frame.sources import RasterSource, Source
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.sampled_light import sampled_columns
from taubench_gl.provenance import provenance
from taubench_gl.run import Progress, Run, RunWriter
from taubench_gl.run_schema import FRAME_COLUMNS, SAMPLED_COLUMNS
from taubench_gl.settings import Settings

TIMED_FIRST, TIMED_EVERY = 16, 16
"""Frames whose passes are timed; timing a pass waits for it, so the passes of all other frames overlap."""


@dataclass(frozen=True, slots=True)
class Readback:
    """What a session reads from the GPU of every pair besides its counts.

    ``images``: mask, motion and channels of ``Pair``, so counts are read at once; ``channels``: to draw for it besides
    those the columns need; ``distances``: of every pixel; ``lobes``: of direct and indirect, to measure apart.
    """

    images: bool = False
    channels: tuple[str, ...] = ()
    distances: bool = False
    lobes: tuple[str, ...] = ()

    @classmethod
    def of(cls, observers: Observers, lobes: Collection[str] = ()) -> Readback:
        """What ``observers`` and the measurement of ``lobes`` need read back of every pair."""
        return cls(observers.on_pair is not None, observers.channels, observers.distances, tuple(lobes))


COUNTS_ONLY = Readback()
"""Nothing is read of a pair but its counts."""


class ColumnGroup(Protocol):
    """Fills columns in the row of every pair, or replaces its masks, before the pair is counted."""

    columns: tuple[str, ...]  # of frames.csv
    distances: bool  # whether it reads the distances of every pixel

    def fill_row(self, pair: Pair) -> None: ...


class Plan(Protocol):
    """What a session evaluates: a scene or files, with camera, frames, and settings that leave nothing open."""

    animated: AnimatedScene | None  # None: files

    @property
    def name(self) -> str: ...

    @property
    def settings(self) -> Settings: ...

    @property
    def frames(self) -> range: ...

    @property
    def light(self) -> LightPlan: ...

    def open_source(self, owner: GpuOwner, timer: PassTimer, readback: Readback) -> Source:
        """Open the source of the frames, which ``owner`` frees."""

    def missing_lobes(self, source: Source, lobes: Collection[str]) -> dict[str, dict[str, str]]:
        """Requested lobe -> {direct or indirect: why it is null}."""

    def column_groups(self, session: Session) -> Iterator[ColumnGroup]:
        """The column groups that the settings and ``session.readback`` call for, in the order in which they run."""

    def static_summary(self, session: Session) -> dict[str, Any]:
        """The parts of the summary that need no pair (``summary.static_summary``)."""

    def views(self, session: Session) -> list[View]:
        """The views of all frames, drawn or not."""

    def add_to_summary(self, summary: dict[str, Any], session: Session) -> None:
        """Add what only this kind of plan has to a summary that is complete but for timing and provenance."""


class Session(GpuOwner):
    """GPU context, source, mask pass and column groups of a plan, and the tally of its pairs.

    ``tally`` and ``drawn`` (views of the frames drawn, through pixel centers) belong to the last call of ``pairs``.
    The GPU context is current while a pair is drawn, not while the caller has it.
    """

    def __init__(
        self,
        plan: Plan,
        readback: Readback = COUNTS_ONLY,
        *,
        every: int = TIMED_EVERY,
        shaders: ShaderCache | None = None,
    ):
        """``every``: the passes of one in so many frames are timed; ``shaders``: programs to share, as of ``GpuOwner``.

        Raises TaubenchError.
        """
        self.plan, self.readback, self.settings = plan, readback, plan.settings
        gpu = open_gpu(self.settings.device.backend, self.settings.device.device)
        self.timer = PassTimer(gpu, first=TIMED_FIRST, every=every)
        super().__init__(gpu, self.timer, shaders)
        with gpu, self.opening():
            self.source = plan.open_source(self, self.timer, readback)
            self.missing_lobes = plan.missing_lobes(self.source, readback.lobes)
            self.column_groups = list(plan.column_groups(self))
            self._images = readback.images or bool(self.column_groups)
            distances = readback.distances or any(group.distances for group in self.column_groups)
            self.evaluator = self.open_evaluator(
                self.source, self.settings, images=self._images, distances=distances, both=self.source.other == COUNTED
            )
            self._previews = self._open_previews()
        self._last: tuple[int, View] | None = None  # the frame that ``pairs`` drew last
        self._begin()

    def variant(
        self,
        settings: Settings,
        *,
        extra: Collection[str] = (),
        without: Collection[str] = (),
        pixel_list: bool = False,
        given_directions: bool = False,
    ) -> RasterSource:
        """Another source of the session's scene with its camera, poses and programs.  Keywords of ``open_source``.

        ``settings``: those of the session with what differs, so that their lighting is resolved.
        """
        return self.open_source(
            self.plan.animated, settings, extra=extra, without=without, pixel_list=pixel_list,
            given_directions=given_directions,
        )  # fmt: skip

    def _begin(self) -> None:
        self.drawn: list[View] = []
        source = self.source
        self.tally = Tally(
            self.settings, self.plan.frames, self.plan.light, source.unmeasured, source.reprojection, source.other,
            self.missing_lobes,
        )  # fmt: skip

    def pairs(
        self, schedule: Schedule | None = None, checked: Collection[int] | None = None, *, continued: bool = False
    ) -> Iterator[Pair]:
        """Draw, compare and count the pairs of ``schedule``, one after another; None: those of the settings.

        ``checked``: frames whose brightness and depth are measured; None: ``checked_frames`` of ``schedule``.  Without
        images a pair arrives while the next one is drawn, and has its row and counts only.  ``continued``: a schedule
        that begins with the frame drawn last does not draw it again; nobody else has drawn with the source meanwhile.
        """
        schedule = frame_schedule(self.plan.frames, self.settings) if schedule is None else schedule
        if self.settings.metrics.stereo and any(evaluate for _, evaluate in schedule):
            # The history of a frame is its other eye: frames that only come before another one are not drawn.
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
                # Counts are read while the GPU works on the next frame, so that neither waits for the other: ``step``
                # submits the pair of ``frame`` and returns the pair before it.  With images, counts are read at once.
                view, finished = self.evaluator.step(frame, evaluate)
                self.drawn.append(view)
                if evaluate and frame in checked:
                    self._check()
                if evaluate and self._previews is not None:
                    self._previews.keep(frame, self.evaluator.submitted)
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
        sampled = self.tally.sampled
        if sampled is not None and not sampled.done:
            sampled.run(self.open_light().visit, watch)

    def open_light(self) -> LightVisits:
        """What decides pixels of the session's pairs under path-traced light."""
        with self.gpu:
            return LightVisits(
                self, self.variant, self.settings, self.plan.frames, self.tally.sampled.estimate, self._previews
            )

    def _open_previews(self) -> Previews | None:
        """What keeps previews for ``open_light``; None where no light is sampled or pixels have two histories."""
        columns = sampled_columns(self.source.unmeasured, self.settings.metrics.columns)
        if self.plan.light is not LightPlan.SAMPLED or not columns or self.settings.metrics.history == "both":
            return None
        return Previews(self, self.source, self.settings, columns)

    @property
    def columns(self) -> tuple[str, ...]:
        """Column names of frames.csv, in file order."""
        return frame_columns(self.added_columns, self.tally.sampled is not None)

    @property
    def added_columns(self) -> tuple[str, ...]:
        """Names of the columns that the column groups fill."""
        return tuple(column for group in self.column_groups for column in group.columns)

    def _check(self) -> None:
        """Measure brightness and depth of the current frame."""
        self.tally.depths.extend(median_depths(self.source))
        if self.source.radiance:
            self.tally.brightness.count(self.source, self.settings)

    def _completed(self, finished: list[EvaluatedPair]) -> Iterator[Pair]:
        for evaluated in finished:
            with contextlib.closing(Pair(evaluated, {}, self.evaluator)) as pair:
                if self._images:
                    with self.gpu:
                        for group in self.column_groups:
                            group.fill_row(pair)
                    evaluated.ended = 0.0  # the CPU is done with it when the caller is
                else:
                    pair.close()  # the source holds other frames
                self.tally.add(pair.frame, evaluated.counts, self._camera_path(evaluated), evaluated.lobes, pair.row)
                yield pair

    def _camera_path(self, evaluated: EvaluatedPair) -> tuple[View, View]:
        """Views of the camera in the frame before and in that of the pair, whatever its history is."""
        if not self.settings.metrics.stereo:
            return evaluated.views
        before = self.plan.animated.view_at((evaluated.frame - 1) / self.settings.sequence.fps)
        return before, evaluated.view

    def summary(self) -> dict[str, Any]:
        """The content of summary.json for the pairs of the last call of ``pairs``."""
        with self.gpu:
            self.gpu.check("evaluation")
            static, views = self.plan.static_summary(self), self.plan.views(self)
            summary = self.tally.summary(static, views, self.source.describe())
            self.plan.add_to_summary(summary, self)
            summary["timing"] = self.timer.summary()
            summary["provenance"] = provenance(self.gpu, self.timer.clock)
        return summary


def run_session(session: Session, observers: Observers, out: str | Path | None = None) -> Run:
    """Evaluate every pair of ``session``, opened with ``Readback.of(observers)``.

    ``out`` receives frames.csv row by row and summary.json at the end, and nothing where there is no pair.  After a
    KeyboardInterrupt the pairs already submitted are still read, written and reported.
    """
    total = sum(evaluate for _, evaluate in frame_schedule(session.plan.frames, session.settings))
    on_finish = observers.on_finish if total else None
    observers = replace(observers, scene=session.plan.name, on_finish=on_finish)
    with contextlib.ExitStack() as stack:
        if out is not None and total:
            writer = stack.enter_context(RunWriter(out, session.columns))
            observers = replace(observers, writer=writer)
        with session.gpu:
            try:
                for pair in session.pairs():
                    _report(pair, observers, len(session.tally.rows), total)
            except KeyboardInterrupt:
                for pair in session.finish():
                    _report(pair, observers, len(session.tally.rows), total)
                raise

            def watch(text: str) -> None:
                if observers.progress is not None:
                    observers.progress(Progress(observers.scene, total, total, 0.0, text))

            session.sample_light(watch)
            summary = session.summary()
        return finish_run(summary, session.tally.rows, observers)


def frame_columns(added: Sequence[str], sampled: bool) -> tuple[str, ...]:
    """Columns of frames.csv; ``added``: of column groups; ``sampled``: of a run with sampled light."""
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
