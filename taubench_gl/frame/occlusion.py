"""Where boxes may be seen in a map or an image, and which of them lie behind what is drawn there.  NumPy only."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product

import numpy as np

Array = np.ndarray
Rect = tuple[int, int, int, int]
"""A rectangle of a map or an image: x, y, width and height in texels."""

COVER_MARGIN = 2.0
"""Texels around the projection of a box that count as covered, at most: float32 rounding of vertices on the GPU."""

COVER_FRACTION, COVER_SNAP = 1.0 / 512.0, 1.0 / 64.0
"""The margin of small maps: this share of the texels along a side, and texels by which corners may be snapped."""

BEHIND, ROUNDING = 1.02, 1e-6
"""A draw is hidden where the depth of what hides it is so many times its own, and so much more: reversed depth, whose
interpolation in float32 is wrong by 1e-7 of the largest depth of a triangle, which is 1."""

SQUARES = 8
"""Squares along the longer side of a rectangle that is tested against depths."""

LARGE = 1 << 18
"""Triangles of a map or an image from which on it is worth to find out what is hidden."""

OCCLUDERS, TURNS = 16, 2
"""One in so many of the triangles, the nearest, are drawn before what they hide is left out; so many times."""

_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))


def corners_of(centers: Array, halves: Array) -> Array:
    """Corners of boxes with these middles and half extents: (K, 3), (K, 3) -> (K, 8, 3)."""
    return centers[:, None] + halves[:, None] * _CORNERS


@dataclass(frozen=True, slots=True)
class Shown:
    """Draws that may be seen in a map or an image, and where."""

    draws: Array  # (K,)
    low: Array  # (K, 2) int64, first and end of the texels each may cover the middle of
    high: Array  # (K, 2)
    nearest: Array  # (K,) reversed depth of its nearest point, at most

    @classmethod
    def projected(cls, draws: Array, clip: Array, size: Array) -> Shown:
        """``draws`` (K,) whose boxes have corners ``clip`` (K, 8, 4), in clip space with reversed depth.

        ``size``: width and height in texels, (2,) or (K, 2).  What reaches behind the near plane may be anywhere.
        """
        depth, w = clip[..., 2], clip[..., 3]
        ahead = np.all((w > 0.0) & (depth < w), axis=1)
        w = np.where(ahead[:, None], w, 1.0)
        anywhere = [[-1.0], [1.0]] * 4
        at = np.where(ahead[:, None, None], clip[..., :2] / w[..., None], anywhere)
        margin = np.minimum(COVER_MARGIN, COVER_FRACTION * size + COVER_SNAP)
        low = np.clip((0.5 + 0.5 * at.min(axis=1)) * size - margin, 0, size)
        high = np.clip((0.5 + 0.5 * at.max(axis=1)) * size + margin, 0, size)
        nearest = np.where(ahead, (depth / w).max(axis=1), 1.0)
        return cls(draws, np.ceil(low - 0.5).astype(np.int64), np.floor(high + 0.5).astype(np.int64), nearest)

    def chosen(self, which: Array | slice) -> Shown:
        """Some of them."""
        return Shown(*(getattr(self, f.name)[which] for f in fields(self)))

    def hidden(self, rect: Rect, depths: Array) -> Array:
        """Which of them lie behind what is drawn at all texels of ``rect`` that they cover.  (K,) bool.

        ``depths`` (h, w): reversed depth in the rectangle, row 0 at the bottom.
        """
        levels = [depths]  # the farthest depth of squares of 2^i texels
        while max(levels[-1].shape) > 1:
            last = np.pad(levels[-1], [(0, n % 2) for n in levels[-1].shape], mode="edge")
            last = np.minimum(last[::2], last[1::2])
            levels.append(np.minimum(last[:, ::2], last[:, 1::2]))
        low, last = np.maximum(self.low - rect[:2], 0), np.minimum(self.high - rect[:2], rect[2:]) - 1
        level = np.ceil(np.log2(np.maximum((last - low + 1).max(axis=1) / SQUARES, 1.0))).astype(int)
        farthest, steps = np.zeros(len(level)), np.arange(SQUARES + 1)  # squares that hold SQUARES times 2^i texels
        for i, squares in enumerate(levels):
            at = np.flatnonzero(level == i)
            x, y = np.minimum((low[at] >> i)[..., None] + steps, (last[at] >> i)[..., None]).transpose(1, 0, 2)
            farthest[at] = squares[y[:, :, None], x[:, None]].min(axis=(1, 2))
        return farthest > BEHIND * self.nearest + ROUNDING


class NearestFirst:
    """Draws of one map or image, the nearest first, less those that are hidden by what is drawn before.

    ``rest`` (``Shown``) is what is neither drawn nor found hidden.
    """

    def __init__(self, shown: Shown, rect: Rect, triangles: Array):
        """``rect``: what of the map is drawn; ``triangles`` (D,): of every draw of the scene."""
        self.rect, self._triangles = rect, triangles
        self._share = int(triangles[shown.draws].sum()) // OCCLUDERS
        self.rest, self._taken = shown.chosen(np.argsort(-shown.nearest, kind="stable")), [shown.draws[:0]]

    def take(self) -> Array:
        """The next draws, ascending."""
        count = int(np.searchsorted(np.cumsum(self._triangles[self.rest.draws]), self._share, "right"))
        self._taken.append(np.sort(self.rest.draws[:count]))
        self.rest = self.rest.chosen(slice(count, None))
        return self._taken[-1]

    def leave_out(self, depths: Array) -> None:
        """Drop of ``rest`` what lies behind ``depths`` of ``rect``, as of ``Shown.hidden``."""
        self.rest = self.rest.chosen(~self.rest.hidden(self.rect, depths))

    @property
    def seen(self) -> Array:
        """Draws that are not known to be hidden, ascending."""
        return np.sort(np.concatenate([*self._taken, self.rest.draws]))
