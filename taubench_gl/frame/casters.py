"""What casts shadows, and the shadow-map cache: which part of each map is out of date.  NumPy only."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, fields

import numpy as np

from taubench_gl.frame.shadow_faces import FaceTable

Array = np.ndarray
Rect = tuple[int, int, int, int]
"""A rectangle of a face: x, y, width and height in texels."""


class Casters:
    """World bounds of every draw, and a version number that grows when a draw moves, bends, appears or vanishes."""

    def __init__(self, count: int):
        self.centers, self.halves = np.zeros((count, 3)), np.zeros((count, 3))
        self.versions = np.zeros(count, dtype=np.int64)
        self.visible = np.zeros(count, dtype=bool)
        self._poses: list[bytes] = [b""] * count

    def update(self, boxes: tuple[Array, Array], poses: list[bytes], visible: Array) -> None:
        """Take the state of a frame.  ``boxes``: centers and half extents (D, 3), world; ``poses``: equal bytes for
        equal pose, per draw; ``visible``: (D,) bool.
        """
        self.centers, self.halves = boxes
        for i, pose in enumerate(poses):
            if pose != self._poses[i]:
                self._poses[i] = pose
                self.versions[i] += 1
        self.visible = visible

    def only(self, draws: Array) -> Casters:
        """These casters, of which those that are not in ``draws`` (D,) bool are hidden."""
        out = copy(self)
        out.visible = self.visible & draws
        return out

    def key(self) -> bytes:
        """Bytes that stay equal exactly while no draw moves, bends, appears or vanishes."""
        return self.visible.tobytes() + self.versions[self.visible].tobytes()

    def shown_by(self, faces: FaceTable) -> list[Shown]:
        """What may be in each face: draws that cover the middle of a texel."""
        owner, draws = np.nonzero(self.visible & faces.sees(self.centers, self.halves))
        cover = faces.cover(owner, self.centers[draws], self.halves[draws])
        every = Shown(draws, self.versions[draws], *cover)
        covers = np.all(every.high > every.low, axis=1)
        ends = np.searchsorted(owner[covers], np.arange(1, len(faces.near) + 1)).tolist()
        every = every.chosen(covers)
        return [every.chosen(slice(start, end)) for start, end in zip([0, *ends], ends)]


@dataclass(frozen=True, slots=True)
class Shown:
    """Draws that may be seen in a map, ascending, and where."""

    draws: Array  # (K,)
    versions: Array  # (K,)
    low: Array  # (K, 2) first and end of the texels each may cover
    high: Array  # (K, 2)
    nearest: Array  # (K,) reversed depth of its nearest point, at most

    def chosen(self, which: Array | slice) -> Shown:
        """Some of them."""
        return Shown(*(getattr(self, f.name)[which] for f in fields(self)))


@dataclass(frozen=True, slots=True)
class StaleFace:
    """A face that is out of date."""

    number: int
    rect: Rect  # what may differ
    shown: Shown  # what may be in it


class ShadowMapCache:
    """Remembers what every face was drawn from, and finds the dirty rectangle of each.

    A texel shows the nearest of the draws whose boxes cover it, so texels change only where a draw that moved was
    before or is now; everything else in that rectangle is drawn again with it.
    """

    def __init__(self, count: int):
        self._cached: list[tuple[bytes, Shown] | None] = [None] * count  # where it looks, and what it shows

    def update(self, rows: Array, faces: FaceTable, casters: Casters) -> list[StaleFace]:
        """Faces among numbers ``rows`` (F,) that are out of date.  Their maps count as drawn after this call."""
        stale = []
        shown = casters.shown_by(faces)
        for row, key, side, now in zip(rows.tolist(), faces.keys(), faces.resolution.tolist(), shown, strict=True):
            before, self._cached[row] = self._cached[row], (key, now)
            if before is None or before[0] != key:
                stale.append(StaleFace(row, (0, 0, side, side), now))
            elif (dirty := _dirty(now, before[1])) is not None:
                stale.append(StaleFace(row, *dirty))
        return stale


def _dirty(now: Shown, before: Shown) -> tuple[Rect, Shown] | None:
    """The rectangle where one view of two moments may differ, and what is there; None where it does not."""
    moved = _differ(now, before), _differ(before, now)
    if not (moved[0].any() or moved[1].any()):
        return None
    corner = np.concatenate([now.low[moved[0]], before.low[moved[1]]]).min(axis=0)
    end = np.concatenate([now.high[moved[0]], before.high[moved[1]]]).max(axis=0)
    there = np.all((now.low < end) & (now.high > corner), axis=1)
    return (*corner.tolist(), *(end - corner).tolist()), now.chosen(there)


def _differ(a: Shown, b: Shown) -> Array:
    """Which draws of a are not in b, or have another version there.  (K,) bool."""
    if np.array_equal(a.draws, b.draws):
        return a.versions != b.versions
    place = np.searchsorted(b.draws, a.draws)
    inside = place < len(b.draws)
    same = np.zeros(len(a.draws), dtype=bool)
    at = place[inside]
    same[inside] = (b.draws[at] == a.draws[inside]) & (b.versions[at] == a.versions[inside])
    return ~same


BEHIND = 1.02
"""How many times as far away as the farthest of what hides it a draw must be: interpolated depth has float32 rounding,
1e-7 of the largest, 0.4 % of what is as far from a point light as the scene is wide."""


SQUARES = 8
"""Squares along the longer side of a rectangle that is tested against depths."""


def hidden(shown: Shown, rect: Rect, depths: Array) -> Array:
    """Which draws lie behind what a map already shows at all texels of ``rect`` that they cover.  (K,) bool.

    ``depths`` (h, w): reversed depth in the rectangle, row 0 at the bottom.
    """
    levels = [depths]  # the farthest depth of squares of 2^i texels
    while max(levels[-1].shape) > 1:
        last = np.pad(levels[-1], [(0, n % 2) for n in levels[-1].shape], mode="edge")
        last = np.minimum(last[::2], last[1::2])
        levels.append(np.minimum(last[:, ::2], last[:, 1::2]))
    low, last = np.maximum(shown.low - rect[:2], 0), np.minimum(shown.high - rect[:2], rect[2:]) - 1
    level = np.ceil(np.log2(np.maximum((last - low + 1).max(axis=1) / SQUARES, 1.0))).astype(int)
    farthest = np.zeros(len(level))
    for i, squares in enumerate(levels):
        at = np.flatnonzero(level == i)
        steps = np.arange(SQUARES + 1)  # so many squares hold SQUARES times 2^i texels
        x, y = np.minimum((low[at] >> i)[..., None] + steps, (last[at] >> i)[..., None]).transpose(1, 0, 2)
        farthest[at] = squares[y[:, :, None], x[:, None]].min(axis=(1, 2))
    return farthest > BEHIND * shown.nearest
