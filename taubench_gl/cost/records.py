"""Records of a cost study as JSON lines, one per finished measurement.  A killed study resumes from them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taubench_gl.data_files import parse_json, read_bytes
from taubench_gl.errors import OutputError
from taubench_gl.outputs import cannot_write, output_folder, own_file

RECORDS_FILE = "records.jsonl"
RECORDS_SCHEMA = "taubench-gl/cost-records/4"
MAX_RECORDS = 1 << 30
"""Limit on the bytes of the file."""

Record = Mapping[str, Any]
"""``kind``: reference, masks, time or columns.  All but the first name their ``configuration``."""


class Records:
    """The file and its records.  Each line is on the disk before the next measurement starts."""

    def __init__(self, folder: Path, header: Mapping[str, Any]):
        """Continue the records in ``folder`` if there are any, else start them.

        ``header`` has ``identity`` (part -> hash) and ``machine`` (what times depend on).  Raises OutputError if the
        records belong to another study or machine.
        """
        self.path = output_folder(folder) / RECORDS_FILE
        header = {"kind": "study", "schema": RECORDS_SCHEMA, **header}
        try:
            text = read_bytes(self.path, max_bytes=MAX_RECORDS, links=False) if self.path.exists() else b""
            whole = text[: text.rfind(b"\n") + 1]
            stored = [_parse(line, self.path, i) for i, line in enumerate(whole.splitlines(), start=1)]
            if stored:
                _require_same(stored[0], header, folder)
            self._file = own_file(self.path, append=True)
            self._file.truncate(len(whole))  # an incomplete last line was cut off when the process was killed
        except OSError as error:
            raise cannot_write(self.path, error) from None
        self.lines = stored[1:]
        if not stored:
            self._write(header)

    def add(self, kind: str, record: Mapping[str, Any]) -> None:
        """Append one finished measurement.  Raises OutputError if it cannot be written."""
        line = {"kind": kind, **record}
        self._write(line)
        self.lines.append(line)

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [line for line in self.lines if line["kind"] == kind]

    def by_configuration(self, kind: str) -> dict[str, dict[str, Any]]:
        return {line["configuration"]: line for line in self.of(kind)}

    @property
    def reference(self) -> dict[str, Any] | None:
        """The latest one."""
        return next(reversed(self.of("reference")), None)

    def close(self) -> None:
        self._file.close()

    def _write(self, record: Mapping[str, Any]) -> None:
        data = (json.dumps(record, allow_nan=False) + "\n").encode()
        try:
            while data:
                data = data[self._file.write(data) :]
            os.fsync(self._file.fileno())
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
    stored = there.get("identity") or {}
    other = [part for part, value in wanted["identity"].items() if stored.get(part) != value]
    if other:
        raise OutputError(f"holds a study with other {' and '.join(other)}", where=str(folder), hint=hint)
    if there.get("machine") != wanted["machine"]:
        was = ", ".join(str(v) for v in (there.get("machine") or {}).values())
        raise OutputError(f"its times were taken on another machine or driver ({was})", where=str(folder), hint=hint)
