"""An evaluation with all columns in a separate process, and its memory.

Arguments: scene, width, height, frames, frames per second.

Reports resident_mib, one value per pair, and frame_ms, and ends.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

from serve import serve


def prepare():
    from taubench_gl.evaluation import Observers, evaluate_scene
    from taubench_gl.settings import Settings

    path, (width, height, frames, fps) = sys.argv[1], map(int, sys.argv[2:])
    resident: list[float] = []

    def note_memory(_) -> None:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        resident.append(pages * resource.getpagesize() / 2**20)

    with tempfile.TemporaryDirectory() as out:
        start = time.perf_counter()
        settings = Settings(width=width, height=height, fps=fps, frames=(0, frames))
        evaluate_scene(path, settings, Observers(progress=note_memory), out=out)
        seconds = time.perf_counter() - start
    return (lambda request: {}), {"resident_mib": resident, "frame_ms": seconds * 1e3 / len(resident)}


serve(prepare)
