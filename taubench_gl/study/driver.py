"""The driver: submits the units of a study to an engine, stores their results, and handles failures."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from taubench_gl.folder_lock import FolderLock
from taubench_gl.study.engines import Engine, engine
from taubench_gl.study.progress import Listener
from taubench_gl.study.store import LOGS
from taubench_gl.study.study import Study
from taubench_gl.study.unit import ATTEMPTS, Advanced, Event, Failed, Finished, Lost, Unit


@dataclass(slots=True)
class _JobState:
    """What the driver knows of a job: the units that wait, and how many run now."""

    label: str
    pending: deque[Unit] = field(default_factory=deque)
    in_flight: int = 0
    over: bool = False  # finished or failed


def run_study(
    study: Study,
    about: Mapping[str, Any],
    same: tuple[str, ...] = (),
    *,
    workers: int = 0,
    listener: Listener | None = None,
) -> Any:
    """Run what is missing of ``study`` in its folder and write its results.  -> what ``Study.merge`` returns.

    ``about``: values of study.json; ``same``: names of those that an earlier run in the folder must have had, too.
    ``workers``: processes, 0: none, all in this process; results do not depend on it.  Raises TaubenchError.
    """
    store, listener = study.store, listener or Listener()
    made = engine(workers, store.out / LOGS)
    kept = {name: about[name] for name in same}
    store.require_usable(kept)  # before the lock file is written
    with FolderLock(store.out):
        store.require_usable(kept)
        with made as running:
            store.write_about(about)
            listener.begin(len(study.jobs()), running.describe())
            Driver(study, running, listener).run()
        return study.merge()


class Driver:
    """Runs what is missing of a study.  The caller holds the lock of its folder."""

    def __init__(self, study: Study, engine: Engine, listener: Listener):
        self._study, self._engine, self._listener = study, engine, listener
        self._states = {job: _JobState(label) for job, label in study.jobs().items()}
        self._attempts: Counter[str] = Counter()
        self._shown: Counter[str] = Counter()  # key of a running unit -> weight that the listener knows as done

    def run(self) -> None:
        """Run all jobs.  Raises NoOpenGL; finished units are kept."""
        for job in self._states:
            self._plan(job)
        while True:
            for worker, last_job in self._engine.idle().items():
                unit = self._choose(last_job)
                if unit is None:
                    break
                self._states[unit.job].in_flight += 1
                self._engine.submit(worker, unit)
            if not any(state.in_flight for state in self._states.values()):
                break
            for event in self._engine.wait(self._handle):
                self._handle(event)

    def _plan(self, job: str) -> None:
        """Queue the units that are missing, or finish the job."""
        state = self._states[job]
        units, total = self._study.missing(job, self._engine.width())
        if total or not units:
            self._listener.job_known(job, state.label, total - sum(unit.weight for unit in units), total)
        state.pending.extend(units)
        if not units:
            self._study.finish(job)
            state.over = True
            self._listener.job_finished(job)

    def _choose(self, last_job: str | None) -> Unit | None:
        """The next unit for a worker: of the job it has loaded, else of a job without workers, else of any job."""
        waiting = [state for state in self._states.values() if state.pending]
        if not waiting:
            return None
        job = self._states.get(last_job) if last_job is not None else None
        if job is None or not job.pending:
            untouched = next((state for state in waiting if not state.in_flight), None)
            job = untouched or max(waiting, key=lambda state: len(state.pending))
        job.pending.extendleft(reversed(self._study.instead(job.pending.popleft(), False)))
        return job.pending.popleft()

    def _handle(self, event: Event) -> None:
        """Store a result, repeat or fail a unit; then plan its job again if nothing of it is left to run."""
        unit = event.unit
        state = self._states[unit.job]
        if isinstance(event, Advanced):
            self._shown[unit.key] += event.weight
            self._listener.advanced(unit.job, event.weight)
            return
        state.in_flight -= 1
        shown = self._shown.pop(unit.key, 0)
        if isinstance(event, Finished):
            self._study.store.save(unit.key, event.data)
            self._listener.advanced(unit.job, unit.weight - shown)
        elif isinstance(event, Failed):
            self._fail(unit, event.message, event.details)
        else:
            self._listener.advanced(unit.job, -shown)
            self._repeat(unit, event)
        if not (state.pending or state.in_flight or state.over):
            self._plan(unit.job)

    def _repeat(self, unit: Unit, event: Lost) -> None:
        """Queue a unit again whose worker died, unless too many workers died in it."""
        state = self._states[unit.job]
        self._attempts[unit.key] += event.attempts
        units = self._study.instead(unit, True)
        if len(units) == 1 and self._attempts[unit.key] >= ATTEMPTS:
            times = f"{event.reason}, {self._attempts[unit.key]} times in {unit.name}"
            self._fail(unit, f"{unit.scene}: {times}", event.details)
        elif not state.over:
            self._listener.message(f"{state.label}: {event.reason}; {unit.name} is repeated")
            state.pending.extendleft(reversed(units))

    def _fail(self, unit: Unit, message: str, details: str) -> None:
        """A unit has no result: its job fails too, unless the study can use the other units."""
        state = self._states[unit.job]
        if state.over:
            return
        if self._study.fail(unit, message, details):
            self._listener.message(f"{state.label}: {unit.name} failed: {message}")
            self._listener.advanced(unit.job, unit.weight)
            return
        state.over = True
        state.pending.clear()
        self._listener.job_failed(unit.job, state.label, message)
