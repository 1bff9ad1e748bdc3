"""Benchmark against Cycles at one sample with its data passes, the fastest frame of a path tracer."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from benches import FPS, Claim, Options, Result, Row, bench, missing, real_scene, row, unmeasured
from mask_benches import Walk

from taubench_gl.animation import CameraTrack, choose_camera
from taubench_gl.datasets.stand_ins import STAND_INS
from taubench_gl.errors import PathTracedError
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.gpu.context import Gpu
from taubench_gl.paths import ASSETS
from taubench_gl.pathtraced.blender.job import Quality
from taubench_gl.pathtraced.blender.process import HOW_TO_GET_BPY, blender_version
from taubench_gl.pathtraced.blender.render import read_render, render_reference
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

GEOMETRY = ("frustum", "position", "normal")
RASTERIZED = {
    "geometry": {"columns": GEOMETRY},
    "geometry, direct": {"columns": (*GEOMETRY, "direct")},
    "all columns": {},
}
CLAIMED, TARGET = "geometry", 30.0
FRAMES = 2


@bench
def cycles(gpu: Gpu, options: Options) -> Result:
    """Per scene: a rasterized frame with masks, for growing sets of columns, against a Cycles frame of one sample."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        version = blender_version()
        rows: list[Row] = []
        claims: list[Claim] = []
        notes = [
            f"{options.size_text}; rasterizer: frame and masks of every pair, before and after Cycles",
            "Cycles: 1 sample, 12 bounces, all data passes, all cores; Blender's clock around each render",
        ]
        for label, scene, camera, fps in _scenes(folder, options):
            rasterized: dict[str, list[float]] = {columns: [] for columns in RASTERIZED}
            notes_of = {}
            for _ in range(2):
                for columns in RASTERIZED:
                    notes_of[columns] = _frames(scene, camera, fps, options, columns, rasterized[columns])
                if version is not None and not any(r.what == f"{label}: Cycles" for r in rows):
                    rows.append(_cycles_row(label, scene, camera, fps, options, folder / label))
            traced = rows[-1] if version is not None else missing(f"{label}: Cycles", f"no bpy: {HOW_TO_GET_BPY}")
            rows = [r for r in rows if r.what != f"{label}: Cycles"] + [traced]
            for columns, samples in rasterized.items():
                note = notes_of[columns]
                own = row(f"{label}: rasterizer, {columns}", samples, note)
                ratio = None if traced.median_ms is None else traced.median_ms / own.median_ms
                rows.append(Row(own.what, own.median_ms, own.low_ms, own.high_ms, own.samples, note, ratio))
            claims.append(_claim(label, traced, rasterized[CLAIMED]))
    title = "A frame against Cycles at one sample"
    return Result(title, rows, notes, base=-1, unit="times faster than Cycles", claims=tuple(claims))


def _claim(label: str, traced: Row, rasterized: list[float]) -> Claim:
    """Frames of both cannot be timed in turn: the interval is that of the rasterizer against Cycles' median."""
    what = f"G-buffer and masks of {label}, faster than Cycles' frame of one sample"
    if traced.median_ms is None:
        return unmeasured(what, ">=", TARGET, "no bpy")
    low, middle, high = (float(traced.median_ms / ms) for ms in np.percentile(rasterized, [90, 50, 10]))
    return Claim(what, ">=", TARGET, middle, low, high)


def _scenes(folder: Path, options: Options) -> list[tuple[str, Scene, CameraTrack, float]]:
    """Label, scene, camera and frame rate."""
    sponza = real_scene("sponza/Sponza.gltf")
    out = []
    if sponza.name.startswith("Sponza"):
        out.append(("Sponza", load_scene(sponza), Walk(), FPS))
    demo = load_scene(ASSETS / "demo.glb")
    out.append(("demo", demo, choose_camera(demo), FPS))
    if not options.quick:
        valley = load_scene(STAND_INS["eternal-valley-fps"])
        out.append(("valley stand-in", valley, choose_camera(valley), 60.0))
    return out


def _frames(scene: Scene, camera: CameraTrack, fps: float, options: Options, columns: str, into: list[float]) -> str:
    """Append the time of each pair but the first (frame and masks, ms) to ``into``; returns a note on null columns."""
    times: list[float] = []
    count = 2 + FRAMES * min(options.repeats, 2)
    width, height = options.size
    settings = Settings(width=width, height=height, fps=fps, frames=(0, count), **RASTERIZED[columns], **FIXED_LIGHTING)
    start = time.perf_counter()
    observers = Observers(progress=lambda step: times.append(step.frame_seconds * 1e3))
    run = evaluate_scene(scene, settings, observers, camera=camera)
    if len(times) < 2:  # a static scene with its own camera has one frame
        times = [(time.perf_counter() - start) * 1e3] * 2
    into += times[1:]
    null = [c for c in settings.metrics.columns if run.summary["discard"][c]["mean_percent"] is None]
    return f"without {', '.join(null)}: the scene does not have them" if null else ""


def _cycles_row(label: str, scene: Scene, camera: CameraTrack, fps: float, options: Options, folder: Path) -> Row:
    """Times from the second frame on: the first one includes setup."""
    frames = range(1, 2 + FRAMES)
    quality = Quality(samples=1, bounces=12, crisp=True)
    try:
        render_reference(scene, camera, frames, folder, fps=fps, size=options.size, quality=quality)
    except PathTracedError as error:
        return missing(f"{label}: Cycles", str(error))
    times = [1e3 * read_render(folder).frame_seconds[str(frame)] for frame in frames]
    return row(f"{label}: Cycles", times[1:])
