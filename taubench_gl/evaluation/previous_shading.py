"""Light at the same surface points in two frames: the previous frame's light at the current frame's points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from taubench_gl.animation import View
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.targets import write_channel
from taubench_gl.math3d import normalize
from taubench_gl.settings import Settings

Array = np.ndarray
SURFACE = ("normal", "geometric_normal", "base_color", "material")
"""Channels of a point that light depends on, besides its position."""

LIGHT = ("direct", "indirect")

Variant = Callable[..., RasterSource]
"""``Session.variant``: settings and options -> another source of the same scene."""


def needed() -> tuple[str, ...]:
    """Channels that the current frame's source must draw besides those of the columns."""
    return ("prev_position", "ids", *SURFACE)


@dataclass(frozen=True, slots=True)
class PointLight:
    """Changes of light at the points of a frame since the frame before, float64.  Radiance is times exposure.

    ``total``: direct, indirect -> (h, w, 3), towards the camera now less then; ``by_direction``: likewise, of the light
    then, towards the direction of the camera now less then; ``color`` (h, w): largest change of a channel of sRGB
    color; ``noise``: as ``total``, between two sets of samples of the light then.  None: not measured.
    """

    total: dict[str, Array]
    by_direction: dict[str, Array]
    color: Array | None
    noise: dict[str, Array] | None


class PreviousShading:
    """Lights the points of a source's current frame as they were in the frame before.

    The previous frame is drawn for its lights, shadows and probes; then its points are replaced by the places that the
    current frame's points had.  With the same sample numbers in both frames a point whose light is unchanged has the
    same radiance.  Normals and directions are turned back with rigid objects; on skinned and morphed surfaces they
    are the current ones.
    """

    def __init__(self, variant: Variant, settings: Settings, without: tuple[str, ...] = ()):
        """``variant``: opens the source of the previous frame; ``without``: effects not to simulate."""
        self._exposure = settings.lighting.exposure_factor
        self._source = variant(settings, extra=SURFACE, without=without, given_directions=True)
        self.radiance = tuple(name for name in LIGHT if name in self._source.radiance)
        self._copied = tuple(n for n in (*SURFACE, "emission") if n in self._source.channels)
        self._glossy = self._source.effects["glossy"].enabled

    def of(self, current: RasterSource, frame: int, *, noise: bool = False) -> PointLight:
        """Changes at the points of ``current``, which holds frame number ``frame`` with the channels of ``needed``.

        ``noise``: also take other samples of path-traced light.
        """
        view, before = current.renderer.frame.view, current.renderer.frame.before[1]
        self._source.draw_at(current.previous_time, before)
        position, turned = current.read("position"), self._turned_back(current)
        points = self._place(current, position, before, turned)
        self._source.light.give_directions(_to_camera(points, before))
        then = self._lit(frame)
        color = self._color(current, position)
        other = self._other_samples(frame) if noise else None
        turned_to = then
        if self._glossy and self.radiance:
            self._source.light.give_directions(np.einsum("hwij,hwj->hwi", turned, _to_camera(position, view)))
            turned_to = self._lit(frame)
        now = {name: self._radiance(current.read(name)) for name in self.radiance}
        return PointLight(
            {name: now[name] - then[name] for name in now},
            {name: turned_to[name] - then[name] for name in now},
            color,
            None if other is None else {name: other[name] - then[name] for name in now},
        )

    def _place(self, current: RasterSource, position: Array, before: View, turned: Array) -> Array:
        """Replace the points of the previous frame by those of ``current``.  Their position channel, (h, w, 4)."""
        q = current.read("prev_position")[..., :3]
        depth = q @ (-before.world_from_view[:, 2]).astype(np.float32)
        seen = (position[..., 3] > 0) & (depth > 0)
        points = np.where(seen[..., None], np.concatenate([q, depth[..., None]], axis=-1), np.float32(0))
        target = self._source.current
        write_channel(target["position"], "position", points)
        for name in self._copied:
            values = current.read(name)
            if name in ("normal", "geometric_normal"):
                values = values.copy()
                values[..., :3] = np.einsum("hwij,hwj->hwi", turned, values[..., :3].astype(np.float32))
            write_channel(target[name], name, values)
        return points

    def _lit(self, frame: int) -> dict[str, Array]:
        self._source.light.run(frame)
        return {name: self._radiance(self._source.read(name)) for name in self.radiance}

    def _radiance(self, values: Array) -> Array:
        return values[..., :3].astype(np.float64) * self._exposure

    def _color(self, current: RasterSource, position: Array) -> Array | None:
        """Largest change of a channel of sRGB color at each point, (h, w), 0 in the sky: a view direction keeps its
        sky.  None where the source has no color.
        """
        if "color" not in self._source.radiance:
            return None
        change = np.abs(current.read("color")[..., :3].astype(np.float64) - self._source.read("color")[..., :3])
        return np.where(position[..., 3] > 0, change.max(axis=-1), 0.0)

    def _other_samples(self, frame: int) -> dict[str, Array] | None:
        """Light by samples that no other image has taken; None where no light has samples."""
        paths = self._source.light.paths
        if paths is None:
            return None
        paths.first_sample = paths.sample_count
        found = self._lit(frame)
        paths.first_sample = 0
        return found

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


def _to_camera(position: Array, view: View) -> Array:
    """Unit directions from points relative to a camera, (h, w, >=3), to that camera, (h, w, 3) float64."""
    if view.camera.parallel:
        return np.broadcast_to(view.world_from_view[:, 2], (*position.shape[:2], 3))
    return normalize(-position[..., :3].astype(np.float64))
