"""Exact reasons in the viewer: rays and the light of the same points of the pair shown, as further bits of its mask."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.conventions import Visibility
from taubench_gl.evaluation.exact import ExactReasons
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.viewer.feeds import SceneFeed
from taubench_gl.viewer.state import EXACT_OVERLAYS, SHIFT

if TYPE_CHECKING:
    import moderngl

Array = np.ndarray


class ExactMasks(GpuOwner):
    """A mask texture with the bits of mask and exact reasons, and the share of pixels of each reason."""

    def __init__(self, gpu: Gpu):
        super().__init__(gpu)
        self._reasons: dict[int, tuple[RasterSource, ExactReasons]] = {}  # by id of the source
        self.texture: moderngl.Texture | None = None
        self.percent: dict[str, float | None] = {}
        self.bits: Array | None = None  # (h, w) uint32 of Visibility, row 0 at the top
        self.lit = False  # whether light was compared

    def update(self, feed: SceneFeed, frame: int, mask: Array, off: frozenset[str]) -> None:
        """Find the reasons of the pair that ``feed`` shows, drawn with ``exact_channels``.

        ``mask`` (h, w): of the pair; ``off``: effects that are switched off.  Raises GraphicsError.
        """
        source = feed.source
        if id(source) not in self._reasons:  # with coarse light, geometry has a source of its own
            variant = partial(self.open_source, feed.animated)
            reasons = ExactReasons(variant, feed.settings, source.radiance, without=tuple(off))
            self._reasons[id(source)] = source, reasons
        reasons = self._reasons[id(source)][1]
        bits = self.bits = reasons.of(source, frame).bits
        self.lit = reasons.lit
        if self.texture is None or self.texture.size != source.size:
            texture = self.gpu.ctx.texture(source.size, 1, dtype="u4")
            self.texture = self.own(texture, instead_of=self.texture)
        # Texture rows go upwards.
        self.texture.write((mask | bits << np.uint32(SHIFT)).astype(np.uint32)[::-1].tobytes())
        self.percent = {name: 100.0 * float(np.mean((bits & wanted) != 0)) for name, wanted in EXACT_OVERLAYS.items()}
        if not reasons.lit:
            self.percent |= dict.fromkeys(("exact_brightened", "exact_darkened", "exact_view_dependent"))

    def reset(self) -> None:
        """Free textures and reasons, before another source is shown."""
        self.release()
        self._reasons, self.percent, self.bits, self.texture = {}, {}, None, None


def exact_words(bits: int, lit: bool) -> str:
    """The exact reason of one pixel, of its bits of ``Visibility``.  ``lit``: whether light was compared."""
    sky = "sky, " if bits & Visibility.SKY else ""
    if bits & Visibility.INVALID:
        return "a position is not finite"
    if bits & Visibility.OCCLUDED:
        words = "disoccluded: behind another surface in the previous frame"
    elif bits & Visibility.OUTSIDE:
        words = "off-screen: outside the previous image"
    elif bits & Visibility.BEHIND:
        words = "off-screen: behind the previous camera"
    elif bits & Visibility.NEW:
        words = "new: not there in the previous frame"
    else:
        words = "visible in the previous frame" + _light_words(bits, lit)
    return sky + words


def _light_words(bits: int, lit: bool) -> str:
    if bits & Visibility.SKY:
        return ""
    if not lit:
        return "; light is not compared"
    changes = {
        Visibility.BRIGHTENED: ", and brightened",
        Visibility.DARKENED: ", and darkened",
        Visibility.VIEW_DEPENDENT: "; its light changed with the direction to the camera",
    }
    return next((words for bit, words in changes.items() if bits & bit), ", its light within the thresholds")
