"""Result files that notice damage: a block ``stored`` with SHA-256 sums.

``stored.sha256`` is the sum of the JSON values without itself (keys sorted, no spaces: indentation and order may
change), ``stored.rows_sha256`` of the bytes of frames.csv; ``stored.files`` names further files of the run.  The sums
protect against damage and careless edits, not against forgery.  Values without the block are read as they are.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.data_files import hashed, one_line
from taubench_gl.errors import OutputError

KEY = "stored"


class _Stored(msgspec.Struct):
    """The block ``stored`` of a result file."""

    sha256: str
    rows_sha256: str | None = None
    files: list[str] = []


def values_sha256(values: Any) -> str:
    """Hash of JSON values, whatever their indentation and the order of their keys."""
    text = json.dumps(values, sort_keys=True, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def with_checksums(values: Mapping[str, Any], rows: Path | None = None, files: Iterable[Path] = ()) -> dict[str, Any]:
    """Add the block ``stored`` to ``values``, which are as JSON reads them back.

    ``rows``: frames.csv, None for a result without rows; ``files``: further files in its folder.  Raises OutputError
    for a file that is missing.
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
    """The ``values`` of the file ``path`` without the block ``stored``, and the names of missing files of the run.

    Raises OutputError where values or ``rows`` are not those that were written.
    """
    if KEY not in values:
        return values, []
    out = dict(values)
    about = out.pop(KEY)
    with one_line(path, hint="is the file damaged?"):
        stored = msgspec.convert(about, _Stored)
    unsealed = {key: value for key, value in about.items() if key != "sha256"}
    remove = f"remove the block {KEY!r} of {path.name}"
    if values_sha256(out | {KEY: unsealed}) != stored.sha256:
        hint = f"write it again; to read a file that you changed yourself, {remove}"
        raise OutputError("a value was changed after the file was written", where=str(path), hint=hint)
    if rows is not None and hashed(rows).hexdigest() != stored.rows_sha256:
        hint = f"write it again; to read rows that you changed yourself, {remove}"
        message = f"is not the file that belongs to {path.name}: its rows were changed"
        raise OutputError(message, where=str(rows), hint=hint)
    return out, [name for name in stored.files if not (path.parent / name).is_file()]
