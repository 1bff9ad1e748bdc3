"""Long runs: constant memory, and no GL object left."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from pathlib import Path

import pytest

from taubench_gl.gpu.context import open_gpu
from taubench_gl.selftest import cases, run_selftest
from taubench_gl.selftest.runner import DEFAULT_SIZE

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


def long_run(frames: int, tmp_path: Path) -> dict:
    code = RUNNER.format(frames=frames, out=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


def check(report: dict, frames: int, per_pair: int) -> None:
    """After the first tenth only the table of results and Python's arenas grow."""
    assert report["pairs"] == frames - 1 and report["error"] == "GL_NO_ERROR"
    first, last = report["rss"][1], report["rss"][-1]
    assert last - first <= 2**20 + per_pair * frames, f"grew by {(last - first) / 1024:.0f} KiB: {report['rss']}"
    assert report["left"] == 0, "GL objects that were not released"


@pytest.mark.long
def test_memory_over_10000_frames(tmp_path):
    check(long_run(10_000, tmp_path), 10_000, per_pair=6 * 1024)


def live_names(gpu) -> dict[str, int]:
    """GL names in use below 20000, by kind, as reported by the driver."""
    import ctypes

    out = {}
    for kind in ("Texture", "Buffer", "Framebuffer", "Program", "Shader", "VertexArray", "Sampler"):
        is_name = ctypes.CFUNCTYPE(ctypes.c_ubyte, ctypes.c_uint)(gpu._function(f"glIs{kind}"))
        out[kind] = sum(bool(is_name(name)) for name in range(1, 20000))
    return out


@pytest.mark.parametrize("step", [40, pytest.param(1, marks=pytest.mark.long)])
def test_selftest_leaves_no_gl_object(step: int):
    """Repeated runs of the same cases, every fortieth one or all, leave the same number of GL objects."""
    gpu = open_gpu("egl")
    names = [c.name for c in cases() if c.name != "more-than-2^24-pixels"][::step]
    found = []
    for _ in range(3):
        results = run_selftest(gpu, DEFAULT_SIZE, only=names)
        assert all(r.passed for r in results)
        with gpu:
            gc.collect()
            gpu.collect()
            found.append(live_names(gpu))
    assert found[1] == found[2], f"each run leaves objects behind: {found}"
