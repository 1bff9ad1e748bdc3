"""Where units run: in this process, in worker processes, on a Dask cluster.  The driver cannot tell them apart."""

from __future__ import annotations

from typing import Protocol

from taubench_gl.batch.units import Event, Slot, Unit


class Engine(Protocol):
    """A context manager; ``with`` starts the workers and stops them, whatever happens."""

    def __enter__(self) -> Engine: ...

    def __exit__(self, *exc: object) -> None: ...

    def describe(self) -> str:
        """One phrase for people: what runs the units."""

    def width(self) -> int:
        """Units that run at the same time, about."""

    def idle(self) -> list[Slot]:
        """Room for more units.  Empty with nothing in flight: no worker is left."""

    def submit(self, slot: Slot, unit: Unit) -> None:
        """Start a unit."""

    def wait(self) -> list[Event]:
        """Block until something has happened; called only while units are in flight."""
