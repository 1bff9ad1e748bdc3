"""The main job over path-traced files: ``exr:DIR`` -> the same Channels, masks and summary as the rasterizer's.

One mask implementation judges both sources; only where channels and cameras come from differs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import View, choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import (
    Observers,
    Pair,
    PairEvaluator,
    assemble_summary,
    evaluate_pairs,
    finish_run,
    frame_schedule,
    sampled_pairs,
)
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.pathtraced.blender.render import read_render
from taubench_gl.pathtraced.cameras import FittedCamera, PathTracedCamera, SceneCamera, SidecarCamera
from taubench_gl.pathtraced.noise import noise_floor
from taubench_gl.pathtraced.passes import BOUNCES, LOBES
from taubench_gl.pathtraced.sequence import PathTracedSequence, is_sequence
from taubench_gl.pathtraced.source import PathTracedSource
from taubench_gl.provenance import provenance
from taubench_gl.run import FRAME_COLUMNS, Progress, Run, RunWriter
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

NO_SCENE = "path-traced files do not say what the scene is made of"

__all__ = ["PathTracedOptions", "evaluate_path_traced", "is_sequence"]


@dataclass(frozen=True, slots=True)
class PathTracedOptions:
    """What only a path-traced sequence needs to be told.  At most one of ``camera_file`` and ``scene_file``."""

    camera_file: str | Path | None = None  # JSON sidecar
    scene_file: str | Path | None = None  # glTF whose camera took the pictures (``Settings.camera`` chooses it)
    mapping: str | Path | None = None  # preset name or TOML/JSON file; None: Blender
    layer: str | None = None  # view layer; None: the one with most passes
    lobes: tuple[str, ...] = field(default=())  # lobes of direct and indirect to measure apart
    second_seed: str | Path | None = None  # exr: of the same frames with another seed, for the noise floor

    def __post_init__(self) -> None:
        if self.camera_file is not None and self.scene_file is not None:
            raise SettingsError("camera file and scene file both say where the camera was", hint="give one")
        for lobe in self.lobes:
            if lobe not in LOBES:
                raise SettingsError(f"no lobe is named {lobe!r}", hint=f"choose from {', '.join(LOBES)}")


def evaluate_path_traced(
    spec: str | Path,
    settings: Settings | None = None,
    options: PathTracedOptions | None = None,
    *,
    out: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    on_pair: Callable[[Pair], None] | None = None,
    channels: tuple[str, ...] = (),
) -> Run:
    """Evaluate the frame pairs of ``exr:DIR`` or ``exr:DIR/name*.exr``.

    The picture size is the files'; ``settings.fps`` gives way to a sidecar's.  A column whose pass is missing is null,
    with the pass that would give it as the reason.  Raises TaubenchError for everything a user can cause.
    """
    settings, options = settings or Settings(), options or PathTracedOptions()
    for what, value, only in (
        ("pairs", settings.metrics.pairs, "all"),
        ("samples per pixel", settings.metrics.samples_per_pixel, 1),
    ):
        if value != only:
            raise SettingsError(f"{what} {value} is for rendered scenes", where=str(spec), hint=f"leave it at {only}")
    sequence = PathTracedSequence.open(spec, mapping=options.mapping, layer=options.layer)
    camera, fps = choose_camera_source(options, settings)
    settings = settings.replace(width=sequence.size[0], height=sequence.size[1], fps=fps)
    frames = sequence.select(settings.sequence.frames)
    observers = Observers(sequence.name, None, progress, on_pair)
    if out is None:
        return _run(sequence, camera, frames, settings, options, observers)
    with RunWriter(out, FRAME_COLUMNS) as writer:
        return _run(sequence, camera, frames, settings, options, replace(observers, writer=writer))


def choose_camera_source(options: PathTracedOptions, settings: Settings) -> tuple[PathTracedCamera, float]:
    """Where the camera comes from, and the frame rate to go with it."""
    if options.camera_file is not None:
        camera = SidecarCamera(options.camera_file)
        return camera, camera.file.fps or settings.sequence.fps
    if options.scene_file is not None:
        scene = load_scene(options.scene_file, scene=settings.sequence.scene, animation=settings.sequence.animation)
        if not len(scene.camera_nodes):
            raise SettingsError("the scene file has no camera", hint="leave it out to have the camera estimated")
        return SceneCamera(
            scene, choose_camera(scene, settings.sequence.camera), settings.sequence.fps
        ), settings.sequence.fps
    return FittedCamera(), settings.sequence.fps


def _run(
    sequence: PathTracedSequence,
    camera: PathTracedCamera,
    frames: range,
    settings: Settings,
    options: PathTracedOptions,
    observers: Observers,
) -> Run:
    gpu = open_gpu(settings.device.backend, settings.device.device)
    with gpu:
        timer = PassTimer(gpu)
        context = GpuContext(gpu, timer=timer)
        source = PathTracedSource(gpu, sequence, camera, settings, lobes=options.lobes)
        untimed = GpuContext(gpu, context.shaders)
        lobes = _LobeColumns(untimed, source, settings) if options.lobes else None

        def seen(pair: Pair) -> None:
            if lobes is not None:
                lobes.add(pair.view)
            if observers.on_pair is not None:
                observers.on_pair(pair)

        watched = seen if lobes is not None or observers.on_pair is not None else None
        try:
            schedule = frame_schedule(frames, sampled_pairs(frames, settings))
            results = evaluate_pairs(context, source, settings, schedule, replace(observers, on_pair=watched))
            gpu.check("evaluation")
            facts = _facts(sequence, frames, settings, camera, _notes(source, camera))
            summary = assemble_summary(facts, frames, settings, results.views, results.stats) | source.describe()
            folder = sequence.path if sequence.path.is_dir() else sequence.path.parent
            record = read_render(folder)
            summary["path_traced"]["render"] = None if record is None else record.summary(frames)
            if lobes is not None:
                summary["lobes"] = lobes.summary()
            if options.second_seed is not None:
                other = PathTracedSequence.open(options.second_seed, mapping=options.mapping, layer=options.layer)
                # Motion reprojection says nothing about a pair without time between its frames.
                still = settings.replace(reprojection="camera")
                floor = noise_floor(untimed, sequence, other, camera, frames, still)
                summary["noise_floor"] = floor
                summary["notes"].append(_said(floor))
        finally:
            if lobes is not None:
                lobes.release()
            source.release()
            context.release()
            gpu.collect()
        summary["timing"] = timer.summary()
        summary["provenance"] = provenance(gpu, timer.clock)
    return finish_run(summary, results.rows, observers.writer)


def _facts(
    sequence: PathTracedSequence, frames: range, settings: Settings, camera: PathTracedCamera, notes: list[str]
) -> dict[str, Any]:
    """As ``evaluation.scene_facts``, of files that do not say what they show."""
    return {
        "scene": {
            "name": sequence.name,
            "path": str(sequence.path),
            "sha256": sequence.sha256(),
            "duration_s": (len(frames) - 1) / settings.sequence.fps,
            "playing": [],
        },
        "census": {"reason": NO_SCENE},
        "camera_source": camera.describe(),
        "notes": notes,
    }


def _said(floor: dict[str, Any]) -> str:
    shares = [f"{c} {e['mean_percent']:.2f} %" for c, e in floor.items() if e["mean_percent"] is not None]
    return f"noise floor, from a render with another seed: {', '.join(shares) or 'nothing to compare'}"


def _notes(source: PathTracedSource, camera: PathTracedCamera) -> list[str]:
    notes = [f"the camera is {camera.describe()}"] if isinstance(camera, FittedCamera) else []
    if source.mismatch_px is None:
        notes.append("without a position pass the camera could not be checked against the pictures")
    if isinstance(camera, SceneCamera) and camera.offset:
        notes.append(f"the files count frames from {-camera.offset}: frame {-camera.offset} is the scene's 0 s")
    return notes


class _LobeColumns:
    """direct and indirect of single lobes, through the same mask pass with their textures in the place of the sums."""

    def __init__(self, context: GpuContext, source: PathTracedSource, settings: Settings):
        self._source = source
        self._lobes: dict[str, tuple[PairEvaluator, SequenceStats]] = {}
        for lobe in source.lobes:
            missing = {b: source.missing[f"{lobe}_{b}"] for b in BOUNCES if f"{lobe}_{b}" in source.missing}
            there = tuple(b for b in BOUNCES if b not in missing)
            evaluator = PairEvaluator(context, source, settings, radiance=there)
            stats = SequenceStats(there, missing)
            self._lobes[lobe] = evaluator, stats

    def add(self, view: View) -> None:
        """Count the pair whose frames the source holds now; ``view`` is the current one's."""
        pair = reprojection(view, self._source.previous_view, *self._source.size)
        for lobe, (evaluator, stats) in self._lobes.items():
            current, previous = (
                dict(textures) | {b: textures[f"{lobe}_{b}"] for b in BOUNCES if f"{lobe}_{b}" in textures}
                for textures in (self._source.current, self._source.previous)
            )
            stats.add(evaluator.compare(pair, current=current, previous=previous))

    def summary(self) -> dict[str, Any]:
        """lobe -> {direct, indirect} as in the ``discard`` block."""
        out = {}
        for lobe, (_, stats) in self._lobes.items():
            discard = stats.discard(np.zeros(stats.pairs, dtype=bool))
            out[lobe] = {bounce: discard[bounce] for bounce in BOUNCES}
        return out

    def release(self) -> None:
        for evaluator, _ in self._lobes.values():
            evaluator.release()
