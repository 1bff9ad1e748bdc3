"""The driver: submits units to an engine, stores their results, and handles failures."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from taubench_gl.batch.merge import finish, is_written, job_positions, merge_job, write_job
from taubench_gl.batch.spec import BatchSpec, Job
from taubench_gl.batch.store import Store, file_stamp
from taubench_gl.batch.units import (
    ATTEMPTS,
    Engine,
    Event,
    Failed,
    Finished,
    Key,
    Lost,
    NoGraphics,
    PairDone,
    Slot,
    Unit,
)
from taubench_gl.batch.worker import resolved_settings
from taubench_gl.errors import GraphicsError
from taubench_gl.evaluation import files_identity

CHUNK_PAIRS = 32
"""Largest chunk: the pairs per worker that a killed driver loses.  A chunk renders one frame more than its pairs."""

MIN_CHUNK_PAIRS = 4


class Listener:
    """Receives progress.  Every method does nothing here."""

    def job_known(self, job: Job, done: int, total: int) -> None:
        """The number of pairs of a job is known, and how many of them an earlier run has counted."""

    def pairs_done(self, job: Job, pairs: int) -> None:
        """``pairs`` more pairs of a job are counted; negative if a chunk is repeated."""

    def job_finished(self, job: Job) -> None: ...

    def job_failed(self, job: Job, message: str) -> None: ...

    def message(self, line: str) -> None:
        """A message: a worker died, or has no OpenGL."""


@dataclass(slots=True)
class _JobState:
    job: Job
    head: dict[str, Any] | None = None
    stamp: list[int] | None = None  # ``file_stamp`` of the scene before its head is computed
    pending: deque[Unit] = field(default_factory=deque)
    in_flight: int = 0
    over: bool = False  # finished or failed

    @property
    def complete(self) -> bool:
        return self.head is not None and not self.pending and not self.in_flight and not self.over


@dataclass(frozen=True, slots=True)
class Outcome:
    """``failed``: job id -> reason."""

    summary: dict[str, Any]
    failed: dict[str, str]


class Driver:
    """Runs the missing part of a batch in ``store``.  The caller holds the folder's lock."""

    def __init__(self, spec: BatchSpec, store: Store, listener: Listener | None = None, chunk: int | None = None):
        """``chunk``: pairs per unit; None: chosen by the engine's width.  It does not change results."""
        self.spec, self.store = spec, store
        self.listener = listener or Listener()
        self._chunk = chunk
        self._states = {job.id: _JobState(job) for job in spec.jobs}
        self._attempts: Counter[Key] = Counter()
        self._shown: Counter[Key] = Counter()  # pairs of a running unit that were reported to the listener
        self._failed: dict[str, str] = {}
        self._without_gl: list[str] = []
        self._engine: Engine | None = None  # while ``run`` is active

    def on_pair(self, event: PairDone) -> None:
        """For engines that report pairs while ``wait`` blocks."""
        self._shown[event.unit.key] += 1
        self.listener.pairs_done(self._states[event.unit.job].job, 1)

    def run(self, engine: Engine) -> Outcome:
        """Run all jobs on ``engine``.  Raises GraphicsError if no worker is left; finished pairs are kept."""
        self._engine = engine
        for state in self._states.values():
            self._start(state)
        while True:
            for slot in engine.idle():
                unit = self._choose(slot)
                if unit is None:
                    break
                self._states[unit.job].in_flight += 1
                engine.submit(slot, unit)
            if not any(state.in_flight for state in self._states.values()):
                if any(state.pending for state in self._states.values()):
                    why = self._without_gl[-1] if self._without_gl else "all workers have ended"
                    hint = "finished pairs are kept; resume on a machine with OpenGL"
                    raise GraphicsError(f"no worker with OpenGL is left: {why}", hint=hint)
                break
            for event in engine.wait():
                self._handle(event)
        return Outcome(finish(self.store, self.spec, self._failed), self._failed)

    # --------------------------------------------------------------------------------------------------- planning
    def _start(self, state: _JobState) -> None:
        """Continue a job where an earlier run has stopped."""
        self.store.clear_failure(state.job.id)
        head = self.store.load_head(state.job)
        if head is None:
            state.stamp = file_stamp(state.job.scene)
            state.pending.append(Unit(state.job.id, state.job.scene, state.job.settings))
        else:
            self._plan(state, head)

    def _plan(self, state: _JobState, head: dict[str, Any]) -> None:
        """Queue the pairs that are not counted yet."""
        job = state.job = replace(state.job, settings=resolved_settings(state.job.settings, head))
        state.head = head
        positions = job_positions(job, head)
        if is_written(self.store, job, head):
            self.listener.job_known(job, len(positions), len(positions))
            state.over = True
            self.listener.job_finished(job)
            return
        records, reports = self.store.load_pairs(job)
        missing = [p for p in positions if p not in records]
        self.listener.job_known(job, len(positions) - len(missing), len(positions))
        sha256 = files_identity(head["facts"]["scene"])
        chunks = chunked(missing, self._chunk or self._chunk_size(len(positions)))
        if not positions and not reports:
            chunks = [()]
        state.pending.extend(Unit(job.id, job.scene, job.settings, chunk, sha256, job.lobes) for chunk in chunks)
        if state.complete:
            self._finish(state)

    def _chunk_size(self, pairs: int) -> int:
        """At least two chunks per worker if the job has that many pairs: it may be the only job left."""
        return min(CHUNK_PAIRS, max(MIN_CHUNK_PAIRS, math.ceil(pairs / (2 * self._engine.width()))))

    def _choose(self, slot: Slot) -> Unit | None:
        """The next unit for a worker: of the job it has loaded, else of a job without workers, else of any job."""
        waiting = [state for state in self._states.values() if state.pending]
        if not waiting:
            return None
        own = self._states.get(slot.last_job) if slot.last_job is not None else None
        if own is not None and own.pending:
            return own.pending.popleft()
        fresh = next((state for state in waiting if not state.in_flight), None)
        return (fresh or max(waiting, key=lambda state: len(state.pending))).pending.popleft()

    # ------------------------------------------------------------------------------------------------------ events
    def _handle(self, event: Event) -> None:
        if isinstance(event, PairDone):
            self.on_pair(event)
            return
        if isinstance(event, NoGraphics):
            self._lost_graphics(event)
            return
        state = self._states[event.unit.job]
        state.in_flight -= 1
        actions: dict[type, Callable[[_JobState, Any], None]] = {
            Finished: self._finished,
            Failed: lambda s, e: self._fail(s, e.message, e.details),
            Lost: self._lost,
        }
        actions[type(event)](state, event)
        if state.complete:
            self._finish(state)

    def _finished(self, state: _JobState, event: Finished) -> None:
        unit = event.unit
        if unit.positions is None:
            if not state.over:
                self._plan(state, self.store.save_head(state.job, event.data, state.stamp))
            return
        self.store.save_pairs(unit.job, unit.positions, event.data)
        self.listener.pairs_done(state.job, len(unit.positions) - self._shown.pop(unit.key, 0))

    def _lost(self, state: _JobState, event: Lost) -> None:
        unit = event.unit
        self.listener.pairs_done(state.job, -self._shown.pop(unit.key, 0))
        self._attempts[unit.key] += event.attempts
        if self._attempts[unit.key] >= ATTEMPTS:
            message = f"{event.reason}, {self._attempts[unit.key]} times in {unit.name}"
            self._fail(state, f"{state.job.scene}: {message}", event.details)
        elif not state.over:
            self.listener.message(f"{state.job.label}: {event.reason}; {unit.name} is repeated")
            state.pending.appendleft(unit)

    def _lost_graphics(self, event: NoGraphics) -> None:
        if event.worker:
            self.listener.message(f"{event.worker} has no OpenGL and gets no more units: {event.message}")
            self._without_gl.append(event.message)
        if event.unit is not None:
            state = self._states[event.unit.job]
            state.in_flight -= 1
            if not state.over:
                state.pending.appendleft(event.unit)

    def _fail(self, state: _JobState, message: str, details: str) -> None:
        if state.over:
            return
        state.over = True
        state.pending.clear()
        self._failed[state.job.id] = message
        self.store.log_failure(state.job.id, message, details)
        self.listener.job_failed(state.job, message)

    def _finish(self, state: _JobState) -> None:
        """Write the files of a job all of whose pairs are counted."""
        job, head = state.job, state.head
        records, reports = self.store.load_pairs(job)
        missing = [p for p in job_positions(job, head) if p not in records]
        if missing or not reports:  # a file was damaged after it was written
            self._plan(state, head)
            return
        write_job(self.store, job, merge_job(job, head, records, reports), reports)
        state.over = True
        self.listener.job_finished(job)


def chunked(positions: list[int], size: int) -> list[tuple[int, ...]]:
    """``positions`` in chunks of at most ``size``.  Frames between distant pairs are not rendered."""
    return [tuple(positions[i : i + size]) for i in range(0, len(positions), size)]
