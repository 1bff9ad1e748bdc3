"""Contexts: errors when there is none, capabilities, and release of all GL objects."""

from __future__ import annotations

import ctypes
import gc
import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import moderngl
import numpy as np
import pytest
from fixed import fixed_settings
from repeated import few

from taubench_gl.api import pairs
from taubench_gl.errors import GraphicsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.gpu import context
from taubench_gl.gpu.context import SUBMITTED_TRIANGLES, Gpu, open_gpu
from taubench_gl.gpu.timing import MAX_SAMPLES, PassTimer, probe_timer
from taubench_gl.paths import PACKAGE
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light", "own_programs")

DEMO = PACKAGE.parent / "assets" / "demo.glb"


@pytest.fixture
def no_contexts(monkeypatch):
    """As if this process had opened none yet."""
    monkeypatch.setattr(context._open, "by_name", {})
    monkeypatch.delenv(context.BACKEND_VARIABLE, raising=False)


def test_auto_tries_both_backends_and_its_error_lists_both(no_contexts, monkeypatch) -> None:
    tried = []

    def missing(name, device):
        tried.append(name)
        raise OSError(f"lib{name} is not installed")

    monkeypatch.setattr(context, "_create", missing)
    with pytest.raises(GraphicsError) as caught:
        open_gpu()
    message = str(caught.value)
    assert tried == ["egl", "osmesa"] and "\n" not in message
    assert all(f"{name}: lib{name} is not installed" in message for name in tried)
    tried.clear()
    with pytest.raises(GraphicsError):
        open_gpu("auto", device=3)
    assert tried == ["egl"], "OSMesa has no devices"


def test_a_driver_that_is_too_old_is_named(no_contexts, monkeypatch) -> None:
    class Old:
        version_code = 330

    monkeypatch.setattr(moderngl, "create_context", lambda **_: Old())
    with pytest.raises(GraphicsError, match=r"offers GL 3\.3, 4\.5 is needed"):
        open_gpu("egl")


def test_bad_device_index(no_contexts) -> None:
    with pytest.raises(GraphicsError, match=r"^no EGL device has number 999 \(the devices there are: 0[0-9, ]*\)$"):
        open_gpu("egl", device=999)
    with pytest.raises(GraphicsError, match="OSMesa has no devices"):
        open_gpu("osmesa", device=0)


def test_egl_without_a_device_gives_way_to_osmesa(no_contexts, monkeypatch) -> None:
    """glcontext counts devices where none was asked for too: a container whose EGL has none still has OSMesa."""

    def create(name, device):
        if name == "egl":
            raise Exception("requested device index 0, but found 0 devices")  # as glcontext does
        return "an OSMesa context"

    monkeypatch.setattr(context, "_create", create)
    assert open_gpu() == "an OSMesa context"
    context._open.by_name.clear()
    with pytest.raises(GraphicsError, match="found 0 devices"):
        open_gpu("egl")
    with pytest.raises(GraphicsError, match="no EGL device has number 0"):
        open_gpu(device=0)


def test_unknown_backend(no_contexts, monkeypatch) -> None:
    with pytest.raises(GraphicsError):
        open_gpu("vulkan")
    monkeypatch.setenv(context.BACKEND_VARIABLE, "metal")
    with pytest.raises(GraphicsError):
        open_gpu()


def test_one_context_per_thread(session_gpu) -> None:
    assert open_gpu() is session_gpu
    assert open_gpu(session_gpu.backend) is session_gpu
    with ThreadPoolExecutor(1) as thread:
        other = thread.submit(open_gpu).result()
        assert other is not session_gpu and thread.submit(open_gpu).result() is other
    with pytest.raises(GraphicsError, match="another thread"), other:
        pass


def test_an_evaluation_on_another_thread_has_the_same_counts(session_gpu) -> None:
    settings = fixed_settings(width=64, height=36, frames=(0, 3), shadow_size=64, indirect="none")
    with ThreadPoolExecutor(2) as threads:
        found = list(threads.map(lambda _: evaluate_scene(DEMO, settings).frames, range(3)))
    assert found == [evaluate_scene(DEMO, settings).frames] * 3


def test_a_loop_over_pairs_stays_on_its_thread(session_gpu) -> None:
    found = pairs(DEMO, Settings(width=64, height=36, frames=(0, 3), columns=("frustum", "position")))
    next(found)
    with ThreadPoolExecutor(1) as thread, pytest.raises(GraphicsError, match="another thread"):
        thread.submit(next, found).result()


FORKED = """
import multiprocessing, sys
from taubench_gl import evaluate
from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import open_gpu

options = {"size": "64x36", "frames": range(3), "columns": "frustum,position"}

def child(scene):
    faults = []
    for use in (lambda: evaluate(scene, **options), open_gpu, inherited.__enter__ if inherited else open_gpu):
        try:
            use()
        except GraphicsError as error:
            faults.append(str(error))
    return faults

if __name__ == "__main__":
    method, used, scene = sys.argv[1], sys.argv[2] == "used", sys.argv[3]
    inherited = open_gpu() if used else None
    if used:
        evaluate(scene, **options)
    with multiprocessing.get_context(method).Pool(1) as pool:
        faults = pool.map_async(child, [scene]).get(timeout=100)[0]
    assert len(faults) == (3 if used and method == "fork" else 0), faults
    assert all("forked" in fault and "spawn" in fault for fault in faults)
    assert evaluate(scene, **options).summary["pairs"] == 2  # the parent still works
else:
    inherited = None
"""


@pytest.mark.parametrize(("method", "used"), few([("fork", True), ("spawn", True), ("fork", False)], 2))
def test_a_forked_child_of_a_process_with_a_context_gets_one_clear_line(tmp_path, method, used) -> None:
    """Drivers do not survive a fork: without the check, the child waits for ever for the threads of its parent."""
    script = tmp_path / "program.py"
    script.write_text(FORKED)
    command = [sys.executable, script, method, "used" if used else "new", DEMO]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_an_unproven_timer_is_not_used(gpu: Gpu) -> None:
    verdict = probe_timer(gpu)
    assert verdict.usable == (0.5 * verdict.wall_ms <= verdict.gpu_ms <= 1.5 * verdict.wall_ms)
    assert "wall clock" in verdict.why


def test_pass_timer_memory_is_bounded(gpu: Gpu) -> None:
    timer = PassTimer(gpu)
    for _ in range(MAX_SAMPLES + 10):
        with timer.measure("nothing"):
            pass
    samples = timer.samples_ms()["nothing"]
    assert len(samples) == MAX_SAMPLES
    with timer.measure("nothing"):
        pass
    assert np.array_equal(timer.samples_ms()["nothing"][:-1], samples[1:])  # the oldest is dropped
    quiet = PassTimer(gpu, enabled=False)
    with quiet.measure("nothing"):
        pass
    assert not quiet.samples_ms()


def test_an_error_state_is_reported_once(gpu: Gpu) -> None:
    texture = gpu.ctx.texture((4, 4), 4)
    texture.bind_to_image(10_000)  # no such unit
    with pytest.raises(GraphicsError, match="after a wrong call"):
        gpu.check("a wrong call")
    gpu.check("nothing")
    texture.release()


def alive(gpu: Gpu) -> dict[str, int]:
    """GL objects that exist, by kind.  Names are handed out in order: the next name bounds the search."""
    ctx, out = gpu.ctx, {}
    texture, buffer = ctx.texture((1, 1), 1), ctx.buffer(reserve=4)
    probes = {
        "Texture": texture,
        "Buffer": buffer,
        "Framebuffer": ctx.framebuffer([texture]),
        "Program": ctx.compute_shader("#version 450\nlayout(local_size_x = 1) in;\nvoid main() {}"),
    }
    for kind, probe in probes.items():
        exists = ctypes.CFUNCTYPE(ctypes.c_ubyte, ctypes.c_uint)(gpu._function(f"glIs{kind}"))
        out[kind] = sum(bool(exists(name)) for name in range(1, probe.glo + 1)) - 1
    for probe in reversed(probes.values()):
        probe.release()
    return out


def alive_before(gpu: Gpu) -> int:
    """Number of GL objects that earlier tests left.  moderngl never deletes a program whose shader did not compile."""
    gc.collect()
    gpu.collect()
    return sum(alive(gpu).values())


def test_capability_report() -> None:
    """In a process of its own: it opens every backend there is, and two Mesas in one process are one too many."""
    code = "import json; from taubench_gl.gpu.capabilities import capability_report as r; print(json.dumps(r()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["backends"][report["backend"]]["usable"]
    assert set(report["backends"]) == {"egl", "osmesa"}
    for backend in report["backends"].values():
        assert backend["why"]
    assert report["limits"]["color attachments"] >= 8 and report["limits"]["texture size"] >= 16384
    assert report["software"] == ("llvmpipe" in report["renderer"].lower())
    assert "wall clock" in report["timer"]["why"]
    assert report["libraries"]["moderngl"] and report["libraries"]["numpy"]


@pytest.mark.parametrize("software", [True, False])
def test_software_is_waited_for_after_so_many_triangles(software: bool) -> None:
    """Portions end behind the draw that reaches the number, also where earlier calls have submitted a part of it."""
    rng, waits, order = np.random.default_rng(1), [], []
    gpu = SimpleNamespace(software=software, _submitted=0, finish=lambda: waits.append(sum(order)))
    for count in (1, 3, 400, 1, 2000):
        triangles = rng.integers(0, 5000, count)
        ends = [0]
        for first, end in Gpu.portions(gpu, triangles):
            assert first == ends[-1] < end
            order.extend(triangles[first:end].tolist())
            ends.append(end)
        assert ends[-1] == count
    steps = np.diff([0, *waits, sum(order)])
    assert (len(waits) == sum(order) // SUBMITTED_TRIANGLES) if software else not waits
    assert (abs(steps[:-1] - SUBMITTED_TRIANGLES) < 5000).all()
