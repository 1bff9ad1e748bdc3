"""Benches beside Cycles at one sample with its data passes: what a path tracer's frame costs at its very cheapest."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from bench_claims import Claim, unmeasured
from benches import FPS, Options, Result, Row, bench, missing, real_scene, row
from mask_benches import Walk

from taubench_gl.animation import CameraTrack, choose_camera
from taubench_gl.datasets.stand_ins import make_stand_in
from taubench_gl.errors import PathTracedError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.gpu.context import Gpu
from taubench_gl.paths import ASSETS
from taubench_gl.pathtraced.blender.job import Quality
from taubench_gl.pathtraced.blender.process import HOW_TO_GET_BPY, blender_version
from taubench_gl.pathtraced.blender.render import read_render, render_reference
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

GEOMETRY = ("frustum", "position", "normal")
OURS = {
    "geometry": {"columns": GEOMETRY},
    "geometry, direct": {"columns": (*GEOMETRY, "direct")},
    "all columns": {},
}
CLAIMED, TARGET = "geometry", 30.0
FRAMES = 2


@bench
def cycles(gpu: Gpu, options: Options) -> Result:
    """Per scene: our frame with masks, with ever more columns, against Cycles' frame at one sample with its passes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        version = blender_version()
        rows: list[Row] = []
        claims: list[Claim] = []
        notes = [
            f"{options.size_text}; ours: frame and masks of every pair, before and after Cycles",
            "Cycles: 1 sample, 12 bounces, all data passes, all cores; its own clock around each render",
        ]
        for label, scene, camera, fps in _scenes(folder, options):
            mine: dict[str, list[float]] = {columns: [] for columns in OURS}
            left_out = {}
            for _ in range(2):
                for columns in OURS:
                    left_out[columns] = _frames(scene, camera, fps, options, columns, mine[columns])
                if version is not None and not any(r.what == f"{label}: Cycles" for r in rows):
                    rows.append(_cycles_row(label, scene, camera, fps, options, folder / label))
            theirs = rows[-1] if version is not None else missing(f"{label}: Cycles", f"no bpy: {HOW_TO_GET_BPY}")
            rows = [r for r in rows if r.what != f"{label}: Cycles"] + [theirs]
            for columns, samples in mine.items():
                note = left_out[columns]
                own = row(f"{label}: ours, {columns}", samples, note)
                ratio = None if theirs.median_ms is None else theirs.median_ms / own.median_ms
                rows.append(Row(own.what, own.median_ms, own.low_ms, own.high_ms, own.samples, note, ratio))
            claims.append(_claim(label, theirs, mine[CLAIMED]))
    title = "A frame beside Cycles at one sample"
    return Result(title, rows, notes, base=-1, unit="times faster than Cycles", claims=tuple(claims))


def _claim(label: str, theirs: Row, mine: list[float]) -> Claim:
    """They cannot be taken frame by frame in turn: the spread is that of our frames beside Cycles' median."""
    what = f"G-buffer and masks of {label}, faster than Cycles' frame of one sample"
    if theirs.median_ms is None:
        return unmeasured(what, ">=", TARGET, "no bpy")
    low, middle, high = (float(theirs.median_ms / ms) for ms in np.percentile(mine, [90, 50, 10]))
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
        path = folder / "valley.glb"
        make_stand_in("eternal-valley-fps", path)
        valley = load_scene(path)
        out.append(("valley stand-in", valley, choose_camera(valley), 60.0))
    return out


def _frames(scene: Scene, camera: CameraTrack, fps: float, options: Options, columns: str, into: list[float]) -> str:
    """Milliseconds of each pair's frame and masks, the first left out; which columns the scene does not call for."""
    seen: list[float] = []
    count = 2 + FRAMES * min(options.repeats, 2)
    settings = Settings.of(width=options.size[0], height=options.size[1], fps=fps, frames=(0, count), **OURS[columns])
    start = time.perf_counter()
    run = evaluate_scene(scene, settings, camera=camera, progress=lambda told: seen.append(told.frame_seconds * 1e3))
    if len(seen) < 2:  # a still scene, seen from its own camera, has one frame
        seen = [(time.perf_counter() - start) * 1e3] * 2
    into += seen[1:]
    null = [c for c in settings.metrics.columns if run.summary["discard"][c]["mean_percent"] is None]
    return f"without {', '.join(null)}: the scene calls for none" if null else ""


def _cycles_row(label: str, scene: Scene, camera: CameraTrack, fps: float, options: Options, folder: Path) -> Row:
    """One sample, so seed and noise do not matter; the second frame on, since the first builds everything."""
    frames = range(1, 2 + FRAMES)
    quality = Quality(samples=1, bounces=12, crisp=True)
    try:
        render_reference(scene, camera, frames, folder, fps=fps, size=options.size, quality=quality)
    except PathTracedError as error:
        return missing(f"{label}: Cycles", str(error))
    times = [1e3 * read_render(folder).frame_seconds[frame] for frame in frames]
    return row(f"{label}: Cycles", times[1:])
