"""What a driver runs: the units of its jobs, and how their results are merged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taubench_gl.study.store import Store
from taubench_gl.study.unit import Unit


class Study:
    """A study of one unit per job: ``units``, by job, in the order of the work.  Others say what a job lacks.

    ``store``: where the driver keeps the records of units; ``failed``: job -> why it failed.
    """

    store: Store
    units: Mapping[str, Unit]

    def __init__(self, store: Store) -> None:
        self.store = store
        self.failed: dict[str, str] = {}

    def jobs(self) -> Mapping[str, str]:
        """Job -> label for messages, in the order of the work."""
        return {job: job for job in self.units}

    def missing(self, job: str, width: int) -> tuple[Sequence[Unit], int]:
        """Units of a job that have no record, and the weight of all its units; 0 while it is not known.

        ``width``: units that run at the same time.  When these are done the driver asks again, until there are none.
        """
        unit = self.units[job]
        return [] if self.store.load(unit.key) is not None else [unit], unit.weight

    def instead(self, unit: Unit, died: bool) -> Sequence[Unit]:
        """Units in place of one that is about to run, or whose worker ``died``; ``(unit,)`` to run it as it is."""
        return (unit,)

    def finish(self, job: str) -> None:
        """No unit of the job is missing."""

    def fail(self, unit: Unit, message: str, details: str) -> bool:
        """The unit has no result.  -> whether the other units of its job are still of use."""
        self.failed[unit.job] = message
        self.store.log_failure(unit.job, message, details)
        return False

    def merge(self) -> Any:
        """Write the results of all jobs, after the last one has ended."""
        raise NotImplementedError
