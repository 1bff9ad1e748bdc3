"""Two benchmarks side by side: only of one suite and equal scenes; other drivers and other methods are marked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taubench_gl.benchmark.values import HEADLINES
from taubench_gl.errors import OutputError

Summary = Mapping[str, Any]

SAME_SUITE = ("version", "name", "sha256")
DRIVER = ("renderer", "driver")


def require_comparable(a: Summary, b: Summary) -> None:
    """Raises OutputError for other suites, and for cases whose scenes or settings differ."""
    if any(a["suite"][name] != b["suite"][name] for name in SAME_SUITE):
        suite_a, suite_b = (
            f"{s['suite']['version']} {s['suite']['name']} ({s['suite']['sha256'][:8]})" for s in (a, b)
        )
        raise OutputError(f"the suites are {suite_a} and {suite_b}", hint="run the same suite for both")
    if set(a["cases"]) != set(b["cases"]):
        raise OutputError("the cases are not the same in both", hint="is one of the files damaged?")
    for case, entry in a["cases"].items():
        if entry["sha256"] != b["cases"][case]["sha256"]:
            hint = "another version made another scene; run one of them again"
            raise OutputError(f"case {case} is not the same in both", hint=hint)


def compared(a: Summary, b: Summary) -> dict[str, Any]:
    """``rows``: track, method, measure, both means, difference b - a; ``notes``: what limits the comparison.

    Raises OutputError, as ``require_comparable``.
    """
    require_comparable(a, b)
    notes = []
    drivers = [" ".join(str(s["provenance"].get(name)) for name in DRIVER) for s in (a, b)]
    if drivers[0] != drivers[1]:
        notes.append(f"other driver: A ran on {drivers[0]}, B on {drivers[1]}; times are not comparable")
    versions = [s["provenance"].get("version") for s in (a, b)]
    if versions[0] != versions[1]:
        notes.append(f"other version of taubench-gl: {versions[0]} and {versions[1]}")
    labels = list(dict.fromkeys([*a["methods"], *b["methods"]]))
    for name, own, other in (("A", a, b), ("B", b, a)):
        if only := [label for label in own["methods"] if label not in other["methods"]]:
            notes.append(f"in {name} only: {', '.join(only)}")
    rows = []
    for label in labels:
        results = [s["methods"].get(label) for s in (a, b)]
        if None in results:
            continue
        if results[0]["sha256"] != results[1]["sha256"]:
            notes.append(f"{label} has other files in A and B")
        for track, of_a in results[0]["tracks"].items():
            rows.append(_row(label, track, of_a, results[1]["tracks"][track], a["measures"]))
    return {"rows": rows, "notes": notes, "other_driver": drivers[0] != drivers[1]}


def _row(label: str, track: str, of_a: Summary, of_b: Summary, measures: Summary) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name in HEADLINES:
        if name in measures:
            pair = [t["mean"].get(name) if t["state"] == "done" else None for t in (of_a, of_b)]
            values[name] = {"a": pair[0], "b": pair[1], "difference": None if None in pair else pair[1] - pair[0]}
    states = {t["state"]: t["reason"] for t in (of_a, of_b) if t["state"] != "done"}
    return {"method": label, "track": track, "measures": values, "states": states}
