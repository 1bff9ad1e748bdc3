"""Comparison of two runs (``compare.py``) as text, one HTML file, and an image of the worst pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import FEATURE_BIT, FRUSTUM
from taubench_gl.outputs import cannot_write
from taubench_gl.report.mask_images import legend, legend_strip, mask_overlay
from taubench_gl.report.page import data_uri, render_page

Array = np.ndarray
NONE = "–"
_GAP = 6  # pixels between the pictures of a row
_FEATURES = {
    "position_mm": "position", "normal_deg": "normal", "motion_px": "motion", "direct_percent": "direct, relative",
    "indirect_percent": "indirect, relative", "color_levels": "color",
}  # fmt: skip


def comparison_text(result: Mapping[str, Any]) -> list[str]:
    """The result as plain lines, at most 120 columns but for names and reasons."""
    lines = [_title(result), *_notes(result), ""]
    for heads, rows, notes in _tables(result):
        lines += [*_aligned(heads, rows), *notes, ""]
    worst = result["worst"]
    if "frame" in worst:
        lines.append(_worst_line(worst))
    return lines


def comparison_html(result: Mapping[str, Any], picture: bytes | None) -> str:
    """One self-contained page without scripts; ``picture`` is the PNG of the worst pair."""
    titles = ("Discarded pixels by column", "Errors by feature", "Time")
    return render_page(
        "comparison.html",
        title=_title(result),
        notes=_notes(result),
        tables=[
            {"title": title, "heads": heads, "rows": rows, "notes": notes}
            for title, (heads, rows, notes) in zip(titles, _tables(result), strict=True)
        ],
        worst=None if picture is None else _worst_line(result["worst"]),
        image=None if picture is None else data_uri(picture),
        provenance=[
            (name, "; ".join(f"{k}: {v}" for k, v in (entries or {}).items() if v is not None) or "no provenance")
            for name, entries in zip(result["runs"], result["provenance"], strict=True)
        ],
    )


def save_worst_picture(
    path: str | Path, result: Mapping[str, Any], masks: Sequence[Array], colors: Sequence[Array] | None
) -> Path:
    """Masks of both runs side by side with the reasons on which they differ, over colours with their difference.

    ``masks``: two (h, w) uint32 words; ``colors``: two (h, w, 3) in [0, 1], or None.  The colour difference is
    multiplied so that its 99th percentile is white; the caption says by how much.  PNG.  Raises OutputError.
    """
    import imageio.v3 as iio

    judged = np.uint32(result["worst"]["judged_bits"])
    reasons = tuple(r for r in (FRUSTUM, *FEATURE_BIT.values()) if judged & np.uint32(int(r)))
    differ = (masks[0] ^ masks[1]) & judged
    bases = colors or (None, None)
    rows = [[mask_overlay(m & judged, b, reasons) for m, b in zip(masks, bases, strict=True)]]
    rows[0].append(mask_overlay(differ, np.zeros((*differ.shape, 3)), reasons))
    caption = f"{_worst_line(result['worst'])}.  Left: {_short(result['runs'][0])}, middle: "
    caption += f"{_short(result['runs'][1])}, right: where they differ"
    if colors is not None:
        error = np.abs(np.nan_to_num(colors[0].astype(np.float64)) - np.nan_to_num(colors[1]))
        top = float(np.percentile(error, 99.0))
        gain = min(1.0 / top, 64.0) if top > 0 else 1.0
        rows.append([_bytes(c) for c in colors] + [_bytes(gain * error)])
        caption += f" (colours: x {gain:.1f})"
    picture = np.concatenate([p for row in rows for p in (_row(row), _gap_row(row))][:-1])
    enlarge = max(1, -(-960 // picture.shape[1]))
    picture = np.repeat(np.repeat(picture, enlarge, axis=0), enlarge, axis=1)
    strip = legend_strip(legend(differ, reasons), picture.shape[1], caption)
    try:
        iio.imwrite(path, np.concatenate([picture, strip]), extension=".png")
    except OSError as error_:
        raise cannot_write(path, error_) from None
    return Path(path)


def _title(result: Mapping[str, Any]) -> str:
    first, second = result["runs"]
    size = "x".join(map(str, result["size"]))
    return f"{first} against {second}: {result['pairs']} pairs, {size}, {result['fps'][1]:g} fps"


def _notes(result: Mapping[str, Any]) -> list[str]:
    return [
        f"the runs differ in {name}: {_plain(a)} and {_plain(b)}"
        for name, (a, b) in result["settings_that_differ"].items()
    ]


def _plain(value: Any) -> str:
    return ", ".join(f"{k} {v:.4g}" for k, v in value.items()) if isinstance(value, dict) else str(value)


def _worst_line(worst: Mapping[str, Any]) -> str:
    frame = worst["frame"]
    return f"worst pair, frames {frame - 1} and {frame}: masks differ on {worst['differing_percent']:.2f} % of pixels"


def _tables(result: Mapping[str, Any]) -> list[tuple[list[str], list[list[str]], list[str]]]:
    """(heads, rows, notes) of columns, features and time."""
    return [_columns(result), _features(result), _time(result)]


def _columns(result: Mapping[str, Any]) -> tuple[list[str], list[list[str]], list[str]]:
    heads = ["column", "first %", "second %", "points", "noise floor %", "IoU", "agree outside band %"]
    rows, notes = [], []
    for column, entry in result["columns"].items():
        if entry["difference_points"] is None:
            rows.append([column] + [NONE] * 6)
            notes.append(f"{column}: {entry['reason']}")
            continue
        mask = result["masks"].get(column)
        floors = entry["noise_floor_percent"]
        known = any(floor is not None for floor in floors)
        floor = " / ".join(NONE if f is None else f"{f:.2f}" for f in floors) if known else NONE
        outside = None if mask is None else mask["agree_outside_band_percent"]
        rows.append([
            column, *(f"{v:.3f}" for v in entry["percent"]), f"{entry['difference_points']:+.3f}", floor,
            NONE if mask is None else f"{mask['iou']:.4f}", NONE if outside is None else f"{outside:.3f}",
        ])  # fmt: skip
    if "reason" in result["masks"]:
        notes.append(f"masks: {result['masks']['reason']}")
    return heads, rows, notes


def _features(result: Mapping[str, Any]) -> tuple[list[str], list[list[str]], list[str]]:
    if "reason" in result["features"]:
        return [], [], [f"features: {result['features']['reason']}"]
    heads = ["error of", "unit", "median", "75 %", "95 %", "99 %", "largest", "mean or total", "pixels"]
    rows = []
    for name, entry in result["features"].items():
        whole = entry.get("mean", entry.get("total_percent"))
        numbers = [f"{entry[key]:.4g}" for key in ("median", "p75", "p95", "p99", "max")]
        numbers.append(NONE if whole is None else f"{whole:.4g}")
        rows.append([_FEATURES[name], entry["unit"], *numbers, str(entry["pixels"])])
    return heads, rows, []


def _time(result: Mapping[str, Any]) -> tuple[list[str], list[list[str]], list[str]]:
    rows, notes = [], []
    for name, entry in zip(result["runs"], result["time"]["runs"], strict=True):
        if "reason" in entry:
            notes.append(f"time of {name}: {entry['reason']}")
        else:
            rows.append([str(name), f"{entry['seconds']:.4g}", entry["of"], entry["clock"]])
    if "ratio" in result["time"]:
        notes.append(f"time, second : first = {result['time']['ratio']:.4g}")
    return ["seconds per frame", "s", "made by", "clock"], rows, notes


def _aligned(heads: list[str], rows: list[list[str]]) -> list[str]:
    if not rows:
        return []
    widths = [max(map(len, column)) for column in zip(heads, *rows)]
    lines = []
    for row in (heads, *rows):
        cells = [c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths))]
        lines.append("  ".join(cells).rstrip())
    return lines


def _short(name: str) -> str:
    return Path(name).name or name


def _bytes(picture: Array) -> Array:
    return np.round(255.0 * np.clip(np.nan_to_num(picture), 0.0, 1.0)).astype(np.uint8)


def _row(pictures: Sequence[Array]) -> Array:
    gap = np.full((pictures[0].shape[0], _GAP, 3), 255, dtype=np.uint8)
    return np.concatenate([p for picture in pictures for p in (picture, gap)][:-1], axis=1)


def _gap_row(pictures: Sequence[Array]) -> Array:
    return np.full((_GAP, _row(pictures).shape[1], 3), 255, dtype=np.uint8)
