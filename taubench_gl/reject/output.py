"""The folder of an evaluation of rejection tests: reject.json, tables, plots, page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from taubench_gl.data_files import read_bytes
from taubench_gl.folder_lock import FolderLock
from taubench_gl.outputs import write_atomically
from taubench_gl.report.page import REPORT_FILE
from taubench_gl.report.reject import plot_reject, reject_html, reject_tables
from taubench_gl.report.table import write_tables

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
