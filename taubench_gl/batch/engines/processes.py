"""Worker processes on this machine: spawned, kept for the whole study, replaced when they die."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path

from taubench_gl.batch.units import Event, Failed, Finished, Lost, NoGraphics, Slot, Unit

THREADS_VARIABLE = "LP_NUM_THREADS"
"""Threads that Mesa's software rasterizer starts in a process; on other drivers it means nothing."""

TAIL_BYTES = 4000


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0))


def worker_environment(workers: int) -> dict[str, str]:
    """The environment of each of ``workers`` processes: together they have as many GL threads as there are cores.

    A number that the user has set stays.
    """
    threads = str(max(1, available_cores() // workers))
    return {THREADS_VARIABLE: threads} | dict(os.environ)


@dataclass(slots=True)
class _Worker:
    number: int
    process: subprocess.Popen[bytes]
    connection: Connection
    said: Path
    unit: Unit | None = None
    last_job: str | None = None
    events: list[Event] = field(default_factory=list)


class Processes:
    """``workers`` processes; what they print goes to ``logs``/worker-N.log, kept only where there is something."""

    def __init__(self, workers: int, logs: Path):
        self._count, self._logs = workers, logs
        self._workers: list[_Worker] = []
        self._lifeline: tuple[int, int] = (-1, -1)
        self._barren = 0  # workers without OpenGL: not replaced

    def __enter__(self) -> Processes:
        self._lifeline = os.pipe()
        self._logs.mkdir(parents=True, exist_ok=True)
        for number in range(self._count):
            self._workers.append(self._spawn(number))
        return self

    def __exit__(self, *exc: object) -> None:
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            self._bury(worker)
        self._workers.clear()
        for end in self._lifeline:
            os.close(end)

    def describe(self) -> str:
        threads = worker_environment(self._count)[THREADS_VARIABLE]
        processes = "process" if self._count == 1 else "processes"
        return f"{self._count} worker {processes}, GL threads of each: {threads}"

    def width(self) -> int:
        return self._count

    def idle(self) -> list[Slot]:
        return [Slot(worker.number, worker.last_job) for worker in self._workers if worker.unit is None]

    def submit(self, slot: Slot, unit: Unit) -> None:
        worker = next(w for w in self._workers if w.number == slot.key)
        worker.unit, worker.last_job = unit, unit.job
        with contextlib.suppress(OSError):  # it is dead, which ``wait`` will find and tell
            worker.connection.send(unit)

    def wait(self) -> list[Event]:
        busy = {worker.connection: worker for worker in self._workers if worker.unit is not None}
        events: list[Event] = []
        for connection in wait(list(busy)):
            worker = busy[connection]
            try:
                event = connection.recv()
            except (EOFError, OSError):
                events.append(self._replace(worker))
                continue
            if isinstance(event, NoGraphics):
                self._workers.remove(worker)
                worker.process.wait()
                self._bury(worker)
            elif isinstance(event, Finished | Failed):
                worker.unit = None
            events.append(event)
        return events

    def _spawn(self, number: int) -> _Worker:
        ours, theirs = socket.socketpair()
        said = self._logs / f"worker-{number}.log"
        arguments = [str(theirs.fileno()), str(self._lifeline[0])]
        with open(said, "ab") as output:
            process = subprocess.Popen(
                [sys.executable, "-m", "taubench_gl.batch.worker", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env=worker_environment(self._count),
                pass_fds=(theirs.fileno(), self._lifeline[0]),
                start_new_session=True,  # Ctrl-C is the driver's, which then ends its workers
            )
        theirs.close()
        return _Worker(number, process, Connection(ours.detach()), said)

    def _replace(self, worker: _Worker) -> Lost:
        """A worker died: say what of, and put another in its place."""
        worker.process.wait()
        reason, tail = how_it_ended(worker.process.returncode), _tail(worker.said)
        unit = worker.unit
        self._bury(worker)
        self._workers[self._workers.index(worker)] = self._spawn(worker.number)
        return Lost(unit, reason, tail)

    def _bury(self, worker: _Worker) -> None:
        worker.process.wait()
        worker.connection.close()
        if worker.said.exists() and worker.said.stat().st_size == 0:
            worker.said.unlink()


def how_it_ended(code: int) -> str:
    if code >= 0:
        return f"its worker ended with exit code {code}"
    try:
        return f"its worker was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"its worker was killed by signal {-code}"


def _tail(path: Path) -> str:
    try:
        return path.read_bytes()[-TAIL_BYTES:].decode(errors="replace")
    except OSError:
        return ""
