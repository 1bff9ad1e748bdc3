"""Exact reasons in the viewer: rays and the light of the same points of the pair shown, as further bits of its mask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.evaluation.exact import ExactReasons
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.viewer.feeds import SceneFeed
from taubench_gl.viewer.state import EXACT_OVERLAYS, SHIFT

if TYPE_CHECKING:
    import moderngl

Array = np.ndarray


class ExactMasks:
    """A mask texture with the bits of mask and exact reasons, and the share of pixels of each reason."""

    def __init__(self, gpu: Gpu):
        self._gpu = gpu
        self._reasons: dict[int, tuple[RasterSource, ExactReasons]] = {}  # by id of the source
        self.texture: moderngl.Texture | None = None
        self.percent: dict[str, float | None] = {}

    def update(self, feed: SceneFeed, frame: int, mask: Array, off: frozenset[str]) -> None:
        """Find the reasons of the pair that ``feed`` shows, drawn with ``exact_channels``.

        ``mask`` (h, w): of the pair; ``off``: effects that are switched off.  Raises GraphicsError.
        """
        source = feed.source
        if id(source) not in self._reasons:  # with coarse light, geometry has a source of its own
            found = ExactReasons(
                self._gpu, feed.scene, feed.camera, feed.settings, feed.poser, source.radiance, without=tuple(off)
            )
            self._reasons[id(source)] = source, found
        reasons = self._reasons[id(source)][1]
        bits = reasons.of(source, frame).bits
        if self.texture is None or self.texture.size != source.size:
            self._drop_texture()
            self.texture = self._gpu.ctx.texture(source.size, 1, dtype="u4")
        self.texture.write((mask | bits << np.uint32(SHIFT)).astype(np.uint32)[::-1].tobytes())
        self.percent = {name: 100.0 * float(np.mean((bits & wanted) != 0)) for name, wanted in EXACT_OVERLAYS.items()}
        if not reasons.lit:
            self.percent |= dict.fromkeys(("exact_brightened", "exact_darkened", "exact_view_dependent"))

    def _drop_texture(self) -> None:
        if self.texture is not None:
            self.texture.release()
            self.texture = None

    def release(self) -> None:
        """Also before another source is shown."""
        for _, reasons in self._reasons.values():
            reasons.release()
        self._drop_texture()
        self._reasons, self.percent = {}, {}
