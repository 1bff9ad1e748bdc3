"""The folder of a batch and its files.

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
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec

from taubench_gl import __version__
from taubench_gl.batch.partition import PairRecord, decode, require_pyarrow
from taubench_gl.batch.spec import BatchSpec, Job, with_differences
from taubench_gl.checksums import with_checksums, without_checksums
from taubench_gl.data_files import checked, opened, read_bytes, read_json, read_text
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.folder_lock import LOCK_FILE
from taubench_gl.outputs import is_partial_of, write_atomically
from taubench_gl.settings import Settings

SPEC_SCHEMA = "taubench-gl/batch-spec/1"
SPEC_FILE = "spec.json"
LOGS = "logs"
WRITTEN_FIRST = (LOCK_FILE, LOGS)
"""Files that exist before the spec does: all that a driver leaves if it is killed while it starts."""


MAX_HEAD_BYTES = 1 << 30
"""Size limit of a head: it holds the camera poses of all frames."""


class _Job(msgspec.Struct):
    id: Annotated[str, msgspec.Meta(pattern=r"^[^/\0]+$", max_length=255)]
    scene: str
    settings: dict[str, Any]
    sweep: dict[str, Any]
    lobes: list[str] = []


class _Spec(msgspec.Struct):
    name: str
    jobs: list[_Job]


class _Head(msgspec.Struct):
    frames: tuple[int, int]
    facts: dict[str, Any]
    lighting: dict[str, Any] = {}
    positions: list[tuple[float, float, float]] = []
    rotations: list[Any] = []


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
            | ({"lobes": list(job.lobes)} if job.lobes else {})
            for job in spec.jobs
        ]
        values = {"schema": SPEC_SCHEMA, "version": __version__, "name": spec.name, "jobs": jobs}
        self.write_json(self.out / SPEC_FILE, values)

    def load_spec(self) -> BatchSpec:
        """The spec that was last stored.  Raises OutputError if there is none."""
        values = self._spec_values()
        try:
            checked(values, _Spec)
            jobs = [
                Job(j["id"], j["scene"], Settings.from_dict(j["settings"]), j["sweep"], lobes=tuple(j.get("lobes", ())))
                for j in values["jobs"]
            ]
            return BatchSpec(values["name"], with_differences(jobs))
        except (msgspec.ValidationError, SettingsError) as error:
            raise OutputError(f"is damaged: {error}", where=str(self.out / SPEC_FILE)) from None

    def _spec_values(self) -> dict[str, Any]:
        path = self.out / SPEC_FILE
        if not path.exists():
            what = "holds no batch" if self.out.is_dir() else "is not a folder"
            what = what if self.out.exists() else "does not exist"
            raise OutputError(what, where=str(self.out), hint="give the folder of 'taubench-gl batch --out'")
        values = read_json(path, dict[str, Any])
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
            path = self.head_file(job)
            return without_checksums(read_json(path, _Head, max_bytes=MAX_HEAD_BYTES), path)[0]
        except OutputError:  # missing, or damaged by a disk error: it is computed again
            return None

    def save_head(self, job: Job, data: bytes, stamp: list[int] | None) -> dict[str, Any]:
        """Store a head.  Removes the pairs of the job if the scene has changed since they were counted.

        ``stamp``: ``file_stamp`` of the scene before it was read, so that a later change is detected.
        """
        values = json.loads(data)
        values["file"] = stamp if values.get("one_file", True) else None
        before = self.known_head(job.id)
        if before is None or any(before.get(key) != values.get(key) for key in ("facts", "frames", "lighting")):
            self.remove(job.id)
        self.write_json(self.head_file(job.id), with_checksums(values), indent=None)
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
                found, report = decode(read_bytes(path, max_bytes=MAX_HEAD_BYTES))
            except (ValueError, OSError, OutputError):
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
            with (
                contextlib.suppress(OSError, ValueError, OutputError),
                opened(path) as file,
            ):  # ArrowInvalid: ValueError
                out += parquet.read_table(file, columns=["pair"])["pair"].to_pylist()
        return out

    # -------------------------------------------------------------------------------------------------------- logs
    def log_failure(self, job: str, message: str, details: str) -> Path:
        path = self.log_file(job)
        write_atomically(path, f"{message}\n\n{details}".rstrip() + "\n", parents=True)
        return path

    def failure(self, job: str) -> str | None:
        """Why the job failed in its last attempt, in one line; None if it did not."""
        try:
            return read_text(self.log_file(job), links=False).partition("\n")[0]
        except OutputError:
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
