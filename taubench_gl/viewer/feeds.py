"""Sources of the viewer: a rasterized scene with a free camera, or path-traced files with theirs; and how they open.

A feed holds the channels of a pair of *shots*, a frame with a view each, and renders only those that changed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View, bounding_sphere
from taubench_gl.animation.eyes import EyeCamera
from taubench_gl.channels import CHANNELS
from taubench_gl.effects.decide import SWITCHABLE, Effect, decide
from taubench_gl.errors import OutputError
from taubench_gl.evaluation import plan_scene
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import FEATURES
from taubench_gl.frame.passes.visibility import CHANNEL as VISIBILITY
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.pathtraced.evaluation import PathTracedOptions, plan_sequence
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.pathtraced.source import PathTracedSource
from taubench_gl.run import SUMMARY_FILE, Run, load_run, not_reusable
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import AUTO, FIELDS, Settings
from taubench_gl.viewer.display import visualizations_of_channels, visualizations_of_scene
from taubench_gl.viewer.names import PixelNames, names_at
from taubench_gl.viewer.scene_tree import SceneTree
from taubench_gl.viewer.state import Live


@dataclass(frozen=True)
class Shot:
    """A frame number and the view that it is drawn from."""

    frame: int
    view: View

    @property
    def key(self) -> tuple[int, bytes, bytes]:
        """Values that are equal for equal shots."""
        return self.frame, self.view.position.tobytes(), self.view.world_from_view.tobytes()


class SceneFeed(GpuOwner):
    """A rasterized Scene.

    ``frames``: of the sequence; ``size``: width and height in pixels; ``lighting``: why light unit, exposure and
    environment were chosen; ``center`` (3,) and ``radius``: bounding sphere in scene units; ``tree``: the nodes;
    ``live``: the live settings of the last plan; ``source``: the channels of the pair.
    """

    free = True  # the camera can be moved

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        settings: Settings,
        timer: Any,
        camera: CameraTrack | None = None,
        poser: Poser | None = None,
    ):
        super().__init__(gpu)
        self.scene, self._timer, self.tree = scene, timer, SceneTree.of(scene)
        # One sample at the pixel center: the masks belong to the displayed image.
        history = {"history": "frame"} if settings.metrics.history == "both" else {}
        poser = poser or Poser(scene, settings.sequence.fps)
        opened = plan_scene(scene, settings.replace(samples_per_pixel=1, **history), camera, poser=poser)
        self.settings = opened.settings.replace(pairs=settings.metrics.pairs)
        self.frames, self.animated, self.lighting = opened.frames, opened.animated, opened.lighting.reasons
        self.size, self.name = (settings.sequence.width, settings.sequence.height), scene.name
        self.center, self.radius = bounding_sphere(self.poser, self.animated.times)
        self._all = decide(scene, self.settings)
        self.source: RasterSource | None = None
        self._base_settings = self.settings  # before the changes of ``live``
        self.live = live_of(self.settings)
        self._extra: frozenset[str] = frozenset()
        self._off: frozenset[str] | None = None
        self._held: list[Any] = [None, None]  # keys of previous and current
        self._shots: dict[int, Shot] = {}

    def beside(self, settings: Settings) -> SceneFeed:
        """Another feed of the same scene with this camera and these poses."""
        return SceneFeed(self.gpu, self.scene, settings, self._timer, self.camera, self.poser)

    @property
    def effects(self) -> Mapping[str, Effect]:
        """Every effect by name, enabled or not."""
        return self._all if self.source is None else self.source.effects

    @property
    def poser(self) -> Poser:
        """Poses of the scene, shared by all feeds beside this one."""
        return self.animated.poser

    @property
    def camera(self) -> CameraTrack:
        """The camera of the file, or the orbit that frames a scene without one."""
        return self.animated.camera

    @property
    def switchable(self) -> tuple[str, ...]:
        """Enabled effects that can be disabled."""
        return tuple(n for n in SWITCHABLE if self._all[n].enabled)

    def visualizations(self) -> tuple[str, ...]:
        """Keys of ``display.VISUALIZATIONS`` that can be shown."""
        return visualizations_of_scene(dict(self.effects))

    def file_shot(self, frame: int) -> Shot:
        """The frame with the camera of the file."""
        if frame not in self._shots:
            while len(self._shots) > 3:  # a pair is asked for again and again
                del self._shots[next(iter(self._shots))]
            self._shots[frame] = Shot(frame, self.animated.view_at(frame / self.settings.sequence.fps))
        return self._shots[frame]

    def other_eye(self, shot: Shot) -> Shot:
        """The frame of ``shot`` from the other eye, or the camera of the file that stands for it (history ``eye``)."""
        eye = self.source.eye
        if isinstance(eye, EyeCamera):
            return Shot(shot.frame, eye.beside(shot.view))
        return Shot(shot.frame, eye.view_at(self.poser.sample(shot.frame / self.settings.sequence.fps)))

    def plan(self, extra: frozenset[str], off: frozenset[str], live: Live) -> bool:
        """Provide channels ``extra``, disable effects ``off``, apply ``live``; whether the source was recreated.

        Raises TaubenchError, with nothing changed.
        """
        have = () if self.source is None else self.source.channels
        same = off == self._off and live == self.live
        if self.source is not None and self.source.visibility is not None and VISIBILITY not in extra:
            self._extra, same = self._extra - {VISIBILITY}, False  # its rays cost time in every pair
        if self.source is not None and same and extra <= {*have, *self._extra}:
            return False
        base = self._base_settings
        settings = base if live == self.live == live_of(base) else live_settings(base, live)
        every = decide(self.scene, settings)
        wanted = tuple(n for n in CHANNELS if n in self._extra | extra)
        self.source = self.open_source(
            self.animated, settings, extra=wanted, without=off, timer=self._timer, instead_of=self.source
        )
        self._off, self._held = off, [None, None]
        self.settings, self.live, self._all, self._extra = settings, live, every, self._extra | extra
        self.size = self.source.size
        return True

    def show(self, previous: Shot, current: Shot) -> bool:
        """Hold the channels of this pair; whether anything was rendered."""
        keys = [previous.key, (*current.key, *previous.key)]
        if self._held == keys:
            return False
        held = self._held[1]
        if held is None or held[:3] != previous.key:
            self.source.draw_pair(previous.frame, previous.frame, previous.view, previous.view)
        self.source.draw_pair(current.frame, previous.frame, current.view, previous.view)
        self._held = keys
        return True

    def names_at(self, x: int, row: int) -> PixelNames | None:
        """What pixel (x, row from the top) of the current frame shows; None without the channel ``ids``."""
        return names_at(self.gpu, self.source, x, row) if "ids" in self.source.channels else None

    def show_one(self, shot: Shot) -> bool:
        """Render ``shot`` alone, without a pair; whether anything was rendered."""
        keys = [None, (*shot.key, *shot.key)]
        if self._held == keys:
            return False
        self.source.draw_pair(shot.frame, shot.frame, shot.view, shot.view)
        self._held = keys
        return True

    def release(self) -> None:
        super().release()
        self.source = None


class PathTracedFeed(Owner):
    """Path-traced OpenEXR frames with the camera of the files.  Attributes and methods are those of ``SceneFeed``."""

    free = False
    switchable: tuple[str, ...] = ()
    tree = None
    lighting: Mapping[str, str] = MappingProxyType({})

    def __init__(self, gpu: Gpu, spec: str, settings: Settings, options: PathTracedOptions):
        super().__init__()
        plan = plan_sequence(spec, settings, options)
        self.sequence, self.settings, self.frames = plan.sequence, plan.settings, plan.frames
        self.size, self.name = self.sequence.size, self.sequence.name
        self.center, self.radius = np.zeros(3), 1.0
        self.effects: Mapping[str, Effect] = {}
        self.source = self.own(PathTracedSource(gpu, self.sequence, plan.camera, self.settings))
        self._gpu, self._camera, self._base_settings = gpu, plan.camera, self.settings
        self.live = live_of(self.settings)
        self._views: dict[int, View] = {}
        self._held: tuple[int | None, int | None] = (None, None)  # previous and current frame
        self._shown: tuple[int, int] | None = None

    def file_shot(self, frame: int) -> Shot:
        """The frame with its camera, which is known after the frame is read."""
        if frame not in self._views:
            self._read(frame)
        return Shot(frame, self._views[frame])

    def visualizations(self) -> tuple[str, ...]:
        return visualizations_of_channels(self.source.channels)

    def plan(self, extra: frozenset[str], off: frozenset[str], live: Live) -> bool:
        """Apply what of ``live`` the files can change; the rest stays.  Whether the source was recreated."""
        live = replace(live, light=self.live.light, scale=1.0, history="frame")  # the files have them
        if not self.source.moves:
            live = replace(live, reprojection=self.live.reprojection)
        if live == self.live:
            return False
        settings = live_settings(self._base_settings, live)
        source = PathTracedSource(self._gpu, self.sequence, self._camera, settings)
        self.source, self.settings, self.live = self.own(source, instead_of=self.source), settings, live
        self._held, self._shown = (None, None), None
        return True

    def show(self, previous: Shot, current: Shot) -> bool:
        keys = (previous.frame, current.frame)
        if self._shown == keys:
            return False
        if self._held != keys:
            if self._held[1] != previous.frame:
                self._read(previous.frame)
            self._read(current.frame)
        self._shown = keys
        return True

    def names_at(self, x: int, row: int) -> PixelNames | None:
        return None  # path-traced files have no names

    def _read(self, frame: int) -> None:
        self._views[frame] = self.source.advance(frame)
        self._held, self._shown = (self._held[1], frame), None


Feed = SceneFeed | PathTracedFeed
LIVE_SPP = 4
"""Samples per pixel of path-traced light that is switched on in the viewer."""


def live_of(settings: Settings) -> Live:
    """The values of the live settings that ``settings`` have already."""
    metrics = settings.metrics
    history = "eye" if metrics.stereo else "frame"  # a picture shows one history: with ``both`` the frame
    return Live(metrics.reprojection, metrics.sampling, settings.lighting.light, history=history)


def live_settings(settings: Settings, live: Live) -> Settings:
    """``settings`` of a source with the choices ``live`` that the user makes while looking."""
    sequence, lighting = settings.sequence, settings.lighting
    changed: dict[str, Any] = {
        "reprojection": live.reprojection,
        "sampling": live.sampling,
        "history": live.history,
        "exposure": lighting.exposure_factor * live.exposure,
        "width": max(round(sequence.width * live.scale), 1),
        "height": max(round(sequence.height * live.scale), 1),
    }
    if live.light != lighting.light:
        changed |= {"light": live.light, "spp": LIVE_SPP}
        changed |= {"indirect": AUTO} if live.light == "path-traced" else {}
    return settings.replace(**changed)


_OF_EVALUATION = ("samples_per_pixel", "pairs", "exact", "light_within", "light_time")
"""Settings of a run that say how much was evaluated, not what its pairs look like."""


@dataclass(frozen=True, slots=True)
class OpenRequest:
    """A source to open with its options.  ``resolve``: a name of the scene registry -> path and settings."""

    source: str
    settings: Settings
    reference: str | None = None
    options: PathTracedOptions = field(default_factory=PathTracedOptions)
    given: frozenset[str] = frozenset()  # settings that the user gave; they override those of a run
    resolve: Callable[[str], tuple[str, dict[str, Any]]] | None = None
    run: str | None = None  # another run to compare with
    method: str | None = None  # a reuse method to compare with, as ``load_method`` takes it
    restored: Any = None  # ``session_file.SessionFile``: how to show it


@dataclass(slots=True)
class Opened:
    """A feed that was opened, the frame to show first, and notes for the user."""

    feed: Feed
    frame: int | None = None  # initial frame
    notes: tuple[str, ...] = ()


def is_run(text: str) -> bool:
    """Whether a path is a run: its folder or its summary."""
    path = Path(text)
    return path.name == SUMMARY_FILE or (path / SUMMARY_FILE).is_file()


def open_feed(gpu: Gpu, request: OpenRequest, timer: Any) -> Opened:
    """Open the source of ``request``.  Raises TaubenchError for everything a user can cause."""
    if is_sequence(request.source):
        return Opened(PathTracedFeed(gpu, request.source, request.settings, request.options))
    if is_run(request.source):
        run = load_run(request.source)
        text, settings = scene_of(run, request)
        if is_sequence(text):
            return Opened(PathTracedFeed(gpu, text, settings, request.options), worst_frame(run))
        feed = scene_feed(gpu, text, settings, timer)
        return Opened(feed, worst_frame(run), (_run_note(run, feed.scene.sha256),))
    text, settings = request.source, request.settings
    if request.resolve is not None:
        text, row = request.resolve(text)
        settings = settings.replace(**row)
    return Opened(scene_feed(gpu, text, settings, timer))


def scene_feed(gpu: Gpu, text: str, settings: Settings, timer: Any) -> SceneFeed:
    """A feed of the scene file at path ``text``.  Raises TaubenchError."""
    return SceneFeed(gpu, load_scene(text, **settings.sequence.reading), settings, timer)


def scene_of(run: Run, request: OpenRequest) -> tuple[str, Settings]:
    """The run's scene and its settings, overridden by the options that the user gave."""
    path = (run.summary.get("scene") or {}).get("path")
    if path is None:
        raise OutputError("the run's scene was not read from a file", where=str(run.out), hint="open a scene instead")
    # Runs recorded before the selection open with that of the file.
    stored = (run.summary["scene"].get("selection") or {}) | (run.summary.get("settings") or {})
    by_user = {*request.given, *(("width", "height") if "size" in request.given else ())}
    values = {n: stored[n] for n in FIELDS if n in stored and n not in by_user and n not in _OF_EVALUATION}
    if "thresholds" in values:
        values["thresholds"] = {f: v for f, v in values["thresholds"].items() if f in FEATURES and v is not None}
    if "frames" not in by_user and stored.get("first_frame") is not None:
        values["frames"] = (stored["first_frame"], stored["last_frame"] + 1)
    path_traced, path = run.summary.get("path_traced") is not None, scene_path(run.out, str(path))
    return (f"exr:{path}" if path_traced else path), request.settings.replace(**values)


def scene_path(out: Path | None, path: str) -> str:
    """Path of the scene of the run in ``out``: ``path`` itself, else relative to a folder above ``out``.

    A run stores the path as it was given, which may be relative to another folder.  Raises OutputError.
    """
    if Path(path).exists() or any(sign in path for sign in "*?[%@"):  # the sequence reader resolves patterns
        return path
    above = () if out is None or Path(path).is_absolute() else (out.resolve(), *out.resolve().parents)
    existing = next((folder / path for folder in above if (folder / path).exists()), None)
    if existing is None:
        hint = "start in the folder of the evaluation, or open the scene itself"
        raise OutputError(f"the run's scene {path} does not exist", where=str(out), hint=hint)
    return str(existing)


def worst_frame(run: Run) -> int | None:
    """Number of the frame with the most discards, which mask.png of the run shows; None without pairs."""
    rows = [row for row in run.frames if row.get("frame") is not None]
    return int(max(rows, key=not_reusable)["frame"]) if rows else None


def _run_note(run: Run, sha256: str | None) -> str:
    scene = run.summary["scene"]
    changed = scene.get("sha256") is not None and scene["sha256"] != sha256
    note = "the scene has changed since" if changed else "worst frame"
    return f"run of {scene.get('name', '?')}: {note}"
