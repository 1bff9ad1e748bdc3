"""Views of results: tables with the paper's rows, plots, mask images and HTML pages.

Input are summaries, rows and arrays; nothing here uses OpenGL.  Modules:

- ``reusable``, ``tables``: reusable pixels and Tables 1 to 4 as data
- ``labels``, ``render``: names of runs, text formats of tables
- ``figures``, ``plots``, ``palette``: Matplotlib helpers, plots of a run, colors
- ``mask_images``, ``frame_store``: images of reason masks, and the stored images of a report
- ``page``, ``run_page``, ``templates``, ``assets``: the HTML kit (``page`` documents how a page is made) and the report
- ``reuse``, ``reuse_frames``: tables, plots, page and stored images of reuse evaluations
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taubench_gl.outputs import output_folder
from taubench_gl.report.mask_images import mask_overlay, save_mask_image
from taubench_gl.report.plots import plot_frames, plot_thresholds
from taubench_gl.report.render import FORMATS, MIN_WIDTH, TablesView, write_tables
from taubench_gl.report.reusable import reusable_sentence, run_tables
from taubench_gl.report.tables import Column, Row, Table, paper_tables

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
    "write_report",
    "write_tables",
]


def write_report(summary: Mapping[str, Any], frames: Sequence[Mapping[str, Any]], folder: str | Path) -> list[Path]:
    """Write the tables (text, Markdown, CSV, LaTeX) and plots (PNG, SVG) of one run to ``folder``.

    -> the files written.  Raises OutputError.
    """
    folder = output_folder(folder)
    written = write_tables(folder, run_tables([summary]))
    written += plot_thresholds(summary, folder / "thresholds")
    written += plot_frames(summary, frames, folder / "frames")
    return written
