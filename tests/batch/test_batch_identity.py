"""Batch results do not depend on engine or chunks, and equal those of ``evaluate``, bit for bit."""

from __future__ import annotations

import io
import json
import os
import shutil
from pathlib import Path

import pytest
from batch_tools import DEMO, final_files
from fixed import fixed_settings
from repeated import few

from taubench_gl.batch.merge import frames_table
from taubench_gl.batch.spec import BatchSpec, Job, read_spec
from taubench_gl.batch.study import batch_store, run_batch, stored_spec
from taubench_gl.evaluation import evaluate_scene, sampled_light
from taubench_gl.evaluation.sampled_light import RoundSizes
from taubench_gl.run import load_run
from taubench_gl.run_schema import FRAME_COLUMNS
from taubench_gl.study.progress import Progress

VOLATILE = ("timing", "memory", "provenance")
"""Blocks of summary.json that differ with machine and engine."""


@pytest.mark.parametrize("chunk", few([7, 1]))
def test_results_do_not_depend_on_chunks(reference, tmp_path, chunk):
    path, expected = reference
    run_batch(read_spec(path), tmp_path / "out", chunk=chunk)
    assert final_files(tmp_path / "out") == expected


def test_results_do_not_depend_on_worker_processes(reference, tmp_path):
    path, expected = reference
    run_batch(read_spec(path), tmp_path / "out", workers=2, chunk=8)
    assert final_files(tmp_path / "out") == expected
    assert not list((tmp_path / "out" / "logs").iterdir())


LIGHT = {"columns": ("frustum", "position", "direct", "indirect", "color"), "shadow_size": 64, "probes": 32}


LOBES = {"columns": ("direct", "indirect"), "shadow_size": 64, "probes": 32, "frames": (0, 5)}
CHANGES = {
    "plain": {},
    "motion": {"reprojection": "motion", "sampling": "bilinear", "frames": (5, 14), "thresholds": {"normal": 0.01}},
    "sampled": {"pairs": "strata:3", "samples_per_pixel": 2},
    "no pairs": {"frames": (4, 5)},
    "exact": {"frames": (4, 8), "exact": True, "columns": ("frustum", "position", "normal", "direct"),
              "shadow_lights": 0},
    "raster light": LIGHT,
    "sampled light": {"light": "auto", "light_within": 6.0, **LIGHT},
    "decided light": {"light": "path-traced", "width": 10, "height": 6, "frames": (5, 8), **LIGHT},
    "other eye": {"history": "eye", "convergence": 3.0, "frames": (3, 7)},
    "both histories": {"history": "both", "eyes": 0.1, "frames": (3, 7)},
    "both histories, sampled light": {"history": "both", "light": "auto", "light_within": 6.0, **LIGHT},
    "lobes": LOBES | {"light": "raster", "indirect": "none"},
    "lobes, sampled light": LOBES | {"light": "auto", "light_within": 9.0},
    "lobes, decided light": LOBES | {"light": "path-traced", "width": 10, "height": 6, "frames": (0, 4)},
}  # fmt: skip
LONG = [kind for kind in CHANGES if "sampled light" in kind or "decided light" in kind]


@pytest.mark.parametrize("kind", [pytest.param(k, marks=pytest.mark.long) if k in LONG else k for k in CHANGES])
def test_results_equal_those_of_evaluate(tmp_path, kind, monkeypatch):
    """Pairs, sums, curves, census, camera, cuts, lobes and rounds of light; a chunk ends at every other pair."""
    monkeypatch.setattr(sampled_light, "ROUND_SIZES", RoundSizes(pairs=3, pixels=16, limit=128))
    settings = {"width": 48, "height": 27, "frames": (0, 8), "columns": ("frustum", "position", "normal")}
    settings, lobes = (
        fixed_settings(**settings | CHANGES[kind]),
        ("diffuse", "glossy", "volume") if "lobes" in kind else (),
    )
    once = evaluate_scene(DEMO, settings, out=tmp_path / "once", lobes=lobes, sampled=True)
    run_batch(BatchSpec("one", (Job("demo", str(DEMO), settings, {}, lobes=lobes),)), tmp_path / "out", chunk=2)
    run = load_run(tmp_path / "out" / "jobs" / "demo")
    # A run without a pair writes nothing; the job of a batch does, so that the batch is complete.
    stored = load_run(tmp_path / "once") if once.frames else once
    assert stored.out == (tmp_path / "once" if once.frames else None)
    assert run.frames == stored.frames == once.frames
    assert list(run.summary) == list(stored.summary)
    assert {k: v for k, v in run.summary.items() if k not in VOLATILE} == {
        k: v for k, v in stored.summary.items() if k not in VOLATILE
    }
    if once.frames:
        assert (run.out / "frames.csv").read_bytes() == (tmp_path / "once" / "frames.csv").read_bytes()
    assert not lobes or run.summary["lobes"]["diffuse"]["direct"]["mean_percent"] > 0
    assert stored_spec(batch_store(tmp_path / "out")).jobs[0].lobes == lobes


def test_names_that_are_not_utf8_are_escaped_in_the_table_of_all_pairs():
    pq = pytest.importorskip("pyarrow.parquet")
    lost = os.fsdecode(b"caf\xe9")
    data = frames_table([("job", lost, {"camera": lost, "fps": 24.0}, [dict.fromkeys(FRAME_COLUMNS, 0)])])
    table = pq.read_table(io.BytesIO(data)).to_pylist()
    assert [(r["scene"], r["sweep_camera"], r["sweep_fps"]) for r in table] == [(r"caf\udce9", r"caf\udce9", "24.0")]


def test_cuts_are_found_over_chunk_boundaries(tmp_path, reference):
    """A cut depends on the pairs around it, so it is detected on the whole sequence."""
    pq = pytest.importorskip("pyarrow.parquet")
    path, _ = reference
    out = path.parent / "out"
    table = pq.read_table(out / "frames.parquet")
    assert table.num_rows == 2 * 15
    assert set(table["sweep_reprojection"].to_pylist()) == {"camera", "motion"}
    jobs = json.loads((out / "summary.json").read_text())["jobs"]
    for job in jobs:
        rows = [r for r in table.to_pylist() if r["job"] == job["id"]]
        assert [r["frame"] for r in rows] == list(range(1, 16))
        assert [r["frame"] for r in rows if r["camera_cut"]] == job["camera"]["cuts"]
        mean = sum(100 * r["frustum"] / r["pixels"] for r in rows) / 15
        assert job["discard"]["frustum"]["mean_percent"] == pytest.approx(mean, rel=1e-12)


@pytest.mark.long
def test_machines_that_share_the_jobs_give_the_results_of_one(reference, tmp_path):
    """Each has a spec of its own with some of the jobs; their records are copied into one folder."""
    path, expected = reference
    whole, out = read_spec(path), tmp_path / "out"
    for name, job in zip("ab", whole.jobs, strict=True):
        run_batch(BatchSpec(name, (job,)), tmp_path / name, chunk=8)
        shutil.copytree(tmp_path / name / "records", out / "records", dirs_exist_ok=True)
    lines: list[str] = []
    run_batch(whole, out, listener=Progress(lines.append))
    assert final_files(out) == expected
    assert sum("of an earlier run" in line for line in lines) == len(whole.jobs)


def records(job: Path) -> Path:
    """Folder of the records of the job whose results are in the folder ``job``."""
    return job.parents[1] / "records" / job.name


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


DAMAGES = {
    "rows-cut": lambda job: truncate(job / "frames.csv"),
    "rows-gone": lambda job: (job / "frames.csv").unlink(),
    "summary-cut": lambda job: truncate(job / "summary.json"),
    "summary-empty": lambda job: (job / "summary.json").write_bytes(b""),
    "long-number": lambda job: (job / "frames.csv").write_text("frame\n" + "1" * 5000 + "\n"),
    "pairs-cut": lambda job: [truncate(job / "summary.json"), truncate(next(records(job).glob("pairs-*")))],
    "head-cut": lambda job: [truncate(job / "frames.csv"), truncate(records(job) / "head.json")],
    "head-empty": lambda job: [truncate(job / "frames.csv"), (records(job) / "head.json").write_text("{}")],
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_half_written_job_is_rebuilt_by_resume(reference, tmp_path, damage):
    spec, expected = reference
    out = tmp_path / "out"
    shutil.copytree(spec.parent / "out", out)
    DAMAGES[damage](sorted((out / "jobs").iterdir())[0])
    run_batch(None, out)
    assert final_files(out) == expected
