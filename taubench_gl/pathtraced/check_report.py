"""The engine check as plain data (schema ``taubench-gl/check/1``), tables, a picture and one HTML page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.data_files import read_bytes
from taubench_gl.outputs import output_folder, remove_files, write_atomically
from taubench_gl.pathtraced.check import TOLERANCE_PX, Check
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.report.page import REPORT_FILE, Page, data_uri, picture, text_lines
from taubench_gl.report.plot import Plot
from taubench_gl.report.table import Column, Row, Table, to_html

Summary = Mapping[str, Any]

SCHEMA = "taubench-gl/check/1"
CHECK_FILE = "check.json"
_LABELS = {
    "rows": "row order", "up": "axes of positions", "positions": "origin of positions", "meters": "unit of positions",
    "matrix": "camera matrices", "lens": "field of view", "order": "frame order", "centers": "pixel centers",
    "depth": "kind of depth", "direction": "motion sign", "y": "motion y", "components": "motion components",
    "unit": "motion unit", "zero": "motion zero", "jitter": "jitter in motion", "sky": "motion of the sky",
}  # fmt: skip
_CAPTION = (
    f"The pair that the mapping explains least.  Gray: nothing to compare with.  White line: {TOLERANCE_PX:g} px."
)
_MOST = 3  # equivalent corrections in a text
_SHORT = 24  # characters of a text beside its verdict


def check_summary(check: Check, sequence: PathTracedSequence) -> dict[str, Any]:
    """Plain data: ``verdicts``, ``pairs``, ``basis``, ``wrong`` (conventions); shares in percent."""
    about = {"sequence": str(sequence.path), "mapping": sequence.mapping.name, "basis": check.basis}
    verdicts, pairs = ([_percent({f.name: getattr(each, f.name) for f in fields(each) if f.name != "errors"})
                        for each in some] for some in (check.verdicts, check.pairs))  # fmt: skip
    about |= {"tolerance_px": TOLERANCE_PX, "wrong": [v.convention for v in check.wrong]}
    return {"schema": SCHEMA, **about, "verdicts": verdicts, "pairs": pairs}


def _percent(values: dict[str, Any]) -> dict[str, Any]:
    return values | {n: 100 * values[n] for n in ("as_read", "explained") if values[n] is not None}


def check_tables(summary: Summary) -> list[Table]:
    """A row for each convention, and one for each pair."""
    shares = (Column("as read", "%", 1, "Pixels explained with this convention as the mapping has it"),
              Column("explained", "%", 1, "Pixels explained with it corrected"))  # fmt: skip
    rows, lead = [], []
    for verdict in summary["verdicts"]:
        name, status, text = (verdict[key] for key in ("convention", "status", "text"))
        if others := verdict["equivalent"]:
            more = f"; and {len(others) - _MOST} more" * (len(others) > _MOST)
            text += f"; equivalent: {'; or '.join(others[:_MOST])}{more}"
        if status == "wrong":
            lead.append(f"{_LABELS.get(name, name)}: {text}")
        short = status == "wrong" or (status == "ok" and len(text) <= _SHORT)
        cell = f"ok: {text}" if status == "ok" and short else status
        values = (cell, verdict["as_read"], verdict["explained"])
        rows.append(Row(_LABELS.get(name, name), values, reasons={} if short else {0: text}))
    count = sum(verdict["status"] == "not checked" for verdict in summary["verdicts"])
    about = f"{len(summary['wrong'])} of {len(rows)} conventions are wrong, {count} are not checked"
    lead.insert(0, f"{summary['sequence']}, mapping {summary['mapping']}: {about}")
    notes = (f"explained: within {TOLERANCE_PX:g} px of the motion of {summary['basis']}",) if summary["pairs"] else ()
    tables = [Table("conventions", "Conventions", (Column("verdict"), *shares), tuple(rows), notes, tuple(lead))]
    columns = (
        *shares,
        *(Column(name, "px", digits) for name, digits in (("jitter x", 3), ("jitter y", 3), ("motion", 2))),
    )
    of_pairs = [Row(f"frame {p['frame']}", (p["as_read"], p["explained"], *p["jitter_px"], p["expected_px"]))
                for p in summary["pairs"]]  # fmt: skip
    return tables + ([Table("pairs", "Motion of each pair", columns, tuple(of_pairs))] if of_pairs else [])


def save_check(check: Check, sequence: PathTracedSequence, out: str | Path) -> list[Path]:
    """Write check.json, report.html and, with pairs, motion_error as PNG and SVG to ``out``.  Raises OutputError."""
    out, summary = output_folder(out), check_summary(check, sequence)
    remove_files(out, ("motion_error.png", "motion_error.svg"))  # of an earlier check; this one may have no pairs
    page = Page(f"{sequence.name}: conventions", kind="engine check")
    tables, files = check_tables(summary), [out / CHECK_FILE, out / REPORT_FILE]
    page.add("conventions", "Conventions", to_html(tables[:1], scroll=True))
    if check.pairs:
        files += _plot(check).save(out / "motion_error.png")
        image = picture(data_uri(read_bytes(files[2])), _CAPTION)
        page.add("vectors", "Where vectors are wrong", image, text_lines([_CAPTION]), to_html(tables[1:], scroll=True))
    write_atomically(files[0], json.dumps(summary, indent=2, allow_nan=False) + "\n")
    write_atomically(files[1], page.html())
    return files


def _plot(check: Check) -> Plot:
    """Errors of motion of the pair that the mapping explains least, as read and corrected."""
    from matplotlib.colors import LogNorm

    pair = min(check.pairs, key=lambda p: p.as_read)
    height, width = pair.errors[0].shape
    plot = Plot("", 10.0, max(2.2, 5.0 * height / width + 0.6), columns=2)
    for axes, errors, title in zip(plot.panels, pair.errors, ("as the mapping reads it", "corrected"), strict=True):
        plot.title(axes, f"frame {pair.frame}, {title}")
        axes.set(xticks=[], yticks=[], facecolor="0.75")
        axes.grid(False)
        shown = axes.imshow(np.maximum(errors, 1e-9), norm=LogNorm(0.01, 10.0, clip=True), cmap="magma")
    bar = plot.figure.colorbar(shown, ax=plot.panels, label="error of motion [px]")
    bar.ax.axhline(TOLERANCE_PX, color="white")
    return plot
