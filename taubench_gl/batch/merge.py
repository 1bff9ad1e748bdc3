"""Merges the pairs of a job into its summary and frames.csv, with the sums of ``evaluate`` in the order of the pairs.

The result does not depend on which worker or chunk counted a pair: equal pairs give equal files, bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.animation.state import View
from taubench_gl.batch.partition import PairRecord, frames_table
from taubench_gl.batch.spec import BatchSpec, Job
from taubench_gl.batch.store import Store
from taubench_gl.errors import OutputError
from taubench_gl.evaluation import (
    Brightness,
    assemble_summary,
    describe_brightness,
    describe_scale,
    frame_columns,
    mark_cuts,
    missing_of_scene,
    sampled_pairs,
    summarize_lobes,
)
from taubench_gl.features import COLUMNS
from taubench_gl.metrics.exact_rates import exact_summary
from taubench_gl.metrics.sequence_stats import SequenceStats
from taubench_gl.outputs import write_atomically
from taubench_gl.report import run_tables
from taubench_gl.report.table import write_tables as write_table_files
from taubench_gl.run import SUMMARY_FILE, Run, RunWriter, load_run
from taubench_gl.run_schema import CAMERA_COLUMNS, EXACT_COLUMNS
from taubench_gl.scene.model import Camera

SCHEMA = "taubench-gl/batch/3"
IN_PROVENANCE = "depends on machine, engine and chunks: see provenance.json"


def job_positions(job: Job, head: Mapping[str, Any]) -> tuple[int, ...]:
    """Positions of the pairs that a job evaluates, ascending."""
    return sampled_pairs(range(*head["frames"]), job.settings).positions


def merge_job(
    job: Job, head: Mapping[str, Any], records: Mapping[int, PairRecord], reports: Sequence[Mapping[str, Any]]
) -> Run:
    """The Run of a job all of whose pairs are counted.  ``reports``: of the workers, one per chunk."""
    settings, frames = job.settings, range(*head["frames"])
    unmeasured = reports[0]["unmeasured"]
    measured = tuple(c for c in COLUMNS if c not in unmeasured)
    stats = SequenceStats(measured, unmeasured)
    rows = []
    for position in job_positions(job, head):
        record = records[position]
        camera = {name: record.row[name] for name in (*CAMERA_COLUMNS, "gimbal")}
        first = {name: record.row[name] for name in ("frame", "time_s")}
        exact = {name: record.row[name] for name in EXACT_COLUMNS} if settings.metrics.exact else {}
        rows.append(first | stats.add(record.counts) | camera | exact)
    lens = Camera()  # camera activity depends on position and direction only
    views = [View(np.array(p), np.array(r), lens) for p, r in zip(head["positions"], head["rotations"])]
    summary = assemble_summary(head["facts"], frames, settings, views, stats)
    source = dict(reports[0]["source"])
    summary["notes"] += source.pop("notes")
    brightness = Brightness()
    for report in reports:
        brightness.add(report["brightness"])
    source["memory"] = {"gpu_bytes": None, "reason": IN_PROVENANCE}
    summary |= source
    describe_brightness(summary, brightness, settings)
    describe_scale(summary, [depth for report in reports for depth in report["depths"]], settings)
    if job.lobes:
        missing = missing_of_scene(job.lobes, unmeasured)
        summary["lobes"] = summarize_lobes(missing, [records[p].lobes for p in job_positions(job, head)])
    if settings.metrics.exact:
        summary["exact"] = exact_summary(rows, unmeasured, reports[0]["reprojection"])
    summary["timing"] = {"clock": None, "unit": "ms", "passes": {}, "reason": IN_PROVENANCE}
    summary["provenance"] = _common([one["provenance"] for one in reports])
    mark_cuts(rows, summary)
    return Run(summary, rows)


def _common(provenances: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Provenance of all workers together; where they differ, every value, sorted."""
    names = ("version", "backend", "renderer", "driver", "git", "python", "machine")
    values_of = {name: sorted({str(one.get(name)) for one in provenances}) for name in names}
    out: dict[str, Any] = {name: " + ".join(values) for name, values in values_of.items()}
    return out | {"command": None, "clock": None, "reason": IN_PROVENANCE}


def write_job(store: Store, job: Job, run: Run, reports: Sequence[Mapping[str, Any]]) -> None:
    """Write summary.json and frames.csv as ``evaluate`` does, and provenance.json beside them."""
    chunks = [
        {"pairs": [one["pairs"][0], one["pairs"][-1]] if one["pairs"] else [], **one["provenance"],
         "passes_ms": one["passes_ms"], "gpu_bytes": one["source"]["memory"]["gpu_bytes"]}
        for one in reports
    ]  # fmt: skip
    store.write_json(store.job(job.id) / "provenance.json", {"job": job.id, "chunks": chunks})
    with RunWriter(store.job(job.id), frame_columns(job.settings)) as writer:
        writer.rewrite_rows(run.frames)
        writer.write_summary(run.summary)


def is_written(store: Store, job: Job, head: Mapping[str, Any]) -> bool:
    """Whether both files of a job are there and whole; if not, removes its summary.json, and the job is written again.

    Files appear complete; a disk error or another program can damage them afterwards.
    """
    frames = range(*head["frames"])
    try:
        run = load_run(store.job(job.id))
    except OutputError:
        (store.job(job.id) / SUMMARY_FILE).unlink(missing_ok=True)
        return False
    if [row.get("frame") for row in run.frames] == [frames[p + 1] for p in job_positions(job, head)]:
        return True
    (store.job(job.id) / SUMMARY_FILE).unlink()
    return False


def finish(store: Store, spec: BatchSpec, failed: Mapping[str, str]) -> dict[str, Any]:
    """Write summary.json, frames.parquet and tables of the whole batch; returns the summary."""
    jobs, frames, summaries = [], [], []
    for job in spec.jobs:
        entry: dict[str, Any] = {"id": job.id, "scene": job.scene, "sweep": dict(job.sweep)}
        if job.id in failed:
            jobs.append(entry | {"state": "failed", "reason": failed[job.id], "log": f"logs/{job.id}.log"})
            continue
        run = load_run(store.job(job.id))
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
    """Write tables.txt, .md, .csv and .tex of these runs; returns the tables."""
    tables = run_tables(list(summaries)) if summaries else []
    if tables:
        write_table_files(store.out, tables)
    return tables
