"""Runs a study in its folder, on an engine by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taubench_gl.errors import SettingsError
from taubench_gl.folder_lock import FolderLock
from taubench_gl.study.driver import Driver
from taubench_gl.study.engines import InProcess, Processes, available_cores
from taubench_gl.study.progress import Listener
from taubench_gl.study.store import LOGS
from taubench_gl.study.study import Study
from taubench_gl.study.unit import Engine

ENGINES = "dask://HOST:PORT, dask-local"

MAX_WORKERS_PER_CORE = 32
"""A larger number of workers is taken for a typing error: it would fill the memory before any work is done."""


def make_engine(name: str | None, workers: int | None, logs: Path) -> Engine:
    """``name``: None (this process, or ``workers`` processes), ``dask-local`` or ``dask://HOST:PORT``.

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
    own: tuple[str, ...] = (),
    *,
    engine: str | Engine | None = None,
    workers: int | None = None,
    listener: Listener | None = None,
) -> Any:
    """Run what is missing of ``study`` and write its results.  -> what ``Study.merge`` returns.

    ``about``: values of its ``study.json``; ``own``: those that an earlier run in the folder must have had, too.
    ``engine``: a name (``make_engine``), or an Engine.  Results do not depend on it.  Raises TaubenchError.
    """
    store, listener = study.store, listener or Listener()
    made = make_engine(engine, workers, store.out / LOGS) if engine is None or isinstance(engine, str) else engine
    same = {name: about[name] for name in own}
    store.require_usable(same)  # before the lock file is written
    with FolderLock(store.out):
        store.require_usable(same)
        with made as running:
            store.write_about(about)
            listener.begin(len(study.jobs()), running.describe())
            Driver(study, running, listener).run()
        return study.merge()
