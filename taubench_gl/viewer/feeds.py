"""What the viewer draws from: a scene whose cameras people may move, or path-traced files as they are.

A feed shows a pair of *shots* (a frame seen by a view) and draws only what it does not hold already.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View, bounding_sphere, choose_camera
from taubench_gl.channels import CHANNELS
from taubench_gl.effects.decide import SWITCHABLE, Effect, decide
from taubench_gl.evaluation import frame_range
from taubench_gl.frame.plan import bound_times
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.pathtraced.evaluation import PathTracedOptions, choose_camera_source
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.pathtraced.source import PathTracedSource
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings
from taubench_gl.viewer import pictures


@dataclass(frozen=True)
class Shot:
    """One frame seen by one view."""

    frame: int
    view: View

    @property
    def key(self) -> tuple[int, bytes, bytes]:
        return self.frame, self.view.position.tobytes(), self.view.world_from_view.tobytes()


class Feed(Protocol):
    """``free``: cameras may be moved.  ``effects``: by name, empty where there is no choice."""

    name: str
    free: bool
    size: tuple[int, int]
    frames: range
    settings: Settings
    effects: Mapping[str, Effect]
    center: np.ndarray
    radius: float
    source: Any

    def file_shot(self, frame: int) -> Shot:
        """The frame as the file's own camera sees it."""

    def pictures(self) -> tuple[str, ...]: ...

    def plan(self, extra: frozenset[str], off: frozenset[str]) -> bool:
        """Have channels ``extra`` too and effects ``off`` switched off; whether anything had to be made anew."""

    def show(self, previous: Shot, current: Shot) -> bool:
        """Hold this pair; whether anything was drawn."""

    def release(self) -> None: ...


class SceneFeed:
    """A Scene, rasterized."""

    free = True

    def __init__(self, gpu: Gpu, scene: Scene, settings: Settings, timer: Any, camera: CameraTrack | None = None):
        self._gpu, self.scene, self._timer = gpu, scene, timer
        # One sample in the middle of each pixel: what a person sees is what is judged.
        self.settings = settings.replace(samples_per_pixel=1)
        self.camera = camera or choose_camera(scene, settings.sequence.camera)
        self.frames = frame_range(scene, self.camera, settings)
        self.size, self.name = (settings.sequence.width, settings.sequence.height), scene.name
        self._poser = Poser(scene)
        self.center, self.radius = bounding_sphere(self._poser, bound_times(scene))
        self._all = decide(scene, self.settings)
        self.source: RasterSource | None = None
        self._extra: frozenset[str] = frozenset()
        self._off: frozenset[str] | None = None
        self._held: list[Any] = [None, None]  # keys of previous and current

    @property
    def effects(self) -> Mapping[str, Effect]:
        return self._all if self.source is None else self.source.effects

    @property
    def switchable(self) -> tuple[str, ...]:
        """Effects that are on, so that switching them off shows something."""
        return tuple(n for n in SWITCHABLE if self._all[n].enabled)

    def pictures(self) -> tuple[str, ...]:
        return pictures.of_scene(dict(self.effects))

    def file_shot(self, frame: int) -> Shot:
        return Shot(frame, self.camera.view_at(self._poser.sample(frame / self.settings.sequence.fps)))

    def plan(self, extra: frozenset[str], off: frozenset[str]) -> bool:
        have = () if self.source is None else self.source.channels
        if self.source is not None and off == self._off and extra <= {*have, *self._extra}:
            return False
        self._extra = self._extra | extra
        source = RasterSource(
            self._gpu,
            self.scene,
            self.camera,
            self.settings,
            extra=tuple(n for n in CHANNELS if n in self._extra),
            timer=self._timer,
            poser=self._poser,
            without=tuple(off),
        )
        if self.source is not None:  # only now: what cannot be made leaves what there was
            self.source.release()
        self.source, self._off, self._held = source, off, [None, None]
        return True

    def show(self, previous: Shot, current: Shot) -> bool:
        wanted = [previous.key, (*current.key, *previous.key)]
        if self._held == wanted:
            return False
        held = self._held[1]
        if held is None or held[:3] != previous.key:
            self.source.draw_pair(previous.frame, previous.frame, previous.view, previous.view)
        self.source.draw_pair(current.frame, previous.frame, current.view, previous.view)
        self._held = wanted
        return True

    def look(self, shot: Shot) -> bool:
        """Draw ``shot`` alone, for somebody who looks on from outside."""
        wanted = [None, (*shot.key, *shot.key)]
        if self._held == wanted:
            return False
        self.source.draw_pair(shot.frame, shot.frame, shot.view, shot.view)
        self._held = wanted
        return True

    def release(self) -> None:
        if self.source is not None:
            self.source.release()
            self.source = None


class PathTracedFeed:
    """Path-traced OpenEXR frames: their camera is the files'."""

    free = False
    switchable: tuple[str, ...] = ()

    def __init__(self, gpu: Gpu, spec: str, settings: Settings, options: PathTracedOptions):
        self.sequence = PathTracedSequence.open(spec, mapping=options.mapping, layer=options.layer)
        camera, fps = choose_camera_source(options, settings)
        width, height = self.sequence.size
        self.settings = settings.replace(width=width, height=height, fps=fps)
        self.frames = self.sequence.select(settings.sequence.frames)
        self.size, self.name = (width, height), self.sequence.name
        self.center, self.radius = np.zeros(3), 1.0
        self.effects: Mapping[str, Effect] = {}
        self.source = PathTracedSource(gpu, self.sequence, camera, self.settings)
        self._views: dict[int, View] = {}
        self._held: tuple[int | None, int | None] = (None, None)  # previous and current frame
        self._shown: tuple[int, int] | None = None

    def file_shot(self, frame: int) -> Shot:
        """The view of a frame is known once the frame was read."""
        if frame not in self._views:
            self._read(frame)
        return Shot(frame, self._views[frame])

    def pictures(self) -> tuple[str, ...]:
        return pictures.of_channels(self.source.channels)

    def plan(self, extra: frozenset[str], off: frozenset[str]) -> bool:
        return False

    def show(self, previous: Shot, current: Shot) -> bool:
        wanted = (previous.frame, current.frame)
        if self._shown == wanted:
            return False
        if self._held != wanted:
            if self._held[1] != previous.frame:
                self._read(previous.frame)
            self._read(current.frame)
        self._shown = wanted
        return True

    def _read(self, frame: int) -> None:
        self._views[frame] = self.source.advance(frame)
        self._held, self._shown = (self._held[1], frame), None

    def release(self) -> None:
        self.source.release()
