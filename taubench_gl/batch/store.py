"""The folder of a batch: its files, and the lock of the process that writes them.

    spec.json                     the jobs of the batch spec
    jobs/JOB/head.json            all that needs no rendering; camera poses of all frames
    jobs/JOB/pairs/*.parquet      finished pairs with their exact counts, one file per chunk
    jobs/JOB/summary.json, frames.csv    once all pairs are counted; as ``evaluate --out`` writes them
    jobs/JOB/provenance.json      worker, machine and times of each chunk
    logs/JOB.log                  why a job failed
    summary.json, frames.parquet, tables.*      of the whole batch

Only the driver writes here, and every file appears complete or not at all.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import platform
import shutil
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from taubench_gl import __version__
from taubench_gl.batch.partition import PairRecord, decode, require_pyarrow
from taubench_gl.batch.spec import BatchSpec, Job, with_differences
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.outputs import cannot_write, is_partial_of, write_atomically
from taubench_gl.settings import Settings

SPEC_SCHEMA = "taubench-gl/batch-spec/1"
SPEC_FILE = "spec.json"
LOCK_FILE = ".lock"
LOGS = "logs"
WRITTEN_FIRST = (LOCK_FILE, LOGS)
"""Files that exist before the spec does: all that a driver leaves if it is killed while it starts."""


class Store:
    """One batch's folder."""

    def __init__(self, out: str | Path):
        self.out = Path(out)

    def job(self, job: str) -> Path:
        return self.out / "jobs" / job

    def head_file(self, job: str) -> Path:
        return self.job(job) / "head.json"

    def pairs_folder(self, job: str) -> Path:
        return self.job(job) / "pairs"

    def log_file(self, job: str) -> Path:
        return self.out / LOGS / f"{job}.log"

    # ------------------------------------------------------------------------------------------------------- spec
    def require_usable(self) -> None:
        """Raise OutputError if the folder holds other files, or a batch of another version."""
        if (self.out / SPEC_FILE).exists():
            self._spec_values()
        elif self.out.is_dir() and any(not _written_first(p.name) for p in self.out.iterdir()):
            raise OutputError("holds other files and no batch", where=str(self.out), hint="give --out a new folder")

    def save_spec(self, spec: BatchSpec) -> None:
        """Store the jobs.  Folders of jobs that an earlier spec had stay and are no longer part of the batch."""
        jobs = [
            {"id": job.id, "scene": job.scene, "settings": job.settings.to_dict(), "sweep": dict(job.sweep)}
            for job in spec.jobs
        ]
        values = {"schema": SPEC_SCHEMA, "version": __version__, "name": spec.name, "jobs": jobs}
        self.write_json(self.out / SPEC_FILE, values)

    def load_spec(self) -> BatchSpec:
        """The spec that was last stored.  Raises OutputError if there is none."""
        values = self._spec_values()
        try:
            jobs = [Job(j["id"], j["scene"], Settings.from_dict(j["settings"]), j["sweep"]) for j in values["jobs"]]
            return BatchSpec(values["name"], with_differences(jobs))
        except (KeyError, TypeError, ValueError, SettingsError) as error:
            raise OutputError(f"is damaged: {error}", where=str(self.out / SPEC_FILE)) from None

    def _spec_values(self) -> dict[str, Any]:
        path = self.out / SPEC_FILE
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            what = "holds no batch" if self.out.is_dir() else "does not exist"
            raise OutputError(what, where=str(self.out), hint="give the folder of 'taubench-gl batch --out'") from None
        except NotADirectoryError:
            hint = "give the folder of 'taubench-gl batch --out'"
            raise OutputError("is not a folder", where=str(self.out), hint=hint) from None
        except OSError as error:
            raise OutputError(f"cannot be read: {error.strerror}", where=str(path)) from None
        except ValueError as error:
            raise OutputError(f"is damaged: {error}", where=str(path)) from None
        if not isinstance(values, dict):
            raise OutputError("is damaged: not a JSON object", where=str(path))
        schema, version = values.get("schema"), values.get("version")
        if schema != SPEC_SCHEMA or version != __version__:
            what = f"was started by taubench-gl {version} ({schema}), this is {__version__} ({SPEC_SCHEMA})"
            raise OutputError(what, where=str(path), hint="a batch does not mix versions: give a new --out")
        return values

    # ------------------------------------------------------------------------------------------------------- heads
    def load_head(self, job: Job) -> dict[str, Any] | None:
        """The job's head; None if it is missing or the scene may have changed since."""
        values = self.known_head(job.id)
        return values if values is not None and values.get("file") == file_stamp(job.scene) is not None else None

    def known_head(self, job: str) -> dict[str, Any] | None:
        """The stored head, even if the scene has changed since; None if there is none."""
        try:
            values = json.loads(self.head_file(job).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return values if isinstance(values, dict) else None

    def save_head(self, job: Job, data: bytes, stamp: list[int] | None) -> dict[str, Any]:
        """Store a head.  Removes the pairs of the job if the scene has changed since they were counted.

        ``stamp``: ``file_stamp`` of the scene before it was read, so that a later change is detected.
        """
        values = json.loads(data)
        values["file"] = stamp if values.get("one_file", True) else None
        before = self.known_head(job.id)
        if before is None or any(before.get(key) != values.get(key) for key in ("facts", "frames", "lighting")):
            self.remove(job.id)
        self.write_json(self.head_file(job.id), values, indent=None)
        return values

    def remove(self, job: str) -> None:
        """Remove all files of one job except its log."""
        if self.job(job).exists():
            shutil.rmtree(self.job(job))

    # ------------------------------------------------------------------------------------------------------- pairs
    def save_pairs(self, job: str, positions: Sequence[int], data: bytes) -> None:
        name = f"pairs-{positions[0]:06d}-{positions[-1]:06d}.parquet" if positions else "pairs-none.parquet"
        write_atomically(self.pairs_folder(job) / name, data, parents=True)

    def load_pairs(self, job: Job) -> tuple[dict[int, PairRecord], list[dict[str, Any]]]:
        """All counted pairs by position, and the workers' reports, in the order of the file names.

        A file that cannot be read (a disk error: files appear complete) is removed, and its pairs are counted again.
        """
        records: dict[int, PairRecord] = {}
        reports: list[dict[str, Any]] = []
        for path in sorted(self.pairs_folder(job.id).glob("*.parquet")):
            try:
                found, report = decode(path.read_bytes())
            except (ValueError, OSError):
                path.unlink(missing_ok=True)
                continue
            reports.append(report | {"pairs": [record.row["frame"] for record in found]})
            for record in found:
                records.setdefault(record.position, record)
        return records, reports

    def known_positions(self, job: str) -> list[int]:
        """Positions of the counted pairs.  Reads one column and changes nothing: a driver may be running."""
        parquet = require_pyarrow().parquet
        out: list[int] = []
        for path in sorted(self.pairs_folder(job).glob("*.parquet")):
            with contextlib.suppress(OSError, ValueError):  # ArrowInvalid is a ValueError
                out += parquet.read_table(path, columns=["pair"])["pair"].to_pylist()
        return out

    # -------------------------------------------------------------------------------------------------------- logs
    def log_failure(self, job: str, message: str, details: str) -> Path:
        path = self.log_file(job)
        write_atomically(path, f"{message}\n\n{details}".rstrip() + "\n", parents=True)
        return path

    def failure(self, job: str) -> str | None:
        """Why the job failed in its last attempt, in one line; None if it did not."""
        try:
            return self.log_file(job).read_text(encoding="utf-8").partition("\n")[0]
        except OSError:
            return None

    def clear_failure(self, job: str) -> None:
        self.log_file(job).unlink(missing_ok=True)

    # ----------------------------------------------------------------------------------------------------- writing
    def write_json(self, path: Path, values: Mapping[str, Any], indent: int | None = 2) -> None:
        text = json.dumps(values, indent=indent, ensure_ascii=False, allow_nan=False)
        write_atomically(path, text + "\n", parents=True)


def _written_first(name: str) -> bool:
    """Whether a driver that is killed while it starts may leave this file, a partial spec included."""
    return name in WRITTEN_FIRST or is_partial_of(Path(SPEC_FILE), Path(name))


def file_stamp(scene: str) -> list[int] | None:
    """Size and modification time of a .glb file; None for other formats.

    Other formats may consist of several files.  Their head is recomputed whenever a batch continues, because only
    reading all files shows whether they have changed.
    """
    if not scene.lower().endswith(".glb"):
        return None
    try:
        found = os.stat(scene)
    except OSError:
        return None
    return [found.st_size, found.st_mtime_ns]


LOCK_ATTEMPTS = 8
"""``lock_holder`` takes a shared lock for a moment; a driver that starts then must not report another driver."""


class FolderLock:
    """A lock held by the running driver.  The system releases it when the process ends, so no lock is ever stale.

    The file names the holder, which is valid only while the lock is held.
    """

    def __init__(self, out: Path):
        self.path = out / LOCK_FILE
        self._file: IO[str] | None = None

    def __enter__(self) -> FolderLock:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open(self.path, "a+", encoding="utf-8")
        except (FileExistsError, NotADirectoryError):
            raise OutputError("is not a folder", where=str(self.path.parent), hint="give --out another name") from None
        except OSError as error:
            raise cannot_write(self.path, error) from None
        for attempt in range(LOCK_ATTEMPTS):
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError:
                who = lock_holder(self.path.parent)
                if who is None and attempt < LOCK_ATTEMPTS - 1:
                    continue  # the other process only asked for the holder
                self._file.close()
                hint = "wait for it, or give --out another folder"
                what = f"{who or 'another process'} is running a batch here"
                raise OutputError(what, where=str(self.path.parent), hint=hint) from None
        self._file.truncate(0)
        self._file.write(json.dumps({"pid": os.getpid(), "host": platform.node(), "since": time.time()}))
        self._file.flush()
        return self

    def __exit__(self, *exc: object) -> None:
        if self._file is not None:
            self._file.truncate(0)
            self._file.close()
            self._file = None


def lock_holder(out: Path) -> str | None:
    """The process that runs the batch in ``out`` now, in words; None if there is none."""
    try:
        with open(out / LOCK_FILE, encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                try:
                    holder = json.loads(file.read())
                    return f"process {holder['pid']} on {holder['host']}"
                except (ValueError, KeyError):
                    return "another process"
    except OSError:
        return None
    return None
