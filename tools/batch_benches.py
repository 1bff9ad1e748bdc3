"""Benchmark of batches: worker processes with one GL thread each, one such worker, and one process on all cores."""

from __future__ import annotations

import os
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from unittest.mock import patch

import numpy as np
from benches import ROOT, Claim, Options, Result, bench, ratios, row

from taubench_gl.batch.spec import BatchSpec, read_spec
from taubench_gl.batch.study import run_batch
from taubench_gl.gpu.context import Gpu
from taubench_gl.study.engines import THREADS_VARIABLE, available_cores
from taubench_gl.study.progress import Listener

FRAMES, MODES = 33, ("camera", "motion")
"""Frames of each job, and the reprojection of the jobs: batches are more than one job."""

PAIRS = len(MODES) * (FRAMES - 1)


class _Watch(Listener):
    """Records when the workers are ready, which is when the driver first reports, and when the last pair is counted."""

    def __init__(self) -> None:
        self.ready = self.done = 0.0

    def begin(self, jobs: int, engine: str) -> None:
        self.ready = time.perf_counter()

    def job_finished(self, job: str) -> None:
        self.done = time.perf_counter()


def _timed(spec: BatchSpec, workers: int) -> tuple[float, float]:
    """Seconds to start the workers, and from there until the last job is finished."""
    with tempfile.TemporaryDirectory() as folder:
        watch, started = _Watch(), time.perf_counter()
        outcome = run_batch(spec, Path(folder) / "out", listener=watch, workers=workers)
    if outcome.failed:
        raise SystemExit(f"tools/bench: {next(iter(outcome.failed.values()))}")
    return watch.ready - started, watch.done - watch.ready


@bench
def batch(gpu: Gpu, options: Options) -> Result:
    """The demo scene with all columns of the preview, at half the size: milliseconds per pair after the workers start.

    Shader compilation is included.
    """
    cores = available_cores()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "spec.toml"
        size = f"{options.size[0] // 2}x{options.size[1] // 2}"
        path.write_text(
            f'scenes = ["{ROOT / "assets" / "demo.glb"}"]\nsize = "{size}"\nframes = "0:{FRAMES}"\nlight = "preview"\n'
            f"reprojection = {list(MODES)}\n"
        )
        spec = read_spec(path)
    threads = os.environ.get(THREADS_VARIABLE, "as many as there are cores")
    one_thread = {THREADS_VARIABLE: "1"}
    engines: dict[str, tuple[int, dict[str, str]]] = {
        "1 worker, 1 GL thread": (1, one_thread),
        f"{cores} workers, 1 GL thread each": (cores, one_thread),
        f"this process, GL threads: {threads}": (0, {}),
    }
    samples, starts = defaultdict(list), defaultdict(list)
    for _ in range(options.repeats):  # interleaved, so that other load affects all engines
        for name, (workers, environment) in engines.items():
            with patch.dict(os.environ, environment):
                start, seconds = _timed(spec, workers)
            samples[name].append(1e3 * seconds / PAIRS)
            starts[name].append(start)
    rows = [row(name, samples[name], f"started in {np.median(starts[name]):.1f} s") for name in engines]
    one, many, here = (samples[name] for name in engines)
    notes = [
        f"demo.glb, {len(MODES)} jobs, {PAIRS} pairs, all columns, {size}, {cores} cores; "
        "without start and end of the workers",
        f"1 : {cores} workers = {np.median(one) / np.median(many):.2f} x, round by round "
        + ", ".join(f"{a / b:.2f}" for a, b in zip(one, many, strict=True)),
    ]
    note = f"{size}, pairs per second once the workers run"
    claims = (
        Claim(f"{cores} workers of one GL thread, over one", ">=", 0.85 * cores, *ratios(one, many), note=note),
        Claim(f"{cores} workers, over one process on all cores", ">=", 1.0, *ratios(here, many), note=note),
    )
    return Result("Batches", rows, notes, claims=claims)
