"""Sources of Channels: whatever gives the frames of a sequence, one after another, as textures of known meaning.

The rasterizer is one source, path-traced files are another; one mask implementation judges both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import moderngl
import numpy as np

from taubench_gl.animation import CameraTrack, Poser, View
from taubench_gl.effects.decide import as_summary, decide, unmeasured
from taubench_gl.effects.decide import force as force_on
from taubench_gl.frame.light_stage import LightStage
from taubench_gl.frame.plan import frame_channels, light_channels
from taubench_gl.frame.renderer import Renderer
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
    ):
        """``extra``: channels besides those the columns need; ``force``: effects to simulate although nothing asks."""
        self.size = (settings.width, settings.height)
        self._fps = settings.fps
        self.effects = force_on(decide(scene, settings), force)
        # Where no surface moves by itself, motion reprojection is camera reprojection: nothing is stored for it.
        self.reprojection = settings.reprojection if self.effects["previous_pose"].on else "camera"
        self.unmeasured = unmeasured(self.effects, settings)
        self.radiance = tuple(c for c in ("direct", "indirect", "color") if c not in self.unmeasured)
        channels = frame_channels(self.effects, extra)
        timer = timer or PassTimer(gpu, enabled=False)
        self.renderer = Renderer(
            gpu,
            scene,
            camera,
            self.size,
            channels,
            culling=settings.culling,
            textures=settings.textures,
            normal_maps=self.effects["normal_maps"].on,
            timer=timer,
            poser=poser,
        )
        self.light = (
            LightStage(self.renderer, settings, self.effects, timer) if light_channels(self.effects, extra) else None
        )

    def advance(self, frame: int) -> View:
        moment = frame / self._fps
        self.renderer.draw(moment, (frame - 1) / self._fps)
        if self.light is not None:
            self.light.run()
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
        notes = [] if self.light is None else self.light.notes()
        return {"effects": as_summary(self.effects), "memory": {"gpu_bytes": size}, "notes": notes}

    def release(self) -> None:
        if self.light is not None:
            self.light.release()
        self.renderer.release()
        self.renderer.shaders.release()
