"""The rasterizer: a Scene and a camera in, channels of any frame out.  One object per scene, size and channel set."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from taubench_gl.animation import CameraTrack, FrameState, Poser, View
from taubench_gl.animation.pose import present_nodes
from taubench_gl.channels import CHANNELS
from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.draw_bounds import in_view
from taubench_gl.frame.materials import MaterialTable
from taubench_gl.frame.passes.deform import DeformPass
from taubench_gl.frame.passes.gbuffer import GBufferPass, attachments, channel_pass
from taubench_gl.frame.records import Placement, RecordTable
from taubench_gl.frame.scene_buffers import SceneBuffers, StoredGeometry
from taubench_gl.frame.targets import History, Targets, read_channel
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.scene.model import Scene


class Renderer(Owner):
    """Draws frames of one scene.  A pose is evaluated at its own time; nothing is taken from earlier calls."""

    def __init__(
        self,
        context: GpuContext,
        scene: Scene,
        camera: CameraTrack,
        size: tuple[int, int],
        channels: Collection[str],
        *,
        culling: str = "gltf",
        textures: str = "mipmapped",
        storage: str = "float",
        normal_maps: bool = True,
        poser: Poser | None = None,
    ):
        """``culling``, ``textures``, ``storage``: as in Settings."""
        super().__init__()
        gpu = context.gpu
        self.context, self.scene, self.camera, self.size = context, scene, camera, size
        self.culling, self._storage = culling, storage
        self.channels = tuple(name for name in CHANNELS if name in channels and name not in ("mask", "motion"))
        drawn = attachments(self.channels)
        self.poser = poser or Poser(scene)
        self._previous = "prev_position" in self.channels
        geometry = self.own(StoredGeometry.held(gpu, scene)).value
        self.draws = geometry.draws
        self._table = RecordTable(geometry.draws, scene.replacements)
        self.buffers = self.own(SceneBuffers(gpu, geometry))
        self.bounds = geometry.bounds
        self._posed = np.array([d.posed for d in geometry.draws], dtype=bool)
        self._deform = None
        if self._posed.any():
            self._deform = self.own(DeformPass(context, scene, geometry, previous=self._previous))
            self.buffers.pools[True] |= self._deform.outputs
        used = {d.material for d in geometry.draws}
        mipmaps = textures == "mipmapped"
        materials = MaterialTable(gpu, scene, drawn, used, normal_maps=normal_maps, mipmaps=mipmaps)
        self.materials = self.own(materials)
        colored = frozenset(p.material for m in scene.meshes for p in m.primitives if p.colors is not None)
        declaration = channel_pass("gbuffer", drawn, at_centers=Tuning(gpu.software).snapped_corners)
        self._gbuffer = self.own(GBufferPass(context, declaration, colored, self.bounds))
        self.history = self.own(self.new_history())
        self.frame: FrameContext | None = None
        """The frame that ``draw`` drew last; None before the first."""
        self.marks_absent = False
        """Whether ``ids`` mark surfaces as ABSENT, for a renderer with ``prev_position``."""
        self._views: dict[float, View] = {}

    def new_history(self) -> History:
        """More render targets for ``draw``; the caller releases them."""
        return History(self.context.gpu, self.size, self.channels, self._storage)

    def view(self, time: float) -> tuple[FrameState, View]:
        """The pose and the camera at ``time`` seconds.

        A pure function of (scene, camera, time).  The last two views are kept by their time, because a frame's
        previous view is most often the last frame's.
        """
        state = self.poser.sample(time)
        if time not in self._views:
            while len(self._views) > 1:
                del self._views[next(iter(self._views))]
            self._views[time] = self.camera.view_at(state)
        return state, self._views[time]

    def draw(
        self,
        time: float,
        previous_time: float,
        jitter_px: np.ndarray | None = None,
        views: tuple[View, View] | None = None,
        history: History | None = None,
        collapsed: bool = False,
    ) -> Targets:
        """Draw the frame at ``time``; the current frame of its history becomes the previous one.  Returns its targets.

        ``jitter_px`` (2,): sub-pixel offset of the samples, as ``View.jitter_px``; None: pixel centers.  ``views``:
        current and previous view instead of the camera's.  ``history``: from ``new_history``; None: the renderer's own.
        ``collapsed``: vertices whose joints are all scaled to zero in the previous pose have no position in it.
        """
        timer, history = self.context.timer, history or self.history
        with timer.measure("pose"):
            state = self.poser.sample(time)
            before = self.poser.sample(previous_time) if self._previous else state
            view, before_view = views or self._own_views(time, previous_time, jitter_px)
            if self.scene.replacements or self.marks_absent:
                self._table.mark_cuts(state, before if self._previous else self.poser.sample(previous_time))
            if self.marks_absent:
                self._table.mark_absent(present_nodes(self.scene, before))
        history.advance()
        mirrored = np.zeros(len(self._posed), dtype=bool)
        if self._deform is not None:
            with timer.measure("deform"):
                poses = (state, view), (before, before_view)
                mirrored[self._posed] = self._deform.run(*poses, self.buffers.pools[True], collapsed)
        with timer.measure("records"):
            now = self._table.place(state, view, mirrored)
            then = self._table.place(before, before_view, mirrored) if self._previous else now
            self.buffers.arrange(now, self.materials, culling=self.culling == "gltf")
            self.buffers.show(self._seen(view, now))
            self.buffers.write_records(self._table.update(now, then))
        earlier = (before, before_view, then) if self._previous else None
        self.frame = FrameContext(state, view, now, self.buffers, self.materials, history, earlier)
        with timer.measure("gbuffer"):
            self._gbuffer.run(self.frame)
        return history.current

    def _own_views(self, time: float, previous_time: float, jitter_px: np.ndarray | None) -> tuple[View, View]:
        """Current and previous view of the camera, the current one moved by ``jitter_px``."""
        view = self.view(time)[1]
        if jitter_px is not None:
            view = replace(view, jitter_px=np.asarray(jitter_px, dtype=np.float64))
        return view, self.view(previous_time)[1] if self._previous else view

    def _seen(self, view: View, placement: Placement) -> np.ndarray:
        """Draws that may be in the image, (D,) bool.  Posed ones always: the bounds of a pose are expensive."""
        centers, radii = self.bounds.of_fixed(placement.world)
        extent = np.linalg.norm(placement.relative[:, :3, 3], axis=1)
        return in_view(view.clip_from_relative(*self.size), centers - view.position, radii, extent)

    def hidden_backs(self) -> int:
        """Pixels of the frame drawn last whose surface is seen through the culled back of a face."""
        return self._gbuffer.hidden_backs(self.frame)

    def read(self, name: str, *, previous: bool = False) -> np.ndarray:
        """A channel of the current (or previous) frame in the renderer's own history.

        (h, w, components), row 0 at the top.
        """
        targets = self.history.previous if previous else self.history.current
        return read_channel(targets.textures[name], name)

    @property
    def bytes(self) -> int:
        """GPU memory held for this scene and size, bytes."""
        return self.history.bytes + self.buffers.bytes + self.materials.texture_bytes
