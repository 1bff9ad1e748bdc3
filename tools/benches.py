"""What tools/bench measures: one function per bench, registered by name; each returns rows for one table.

Every sample is taken with the passes interleaved (pass A, pass B, pass A, ...), after a warm-up round that is thrown
away, by the clock that gpu.timing has proven, which is named with the numbers.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from taubench_gl.animation import choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.animation.state import View
from taubench_gl.channels import CHANNELS
from taubench_gl.conventions import FEATURES
from taubench_gl.frame.passes.masks import Counts, MaskPass
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.provenance import provenance
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera
from taubench_gl.settings import Settings

ROOT = Path(__file__).resolve().parents[1]
FPS = 24.0
EIGHT = tuple(name for name in ("position", "normal", "prev_position", "geometric_normal", "base_color", "material",
                                "emission", "ids") if name in CHANNELS)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """Milliseconds of one pass."""

    what: str
    median_ms: float
    low_ms: float  # 10th percentile
    high_ms: float  # 90th
    samples: int
    note: str = ""


@dataclass(frozen=True)
class Result:
    title: str
    rows: list[Row]
    notes: list[str]


@dataclass(frozen=True)
class Options:
    size: tuple[int, int]
    repeats: int


BENCHES: dict[str, Callable[[Gpu, Options], Result]] = {}


def bench(function: Callable[[Gpu, Options], Result]) -> Callable[[Gpu, Options], Result]:
    """Registers a bench under its function's name."""
    BENCHES[function.__name__] = function
    return function


def real_scene(*names: str) -> Path:
    """The first of ``names`` among the real scenes beside the checkout; assets/demo.glb without them."""
    data = Path(os.environ.get("TAUBENCH_DATA") or ROOT.parent / "shared" / "data")
    for name in names:
        if (data / name).is_file():
            return data / name
    return ROOT / "assets" / "demo.glb"


def row(what: str, samples: list[float], note: str = "") -> Row:
    low, median, high = np.percentile(samples, [10, 50, 90])
    return Row(what, float(median), float(low), float(high), len(samples), note)


def peak_rss_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


class Stopwatch:
    """Wall-clock milliseconds by name, each closed by finish()."""

    def __init__(self, gpu: Gpu):
        self._gpu, self.samples = gpu, defaultdict(list)

    def time(self, name: str, work: Callable[[], object]) -> object:
        self._gpu.finish()
        start = time.perf_counter()
        value = work()
        self._gpu.finish()
        self.samples[name].append((time.perf_counter() - start) * 1e3)
        return value


class MaskBench:
    """One scene and reprojection mode: draws a pair, masks it, and asks the twin."""

    def __init__(self, gpu: Gpu, path: Path, mode: str, size: tuple[int, int]):
        scene = load_scene(path)
        self.mode, self.size = mode, size
        self.channels = ("position", "normal", "prev_position") if mode == "motion" else ("position", "normal")
        self.renderer = Renderer(gpu, scene, choose_camera(scene), size, self.channels)
        self.shaders = ShaderCache(gpu.ctx)
        self.masks = MaskPass(gpu, self.shaders, size, reprojection=mode)
        self.thresholds = {f: Settings().threshold(f) for f in FEATURES}

    def run_masks(self, pair: Reprojection) -> Counts:
        history = self.renderer.history
        self.masks.run(pair, self.thresholds, history.current.textures, history.previous.textures)
        return self.masks.read()

    def run_twin(self, pair: Reprojection, current: dict, history: dict) -> np.ndarray:
        return pair_masks(current, history, pair, self.thresholds, reprojection=self.mode).combos()

    def round(self, watch: Stopwatch, *, twin: bool) -> None:
        """Seven frames, six pairs."""
        view = None
        for frame in range(7):
            watch.time("g-buffer", lambda f=frame: self.renderer.draw(f / FPS, (f - 1) / FPS))
            before, view = view, self.renderer.view(frame / FPS)[1]
            if before is None:
                continue
            pair = reprojection(view, before, *self.size)
            counts = watch.time("masks and counts", lambda p=pair: self.run_masks(p))
            if twin:
                current = {n: self.renderer.read(n) for n in self.channels}
                history = {n: self.renderer.read(n, previous=True) for n in self.channels}
                combos = watch.time("NumPy twin", lambda p=pair, c=current, h=history: self.run_twin(p, c, h))
                differ = int(np.abs(combos - counts.combos.astype(np.int64)).sum())
                if differ > 1e-3 * self.size[0] * self.size[1]:
                    raise SystemExit(f"tools/bench: masks and twin differ in {differ} counts; no timing means anything")

    def release(self) -> None:
        for part in (self.masks, self.shaders, self.renderer, self.renderer.shaders):
            part.release()


@bench
def masks(gpu: Gpu, options: Options) -> Result:
    """Seven frames of a skinned figure: G-buffer, masks with their counts, and the masks' NumPy twin."""
    path = real_scene("khronos/CesiumMan/CesiumMan.glb")
    modes = {mode: MaskBench(gpu, path, mode, options.size) for mode in ("camera", "motion")}
    for subject in modes.values():
        subject.round(Stopwatch(gpu), twin=False)
    memory = peak_rss_mb()  # what an evaluation needs: the twin's float64 arrays come on top
    watches = {mode: Stopwatch(gpu) for mode in modes}
    for _ in range(options.repeats):
        for mode, subject in modes.items():
            subject.round(watches[mode], twin=True)
    held = sum(subject.renderer.bytes for subject in modes.values()) / len(modes)
    for subject in modes.values():
        subject.release()
    gpu.collect()
    size = f"{options.size[0]}x{options.size[1]}"
    rows, notes = [], [f"{path.name}, 7 frames at {FPS:g} fps, {size}; GPU memory {held / 2**20:.0f} MiB",
                       f"peak resident memory before the twin ran, both modes open: {memory:.0f} MiB"]  # fmt: skip
    for mode, watch in watches.items():
        rows += [row(f"{name} ({mode})", samples) for name, samples in watch.samples.items()]
        median = {name: float(np.median(samples)) for name, samples in watch.samples.items()}
        ratio = median["NumPy twin"] / median["masks and counts"]
        frame = median["g-buffer"] + median["masks and counts"]
        notes.append(f"{mode}: twin : masks = {ratio:.1f} x; a frame (g-buffer + masks) takes {frame:.1f} ms")
    return Result("Masks against their NumPy twin", rows, notes)


class _Walk:
    """A walk along Sponza's nave."""

    name = "walk"

    def describe(self) -> str:
        return self.name

    def view_at(self, state) -> View:
        axes = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # looks along -X
        lens = Camera(yfov=0.9, znear=0.05, zfar=200.0)
        return View(np.array([6.0 - 2.0 * state.time, 2.0, 0.3]), axes.T, lens)


@bench
def geometry(gpu: Gpu, options: Options) -> Result:
    """The G-buffer alone, from two channels to eight: what each further channel costs."""
    path = real_scene("sponza/Sponza.gltf")
    scene = load_scene(path)
    camera = _Walk() if path.name.startswith("Sponza") else choose_camera(scene)
    sets = {"2 channels": EIGHT[:2], "5 channels": EIGHT[:5], f"{len(EIGHT)} channels": EIGHT}
    timers = {name: PassTimer(gpu) for name in sets}
    renderers = {n: Renderer(gpu, scene, camera, options.size, c, timer=timers[n]) for n, c in sets.items()}
    for frame in range(7 * options.repeats + 1):
        for renderer in renderers.values():  # interleaved; the first round warms up
            renderer.draw(frame % 7 / FPS, (frame % 7 - 1) / FPS)
    rows = []
    for name, timer in timers.items():
        samples = timer.samples_ms()
        rows.append(row(f"g-buffer, {name}", samples["gbuffer"][1:].tolist()))
        rows.append(row("  pose, deform, records", sum(v[1:] for k, v in samples.items() if k != "gbuffer").tolist()))
    first, last = rows[0].median_ms, rows[-2].median_ms
    held = {name: renderer.bytes / 2**20 for name, renderer in renderers.items()}
    for renderer in renderers.values():
        renderer.release()
        renderer.shaders.release()
    gpu.collect()
    triangles = sum(len(p.triangles) for m in scene.meshes for p in m.primitives)
    memory = ", ".join(f"{name.split()[0]} channels {mib:.0f} MiB" for name, mib in held.items())
    size = f"{options.size[0]}x{options.size[1]}"
    return Result(
        "Geometry pass",
        rows,
        [f"{path.name}, {triangles} triangles, {size}; GPU memory: {memory}", f"8 : 2 channels = {last / first:.1f} x"],
    )


def size_of(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="tools/bench", description="Times the passes and prints tables.")
    parser.add_argument("which", nargs="?", default="all", choices=[*BENCHES, "all", "agreement"])
    parser.add_argument("--size", type=size_of, metavar="WxH", help="default 1920x1080; agreement: 192x108")
    parser.add_argument("--repeats", type=int, default=3, help="rounds of 7 frames after the warm-up (default 3)")
    parser.add_argument("--backend", default="auto")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers with their provenance")
    group = parser.add_argument_group("agreement (needs Blender as a Python module; not part of all)")
    group.add_argument("--out", type=Path, default=ROOT / "out" / "agreement", help="keeps renders (out/agreement)")
    group.add_argument("--scene", default="room", help="of tools/light_scenes.py (default room)")
    group.add_argument("--converged", type=int, default=256, help="samples of the reference (default 256)")
    options = parser.parse_args(arguments)
    console = Console(soft_wrap=True)
    if options.which == "agreement":
        return agreement(console, options)
    options.size = options.size or (1920, 1080)
    gpu = open_gpu(options.backend)
    with gpu:
        told = provenance(gpu, PassTimer.clock)
        console.print(f"{gpu.renderer}, {gpu.backend}; clock: {told['clock']}; {os.cpu_count()} cores; "
                      f"Python {platform.python_version()}, NumPy {np.__version__}", markup=False)  # fmt: skip
        results = {}
        for name in BENCHES if options.which == "all" else [options.which]:
            result = BENCHES[name](gpu, Options(options.size, max(options.repeats, 1)))
            results[name] = asdict(result) | {"peak_rss_mib": peak_rss_mb()}
            show(console, result)
        gpu.check("the benches")
    if options.json is not None:
        report = {"provenance": told, "cores": os.cpu_count(), "benches": results}
        options.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0


def agreement(console: Console, options: argparse.Namespace) -> int:
    """Its own program: it opens a context per evaluation, and its rows have columns of accuracy."""
    from agreement_bench import SIZE, measure
    from agreement_bench import show as show_costs

    costs = measure(options.out, options.scene, options.size or SIZE, options.converged, options.backend)
    show_costs(console, costs)
    if options.json is not None:
        report = {"cores": os.cpu_count(), "benches": {"agreement": asdict(costs)}}
        options.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0


def show(console: Console, result: Result) -> None:
    table = Table(title=result.title, title_justify="left")
    table.add_column("pass")
    for head in ("median ms", "10 %", "90 %", "samples"):
        table.add_column(head, justify="right")
    for r in result.rows:
        table.add_row(r.what, f"{r.median_ms:.2f}", f"{r.low_ms:.2f}", f"{r.high_ms:.2f}", str(r.samples))
    console.print(table)
    for note in (*result.notes, f"peak resident memory of this process so far: {peak_rss_mb():.0f} MiB"):
        console.print(f"  {note}", markup=False, highlight=False)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
