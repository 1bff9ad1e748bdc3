"""``run_study``: a study, a folder and an engine's name -> results; and what a folder holds at this moment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.batch.driver import Driver, Listener, Outcome
from taubench_gl.batch.engines import Engine
from taubench_gl.batch.lock import FolderLock, holder
from taubench_gl.batch.merge import job_positions, labelled, write_tables
from taubench_gl.batch.partition import require_pyarrow
from taubench_gl.batch.store import LOGS, Store
from taubench_gl.batch.study import Study
from taubench_gl.batch.units import PairDone
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.run import SUMMARY_FILE, load_run

ENGINES = "dask://HOST:PORT, dask-local"

WORKERS_A_CORE = 32
"""Worker processes started here at most: more are a slip of the keys, which would take all memory before any work."""


def make_engine(name: str | None, workers: int | None, logs: Path, on_pair: Callable[[PairDone], None]) -> Engine:
    """``name``: None (here, or ``workers`` processes), ``dask-local`` or ``dask://HOST:PORT``.

    Raises SettingsError.
    """
    if workers is not None and workers < 1:
        raise SettingsError(f"workers is {workers}", hint="give 1 or more")
    from taubench_gl.batch.engines.processes import Processes, available_cores

    most = WORKERS_A_CORE * available_cores()
    if workers is not None and workers > most:
        raise SettingsError(f"workers is {workers}", hint=f"give at most {most} on this machine: one a core is plenty")
    if name is None:
        from taubench_gl.batch.engines.inprocess import InProcess

        return InProcess(on_pair) if workers is None else Processes(workers, logs)
    scheme, separator, address = name.partition("://")
    if name != "dask-local" and (scheme not in ("dask", "tcp", "tls") or not separator or not address):
        raise SettingsError(f"no engine is named {name!r}", hint=f"choose from {ENGINES}, or --workers N")
    from taubench_gl.batch.engines.cluster import DaskCluster

    if name == "dask-local":
        return DaskCluster(None, workers)
    if workers is not None:
        raise SettingsError("a cluster has the workers it has", where=name, hint="leave --workers out")
    return DaskCluster(f"{'tcp' if scheme == 'dask' else scheme}://{address}")


def run_study(
    study: Study | None,
    out: str | Path,
    *,
    engine: str | None = None,
    workers: int | None = None,
    chunk: int | None = None,
    listener: Listener | None = None,
) -> Outcome:
    """Run what is missing of ``study`` in ``out``; None: of the study that ``out`` was last given.

    Results do not depend on ``engine``, ``workers`` or ``chunk``.  Raises TaubenchError; scenes that fail are told in
    the outcome.
    """
    require_pyarrow()
    if chunk is not None and chunk < 1:
        raise SettingsError(f"chunk is {chunk}", hint="give 1 pair or more")
    store, drivers = Store(out), []
    made = make_engine(engine, workers, store.out / LOGS, lambda event: drivers[0].on_pair(event))
    if study is None:
        study = store.load_study()
    store.require_ours()  # before anything of ours is there, the lock's file included
    with FolderLock(store.out):
        store.require_ours()
        with made as running:
            store.save_study(study)
            if listener is not None:
                jobs = len(study.jobs)
                listener.say(f"{jobs} job{'' if jobs == 1 else 's'} on {running.describe()}")
            drivers.append(Driver(study, store, running, listener, chunk))
            return drivers[0].run()


@dataclass(frozen=True, slots=True)
class JobStatus:
    """``total`` None: not known yet.  ``state``: waiting, part, done, failed."""

    id: str
    label: str
    state: str
    done: int
    total: int | None
    reason: str | None


def study_status(out: str | Path) -> tuple[str, str | None, list[JobStatus]]:
    """Name of the study, who is driving it now (None: nobody), and how far each job is."""
    require_pyarrow()
    store = Store(out)
    study = store.load_study()
    found = []
    for job in study.jobs:
        head, reason = store.known_head(job.id), store.failure(job.id)
        positions = None if head is None else job_positions(job, head)
        counted = [] if head is None else store.known_positions(job.id)
        done = 0 if positions is None else len(set(counted) & set(positions))
        state = "part" if done else "waiting"
        if reason is not None:
            state = "failed"
        elif head is not None and (store.job(job.id) / SUMMARY_FILE).is_file():
            state, done = "done", len(positions)
        found.append(JobStatus(job.id, job.label, state, done, None if positions is None else len(positions), reason))
    return study.name, holder(store.out), found


def study_report(out: str | Path) -> tuple[list[Any], list[str]]:
    """Tables of all finished jobs, written beside the study's summary; and the labels of jobs that are not finished."""
    store = Store(out)
    study = store.load_study()
    summaries, missing = [], []
    for job in study.jobs:
        if (store.job(job.id) / SUMMARY_FILE).is_file():
            summaries.append(labelled(job, load_run(store.job(job.id)).summary))
        else:
            missing.append(job.label)
    if not summaries:
        raise OutputError("no job is finished yet", where=str(store.out), hint="taubench-gl batch status, or resume")
    return write_tables(store, summaries), missing
