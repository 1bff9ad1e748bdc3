"""Engines: what runs the units of a study, which is this process, or worker processes on this machine."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path

from taubench_gl.data_files import opened
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.memory_budget import VARIABLE, limit
from taubench_gl.outputs import folder_in, log_file
from taubench_gl.study.unit import (
    ATTEMPTS,
    THREADS_VARIABLE,
    THREADS_VARIABLES,
    Advanced,
    Event,
    Failed,
    Finished,
    Lost,
    NoOpenGL,
    Unit,
    Worker,
)

MAX_WORKERS_PER_CORE = 32
"""A larger number of workers is taken for a typing error: it would fill the memory before any work is done."""

TAIL_BYTES = 4000
"""How much of the end of a dead worker's output becomes part of its failure."""


def available_cores() -> int:
    """Number of CPU cores that this process may use."""
    return len(os.sched_getaffinity(0))


def worker_environment(workers: int) -> dict[str, str]:
    """The environment of each of ``workers`` processes, which share the cores and the memory of this machine.

    A value that the user has set is kept.
    """
    threads = str(max(1, available_cores() // workers))
    memory = {VARIABLE: str(max(limit() // workers, 1 << 20))}
    return dict.fromkeys(THREADS_VARIABLES, threads) | memory | dict(os.environ)


class InProcess:
    """Runs units here, one after another.  ``with`` starts and stops an engine; its workers have numbers."""

    def __init__(self) -> None:
        self._worker = Worker(lambda event: self._advanced(event))
        self._advanced: Callable[[Advanced], None] = lambda event: None
        self._unit: Unit | None = None
        self._last: str | None = None

    def __enter__(self) -> InProcess:
        return self

    def __exit__(self, *exc: object) -> None:
        self._worker.release()

    def describe(self) -> str:
        """What runs the units, in one phrase for messages."""
        return "this process"

    def width(self) -> int:
        """Number of units that run at the same time."""
        return 1

    def idle(self) -> dict[int, str | None]:
        """Workers that can take a unit -> the job whose scene they have loaded."""
        return {0: self._last} if self._unit is None else {}

    def submit(self, worker: int, unit: Unit) -> None:
        """Start a unit on an idle worker."""
        self._unit, self._last = unit, unit.job

    def wait(self, advanced: Callable[[Advanced], None]) -> list[Event]:
        """Block until there is an event; ``advanced`` gets what occurs meanwhile.  Raises NoOpenGL.

        Called only while units run.
        """
        unit, self._unit, self._advanced = self._unit, None, advanced
        return [self._worker.attempt(unit)]


@dataclass(slots=True)
class _Process:
    """A worker process, and the unit that it runs."""

    number: int
    process: subprocess.Popen[bytes]
    connection: Connection
    log: Path
    unit: Unit | None = None
    last_job: str | None = None


class Processes:
    """Worker processes, replaced when they die; an engine with the methods of ``InProcess``.

    Their output goes to ``logs``/worker-N.log unless it is empty.
    """

    def __init__(self, workers: int, logs: Path):
        self._count, self._logs = workers, logs
        self._workers: list[_Process] = []
        self._lifeline: tuple[int, int] = (-1, -1)

    def __enter__(self) -> Processes:
        self._lifeline = os.pipe()
        folder_in(self._logs.parent, self._logs.name)
        for number in range(self._count):
            self._workers.append(self._spawn(number))
        return self

    def __exit__(self, *exc: object) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            self._reap(worker)
        self._workers.clear()
        for end in self._lifeline:
            os.close(end)

    def describe(self) -> str:
        threads = worker_environment(self._count)[THREADS_VARIABLE]
        processes = "process" if self._count == 1 else "processes"
        return f"{self._count} worker {processes}, GL threads of each: {threads}"

    def width(self) -> int:
        return self._count

    def idle(self) -> dict[int, str | None]:
        return {number: process.last_job for number, process in enumerate(self._workers) if process.unit is None}

    def submit(self, worker: int, unit: Unit) -> None:
        process = self._workers[worker]
        process.unit, process.last_job = unit, unit.job
        with contextlib.suppress(OSError):  # it is dead, which ``wait`` reports
            process.connection.send(unit)

    def wait(self, advanced: Callable[[Advanced], None]) -> list[Event]:
        busy = {worker.connection: worker for worker in self._workers if worker.unit is not None}
        events: list[Event] = []
        for connection in wait(list(busy)):
            worker = busy[connection]
            try:
                event = connection.recv()
            except (EOFError, OSError):
                events.append(self._replace(worker))
                continue
            if isinstance(event, NoOpenGL):
                raise event
            if isinstance(event, Finished | Failed):
                worker.unit = None
            events.append(event)
        return events

    def _spawn(self, number: int) -> _Process:
        ours, theirs = socket.socketpair()
        log = self._logs / f"worker-{number}.log"
        arguments = [str(theirs.fileno()), str(self._lifeline[0])]
        with log_file(log) as output:
            process = subprocess.Popen(
                [sys.executable, "-m", "taubench_gl.study.worker", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env=worker_environment(self._count),
                pass_fds=(theirs.fileno(), self._lifeline[0]),
                start_new_session=True,  # Ctrl-C goes to the driver, which ends its workers
            )
        theirs.close()
        return _Process(number, process, Connection(ours.detach()), log)

    def _replace(self, worker: _Process) -> Lost:
        """Start another process in place of one that died; returns why it died."""
        unit, code, tail = worker.unit, worker.process.wait(), _end_of(worker.log)
        self._reap(worker)
        self._workers[worker.number] = self._spawn(worker.number)
        if code == -signal.SIGALRM and unit.limit is not None:
            return Lost(unit, f"a frame took longer than {unit.limit:g} s (--time-limit)", tail, ATTEMPTS)
        return Lost(unit, how_it_ended(code), tail)

    def _reap(self, worker: _Process) -> None:
        worker.process.wait()
        worker.connection.close()
        if worker.log.exists() and worker.log.stat().st_size == 0:
            worker.log.unlink()


Engine = InProcess | Processes


def engine(workers: int, logs: Path) -> Engine:
    """The engine of ``workers`` processes; of this process if it is 0.  Raises SettingsError.

    ``logs``: folder for the output of worker processes.
    """
    most = MAX_WORKERS_PER_CORE * available_cores()
    if not 0 <= workers <= most:
        raise SettingsError(f"workers is {workers}", hint=f"give 0 to {most}; one per core is enough")
    return Processes(workers, logs) if workers else InProcess()


def how_it_ended(code: int) -> str:
    """The exit code of a worker process in words."""
    if code >= 0:
        return f"its worker ended with exit code {code}"
    try:
        return f"its worker was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"its worker was killed by signal {-code}"


def _end_of(path: Path) -> str:
    """The last TAIL_BYTES of a log as text; empty where it cannot be read."""
    try:
        with opened(path, links=False) as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - TAIL_BYTES))
            return file.read(TAIL_BYTES).decode(errors="replace")
    except (OSError, OutputError):
        return ""
