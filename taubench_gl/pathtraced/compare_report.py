"""Comparison of two runs (``compare.py``) as tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from taubench_gl.report.table import NONE, Column, Row, Table

Result = Mapping[str, Any]
_FEATURES = {
    "position_mm": "position", "normal_deg": "normal", "direct_percent": "direct, relative",
    "indirect_percent": "indirect, relative", "color_levels": "color",
}  # fmt: skip


def comparison_tables(result: Result) -> list[Table]:
    """Tables of columns, features and times; above the first what was compared, and the worst pair."""
    (run, reference), size = result["runs"], "x".join(map(str, result["size"]))
    lead = [f"{run} and reference {reference}: {result['pairs']} pairs, {size}, {result['fps'][1]:g} fps"]
    lead += [f"the runs differ in {name}: {_plain(a)} and {_plain(b)}"
             for name, (a, b) in result["settings_that_differ"].items()]  # fmt: skip
    if "frame" in (worst := result["worst"]):
        frames = f"{worst['frame'] - 1} and {worst['frame']}"
        lead.append(f"worst pair, frames {frames}: masks differ in {worst['differing_percent']:.2f} % of pixels")
    return [replace(_columns(result), lead=tuple(lead)), _features(result), _time(result)]


def _plain(value: Any) -> str:
    return ", ".join(f"{k} {v:.4g}" for k, v in value.items()) if isinstance(value, dict) else str(value)


def _columns(result: Result) -> Table:
    columns = (
        Column("run", "% of all pixels", 3), Column("reference", "% of all pixels", 3), Column("difference", "pp"),
        Column("noise floor", "%"), Column("IoU", "", 4), Column("equal outside band", "%", 3),
    )  # fmt: skip
    rows, masks = [], result["masks"]
    for column, entry in result["columns"].items():
        if entry["difference_pp"] is None:
            rows.append(Row.of(column, [None] * len(columns), entry["reason"]))
            continue
        mask, floors = masks.get(column) or {}, entry["noise_floor_percent"]
        has_floor = any(floor is not None for floor in floors)
        floor = " / ".join(NONE if f is None else f"{f:.2f}" for f in floors) if has_floor else None
        difference = f"{entry['difference_pp']:+.3f}"
        agreement = mask.get("iou"), mask.get("equal_outside_band_percent")
        rows.append(Row(column, (*entry["percent"], difference, floor, *agreement)))
    notes = (f"masks: {masks['reason']}",) if "reason" in masks else ()
    return Table("columns", "Discarded pixels by column", columns, tuple(rows), notes)


def _features(result: Result) -> Table:
    numbers = {"median": "median", "p75": "75 %", "p95": "95 %", "p99": "99 %", "max": "maximum"}
    columns = tuple(map(Column, ("unit", *numbers.values(), "mean or total", "pixels")))
    rows, features = [], result["features"]
    if "reason" in features:
        return Table("features", "Errors by feature", columns, (), (f"features: {features['reason']}",))
    for name, entry in features.items():
        whole = entry.get("mean", entry.get("total_percent"))
        texts = [None if value is None else f"{value:.4g}" for value in (*(entry[key] for key in numbers), whole)]
        rows.append(Row(_FEATURES[name], (entry["unit"], *texts, entry["pixels"])))
    return Table("features", "Errors by feature", columns, tuple(rows))


def _time(result: Result) -> Table:
    columns = (Column("time", "s/frame"), Column("renderer"), Column("clock"))
    rows = []
    for name, entry in zip(result["runs"], result["time"]["runs"], strict=True):
        values = (f"{entry['seconds']:.4g}", entry["of"], entry["clock"]) if "seconds" in entry else (None,) * 3
        rows.append(Row.of(str(name), values, entry.get("reason")))
    ratio = result["time"].get("ratio")
    notes = () if ratio is None else (f"time, reference / run = {ratio:.4g}",)
    return Table("time", "Seconds per frame", columns, tuple(rows), notes)
