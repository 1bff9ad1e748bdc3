"""The main job: frames of a scene -> masks of every pair -> statistics -> Run.

``evaluate_scene`` is the whole road on one page.  Pictures, tables and plots are views of what it returns and of the
pairs it shows to ``on_pair``; ``taubench_gl.api.evaluate`` adds them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
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
from taubench_gl.frame.passes.masks import Counts, MaskPass
from taubench_gl.frame.sources import RasterSource, Source
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.activity import camera_activity, summarize
from taubench_gl.metrics.cuts import detect_cuts
from taubench_gl.metrics.pair_sample import PairSample, draw_sample, estimate
from taubench_gl.provenance import provenance
from taubench_gl.run import FRAME_COLUMNS, Progress, Run, RunWriter
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

STILL_ORBIT_SECONDS = 2.0
"""What a still scene lasts, seen from the framing orbit or a caller's camera; seen from its own, it has one frame."""

TIMED_FIRST, TIMED_EVERY = 16, 16
"""Passes of these frames are timed, which keeps the CPU from working ahead of the GPU; all others overlap."""


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
    require_triangles(scene)
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
        timer, poser = PassTimer(gpu, first=TIMED_FIRST, every=TIMED_EVERY), Poser(scene)
        source = RasterSource(gpu, scene, camera, settings, extra=extra, timer=timer, poser=poser)
        try:
            rows, views, stats = count_pairs(
                gpu, source, frames, settings, scene.name, timer, writer, progress, on_pair
            )
            gpu.check("evaluation")
            if settings.pairs != "all":  # the camera's activity is that of all frames, drawn or not
                views = [camera.view_at(poser.sample(frame / settings.fps)) for frame in frames]
            facts = scene_facts(scene, camera, frames, settings, poser)
            summary = assemble_summary(facts, frames, settings, views, stats)
            told = source.describe()
            summary["notes"] += told.pop("notes")
            summary |= told
        finally:
            source.release()
            gpu.collect()
        summary["timing"] = timer.summary()
        summary["provenance"] = provenance(gpu, timer.clock)
    mark_cuts(rows, summary)
    if writer is not None:
        writer.rewrite_rows(rows)
        writer.write_summary(summary)
    return Run(summary, rows, None if writer is None else writer.out)


def sampled_pairs(frames: range, settings: Settings) -> PairSample:
    """Which of the pairs of ``frames`` the settings look at; position p is the pair (frames[p], frames[p + 1])."""
    return draw_sample(max(len(frames) - 1, 0), *settings.pair_scheme)


def frame_schedule(frames: range, sample: PairSample) -> list[tuple[int, bool]]:
    """Frames to draw, in order, and whether each is judged against the one drawn before it."""
    if not sample.positions:
        return [(frame, False) for frame in frames]
    return pair_schedule(frames, sample.positions)


def pair_schedule(frames: range, positions: Sequence[int]) -> list[tuple[int, bool]]:
    """``frame_schedule`` of these pairs alone: ``positions`` as in ``sampled_pairs``, ascending."""
    drawn: dict[int, bool] = {}
    for position in positions:
        drawn.setdefault(frames[position], False)
        drawn[frames[position + 1]] = True
    return list(drawn.items())


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
    *,
    schedule: list[tuple[int, bool]] | None = None,
    keep: list[Counts] | None = None,
) -> tuple[list[dict[str, Any]], list[View], SequenceStats]:
    """Masks and counts of every pair of a source: rows of frames.csv, views of all frames, sums over all pairs.

    ``schedule``: only these frames (as ``pair_schedule``); ``keep`` takes the exact counts of each pair.
    """
    thresholds = {f: settings.threshold(f) for f in FEATURES}
    measured = tuple(c for c in COLUMNS if c not in source.unmeasured)
    bits = settings.histogram_bits
    stats = SequenceStats(measured, dict(source.unmeasured), summation=settings.summation, histogram_bits=bits)
    shaders = ShaderCache(gpu.ctx)
    masks = MaskPass(
        gpu,
        shaders,
        source.size,
        reprojection=source.reprojection,
        sampling=settings.sampling,
        radiance=source.radiance,
        cuts=source.cuts,
        write_mask=on_pair is not None,
        write_motion=on_pair is not None,
        histogram_bits=bits,
    )
    rows: list[dict[str, Any]] = []
    views: list[View] = []
    if schedule is None:
        schedule = frame_schedule(frames, sampled_pairs(frames, settings))
    last: list[View] = []  # per sample within a pixel, of the frame drawn before
    total = sum(judged for _, judged in schedule)

    def finish(frame: int, both: list[View], found: Counts | int, started: float) -> None:
        """Take in a pair: its counts, or the run of the mask pass that made them."""
        found = masks.read(found) if isinstance(found, int) else found
        rows.append({"frame": frame, "time_s": frame / settings.fps, **stats.add(found), **_camera_row(both)})
        if keep is not None:
            keep.append(found)
        if writer is not None:
            writer.write_row(rows[-1])
        if on_pair is not None:
            on_pair(Pair(frame, rows[-1], views[-1], source, masks))
        if progress is not None:
            progress(Progress(name, len(rows), total, (ended.pop(frame, None) or time.perf_counter()) - started))

    # Counts are read one pair late, when the GPU has the next one to do; at once where images go with them.
    late = on_pair is None and settings.samples_per_pixel == 1
    waiting: list[tuple[int, list[View], Counts | int, float]] = []
    ended: dict[int, float] = {}  # frame -> when the CPU was done with it, if that was before its counts were read
    try:
        for frame, judged in schedule:
            started = time.perf_counter()
            seen, found = [], None
            for sample in range(settings.samples_per_pixel):
                one = settings.samples_per_pixel == 1
                seen.append(source.advance(frame) if one else source.advance_sample(frame, sample))
                if not judged:
                    continue
                with timer.measure("masks"):
                    pair = reprojection(seen[-1], last[sample], *source.size)
                    run = masks.run(pair, thresholds, source.current, source.previous, exposure=settings.exposure)
                    found = run if late else masks.read() if found is None else found + masks.read()
            both, last = [last[0] if last else seen[0], seen[0]], seen
            views.append(seen[0].centered())
            if judged:
                waiting.append((frame, both, found, started))
                while len(waiting) > late:
                    finish(*waiting.pop(0))
                if late:
                    ended[frame] = time.perf_counter()
        while waiting:
            finish(*waiting.pop(0))
    except KeyboardInterrupt:
        while waiting:  # judged, only not read yet
            finish(*waiting.pop(0))
        raise
    finally:
        masks.release()
        shaders.release()
    return rows, views, stats


def scene_facts(scene: Scene, camera: CameraTrack, frames: range, settings: Settings, poser: Poser) -> dict[str, Any]:
    """What the summary says of the scene without a frame being drawn: blocks ``scene``, ``census`` and ``notes``, and
    ``camera_source``.  Plain values, fit for JSON."""
    notes = [str(note) for note in scene.notes]
    if isinstance(camera, OrbitCamera):
        notes.insert(0, f"the camera is a {camera.describe()}")
    return {
        "scene": {
            "name": scene.name,
            "path": None if scene.path is None else str(scene.path),
            "sha256": scene.sha256,
            "duration_s": scene.duration,
            "playing": list(scene.playing),
            "stand_in": scene.stand_in,
        },
        "census": census(scene, (f / settings.fps for f in frames), poser),
        "camera_source": camera.describe(),
        "notes": notes,
    }


def assemble_summary(
    facts: dict[str, Any], frames: range, settings: Settings, views: list[View], stats: SequenceStats
) -> dict[str, Any]:
    """summary.json of SPEC section 6 (effects, timing and provenance are added by the caller).

    ``facts``: ``scene_facts``; ``views`` of all frames; ``stats`` has taken in all pairs, in order.
    """
    positions = np.array([v.position for v in views]).reshape(-1, 3)
    rotations = np.array([v.world_from_view for v in views]).reshape(-1, 3, 3)
    activity = camera_activity(positions, rotations)
    cuts = detect_cuts(activity, settings.unit_scale)
    sample = sampled_pairs(frames, settings)
    discard = stats.discard(cuts[list(sample.positions)])
    sampling = _sampling(sample, stats, settings, discard) if settings.pairs != "all" else None
    return {
        "schema": SUMMARY_SCHEMA,
        "scene": facts["scene"],
        "settings": settings.as_summary(frames),
        "pairs": stats.pairs,
        "census": facts["census"],
        "camera": summarize(activity, cuts, settings.fps, frames[0]) | {"source": facts["camera_source"]},
        "discard": discard,
        **({} if sampling is None else {"sampling": sampling}),
        "classes": stats.classes(),
        "curves": stats.curves(),
        "notes": [*facts["notes"], *_accuracy_notes(settings, sampling)],
    }


def _accuracy_notes(settings: Settings, sampling: dict[str, Any] | None) -> list[str]:
    """What a reader of the tables must know of a run that looks at less, or at more, than every pixel centre."""
    notes = []
    if sampling is not None:
        widths = {c: e["half_width_points"] for c, e in sampling["columns"].items()}
        said = ", ".join(f"{c} ±{w:.2f}" for c, w in widths.items() if w is not None)
        drawn = f"{sampling['drawn']} of {sampling['total']} pairs ({settings.pairs})"
        notes.append(f"{drawn}; 95 % intervals, points: {said or 'unknown'}")
    if settings.samples_per_pixel > 1:
        notes.append(f"counts and percentages are over {settings.samples_per_pixel} samples per pixel")
    return notes


def _sampling(sample: PairSample, stats: SequenceStats, settings: Settings, discard: dict[str, Any]) -> dict[str, Any]:
    """The block ``sampling``: confidence intervals of the means.  Puts the weighted means into ``discard``."""
    columns = {}
    for column in stats.measured if sample.positions else ():
        found = estimate(sample, stats.per_pair(column))
        discard[column]["mean_percent"] = found.mean
        columns[column] = {"mean_percent": found.mean, "half_width_points": found.half_width, "level": found.level}
    return {"pairs": settings.pairs, "drawn": len(sample.positions), "total": sample.total, "columns": columns}


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


def mark_cuts(rows: list[dict[str, Any]], summary: dict[str, Any]) -> None:
    """A cut shows only against the pairs around it, so this column is filled in at the end."""
    cuts = set(summary["camera"]["cuts"])
    for row in rows:
        row["camera_cut"] = row["frame"] in cuts


def require_triangles(scene: Scene) -> None:
    """Raises SceneError where there is nothing to draw, saying what there is instead."""
    if not any(len(p.triangles) for n in scene.mesh_nodes for p in scene.meshes[scene.nodes.mesh[n]].primitives):
        raise SceneError("no mesh with triangles to draw", where=str(scene.path or scene.name), hint=_what_is_in(scene))


def _what_is_in(scene: Scene) -> str:
    if len(scene.mesh_nodes):
        return "its meshes hold only points or lines"
    return (
        f"it has {len(scene.nodes)} nodes, {len(scene.cameras)} cameras, {len(scene.lights)} lights and no mesh in use"
    )
