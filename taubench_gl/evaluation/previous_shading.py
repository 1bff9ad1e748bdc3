"""Whether light changed at the same surface points: the previous frame's light at the current frame's points."""

from __future__ import annotations

import numpy as np

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.frame.sources import RasterSource, SourceOptions
from taubench_gl.frame.targets import read_channel, write_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray
SURFACE = ("normal", "geometric_normal", "base_color", "material")
"""Channels of a point that light depends on, besides its position."""


def needed() -> tuple[str, ...]:
    """Channels that the current frame's source must draw besides those of the columns."""
    return ("prev_position", "ids", *SURFACE)


class PreviousShading:
    """Lights the points of a source's current frame as they were in the frame before, seen from the previous camera.

    The previous frame is drawn for its lights, shadows and probes; then its points are replaced by the places that the
    current frame's points had.  With the same sample numbers in both frames a point whose light is unchanged has the
    same radiance.  Normals of rigid objects are turned back; those of skinned and morphed ones are the current ones.
    """

    def __init__(self, gpu: Gpu, scene: Scene, camera: CameraTrack, settings: Settings, poser: Poser):
        self._exposure = settings.lighting.exposure_factor
        options = SourceOptions(extra=SURFACE)
        self._source = RasterSource(gpu, scene, camera, settings, options, poser=poser)
        self.radiance = tuple(name for name in ("direct", "indirect") if name in self._source.radiance)

    def of(self, current: RasterSource, frame: int) -> dict[str, Array]:
        """``direct`` and ``indirect`` (h, w, 3) float32, row 0 at the top, of the points of ``current``, which holds
        ``frame`` with prev_position, ids and SURFACE; without exposure."""
        view = self._source.draw(frame - 1)
        position = current.read("position")
        q = current.read("prev_position")[..., :3]
        depth = q @ (-view.world_from_view[:, 2]).astype(np.float32)
        seen = (position[..., 3] > 0) & (depth > 0)
        points = np.where(seen[..., None], np.concatenate([q, depth[..., None]], axis=-1), np.float32(0))
        target = self._source.current
        write_channel(target["position"], "position", points)
        turned = self._turned_back(current)
        for name in SURFACE:
            values = current.read(name)
            if name in ("normal", "geometric_normal"):
                values = values.copy()
                values[..., :3] = np.einsum("hwij,hwj->hwi", turned, values[..., :3].astype(np.float32))
            write_channel(target[name], name, values)
        self._source.light.run(frame)
        return {name: read_channel(target[name], name)[..., :3] for name in self.radiance}

    def changes(self, current: RasterSource, frame: int) -> dict[str, Array]:
        """Radiance now less radiance then, times exposure, of each point: (h, w, 3) float64 by column."""
        before = self.of(current, frame)
        return {n: (current.read(n)[..., :3].astype(np.float64) - v) * self._exposure for n, v in before.items()}

    @staticmethod
    def _turned_back(current: RasterSource) -> Array:
        """Rotation of each pixel's object from this frame to the frame before.  (h, w, 3, 3) float32."""
        frame = current.renderer.frame
        now, then = frame.placement.world[:, :3, :3], frame.before[2].world[:, :3, :3]
        posed = np.array([draw.posed for draw in current.renderer.draws], dtype=bool)
        table = np.tile(np.eye(3), (len(now) + 1, 1, 1))
        regular = ~posed & (np.abs(np.linalg.det(now)) > 1e-30) & (np.abs(np.linalg.det(then)) > 1e-30)
        for row in np.flatnonzero(regular & (np.abs(now - then).max(axis=(1, 2)) > 0)):
            u, _, v = np.linalg.svd(then[row] @ np.linalg.inv(now[row]))
            table[row + 1] = u @ v
        return table.astype(np.float32)[current.read("ids")[..., 0]]

    def release(self) -> None:
        self._source.release()
