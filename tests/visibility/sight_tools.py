"""Pairs of frames with the channel ``prev_visibility``, and the float64 answer for the same points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from fixed import fixed_settings
from ray_caster import gather
from references.visibility import PreviousSurfaces, visibility

from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import Visibility
from taubench_gl.frame.passes.pathtracing import pixel_footprint
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu

Array = np.ndarray
CHANNELS = ("prev_visibility", "prev_position", "ids", "geometric_normal")


@dataclass
class Sight:
    """One pair as the pass saw it."""

    bits: Array  # (h, w)
    channels: dict[str, Array]
    source: RasterSource

    @property
    def kind(self) -> Array:
        """``bits`` without SKY and MOVED."""
        return self.bits & ~np.uint32(Visibility.SKY | Visibility.MOVED)


def look(gpu: Gpu, scene, camera, size, frame=1, *, fps=24.0, **settings) -> Sight:
    """The pair (frame - 1, frame)."""
    settings = fixed_settings(
        width=size[0], height=size[1], fps=fps, columns=("frustum", "position"), reprojection="motion", **settings
    )
    with RasterSource(gpu, AnimatedScene(scene, camera), settings, extra=CHANNELS) as source:
        source.advance(frame)
        channels = {name: source.read(name) for name in source.channels}
        assert source.visibility.structure.unfinished_rays == 0
    gpu.collect()
    return Sight(channels["prev_visibility"][..., 0], channels, source)


def surfaces_before(sight: Sight) -> PreviousSurfaces:
    """Triangles of the frame before, relative to its camera, from the float64 pose."""
    state, view, _ = sight.source.renderer.frame.before
    found = gather(sight.source.renderer.scene, state, state)
    return PreviousSurfaces(found.corners - view.position, found.culled_back)


def reference(sight: Sight, *, snapped: float = 1.0, offset=(0.0, 0.0)) -> Array:
    """Bits by ``references.visibility``.  ``offset``: of the points, previous pixels right and up."""
    frame, size = sight.source.renderer.frame, sight.source.size
    before = frame.before[1]
    pair = reprojection(frame.view, before, *size)
    prev = sight.channels["prev_position"].astype(np.float64)
    footprint = pixel_footprint(before, size)
    depth = np.maximum(prev[..., :3] @ pair.prev_forward, 0.0)[..., None]
    axes = before.world_from_view
    step = offset[0] * axes[:, 0] + offset[1] * axes[:, 1]
    prev[..., :3] += (footprint[0] + footprint[1] * depth) * step
    reach = float(np.abs(sight.channels["position"][..., :3]).max())
    return visibility(
        pair, sight.channels["position"], prev, surfaces_before(sight),
        footprint=tuple(snapped * x for x in footprint), threshold=0.1, slack=1e-5 * reach,
    )  # fmt: skip


def surely(sight: Sight, width: float = 1 / 16) -> tuple[Array, Array]:
    """Reference without MOVED, (h, w), and the pixels (h, w) bool where it is the same for points up to ``width`` of a
    pixel away: outside of that band around edges any difference is a fault."""
    own = np.uint32(~np.uint32(Visibility.MOVED))
    middle = reference(sight) & own
    same = np.ones(middle.shape, dtype=bool)
    for right, up in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
        same &= (reference(sight, offset=(width * right, width * up)) & own) == middle
    for snapped in (0.25, 4.0):
        same &= (reference(sight, snapped=snapped) & own) == middle
    return middle, same
