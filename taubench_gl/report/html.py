"""A run, or several side by side, as one HTML file: no network, no library, everything inside.

Tables and listings are plain HTML; plots, the frame viewer and the threshold curves are drawn by the scripts in
``assets`` from one block of JSON.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from taubench_gl.outputs import write_atomically
from taubench_gl.report import html_parts as parts
from taubench_gl.report.html_data import MAX_PICTURES, ReportRun, for_script, report_data
from taubench_gl.report.tables import run_labels

REPORT_FILE = "report.html"
_SCRIPTS = ("svg.js", "viewer.js", "plots.js", "curves.js", "report.js")

__all__ = ["REPORT_FILE", "ReportRun", "asset", "report_html", "write_html_report"]


def write_html_report(runs: Sequence[ReportRun], path: str | Path, pictures: int = MAX_PICTURES) -> Path:
    """Write ``report_html`` to ``path``, whole or not at all.  Raises OutputError."""
    path = Path(path)
    write_atomically(path, report_html(runs, pictures))
    return path


def report_html(runs: Sequence[ReportRun], pictures: int = MAX_PICTURES) -> str:
    """The page.  ``pictures``: pairs pictured at most, all runs together; fewer where they take too many bytes.

    Raises ValueError without a run.
    """
    if not runs:
        raise ValueError("a report needs a run")
    summaries = [run.summary for run in runs]
    labels = run_labels(summaries)
    return Template(asset("report.html")).substitute(
        title=parts.escape(" and ".join(labels) if len(labels) < 4 else f"{len(labels)} runs"),
        about="<br>".join(
            _about(summary, label, len(labels)) for summary, label in zip(summaries, labels, strict=True)
        ),
        style=asset("page.css") + asset("report.css"),
        figures=parts.key_figures(summaries, labels),
        tables=parts.tables(summaries),
        runs="".join(_details(summary, label, len(labels)) for summary, label in zip(summaries, labels, strict=True)),
        data=for_script(report_data(runs, labels, pictures)),
        script="\n".join(asset(name) for name in _SCRIPTS),
    )


def asset(name: str) -> str:
    """A file of ``report/assets`` as text."""
    return resources.files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


def _about(summary: Mapping[str, Any], label: str, count: int) -> str:
    who = f"<b>{parts.escape(label)}</b>: " if count > 1 else ""
    stand_in = (summary.get("scene") or {}).get("stand_in")
    return f"{who}{parts.about(summary)}" + (f" · stand-in: {parts.escape(str(stand_in))}" if stand_in else "")


def _details(summary: Mapping[str, Any], label: str, count: int) -> str:
    blocks = (
        ("Effects, and why they are simulated", parts.effects(summary), True),
        ("Cuts", parts.cuts(summary), True),
        ("Notes", parts.notes(summary), bool(summary.get("notes"))),
        ("Time per pass", parts.timing(summary), False),
        ("Settings", parts.listing(summary.get("settings")), False),
        ("Scene", parts.listing(summary.get("scene")), False),
        ("Where these numbers come from", parts.listing(summary.get("provenance")), False),
    )
    inner = "".join(
        f"<details{' open' if is_open else ''}><summary>{parts.escape(head)}</summary>{body}</details>"
        for head, body, is_open in blocks
    )
    head = f"<h3>{parts.escape(label)}</h3>" if count > 1 else ""
    return f"<section class='run'>{head}{inner}</section>"
