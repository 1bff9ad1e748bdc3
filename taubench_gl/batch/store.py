"""The folder of a batch: where everything lies, and what of it is whole.

    study.json                    the jobs, as the study asked for them
    jobs/JOB/head.json            what the scene says; cameras of all frames
    jobs/JOB/pairs/*.parquet      finished pairs with their exact counts, one file per chunk
    jobs/JOB/summary.json, frames.csv    once all pairs are there: as ``evaluate --out`` writes them
    jobs/JOB/provenance.json      who computed which pairs, and how fast
    logs/JOB.log                  why a job failed
    summary.json, frames.parquet, tables.*      of the whole study

Only the driver writes here, every file whole or not at all, so whatever is there can be believed.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taubench_gl import __version__
from taubench_gl.batch.lock import LOCK_FILE
from taubench_gl.batch.partition import PairRecord, decode, require_pyarrow
from taubench_gl.batch.study import Job, Study, set_apart
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.outputs import is_partial_of, write_atomically
from taubench_gl.settings import Settings

STUDY_SCHEMA = "taubench-gl/batch-study/1"
STUDY_FILE = "study.json"
LOGS = "logs"
BEGUN = (LOCK_FILE, LOGS)
"""What is there before the study is: workers may be killed while they start."""


class Store:
    """One batch's folder."""

    def __init__(self, out: str | Path):
        self.out = Path(out)

    # ----------------------------------------------------------------------------------------------------- places
    def job(self, job: str) -> Path:
        return self.out / "jobs" / job

    def head_file(self, job: str) -> Path:
        return self.job(job) / "head.json"

    def pairs_folder(self, job: str) -> Path:
        return self.job(job) / "pairs"

    def log_file(self, job: str) -> Path:
        return self.out / LOGS / f"{job}.log"

    # ------------------------------------------------------------------------------------------------------ study
    def require_ours(self) -> None:
        """Raise OutputError where the folder holds anything but a batch of this version; a new one may be made."""
        if (self.out / STUDY_FILE).exists():
            self._study_values()
        elif self.out.is_dir() and any(not _begun(p.name) for p in self.out.iterdir()):
            raise OutputError("holds other files and no batch", where=str(self.out), hint="give --out a new folder")

    def save_study(self, study: Study) -> None:
        """Remember the jobs.  Folders of jobs that an earlier study had are left alone and no longer counted."""
        jobs = [
            {"id": job.id, "scene": job.scene, "settings": job.settings.to_dict(), "sweep": dict(job.sweep)}
            for job in study.jobs
        ]
        values = {"schema": STUDY_SCHEMA, "version": __version__, "name": study.name, "jobs": jobs}
        self.write_json(self.out / STUDY_FILE, values)

    def load_study(self) -> Study:
        """The study this folder was last given.  Raises OutputError where there is none."""
        values = self._study_values()
        try:
            jobs = [Job(j["id"], j["scene"], Settings.from_dict(j["settings"]), j["sweep"]) for j in values["jobs"]]
            return Study(values["name"], set_apart(jobs))
        except (KeyError, TypeError, ValueError, SettingsError) as error:
            raise OutputError(f"is damaged: {error}", where=str(self.out / STUDY_FILE)) from None

    def _study_values(self) -> dict[str, Any]:
        path = self.out / STUDY_FILE
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
            raise OutputError("is damaged: no JSON object", where=str(path))
        schema, version = values.get("schema"), values.get("version")
        if schema != STUDY_SCHEMA or version != __version__:
            what = f"was begun by taubench-gl {version} ({schema}), this is {__version__} ({STUDY_SCHEMA})"
            raise OutputError(what, where=str(path), hint="numbers of two versions are not mixed: give a new --out")
        return values

    # ------------------------------------------------------------------------------------------------------- heads
    def load_head(self, job: Job) -> dict[str, Any] | None:
        """The job's head; None where it is missing or the scene may no longer be the one it was made of."""
        values = self.known_head(job.id)
        return values if values is not None and values.get("file") == file_stamp(job.scene) is not None else None

    def known_head(self, job: str) -> dict[str, Any] | None:
        """The head as it was left, whatever became of the scene since; None where there is none."""
        try:
            values = json.loads(self.head_file(job).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return values if isinstance(values, dict) else None

    def save_head(self, job: Job, data: bytes, stamp: list[int] | None) -> dict[str, Any]:
        """Keep a head.  Pairs of a scene that has changed since are of no more use and go.

        ``stamp``: of the scene's file (``file_stamp``) before it was read, so that a change meanwhile is noticed.
        """
        values = json.loads(data)
        values["file"] = stamp if values.get("one_file", True) else None
        before = self.known_head(job.id)
        if before is None or before["facts"] != values["facts"] or before["frames"] != values["frames"]:
            self.forget(job.id)
        self.write_json(self.head_file(job.id), values, indent=None)
        return values

    def forget(self, job: str) -> None:
        """Remove everything of one job but its log."""
        if self.job(job).exists():
            shutil.rmtree(self.job(job))

    # ------------------------------------------------------------------------------------------------------- pairs
    def save_pairs(self, job: str, positions: Sequence[int], data: bytes) -> None:
        name = f"pairs-{positions[0]:06d}-{positions[-1]:06d}.parquet" if positions else "pairs-none.parquet"
        write_atomically(self.pairs_folder(job) / name, data, parents=True)

    def load_pairs(self, job: Job) -> tuple[dict[int, PairRecord], list[dict[str, Any]]]:
        """All finished pairs by position, and what the workers told, in the order of the files' names.

        A file that cannot be read (a disk's fault: files appear whole) is removed, its pairs are to be done again.
        """
        records: dict[int, PairRecord] = {}
        told: list[dict[str, Any]] = []
        for path in sorted(self.pairs_folder(job.id).glob("*.parquet")):
            try:
                found, said = decode(path.read_bytes())
            except (ValueError, OSError):
                path.unlink(missing_ok=True)
                continue
            told.append(said | {"pairs": [record.row["frame"] for record in found]})
            for record in found:
                records.setdefault(record.position, record)
        return records, told

    def known_positions(self, job: str) -> list[int]:
        """Positions of the pairs that are there.  Reads one column and changes nothing: a driver may be at work."""
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
        """Why the job failed when it was last tried, in one line."""
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


def _begun(name: str) -> bool:
    """Whether a start that was killed leaves it: also the file that the study was being written to."""
    return name in BEGUN or is_partial_of(Path(STUDY_FILE), Path(name))


def file_stamp(scene: str) -> list[int] | None:
    """Size and time of change of a scene that is all in one file; None for others (.gltf with its buffers, OBJ, ...),
    whose head is made anew whenever a study goes on: only reading them tells whether they have changed."""
    if not scene.lower().endswith(".glb"):
        return None
    try:
        found = os.stat(scene)
    except OSError:
        return None
    return [found.st_size, found.st_mtime_ns]
