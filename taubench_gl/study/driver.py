"""The driver: submits the units of a study to an engine, stores their results, and handles failures."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.errors import GraphicsError, SettingsError
from taubench_gl.folder_lock import FolderLock
from taubench_gl.study.engines import InProcess, Processes, available_cores
from taubench_gl.study.progress import Listener
from taubench_gl.study.store import LOGS
from taubench_gl.study.study import Study
from taubench_gl.study.unit import ATTEMPTS, Advanced, Engine, Event, Failed, Finished, Lost, NoGraphics, Slot, Unit


@dataclass(slots=True)
class _JobState:
    """What the driver knows of a job: the units that wait, and how many run now."""

    label: str
    pending: deque[Unit] = field(default_factory=deque)
    in_flight: int = 0
    over: bool = False  # finished or failed


ENGINES = "dask://HOST:PORT, dask-local"

MAX_WORKERS_PER_CORE = 32
"""A larger number of workers is taken for a typing error: it would fill the memory before any work is done."""


def make_engine(name: str | None, workers: int | None, logs: Path) -> Engine:
    """The engine ``name``: None (this process, or ``workers`` processes), ``dask-local`` or ``dask://HOST:PORT``.

    ``logs``: folder for the output of worker processes.  Raises SettingsError.
    """
    if workers is not None and workers < 1:
        raise SettingsError(f"workers is {workers}", hint="give 1 or more")
    most = MAX_WORKERS_PER_CORE * available_cores()
    if workers is not None and workers > most:
        raise SettingsError(f"workers is {workers}", hint=f"give at most {most}; one per core is enough")
    if name is None:
        return InProcess() if workers is None else Processes(workers, logs)
    scheme, separator, address = name.partition("://")
    if name != "dask-local" and (scheme not in ("dask", "tcp", "tls") or not separator or not address):
        raise SettingsError(f"no engine is named {name!r}", hint=f"choose from {ENGINES}, or --workers N")
    from taubench_gl.study.cluster import DaskCluster

    if name == "dask-local":
        return DaskCluster(None, workers or available_cores())
    if workers is not None:
        raise SettingsError("--workers does not apply to a running cluster", where=name, hint="leave --workers out")
    return DaskCluster(f"{'tcp' if scheme == 'dask' else scheme}://{address}")


def run_study(
    study: Study,
    about: Mapping[str, Any],
    same: tuple[str, ...] = (),
    *,
    engine: str | Engine | None = None,
    workers: int | None = None,
    listener: Listener | None = None,
) -> Any:
    """Run what is missing of ``study`` in its folder and write its results.  -> what ``Study.merge`` returns.

    ``about``: values of study.json; ``same``: names of those that an earlier run in the folder must have had, too.
    ``engine``: a name (``make_engine``), or an Engine.  Results do not depend on it.  Raises TaubenchError.
    """
    store, listener = study.store, listener or Listener()
    made = make_engine(engine, workers, store.out / LOGS) if engine is None or isinstance(engine, str) else engine
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
        self._without_gl = "all workers have ended"

    def run(self) -> None:
        """Run all jobs.  Raises GraphicsError if no worker is left; finished units are kept."""
        for job in self._states:
            self._plan(job)
        while True:
            for slot in self._engine.idle():
                unit = self._choose(slot)
                if unit is None:
                    continue
                self._states[unit.job].in_flight += 1
                self._engine.submit(slot, unit)
            if not any(state.in_flight for state in self._states.values()):
                break
            for event in self._engine.wait(self._handle):
                self._handle(event)
        if any(state.pending for state in self._states.values()):
            hint = "finished units are kept; continue on a machine with OpenGL"
            raise GraphicsError(f"no worker with OpenGL is left: {self._without_gl}", hint=hint)

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

    def _choose(self, slot: Slot) -> Unit | None:
        """The next unit for a worker: of the job it has loaded, else of a job without workers, else of any job."""
        waiting = [state for state in self._states.values() if state.pending]
        if not waiting:
            return None
        job = self._states.get(slot.last_job) if slot.last_job is not None else None
        if job is None or not job.pending:
            if slot.busy:
                return None
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

    def _repeat(self, unit: Unit, event: Lost | NoGraphics) -> None:
        """Queue a unit again that has ended without a result, unless too many workers died in it."""
        state = self._states[unit.job]
        if isinstance(event, NoGraphics):
            if event.worker:
                self._listener.message(f"{event.worker} has no OpenGL and gets no more units: {event.message}")
                self._without_gl = event.message
            units: Sequence[Unit] = (unit,)
        else:
            self._attempts[unit.key] += event.attempts
            units = self._study.instead(unit, True)
            if len(units) == 1 and self._attempts[unit.key] >= ATTEMPTS:
                times = f"{event.reason}, {self._attempts[unit.key]} times in {unit.name}"
                self._fail(unit, f"{unit.scene}: {times}", event.details)
                return
            if not state.over:
                self._listener.message(f"{state.label}: {event.reason}; {unit.name} is repeated")
        if not state.over:
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
