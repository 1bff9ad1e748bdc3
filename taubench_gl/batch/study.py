"""A batch as a study: every job has a head, then its pairs in chunks; and the state and the tables of a batch.

study.json                              the jobs of the batch spec
records/JOB/*.json                      heads and finished pairs (``units``)
jobs/JOB/summary.json, frames.csv       once all pairs are counted; as ``evaluate --out`` writes them
jobs/JOB/provenance.json                worker, machine and times of each chunk
logs/JOB.log                            why a job failed
summary.json, frames.parquet, tables.*  of the whole batch
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec

from taubench_gl.batch.merge import (
    is_written,
    job_folder,
    job_positions,
    labelled,
    merge_job,
    require_pyarrow,
    tally_job,
    write_batch,
    write_job,
    write_tables,
)
from taubench_gl.batch.spec import BatchSpec, Job, with_differences
from taubench_gl.batch.units import head_key, head_unit, light_key, light_unit, pairs_key, pairs_unit, resolved_job
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation.tally import Tally
from taubench_gl.folder_lock import lock_holder
from taubench_gl.metrics.sampled_light import Visit
from taubench_gl.run import SUMMARY_FILE, load_run
from taubench_gl.settings import Settings
from taubench_gl.study.driver import run_study
from taubench_gl.study.progress import Listener
from taubench_gl.study.store import STUDY_FILE, Store
from taubench_gl.study.study import Study
from taubench_gl.study.unit import Unit

SCHEMA = "taubench-gl/batch-study/1"

CHUNK_PAIRS = 32
"""Largest chunk: the pairs per worker that a killed driver loses.  A chunk renders one frame more than its pairs."""

MIN_CHUNK_PAIRS = 4


class _Job(msgspec.Struct):
    """What study.json stores of a job: a scene with settings, of which ``sweep`` are the swept ones."""

    id: Annotated[str, msgspec.Meta(pattern=r"^[^/\0]+$", max_length=255)]
    scene: str
    settings: dict[str, Any]
    sweep: dict[str, Any]
    lobes: list[str] = []


class _About(msgspec.Struct):
    """The keys of study.json that a batch adds."""

    name: str
    jobs: list[_Job]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a batch ends with: its summary.json, and the jobs that ``failed``: job id -> reason."""

    summary: dict[str, Any]
    failed: dict[str, str]


class BatchStudy(Study):
    """The jobs of a batch in a folder."""

    def __init__(self, spec: BatchSpec, store: Store, chunk: int | None = None):
        """A batch in ``store``; ``chunk``: pairs per unit, which change no result, None: by the number of workers."""
        if chunk is not None and chunk < 1:
            raise SettingsError(f"chunk is {chunk}", hint="give 1 pair or more")
        if any(job.settings.lighting.light_time is not None for job in spec.jobs):
            what = "light_time makes results depend on the machine, those of a batch do not"
            raise SettingsError(what, hint="leave it out, or give a larger light_within", setting="light_time")
        super().__init__(store)
        self.spec, self._chunk = spec, chunk
        self._jobs = {job.id: job for job in spec.jobs}
        self._tallies: dict[str, Tally] = {}  # of the jobs whose pairs are all counted
        self._heads: dict[str, dict[str, Any] | None] = {}  # of jobs that were asked for; None: not yet there

    def jobs(self) -> Mapping[str, str]:
        return {job.id: job.label for job in self.spec.jobs}

    def missing(self, job: str, width: int) -> tuple[Sequence[Unit], int]:
        head = self._head(job)
        if head is None:
            return [head_unit(self._jobs[job], file_stamp(self._jobs[job].scene))], 0
        resolved = resolved_job(self._jobs[job], head)
        positions = job_positions(resolved, head)
        if is_written(self.store, resolved, head):
            return [], len(positions)
        reports, pairs = stored_pairs(self.store, job, head)
        left = [position for position in positions if position not in pairs]
        # At least two chunks per worker if the job has that many pairs: it may be the only job left.
        automatic = min(CHUNK_PAIRS, max(MIN_CHUNK_PAIRS, math.ceil(len(positions) / (2 * width))))
        size = self._chunk or automatic
        chunks = [tuple(left[i : i + size]) for i in range(0, len(left), size)]
        if not positions and not reports:
            chunks = [()]
        if not chunks:
            return self._missing_light(resolved, head, reports, pairs), len(positions)
        return [pairs_unit(resolved, chunk, head) for chunk in chunks], len(positions)

    def _missing_light(self, job: Job, head: Mapping[str, Any], reports: Any, pairs: Any) -> Sequence[Unit]:
        """Visits of the next round of sampled light that have no record."""
        if job.id not in self._tallies:
            self._tallies[job.id] = tally_job(job, head, reports, pairs)
        light = self._tallies[job.id].sampled
        while light is not None and not light.done:
            wanted = light.next_round()
            records = [self.store.load(light_key(job.id, visit, head)) for visit in wanted]
            missing = [visit for visit, record in zip(wanted, records, strict=True) if record is None]
            if missing:
                return [light_unit(job, visit, head) for visit in missing]
            light.add_round([Visit.of_record(record) for record in records])
        return []

    def finish(self, job: str) -> None:
        head = self._heads[job]
        resolved = resolved_job(self._jobs[job], head)
        if not is_written(self.store, resolved, head):
            reports, tally = stored_pairs(self.store, job, head)[0], self._tallies[job]
            run = merge_job(head, tally, reports)
            write_job(self.store, resolved, head, run, reports, tally.sampled is not None)
        self._tallies.pop(job, None)  # its rows are in the files

    def merge(self) -> Outcome:
        return Outcome(write_batch(self.store, self.spec, self.failed), self.failed)

    def _head(self, job: str) -> dict[str, Any] | None:
        """The job's head; None if it is missing, or made before the scene may have changed."""
        if job not in self._heads:
            self.store.log_file(job).unlink(missing_ok=True)
            head, stamp = self.store.load(head_key(job)), file_stamp(self._jobs[job].scene)
            self._heads[job] = head if head is not None and head["stamp"] == stamp is not None else None
        elif self._heads[job] is None:  # its unit is done
            self._heads[job] = self.store.load(head_key(job))
        return self._heads[job]


def stored_pairs(
    store: Store, job: str, head: Mapping[str, Any], *, remove: bool = True
) -> tuple[list[dict[str, Any]], dict[int, dict[str, Any]]]:
    """Reports of the workers in the order of the pairs, and the counted pairs by position.

    ``remove``: whether damaged records are removed, whose pairs are then counted again.
    """
    reports: list[dict[str, Any]] = []
    pairs: dict[int, dict[str, Any]] = {}
    for record in store.find(pairs_key(job, "*", head), remove=remove):
        reports.append(record["report"] | {"positions": [pair["position"] for pair in record["pairs"]]})
        for pair in record["pairs"]:
            pairs.setdefault(pair["position"], pair)
    return reports, pairs


def file_stamp(scene: str) -> list[int] | None:
    """Size and modification time of a .glb file; None for other formats.

    Other formats may consist of several files.  Their head is recomputed whenever a batch continues, because only
    reading all files shows whether they have changed.
    """
    if not scene.lower().endswith(".glb"):
        return None
    try:
        state = os.stat(scene)
    except OSError:
        return None
    return [state.st_size, state.st_mtime_ns]


def batch_store(out: str | Path) -> Store:
    """The study folder ``out`` as the store of a batch."""
    return Store(out, "batch", SCHEMA)


def about_batch(spec: BatchSpec) -> dict[str, Any]:
    """The jobs of a batch as study.json has them."""
    jobs = [_Job(j.id, j.scene, j.settings.to_dict(), dict(j.sweep), list(j.lobes)) for j in spec.jobs]
    return msgspec.to_builtins(_About(spec.name, jobs))


def stored_spec(store: Store) -> BatchSpec:
    """The jobs that study.json holds.  Raises OutputError if there is none, or a damaged one."""
    values = store.about()
    try:
        about = msgspec.convert(values, _About)
        jobs = [Job(j.id, j.scene, Settings.from_dict(j.settings), j.sweep, {}, tuple(j.lobes)) for j in about.jobs]
        return BatchSpec(about.name, with_differences(jobs))
    except (msgspec.ValidationError, SettingsError) as error:
        raise OutputError(f"is damaged: {error}", where=str(store.out / STUDY_FILE)) from None


def run_batch(
    spec: BatchSpec | None,
    out: str | Path,
    *,
    workers: int = 0,
    chunk: int | None = None,
    listener: Listener | None = None,
) -> Outcome:
    """Run what is missing of ``spec`` in the folder ``out``; None: of the spec that is stored there.

    ``workers``: as of ``run_study``; results do not depend on it, or on ``chunk``.  Scenes that fail are
    listed in the outcome.  Raises TaubenchError.
    """
    require_pyarrow()
    store = batch_store(out)
    study = BatchStudy(spec or stored_spec(store), store, chunk)
    return run_study(study, about_batch(study.spec), workers=workers, listener=listener)


@dataclass(frozen=True, slots=True)
class JobStatus:
    """The state of one job (waiting, part, done or failed) and its pairs; ``total`` None: not known yet."""

    id: str
    label: str
    state: str
    done: int
    total: int | None
    reason: str | None


def batch_status(out: str | Path) -> tuple[str, str | None, list[JobStatus]]:
    """Name of the batch, the process that runs it now (None: no process), and the state of each job.

    Changes nothing: a driver may be running.
    """
    store = batch_store(out)
    spec = stored_spec(store)
    states = []
    for job in spec.jobs:
        head, reason = store.load(head_key(job.id), remove=False), store.failure(job.id)
        positions = () if head is None else job_positions(resolved_job(job, head), head)
        done = 0 if head is None else len(stored_pairs(store, job.id, head, remove=False)[1])
        state = "part" if done else "waiting"
        if reason is not None:
            state = "failed"
        elif head is not None and (job_folder(store, job.id) / SUMMARY_FILE).is_file():
            state, done = "done", len(positions)
        states.append(JobStatus(job.id, job.label, state, done, None if head is None else len(positions), reason))
    return spec.name, lock_holder(store.out), states


def batch_report(out: str | Path) -> tuple[list[Any], list[str]]:
    """Write the tables of all finished jobs; returns the tables, and the labels of jobs that are not finished."""
    store = batch_store(out)
    summaries, missing = [], []
    for job in stored_spec(store).jobs:
        if (job_folder(store, job.id) / SUMMARY_FILE).is_file():
            summaries.append(labelled(job, load_run(job_folder(store, job.id)).summary))
        else:
            missing.append(job.label)
    if not summaries:
        raise OutputError("no job is finished yet", where=str(store.out), hint="taubench-gl batch status, or resume")
    return write_tables(store, summaries), missing
