"""One pixel magnified in three images of a pair: the previous frame, history reprojected, and the current frame."""

from __future__ import annotations

from dataclasses import replace

import moderngl

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.viewer.display import Content, Display, Other

TILES = ("previous", "reprojected", "current")
Pixel = tuple[int, int]  # x, y up


class Magnifier(Owner):
    """Draws TILES from left to right into ``texture``, each ``side`` pixels of the image wide and high.

    The middle of the first is the history position, the middle of the others the pixel itself.
    """

    def __init__(self, gpu: Gpu):
        super().__init__()
        self._gpu = gpu
        self._display: Display | None = None
        self.side = 0

    @property
    def texture(self) -> moderngl.Texture | None:
        """RGBA8, 3 ``side`` x ``side``; None before the first ``draw``."""
        return None if self._display is None else self._display.texture

    def draw(self, side: int, current: Content, history: Other | None, pixel: Pixel, at: Pixel | None) -> None:
        """``current``: the image, without comparison; ``history``: the same channel of the previous frame, with the
        motion to it; ``at``: its pixel, None where it has none."""
        if side != self.side:
            display = Display(self._gpu, (len(TILES) * side, side))
            self._display, self.side = self.own(display, instead_of=self._display), side
            self._display.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        off = replace(current, comparison="off", other=None)
        nothing = (off, (-side, -side))  # beside the image: black
        before = nothing if history is None or at is None else (_only(off, replace(history, motion=None)), at)
        moved = nothing if history is None else (_only(off, history), pixel)
        for i, (content, middle) in enumerate((before, moved, (off, pixel))):
            first = (middle[0] - side // 2, middle[1] - side // 2)
            self._display.draw(content, (i * side, 0, side, side), first)


def _only(content: Content, other: Other) -> Content:
    """The other image alone, without masks."""
    return replace(content, comparison="other", other=other, shown=())
