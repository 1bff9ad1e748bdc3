"""The engine check as plain data (schema ``taubench-gl/check/1``), tables, a picture and one HTML page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.data_files import read_bytes
from taubench_gl.outputs import output_folder, remove_files, write_atomically
from taubench_gl.pathtraced.check import Check
from taubench_gl.pathtraced.check_vectors import TOLERANCE_PX
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
    "depth": "kind of depth", "normals": "axes of normals",
    "direction": "motion sign", "y": "motion y", "components": "motion components",
    "unit": "motion unit", "zero": "motion zero", "jitter": "jitter in motion",
}  # fmt: skip
_CAPTION = (
    f"The pair that the mapping explains least.  Gray: nothing to compare with.  White line: {TOLERANCE_PX:g} px."
)
_SHARES = ("as_read", "explained", "judged", "pixels")
_PAIR = ("frame", "judged", "as_read", "explained", "expected_px")
_MOST = 3  # equivalent corrections in a text
_SHORT = 24  # characters of a text beside its verdict


def check_summary(check: Check, sequence: PathTracedSequence) -> dict[str, Any]:
    """Plain data: ``answer``, ``classes``, ``verdicts``, ``pairs``, ``basis``, ``wrong`` (conventions).

    Shares in percent.
    """
    about = {"sequence": str(sequence.path), "mapping": sequence.mapping.name, "basis": check.basis}
    lists = {name: [_percent(asdict(each)) for each in getattr(check, name)] for name in ("classes", "verdicts")}
    lists["pairs"] = [_percent({n: getattr(p, n) for n in _PAIR} | {"jitter_px": p.jitter_px.tolist()})
                      for p in check.pairs]  # fmt: skip
    about |= {"tolerance_px": TOLERANCE_PX, "answer": check.answer, "wrong": [v.convention for v in check.wrong]}
    return {"schema": SCHEMA, **about, **lists}


def _percent(values: dict[str, Any]) -> dict[str, Any]:
    return values | {n: 100 * values[n] for n in _SHARES if values.get(n) is not None}


def check_tables(summary: Summary) -> list[Table]:
    """A row for each class of vectors, for each convention, and for each pair."""
    shares = (Column("as read", "%", 1, "Pixels explained with this convention as the mapping has it"),
              Column("explained", "%", 1, "Pixels explained with it corrected"))  # fmt: skip
    rows, lead = [], [f"{summary['sequence']}, mapping {summary['mapping']}: {headline(summary)}"]
    for verdict in summary["verdicts"]:
        status, text, name = verdict["status"], verdict["text"], verdict["convention"]
        name = _LABELS.get(name, name)
        if others := verdict["equivalent"]:
            further = f"; and {len(others) - _MOST} more" * (len(others) > _MOST)
            text += f"; equivalent: {'; or '.join(others[:_MOST])}{further}"
        if status == "wrong":
            lead.append(f"{name}: {text}")
        short = status == "wrong" or (status == "ok" and len(text) <= _SHORT)
        cell = f"ok: {text}" if status == "ok" and short else status
        rows.append(Row(name, (cell, verdict["as_read"], verdict["explained"]), reasons={} if short else {0: text}))
    notes = (f"explained: within {TOLERANCE_PX:g} px of the motion of {summary['basis']}",) if summary["pairs"] else ()
    judged = (Column("answer"), Column("pixels", "%", 1, "Share of the picture"),
              Column("judged", "%", 1, "Share of these whose motion is known"),
              Column("as read", "%", 1, "Share of the judged vectors that are right as the mapping reads them"),
              Column("corrected", "%", 1, "The same with wrong conventions corrected"))  # fmt: skip
    of_classes = [Row(c["name"], (c["answer"], *(c[key] for key in ("pixels", "judged", "as_read", "explained"))),
                      reasons={0: c["text"]} if c["text"] else {}) for c in summary["classes"]]  # fmt: skip
    of_pairs = [Row(f"frame {p['frame']}", (*(p[n] for n in _PAIR[1:4]), *p["jitter_px"], p["expected_px"]))
                for p in summary["pairs"]]  # fmt: skip
    px = (Column("jitter x", "px", 3), Column("jitter y", "px", 3), Column("motion", "px", 2))
    tables = [Table("classes", "Motion vectors", judged, tuple(of_classes), notes),
              Table("conventions", "Conventions", (Column("verdict"), *shares), tuple(rows)),
              Table("pairs", "Motion of each pair", (*judged[2:], *px), tuple(of_pairs))]  # fmt: skip
    first, *others = (table for table in tables if table.rows)
    return [replace(first, lead=tuple(lead)), *others]


def headline(summary: Summary) -> str:
    """The answer in one line: what is wrong, then what is not judged."""
    count = sum(verdict["status"] == "not checked" for verdict in summary["verdicts"])
    parts = [f"{len(summary['wrong'])} of {len(summary['verdicts'])} conventions wrong, {count} not checked"]
    classes = [f"vectors of {c['name']} {c['answer']}" for c in summary["classes"]] or ["no motion vectors"]
    parts += [text.replace("vectors of vectors", "vectors") for text in classes]
    return f"{summary['answer'].upper()}: {'; '.join(parts)}"


def save_check(check: Check, sequence: PathTracedSequence, out: str | Path) -> list[Path]:
    """Write check.json, report.html and, with pairs, motion_error as PNG and SVG to ``out``.  Raises OutputError."""
    out, summary = output_folder(out), check_summary(check, sequence)
    remove_files(out, ("motion_error.png", "motion_error.svg"))  # of an earlier check; this one may have no pairs
    page = Page(f"{sequence.name}: conventions", kind="engine check")
    tables, files = check_tables(summary), [out / CHECK_FILE, out / REPORT_FILE]
    of_pairs = [table for table in tables if table.number == "pairs"]
    page.add("conventions", "Verdicts", to_html([t for t in tables if t not in of_pairs], scroll=True))
    if check.pairs:
        files += _plot(check).save(out / "motion_error.png")
        image = picture(data_uri(read_bytes(files[2])), _CAPTION)
        page.add("vectors", "Where vectors are wrong", image, text_lines([_CAPTION]), to_html(of_pairs, scroll=True))
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
