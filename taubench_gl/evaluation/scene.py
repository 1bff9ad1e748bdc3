"""Evaluation of one scene, from file to Run."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from taubench_gl.animation import CameraTrack, Poser, View, camera_of_run
from taubench_gl.animation.eyes import other_eye
from taubench_gl.effects.decide import as_summary
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.evaluation.both import BothHistories
from taubench_gl.evaluation.decided_light import DecidedLight
from taubench_gl.evaluation.exact import ExactColumns, exact_channels
from taubench_gl.evaluation.lighting import ResolvedLighting, resolve_lighting, with_pairs, with_samples
from taubench_gl.evaluation.lobes import LobeColumns, missing_of_scene, require_lobes, scene_channels, scene_lobes
from taubench_gl.evaluation.owner import GpuOwner, opened_gpu
from taubench_gl.evaluation.pairs import Observers
from taubench_gl.evaluation.sampled_light import SampledLight, decides_light, preview_notes
from taubench_gl.evaluation.scale import require_scale
from taubench_gl.evaluation.schedule import frame_range
from taubench_gl.evaluation.session import TIMED_EVERY, ColumnAdder, Session, Wants, evaluate
from taubench_gl.evaluation.summary import scene_facts
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.run import Run
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings


@dataclass(frozen=True, slots=True)
class SceneInput:
    """A scene ready to be evaluated: its camera, its frames, and the settings with their lighting resolved."""

    animated: AnimatedScene
    frames: range
    lighting: ResolvedLighting

    @property
    def name(self) -> str:
        return self.animated.scene.name

    @property
    def settings(self) -> Settings:
        return self.lighting.settings

    def open_source(self, owner: GpuOwner, timer: PassTimer, wants: Wants) -> RasterSource:
        extra = (*wants.channels, *scene_channels(wants.lobes), *exact_channels() * self.settings.metrics.exact)
        settings = self.settings
        if wants.lobes and settings.metrics.history == "both":
            raise SettingsError("lobes have one history", hint="give --history frame or eye", setting="history")
        if wants.sampled and decides_light(settings):  # its images are the preview
            settings = with_samples(settings.replace(light="preview"))
            extra += ("emission",) * ("color" in settings.metrics.columns)
        return owner.open_source(self.animated, settings, extra=tuple(dict.fromkeys(extra)), timer=timer)

    def adders(self, session: Session) -> Iterator[ColumnAdder]:
        source, settings = session.source, self.settings
        if session.wants.sampled and decides_light(settings):
            yield DecidedLight(session, source, settings)
        if session.wants.lobes:
            effects = as_summary(source.effects)
            missing = missing_of_scene(session.wants.lobes, source.unmeasured, effects, settings)
            yield LobeColumns(session, source, settings, missing, lambda lobe, bounce: f"{bounce}_{lobe}")
        if settings.metrics.exact:
            yield ExactColumns.of_source(session.variant, settings, source, self.frames)
        if settings.metrics.history == "both":
            of_eye = replace(self, lighting=replace(self.lighting, settings=settings.replace(history="eye")))
            yield BothHistories(session, of_eye, session.wants.sampled and decides_light(settings))

    def facts(self, session: Session) -> dict[str, Any]:
        return scene_facts(self.animated, self.frames, self.lighting, session)

    def views(self, session: Session) -> list[View]:
        if self.settings.metrics.all_pairs and not self.settings.metrics.stereo:
            return session.drawn
        fps = self.settings.sequence.fps
        return [self.animated.view_at(frame / fps) for frame in self.frames]

    def sampled_light(self, session: Session) -> SampledLight | None:
        if not session.wants.sampled:
            return None
        lobes = scene_lobes(session.wants.lobes, as_summary(session.source.effects))
        return SampledLight.of(self.settings, self.frames, session.source.unmeasured, lobes)

    def amend(self, summary: dict[str, Any], session: Session) -> None:
        if session.sampled is None:
            summary["notes"] += preview_notes(self.settings, session.source.unmeasured)


def open_scene(
    scene: Scene | str | Path,
    settings: Settings,
    camera: CameraTrack | None = None,
    *,
    poser: Poser | None = None,
    owner: GpuOwner | None = None,
    sampled: bool = False,
) -> SceneInput:
    """Load a scene if it is a path, choose camera, frames, lighting and pairs.  Raises TaubenchError.

    ``poser``: of the scene, None: a new one; ``owner``: whose programs metering shares; ``sampled``: for a session that
    wants it, so that path-traced light can have as many samples as each pixel needs.
    """
    scene = _drawable(scene, settings)
    camera = camera or camera_of_run(scene, settings.sequence)
    frames = frame_range(scene, camera, settings)
    if settings.metrics.history != "frame":
        other_eye(scene, camera, settings)  # says what is wrong with it before anything is metered or drawn
    animated = AnimatedScene(scene, camera, poser).at_rate(settings.sequence.fps)
    lighting = resolve_lighting(scene, settings, camera, owner)
    settings = lighting.settings
    if not (sampled and decides_light(settings)):
        settings = with_samples(settings)
    return SceneInput(animated, frames, replace(lighting, settings=with_pairs(scene, settings, frames)))


def _drawable(scene: Scene | str | Path, settings: Settings) -> Scene:
    """The scene, read if it is a path, which an evaluation with ``settings`` can draw.  Raises TaubenchError."""
    if settings.metrics.exact:
        settings.require_exact()
    if not isinstance(scene, Scene):
        scene = load_scene(scene, **settings.sequence.reading)
    require_triangles(scene)
    if settings.metrics.thresholds["position"] == 0.0:
        require_scale(scene)
    return scene


@contextlib.contextmanager
def open_session(
    scene: Scene | str | Path,
    settings: Settings,
    wants: Wants | None = None,
    *,
    camera: CameraTrack | None = None,
    every: int = TIMED_EVERY,
) -> Iterator[Session]:
    """A session of a scene, whose metering shares its programs.  Arguments of ``open_scene`` and ``Session``."""
    scene = _drawable(scene, settings)  # what is wrong with a file is said also where there is no GPU
    with opened_gpu(settings) as owner:
        wants = wants or Wants()
        opened = open_scene(scene, settings, camera, owner=owner, sampled=wants.sampled)
        with Session(opened, wants, every=every, shaders=owner.context.shaders) as session:
            yield session


def evaluate_scene(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    observers: Observers | None = None,
    *,
    out: str | Path | None = None,
    camera: CameraTrack | None = None,
    lobes: Collection[str] = (),
    sampled: bool = False,
) -> Run:
    """Evaluate every frame pair of one scene.

    ``out`` receives frames.csv row by row and summary.json at the end; ``camera`` overrides ``sequence.camera``;
    ``lobes`` of direct and indirect (``conventions.LOBES``) are also measured apart, in ``lobes`` of the summary;
    ``sampled``: with light method ``auto``, columns of light are path-traced at random pixels, else they are the
    preview's; path-traced light without ``spp`` has as many samples as each pixel needs, else images of 256.  Raises
    TaubenchError.
    """
    require_lobes(lobes)
    if lobes and (settings or Settings()).metrics.samples_per_pixel > 1:
        raise SettingsError("lobes are measured at one sample per pixel", hint="leave samples per pixel at 1")
    observers = observers or Observers()
    with open_session(scene, settings or Settings(), Wants.of(observers, lobes, sampled), camera=camera) as session:
        return evaluate(session, observers, out)


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
