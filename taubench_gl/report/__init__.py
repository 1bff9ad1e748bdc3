"""Views of results: tables with the paper's rows, plots, mask images and HTML pages.

Input are summaries, rows and arrays; nothing here uses OpenGL.  The kit: ``table`` (``Table`` in five formats),
``page`` (``Page``), ``plot`` (``Plot``), ``palette``, ``method_styles``, ``mask_images``, and the stored images of the
frame viewer (``frame_store``, ``reuse_frames``).  Everything else composes it: tables, plots and page of one kind of
result each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taubench_gl.outputs import output_folder
from taubench_gl.report.mask_images import mask_overlay, save_mask_image
from taubench_gl.report.paper import paper_tables
from taubench_gl.report.reusable import reusable_sentence, run_tables, short_tables
from taubench_gl.report.run_plots import plot_frames, plot_thresholds
from taubench_gl.report.table import FORMATS, MIN_WIDTH, Column, Row, Table, TablesView, write_tables

__all__ = [
    "FORMATS",
    "MIN_WIDTH",
    "Column",
    "Row",
    "Table",
    "TablesView",
    "mask_overlay",
    "paper_tables",
    "plot_frames",
    "plot_thresholds",
    "reusable_sentence",
    "run_tables",
    "save_mask_image",
    "short_tables",
    "write_report",
    "write_tables",
]


def write_report(summary: Mapping[str, Any], frames: Sequence[Mapping[str, Any]], folder: str | Path) -> list[Path]:
    """Write the tables (text, Markdown, CSV, LaTeX) and plots (PNG, SVG) of one run to ``folder``.

    -> the files written.  Raises OutputError.
    """
    folder = output_folder(folder)
    files = write_tables(folder, run_tables([summary]))
    files += plot_thresholds(summary, folder / "thresholds")
    files += plot_frames(summary, frames, folder / "frames")
    return files
