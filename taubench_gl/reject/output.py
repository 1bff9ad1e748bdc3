"""The folder of an evaluation of rejection tests, and thresholds for a wanted recall."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.data_files import read_bytes
from taubench_gl.errors import SettingsError
from taubench_gl.folder_lock import FolderLock
from taubench_gl.outputs import write_atomically
from taubench_gl.reject.evaluate import Rejection
from taubench_gl.report.page import REPORT_FILE
from taubench_gl.report.reject import plot_reject, reject_html, reject_tables
from taubench_gl.report.table import Column, Row, Table, write_tables

REJECT_FILE = "reject.json"


def write_rejection(out: Path, summary: dict[str, Any]) -> list[Path]:
    """Write everything to ``out``, reject.json last.  -> the files.  Raises OutputError."""
    with FolderLock(out):
        written = write_tables(out, reject_tables(summary))
        plots = plot_reject(summary, out)
        images = {path.stem.replace("_", " "): read_bytes(path) for path in plots if path.suffix == ".png"}
        write_atomically(out / REPORT_FILE, reject_html(summary, images))
        write_atomically(out / REJECT_FILE, json.dumps(summary, indent=2, allow_nan=False) + "\n")
    return [*written, *plots, out / REPORT_FILE, out / REJECT_FILE]


def check_recall(recall: float) -> None:
    """Refuse a recall outside (0, 1].  Raises SettingsError."""
    if not 0.0 < recall <= 1.0:
        raise SettingsError(f"recall is {recall:g}", hint="give a number above 0, at most 1")


def fitted(found: Rejection, recall: float) -> dict[str, Any]:
    """Test -> the largest threshold whose recall is at least ``recall``, and its rates; JSON values.

    Raises SettingsError.
    """
    check_recall(recall)
    tests = {}
    for name, scores in found.scores.items():
        curve = scores.curves[scores.truth]
        threshold = curve.threshold_for(recall)
        entry: dict[str, Any] = {"default": scores.test.threshold, "threshold": threshold, "truth": scores.truth}
        if threshold is None:
            entry |= dict.fromkeys(("recall", "precision", "false_positive_rate"))
            entry["reason"] = "no threshold reaches this recall" if curve.positive.sum() else "no positive pixel"
        else:
            thresholds, reached, wrong = curve.rates()
            at = int(np.searchsorted(thresholds, threshold))
            precision = float(curve.precision()[at])
            entry |= {"recall": float(reached[at]), "precision": precision, "false_positive_rate": float(wrong[at])}
        tests[name] = entry
    return {"schema": "taubench-gl/reject-fit/1", "recall": recall, "scene": found.summary["scene"], "tests": tests}


def fit_table(fit: dict[str, Any]) -> Table:
    """The result of ``fitted`` as a table, one row a test."""
    columns = (
        Column("default", "", 4), Column("threshold", "", 5), Column("recall", "", 3), Column("precision", "", 3),
        Column("false positives", "%", 3),
    )  # fmt: skip
    rows = []
    for name, t in fit["tests"].items():
        wrong = None if t["false_positive_rate"] is None else 100.0 * t["false_positive_rate"]
        values = (t["default"], t["threshold"], t["recall"], t["precision"], wrong)
        rows.append(Row(name, values, reasons={i: t.get("reason", "") for i, v in enumerate(values) if v is None}))
    return Table("fit", f"Thresholds for a recall of {fit['recall']:g}", columns, tuple(rows))
