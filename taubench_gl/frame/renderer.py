"""The rasterizer: a Scene and a camera in, channels of any frame out.  One object per scene, size and channel set."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import CameraTrack, FrameState, Poser, View
from taubench_gl.channels import CHANNELS
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
        self._table = RecordTable(geometry.draws)
        self.buffers = SceneBuffers(gpu, geometry, previous=self._previous)
        self._posed = np.array([d.posed for d in geometry.draws], dtype=bool)
        self._deform = None
        if self._posed.any():
            self._deform = DeformPass(gpu, self.shaders, scene, geometry, previous=self._previous)
        used = {d.material for d in geometry.draws}
        self.materials = MaterialTable(
            gpu, scene, drawn, used, normal_maps=normal_maps, mipmaps=textures == "mipmapped"
        )
        self._gbuffer = GBufferPass(gpu, self.shaders, drawn, self.colored)
        self.history = History(gpu, size, self.channels)
        self.drawn: Drawn | None = None

    def view(self, time: float) -> tuple[FrameState, View]:
        """The pose and the camera at ``time`` seconds."""
        state = self.poser.sample(time)
        return state, self.camera.view_at(state)

    def draw(self, time: float, previous_time: float) -> Targets:
        """Draw the frame at ``time``; what was current becomes history.  Returns the current targets."""
        with self.timer.measure("pose"):
            state, view = self.view(time)
            before, before_view = self.view(previous_time) if self._previous else (state, view)
        self.history.advance()
        mirrored = np.zeros(len(self._posed), dtype=bool)
        if self._deform is not None:
            with self.timer.measure("deform"):
                mirrored[self._posed] = self._deform.run(state, view, before, before_view, self.buffers.pools[True])
        with self.timer.measure("records"):
            now = self._table.place(state, view, mirrored)
            then = self._table.place(before, before_view, mirrored) if self._previous else now
            if len(self._posed):
                self.buffers.records.write(self._table.update(now, then).tobytes())
            self.buffers.arrange(now, self.materials, culling=self._culling)
        with self.timer.measure("gbuffer"):
            self._gbuffer.run(view, self.history.current, self.buffers, self.materials)
        self.drawn = Drawn(state, view, now)
        return self.history.current

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
