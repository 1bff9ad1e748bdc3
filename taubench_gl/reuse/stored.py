"""Reads the folder of a reuse evaluation back: reuse.json and frames.csv."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from taubench_gl.checksums import without_checksums
from taubench_gl.data_files import checked, read_json, schema_fault
from taubench_gl.errors import OutputError
from taubench_gl.run import FRAMES_FILE, read_frames

FILE = "reuse.json"
SCHEMA = "taubench-gl/reuse/3"
_INTEGERS = frozenset({"frame", "seed", "invalid_pixels"})

Number = float | None
Count = Annotated[int, Meta(ge=0)]


class _Class(Struct):
    percent: Number
    pixels: Count


class _Method(Struct):
    """A method that failed has ``failed`` alone."""

    failed: str | None
    mean: dict[str, Number] | None = None
    reuse: dict[str, Number] | None = None
    classes: dict[str, _Class] | None = None
    reasons: dict[str, str] | None = None
    time_ms: Number = None
    memory_bytes: Number = None


class _Measure(Struct):
    unit: str
    better: str
    doc: str


class _Settings(Struct):
    width: Count
    height: Count
    fps: float
    first_frame: int
    last_frame: int


class _Input(Struct):
    kind: str
    light_samples: int | None
    notes: list[str]
    shading_ms: Number
    indirect_samples: int | None = None
    seed: int | None = None


class _Reference(Struct):
    kind: str
    samples: int | None
    path: str | None = None
    noise: str | None = None


class _Scene(Struct):
    name: str


class _Summary(Struct):
    scene: _Scene
    settings: _Settings
    evaluated_frames: Count
    input: _Input
    reference: _Reference
    mask_source: str
    measures: dict[str, _Measure]
    classes: dict[str, str]
    clock: str
    methods: dict[str, _Method]


@dataclass(frozen=True, slots=True)
class StoredEvaluation:
    """An evaluation as its folder ``out`` holds it.  ``summary``: reuse.json; ``rows``: frames.csv, numbers as int or
    float, an empty cell as None."""

    summary: dict[str, Any]
    rows: list[dict[str, Any]]
    out: Path


def is_evaluation(folder: str | Path) -> bool:
    """Whether ``folder``, or the reuse.json that it names, holds a reuse evaluation."""
    path = Path(folder)
    return path.name == FILE or (path / FILE).is_file()


def load_evaluation(folder: str | Path) -> StoredEvaluation:
    """Read an evaluation; ``folder`` may also name its reuse.json.

    Raises OutputError for files that are missing, damaged, changed or of another schema.
    """
    out = Path(folder)
    out = out.parent if out.name == FILE else out
    path = out / FILE
    summary = read_json(path)
    schema = summary.get("schema") if isinstance(summary, dict) else None
    if schema != SCHEMA:
        hint = "another version of taubench-gl wrote it"
        raise OutputError(f"schema is {schema!r}, expected {SCHEMA!r}", where=str(path), hint=hint)
    try:
        checked(summary, _Summary)
    except msgspec.ValidationError as error:
        raise OutputError(schema_fault(error), where=str(path), hint="is the file damaged?") from None
    _check_methods(summary, path)
    rows = _read_rows(out / FRAMES_FILE, summary)
    summary, _ = without_checksums(summary, path, out / FRAMES_FILE)
    return StoredEvaluation(summary, rows, out)


def _check_methods(summary: dict[str, Any], path: Path) -> None:
    """Raises OutputError for a method that ran and lacks a block."""
    for label, method in summary["methods"].items():
        if method["failed"]:
            continue
        missing = [block for block in ("mean", "reuse", "classes", "reasons") if method.get(block) is None]
        missing += [f"classes.{c}" for c in summary["classes"] if c not in (method.get("classes") or {})]
        if missing:
            message = f"methods.{label} has no {', '.join(missing)}"
            raise OutputError(message, where=str(path), hint="is the file damaged?")


def _read_rows(path: Path, summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Raises OutputError for a file without the columns of the measures."""
    rows = read_frames(path, _INTEGERS, texts=("method",))
    columns = rows[0] if rows else ()
    needed = ("frame", "method", *summary["measures"])
    lacking = [name for name in needed if name not in columns]
    if lacking and not all(method["failed"] for method in summary["methods"].values()):
        raise OutputError(f"has no column {lacking[0]}", where=str(path), hint="is the file damaged?")
    return rows
