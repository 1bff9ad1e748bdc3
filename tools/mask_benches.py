"""Benchmarks of the mask pass, compared with NumPy, Numba and PyTorch, and of the geometry pass."""

from __future__ import annotations

import importlib.util

import numpy as np
from benches import (
    EIGHT,
    FPS,
    Claim,
    Options,
    Result,
    Row,
    Stopwatch,
    bench,
    missing,
    peak_rss_mb,
    quick,
    ratios,
    real_scene,
    row,
    unmeasured,
)
from peers import Peer, torch_python

from taubench_gl.animation import choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.animation.state import View
from taubench_gl.conventions import Reason
from taubench_gl.evaluation import ChannelPair
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.counts import Counts
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera
from taubench_gl.settings import FIXED_LIGHTING, Settings

HAS_NUMBA = importlib.util.find_spec("numba") is not None
NO_NUMBA = "numba is not installed"


class MaskBench(GpuOwner):
    """One scene and reprojection mode: renders pairs and computes their masks on the GPU and with the peers."""

    def __init__(self, gpu: Gpu, path, mode: str, size: tuple[int, int], torch: Peer | None = None):
        super().__init__(gpu)
        scene = load_scene(path)
        self.mode, self.size = mode, size
        self.channels = ("position", "normal", "prev_position") if mode == "motion" else ("position", "normal")
        self.renderer = self.own(Renderer(self.context, scene, choose_camera(scene), size, self.channels))
        self.evaluator = self.open_evaluator(ChannelPair(size, reprojection=mode), Settings(**FIXED_LIGHTING))
        self.thresholds = Settings().metrics.thresholds
        self.torch = torch

    def run_masks(self, pair: Reprojection) -> Counts:
        history = self.renderer.history
        run = self.evaluator.submit(pair, current=history.current.textures, previous=history.previous.textures)
        return self.evaluator.read(run)

    def run_numpy(self, pair: Reprojection, current: dict, history: dict) -> np.ndarray:
        return pair_masks(current, history, pair, self.thresholds, reprojection=self.mode).mask_histogram()

    def run_numba(self, pair: Reprojection, current: dict, history: dict) -> np.ndarray:
        from numba_masks import numba_masks

        return numba_masks(current, history, pair, self.thresholds, reprojection=self.mode)[0]

    def round(self, watch: Stopwatch, *, frames: int = 7, peers_every: int = 0) -> None:
        """Evaluate ``frames`` - 1 pairs; the peers, which are slow, every ``peers_every``-th pair (0: never)."""
        view = None
        for frame in range(frames):
            watch.time("g-buffer", lambda f=frame: self.renderer.draw(f / FPS, (f - 1) / FPS))
            before, view = view, self.renderer.view(frame / FPS)[1]
            if before is None:
                continue
            pair = reprojection(view, before, *self.size)
            counts = watch.time("masks and counts", lambda p=pair: self.run_masks(p))
            if peers_every and frame % peers_every == 1 % peers_every:
                self._run_peers(watch, pair, counts)

    def _run_peers(self, watch: Stopwatch, pair: Reprojection, counts: Counts) -> None:
        current = {n: self.renderer.read(n) for n in self.channels}
        history = {n: self.renderer.read(n, previous=True) for n in self.channels}
        self._compare("NumPy", watch.time("NumPy", lambda: self.run_numpy(pair, current, history)), counts)
        if HAS_NUMBA:
            self._compare("Numba", watch.time("Numba", lambda: self.run_numba(pair, current, history)), counts)
        if self.torch is not None:
            bits = {bit.name: int(bit) for bit in Reason}
            answer = self.torch.ask(current=current, history=history, pair=pair, thresholds=self.thresholds, bits=bits)
            self._compare("PyTorch", answer["mask_histogram"], counts)
            watch.samples["PyTorch"].append(answer["ms"])

    def _compare(self, name: str, mask_histogram: np.ndarray, counts: Counts) -> None:
        """Stop if the counts differ by more than the rounding of float32 at thresholds explains."""
        differ = int(np.abs(mask_histogram - counts.mask_histogram.astype(np.int64)).sum())
        if differ > 1e-3 * self.size[0] * self.size[1]:
            raise SystemExit(f"tools/bench: masks and {name} differ in {differ} counts")


@quick
@bench
def masks(gpu: Gpu, options: Options) -> Result:
    """Masks and counts of seven frames of a skinned figure, on the GPU and in NumPy, Numba and PyTorch."""
    path = real_scene("khronos/CesiumMan/CesiumMan.glb")
    torch = Peer.start("torch_masks.py", python=torch_python())
    modes = {
        mode: MaskBench(gpu, path, mode, options.size, torch if mode == "camera" and torch.missing is None else None)
        for mode in ("camera", "motion")
    }
    for subject in modes.values():
        subject.round(Stopwatch(gpu))
    memory = peak_rss_mb()  # of an evaluation, without the float64 arrays of the reference
    for subject in modes.values():
        subject.round(Stopwatch(gpu), frames=2, peers_every=1)  # compiles the Numba code
    watches = {mode: Stopwatch(gpu) for mode in modes}
    for _ in range(options.repeats):
        for mode, subject in modes.items():
            subject.round(watches[mode], peers_every=2)
    held = sum(subject.renderer.bytes for subject in modes.values()) / len(modes)
    for subject in modes.values():
        subject.release()
    torch.close()
    gpu.collect()
    rows, notes = (
        [],
        [
            f"{path.name}, 7 frames at {FPS:g} fps, {options.size_text}; GPU memory {held / 2**20:.0f} MiB",
            f"peak resident memory before the peers ran, both modes open: {memory:.0f} MiB",
            "all counts agree except for pixels within rounding of a threshold",
            "NumPy is the float64 reference, timed without histograms; the others use float32 or float64",
        ],
    )
    for mode, watch in watches.items():
        own = [row(f"{name} ({mode})", watch.samples[name]) for name in ("masks and counts", "g-buffer")]
        peers = [row(f"{n} ({mode})", watch.samples[n]) for n in ("NumPy", "Numba", "PyTorch") if watch.samples.get(n)]
        rows += [_relative(r, own[0]) for r in (*own, *peers)]
        ratio, frame = watch.median("NumPy") / own[0].median_ms, own[0].median_ms + own[1].median_ms
        notes.append(f"{mode}: NumPy / masks = {ratio:.1f} x; a frame (g-buffer + masks) takes {frame:.1f} ms")
    if not HAS_NUMBA:
        rows.append(missing("Numba", NO_NUMBA))
    if torch.missing is not None:
        rows.append(missing("PyTorch grid_sample", torch.missing))
    claims = [_claim(mode, peer, target, watch) for mode, watch in watches.items()
              for peer, target in (("NumPy", 5.0), ("Numba", 1.0))]  # fmt: skip
    return Result("Masks against NumPy, Numba and PyTorch", rows, notes, base=-1, unit="x masks", claims=tuple(claims))


def _claim(mode: str, peer: str, target: float, watch: Stopwatch) -> Claim:
    what = f"masks and counts, {mode} reprojection, faster than {peer}"
    if not watch.samples.get(peer):
        return unmeasured(what, ">=", target, NO_NUMBA)
    own = watch.samples["masks and counts"][:: len(watch.samples["masks and counts"]) // len(watch.samples[peer])]
    return Claim(what, ">=", target, *ratios(watch.samples[peer], own))


def _relative(r: Row, base: Row) -> Row:
    return Row(r.what, r.median_ms, r.low_ms, r.high_ms, r.samples, r.note, r.median_ms / base.median_ms)


class Walk:
    """A camera that moves along the nave of Sponza."""

    name = "walk"
    lens = Camera(yfov=0.9, znear=0.05, zfar=200.0)

    def describe(self) -> str:
        return self.name

    def view_at(self, state) -> View:
        axes = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # looks along -X
        return View(np.array([6.0 - 2.0 * state.time, 2.0, 0.3]), axes.T, self.lens)


@bench
def geometry(gpu: Gpu, options: Options) -> Result:
    """The G-buffer with two, five and eight channels."""
    path = real_scene("sponza/Sponza.gltf")
    scene = load_scene(path)
    camera = Walk() if path.name.startswith("Sponza") else choose_camera(scene)
    sets = {"2 channels": EIGHT[:2], "5 channels": EIGHT[:5], f"{len(EIGHT)} channels": EIGHT}
    timers = {name: PassTimer(gpu) for name in sets}
    renderers = {n: Renderer(GpuContext(gpu, timer=timers[n]), scene, camera, options.size, c) for n, c in sets.items()}
    for frame in range(7 * options.repeats + 1):
        for renderer in renderers.values():  # interleaved; the first round is a warm-up
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
        renderer.context.release()
    gpu.collect()
    triangles = sum(len(p.triangles) for m in scene.meshes for p in m.primitives)
    memory = ", ".join(f"{name.split()[0]} channels {mib:.0f} MiB" for name, mib in held.items())
    note = f"{path.name}, {triangles} triangles, {options.size_text}; GPU memory: {memory}"
    return Result("Geometry pass", rows, [note, f"8 / 2 channels = {last / first:.1f} x"], unit="x 2 channels")
