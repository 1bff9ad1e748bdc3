"""Dask: a cluster that is already there (SLURM, Kubernetes, SSH: by Dask's own deployers), or one made here."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from queue import Empty, Queue
from typing import Any

from taubench_gl.batch.engines.inprocess import attempt
from taubench_gl.batch.engines.processes import THREADS_VARIABLE, available_cores
from taubench_gl.batch.units import ATTEMPTS, Event, Lost, NoGraphics, Slot, Unit
from taubench_gl.batch.work import NoOpenGL, Workbench, warm_up
from taubench_gl.errors import TaubenchError

CONNECT_SECONDS = 30
AHEAD = 2
"""Units each worker is given: one to run, one so that it need not wait for the driver."""

UNPLACED = 16
"""Units handed to the scheduler while there is no worker at all: what an adaptive cluster needs to see to grow."""


class DaskCluster:
    """``address`` of a scheduler (tcp://host:port), or None: ``workers`` processes here with one GL thread each."""

    def __init__(self, address: str | None, workers: int | None = None):
        self._address, self._count = address, workers or available_cores()
        self._client: Any = None
        self._cluster: Any = None
        self._done: Queue[Any] = Queue()
        self._flying: dict[str, tuple[Any, Unit, str | None]] = {}  # key -> future, unit, worker it was meant for
        self._last: dict[str, str] = {}  # worker -> job
        self._barren: set[str] = set()
        self._numbers = iter(range(1 << 62))

    def __enter__(self) -> DaskCluster:
        try:
            import dask
            import distributed
        except ImportError:
            raise TaubenchError("Dask is not installed", hint="pip install 'taubench-gl[cluster]'") from None
        try:
            if self._address is None:
                # One GL thread in each: as many threads as processes, and no two of them draw in one process.
                one = {"distributed.nanny.pre-spawn-environ": {THREADS_VARIABLE: "1", "OMP_NUM_THREADS": "1"}}
                with dask.config.set(one):
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
        except RuntimeError as error:  # so says Dask when its worker processes do not come up
            self.__exit__()
            hint = "in a script of your own, call this under if __name__ == '__main__'"
            raise TaubenchError(f"Dask's workers do not start: {error}", where="dask-local", hint=hint) from None
        except (OSError, TimeoutError, ValueError) as error:
            self.__exit__()
            where = self._address or "dask-local"
            hint = "give the address that dask-scheduler printed, such as tcp://host:8786"
            raise TaubenchError(f"no Dask scheduler answers: {error}", where=where, hint=hint) from None
        return self

    def __exit__(self, *exc: object) -> None:
        for future, _, _ in self._flying.values():
            future.cancel()
        for part in (self._client, self._cluster):
            if part is not None:
                part.close()

    def describe(self) -> str:
        if self._address is None:
            return f"{self._count} Dask worker{'' if self._count == 1 else 's'} here, one GL thread each"
        return f"Dask at {self._address}, workers: {len(self._workers())}"

    def width(self) -> int:
        return max(len(self._workers()), 1)

    def _workers(self) -> list[str]:
        info = self._client.scheduler_info(n_workers=-1)
        return [address for address in info["workers"] if address not in self._barren]

    def idle(self) -> list[Slot]:
        load = Counter(worker for _, _, worker in self._flying.values())
        workers = self._workers()
        if not workers:
            if self._barren:
                return []
            return [Slot(None)] * max(UNPLACED - len(self._flying), 0)
        # Round by round, so that every worker has one before any has two.
        return [Slot(w, self._last.get(w)) for held in range(AHEAD) for w in workers if load[w] <= held]

    def submit(self, slot: Slot, unit: Unit) -> None:
        where: dict[str, Any] = {}
        if slot.key is not None:
            where = {"workers": [slot.key], "allow_other_workers": True}
            self._last[slot.key] = unit.job
        key = f"taubench-{unit.job}-{next(self._numbers)}"
        future = self._client.submit(run_on_worker, unit, key=key, pure=False, **where)
        self._flying[key] = (future, unit, slot.key)
        future.add_done_callback(self._done.put)

    def wait(self) -> list[Event]:
        futures = [self._next()]
        while not self._done.empty():
            futures.append(self._done.get())
        return [event for future in futures for event in self._ended(future)]

    def _next(self) -> Any:
        while True:
            try:
                return self._done.get(timeout=CONNECT_SECONDS)
            except Empty:
                if self._client.status in ("closing", "closed"):
                    where = self._address or "dask-local"
                    raise TaubenchError(
                        "the Dask scheduler is gone", where=where, hint="resume when it is back"
                    ) from None

    def _ended(self, future: Any) -> list[Event]:
        _, unit, _ = self._flying.pop(future.key, (None, None, None))
        if unit is None:
            return []
        if future.status == "finished":
            event = future.result()
            if isinstance(event, NoGraphics):
                known = event.worker in self._barren
                self._barren.add(event.worker)
                return [NoGraphics("" if known else event.worker, event.message, unit)]
            return [event]
        error = future.exception() if future.status == "error" else "the scheduler gave it up"
        # Dask itself has tried again on other workers (distributed.scheduler.allowed-failures).
        return [Lost(unit, f"its workers died or could not run it: {' '.join(str(error).split())}", tried=ATTEMPTS)]


_bench = Workbench()
_thread = ThreadPoolExecutor(1, thread_name_prefix="taubench-gl")


def dask_setup(worker: Any) -> None:
    """Dask calls this on workers started with ``--preload`` and this module's name: all is imported when they join."""
    warm_up()


def run_on_worker(unit: Unit) -> Event:
    """On a Dask worker: all GL of a process on one thread, however many the worker has."""
    from distributed import get_worker

    try:
        return _thread.submit(attempt, _bench, unit).result()
    except NoOpenGL as error:
        return NoGraphics(str(get_worker().address), str(error), unit)
