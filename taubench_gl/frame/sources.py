"""Sources of Channels: whatever gives the frames of a sequence, one after another, as textures of known meaning.

The rasterizer is one source, path-traced files are another; one mask implementation judges both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import moderngl
import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View
from taubench_gl.animation.jitter import grid_offsets
from taubench_gl.effects.decide import as_summary, decide, switch_off, unmeasured
from taubench_gl.effects.decide import force as force_on
from taubench_gl.frame.flow import light_flow
from taubench_gl.frame.light_stage import LightStage
from taubench_gl.frame.plan import frame_channels
from taubench_gl.frame.renderer import Renderer
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.targets import History
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings


class Source(Protocol):
    """What an evaluation asks of a sequence.  ``advance`` is called for every frame in order."""

    size: tuple[int, int]
    reprojection: str  # the mode this source can serve: camera | motion
    radiance: tuple[str, ...]  # of direct, indirect, color: those it has
    unmeasured: Mapping[str, str]  # column -> why it is null
    cuts: bool  # ``current`` has ``ids`` that mark surfaces without history

    def advance(self, frame: int) -> View:
        """Make ``frame`` current and what was current history; the frame's view."""

    @property
    def current(self) -> Mapping[str, moderngl.Texture]: ...

    @property
    def previous(self) -> Mapping[str, moderngl.Texture]: ...

    def read(self, name: str, *, previous: bool = False) -> np.ndarray:
        """A channel as (h, w, components), row 0 at the top."""

    def describe(self) -> dict[str, Any]:
        """What only this source can say of itself: summary blocks ``effects``, ``memory``."""

    def release(self) -> None: ...


class RasterSource:
    """Frames of a Scene, rasterized."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        settings: Settings,
        *,
        extra: tuple[str, ...] = (),
        timer: PassTimer | None = None,
        poser: Poser | None = None,
        force: tuple[str, ...] = (),
        without: tuple[str, ...] = (),
        jitter: Callable[[int], np.ndarray] | None = None,
        shading: Shading | None = None,
    ):
        """``extra``: channels besides those the columns need; ``force``: effects to simulate although nothing asks;
        ``without``: effects not to simulate although something does, and what rests on them;
        ``jitter``: sub-pixel offset (2,) of each frame's samples, such as ``animation.jitter.halton_jitter``;
        ``shading``: fewer pixels or random lights in the place of exact light, see ``frame.shading``."""
        self._jitter = jitter
        self.samples = settings.metrics.samples_per_pixel
        self._offsets = grid_offsets(self.samples)
        self.size = (settings.sequence.width, settings.sequence.height)
        self._fps = settings.sequence.fps
        self.effects = switch_off(force_on(decide(scene, settings), force), without)
        # Where no surface moves by itself, motion reprojection is camera reprojection: nothing is stored for it.
        self.reprojection = settings.metrics.reprojection if self.effects["previous_pose"].enabled else "camera"
        self.unmeasured = unmeasured(self.effects, settings)
        self.cuts = self.effects["cuts"].enabled
        self.radiance = tuple(c for c in ("direct", "indirect", "color") if c not in self.unmeasured)
        channels = frame_channels(self.effects, extra)
        timer = timer or PassTimer(gpu, enabled=False)
        self.renderer = Renderer(
            gpu,
            scene,
            camera,
            self.size,
            channels,
            culling=settings.sequence.culling,
            textures=settings.sequence.textures,
            storage=settings.device.storage,
            normal_maps=self.effects["normal_maps"].enabled,
            timer=timer,
            poser=poser,
        )
        # Every sample place has a history of its own; scene, shadows and probes are shared.
        more = (
            History(gpu, self.size, self.renderer.channels, settings.device.storage) for _ in range(self.samples - 1)
        )
        self._histories = [self.renderer.history, *more]
        self.light = None
        if light_flow(self.effects):
            self.light = LightStage(self.renderer, settings, self.effects, timer, shading)

    def advance(self, frame: int) -> View:
        return self._draw(frame, None if self._jitter is None else self._jitter(frame))

    def advance_sample(self, frame: int, sample: int) -> View:
        """``advance`` for one of the ``samples`` places within a pixel (``grid_offsets``), which has its own history.

        ``current`` and ``previous`` are that sample's until the next call.
        """
        self.renderer.history = self._histories[sample]
        return self._draw(frame, self._offsets[sample] if self.samples > 1 else None)

    def draw_pair(self, frame: int, previous_frame: int, view: View, previous_view: View) -> View:
        """``advance`` with views and a previous frame of the caller's choice, for cameras that people move."""
        fps = self._fps
        self.renderer.draw(frame / fps, previous_frame / fps, views=(view, previous_view))
        if self.light is not None:
            self.light.run(frame)
        return view

    def _draw(self, frame: int, offset: np.ndarray | None) -> View:
        self.renderer.draw(frame / self._fps, (frame - 1) / self._fps, offset)
        if self.light is not None:
            self.light.run(frame)
        return self.renderer.drawn.view

    @property
    def current(self) -> Mapping[str, moderngl.Texture]:
        return self.renderer.history.current.textures

    @property
    def previous(self) -> Mapping[str, moderngl.Texture]:
        return self.renderer.history.previous.textures

    @property
    def channels(self) -> tuple[str, ...]:
        return self.renderer.channels

    def read(self, name: str, *, previous: bool = False) -> np.ndarray:
        return self.renderer.read(name, previous=previous)

    def describe(self) -> dict[str, Any]:
        size = self.renderer.bytes + (0 if self.light is None else self.light.bytes)
        size += sum(h.bytes for h in self._histories if h is not self.renderer.history)
        notes = [] if self.light is None else self.light.notes()
        return {"effects": as_summary(self.effects), "memory": {"gpu_bytes": size}, "notes": notes}

    def release(self) -> None:
        if self.light is not None:
            self.light.release()
        for history in self._histories:
            if history is not self.renderer.history:
                history.release()
        self.renderer.release()
        self.renderer.shaders.release()
