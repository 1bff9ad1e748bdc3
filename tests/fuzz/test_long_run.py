"""Long runs: constant memory, and no GL object left."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

RUNNER = """
import json, os, resource
from dataclasses import replace
import psutil
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.selftest.scenes import busy_room
from taubench_gl.settings import Settings
from taubench_gl.gpu.context import open_gpu

frames = {frames}
room = busy_room(lamps=2)
stretched = tuple(replace(c, times=c.times * (frames / 24)) for c in room.channels)
process, seen = psutil.Process(), []

def progress(p):
    if p.done * 10 % p.total < 10:
        seen.append(process.memory_info().rss)

settings = Settings(width=32, height=18, frames=(0, frames), reprojection="motion", shadow_size=32, indirect="none",
                    backend="egl", pairs="all",
                    columns=("frustum", "position", "normal", "direct", "color"))
run = evaluate_scene(replace(room, channels=stretched), settings, Observers(progress=progress), out={out!r})
gpu = open_gpu("egl")
with gpu:
    left = gpu.collect()
    error = gpu.ctx.error
print(json.dumps({{"pairs": run.summary["pairs"], "rss": seen, "left": left, "error": error}}))
"""


@pytest.mark.long
def test_memory_over_10000_frames(tmp_path):
    """After the first tenth only the table of results and Python's arenas grow."""
    frames, per_pair = 10_000, 6 * 1024
    code = RUNNER.format(frames=frames, out=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stderr[-3000:]
    report = json.loads(done.stdout.splitlines()[-1])
    assert report["pairs"] == frames - 1 and report["error"] == "GL_NO_ERROR"
    first, last = report["rss"][1], report["rss"][-1]
    assert last - first <= 2**20 + per_pair * frames, f"grew by {(last - first) / 1024:.0f} KiB: {report['rss']}"
    assert report["left"] == 0, "GL objects that were not released"
