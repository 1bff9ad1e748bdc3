"""One file about a driver, to attach to an issue: what it can do, the hard cases, ten timings, ten checksums."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from taubench_gl.animation import choose_camera
from taubench_gl.evaluation import Observers, Pair, evaluate_scene
from taubench_gl.gpu.capabilities import capability_report
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK
from taubench_gl.provenance import provenance
from taubench_gl.selftest.runner import DEFAULT_SIZE, run_selftest
from taubench_gl.selftest.scenes import busy_room
from taubench_gl.settings import FIXED_LIGHTING, Settings

SCHEMA = "taubench-gl/driver-report/1"
FRAMES = 10
"""Evaluated pairs: as many timings and checksums."""
SIZE = (320, 180)
LAMPS = 4
CHANNELS = ("position", "normal", "direct", "indirect", "color")
"""Channels with a checksum of each frame, beside mask and motion."""


def driver_report(
    backend: str = "auto", device: int | None = None, size: tuple[int, int] = DEFAULT_SIZE
) -> dict[str, Any]:
    """The report as JSON values; ``size``: pixels of the selftest.  Raises GraphicsError without OpenGL.

    ``frames`` has, of each pair of ``busy_room``, the counts, the milliseconds by the wall clock (the first with the
    compilation of shaders) and SHA-256 checksums of the arrays, row 0 at the top.  Equal checksums on two drivers mean
    equal bits.
    """
    gpu = open_gpu(backend, device)
    results = run_selftest(gpu, size, device=device)
    settings = Settings(
        width=SIZE[0], height=SIZE[1], frames=(0, FRAMES + 1), backend=backend, device=device, **FIXED_LIGHTING
    )
    scene = busy_room(lamps=LAMPS)
    frames: list[dict[str, Any]] = []
    seconds: list[float] = []

    def look(pair: Pair) -> None:
        arrays = {"mask": pair.mask, "motion": pair.motion}
        arrays |= {name: pair.source.read(name) for name in CHANNELS if name in pair.source.channels}
        sums = {name: _checksum(array) for name, array in arrays.items()}
        frames.append({"frame": pair.frame, "counts": _counts(pair.row), "sha256": sums})

    observers = Observers(on_pair=look, progress=lambda done: seconds.append(done.frame_seconds))
    run = evaluate_scene(scene, settings, observers, camera=choose_camera(scene))
    for entry, time in zip(frames, seconds, strict=True):
        entry["ms"] = 1e3 * time
    return {
        "schema": SCHEMA,
        **capability_report(backend, device),
        "selftest": {
            "size": list(size),
            "passed": sum(result.passed for result in results),
            "failed": [result.as_json() for result in results if not result.passed],
            "errors": {result.name: None if np.isnan(result.error) else result.error for result in results},
        },
        "scene": f"busy_room with {LAMPS} lamps, {SIZE[0]}x{SIZE[1]}",
        "frames": frames,
        "passes_ms": run.summary["timing"]["passes"],
        "provenance": provenance(gpu, WALL_CLOCK),
    }


def _checksum(array: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def _counts(row: dict[str, Any]) -> dict[str, int]:
    return {name: value for name, value in row.items() if isinstance(value, int) and not isinstance(value, bool)}
