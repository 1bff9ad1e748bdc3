"""Evaluation of one scene, from file to Run."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

from taubench_gl.animation import CameraTrack, Poser, camera_of_run
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.evaluation.brightness import describe_brightness
from taubench_gl.evaluation.exact import ExactColumns, exact_channels, exact_summary, require_exact
from taubench_gl.evaluation.lighting import ResolvedLighting, resolve_lighting
from taubench_gl.evaluation.lobes import LobeColumns, missing_of_scene, require_lobes, scene_channels
from taubench_gl.evaluation.pairs import Observers, evaluate_pairs
from taubench_gl.evaluation.scale import describe_scale, require_scale
from taubench_gl.evaluation.schedule import frame_range, frame_schedule, with_pairs
from taubench_gl.evaluation.summary import assemble_summary, finish_run, scene_facts
from taubench_gl.frame.sources import RasterSource, SourceOptions
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.provenance import provenance
from taubench_gl.run import EXACT_COLUMNS, FRAME_COLUMNS, Run, RunWriter
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

TIMED_FIRST, TIMED_EVERY = 16, 16
"""Frames whose passes are timed; timing a pass waits for it, so the passes of all other frames overlap."""


@dataclass(frozen=True, slots=True)
class SceneInput:
    """A scene ready to be evaluated: its camera, its frames, and the settings with their lighting resolved."""

    scene: Scene
    camera: CameraTrack
    frames: range
    lighting: ResolvedLighting

    @property
    def settings(self) -> Settings:
        return self.lighting.settings


def open_scene(scene: Scene | str | Path, settings: Settings, camera: CameraTrack | None = None) -> SceneInput:
    """Load a scene if it is a path, choose camera, frames and lighting.  Raises TaubenchError."""
    if settings.metrics.exact:
        require_exact(settings)
    if not isinstance(scene, Scene):
        scene = load_scene(scene, **settings.sequence.reading)
    camera = camera or camera_of_run(scene, settings.sequence)
    frames = frame_range(scene, camera, settings)
    require_triangles(scene)
    require_scale(scene, settings)
    lighting = resolve_lighting(scene, settings, camera, frames=frames)
    return SceneInput(scene, camera, frames, replace(lighting, settings=with_pairs(scene, lighting.settings, frames)))


def evaluate_scene(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    observers: Observers | None = None,
    *,
    out: str | Path | None = None,
    camera: CameraTrack | None = None,
    lobes: Collection[str] = (),
) -> Run:
    """Evaluate every frame pair of one scene.

    ``out`` receives frames.csv row by row and summary.json at the end; ``camera`` overrides ``sequence.camera``;
    ``lobes`` of direct and indirect (``conventions.LOBES``) are also measured apart, in ``lobes`` of the summary.
    Raises TaubenchError.
    """
    require_lobes(lobes)
    if lobes and (settings or Settings()).metrics.samples_per_pixel > 1:
        raise SettingsError("lobes are measured at one sample per pixel", hint="leave samples per pixel at 1")
    given = open_scene(scene, settings or Settings(), camera)
    observers = replace(observers or Observers(), scene=given.scene.name)
    if out is None:
        return _run(given, observers, tuple(lobes))
    with RunWriter(out, frame_columns(given.settings)) as writer:
        return _run(given, replace(observers, writer=writer), tuple(lobes))


def frame_columns(settings: Settings) -> tuple[str, ...]:
    """Columns of frames.csv."""
    return FRAME_COLUMNS + EXACT_COLUMNS * settings.metrics.exact


def _run(given: SceneInput, observers: Observers, lobes: tuple[str, ...]) -> Run:
    scene, camera, frames, settings = given.scene, given.camera, given.frames, given.settings
    gpu = open_gpu(settings.device.backend, settings.device.device)
    with gpu:
        timer, poser = PassTimer(gpu, first=TIMED_FIRST, every=TIMED_EVERY), Poser(scene)
        context = GpuContext(gpu, timer=timer)
        exact = settings.metrics.exact
        extra = tuple(dict.fromkeys((*observers.channels, *scene_channels(lobes), *exact_channels() * exact)))
        source = RasterSource(gpu, scene, camera, settings, SourceOptions(extra=extra), timer=timer, poser=poser)
        untimed, missing = GpuContext(gpu, context.shaders), missing_of_scene(lobes, source.unmeasured)
        apart = LobeColumns(untimed, source, settings, missing, lambda lobe, bounce: f"{bounce}_{lobe}")
        if lobes:
            observers = replace(observers, on_pair=apart.observer(observers.on_pair))
        schedule = frame_schedule(frames, settings)
        if exact:
            columns = ExactColumns.of_source(gpu, scene, camera, settings, poser, source, frames)
            observers = replace(observers, complete_row=columns.complete)
        try:
            results = evaluate_pairs(context, source, settings, schedule, observers)
            gpu.check("evaluation")
            views = results.views
            if not settings.metrics.all_pairs:  # camera activity is over all frames, drawn or not
                views = [camera.view_at(poser.sample(frame / settings.sequence.fps)) for frame in frames]
            facts = scene_facts(scene, camera, frames, given.lighting, poser)
            summary = assemble_summary(facts, frames, settings, views, results.stats)
            described = source.describe()
            summary["notes"] += described.pop("notes")
            summary |= described
            describe_brightness(summary, results.brightness, settings)
            describe_scale(summary, results.depths, settings)
            if lobes:
                summary["lobes"] = apart.summary()
            if exact:
                summary["exact"] = exact_summary(results.rows, source.unmeasured, source.reprojection)
        finally:
            apart.release()
            if exact:
                columns.release()
            source.release()
            context.release()
            gpu.collect()
        summary["timing"] = timer.summary()
        summary["provenance"] = provenance(gpu, timer.clock)
    return finish_run(summary, results.rows, observers)


def require_triangles(scene: Scene) -> None:
    """Raises SceneError if the scene has no triangles, with its contents as the hint."""
    if not any(len(p.triangles) for n in scene.mesh_nodes for p in scene.meshes[scene.nodes.mesh[n]].primitives):
        raise SceneError("no mesh with triangles to draw", where=str(scene.path or scene.name), hint=_contents(scene))


def _contents(scene: Scene) -> str:
    if len(scene.mesh_nodes):
        return "its meshes hold only points or lines"
    return (
        f"it has {len(scene.nodes)} nodes, {len(scene.cameras)} cameras, {len(scene.lights)} lights and no mesh in use"
    )
