"""Rounds: all settings visited in turn, several times over, and what counts of these visits."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from taubench_gl.cost.plan import Setting

SWEEPS = 3
"""Times that a round goes over all settings, A B C A B C A B C: what a machine does for seconds hits one visit of
three, and their median is what the round says."""


def due_visits(
    settings: Iterable[Setting], rounds: int, done: Iterable[Mapping[str, Any]]
) -> list[tuple[int, int, Setting]]:
    """(round, sweep, setting) still to be timed: A B C A B C, never A A A B B B."""
    counted: dict[str, int] = defaultdict(int)
    for record in done:
        counted[record["setting"]] += 1
    settings = list(settings)
    order = ((r, k) for r in range(rounds) for k in range(SWEEPS))
    return [(r, k, s) for r, k in order for s in settings if counted[s.name] <= r * SWEEPS + k]


def rounds_of(visits: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One record for every setting and finished round, in their order: of each time the median of its visits.

    ``visits``: records with ``setting``, ``round`` and times in ms, ``frame_ms`` and what else there is of ``base_ms``
    (number) and ``passes`` (name -> number, 0 where a visit lacks it).
    """
    groups: dict[tuple[str, int], list[Mapping[str, Any]]] = {}
    for visit in visits:
        groups.setdefault((visit["setting"], visit["round"]), []).append(visit)
    return [_median(group) for group in groups.values() if len(group) == SWEEPS]


def _median(visits: list[Mapping[str, Any]]) -> dict[str, Any]:
    out = {k: visits[0][k] for k in ("setting", "round")}
    out |= {k: statistics.median(v[k] for v in visits) for k in ("frame_ms", "base_ms") if k in visits[0]}
    if "passes" in visits[0]:
        names = sorted({name for v in visits for name in v["passes"]})
        out["passes"] = {n: statistics.median(v["passes"].get(n, 0.0) for v in visits) for n in names}
    return out
