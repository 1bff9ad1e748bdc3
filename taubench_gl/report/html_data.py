"""What the report's scripts read: numbers, curves and pictures of runs as plain values fit for JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl import glossary
from taubench_gl.conventions import COLUMNS, FEATURE_BIT, FEATURES, FRUSTUM, Reason
from taubench_gl.report.frame_store import StoredPictures, spread, stored_pictures
from taubench_gl.report.palette import FEATURE_COLORS, REASON_COLORS
from taubench_gl.report.plots import DASHES
from taubench_gl.report.tables import length_unit, paper_numbers, thresholds_shown

MAX_PICTURES = 60
"""Pairs pictured per report unless told otherwise, all runs together."""
MAX_PICTURE_BYTES = 18_000_000
"""Of base64 text, all runs together: what a phone still opens."""

UNITS = {"position": "m"}
_CLASSES = (Reason.FIRST, Reason.CUT, Reason.INVALID)
_DETAILS = (Reason.OUTSIDE, Reason.BEHIND, Reason.DISOCCLUDED, Reason.OCCLUDING, Reason.LIT, Reason.SHADOWED)
_NEEDS = {Reason.DISOCCLUDED: "position", Reason.OCCLUDING: "position", Reason.LIT: "direct", Reason.SHADOWED: "direct"}
_ROW_COLUMNS = ("frame", "time_s", "pixels", "comparable", "translation_m", "angle_deg")


@dataclass(frozen=True, slots=True)
class ReportRun:
    """A run as the report takes it: summary.json, the rows of frames.csv, and the folder it is in, if any."""

    summary: Mapping[str, Any]
    frames: Sequence[Mapping[str, Any]]
    out: Path | None = None


def report_data(runs: Sequence[ReportRun], labels: Sequence[str], pictures: int = MAX_PICTURES) -> dict[str, Any]:
    """Everything the scripts need, for ``pictures`` pictured pairs in all."""
    share = max(1, pictures // max(len(runs), 1))
    budget = MAX_PICTURE_BYTES // max(len(runs), 1)
    return {
        "columns": [
            {
                "name": n,
                "color": _hex(FEATURE_COLORS[n]),
                "dash": DASHES[n],
                "unit": UNITS.get(n, ""),
                "told": glossary.COLUMNS[n].tooltip,
            }
            for n in COLUMNS
        ],
        "features": list(FEATURES),
        "paper": [{"name": s["name"], "discard": s["discard"]} for s in paper_numbers()["scenes"]],
        "runs": [_run(run, label, share, budget) for run, label in zip(runs, labels, strict=True)],
    }


def for_script(data: Any) -> str:
    """JSON that may stand in a script element: no name in a file can end it or open another."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _run(run: ReportRun, label: str, most: int, budget: int) -> dict[str, Any]:
    summary, settings = run.summary, run.summary.get("settings") or {}
    discard = summary.get("discard") or {}
    measured = [c for c in COLUMNS if (discard.get(c) or {}).get("mean_percent") is not None]
    pictures, why = _pictures(run, most, budget)
    return {
        "label": label,
        "pairs": summary.get("pairs") or 0,
        "pixels": _pixels(run),
        "fps": settings.get("fps"),
        "width": settings.get("width"),
        "height": settings.get("height"),
        "measured": measured,
        "discard": {c: discard.get(c) or {} for c in COLUMNS},
        "thresholds": thresholds_shown(summary),
        "curves": {f: _curve(summary, f) for f in FEATURES},
        "rows": _rows(run.frames),
        "cuts": list((summary.get("camera") or {}).get("cuts") or ()),
        "reasons": _reasons(measured, run.frames),
        "pictures": pictures,
        "no_pictures": why,
    }


def _pixels(run: ReportRun) -> int:
    """Pixels of all pairs together, each sample of a pixel counted: what percentages are of."""
    counted = [row.get("pixels") for row in run.frames]
    if counted and None not in counted:
        return int(sum(counted))
    settings = run.summary.get("settings") or {}
    return int((run.summary.get("pairs") or 0) * (settings.get("width") or 0) * (settings.get("height") or 0))


def _rows(frames: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    names = {glossary.key_of(r) for r in (*_CLASSES, *_DETAILS)}
    return {n: [row.get(n) for row in frames] for n in (*_ROW_COLUMNS, *COLUMNS, *sorted(names))}


def _curve(summary: Mapping[str, Any], feature: str) -> dict[str, Any] | None:
    """Bin edges (position: metres) and the exact number of pixels at or above each, all pairs together."""
    curve = (summary.get("curves") or {}).get(feature)
    if not curve or not curve.get("counts") or (summary["discard"].get(feature) or {}).get("mean_percent") is None:
        return None
    above, total = [], 0
    for count in reversed(curve["counts"][1:]):
        total += count
        above.append(total)
    scale = length_unit(summary) if feature == "position" else 1.0
    return {"edges": [edge / scale for edge in curve["edges"]], "above": above[::-1]}


def _reasons(measured: Sequence[str], frames: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What can be toggled, in two groups: Table 4's columns, and why in more detail."""
    bits = {"frustum": FRUSTUM, **FEATURE_BIT}
    seen = {r for r in _CLASSES if any(row.get(glossary.key_of(r)) for row in frames)}
    details = [r for r in _DETAILS if _NEEDS.get(r, "frustum") in measured] + [r for r in _CLASSES if r in seen]
    table = [(name, bits[name], "Table 4", name != "color") for name in measured]
    return [
        {"name": name, "label": glossary.label_of(bit), "bits": int(bit), "color": _hex(REASON_COLORS[bit]),
         "group": group, "on": on, "told": glossary.REASONS[bit].tooltip, "row": name}
        for name, bit, group, on in [*table, *((glossary.key_of(r), r, "in detail", False) for r in details)]
    ]  # fmt: skip


def _pictures(run: ReportRun, most: int, budget: int) -> tuple[dict[str, Any] | None, str]:
    stored, why = stored_pictures(run.out)
    if stored is None:
        return None, why
    while True:
        chosen = spread(stored.frames, most, stored.worst)
        try:
            items = [{"n": f, **{part: stored.uri(part, f) for part in ("frame", "previous", "mask")}} for f in chosen]
        except OSError as error:
            return None, f"a picture cannot be read: {error.strerror}"
        size = sum(len(item[part]) for item in items for part in ("frame", "previous", "mask"))
        if size <= budget or most <= 2:
            return {"width": stored.width, "height": stored.height, "step": stored.step, "worst": stored.worst,
                    "told": _told(run, stored, len(items)), "items": items}, ""  # fmt: skip
        most = max(2, int(len(chosen) * budget / size))


def _told(run: ReportRun, stored: StoredPictures, shown: int) -> str:
    """What was left out of the pictures, in one sentence."""
    pairs = run.summary.get("pairs") or 0
    which = (
        f"{shown} of {pairs} pairs pictured, evenly spaced"
        if shown < pairs
        else (f"All {pairs} pairs pictured" if pairs > 1 else "The one pair is pictured")
    )
    if shown < pairs and stored.worst is not None:
        which += ", the most discarded among them"
    size = f"{stored.width}×{stored.height}"
    small = f", at {size}: every {_nth(stored.step)} pixel of rows and columns" if stored.step > 1 else f", at {size}"
    return f"{which}{small}. Percentages are those of the full pictures."


def _nth(n: int) -> str:
    return {2: "second", 3: "third"}.get(n, f"{n}th")


def _hex(color: Sequence[int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*color)
