"""Points out of records: what every setting and every path-traced rung gets wrong, and what a frame of it costs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.cost.analysis import Point
from taubench_gl.cost.clock import time_of
from taubench_gl.cost.column_errors import Record, column_errors, curve_error
from taubench_gl.cost.plan import Setting
from taubench_gl.cost.rounds import rounds_of
from taubench_gl.cost.rungs import Ladder, Rung


def errors_of(records: Iterable[Record]) -> dict[str, Record]:
    """Setting or rung -> its ``error`` record."""
    errors = {r["setting"]: r for r in records if r["kind"] == "error"}
    return errors


def points_of(
    settings: Iterable[Setting],
    ladder: Ladder | None,
    records: Sequence[Record],
    reference: str,
    repeats: int,
    clock: str,
) -> list[Point]:
    """Points of ``settings`` and, last, of the rungs of ``ladder``.

    ``records``: lines of kind ``error`` and ``time``, of which the first ``repeats`` rounds count.  ``reference``:
    setting or rung that errors are measured against; ``clock``: of frames.
    """
    errors = errors_of(records)
    rounds: dict[str, list[Mapping[str, Any]]] = {}
    for r in rounds_of(r for r in records if r["kind"] == "time"):
        rounds.setdefault(r["setting"], []).append(r)
    truth = errors[reference]
    points = [_point(s, errors[s.name], rounds.get(s.name, [])[:repeats], truth, clock) for s in settings]
    return points + [_rung(r, errors[r.name], truth) for r in (() if ladder is None else ladder.rungs)]


def _point(setting: Setting, record: Record, rounds: Sequence[Record], reference: Record, clock: str) -> Point:
    names = sorted({name for r in rounds for name in r["passes"]})
    passes = {n: float(np.median([r["passes"].get(n, 0.0) for r in rounds])) for n in names}
    return Point(
        setting.name,
        setting.label,
        setting.role,
        setting.choice,
        column_errors(record, reference, same_pairs=setting.role != "question"),
        time_of([r["frame_ms"] for r in rounds]) if rounds else None,
        clock,
        usable=not setting.twin,
        features=record.get("features") or {},
        curve=curve_error(record, reference),
        passes=passes,
        bytes=record.get("bytes"),
    )


def _rung(rung: Rung, record: Record, reference: Record) -> Point:
    columns = column_errors(record, reference, same_pairs=True)
    time = time_of(rung.frame_ms, in_turn=False) if rung.frame_ms else None
    label, features = f"path-traced, {rung.samples} spp", record.get("features") or {}
    return Point(rung.name, label, "rung", {"spp": rung.samples}, columns, time, rung.clock, False, features)
