"""From the pairs of a job to its summary and frames.csv: the sums that ``evaluate`` makes, in the order of the pairs.

Nothing here depends on who counted a pair or in which chunk it was: the same pairs give the same files, bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.animation.state import View
from taubench_gl.batch.partition import PairRecord, frames_table
from taubench_gl.batch.store import Store
from taubench_gl.batch.study import Job, Study
from taubench_gl.conventions import COLUMNS
from taubench_gl.evaluation import assemble_summary, mark_cuts, sampled_pairs
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.outputs import write_atomically
from taubench_gl.report import FORMATS, paper_tables
from taubench_gl.run import CAMERA_COLUMNS, FRAME_COLUMNS, Run, RunWriter, load_run
from taubench_gl.scene.model import Camera

SCHEMA = "taubench-gl/batch/1"
TABLE_FILES = {"tables.txt": "text", "tables.md": "markdown", "tables.csv": "csv", "tables.tex": "latex"}
ELSEWHERE = "differs with machine, engine and chunks: see provenance.json"


def job_positions(job: Job, head: Mapping[str, Any]) -> tuple[int, ...]:
    """Positions of the pairs a job looks at, ascending."""
    return sampled_pairs(range(*head["frames"]), job.settings).positions


def merge_job(
    job: Job, head: Mapping[str, Any], records: Mapping[int, PairRecord], told: Sequence[Mapping[str, Any]]
) -> Run:
    """The Run of a job all of whose pairs are there."""
    settings, frames = job.settings, range(*head["frames"])
    unmeasured = told[0]["unmeasured"]
    measured = tuple(c for c in COLUMNS if c not in unmeasured)
    stats = SequenceStats(measured, unmeasured)
    rows = []
    for position in job_positions(job, head):
        record = records[position]
        camera = {name: record.row[name] for name in (*CAMERA_COLUMNS, "gimbal")}
        first = {name: record.row[name] for name in ("frame", "time_s")}
        rows.append(first | stats.add(record.counts) | camera)
    lens = Camera()  # camera activity is about place and direction only
    views = [View(np.array(p), np.array(r), lens) for p, r in zip(head["positions"], head["rotations"])]
    summary = assemble_summary(head["facts"], frames, settings, views, stats)
    source = dict(told[0]["source"])
    summary["notes"] += source.pop("notes")
    source["memory"] = {"gpu_bytes": None, "reason": ELSEWHERE}
    summary |= source
    summary["timing"] = {"clock": None, "unit": "ms", "passes": {}, "reason": ELSEWHERE}
    summary["provenance"] = _common([one["provenance"] for one in told])
    mark_cuts(rows, summary)
    return Run(summary, rows)


def _common(told: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What all workers say alike; where they differ, all that was said, in one order."""
    names = ("version", "backend", "renderer", "driver", "git", "python", "machine")
    said = {name: sorted({str(one.get(name)) for one in told}) for name in names}
    out: dict[str, Any] = {name: " + ".join(values) for name, values in said.items()}
    return out | {"command": None, "clock": None, "reason": ELSEWHERE}


def write_job(store: Store, job: Job, run: Run, told: Sequence[Mapping[str, Any]]) -> None:
    """summary.json and frames.csv as ``evaluate`` writes them, and provenance.json beside them."""
    chunks = [
        {"pairs": [one["pairs"][0], one["pairs"][-1]] if one["pairs"] else [], **one["provenance"],
         "passes_ms": one["passes_ms"], "gpu_bytes": one["source"]["memory"]["gpu_bytes"]}
        for one in told
    ]  # fmt: skip
    store.write_json(store.job(job.id) / "provenance.json", {"job": job.id, "chunks": chunks})
    with RunWriter(store.job(job.id), FRAME_COLUMNS) as writer:
        writer.rewrite_rows(run.frames)
        writer.write_summary(run.summary)


def finish(store: Store, study: Study, failed: Mapping[str, str]) -> dict[str, Any]:
    """Write the study's own summary.json, frames.parquet and tables; the summary."""
    jobs, frames, summaries = [], [], []
    for job in study.jobs:
        entry: dict[str, Any] = {"id": job.id, "scene": job.scene, "sweep": dict(job.sweep)}
        if job.id in failed:
            jobs.append(entry | {"state": "failed", "reason": failed[job.id], "log": f"logs/{job.id}.log"})
            continue
        run = load_run(store.job(job.id))
        summaries.append(labelled(job, run.summary))
        frames.append((job.id, run.summary["scene"]["name"], job.sweep, run.frames))
        kept = ("pairs", "camera", "discard")
        entry |= {"state": "done", "summary": f"jobs/{job.id}/summary.json"}
        jobs.append(entry | {name: run.summary[name] for name in kept})
    summary = {"schema": SCHEMA, "study": study.name, "done": len(summaries), "failed": len(failed), "jobs": jobs}
    write_atomically(store.out / "frames.parquet", frames_table(frames))
    write_tables(store, summaries)
    store.write_json(store.out / "summary.json", summary)
    return summary


def labelled(job: Job, summary: Mapping[str, Any]) -> dict[str, Any]:
    """A summary whose scene is named after what sets its job apart too, for tables that hold several of one scene."""
    return dict(summary) | {"scene": summary["scene"] | {"name": job.labelled(summary["scene"]["name"])}}


def write_tables(store: Store, summaries: Sequence[Mapping[str, Any]]) -> list[Any]:
    """tables.txt, .md, .csv and .tex of these runs; the tables."""
    tables = paper_tables(list(summaries)) if summaries else []
    for name, look in TABLE_FILES.items() if tables else ():
        write_atomically(store.out / name, FORMATS[look](tables))
    return tables
