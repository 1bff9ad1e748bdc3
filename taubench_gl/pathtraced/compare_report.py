"""Comparison of two runs (``compare.py``) as text, one HTML file, and an image of the worst pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import FRUSTUM
from taubench_gl.features import FEATURE_BIT
from taubench_gl.outputs import write_png
from taubench_gl.report.mask_images import as_bytes, legend, legend_strip, mask_overlay
from taubench_gl.report.page import Page, data_uri, tag
from taubench_gl.report.table import NONE, Column, Row, Table, to_html, to_text

Array = np.ndarray
Result = Mapping[str, Any]
_GAP = 6  # pixels between the images of a row
_MIN_WIDTH = 960  # pixels; smaller images are enlarged by a whole factor
_MAX_GAIN = 64.0
_FEATURES = {
    "position_mm": "position", "normal_deg": "normal", "direct_percent": "direct, relative",
    "indirect_percent": "indirect, relative", "color_levels": "color",
}  # fmt: skip


def comparison_text(result: Result) -> list[str]:
    """The result as lines of at most 120 columns, not counting names and reasons."""
    lines = [_title(result), *_notes(result), "", *to_text(_tables(result)).splitlines()]
    return [*lines, _worst_line(result["worst"])] if "frame" in result["worst"] else lines


def comparison_html(result: Result, image: bytes | None) -> str:
    """One self-contained page without scripts; ``image``: PNG of the worst pair."""
    page = Page(_title(result), intro=tuple(tag("p", note, class_="about") for note in _notes(result)))
    page.add("tables", "", to_html(_tables(result), scroll=True), label="Tables")
    if image is not None:
        worst = _worst_line(result["worst"])
        page.add("worst", worst, tag("img", src=data_uri(image), alt=worst))
    origins = [
        (name, "; ".join(f"{k}: {v}" for k, v in (entries or {}).items() if v is not None) or "no provenance")
        for name, entries in zip(result["runs"], result["provenance"], strict=True)
    ]
    texts = [tag("p", f"{name}: {text}", class_="muted") for name, text in origins]
    page.add("provenance", "", *texts, label="Provenance")
    return page.html()


def save_worst_image(path: str | Path, result: Result, masks: Sequence[Array], colors: Sequence[Array] | None) -> Path:
    """Write a PNG: masks of both runs and the reasons in which they differ; below, the colors and their difference.

    ``masks``: two (h, w) uint32; ``colors``: two (h, w, 3) in [0, 1], or None.  The color difference is scaled so that
    its 99th percentile is white; the caption has the factor.  Raises OutputError.
    """
    compared = np.uint32(result["worst"]["compared_bits"])
    reasons = tuple(r for r in (FRUSTUM, *FEATURE_BIT.values()) if compared & np.uint32(int(r)))
    differ = (masks[0] ^ masks[1]) & compared
    rows = [[mask_overlay(m & compared, b, reasons) for m, b in zip(masks, colors or (None, None), strict=True)]]
    rows[0].append(mask_overlay(differ, np.zeros((*differ.shape, 3)), reasons))
    left, middle = (Path(name).name or name for name in result["runs"])
    caption = f"{_worst_line(result['worst'])}.  Left: {left}, middle: {middle}, right: difference"
    if colors is not None:
        error = np.abs(np.nan_to_num(colors[0].astype(np.float64)) - np.nan_to_num(colors[1]))
        top = float(np.percentile(error, 99.0))
        gain = min(1.0 / top, _MAX_GAIN) if top > 0 else 1.0
        rows.append([as_bytes(c) for c in colors] + [as_bytes(gain * error)])
        caption += f" (colors: x {gain:.1f})"
    image = _join([_join(row, axis=1) for row in rows], axis=0)
    factor = max(1, -(-_MIN_WIDTH // image.shape[1]))
    image = np.repeat(np.repeat(image, factor, axis=0), factor, axis=1)
    strip = legend_strip(legend(differ, reasons), image.shape[1], caption)
    write_png(Path(path), np.concatenate([image, strip]))
    return Path(path)


def _title(result: Result) -> str:
    run, reference = result["runs"]
    size = "x".join(map(str, result["size"]))
    return f"{run} and reference {reference}: {result['pairs']} pairs, {size}, {result['fps'][1]:g} fps"


def _notes(result: Result) -> list[str]:
    return [
        f"the runs differ in {name}: {_plain(a)} and {_plain(b)}"
        for name, (a, b) in result["settings_that_differ"].items()
    ]


def _plain(value: Any) -> str:
    return ", ".join(f"{k} {v:.4g}" for k, v in value.items()) if isinstance(value, dict) else str(value)


def _worst_line(worst: Mapping[str, Any]) -> str:
    frame = worst["frame"]
    return f"worst pair, frames {frame - 1} and {frame}: masks differ in {worst['differing_percent']:.2f} % of pixels"


def _tables(result: Result) -> list[Table]:
    return [_columns(result), _features(result), _time(result)]


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


def _join(images: Sequence[Array], axis: int) -> Array:
    """Images with white gaps between them, side by side (axis 1) or one below the other (axis 0)."""
    shape = list(images[0].shape)
    shape[axis] = _GAP
    gap = np.full(shape, 255, dtype=np.uint8)
    return np.concatenate([part for image in images for part in (image, gap)][:-1], axis=axis)
