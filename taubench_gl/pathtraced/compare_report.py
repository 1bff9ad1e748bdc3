"""Comparison of two runs (``compare.py``) as text, one HTML file, and an image of the worst pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import FRUSTUM
from taubench_gl.features import FEATURE_BIT
from taubench_gl.outputs import write_png
from taubench_gl.report.mask_images import legend, legend_strip, mask_overlay
from taubench_gl.report.page import data_uri, render_page

Array = np.ndarray
Result = Mapping[str, Any]
NONE = "–"
_GAP = 6  # pixels between the images of a row
_MIN_WIDTH = 960  # pixels; smaller images are enlarged by a whole factor
_MAX_GAIN = 64.0
_FEATURES = {
    "position_mm": "position", "normal_deg": "normal", "motion_px": "motion", "direct_percent": "direct, relative",
    "indirect_percent": "indirect, relative", "color_levels": "color",
}  # fmt: skip


@dataclass(slots=True)
class _Table:
    title: str
    heads: list[str]
    rows: list[list[str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def comparison_text(result: Result) -> list[str]:
    """The result as lines of at most 120 columns, not counting names and reasons."""
    lines = [_title(result), *_notes(result), ""]
    for table in _tables(result):
        lines += [*_aligned(table), *table.notes, ""]
    if "frame" in result["worst"]:
        lines.append(_worst_line(result["worst"]))
    return lines


def comparison_html(result: Result, image: bytes | None) -> str:
    """One self-contained page without scripts; ``image``: PNG of the worst pair."""
    return render_page(
        "comparison.html",
        title=_title(result),
        notes=_notes(result),
        tables=_tables(result),
        worst=None if image is None else _worst_line(result["worst"]),
        image=None if image is None else data_uri(image),
        provenance=[
            (name, "; ".join(f"{k}: {v}" for k, v in (entries or {}).items() if v is not None) or "no provenance")
            for name, entries in zip(result["runs"], result["provenance"], strict=True)
        ],
    )


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
        rows.append([_bytes(c) for c in colors] + [_bytes(gain * error)])
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


def _tables(result: Result) -> list[_Table]:
    return [_columns(result), _features(result), _time(result)]


def _columns(result: Result) -> _Table:
    heads = [
        "column",
        "run, % of all pixels",
        "reference, % of all pixels",
        "difference pp",
        "noise floor %",
        "IoU",
        "equal outside band %",
    ]
    table = _Table("Discarded pixels by column", heads)
    for column, entry in result["columns"].items():
        if entry["difference_pp"] is None:
            table.rows.append([column] + [NONE] * 6)
            table.notes.append(f"{column}: {entry['reason']}")
            continue
        mask = result["masks"].get(column)
        floors = entry["noise_floor_percent"]
        known = any(floor is not None for floor in floors)
        floor = " / ".join(NONE if f is None else f"{f:.2f}" for f in floors) if known else NONE
        outside = None if mask is None else mask["equal_outside_band_percent"]
        table.rows.append([
            column, *(f"{v:.3f}" for v in entry["percent"]), f"{entry['difference_pp']:+.3f}", floor,
            NONE if mask is None else f"{mask['iou']:.4f}", NONE if outside is None else f"{outside:.3f}",
        ])  # fmt: skip
    if "reason" in result["masks"]:
        table.notes.append(f"masks: {result['masks']['reason']}")
    return table


def _features(result: Result) -> _Table:
    heads = ["error of", "unit", "median", "75 %", "95 %", "99 %", "maximum", "mean or total", "pixels"]
    table = _Table("Errors by feature", heads)
    if "reason" in result["features"]:
        table.notes.append(f"features: {result['features']['reason']}")
        return table
    for name, entry in result["features"].items():
        whole = entry.get("mean", entry.get("total_percent"))
        numbers = [f"{entry[key]:.4g}" for key in ("median", "p75", "p95", "p99", "max")]
        numbers.append(NONE if whole is None else f"{whole:.4g}")
        table.rows.append([_FEATURES[name], entry["unit"], *numbers, str(entry["pixels"])])
    return table


def _time(result: Result) -> _Table:
    table = _Table("Time", ["seconds per frame", "s", "renderer", "clock"])
    for name, entry in zip(result["runs"], result["time"]["runs"], strict=True):
        if "reason" in entry:
            table.notes.append(f"time of {name}: {entry['reason']}")
        else:
            table.rows.append([str(name), f"{entry['seconds']:.4g}", entry["of"], entry["clock"]])
    if "ratio" in result["time"]:
        table.notes.append(f"time, reference / run = {result['time']['ratio']:.4g}")
    return table


def _aligned(table: _Table) -> list[str]:
    if not table.rows:
        return []
    widths = [max(map(len, column)) for column in zip(table.heads, *table.rows)]
    lines = []
    for row in (table.heads, *table.rows):
        cells = [c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths))]
        lines.append("  ".join(cells).rstrip())
    return lines


def _bytes(image: Array) -> Array:
    """(h, w, 3) in [0, 1] -> uint8; NaN becomes black."""
    return np.round(255.0 * np.clip(np.nan_to_num(image), 0.0, 1.0)).astype(np.uint8)


def _join(images: Sequence[Array], axis: int) -> Array:
    """Images with white gaps between them, side by side (axis 1) or one below the other (axis 0)."""
    shape = list(images[0].shape)
    shape[axis] = _GAP
    gap = np.full(shape, 255, dtype=np.uint8)
    return np.concatenate([part for image in images for part in (image, gap)][:-1], axis=axis)
