"""summary.json from the sums over all pairs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from taubench_gl.animation import OrbitCamera, RecordedCamera, View
from taubench_gl.animation.key_notes import key_notes
from taubench_gl.conventions import SUMMARY_SCHEMA
from taubench_gl.effects.census import census
from taubench_gl.evaluation.appearance import appearance_notes
from taubench_gl.evaluation.lighting import ResolvedLighting, file_hashes
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.pairs import Observers
from taubench_gl.evaluation.schedule import sampled_pairs
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.metrics.activity import camera_activity, detect_cuts, summarize
from taubench_gl.metrics.sequence_stats import SequenceStats, sensitivity
from taubench_gl.run import Run
from taubench_gl.settings import FIELDS, Settings


def static_summary(
    animated: AnimatedScene, frames: range, resolved: ResolvedLighting, owner: GpuOwner | None = None
) -> dict[str, Any]:
    """The parts of the summary that need no pair: ``scene``, ``census``, ``lighting``, ``notes``, ``camera_source``.

    Also ``camera_jumps``: frames before which a recorded camera jumps over missing samples.

    JSON values.  ``owner``: whose programs frames share that are drawn for notes.
    """
    settings, scene, camera, poser = resolved.settings, animated.scene, animated.camera, animated.poser
    of_path = [name for name in FIELDS if name.startswith("camera_path")] if settings.sequence.camera_path else []
    notes = appearance_notes(animated, settings, frames, owner)
    notes += key_notes(scene, frames, settings.sequence.fps)
    source = camera.describe()
    if isinstance(camera, OrbitCamera):
        source = camera.describe(settings.metrics.unit_scale)
        notes.insert(0, f"the camera is a {source}")
    jumps = []
    if isinstance(camera, RecordedCamera):
        notes[:0] = camera.notes(settings.sequence.fps)
        jumps = camera.cut_frames(frames, settings.sequence.fps)
    overflowing = poser.overflowing(poser.sample(frames[0] / settings.sequence.fps).world)
    if len(overflowing):
        name = scene.nodes.names[overflowing[0]] or f"number {overflowing[0]}"
        others = f" and {len(overflowing) - 1} more" if len(overflowing) > 1 else ""
        notes.append(f"node {name!r}{others}: the world transform overflows; no drawn node depends on it")
    return {
        "scene": {
            "name": scene.name,
            "path": None if scene.path is None else str(scene.path),
            **file_hashes(scene, settings),
            "duration_s": scene.duration,
            "playing": list(scene.playing),
            "selection": {name: settings.get(name) for name in ("camera", "scene", "animation", *of_path)},
            "stand_in": scene.stand_in,
        },
        "census": census(scene, (f / settings.sequence.fps for f in frames), poser),
        "lighting": dict(resolved.reasons),
        "camera_source": source,
        "camera_jumps": jumps,
        "notes": notes,
    }


def assemble_summary(
    static: Mapping[str, Any],
    frames: range,
    settings: Settings,
    views: list[View],
    stats: SequenceStats,
    sampled: Collection[str] = (),
) -> dict[str, Any]:
    """The parts of summary.json that follow from the sums over all pairs; the caller adds the others.

    ``static``: of ``static_summary``; ``views``: of all frames; ``stats``: of all pairs, added in order; ``sampled``:
    columns whose intervals the caller adds too.
    """
    positions = np.array([v.position for v in views]).reshape(-1, 3)
    rotations = np.array([v.world_from_view for v in views]).reshape(-1, 3, 3)
    activity = camera_activity(positions, rotations)
    cuts = detect_cuts(activity, settings.metrics.unit_scale) | np.isin(frames[1:], static.get("camera_jumps", ()))
    in_meters = activity.in_meters(settings.metrics.unit_scale)
    sample = sampled_pairs(frames, settings)
    rates = stats.rates(
        settings.metrics.reprojection, cuts[list(sample.positions)], None if settings.metrics.all_pairs else sample
    )
    reusable, sampling, curves = rates["reusable"], rates.get("sampling"), stats.curves()
    if sampling is not None:
        sampling = {"pairs": settings.metrics.pairs} | sampling
    for column, shares in sensitivity(curves, settings.metrics.thresholds, stats.reuse.pixels).items():
        rates["discard"][column] |= shares
    return {
        "schema": SUMMARY_SCHEMA,
        "reusable": reusable,
        "scene": static["scene"],
        "settings": settings.as_summary(frames),
        "lighting": static["lighting"],
        "pairs": stats.pairs,
        "census": static["census"],
        "camera": summarize(in_meters, cuts, settings.sequence.fps, frames[0]) | {"source": static["camera_source"]},
        "discard": rates["discard"],
        **({} if sampling is None else {"sampling": sampling}),
        "classes": stats.classes(),
        "curves": _curves_in_meters(curves, settings.metrics.unit_scale),
        "mask_histogram": stats.reuse.histogram(),
        "notes": [*static["notes"], *_color_notes(reusable), *_accuracy_notes(settings, sampling, sampled)],
    }


def _curves_in_meters(curves: dict[str, Any], unit_scale: float) -> dict[str, Any]:
    """``curves`` with the bin edges of position in meters; ``unit_scale``: scene units per meter."""
    position = curves.get("position")
    if position is None:
        return curves
    return curves | {"position": position | {"edges": [edge / unit_scale for edge in position["edges"]]}}


def finish_run(summary: dict[str, Any], rows: list[dict[str, Any]], observers: Observers) -> Run:
    """Mark the camera cuts in ``rows``, write both files if there is a ``writer``, and return the Run.

    summary.json is the last file to be written: a folder that holds one is complete.
    """
    mark_cuts(rows, summary)
    writer = observers.writer
    run = Run(summary, rows, None if writer is None else writer.out)
    if writer is not None:
        writer.rewrite_rows(rows)
    files = [] if observers.on_finish is None else observers.on_finish(run)
    if writer is not None:
        writer.write_summary(summary, files)
    return run


def mark_cuts(rows: list[dict[str, Any]], summary: dict[str, Any]) -> None:
    """Fill in the column ``camera_cut``, which needs the whole sequence: a cut is detected against its neighbors."""
    cuts = set(summary["camera"]["cuts"])
    for row in rows:
        row["camera_cut"] = row["frame"] in cuts


def _color_notes(reusable: dict[str, Any]) -> list[str]:
    """A note where color alone changes: emission and textures are not part of the reuse rate."""
    share = (reusable["color_only"] or {}).get("mean_percent") or 0.0
    if share < 0.005:
        return []
    return [
        f"color is not part of the reuse rate, because it depends on the tone map; color alone discards {share:.2f} % "
        "of the surface pixels (emission or textures changed, or light changed by less than its thresholds)"
    ]


def _accuracy_notes(settings: Settings, sampling: dict[str, Any] | None, sampled: Collection[str]) -> list[str]:
    """Notes on a run that evaluates a sample of the pairs, or several samples per pixel."""
    notes = []
    if sampling is not None:
        ends = {c: e["interval95_percent"] for c, e in sampling["columns"].items() if c not in sampled}
        intervals = ", ".join(f"{c} {e[0]:.2f} to {e[1]:.2f}" for c, e in ends.items() if e is not None)
        drawn = f"{sampling['drawn']} of {sampling['total']} pairs ({settings.metrics.pairs}; --pairs all: every pair)"
        notes.append(f"{drawn}; 95 % intervals, percent: {intervals or 'unknown'}")
    if settings.metrics.samples_per_pixel > 1:
        notes.append(f"counts and percentages are over {settings.metrics.samples_per_pixel} samples per pixel")
    return notes
