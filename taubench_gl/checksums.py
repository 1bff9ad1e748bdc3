"""Result files that notice a later change: a block ``stored`` with SHA-256 sums.

``stored.sha256`` is of the JSON values without it (keys sorted, no spaces: indentation and order may change),
``stored.rows_sha256`` of the bytes of frames.csv, ``stored.files`` names further files of the run.  This finds damage
and careless edits; it is no signature.  Values without the block are read as they are.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.data_files import checked, hashed, schema_fault
from taubench_gl.errors import OutputError

KEY = "stored"


class _Stored(msgspec.Struct):
    sha256: str
    rows_sha256: str | None = None
    files: list[str] = []


def values_sha256(values: Any) -> str:
    """Of JSON values, whatever their indentation and the order of their keys."""
    text = json.dumps(values, sort_keys=True, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def with_checksums(values: Mapping[str, Any], rows: Path | None = None, files: Iterable[Path] = ()) -> dict[str, Any]:
    """``values``, as JSON reads them back, with the block ``stored``.

    ``rows``: frames.csv, if they have one; ``files``: others of its folder.  Raises OutputError for a missing one.
    """
    about: dict[str, Any] = {}
    if rows is not None:
        files = sorted(set(files))
        if lost := [file for file in files if not file.is_file()]:
            hint = f"{len(lost)} of {len(files)} files that the run wrote were removed: run it again"
            raise OutputError("was removed while the run went on", where=str(lost[0]), hint=hint)
        about = {
            "rows_sha256": hashed(rows).hexdigest(),
            "files": [str(file.relative_to(rows.parent)) for file in files],
        }
    out = {key: value for key, value in values.items() if key != KEY} | {KEY: about}
    return out | {KEY: about | {"sha256": values_sha256(out)}}


def without_checksums(values: dict[str, Any], path: Path, rows: Path | None = None) -> tuple[dict[str, Any], list[str]]:
    """``values`` of the file ``path`` without the block ``stored``, and those of its files that are missing.

    Raises OutputError where values or ``rows`` are not those that were written.
    """
    if KEY not in values:
        return values, []
    try:
        about = checked(values[KEY], _Stored)
    except msgspec.ValidationError as error:
        raise OutputError(f"{KEY}.{schema_fault(error)}", where=str(path), hint="is the file damaged?") from None
    out = {key: value for key, value in values.items() if key != KEY}
    rest = {key: value for key, value in about.items() if key != "sha256"}
    if values_sha256(out | {KEY: rest}) != about["sha256"]:
        hint = f"write it again; to read a file that you changed yourself, remove its block {KEY!r}"
        raise OutputError("a value was changed after the file was written", where=str(path), hint=hint)
    if rows is not None and hashed(rows).hexdigest() != about.get("rows_sha256"):
        hint = f"write it again; to read rows that you changed yourself, remove the block {KEY!r} of {path.name}"
        raise OutputError(
            f"is not the file that belongs to {path.name}: its rows were changed", where=str(rows), hint=hint
        )
    missing = [name for name in about.get("files", ()) if not (path.parent / name).is_file()]
    return out, missing


def stored_files(values: Mapping[str, Any]) -> list[str]:
    """Names of the further files of a run in the block ``stored``; none without a right block."""
    try:
        return msgspec.convert(values.get(KEY) or {}, _Stored).files
    except msgspec.ValidationError:
        return []
