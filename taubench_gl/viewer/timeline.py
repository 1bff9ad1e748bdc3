"""The timeline's numbers and images: the rates of every pair that was shown, and small images of the sequence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner

Array = np.ndarray
SLOTS = 10
"""Number of small images side by side."""
SLOT_SIZE = (96, 54)
"""Width and height of a small image, pixels."""


@dataclass(frozen=True, slots=True)
class Rates:
    """Shares of one pair.

    ``percent``: percent per count, as ``ViewerEngine.percentages``; ``reusable``: the reuse rate in % of surface
    pixels, None where it is unknown; ``coarse``: whether light was coarse.
    """

    percent: Mapping[str, float | None]
    reusable: float | None
    coarse: bool


class Timeline(Owner):
    """What was shown of a sequence.  ``rates``: by frame, of one choice of settings; they begin again where ``key``
    changes.
    """

    def __init__(self, gpu: Gpu, first: int, last: int):
        super().__init__()
        size = (SLOTS * SLOT_SIZE[0], SLOT_SIZE[1])
        self.texture: moderngl.Texture = self.own(gpu.ctx.texture(size, 3, bytes(3 * size[0] * size[1]), alignment=1))
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.first, self.last = first, last
        self.rates: dict[int, Rates] = {}
        self._key: Any = None
        self._shown: set[int] = set()

    def record(self, key: Any, frame: int, rates: Rates) -> None:
        """Keep the rates of a frame; those of exact light replace those of coarse light."""
        if key != self._key:
            self.rates.clear()
            self._key = key
        if not rates.coarse or self.rates.get(frame, rates).coarse:
            self.rates[frame] = rates

    def lacks_image(self, frame: int) -> bool:
        """Whether no frame near ``frame`` has given its small image."""
        return self._slot(frame) not in self._shown

    def show(self, frame: int, image: Array) -> None:
        """The small image of ``frame``.  ``image`` (h, w, 3) uint8, row 0 at the top."""
        (width, height), slot = SLOT_SIZE, self._slot(frame)
        side = min(image.shape[1] / width, image.shape[0] / height)  # image pixels per small pixel; the middle is kept
        rows, columns = (
            (0.5 * (have - side * want) + side * (np.arange(want) + 0.5)).astype(int)
            for want, have in ((height, image.shape[0]), (width, image.shape[1]))
        )
        small = np.ascontiguousarray(image[rows[:, None], columns])
        self.texture.write(small.tobytes(), viewport=(slot * width, 0, width, height), alignment=1)
        self._shown.add(slot)

    def place(self, frame: int) -> float:
        """Where a frame is, from 0 (left) to 1."""
        return (frame - self.first) / max(self.last - self.first, 1)

    def frame_at(self, place: float) -> int:
        """The frame nearest to a place from 0 to 1."""
        return self.first + round(min(max(place, 0.0), 1.0) * (self.last - self.first))

    def _slot(self, frame: int) -> int:
        return min(int(self.place(frame) * SLOTS), SLOTS - 1)
