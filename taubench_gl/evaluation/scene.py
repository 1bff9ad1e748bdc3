"""Evaluation of one scene, from file to Run."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View, camera_of_run
from taubench_gl.animation.eyes import other_eye
from taubench_gl.effects.decide import as_summary
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.evaluation.decided_light import DecidedLight, counts_of_images
from taubench_gl.evaluation.exact import ExactColumns, exact_channels
from taubench_gl.evaluation.lighting import (
    LightPlan,
    ResolvedLighting,
    light_plan,
    resolve_lighting,
    with_pairs,
    with_samples,
)
from taubench_gl.evaluation.lobes import LobeColumns, measured_lobes, missing_of_scene, require_lobes, scene_channels
from taubench_gl.evaluation.owner import GpuOwner, opened_gpu
from taubench_gl.evaluation.pairs import Observers, Pair
from taubench_gl.evaluation.sampled_light import preview_channels
from taubench_gl.evaluation.scale import require_scale
from taubench_gl.evaluation.schedule import frame_range
from taubench_gl.evaluation.session import COUNTS_ONLY, TIMED_EVERY, ColumnGroup, Readback, Session, run_session
from taubench_gl.evaluation.summary import static_summary
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.metrics.histories import uses_other_eye
from taubench_gl.metrics.masks import PixelDistances
from taubench_gl.run import Run
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class ScenePlan:
    """A scene ready to be evaluated: its camera, its frames, and settings in which nothing is left to choose."""

    animated: AnimatedScene
    frames: range
    lighting: ResolvedLighting
    light: LightPlan

    @property
    def name(self) -> str:
        return self.animated.scene.name

    @property
    def settings(self) -> Settings:
        return self.lighting.settings

    def open_source(self, owner: GpuOwner, timer: PassTimer, readback: Readback) -> RasterSource:
        settings, lobes = self.settings, readback.lobes
        if lobes and settings.metrics.history == "both":
            raise SettingsError("lobes have one history", hint="give --history frame or eye", setting="history")
        channels = (*readback.channels, *scene_channels(lobes), *exact_channels() * settings.metrics.exact)
        if self.light is LightPlan.DECIDED:  # its images are the preview
            settings = with_samples(settings.replace(light="preview"))
        if self.light in (LightPlan.DECIDED, LightPlan.SAMPLED):
            channels += preview_channels(settings.metrics.columns)
        return owner.open_source(self.animated, settings, extra=tuple(dict.fromkeys(channels)), timer=timer)

    def missing_lobes(self, source: RasterSource, lobes: Collection[str]) -> dict[str, dict[str, str]]:
        return missing_of_scene(lobes, source.unmeasured, as_summary(source.effects), self.settings)

    def column_groups(self, session: Session) -> Iterator[ColumnGroup]:
        source, settings, missing = session.source, self.settings, session.missing_lobes
        if self.light is LightPlan.DECIDED:
            yield DecidedLight(session, session.variant, source, settings, measured_lobes(missing))
        if missing:
            yield LobeColumns(session, source, settings, missing, lambda lobe, bounce: f"{bounce}_{lobe}")
        if settings.metrics.exact:
            yield ExactColumns.of_source(session.variant, settings, source, self.frames)
        if settings.metrics.history == "both":
            of_eye = replace(self.lighting, settings=settings.replace(history="eye"))
            yield BothHistories(session, replace(self, lighting=of_eye))

    def static_summary(self, session: Session) -> dict[str, Any]:
        return static_summary(self.animated, self.frames, self.lighting, session)

    def views(self, session: Session) -> list[View]:
        if self.settings.metrics.all_pairs and not self.settings.metrics.stereo:
            return session.drawn
        fps = self.settings.sequence.fps
        return [self.animated.view_at(frame / fps) for frame in self.frames]

    def add_to_summary(self, summary: dict[str, Any], session: Session) -> None:
        """Add nothing: a tally has all that scenes have."""


class BothHistories:
    """Compares every pair with the other eye too, and replaces mask, counts and distances by those of the better."""

    columns, distances = (), True

    def __init__(self, session: Session, of_eye: ScenePlan):
        """``of_eye``: the plan of the session with history ``eye``."""
        self._source = of_eye.open_source(session, session.timer, session.readback)
        self._evaluator = session.open_evaluator(
            self._source, of_eye.settings, timed=False, images=True, distances=True
        )
        decided = of_eye.light is LightPlan.DECIDED
        self._decided = DecidedLight(session, session.variant, self._source, of_eye.settings) if decided else None

    def fill_row(self, pair: Pair) -> None:
        """Compare the frame of ``pair`` with the other eye."""
        [evaluated] = self._evaluator.step(pair.frame)[1]
        other = Pair(evaluated, {}, self._evaluator)
        if self._decided is not None:
            self._decided.fill_row(other)
            pair.row |= {name: pair.row[name] + other.row[name] for name in other.row}
        eye = uses_other_eye(pair.mask, other.mask)
        distances = _chosen_distances(eye, pair.distances, other.distances)
        words = np.where(eye, other.mask, pair.mask)
        pair.replace(words, distances, counts_of_images(words, distances.features))
        pair.add_eye(other, eye)


def _chosen_distances(eye: Array, frame: PixelDistances, other: PixelDistances) -> PixelDistances:
    def both(a: Array, b: Array) -> Array:
        return np.where(eye, b, a)

    features = {name: both(values, other.features[name]) for name, values in frame.features.items()}
    return PixelDistances(features, both(frame.depth, other.depth), both(frame.luminance, other.luminance))


def plan_scene(
    scene: Scene | str | Path,
    settings: Settings,
    camera: CameraTrack | None = None,
    *,
    poser: Poser | None = None,
    owner: GpuOwner | None = None,
    sampled: bool = False,
) -> ScenePlan:
    """Load a scene if it is a path, choose camera, frames, lighting, samples and pairs.  Raises TaubenchError.

    ``poser``: of the scene, None: a new one; ``owner``: whose programs metering shares; ``sampled``: columns of light
    are measured at single pixels where the settings allow it (``light_plan``), else by images.
    """
    scene = _drawable(scene, settings)
    camera = camera or camera_of_run(scene, settings.sequence, settings.metrics.unit_scale)
    frames = frame_range(scene, camera, settings)
    if settings.metrics.history != "frame":
        other_eye(scene, camera, settings)  # says what is wrong with it before anything is metered or drawn
    animated = AnimatedScene(scene, camera, poser).at_rate(settings.sequence.fps)
    lighting = resolve_lighting(scene, settings, camera, owner)
    settings, light = lighting.settings, light_plan(lighting.settings, sampled)
    if light is not LightPlan.DECIDED:  # each pixel has as many samples as it needs
        settings = with_samples(settings)
    return ScenePlan(animated, frames, replace(lighting, settings=with_pairs(scene, settings, frames)), light)


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
    readback: Readback = COUNTS_ONLY,
    *,
    camera: CameraTrack | None = None,
    sampled: bool = False,
    every: int = TIMED_EVERY,
) -> Iterator[Session]:
    """A session of a scene, whose metering shares its programs.  Arguments of ``plan_scene`` and ``Session``."""
    scene = _drawable(scene, settings)  # what is wrong with a file is said also where there is no GPU
    with opened_gpu(settings) as owner:
        plan = plan_scene(scene, settings, camera, owner=owner, sampled=sampled)
        with Session(plan, readback, every=every, shaders=owner.context.shaders) as session:
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
    ``lobes`` of direct and indirect (``lobes.LOBES``) are also measured apart, in ``lobes`` of the summary;
    ``sampled``: with light method ``auto``, columns of light are path-traced at random pixels, else they are the
    preview's; path-traced light without ``spp`` has as many samples as each pixel needs, else images of 256.  Raises
    TaubenchError.
    """
    require_lobes(lobes)
    if lobes and (settings or Settings()).metrics.samples_per_pixel > 1:
        raise SettingsError("lobes are measured at one sample per pixel", hint="leave samples per pixel at 1")
    observers = observers or Observers()
    readback = Readback.of(observers, lobes)
    with open_session(scene, settings or Settings(), readback, camera=camera, sampled=sampled) as session:
        return run_session(session, observers, out)


def require_triangles(scene: Scene) -> None:
    """Raises SceneError if the scene has no triangles, with its contents as the hint."""
    if not scene.drawn():
        raise SceneError("no mesh with triangles to draw", where=str(scene.path or scene.name), hint=_contents(scene))


def _contents(scene: Scene) -> str:
    if len(scene.mesh_nodes):
        return "its meshes hold only points or lines"
    return (
        f"it has {len(scene.nodes)} nodes, {len(scene.cameras)} cameras, {len(scene.lights)} lights and no mesh in use"
    )
