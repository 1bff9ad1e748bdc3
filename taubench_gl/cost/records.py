"""Records of a cost study as JSON lines, one per finished measurement.  A killed study resumes from them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taubench_gl.data_files import parse_json
from taubench_gl.errors import OutputError
from taubench_gl.outputs import cannot_write

RECORDS_FILE = "records.jsonl"
RECORDS_SCHEMA = "taubench-gl/cost-records/4"


class Records:
    """The file and its records.  Each line is on the disk before the next measurement starts."""

    def __init__(self, folder: Path, header: Mapping[str, Any]):
        """Continue the records in ``folder`` if there are any, else start them.

        ``header`` has ``identity`` (part -> hash) and ``machine`` (what times depend on).  Raises OutputError if the
        records belong to another study or machine.
        """
        self.path = folder / RECORDS_FILE
        self.lines: list[dict[str, Any]] = []
        header = {"kind": "study", "schema": RECORDS_SCHEMA, **header}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            text = self.path.read_bytes() if self.path.exists() else b""
        except (FileExistsError, NotADirectoryError):
            raise OutputError("is not a folder", where=str(folder), hint="give --out another name") from None
        except OSError as error:
            raise cannot_write(folder, error) from None
        whole = text[: text.rfind(b"\n") + 1]
        found = [_parse(line, self.path, i) for i, line in enumerate(whole.splitlines(), start=1)]
        if found:
            _require_same(found[0], header, folder)
            self.lines = found[1:]
        try:
            self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT, 0o644)
            # An incomplete last line was cut off when the process was killed.
            os.ftruncate(self._file, len(whole))
            os.lseek(self._file, 0, os.SEEK_END)
        except OSError as error:
            raise cannot_write(self.path, error) from None
        if not found:
            self._write(header)

    def add(self, record: Mapping[str, Any]) -> None:
        """Append one finished measurement.  Raises OutputError if it cannot be written."""
        self._write(record)
        self.lines.append(dict(record))

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [line for line in self.lines if line["kind"] == kind]

    def close(self) -> None:
        os.close(self._file)

    def _write(self, record: Mapping[str, Any]) -> None:
        data = (json.dumps(record, allow_nan=False, default=_plain) + "\n").encode()
        try:
            while data:
                data = data[os.write(self._file, data) :]
            os.fsync(self._file)
        except OSError as error:
            raise cannot_write(self.path, error) from None


def _parse(line: bytes, path: Path, number: int) -> dict[str, Any]:
    try:
        record = parse_json(line)
    except (ValueError, RecursionError):
        record = None
    if not isinstance(record, dict) or not isinstance(record.get("kind"), str):
        hint = "delete the file to start from scratch"
        raise OutputError("is not a record of a study", where=f"{path}:{number}", hint=hint)
    return record


def _require_same(there: Mapping[str, Any], wanted: Mapping[str, Any], folder: Path) -> None:
    hint = "give --out another folder, or --fresh to measure from scratch"
    if there.get("kind") != "study" or there.get("schema") != RECORDS_SCHEMA:
        raise OutputError("its records have another format version", where=str(folder), hint=hint)
    known = there.get("identity") or {}
    other = [part for part, value in wanted["identity"].items() if known.get(part) != value]
    if other:
        raise OutputError(f"holds a study with other {' and '.join(other)}", where=str(folder), hint=hint)
    if there.get("machine") != wanted["machine"]:
        was = ", ".join(str(v) for v in (there.get("machine") or {}).values())
        raise OutputError(f"its times were taken on another machine or driver ({was})", where=str(folder), hint=hint)


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be stored in a record")
