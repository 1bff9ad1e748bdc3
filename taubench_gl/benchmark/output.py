"""Files of a benchmark: benchmark.json, report.html, tables and the plot of error against speed; two side by side."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.benchmark.merge import SCHEMA
from taubench_gl.benchmark.scores import HEADLINES
from taubench_gl.checksums import with_checksums, without_checksums
from taubench_gl.data_files import one_line, read_bytes, read_json
from taubench_gl.errors import OutputError
from taubench_gl.outputs import write_atomically
from taubench_gl.report.benchmark import benchmark_html, benchmark_tables, plot_speeds
from taubench_gl.report.page import REPORT_FILE
from taubench_gl.report.table import write_tables

Summary = Mapping[str, Any]

FILE = "benchmark.json"
SAME_SUITE = ("version", "name", "sha256")
DRIVER = ("renderer", "driver")
DAMAGED = "is the file damaged?"


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
    """The keys of benchmark.json that its readers need; others are allowed."""

    suite: _Suite
    measures: dict[str, _Measure]
    cases: dict[str, _Case]
    methods: dict[str, _Method]
    rankings: dict[str, dict[str, Any]]
    speeds: dict[str, Any]
    times: dict[str, Any]
    provenance: dict[str, Any]


def write_results(summary: Summary, folder: Path) -> list[Path]:
    """Write the numbers first, then tables, plots and the page.  -> the files.  Raises OutputError."""
    path = folder / FILE
    write_atomically(path, json.dumps(with_checksums(summary), indent=1, allow_nan=False) + "\n")
    plots = plot_speeds(summary, folder)
    written = [path, *write_tables(folder, benchmark_tables(summary)), *plots]
    write_atomically(folder / REPORT_FILE, benchmark_html(summary, read_bytes(plots[0]) if plots else None))
    return [*written, folder / REPORT_FILE]


def load_benchmark(path: str | Path) -> dict[str, Any]:
    """The values of a benchmark.json, or of the one in a folder.  Raises OutputError for other and damaged files."""
    file = Path(path) / FILE if Path(path).is_dir() else Path(path)
    values = read_json(file, dict[str, Any])
    if values.get("schema") != SCHEMA:
        message = f"schema is {values.get('schema')!r}, expected {SCHEMA!r}"
        raise OutputError(message, where=str(file), hint="give a benchmark.json, or the folder of --out")
    with one_line(file, hint=DAMAGED):
        methods = msgspec.convert(values, _Benchmark).methods
    tracks = {case["track"] for case in values["cases"].values()}
    if lost := next((label for label, method in methods.items() if method.tracks.keys() != tracks), None):
        raise OutputError(f"method {lost} has not the tracks of the cases", where=str(file), hint=DAMAGED)
    return without_checksums(values, file)[0]


def require_comparable(a: Summary, b: Summary) -> None:
    """Raise OutputError for other suites, and for cases whose scenes or settings differ."""
    if any(a["suite"][name] != b["suite"][name] for name in SAME_SUITE):
        suite_a, suite_b = (
            f"{s['suite']['version']} {s['suite']['name']} ({s['suite']['sha256'][:8]})" for s in (a, b)
        )
        raise OutputError(f"the suites are {suite_a} and {suite_b}", hint="run the same suite for both")
    if set(a["cases"]) != set(b["cases"]):
        raise OutputError("the cases are not the same in both", hint=DAMAGED)
    for case, entry in a["cases"].items():
        if entry["sha256"] != b["cases"][case]["sha256"]:
            hint = "another version made another scene; run one of them again"
            raise OutputError(f"case {case} is not the same in both", hint=hint)


def compared(a: Summary, b: Summary) -> dict[str, Any]:
    """Two benchmarks side by side: ``rows`` of method and track with both means and b - a, and ``notes``.

    Notes say what limits the comparison, such as another driver.  Raises OutputError, as ``require_comparable``.
    """
    require_comparable(a, b)
    notes = []
    drivers = [" ".join(str(s["provenance"].get(name)) for name in DRIVER) for s in (a, b)]
    if drivers[0] != drivers[1]:
        notes.append(f"other driver: A ran on {drivers[0]}, B on {drivers[1]}; times are not comparable")
    versions = [s["provenance"].get("version") for s in (a, b)]
    if versions[0] != versions[1]:
        notes.append(f"other version of taubench-gl: {versions[0]} and {versions[1]}")
    for name, one, other in (("A", a, b), ("B", b, a)):
        if only := [label for label in one["methods"] if label not in other["methods"]]:
            notes.append(f"in {name} only: {', '.join(only)}")
    rows = []
    for label in a["methods"]:
        if label not in b["methods"]:
            continue
        of_a, of_b = (s["methods"][label] for s in (a, b))
        if of_a["sha256"] != of_b["sha256"]:
            notes.append(f"{label} has other files in A and B")
        tracks = of_a["tracks"].items()
        rows += [_row(label, track, state, of_b["tracks"][track], a["measures"]) for track, state in tracks]
    return {"rows": rows, "notes": notes, "other_driver": drivers[0] != drivers[1]}


def _row(label: str, track: str, of_a: Summary, of_b: Summary, measures: Summary) -> dict[str, Any]:
    """One method in one track of both benchmarks."""
    values: dict[str, Any] = {}
    for name in HEADLINES:
        if name in measures:
            pair = [t["mean"].get(name) if t["state"] == "done" else None for t in (of_a, of_b)]
            values[name] = {"a": pair[0], "b": pair[1], "difference": None if None in pair else pair[1] - pair[0]}
    states = {t["state"]: t["reason"] for t in (of_a, of_b) if t["state"] != "done"}
    return {"method": label, "track": track, "measures": values, "states": states}
