"""Files of a benchmark: benchmark.json, report.html, tables and the plot of error against speed; and reading them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.benchmark.merge import SCHEMA
from taubench_gl.checksums import with_checksums, without_checksums
from taubench_gl.data_files import checked, read_bytes, read_json, schema_fault
from taubench_gl.errors import OutputError
from taubench_gl.outputs import write_atomically
from taubench_gl.report.benchmark import benchmark_html, benchmark_tables, plot_speeds
from taubench_gl.report.page import REPORT_FILE
from taubench_gl.report.table import write_tables

FILE = "benchmark.json"


class _Suite(msgspec.Struct):
    version: str
    name: str
    sha256: str


class _Case(msgspec.Struct):
    sha256: str
    track: str


class _Track(msgspec.Struct):
    state: str
    reason: str | None
    mean: dict[str, float | None] = {}


class _Method(msgspec.Struct):
    sha256: str | None
    tracks: dict[str, _Track]


class _Measure(msgspec.Struct):
    unit: str
    better: str


class _Benchmark(msgspec.Struct):
    schema: str
    suite: _Suite
    measures: dict[str, _Measure]
    cases: dict[str, _Case]
    methods: dict[str, _Method]
    rankings: dict[str, dict[str, Any]]
    speeds: dict[str, Any]
    times: dict[str, Any]
    provenance: dict[str, Any]


def write_results(summary: Mapping[str, Any], folder: Path) -> list[Path]:
    """Numbers first, then the page.  -> the files.  Raises OutputError."""
    path = folder / FILE
    write_atomically(path, json.dumps(with_checksums(summary), indent=1, allow_nan=False) + "\n")
    plots = plot_speeds(summary, folder)
    written = [path, *write_tables(folder, benchmark_tables(summary)), *plots]
    write_atomically(folder / REPORT_FILE, benchmark_html(summary, read_bytes(plots[0]) if plots else None))
    return [*written, folder / REPORT_FILE]


def load_benchmark(path: str | Path) -> dict[str, Any]:
    """A benchmark.json, or that of a folder.  Raises OutputError for other files, and changed ones."""
    file = Path(path) / FILE if Path(path).is_dir() else Path(path)
    values = read_json(file, dict[str, Any])
    if values.get("schema") != SCHEMA:
        message = f"schema is {values.get('schema')!r}, expected {SCHEMA!r}"
        raise OutputError(message, where=str(file), hint="give a benchmark.json, or the folder of --out")
    try:
        checked(values, _Benchmark)
    except msgspec.ValidationError as error:
        raise OutputError(schema_fault(error), where=str(file), hint="is the file damaged?") from None
    tracks = {case["track"] for case in values["cases"].values()}
    if lost := next((label for label, method in values["methods"].items() if set(method["tracks"]) != tracks), None):
        raise OutputError(
            f"method {lost} has not the tracks of the cases", where=str(file), hint="is the file damaged?"
        )
    return without_checksums(values, file)[0]
