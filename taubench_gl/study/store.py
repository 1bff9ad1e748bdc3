"""The folder of a study and its files.

    study.json               what the study is of, and the version that writes it
    records/KEY.json         result of the unit ``key``: {"sha256": of the value's bytes, "value": ...}
    logs/JOB.log             why a job failed; logs/worker-N.log: output of worker processes

A record's name has a hash of all that it depends on, so that records of folders can be copied together.  Only the
driver writes here, and every file appears complete or not at all.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from taubench_gl import __version__
from taubench_gl.conventions import DEFINITIONS
from taubench_gl.data_files import parse_json, read_bytes, read_json, read_text
from taubench_gl.errors import OutputError
from taubench_gl.outputs import write_atomically

STUDY_FILE, RECORDS, LOGS = "study.json", "records", "logs"

MAX_RECORD_BYTES = 1 << 30


class _Record(msgspec.Struct):
    sha256: str
    value: msgspec.Raw
    definitions: int = 1


def json_bytes(value: Any) -> bytes:
    """The result of a unit as JSON.  NumPy values become lists and numbers.  Raises ValueError for NaN and infinity."""
    return json.dumps(value, default=_plain, allow_nan=False).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be stored")


def content_hash(value: Any) -> str:
    """Hash of a JSON value for keys, 16 hexadecimal digits."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


class Store:
    """The folder ``out`` of a study.  ``kind``: name of its command, such as ``batch``; ``schema``: of study.json."""

    def __init__(self, out: str | Path, kind: str, schema: str):
        self.out, self._kind, self._schema = Path(out), kind, schema

    # ------------------------------------------------------------------------------------------------------- study
    def require_usable(self, expected: Mapping[str, Any]) -> None:
        """Raise OutputError if the folder holds other files, or another study.

        ``expected``: values that study.json must have, if there is one; a folder of copied records has none.
        """
        if (self.out / STUDY_FILE).exists():
            values = self.about()
            for name, value in expected.items():
                if values.get(name) != value:
                    message = f"holds a {self._kind} of another {name}: {_short(values.get(name))}, not {_short(value)}"
                    raise OutputError(message, where=str(self.out), hint="give --out a new folder")
        elif self.out.is_dir() and any(p.name not in (RECORDS, LOGS) and p.name[0] != "." for p in self.out.iterdir()):
            raise OutputError(
                f"holds other files and no {self._kind}", where=str(self.out), hint="give --out a new folder"
            )

    def write_about(self, values: Mapping[str, Any]) -> None:
        """Write ``values`` to study.json, with schema and version."""
        head = {"schema": self._schema, "version": __version__, "definitions": DEFINITIONS}
        self.write_json(self.out / STUDY_FILE, head | values)

    def about(self) -> dict[str, Any]:
        """The values of study.json.  Raises OutputError if there is none, and for one of another version."""
        path = self.out / STUDY_FILE
        if not path.exists():
            message = f"holds no {self._kind}" if self.out.is_dir() else "is not a folder"
            message = message if self.out.exists() else "does not exist"
            hint = f"give the folder of 'taubench-gl {self._kind} --out'"
            raise OutputError(message, where=str(self.out), hint=hint)
        values = read_json(path, dict[str, Any])
        schema, version = values.get("schema"), values.get("version")
        if schema != self._schema or version != __version__:
            message = f"was started by taubench-gl {version} ({schema}), this is {__version__} ({self._schema})"
            raise OutputError(message, where=str(path), hint="a study does not mix versions: give a new --out")
        if (definitions := values.get("definitions", 1)) != DEFINITIONS:
            message = f"holds numbers of definitions {definitions}, this version measures by {DEFINITIONS}"
            raise OutputError(message, where=str(path), hint="give a new --out; see docs/changes-of-numbers.md")
        return values

    # ----------------------------------------------------------------------------------------------------- records
    def save(self, key: str, data: bytes) -> None:
        """Store the result of a unit, JSON, as the record ``key`` with a checksum.  Raises OutputError."""
        sha256 = hashlib.sha256(data).hexdigest().encode()
        head = b'{"definitions":%d,"sha256":"%s","value":' % (DEFINITIONS, sha256)
        write_atomically(self._record(key), head + data + b"}\n", parents=True)

    def load(self, key: str, *, remove: bool = True) -> Any:
        """The value of a record; None if it is missing, damaged or of other ``DEFINITIONS``, so that it is made again.

        ``remove``: whether such a file is removed.
        """
        path = self._record(key)
        try:
            record = msgspec.json.decode(read_bytes(path, max_bytes=MAX_RECORD_BYTES), type=_Record)
            data = bytes(record.value)
            if hashlib.sha256(data).hexdigest() == record.sha256 and record.definitions == DEFINITIONS:
                return parse_json(data)
        except (OutputError, OSError, ValueError, RecursionError):  # damaged by a disk error: files appear complete
            pass
        if remove:
            path.unlink(missing_ok=True)
        return None

    def find(self, pattern: str, *, remove: bool = True) -> Iterator[Any]:
        """Values of the records whose keys match ``pattern``, in the order of the keys, as ``load`` reads them."""
        for path in sorted((self.out / RECORDS).glob(f"{pattern}.json")):
            value = self.load(path.relative_to(self.out / RECORDS).with_suffix("").as_posix(), remove=remove)
            if value is not None:
                yield value

    def _record(self, key: str) -> Path:
        return self.out / RECORDS / f"{key}.json"

    # -------------------------------------------------------------------------------------------------------- logs
    def log_file(self, job: str) -> Path:
        """The file that says why a job failed."""
        return self.out / LOGS / f"{job}.log"

    def log_failure(self, job: str, message: str, details: str) -> None:
        """Write why a job failed: ``message``, one line, and ``details`` below it."""
        write_atomically(self.log_file(job), f"{message}\n\n{details}".rstrip() + "\n", parents=True)

    def failure(self, job: str) -> str | None:
        """Why the job failed in its last attempt, in one line; None if it did not."""
        try:
            return read_text(self.log_file(job), links=False).partition("\n")[0]
        except OutputError:
            return None

    def write_json(self, path: Path, values: Mapping[str, Any]) -> None:
        """Write ``values`` to ``path``, whose folder is created.  Raises OutputError."""
        text = json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False)
        write_atomically(path, text + "\n", parents=True)


def _short(value: Any) -> str:
    """A JSON value for messages, at most 100 characters of it."""
    text = json.dumps(value)
    return text if len(text) <= 100 else f"{text[:100]}..."
