"""The Dask engine: an existing cluster (started by Dask's own deployers), or a local one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from queue import Empty, Queue
from typing import Any

from taubench_gl.errors import TaubenchError
from taubench_gl.study.unit import (
    ATTEMPTS,
    THREADS_VARIABLES,
    Advanced,
    Event,
    Lost,
    NoGraphics,
    NoOpenGL,
    Slot,
    Unit,
    Worker,
)
from taubench_gl.study.worker import warm_up

CONNECT_SECONDS = 30
AHEAD = 2
"""Units per worker in flight: one that runs and one that waits, so that no worker waits for the driver."""

UNASSIGNED = 16
"""Units submitted while there is no worker: an adaptive cluster grows only while tasks wait."""


class DaskCluster:
    """Runs units on the workers of a Dask scheduler, as an Engine (``study.unit``)."""

    def __init__(self, address: str | None, workers: int = 1):
        """Connect to the scheduler at ``address``, tcp://host:port; None: start ``workers`` local processes."""
        self._address, self._count = address, workers
        self._client: Any = None
        self._cluster: Any = None
        self._done: Queue[Any] = Queue()
        self._in_flight: dict[str, tuple[Any, Unit, str | None]] = {}  # key -> future, unit, worker
        self._last: dict[str, str] = {}  # worker -> job
        self._without_gl: set[str] = set()
        self._numbers = iter(range(1 << 62))

    def __enter__(self) -> DaskCluster:
        try:
            import dask
            import distributed
        except ImportError:
            raise TaubenchError("Dask is not installed", hint="pip install 'taubench-gl[cluster]'") from None
        try:
            if self._address is None:
                # One thread of a kind per process, so that all processes together have one per core.
                environment = {"distributed.nanny.pre-spawn-environ": dict.fromkeys(THREADS_VARIABLES, "1")}
                # The driver gives workers units of the job they have loaded; a stolen unit would load another one.
                with dask.config.set(environment | {"distributed.scheduler.work-stealing": False}):
                    self._cluster = distributed.LocalCluster(
                        n_workers=self._count,
                        threads_per_worker=1,
                        processes=True,
                        dashboard_address="127.0.0.1:0",
                        preload=[__name__],
                    )
                self._client = distributed.Client(self._cluster)
            else:
                self._client = distributed.Client(self._address, timeout=CONNECT_SECONDS)
        except RuntimeError as error:  # Dask raises this when its worker processes do not start
            self.__exit__()
            hint = "a script must call this under if __name__ == '__main__'"
            raise TaubenchError(f"the Dask workers do not start: {error}", where="dask-local", hint=hint) from None
        except (OSError, TimeoutError, ValueError) as error:
            self.__exit__()
            where = self._address or "dask-local"
            hint = "give the address that dask-scheduler printed, such as tcp://host:8786"
            raise TaubenchError(f"no Dask scheduler answers: {error}", where=where, hint=hint) from None
        return self

    def __exit__(self, *exc: object) -> None:
        for future, _, _ in self._in_flight.values():
            future.cancel()
        for part in (self._client, self._cluster):
            if part is not None:
                part.close()

    def describe(self) -> str:
        if self._address is None:
            return f"{self._count} local Dask worker{'' if self._count == 1 else 's'}, one GL thread each"
        return f"Dask at {self._address}, workers: {len(self._workers())}"

    def width(self) -> int:
        return max(len(self._workers()), 1)

    def _workers(self) -> list[str]:
        """Addresses of the workers that are there now, without those that have no OpenGL."""
        info = self._client.scheduler_info(n_workers=-1)
        return [address for address in info["workers"] if address not in self._without_gl]

    def idle(self) -> list[Slot]:
        load = Counter(worker for _, _, worker in self._in_flight.values())
        workers = self._workers()
        if not workers:
            waiting = 0 if self._without_gl else max(UNASSIGNED - len(self._in_flight), 0)
            return [Slot(None)] * waiting
        # Every worker gets one unit before any worker gets two.
        return [Slot(w, self._last.get(w), load[w] > 0) for held in range(AHEAD) for w in workers if load[w] <= held]

    def submit(self, slot: Slot, unit: Unit) -> None:
        where: dict[str, Any] = {}
        if slot.key is not None:
            where = {"workers": [slot.key], "allow_other_workers": True}
            self._last[slot.key] = unit.job
        key = f"taubench-{unit.job}-{next(self._numbers)}"
        future = self._client.submit(run_on_worker, unit, key=key, pure=False, **where)
        self._in_flight[key] = (future, unit, slot.key)
        future.add_done_callback(self._done.put)

    def wait(self, advanced: Callable[[Advanced], None]) -> list[Event]:
        futures = [self._next()]
        while not self._done.empty():
            futures.append(self._done.get())
        return [event for future in futures for event in self._ended(future)]

    def _next(self) -> Any:
        """The next future that has ended.  Raises TaubenchError if the scheduler has stopped."""
        while True:
            try:
                return self._done.get(timeout=CONNECT_SECONDS)
            except Empty:
                if self._client.status in ("closing", "closed"):
                    where = self._address or "dask-local"
                    raise TaubenchError(
                        "the Dask scheduler has stopped", where=where, hint="resume when it runs again"
                    ) from None

    def _ended(self, future: Any) -> list[Event]:
        """The event of a future that has ended; none for one that is no longer awaited."""
        _, unit, _ = self._in_flight.pop(future.key, (None, None, None))
        if unit is None:
            return []
        if future.status == "finished":
            event = future.result()
            if isinstance(event, NoGraphics):
                reported = event.worker in self._without_gl
                self._without_gl.add(event.worker)
                return [NoGraphics("" if reported else event.worker, event.message, unit)]
            return [event]
        error = future.exception() if future.status == "error" else "the scheduler cancelled it"
        # Dask has already repeated it on other workers (distributed.scheduler.allowed-failures).
        return [Lost(unit, f"its workers died or could not run it: {' '.join(str(error).split())}", attempts=ATTEMPTS)]


_worker = Worker(limited=True)
_thread = ThreadPoolExecutor(1, thread_name_prefix="taubench-gl")


def dask_setup(dask_worker: Any) -> None:
    """Import what units need before a worker joins: Dask calls this on workers started with ``--preload``."""
    warm_up()


def run_on_worker(unit: Unit) -> Event:
    """Run a unit on a Dask worker: all GL calls of the process are made on one thread, whatever threads it has."""
    from distributed import get_worker

    try:
        return _thread.submit(_worker.attempt, unit).result()
    except NoOpenGL as error:
        return NoGraphics(str(get_worker().address), str(error), unit)
