"""The rasterizer: a Scene and a camera in, channels of any frame out.  One object per scene, size and channel set."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from taubench_gl.animation import CameraTrack, FrameState, Poser, View
from taubench_gl.channels import CHANNELS
from taubench_gl.frame.draw_bounds import DrawBounds, in_view
from taubench_gl.frame.geometry import build_geometry
from taubench_gl.frame.materials import MaterialTable
from taubench_gl.frame.passes.deform import DeformPass
from taubench_gl.frame.passes.gbuffer import GBufferPass, attachments
from taubench_gl.frame.records import Placement, RecordTable
from taubench_gl.frame.scene_buffers import SceneBuffers
from taubench_gl.frame.targets import History, Targets, read_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.scene.model import Scene


@dataclass(frozen=True, slots=True)
class Drawn:
    """What the current frame was drawn from, for the passes that follow."""

    state: FrameState
    view: View
    placement: Placement


class Renderer:
    """Draws frames of one scene.  ``previous`` poses are evaluated at the previous time, never remembered."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        size: tuple[int, int],
        channels: Collection[str],
        *,
        culling: str = "gltf",
        textures: str = "mipmapped",
        storage: str = "float",
        normal_maps: bool = True,
        shaders: ShaderCache | None = None,
        timer: PassTimer | None = None,
        poser: Poser | None = None,
    ):
        self.gpu, self.scene, self.camera, self.size = gpu, scene, camera, size
        self.channels = tuple(name for name in CHANNELS if name in channels and name not in ("mask", "motion"))
        drawn = attachments(self.channels)
        self.poser = poser or Poser(scene)
        self.shaders = shaders or ShaderCache(gpu.ctx)
        self.timer = timer or PassTimer(gpu, enabled=False)
        self._culling = culling == "gltf"
        self._previous = "prev_position" in self.channels
        geometry = build_geometry(scene)
        self.draws = geometry.draws
        self.colored = _colored(scene)
        self._table = RecordTable(geometry.draws, scene.replacements)
        self.buffers = SceneBuffers(gpu, geometry, previous=self._previous)
        self._bounds = DrawBounds(scene, geometry.draws)
        self._posed = np.array([d.posed for d in geometry.draws], dtype=bool)
        self._deform = None
        if self._posed.any():
            self._deform = DeformPass(gpu, self.shaders, scene, geometry, previous=self._previous)
        used = {d.material for d in geometry.draws}
        self.materials = MaterialTable(
            gpu, scene, drawn, used, normal_maps=normal_maps, mipmaps=textures == "mipmapped"
        )
        self._gbuffer = GBufferPass(gpu, self.shaders, drawn, self.colored)
        self.history = History(gpu, size, self.channels, storage)
        self.drawn: Drawn | None = None
        self._views: dict[float, tuple[FrameState, View]] = {}

    def view(self, time: float) -> tuple[FrameState, View]:
        """The pose and the camera at ``time`` seconds.

        A pure function of (scene, camera, time).  The last two values are kept by their time, because a frame's
        previous pose is most often the last frame's: nothing here depends on what was asked, or drawn, before.
        """
        if time not in self._views:
            state = self.poser.sample(time)
            while len(self._views) > 1:
                del self._views[next(iter(self._views))]
            state.world.flags.writeable = state.visible.flags.writeable = False
            self._views[time] = state, self.camera.view_at(state)
        return self._views[time]

    def draw(
        self,
        time: float,
        previous_time: float,
        jitter_px: np.ndarray | None = None,
        views: tuple[View, View] | None = None,
    ) -> Targets:
        """Draw the frame at ``time``; what was current becomes history.  Returns the current targets.

        ``jitter_px`` (2,): sub-pixel offset of the samples, as ``View.jitter_px``; None: pixel centres.  ``views``:
        current and previous view in the place of the camera's.
        """
        with self.timer.measure("pose"):
            state, view = self.view(time)
            if jitter_px is not None:
                view = replace(view, jitter_px=np.asarray(jitter_px, dtype=np.float64))
            before, before_view = self.view(previous_time) if self._previous else (state, view)
            if views is not None:
                view, before_view = views
            if self.scene.replacements:
                self._table.mark_cuts(state, before if self._previous else self.view(previous_time)[0])
        self.history.advance()
        mirrored = np.zeros(len(self._posed), dtype=bool)
        if self._deform is not None:
            with self.timer.measure("deform"):
                mirrored[self._posed] = self._deform.run(state, view, before, before_view, self.buffers.pools[True])
        with self.timer.measure("records"):
            now = self._table.place(state, view, mirrored)
            then = self._table.place(before, before_view, mirrored) if self._previous else now
            self.buffers.arrange(now, self.materials, culling=self._culling)
            self.buffers.show(self._seen(view, now))
            self.buffers.write_records(self._table.update(now, then))
        with self.timer.measure("gbuffer"):
            self._gbuffer.run(view, self.history.current, self.buffers, self.materials)
        self.drawn = Drawn(state, view, now)
        return self.history.current

    def _seen(self, view: View, placement: Placement) -> np.ndarray:
        """Draws that may be in the picture, (D,) bool.  Posed ones always: a pose is dear to bound."""
        centers, radii = self._bounds.of_fixed(placement.world)
        extent = np.linalg.norm(placement.relative[:, :3, 3], axis=1)
        return in_view(view.clip_from_relative(*self.size), centers - view.position, radii, extent)

    def read(self, name: str, *, previous: bool = False) -> np.ndarray:
        """A channel of the current (or previous) frame: (h, w, components), row 0 at the top."""
        targets = self.history.previous if previous else self.history.current
        return read_channel(targets.textures[name], name)

    @property
    def bytes(self) -> int:
        """GPU memory held for this scene and size, bytes."""
        return self.history.bytes + self.buffers.bytes + self.materials.texture_bytes

    def release(self) -> None:
        for part in (self.history, self.buffers, self.materials, self._gbuffer, self._deform):
            if part is not None:
                part.release()


def _colored(scene: Scene) -> frozenset[int]:
    """Materials (-1: default) of primitives with vertex colours."""
    return frozenset(p.material for m in scene.meshes for p in m.primitives if p.colors is not None)
