"""What a setting may cost and get wrong, from settings that were measured: enough to choose what to measure next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.study.knobs import KNOBS, Situation

Choice = Mapping[str, Any]
"""Dials that are off the base, and their values."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A setting of which the errors are known.  ``choice``: dials off the base; None: it has none (a render)."""

    name: str
    choice: Choice | None
    log_time: float  # log of its time over the base's
    errors: Mapping[str, float]  # front -> points
    timed: bool = True  # False: ``log_time`` is a forecast


class Forecast:
    """Log times add up over dials, errors as squares do; between measured values of a dial both are interpolated.

    Dials do not quite multiply (what is fixed in a frame does not shrink with the picture), so a time is taken relative
    to that of the timed setting that is nearest in time, dial by dial.
    """

    def __init__(self, situation: Situation, dials: Sequence[str], seen: Sequence[Seen]):
        """``seen``: timed settings, the base among them; ``dials``: those that trade, of which alone it is asked."""
        self._situation, self._dials = situation, tuple(dials)
        self._tables: dict[str, dict[Any, Seen]] = {}
        self._known: dict[tuple[str, Any], float] = {}
        chosen = [(s, {d: v for d, v in s.choice.items() if d in dials}) for s in seen if s.choice is not None]
        base = next((s for s, _ in chosen if not s.choice), None)
        for dial in dials:
            table = {} if base is None else {KNOBS[dial].current(situation.base): base}
            for s, choice in chosen:
                if set(choice) == {dial}:
                    table.setdefault(choice[dial], s)
            self._tables[dial] = table
        times = np.array([s.log_time for s, _ in chosen])
        self._places = np.array([self._parts(choice) for _, choice in chosen]).reshape(len(chosen), len(dials))
        self._rest = times - self._places.sum(axis=1)

    def log_time(self, choice: Choice) -> float:
        """Log of its time over the base's."""
        parts = self._parts(choice)
        if not len(self._rest):
            return float(parts.sum())
        nearest = int(np.abs(self._places - parts).sum(axis=1).argmin())
        return float(parts.sum() + self._rest[nearest])

    def error(self, choice: Choice, front: str) -> float:
        """Points."""
        return math.hypot(*(self._at(d, v, lambda s: s.errors.get(front, 0.0)) for d, v in choice.items()))

    def _parts(self, choice: Choice) -> np.ndarray:
        """Log time that each dial adds.  (dials,) float64."""
        return np.array([self._time_of(d, choice[d]) if d in choice else 0.0 for d in self._dials])

    def _time_of(self, dial: str, value: Any) -> float:
        if (dial, value) not in self._known:
            self._known[dial, value] = self._at(dial, value, lambda s: s.log_time)
        return self._known[dial, value]

    def _at(self, dial: str, value: Any, read: Callable[[Seen], float]) -> float:
        table = self._tables.get(dial, {})
        if value in table:
            return read(table[value])
        place = KNOBS[dial].place
        known = sorted((p, read(s)) for v, s in table.items() if (p := place(self._situation, v)) is not None)
        at = place(self._situation, value)
        if at is None or not known:
            return 0.0
        return float(np.interp(at, *zip(*known)))
