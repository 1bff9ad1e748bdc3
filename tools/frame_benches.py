"""Benches of whole frames: what each pass's share is, what not waiting gains, and how near to the memory's speed."""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from benches import EIGHT, FPS, Options, Result, Row, Stopwatch, bench, missing, quick, real_scene, row
from mask_benches import MaskBench, Walk

from taubench_gl.animation import CameraTrack, choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.channels import CHANNELS
from taubench_gl.datasets.stand_ins import make_stand_in
from taubench_gl.evaluation import count_pairs
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

BYTES = {"f4": 4, "f2": 2, "u4": 4, "f1": 1}
GEOMETRY = ("frustum", "position", "normal")


@quick
@bench
def shares(gpu: Gpu, options: Options) -> Result:
    """Each pass's share of a frame, masks included, on scenes that need little and much."""
    rows: list[Row] = []
    notes = [f"{options.size_text}; every pass waited for; share of the sum of the passes' medians"]
    with tempfile.TemporaryDirectory() as name:
        for label, scene, camera, columns, fps in _cases(Path(name), options):
            timer = PassTimer(gpu)
            given = {} if columns is None else {"columns": columns}
            count = 2 + (2 if options.quick else 4) * options.repeats
            settings = Settings(width=options.size[0], height=options.size[1], fps=fps, frames=(0, count), **given)
            source = RasterSource(gpu, scene, camera, settings, timer=timer)
            count_pairs(gpu, source, range(count), settings, label, timer)
            source.release()
            gpu.collect()
            samples = {what: list(ms[1:]) for what, ms in timer.samples_ms().items() if len(ms) > 1}
            whole = sum(float(np.median(ms)) for ms in samples.values())
            for what, ms in samples.items():
                r = row(f"{label}: {what}", ms)
                rows.append(Row(r.what, r.median_ms, r.low_ms, r.high_ms, r.samples, "", 100.0 * r.median_ms / whole))
            notes.append(f"{label}: {'geometry columns' if columns else 'all columns'}")
    return Result("Shares of a frame", rows, notes, base=-1, unit="share %")


def _cases(folder: Path, options: Options) -> list[tuple[str, Scene, CameraTrack, tuple[str, ...] | None, float]]:
    out = []
    for file in ("sponza/Sponza.gltf", "khronos/CesiumMan/CesiumMan.glb"):
        path = real_scene(file)
        scene = load_scene(path)
        out.append((path.stem, scene, Walk() if path.stem == "Sponza" else choose_camera(scene), GEOMETRY, FPS))
    demo = load_scene(ASSETS / "demo.glb")
    out.append(("demo", demo, choose_camera(demo), None, FPS))
    if not options.quick:
        path = folder / "valley.glb"
        make_stand_in("eternal-valley-fps", path)
        valley = load_scene(path)
        out.append(("valley stand-in", valley, choose_camera(valley), None, 60.0))
    return out


@bench
def overlap(gpu: Gpu, options: Options) -> Result:
    """A run of frames in which every pass is waited for, as if all were timed, against one that runs ahead."""
    path = real_scene("khronos/CesiumMan/CesiumMan.glb")
    scene = load_scene(path)
    camera = choose_camera(scene)
    count = 13
    settings = Settings(
        width=options.size[0],
        height=options.size[1],
        fps=FPS,
        frames=(0, count),
        columns=GEOMETRY,
        reprojection="motion",
    )
    ways = {"waits for every pass": True, "runs ahead": False}
    samples: dict[str, list[float]] = {name: [] for name in ways}
    for turn in range(options.repeats + 1):
        for name, waits in ways.items():
            timer = PassTimer(gpu, enabled=waits)
            source = RasterSource(gpu, scene, camera, settings, timer=timer)
            source.advance(0)  # compiles
            gpu.finish()
            start = time.perf_counter()
            count_pairs(gpu, source, range(count), settings, name, timer)
            if turn:
                samples[name].append((time.perf_counter() - start) * 1e3 / (count - 1))
            source.release()
    gpu.collect()
    rows = [row(name, ms) for name, ms in samples.items()]
    return Result("A pair of a run", rows, [f"{path.name}, {options.size_text}, {count - 1} pairs a run"])


@bench
def bandwidth(gpu: Gpu, options: Options) -> Result:
    """Bytes that passes must move over their time, against what a plain copy moves on the same device."""
    title = "Bytes moved, against the measured copy bandwidth"
    if gpu.software:
        return Result(title, [missing("bandwidth", f"{gpu.renderer} renders in software: its memory is the CPU's")], [])
    pixels = options.size[0] * options.size[1]
    subject = MaskBench(gpu, real_scene("khronos/CesiumMan/CesiumMan.glb"), "motion", options.size)
    watch = Stopwatch(gpu)
    size = 256 << 20
    source, target = gpu.ctx.buffer(reserve=size), gpu.ctx.buffer(reserve=size)
    rounds = 20  # within one sample, so that starting it does not count
    history = subject.renderer.history
    for frame in range(1, 2 + 5 * options.repeats):
        subject.renderer.draw(frame / FPS, (frame - 1) / FPS)
        views = subject.renderer.view(frame / FPS)[1], subject.renderer.view((frame - 1) / FPS)[1]
        pair = reprojection(*views, *options.size)
        textures = history.current.textures, history.previous.textures
        watch.time("copy", lambda: [gpu.ctx.copy_buffer(target, source) for _ in range(rounds)])
        run = partial(subject.masks.run, pair, subject.thresholds, *textures)
        watch.time("masks", lambda r=run: [r() for _ in range(rounds)])
        watch.time("clear", lambda: [history.current.clear() for _ in range(rounds)])
    source.release()
    target.release()
    read = sum(_bytes(n) for n in subject.channels) + sum(_bytes(n) for n in ("position", "normal"))
    moved = {"copy": 2 * size, "masks": pixels * read, "clear": pixels * (4 + sum(_bytes(n) for n in subject.channels))}
    subject.release()
    rate = {name: moved[name] * rounds / (watch.median(name) * 1e-3) for name in moved}
    rows = []
    for name in moved:
        r = row(f"{name}, {rounds} times", watch.samples[name][1:], f"{moved[name] / 2**20:.0f} MiB each")
        rows.append(Row(r.what, r.median_ms, r.low_ms, r.high_ms, r.samples, r.note, rate[name] / rate["copy"]))
    notes = [f"{options.size_text}; a copy reads and writes 256 MiB: {rate['copy'] / 1e9:.0f} GB/s",
             f"{len(EIGHT)} channels in all; least bytes: each texel once, nothing for what caches miss"]  # fmt: skip
    return Result(title, rows, notes, base=-1, unit="of copy's rate")


def _bytes(channel: str) -> int:
    return CHANNELS[channel].components * BYTES[CHANNELS[channel].dtype]
