"""Bench of batches: Dask workers of one GL thread each against one such worker, and one process on all cores."""

from __future__ import annotations

import os
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from benches import ROOT, Options, Result, bench, row

from taubench_gl.batch.driver import Listener
from taubench_gl.batch.engines.processes import THREADS_VARIABLE, available_cores
from taubench_gl.batch.run import run_study
from taubench_gl.batch.study import Study, read_study
from taubench_gl.gpu.context import Gpu

FRAMES = 49


class _Watch(Listener):
    """When the workers were ready: the driver speaks for the first time then."""

    def __init__(self) -> None:
        self.ready: float | None = None

    def say(self, line: str) -> None:
        self.ready = self.ready or time.perf_counter()


def _timed(study: Study, **engine) -> tuple[float, float]:
    """Seconds to start the workers, and seconds from there to the last table."""
    with tempfile.TemporaryDirectory() as folder:
        watch, started = _Watch(), time.perf_counter()
        outcome = run_study(study, Path(folder) / "out", listener=watch, **engine)
        ended = time.perf_counter()
    if outcome.failed:
        raise SystemExit(f"tools/bench: {next(iter(outcome.failed.values()))}")
    return watch.ready - started, ended - watch.ready


@bench
def batch(gpu: Gpu, options: Options) -> Result:
    """The demo scene with all columns: milliseconds per pair once the workers run, shader compilation included."""
    cores = available_cores()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "study.toml"
        size = f"{options.size[0]}x{options.size[1]}"
        path.write_text(f'scenes = ["{ROOT / "assets" / "demo.glb"}"]\nsize = "{size}"\nframes = "0:{FRAMES}"\n')
        study = read_study(path)
    threads = os.environ.get(THREADS_VARIABLE, "as many as there are cores")
    engines = {
        "1 Dask worker, 1 GL thread": {"engine": "dask-local", "workers": 1},
        f"{cores} Dask workers, 1 GL thread each": {"engine": "dask-local", "workers": cores},
        f"{cores} processes (--workers {cores})": {"workers": cores},
        f"this process, GL threads: {threads}": {},
    }
    samples, starts = defaultdict(list), defaultdict(list)
    for _ in range(options.repeats):  # interleaved: what else the machine does hits all of them
        for name, engine in engines.items():
            start, seconds = _timed(study, **engine)
            samples[name].append(1e3 * seconds / (FRAMES - 1))
            starts[name].append(start)
    rows = [row(name, samples[name], f"started in {np.median(starts[name]):.1f} s") for name in engines]
    one, many, _, here = (r.median_ms for r in rows)
    notes = [
        f"demo.glb, {FRAMES - 1} pairs, all columns, {size}, {cores} cores; start of the workers is not in the times:",
        *(f"{name}: started in {np.median(starts[name]):.1f} s" for name in engines),
        f"1 : {cores} Dask workers = {one / many:.2f} x; this process : {cores} Dask workers = {here / many:.2f} x",
    ]
    return Result("Batches", rows, notes)
