"""What a driver runs: the units of its jobs, and how their results are merged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taubench_gl.study.store import Store
from taubench_gl.study.unit import Unit


class Study:
    """What a driver runs: the jobs of a study, the units that they lack, and how records become results.

    A subclass with one unit per job sets ``units``; others say themselves what a job lacks (``missing``).
    """

    store: Store  # where the driver keeps the records of units
    units: Mapping[str, Unit]  # job -> its unit, in the order of the work
    failed: dict[str, str]  # job -> why it failed

    def __init__(self, store: Store) -> None:
        self.store = store
        self.failed = {}

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
        """Write the results of a job, no unit of which is missing."""

    def fail(self, unit: Unit, message: str, details: str) -> bool:
        """Note that a unit has no result.  -> whether the other units of its job are still of use."""
        self.failed[unit.job] = message
        self.store.log_failure(unit.job, message, details)
        return False

    def merge(self) -> Any:
        """Write the results of all jobs, after the last one has ended.  -> what the study's caller gets."""
        raise NotImplementedError
