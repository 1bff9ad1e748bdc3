"""Runs a batch spec in a folder, reports the state of a batch, and writes the tables of its finished jobs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.batch.driver import Driver, Listener, Outcome
from taubench_gl.batch.merge import job_positions, labelled, write_tables
from taubench_gl.batch.partition import require_pyarrow
from taubench_gl.batch.spec import BatchSpec
from taubench_gl.batch.store import LOGS, Store
from taubench_gl.batch.units import Engine, PairDone
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.folder_lock import FolderLock, lock_holder
from taubench_gl.run import SUMMARY_FILE, load_run

ENGINES = "dask://HOST:PORT, dask-local"

MAX_WORKERS_PER_CORE = 32
"""A larger number of workers is taken for a typing error: it would fill the memory before any work is done."""


def make_engine(name: str | None, workers: int | None, logs: Path, on_pair: Callable[[PairDone], None]) -> Engine:
    """``name``: None (this process, or ``workers`` processes), ``dask-local`` or ``dask://HOST:PORT``.

    Raises SettingsError.
    """
    if workers is not None and workers < 1:
        raise SettingsError(f"workers is {workers}", hint="give 1 or more")
    from taubench_gl.batch.engines import InProcess, Processes, available_cores

    most = MAX_WORKERS_PER_CORE * available_cores()
    if workers is not None and workers > most:
        raise SettingsError(f"workers is {workers}", hint=f"give at most {most}; one per core is enough")
    if name is None:
        return InProcess(on_pair) if workers is None else Processes(workers, logs)
    scheme, separator, address = name.partition("://")
    if name != "dask-local" and (scheme not in ("dask", "tcp", "tls") or not separator or not address):
        raise SettingsError(f"no engine is named {name!r}", hint=f"choose from {ENGINES}, or --workers N")
    from taubench_gl.batch.cluster import DaskCluster

    if name == "dask-local":
        return DaskCluster(None, workers)
    if workers is not None:
        raise SettingsError("--workers does not apply to a running cluster", where=name, hint="leave --workers out")
    return DaskCluster(f"{'tcp' if scheme == 'dask' else scheme}://{address}")


def run_batch(
    spec: BatchSpec | None,
    out: str | Path,
    *,
    engine: str | None = None,
    workers: int | None = None,
    chunk: int | None = None,
    listener: Listener | None = None,
) -> Outcome:
    """Run the missing part of ``spec`` in the folder ``out``; None: of the spec stored there.

    Results do not depend on ``engine``, ``workers`` or ``chunk``.  Scenes that fail are listed in the outcome.  Raises
    TaubenchError.
    """
    require_pyarrow()
    if chunk is not None and chunk < 1:
        raise SettingsError(f"chunk is {chunk}", hint="give 1 pair or more")
    store = Store(out)
    spec = spec or store.load_spec()
    driver = Driver(spec, store, listener, chunk)
    made = make_engine(engine, workers, store.out / LOGS, driver.on_pair)
    store.require_usable()  # before the lock file is written
    with FolderLock(store.out):
        store.require_usable()
        with made as running:
            store.save_spec(spec)
            jobs = len(spec.jobs)
            driver.listener.message(f"{jobs} job{'' if jobs == 1 else 's'} on {running.describe()}")
            return driver.run(running)


@dataclass(frozen=True, slots=True)
class JobStatus:
    """State of one job: waiting, part, done or failed.  ``total`` None: number of pairs not known yet."""

    id: str
    label: str
    state: str
    done: int
    total: int | None
    reason: str | None


def batch_status(out: str | Path) -> tuple[str, str | None, list[JobStatus]]:
    """Name of the batch, the process that runs it now (None: no process), and the state of each job."""
    require_pyarrow()
    store = Store(out)
    spec = store.load_spec()
    found = []
    for job in spec.jobs:
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
    return spec.name, lock_holder(store.out), found


def batch_report(out: str | Path) -> tuple[list[Any], list[str]]:
    """Write the tables of all finished jobs; returns the tables, and the labels of jobs that are not finished."""
    store = Store(out)
    spec = store.load_spec()
    summaries, missing = [], []
    for job in spec.jobs:
        if (store.job(job.id) / SUMMARY_FILE).is_file():
            summaries.append(labelled(job, load_run(store.job(job.id)).summary))
        else:
            missing.append(job.label)
    if not summaries:
        raise OutputError("no job is finished yet", where=str(store.out), hint="taubench-gl batch status, or resume")
    return write_tables(store, summaries), missing
