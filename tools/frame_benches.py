"""Benchmarks of whole frames: share of each pass, overlap, read-back, bandwidth, and memory of a long run."""

from __future__ import annotations

import contextlib
import tempfile
from functools import partial
from pathlib import Path

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
    quick,
    ratios,
    real_scene,
    row,
)
from mask_benches import MaskBench, Walk
from peers import Peer

from taubench_gl.animation import CameraTrack, choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.channels import CHANNELS
from taubench_gl.datasets.stand_ins import STAND_INS
from taubench_gl.evaluation import PairEvaluator, open_session
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.read_back import ChannelReader
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

BYTES = {"f4": 4, "f2": 2, "u4": 4, "f1": 1}
GEOMETRY = ("frustum", "position", "normal")


@quick
@bench
def shares(gpu: Gpu, options: Options) -> Result:
    """The share of each pass in a frame, masks included, on simple and complex scenes."""
    rows: list[Row] = []
    notes = [f"{options.size_text}; finish() after every pass; share of the sum of the medians"]
    with tempfile.TemporaryDirectory() as name:
        for label, scene, camera, columns, fps in _cases(Path(name), options):
            given = {} if columns is None else {"columns": columns}
            count = 2 + (2 if options.quick else 4) * options.repeats
            settings = Settings(
                width=options.size[0], height=options.size[1], fps=fps, frames=(0, count), **given, **FIXED_LIGHTING
            )
            with open_session(scene, settings, camera=camera, every=1) as session:
                for _ in session.pairs():
                    pass
            samples = {what: list(ms[1:]) for what, ms in session.timer.samples_ms().items() if len(ms) > 1}
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
        valley = load_scene(STAND_INS["eternal-valley-fps"])
        out.append(("valley stand-in", valley, choose_camera(valley), None, 60.0))
    return out


WAITS, AT_ONCE, LATE = "waits for every pass", "reads each pair's counts at once", "reads counts one pair late"


@bench
def overlap(gpu: Gpu, options: Options) -> Result:
    """A run with finish() after every pass, one that waits for the counts of each pair, and one that does not wait."""
    path = real_scene("khronos/CesiumMan/CesiumMan.glb")
    scene = load_scene(path)
    count = 13
    settings = Settings(
        width=options.size[0],
        height=options.size[1],
        fps=FPS,
        frames=(0, count),
        columns=GEOMETRY,
        reprojection="motion",
        **FIXED_LIGHTING,
    )
    timers = {name: PassTimer(gpu, enabled=name == WAITS) for name in (WAITS, AT_ONCE, LATE)}
    camera = choose_camera(scene)
    watch = Stopwatch(gpu)
    with contextlib.ExitStack() as stack:
        evaluators = {}
        for name, timer in timers.items():
            owner = stack.enter_context(GpuOwner(gpu, timer))
            source = owner.open_source(AnimatedScene(scene, camera), settings, timer=timer)
            evaluators[name] = owner.open_evaluator(source, settings)
            evaluators[name].deferred = name == LATE
        for _ in range(3 * options.repeats + 1):  # many rounds, as the differences are small
            for name, evaluator in evaluators.items():
                watch.time(name, partial(_evaluate, evaluator, count))
    samples = {name: [ms / (count - 1) for ms in watch.samples[name][1:]] for name in timers}
    rows = [row(name, ms) for name, ms in samples.items()]
    notes = [f"{path.name}, {options.size_text}, {count - 1} pairs per run; wall-clock time"]
    for name in (WAITS, AT_ONCE):
        gain, low, high = ratios(samples[name], samples[LATE])
        notes.append(f"{name} : {LATE} = {gain:.3f} x ({low:.3f} to {high:.3f} round by round)")
    return Result("A pair of a run", rows, notes)


def _evaluate(evaluator: PairEvaluator, count: int) -> None:
    """One run of an evaluation over ``count`` frames."""
    evaluator.restart()
    for frame in range(count):
        evaluator.step(frame)
    evaluator.finish()


READS = ("position", "normal", "base_color")


@bench
def readback(gpu: Gpu, options: Options) -> Result:
    """Frames whose images are read back: immediately, and through pixel buffers one frame late."""
    path = real_scene("sponza/Sponza.gltf")
    scene = load_scene(path)
    camera = Walk() if path.stem == "Sponza" else choose_camera(scene)
    settings = Settings(width=options.size[0], height=options.size[1], fps=FPS, columns=GEOMETRY, **FIXED_LIGHTING)
    watch, ways = Stopwatch(gpu), {"at once": False, "pixel buffers, one frame late": True}

    def run(source: RasterSource, reader: ChannelReader) -> None:
        waiting = None
        for frame in range(READ_FRAMES):
            source.advance(frame)
            pending = [reader.start(source.current[name], name) for name in READS]
            for image in waiting or ():
                image.get()
            waiting = pending
        for image in waiting:
            image.get()

    with GpuOwner(gpu) as owner:
        source = owner.open_source(AnimatedScene(scene, camera), settings, extra=READS)
        readers = {name: owner.own(ChannelReader(gpu, buffered=buffered)) for name, buffered in ways.items()}
        for _ in range(options.repeats + 1):
            for name, reader in readers.items():
                watch.time(name, partial(run, source, reader))
    rows = [row(name, [ms / READ_FRAMES for ms in watch.samples[name][1:]]) for name in ways]
    chosen = "pixel buffers" if ChannelReader(gpu).buffered else "at once"
    notes = [f"{path.name}, {options.size_text}, {', '.join(READS)} of every frame; exports here read: {chosen}"]
    return Result("A frame whose images are read", rows, notes)


READ_FRAMES = 5


@bench
def bandwidth(gpu: Gpu, options: Options) -> Result:
    """Bytes that passes must move per second, compared with a copy on the same device."""
    title = "Bytes moved, against the measured copy bandwidth"
    if gpu.software:
        return Result(title, [missing("bandwidth", f"{gpu.renderer} renders in software: its memory is the CPU's")], [])
    pixels = options.size[0] * options.size[1]
    subject = MaskBench(gpu, real_scene("khronos/CesiumMan/CesiumMan.glb"), "motion", options.size)
    watch = Stopwatch(gpu)
    size = 256 << 20
    source, target = gpu.ctx.buffer(reserve=size), gpu.ctx.buffer(reserve=size)
    rounds = 20  # per sample, so that launch overhead is negligible
    history = subject.renderer.history
    for frame in range(1, 2 + 5 * options.repeats):
        subject.renderer.draw(frame / FPS, (frame - 1) / FPS)
        views = subject.renderer.view(frame / FPS)[1], subject.renderer.view((frame - 1) / FPS)[1]
        pair = reprojection(*views, *options.size)
        textures = history.current.textures, history.previous.textures
        watch.time("copy", lambda: [gpu.ctx.copy_buffer(target, source) for _ in range(rounds)])
        run = partial(subject.evaluator.submit, pair, current=textures[0], previous=textures[1])
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
             f"{len(EIGHT)} channels in all; minimum bytes: each texel once"]  # fmt: skip
    return Result(title, rows, notes, base=-1, unit="of copy's rate")


def _bytes(channel: str) -> int:
    return CHANNELS[channel].components * BYTES[CHANNELS[channel].dtype]


STEADY_SECONDS, STEADY_GROWTH = 6.0, 0.05
STEADY = "memory that a run adds after its first quarter, relative to its memory then"


@bench
def steady(gpu: Gpu, options: Options) -> Result:
    """Memory of a run of a stand-in with all columns.  As part of ``all``: half a second.

    Alone (``tools/bench steady``): six seconds, 360 frames at 60 fps.
    """
    seconds = STEADY_SECONDS if options.alone else STEADY_SECONDS / 12
    path = STAND_INS["eternal-valley-fps"]
    run = Peer.start("long_run.py", str(path), *map(str, options.size), str(int(60 * seconds)), "60")
    run.close()
    if run.missing is not None:
        return Result("A long run", [missing("a frame", run.missing)], [])
    resident = run.hello["resident_mib"]
    quarter = len(resident) // 4
    before, after = max(resident[: quarter + 1]), max(resident[quarter:])
    rows = [row("a frame", [run.hello["frame_ms"]], "start included")]
    notes = [
        f"valley stand-in, {len(resident)} pairs, all columns, {options.size_text}, in a separate process; resident "
        f"after a quarter {before:.0f} MiB, at most {after:.0f} MiB later, {resident[-1]:.0f} MiB at the end"
    ]
    claim = Claim(STEADY, "<=", STEADY_GROWTH, after / before - 1, note=f"{len(resident)} pairs of a stand-in")
    return Result("A long run", rows, notes, claims=(claim,))
