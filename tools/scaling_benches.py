"""Benchmarks of scaling: time against pixels, triangles, lights, bones and frames, with a fitted power law."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from benches import FPS, Options, Result, Row, Stopwatch, bench, real_scene, row
from lamp_field import lamp_field
from mask_benches import Walk

from taubench_gl.animation import choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.evaluation import ChannelPair, evaluate_scene
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, quad, skinned, sphere, turn_x
from taubench_gl.scene.model import Scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

SMALL = (320, 180)


def fit(counts: list[float], times: list[float]) -> tuple[float, float]:
    """Exponent k of time = c count^k by least squares of logarithms: over all counts, and over the larger half."""
    x, y = np.log(counts), np.log(times)
    half = len(x) // 2
    return float(np.polyfit(x, y, 1)[0]), float(np.polyfit(x[half:], y[half:], 1)[0])


def scaling(
    title: str, counts: list[int], samples: dict[str, list[list[float]]], unit: str, notes: list[str]
) -> Result:
    """Rows per count and alternative, relative to the smallest count, and the fitted exponents."""
    rows: list[Row] = []
    for what, series in samples.items():
        measured = [row(f"{what}, {count} {unit}", ms) for count, ms in zip(counts, series, strict=True)]
        rows += [
            Row(r.what, r.median_ms, r.low_ms, r.high_ms, r.samples, "", r.median_ms / measured[0].median_ms)
            for r in measured
        ]
        whole, upper = fit(counts, [r.median_ms for r in measured])
        notes = [*notes, f"{what}: time grows as {unit}^{whole:.2f} (larger half: ^{upper:.2f})"]
    return Result(title, rows, notes, base=-1, unit="x smallest")


def interleaved(gpu: Gpu, subjects: list[Callable[[], object]], rounds: int) -> list[list[float]]:
    """Milliseconds of every subject, interleaved; the first round is a warm-up."""
    watch = Stopwatch(gpu)
    for _ in range(rounds + 1):
        for i, subject in enumerate(subjects):
            watch.time(str(i), subject)
    return [watch.samples[str(i)][1:] for i in range(len(subjects))]


class Walker(GpuOwner):
    """Renders the next frame of a scene at every call."""

    def __init__(self, gpu: Gpu, scene: Scene, size: tuple[int, int], channels=("position", "normal"), camera=None):
        super().__init__(gpu)
        self.renderer = self.own(Renderer(self.context, scene, camera or choose_camera(scene), size, channels))
        self._frame = 0

    def __call__(self) -> None:
        self._frame += 1
        frame = self._frame % 7
        self.renderer.draw(frame / FPS, (frame - 1) / FPS)


def interleaved_frames(gpu: Gpu, walkers: list[Walker], rounds: int) -> list[list[float]]:
    """As ``interleaved``; releases the walkers."""
    times = interleaved(gpu, list(walkers), rounds)
    for walker in walkers:
        walker.release()
    return times


@bench
def pixels(gpu: Gpu, options: Options) -> Result:
    """G-buffer and masks against the number of pixels."""
    path = real_scene("sponza/Sponza.gltf")
    scene = load_scene(path)
    camera = Walk() if path.stem == "Sponza" else choose_camera(scene)
    sizes = [(max(options.size[0] // n, 16), max(options.size[1] // n, 9)) for n in (8, 4, 2, 1)]
    walkers = [Walker(gpu, scene, size, camera=camera) for size in sizes]
    owner = GpuOwner(gpu)
    evaluators = [owner.open_evaluator(ChannelPair(size), Settings(**FIXED_LIGHTING)) for size in sizes]

    def mask(i: int) -> Callable[[], object]:
        renderer, history = walkers[i].renderer, walkers[i].renderer.history
        pair = reprojection(renderer.view(1 / FPS)[1], renderer.view(0.0)[1], *sizes[i])
        current, previous = history.current.textures, history.previous.textures
        return lambda: evaluators[i].submit(pair, current=current, previous=previous)

    drawn = interleaved(gpu, list(walkers), 3 * options.repeats)
    masked = interleaved(gpu, [mask(i) for i in range(len(sizes))], 3 * options.repeats)
    for part in (owner, *walkers):
        part.release()
    counts = [w * h for w, h in sizes]
    return scaling("Pixels", counts, {"g-buffer": drawn, "masks": masked}, "pixels", [path.name])


@bench
def triangles(gpu: Gpu, options: Options) -> Result:
    """G-buffer against the number of triangles of a sphere that fills the image."""
    rings = (16, 32, 64, 128, 256)
    subjects, counts = [], []
    for count in rings:
        b = SceneBuilder()
        primitive = sphere(1.0, count)
        b.node(mesh=b.mesh(primitive))
        b.animate(b.camera(translation=(0.0, 0.0, 2.5)), "translation", [0.0, 1.0], [(0, 0, 2.5), (0.2, 0, 2.5)])
        counts.append(len(primitive.triangles))
        subjects.append(Walker(gpu, b.build(), SMALL))
    times = interleaved_frames(gpu, subjects, 5 * options.repeats)
    return scaling("Triangles", counts, {"frame": times}, "triangles", [f"a sphere, {SMALL[0]}x{SMALL[1]}"])


@bench
def lights_growth(gpu: Gpu, options: Options) -> Result:
    """Direct light against the number of lights of a fixed range, without shadows."""
    counts = [16, 64, 256, 1024]
    settings = Settings(
        width=SMALL[0], height=SMALL[1], fps=FPS, columns=("frustum", "direct"), shadow_lights=0, **FIXED_LIGHTING
    )
    timers = [PassTimer(gpu) for _ in counts]
    scenes = [lamp_field(count // 4, count - count // 4, reach=4.0) for count in counts]
    with GpuOwner(gpu) as owner:
        sources = [
            owner.open_source(AnimatedScene(scene), settings, timer=timer)
            for scene, timer in zip(scenes, timers, strict=True)
        ]
        for frame in range(1 + 3 * options.repeats):
            for source in sources:
                source.advance(frame % 7)
    times = [timer.samples_ms()["direct"][1:].tolist() for timer in timers]
    return scaling("Lights", counts, {"direct": times}, "lights", [f"range 4 m, {SMALL[0]}x{SMALL[1]}"])


def banner(bones: int, vertices: int = 4096) -> Scene:
    """A strip with a fixed number of vertices, skinned to a chain of ``bones`` rotating joints."""
    b = SceneBuilder()
    joints, above = [], -1
    for i in range(bones):
        above = b.node(above, translation=(0.0, 0.0 if i == 0 else 2.0 / bones, 0.0))
        b.animate(above, "rotation", [0.0, 1.0], [turn_x(-20.0 / bones), turn_x(20.0 / bones)])
        joints.append(above)
    strip = quad(0.5, 1.0, cells=(1, vertices // 2 - 1), material=b.material(double_sided=True))
    along = (strip.positions[:, 1] + 1.0) * 0.5 * (bones - 1)
    low = np.minimum(along.astype(int), max(bones - 2, 0))
    high = np.minimum(low + 1, bones - 1)
    share = (along - low)[:, None]
    bind = np.tile(np.eye(4), (bones, 1, 1))
    bind[:, 1, 3] = 1.0 - np.arange(bones) * 2.0 / bones
    strip = skinned(strip, np.stack([low, high], axis=1), np.concatenate([1.0 - share, share], axis=1))
    b.node(mesh=b.mesh(strip), skin=b.skin(joints, bind))
    b.camera(translation=(0.0, 1.0, 4.0))
    return b.build()


@bench
def bones(gpu: Gpu, options: Options) -> Result:
    """Posing and deforming against the number of bones, for a fixed number of vertices."""
    counts = [16, 64, 256, 1024]
    subjects = [Walker(gpu, banner(count), SMALL, ("position", "normal", "prev_position")) for count in counts]
    times = interleaved_frames(gpu, subjects, 5 * options.repeats)
    return scaling("Bones", counts, {"frame": times}, "bones", [f"4096 vertices, {SMALL[0]}x{SMALL[1]}"])


@bench
def frames(gpu: Gpu, options: Options) -> Result:
    """A whole run against its number of frames, start-up included."""
    scene = load_scene(ASSETS / "demo.glb")
    counts = [4, 8, 16, 32]
    times: list[list[float]] = [[] for _ in counts]
    for turn in range(options.repeats + 1):
        for count, into in zip(counts, times, strict=True):
            settings = Settings(
                width=192,
                height=108,
                frames=(0, count + 1),
                columns=("frustum", "position", "normal"),
                **FIXED_LIGHTING,
            )
            start = time.perf_counter()
            evaluate_scene(scene, settings)
            if turn:
                into.append((time.perf_counter() - start) * 1e3)
    medians = [float(np.median(ms)) for ms in times]
    slope, start = np.polyfit(counts, medians, 1)
    notes = [f"demo.glb, 192x108; start-up takes as long as {start / slope:.1f} pairs"]
    return scaling("Frames", counts, {"run": times}, "pairs", notes)
