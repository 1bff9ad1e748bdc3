"""Merges the pairs of a job into its summary and frames.csv, with the sums of ``evaluate`` in the order of the pairs,
and the jobs of a batch into its tables.

The result does not depend on which worker or chunk counted a pair: equal pairs give equal files, bit for bit.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation.state import View
from taubench_gl.batch.spec import BatchSpec, Job
from taubench_gl.batch.units import counts_of_record, head_hash, lobes_of_record
from taubench_gl.data_files import read_json
from taubench_gl.errors import OutputError
from taubench_gl.evaluation import light_plan, sampled_pairs
from taubench_gl.evaluation.lobes import missing_of_scene
from taubench_gl.evaluation.session import frame_columns
from taubench_gl.evaluation.summary import mark_cuts
from taubench_gl.evaluation.tally import Tally
from taubench_gl.outputs import plain_text, write_atomically
from taubench_gl.provenance import combined
from taubench_gl.report import run_tables
from taubench_gl.report.table import write_tables as write_table_files
from taubench_gl.run import SUMMARY_FILE, Run, RunWriter, load_run
from taubench_gl.run_schema import (
    CAMERA_COLUMNS,
    COUNT_COLUMNS,
    DECIDED_COLUMNS,
    EXACT_COLUMNS,
    OTHER_COLUMNS,
    SAMPLED_COLUMNS,
)
from taubench_gl.scene.model import Camera
from taubench_gl.study.store import Store

SCHEMA = "taubench-gl/batch/4"
IN_PROVENANCE = "depends on machine, engine and chunks: see provenance.json"
PROVENANCE_FILE = "provenance.json"
WORKERS = ("version", "backend", "renderer", "driver", "git", "python", "machine")
"""Entries of the provenance of a job, which combine those of all its workers."""


def require_pyarrow() -> Any:
    """pyarrow with its Parquet module.  Raises OutputError if it is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        hint = "pip install 'taubench-gl[batch]'"
        raise OutputError("a batch writes a Parquet file, which requires pyarrow", hint=hint) from None
    return pyarrow


def job_folder(store: Store, job: str) -> Path:
    """Folder of the results of a job."""
    return store.out / "jobs" / job


def job_positions(job: Job, head: Mapping[str, Any]) -> tuple[int, ...]:
    """Positions of the pairs that a job evaluates, ascending."""
    return sampled_pairs(range(*head["frames"]), job.settings).positions


def tally_job(
    job: Job, head: Mapping[str, Any], reports: Sequence[Mapping[str, Any]], pairs: Mapping[int, Mapping[str, Any]]
) -> Tally:
    """The tally of a job, all of whose pairs are counted, before the first round of its sampled light.

    ``reports``: of the workers, one per chunk; ``pairs``: records by position.
    """
    frames, settings, report, views = range(*head["frames"]), job.settings, reports[0], _views(head)
    unmeasured = report["unmeasured"]
    missing = missing_of_scene(job.lobes, unmeasured, report["source"]["effects"], settings)
    light = light_plan(settings, sampled=True)
    tally = Tally(settings, frames, light, unmeasured, report["reprojection"], report["other"], missing)
    for position in job_positions(job, head):
        record, camera_path = pairs[position], (views[position], views[position + 1])
        counts, lobes = counts_of_record(record), lobes_of_record(record)
        tally.add(frames[position + 1], counts, camera_path, lobes, dict(record["added"]))
    for report in reports:
        tally.brightness.add(report["brightness"])
        tally.depths += report["depths"]
    return tally


def merge_job(head: Mapping[str, Any], tally: Tally, reports: Sequence[Mapping[str, Any]]) -> Run:
    """The Run of a job after the last round of its sampled light, as ``Session.summary`` and ``finish_run`` make it.

    What depends on machine, engine and chunks is left to provenance.json.  ``reports``: of the workers, one per chunk.
    """
    source = reports[0]["source"] | {"memory": {"gpu_bytes": None, "reason": IN_PROVENANCE}}
    summary = tally.summary(head["facts"], _views(head), source)
    summary["timing"] = {"clock": None, "unit": "ms", "passes": {}, "reason": IN_PROVENANCE}
    workers = combined([report["provenance"] for report in reports], WORKERS)
    summary["provenance"] = workers | {"command": None, "clock": None, "reason": IN_PROVENANCE}
    mark_cuts(tally.rows, summary)
    return Run(summary, tally.rows)


def _views(head: Mapping[str, Any]) -> list[View]:
    """Position and direction of the camera in every frame, all that camera activity depends on."""
    lens = Camera()
    return [View(np.array(p), np.array(r), lens) for p, r in zip(head["positions"], head["rotations"], strict=True)]


def write_job(
    store: Store, job: Job, head: Mapping[str, Any], run: Run, reports: Sequence[Mapping[str, Any]], sampled: bool
) -> None:
    """Write summary.json and frames.csv as ``evaluate`` does, and provenance.json beside them.

    ``reports``: one per chunk; ``sampled``: whether the job has sampled light, which adds columns.
    """
    frames = range(*head["frames"])
    chunks = [
        {"pairs": [frames[report["positions"][i] + 1] for i in (0, -1) if report["positions"]], **report["provenance"],
         "passes_ms": report["passes_ms"], "gpu_bytes": report["source"]["memory"]["gpu_bytes"]}
        for report in reports
    ]  # fmt: skip
    folder = job_folder(store, job.id)
    store.write_json(folder / PROVENANCE_FILE, {"job": job.id, "head": head_hash(head), "chunks": chunks})
    with RunWriter(folder, frame_columns(reports[0]["added"], sampled)) as writer:
        writer.rewrite_rows(run.frames)
        writer.write_summary(run.summary)


def is_written(store: Store, job: Job, head: Mapping[str, Any]) -> bool:
    """Whether the files of a job are there, undamaged and made with this head; removes its summary.json if not.

    A job that is not written is written again.  Files appear complete; a disk error or another program can damage them
    afterwards.
    """
    folder, frames = job_folder(store, job.id), range(*head["frames"])
    try:
        same_head = read_json(folder / PROVENANCE_FILE, dict[str, Any]).get("head") == head_hash(head)
        rows = load_run(folder).frames
        if same_head and [row.get("frame") for row in rows] == [frames[p + 1] for p in job_positions(job, head)]:
            return True
    except OutputError:
        pass
    (folder / SUMMARY_FILE).unlink(missing_ok=True)
    return False


def write_batch(store: Store, spec: BatchSpec, failed: Mapping[str, str]) -> dict[str, Any]:
    """Write summary.json, frames.parquet and tables of the whole batch.  -> the values of summary.json.

    ``failed``: job -> why it failed.
    """
    jobs, frames, summaries = [], [], []
    for job in spec.jobs:
        entry: dict[str, Any] = {"id": job.id, "scene": job.scene, "sweep": dict(job.sweep)}
        if job.id in failed:
            jobs.append(entry | {"state": "failed", "reason": failed[job.id], "log": f"logs/{job.id}.log"})
            continue
        run = load_run(job_folder(store, job.id))
        summaries.append(labelled(job, run.summary))
        frames.append((job.id, run.summary["scene"]["name"], job.sweep, run.frames))
        kept = ("reusable", "pairs", "camera", "discard")
        entry |= {"state": "done", "summary": f"jobs/{job.id}/summary.json"}
        jobs.append(entry | {name: run.summary[name] for name in kept})
    summary = {"schema": SCHEMA, "name": spec.name, "done": len(summaries), "failed": len(failed), "jobs": jobs}
    write_atomically(store.out / "frames.parquet", frames_table(frames))
    write_tables(store, summaries)
    store.write_json(store.out / "summary.json", summary)
    return summary


def labelled(job: Job, summary: Mapping[str, Any]) -> dict[str, Any]:
    """A summary whose scene name includes the settings that distinguish the job, for tables of several jobs."""
    return dict(summary) | {"scene": summary["scene"] | {"name": job.labelled(summary["scene"]["name"])}}


def write_tables(store: Store, summaries: Sequence[Mapping[str, Any]]) -> list[Any]:
    """Write tables.txt, .md, .csv and .tex of these runs.  -> the tables."""
    tables = run_tables(list(summaries)) if summaries else []
    if tables:
        write_table_files(store.out, tables)
    return tables


def frames_table(jobs: Iterable[tuple[str, str, Mapping[str, Any], Sequence[Mapping[str, Any]]]]) -> bytes:
    """A Parquet file of all pairs of all jobs: ``job``, ``scene``, swept settings (as text), and frames.csv.

    ``jobs``: id, name of the scene, swept settings and rows of each.  A count that is not measured is null.
    """
    pa = require_pyarrow()
    jobs = list(jobs)
    swept = list(dict.fromkeys(key for _, _, sweep, _ in jobs for key in sweep))
    every = [row for *_, rows in jobs for row in rows]
    groups = (EXACT_COLUMNS, DECIDED_COLUMNS, SAMPLED_COLUMNS)
    added = [name for group in groups for name in group if any(row.get(group[0]) is not None for row in every)]
    fields = dict.fromkeys(("job", "scene", *(f"sweep_{key}" for key in swept)), pa.string())
    fields |= {
        "frame": pa.int64(),
        "time_s": pa.float64(),
        **dict.fromkeys((*COUNT_COLUMNS, *OTHER_COLUMNS, *added), pa.int64()),
    }
    fields |= {**dict.fromkeys(CAMERA_COLUMNS, pa.float64()), "gimbal": pa.bool_(), "camera_cut": pa.bool_()}
    columns: dict[str, list[Any]] = {name: [] for name in fields}
    for job, scene, sweep, rows in jobs:
        text = {"job": job, "scene": _text(scene)} | {f"sweep_{key}": _text(sweep.get(key)) for key in swept}
        for row in rows:
            values = dict.fromkeys(added) | dict(row) | text
            for name, kind in fields.items():
                columns[name].append(bool(values[name]) if kind == pa.bool_() else values[name])
    table = pa.table({name: pa.array(columns[name], type=kind) for name, kind in fields.items()})
    sink = io.BytesIO()
    pa.parquet.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def _text(value: Any) -> str | None:
    """A swept setting, or a name that may not be UTF-8, as text; None for a setting that a job does not sweep."""
    if value is None:
        return None
    return plain_text(value) if isinstance(value, str) else json.dumps(value)
