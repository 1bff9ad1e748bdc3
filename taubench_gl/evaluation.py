"""The main job: frames of a scene -> masks of every pair -> statistics -> Run.

``evaluate_scene`` is the whole road on one page.  Pictures, tables and plots are views of what it returns and of the
pairs it shows to ``on_pair``; ``taubench_gl.api.evaluate`` adds them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, FileCamera, OrbitCamera, Poser, View, choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import COLUMNS, FEATURES, SUMMARY_SCHEMA
from taubench_gl.effects.census import census
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.frame.passes.masks import MaskPass
from taubench_gl.frame.sources import RasterSource, Source
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.activity import camera_activity, summarize
from taubench_gl.metrics.cuts import detect_cuts
from taubench_gl.provenance import provenance
from taubench_gl.run import FRAME_COLUMNS, Progress, Run, RunWriter
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

STILL_ORBIT_SECONDS = 2.0
"""What a still scene lasts, seen from the framing orbit or a caller's camera; seen from its own, it has one frame."""


@dataclass(frozen=True, slots=True)
class Pair:
    """One finished pair, while its images are still on the GPU."""

    frame: int
    row: dict[str, Any]
    view: View
    source: Source
    _masks: MaskPass

    def mask(self) -> np.ndarray:
        """Reason words, (h, w) uint32, row 0 at the top."""
        return read_channel(self._masks.mask, "mask")[..., 0]

    def motion(self) -> np.ndarray:
        """Previous - current, pixels, +x right, +y down.  (h, w, 2) float32; 0 where behind."""
        return read_channel(self._masks.motion, "motion")


def evaluate_scene(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_pair: Callable[[Pair], None] | None = None,
    channels: tuple[str, ...] = (),
    camera: CameraTrack | None = None,
) -> Run:
    """Evaluate every frame pair of one scene.

    ``out`` receives frames.csv row by row and summary.json at the end.  ``on_pair`` sees each pair; ``channels`` are
    extra channels it wants drawn; ``camera`` takes the place of ``settings.camera``.  Raises TaubenchError for
    everything a user can cause.
    """
    settings = settings or Settings()
    if not isinstance(scene, Scene):
        scene = load_scene(scene, scene=settings.scene, animation=settings.animation)
    camera = camera or choose_camera(scene, settings.camera)
    frames = frame_range(scene, camera, settings)
    if not _draws_anything(scene):
        raise SceneError("no mesh with triangles to draw", where=str(scene.path or scene.name), hint=_what_is_in(scene))
    if out is None:
        return _run(scene, camera, frames, settings, None, progress, on_pair, channels)
    with RunWriter(out, FRAME_COLUMNS) as writer:
        return _run(scene, camera, frames, settings, writer, progress, on_pair, channels)


def frame_range(scene: Scene, camera: CameraTrack, settings: Settings) -> range:
    """Frame numbers of the evaluation.  Raises SettingsError for a slice that leaves none."""
    duration = scene.duration
    if duration == 0 and not isinstance(camera, FileCamera):
        duration = STILL_ORBIT_SECONDS
    frames = settings.frame_range(duration)
    if not frames:
        count = settings.frame_count(duration)
        first, stop = settings.frames
        given = f"{'' if first is None else first}:{'' if stop is None else stop}"
        raise SettingsError(f"frames {given} of {count} frames are none", hint=f"choose within 0:{count}")
    return frames


def _run(
    scene: Scene,
    camera: CameraTrack,
    frames: range,
    settings: Settings,
    writer: RunWriter | None,
    progress: Callable[[Progress], None] | None,
    on_pair: Callable[[Pair], None] | None,
    extra: tuple[str, ...],
) -> Run:
    gpu = open_gpu(settings.backend, settings.device)
    with gpu:
        timer, poser = PassTimer(gpu), Poser(scene)
        source = RasterSource(gpu, scene, camera, settings, extra=extra, timer=timer, poser=poser)
        try:
            rows, views, stats = count_pairs(
                gpu, source, frames, settings, scene.name, timer, writer, progress, on_pair
            )
            gpu.check("evaluation")
            summary = _summary(scene, camera, frames, settings, views, stats, poser)
            told = source.describe()
            summary["notes"] += told.pop("notes")
            summary |= told
        finally:
            source.release()
            gpu.collect()
        summary["timing"] = {"clock": timer.clock, "unit": "ms", "passes": timer.median_ms()}
        summary["provenance"] = provenance(gpu, timer.clock)
    _mark_cuts(rows, summary)
    if writer is not None:
        writer.rewrite_rows(rows)
        writer.write_summary(summary)
    return Run(summary, rows, None if writer is None else writer.out)


def count_pairs(
    gpu: Gpu,
    source: Source,
    frames: range,
    settings: Settings,
    name: str,
    timer: PassTimer,
    writer: RunWriter | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_pair: Callable[[Pair], None] | None = None,
) -> tuple[list[dict[str, Any]], list[View], SequenceStats]:
    """Masks and counts of every pair of a source: rows of frames.csv, views of all frames, sums over all pairs."""
    thresholds = {f: settings.threshold(f) for f in FEATURES}
    stats = SequenceStats(tuple(c for c in COLUMNS if c not in source.unmeasured), dict(source.unmeasured))
    shaders = ShaderCache(gpu.ctx)
    masks = MaskPass(
        gpu,
        shaders,
        source.size,
        reprojection=source.reprojection,
        sampling=settings.sampling,
        radiance=source.radiance,
        write_mask=on_pair is not None,
        write_motion=on_pair is not None,
    )
    rows: list[dict[str, Any]] = []
    views: list[View] = []
    try:
        for done, frame in enumerate(frames):
            started = time.perf_counter()
            views.append(source.advance(frame))
            if done == 0:
                continue
            with timer.measure("masks"):
                pair = reprojection(views[-1], views[-2], *source.size)
                masks.run(pair, thresholds, source.current, source.previous, exposure=settings.exposure)
                counts = stats.add(masks.read())
            rows.append({"frame": frame, "time_s": frame / settings.fps, **counts, **_camera_row(views[-2:])})
            if writer is not None:
                writer.write_row(rows[-1])
            if on_pair is not None:
                on_pair(Pair(frame, rows[-1], views[-1], source, masks))
            if progress is not None:
                progress(Progress(name, done, len(frames) - 1, time.perf_counter() - started))
    finally:
        masks.release()
        shaders.release()
    return rows, views, stats


def _summary(
    scene: Scene,
    camera: CameraTrack,
    frames: range,
    settings: Settings,
    views: list[View],
    stats: SequenceStats,
    poser: Poser,
) -> dict[str, Any]:
    """summary.json of SPEC section 6 (effects, timing and provenance are added by the caller)."""
    positions = np.array([v.position for v in views]).reshape(-1, 3)
    rotations = np.array([v.world_from_view for v in views]).reshape(-1, 3, 3)
    activity = camera_activity(positions, rotations)
    cuts = detect_cuts(activity, settings.unit_scale)
    counted = census(scene, (f / settings.fps for f in frames), poser)
    notes = [str(note) for note in scene.notes]
    if isinstance(camera, OrbitCamera):
        notes.insert(0, f"the camera is a {camera.describe()}")
    return {
        "schema": SUMMARY_SCHEMA,
        "scene": {
            "name": scene.name,
            "path": None if scene.path is None else str(scene.path),
            "sha256": scene.sha256,
            "duration_s": scene.duration,
            "playing": list(scene.playing),
            "stand_in": scene.stand_in,
        },
        "settings": settings.as_summary(frames),
        "pairs": stats.pairs,
        "census": counted,
        "camera": summarize(activity, cuts, settings.fps, frames[0]) | {"source": camera.describe()},
        "discard": stats.discard(cuts),
        "classes": stats.classes(),
        "curves": stats.curves(),
        "notes": notes,
    }


def _camera_row(views: list[View]) -> dict[str, Any]:
    activity = camera_activity(np.array([v.position for v in views]), np.array([v.world_from_view for v in views]))
    return {
        "translation_m": float(activity.position[0]),
        "yaw_deg": float(activity.yaw[0]),
        "pitch_deg": float(activity.pitch[0]),
        "roll_deg": float(activity.roll[0]),
        "angle_deg": float(activity.angle[0]),
        "gimbal": bool(activity.gimbal[0]),
    }


def _mark_cuts(rows: list[dict[str, Any]], summary: dict[str, Any]) -> None:
    """A cut shows only against the pairs around it, so this column is filled in at the end."""
    cuts = set(summary["camera"]["cuts"])
    for row in rows:
        row["camera_cut"] = row["frame"] in cuts


def _draws_anything(scene: Scene) -> bool:
    return any(len(p.triangles) for n in scene.mesh_nodes for p in scene.meshes[scene.nodes.mesh[n]].primitives)


def _what_is_in(scene: Scene) -> str:
    if len(scene.mesh_nodes):
        return "its meshes hold only points or lines"
    return (
        f"it has {len(scene.nodes)} nodes, {len(scene.cameras)} cameras, {len(scene.lights)} lights and no mesh in use"
    )
