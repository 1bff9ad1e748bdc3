"""Points out of records: what every setting and every path-traced render gets wrong, and what a frame of it costs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.cost.analysis import Point
from taubench_gl.cost.clock import time_of
from taubench_gl.cost.column_errors import Record, column_errors
from taubench_gl.cost.plan import Setting
from taubench_gl.cost.rounds import rounds_of
from taubench_gl.pathtraced.series import Render, SampleCountSeries


def errors_of(records: Iterable[Record]) -> dict[str, Record]:
    """Setting or render -> its ``error`` record."""
    errors = {r["setting"]: r for r in records if r["kind"] == "error"}
    return errors


def points_of(
    settings: Iterable[Setting],
    series: SampleCountSeries | None,
    records: Sequence[Record],
    reference: str,
    repeats: int,
    clock: str,
) -> list[Point]:
    """Points of ``settings`` and, last, of the renders of ``series``.

    ``records``: lines of kind ``error`` and ``time``, of which the first ``repeats`` rounds count.  ``reference``:
    setting or render that errors are measured against; ``clock``: of frames.
    """
    errors = errors_of(records)
    rounds: dict[str, list[Mapping[str, Any]]] = {}
    for r in rounds_of(r for r in records if r["kind"] == "time"):
        rounds.setdefault(r["setting"], []).append(r)
    truth = errors[reference]
    points = [_point(s, errors[s.name], rounds.get(s.name, [])[:repeats], truth, clock) for s in settings]
    return points + [_render_point(r, errors[r.name], truth) for r in (() if series is None else series.renders)]


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
        passes=passes,
        bytes=record.get("bytes"),
    )


def _render_point(render: Render, record: Record, reference: Record) -> Point:
    columns = column_errors(record, reference, same_pairs=True)
    time = time_of(render.frame_ms, in_turn=False) if render.frame_ms else None
    label, features = f"path-traced, {render.samples} spp", record.get("features") or {}
    return Point(render.name, label, "rung", {"spp": render.samples}, columns, time, render.clock, False, features)
