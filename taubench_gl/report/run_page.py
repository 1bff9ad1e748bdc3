"""The report of one or several runs as one HTML file.

Figures, tables and details are HTML (templates/run.html); the frame viewer, the plots over time and the threshold
curves are drawn by the scripts, which run.js links, from one block of JSON (``report_data``).
"""

from __future__ import annotations

import base64
import logging
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup

from taubench_gl import glossary
from taubench_gl.conventions import FRUSTUM, NOT_COMPARABLE, Reason
from taubench_gl.features import BY_BIT, COLUMN_BITS, COLUMNS, FEATURE_BIT, FEATURES, UNITS
from taubench_gl.metrics.reuse_rate import LIGHT_REASONS, RATE_BITS, RATE_COLUMNS, RATES
from taubench_gl.outputs import write_atomically
from taubench_gl.report.distance_planes import FELL, NEARER, ROSE
from taubench_gl.report.frame_store import MAX_IMAGE_BYTES, shown_text, within_budget
from taubench_gl.report.labels import comparison_text, lighting_text, run_labels
from taubench_gl.report.page import Page, macro, tag
from taubench_gl.report.palette import REASON_COLORS, REUSE_COLORS, hex_of
from taubench_gl.report.paper import interval_text, paper_numbers, sampled_text, thresholds_of, two_decimals
from taubench_gl.report.plot import DASHES
from taubench_gl.report.reusable import MERGED, TERMS, reprojection_of, reusable_sentence, run_tables
from taubench_gl.report.run_frames import StoredFrames, stored_frames
from taubench_gl.report.table import NONE, to_html

Summary = Mapping[str, Any]
log = logging.getLogger(__name__)

MAX_IMAGES = 60
"""Default number of pairs with images per report, all runs together."""

SHARED_IMAGE_BYTES = 4_400_000
"""Bytes of base64 text of the images of a page to share, which then has less than 5 MB."""

REUSE_REASON_COLORS = {term.key: hex_of(REASON_COLORS[bit]) for bit, term in glossary.REUSE_REASONS.items()}
"""Key of a disjoint reason -> its color, that of masks."""

_CLASSES = (Reason.FIRST, Reason.CUT, Reason.INVALID)
_DETAILS = (Reason.OUTSIDE, Reason.BEHIND, *(bit for feature in BY_BIT for bit in feature.details))
_COLUMN_OF = {bit: feature.name for feature in BY_BIT for bit in feature.details}
"""The column that must be measured for a detail to be known; the frustum column for the others."""
_ROW_COLUMNS = ("frame", "time_s", "pixels", "sky", "comparable", "translation_m", "angle_deg")


@dataclass(frozen=True, slots=True)
class ReportRun:
    """One run of a report: summary.json, the rows of frames.csv, and the folder that holds them, if any."""

    summary: Summary
    frames: Sequence[Mapping[str, Any]]
    out: Path | None = None


def write_html_report(runs: Sequence[ReportRun], path: str | Path, images: int | None = MAX_IMAGES) -> Path:
    """Write ``report_html`` to ``path`` atomically.  Raises OutputError."""
    path = Path(path)
    log.info("writing %s", path.name)
    write_atomically(path, report_html(runs, images))
    return path


def report_html(runs: Sequence[ReportRun], images: int | None = MAX_IMAGES) -> str:
    """The page.  ``images``: most pairs with images, all runs together; fewer where they take MAX_IMAGE_BYTES.

    None: a page to share, with every recorded pair, as small as SHARED_IMAGE_BYTES asks for, without the reprojected
    history and distances, which plays at once.  Raises ValueError without a run.
    """
    if not runs:
        raise ValueError("runs is empty, expected at least one")
    summaries = [run.summary for run in runs]
    labels, several = run_labels(summaries), len(runs) > 1
    views = [_run_view(summary, label) for summary, label in zip(summaries, labels, strict=True)]
    data = report_data(runs, labels, images)
    title = ", ".join(labels) if len(labels) < 4 else f"{len(labels)} runs"
    about = [Markup("<b>{}</b>: {}").format(v["label"], v["about"]) if several else v["about"] for v in views]
    page = Page(
        f"{title}: temporal reuse report", "temporal reuse report", heading=title,
        intro=(tag("p", Markup("<br>").join(about), class_="about"),),
        tools=Markup('<label id="run-choice" hidden>Run <select id="run"></select></label>'),
        styles=("stage.css", "run.css"),
        scripts=("stage.js", "zoom.js", "frame_viewer.js", "planes.js", "probe.js", "headline.js", "run_viewer.js",
                 "time_plots.js", "thresholds.js", "run.js"),
        data=data,
    )  # fmt: skip
    missing = tag("p", "The images and plots below need scripts. Figures, tables and details do not.", class_="missing")
    page.add("answer", "", macro("answers", "run.html")(views, several), label="Answer")
    frames = partial(page.add, "frames", "", tag("div", id="viewer"), label="Discarded pixels by reason", link="Frames")
    first = any(run["images"] for run in data["runs"])
    if first:
        frames()
    page.add("reusable", "", macro("reusable", "run.html")(views, several), label="Reusable pixels")
    page.add("figures", "", macro("key_figures", "run.html")(views, several), tag("noscript", missing),
             label="Key figures")  # fmt: skip
    if not first:
        frames()
    page.add("time", "Over time", tag("div", id="plots"))
    text = "The tables show one point of each curve. Drag a dot on its track, or move it with the arrow keys. The "
    text += "triangle moves all dots."
    if any(run["images"] and run["images"]["planes"] for run in data["runs"]):
        text += " The sentence and bars, the masks and shares of the frame and the rates over time follow; "
        text += "the sliders next to the frame are the same."
    curves = tag("p", text, class_="lead"), tag("div", id="curves")
    page.add("thresholds", "Discarded pixels by threshold", *curves, link="Thresholds")
    rates, *tables = run_tables(summaries)
    rates = replace(rates, lead=rates.lead[: -len(runs)])  # the sentence of each run is the answer above
    page.add("tables", "Comparison with the paper", to_html([rates, *tables], scroll=True), link="Tables")
    page.add("details", "Details", macro("run_details", "run.html")(views, several))
    return page.html()


# -------------------------------------------------------------------------------------------------- values of run.html


def _run_view(summary: Summary, label: str) -> dict[str, Any]:
    """Values of one run that the template shows without scripts."""
    camera, timing = summary.get("camera") or {}, summary.get("timing") or {}
    passes = {name: ms for name, ms in (timing.get("passes") or {}).items() if ms is not None}
    most = max(passes.values(), default=0.0) or 1.0
    fps = (summary.get("settings") or {}).get("fps")
    return {
        "label": label,
        "about": _about(summary),
        "headline": reusable_sentence(summary),
        "light": sampled_text(summary),
        "lighting": lighting_text(summary),
        "reprojection": reprojection_of(summary),
        "rates": [_rate(summary, rate) for rate in RATES],
        "sky": _sky(summary),
        "reasons": _reason_bars(summary),
        "figures": [_figure(summary, column) for column in COLUMNS],
        "effects": _effects(summary),
        "cuts": [{"frame": c, "time": f"{c / fps:.3f} s" if fps else ""} for c in camera.get("cuts") or ()],
        "cuts_text": _cuts_text(summary),
        "notes": [str(note) for note in summary.get("notes") or ()],
        "passes": [(name, ms, 100.0 * ms / most) for name, ms in passes.items()],
        "clock": timing.get("clock") or "unknown",
        "listings": [
            (head, {k.replace("_", " "): _plain(v) for k, v in (summary.get(block) or {}).items()})
            for head, block in (("Settings", "settings"), ("Scene", "scene"), ("Provenance", "provenance"))
        ],
    }


def _about(summary: Summary) -> str:
    """``60 pairs at 24 fps · 320 × 180 pixels · camera reprojection, nearest sampling``."""
    settings = summary.get("settings") or {}
    rate, count = settings.get("fps"), summary.get("pairs", 0)
    parts = [
        f"{count} pair{'' if count == 1 else 's'} at {'?' if rate is None else f'{rate:g}'} fps",
        f"{settings.get('width', '?')} × {settings.get('height', '?')} pixels",
        comparison_text(summary),
    ]
    stand_in = (summary.get("scene") or {}).get("stand_in")
    return " · ".join(parts + ([f"stand-in: {stand_in}"] if stand_in else []))


def _rate(summary: Summary, rate: str) -> dict[str, Any]:
    """A reuse rate: mean, lowest and highest of a pair, and share of all pixels; or why it is unknown."""
    entry = (summary.get("reusable") or {}).get(rate) or {}
    mean, low, high = (entry.get(f"{key}_percent") for key in ("mean", "min", "max"))
    view = {"name": rate, "definition": glossary.CONCEPTS[rate].tooltip, "reason": None}
    if mean is None:
        return view | {"reason": entry.get("reason") or "not measured"}
    whole = entry.get("of_picture_percent")
    return view | {
        "mean": two_decimals(mean),
        "range": interval_text(entry) or ("" if low is None else f"{two_decimals(low)} to {two_decimals(high)} %"),
        "of_all": "" if whole is None else f"{two_decimals(whole)} % of all pixels",
    }


def _sky(summary: Summary) -> dict[str, Any]:
    """Definition and value of the share of sky; the value is None where it is unknown."""
    value = (summary.get("reusable") or {}).get("sky_percent")
    return {
        "definition": glossary.STATISTICS["sky_percent"].tooltip,
        "value": None if value is None else two_decimals(value),
    }


def _reason_bars(summary: Summary) -> dict[str, Any]:
    """Disjoint reasons of the surface pixels that are not reusable, the largest first, or why they are unknown.

    ``rows``: label, % of surface pixels as text, length of the bar in % of the longest one, color.
    """
    block = summary.get("reusable") or {}
    if block.get("reasons_of") is None:
        return {"rows": [], "missing": (block.get("surface") or {}).get("reason") or "not recorded"}
    shares = {name: (block["reasons"].get(name) or {}).get("mean_percent") or 0.0 for name in TERMS}
    ranked = sorted((name for name in TERMS if shares[name] > 0.0), key=lambda name: -shares[name])
    most = shares[ranked[0]] if ranked else 1.0
    rows = [(TERMS[n].label, two_decimals(shares[n]), 100.0 * shares[n] / most, REUSE_REASON_COLORS[n]) for n in ranked]
    return {"rows": rows, "missing": None}


def _figure(summary: Summary, column: str) -> dict[str, Any]:
    """One key figure: the mean of a column, its highest pair, and the paper's scenes on a line (x in 4 .. 116)."""
    entry = (summary.get("discard") or {}).get(column) or {}
    mean, highest = entry.get("mean_percent"), entry.get("max_percent")
    figure = {"column": column, "definition": glossary.COLUMNS[column].tooltip, "reason": None, "paper": []}
    if mean is None:
        return figure | {"reason": entry.get("reason") or "not measured"}
    end = max(40.0, 1.08 * mean)
    paper = {scene["name"]: scene["discard"].get(column) for scene in paper_numbers()["scenes"]}
    return figure | {
        "mean": two_decimals(mean),
        "range": interval_text(entry) or ("" if highest is None else f"up to {two_decimals(highest)} %"),
        "x": 4.0 + 112.0 * mean / end,
        "paper": [
            {"x": 4.0 + 112.0 * value / end, "text": f"{name}: {value:g} %"}
            for name, value in paper.items()
            if value is not None
        ],
    }


def _effects(summary: Summary) -> list[dict[str, str]]:
    """Effects with the reason of each decision, the enabled ones first."""
    effects = [
        {"name": name.replace("_", " "), "state": "on" if e.get("on") else "off", "reason": str(e.get("reason") or "")}
        for name, e in (summary.get("effects") or {}).items()
    ]
    return sorted(effects, key=lambda effect: effect["state"] != "on")


def _cuts_text(summary: Summary) -> str:
    camera = summary.get("camera") or {}
    cuts, gimbal = len(camera.get("cuts") or ()), len(camera.get("gimbal_pairs") or ())
    text = f"{cuts} of {summary.get('pairs')} pairs are cuts. The tables also list values without them."
    if not cuts:
        text = "No pair is a cut."
    if gimbal:
        text += f" In {gimbal} pairs the camera points straight up or down, where yaw and roll are ill-defined."
    return text


def _plain(value: Any) -> str:
    if value is None:
        return NONE
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_plain(v)}" for k, v in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_plain, value)) or NONE
    return str(value)


# ----------------------------------------------------------------------------------------------- values of the scripts


def report_data(runs: Sequence[ReportRun], labels: Sequence[str], images: int | None = MAX_IMAGES) -> dict[str, Any]:
    """Values of the scripts, fit for JSON, with images of at most ``images`` pairs in all; None: small ones of all."""
    most = None if images is None else max(1, images // max(len(runs), 1))
    budget = (SHARED_IMAGE_BYTES if images is None else MAX_IMAGE_BYTES) // max(len(runs), 1)
    return {
        "play": images is None,
        "columns": [{"name": name, "dash": DASHES[name], "unit": UNITS.get(name, "")} for name in COLUMNS],
        "features": list(FEATURES),
        "bits": {
            "features": {name: int(bit) for name, bit in FEATURE_BIT.items()},
            "not_comparable": int(NOT_COMPARABLE),
            **{bit.name.lower(): int(bit) for bit in (*_COLUMN_OF, Reason.SKY, Reason.HISTORY_SKY)},
        },
        "reuse": {
            "terms": [
                {
                    "name": term.key,
                    "label": term.label,
                    "bits": int(bit),
                    "light": bit in LIGHT_REASONS,
                    "color": REUSE_REASON_COLORS[term.key],
                }
                for bit, term in glossary.REUSE_REASONS.items()
            ],
            "merged": MERGED,
        },
        "terms": [
            {
                "bits": int(bit),
                "label": term.label,
                "definition": term.tooltip,
                "color": hex_of(REASON_COLORS[bit]),
                "quiet": bit in (Reason.SKY, Reason.HISTORY_SKY),
            }
            for bit, term in glossary.REASONS.items()
            if bit is not FRUSTUM
        ],
        "runs": [_run_data(run, label, most, budget) for run, label in zip(runs, labels, strict=True)],
    }


def _run_data(run: ReportRun, label: str, most: int | None, budget: int) -> dict[str, Any]:
    summary, settings = run.summary, run.summary.get("settings") or {}
    discard = summary.get("discard") or {}
    measured = [c for c in COLUMNS if (discard.get(c) or {}).get("mean_percent") is not None]
    images, why = _images(run, most, budget)
    if not summary.get("pairs"):
        images, why = None, "No images: the run has no pair of frames."
    elif images is None:
        why = f"No images: {why}. Evaluate the scene again with --report to show the frames with their masks here."
    return {
        "label": label,
        "pairs": summary.get("pairs") or 0,
        "sampled": bool(summary.get("sampling")),
        "preview": bool(summary.get("sampled_light")),
        "pixels": _pixels(run),
        "width": settings.get("width"),
        "height": settings.get("height"),
        "measured": measured,
        "discard": {c: discard.get(c) or {} for c in COLUMNS},
        "thresholds": thresholds_of(summary),
        "curves": {f: _curve(summary, f) for f in FEATURES},
        "rows": _rows(run.frames),
        "cuts": list((summary.get("camera") or {}).get("cuts") or ()),
        "reasons": _reasons(measured, run.frames),
        "images": images,
        "no_images": why,
    }


def _pixels(run: ReportRun) -> int:
    """Pixels of all pairs, every sample of a pixel counted: the denominator of percentages."""
    counted = [row.get("pixels") for row in run.frames]
    if counted and None not in counted:
        return int(sum(counted))
    settings = run.summary.get("settings") or {}
    return int((run.summary.get("pairs") or 0) * (settings.get("width") or 0) * (settings.get("height") or 0))


def _rows(frames: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    names = {glossary.key_of(r) for r in (*_CLASSES, *_DETAILS)}
    rates = [f"reusable_{rate}" for rate in RATES]
    return {n: [row.get(n) for row in frames] for n in (*_ROW_COLUMNS, *COLUMNS, *sorted(names), *rates)}


def _curve(summary: Summary, feature: str) -> dict[str, Any] | None:
    """Bin edges (position: meters) and the exact number of pixels at or above each, all pairs together."""
    curve = (summary.get("curves") or {}).get(feature)
    if not curve or not curve.get("counts") or not curve.get("edges"):
        return None
    if ((summary.get("discard") or {}).get(feature) or {}).get("mean_percent") is None:
        return None
    above, total = [], 0
    for count in reversed(curve["counts"][1:]):
        total += count
        above.append(total)
    return {"edges": list(curve["edges"]), "above": above[::-1]}


def _reasons(measured: Sequence[str], frames: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The reasons that the viewer lists: columns of Table 4, reason classes, and surface pixels outside a rate.

    ``of``: the rate whose complement in the surface pixels a reason is; its count in ``rows`` is that of the rate.
    """
    present = {r for r in _CLASSES if any(row.get(glossary.key_of(r)) for row in frames)}
    details = [r for r in _DETAILS if _COLUMN_OF.get(r, "frustum") in measured]
    details += [r for r in _CLASSES if r in present]
    columns = [(COLUMN_BITS[name], "Table 4", name != "color") for name in measured]
    reasons = [
        {"name": glossary.key_of(bit), "label": glossary.label_of(bit), "bits": int(bit), "group": group, "on": on,
         "color": hex_of(REASON_COLORS[bit]), "definition": glossary.REASONS[bit].tooltip}
        for bit, group, on in [*columns, *((reason, "Reason classes", False) for reason in details)]
    ]  # fmt: skip
    measured_rates = [rate for rate in RATES if set(RATE_COLUMNS[rate]) <= set(measured)]
    return reasons + [
        {"name": f"reusable_{rate}", "label": f"not reusable, {rate}", "bits": int(RATE_BITS[rate]), "of": rate,
         "group": "Not reusable, for any reason", "on": False, "color": hex_of(REUSE_COLORS[rate]),
         "definition": f"Surface pixels that the rate does not count. {glossary.CONCEPTS[rate].tooltip}"}
        for rate in measured_rates
    ]  # fmt: skip


def _images(run: ReportRun, most: int | None, budget: int) -> tuple[dict[str, Any] | None, str]:
    """Images of at most ``most`` pairs (None: small ones of all) and ``budget`` bytes, or None and the reason."""
    stored, why = stored_frames(run.out)
    if stored is None:
        return None, why

    planes, no_planes = _planes(run, stored) if most is not None else (None, "")
    parts = ("frame", "previous", "mask", *(("planes",) if planes else ()))

    def load(frame: int) -> dict[str, Any]:
        return {"n": frame, **{part: stored.uri(part, frame) for part in parts}}

    index = stored.index
    try:
        if most is None:
            items, index = stored.small(budget)
        else:
            items = within_budget(index, most, budget - len((planes or {}).get("counts", "")), load)
    except OSError as error:
        return None, f"an image cannot be read: {error.strerror}"
    text = shown_text(index, len(items), run.summary.get("pairs") or 0, "pairs")
    text += f". {stored.lost}" if stored.lost else ""
    return {
        "width": index.width, "height": index.height, "step": index.step, "worst": index.worst,
        "summary": f"{text}. Percentages refer to the full frames.",
        "items": items, "planes": planes, "no_planes": no_planes,
    }, ""  # fmt: skip


def _planes(run: ReportRun, stored: StoredFrames) -> tuple[dict[str, Any] | None, str]:
    """Distances of a run for planes.js, or None and the reason.

    ``counts``: deflated uint32, little-endian, (pairs, features, codes), of the rows of frames.csv in order.
    """
    planes, again = stored.planes, "Evaluate the scene again with --report-full"
    if planes is None:
        return None, f"Masks stay at the thresholds of the run: {stored.no_planes}. {again} to redraw them here."
    counted = [[row.get(name) for name in planes.features] for row in run.frames]
    homes = [planes.levels[name]["home"] for name in planes.features]
    above = [[int(codes[home:].sum()) for codes, home in zip(pair, homes, strict=True)] for pair in planes.counts]
    if counted != above:
        return None, f"Masks stay at the thresholds of the run: the distances do not fit its counts. {again}."
    return {
        "names": planes.names,
        "features": planes.features,
        "levels": planes.levels,
        "steps": {str(frame): step for frame, step in planes.steps.items()},
        "counts": base64.b64encode(zlib.compress(planes.counts.tobytes(), 9)).decode("ascii"),
        "signs": {"nearer": NEARER, "rose": ROSE, "fell": FELL},
    }, ""
