"""What casts shadows, and the shadow-map cache: which part of each map is out of date.  NumPy only."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from taubench_gl.frame.shadow_faces import FaceTable

Array = np.ndarray
Rect = tuple[int, int, int, int]
"""A rectangle of a face: x, y, width and height in texels."""


class Casters:
    """World bounds of every draw, and a version number that grows when a draw moves, bends, appears or vanishes."""

    def __init__(self, count: int):
        self.centers, self.radii = np.zeros((count, 3)), np.zeros(count)
        self.versions = np.zeros(count, dtype=np.int64)
        self.visible = np.zeros(count, dtype=bool)
        self._poses: list[bytes] = [b""] * count

    def update(self, bounds: tuple[Array, Array], poses: list[bytes], visible: Array) -> None:
        """Take the state of a frame.  ``bounds``: centers (D, 3) and radii (D,), world; ``poses``: equal bytes for
        equal pose, per draw; ``visible``: (D,) bool.
        """
        self.centers, self.radii = bounds
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

    def seen_by(self, faces: FaceTable) -> list[Array]:
        """Draws that can be seen in each face."""
        return [np.flatnonzero(seen) for seen in self.visible & faces.sees(self.centers, self.radii)]


@dataclass(frozen=True, slots=True)
class _Cached:
    """What a face of the atlas was drawn from."""

    face: bytes  # where it looks
    draws: Array  # (K,) that the map shows
    versions: Array  # (K,)
    low: Array  # (K, 2) texels each may cover
    high: Array  # (K, 2)


class ShadowMapCache:
    """Remembers what every face was drawn from, and finds the dirty rectangle of each.

    A texel shows the nearest of the draws whose spheres cover it, so texels change only where a draw that moved was
    before or is now; everything else in that rectangle is drawn again with it.
    """

    def __init__(self, count: int):
        self._cached: list[_Cached | None] = [None] * count

    def update(self, rows: Array, faces: FaceTable, casters: Casters) -> list[tuple[int, Rect, Array]]:
        """Faces among numbers ``rows`` (F,) that are out of date: number, dirty rectangle and draws to draw there.

        Their maps count as drawn after this call.
        """
        seen = casters.seen_by(faces)
        ends = np.cumsum([len(draws) for draws in seen])
        of_face, draws = np.repeat(np.arange(len(seen)), [len(draws) for draws in seen]), np.concatenate(seen)
        versions = casters.versions[draws]
        low, high = faces.cover(of_face, casters.centers[draws], casters.radii[draws])
        stale = []
        for k, (row, key, end) in enumerate(zip(rows.tolist(), faces.keys(), ends.tolist(), strict=True)):
            part = slice(end - len(seen[k]), end)
            now, before = _Cached(key, seen[k], versions[part], low[part], high[part]), self._cached[row]
            self._cached[row] = now
            if before is None or before.face != key:
                side = int(faces.resolution[k])
                stale.append((row, (0, 0, side, side), seen[k]))
            elif (dirty := _dirty(now, before)) is not None:
                stale.append((row, *dirty))
        return stale


def _dirty(now: _Cached, before: _Cached) -> tuple[Rect, Array] | None:
    """The rectangle where one view of two moments may differ, and the draws there; None where it does not."""
    moved = _differ(now, before), _differ(before, now)
    if not (moved[0].any() or moved[1].any()):
        return None
    low = np.concatenate([now.low[moved[0]], before.low[moved[1]]])
    high = np.concatenate([now.high[moved[0]], before.high[moved[1]]])
    full = np.all(high > low, axis=1)
    if not full.any():
        return None
    corner, end = low[full].min(axis=0), high[full].max(axis=0)
    there = np.all((now.low < end) & (now.high > corner), axis=1)
    return (*corner.tolist(), *(end - corner).tolist()), now.draws[there]


def _differ(a: _Cached, b: _Cached) -> Array:
    """Which draws of a are not in b, or have another version there.  (K,) bool."""
    if np.array_equal(a.draws, b.draws):
        return a.versions != b.versions
    place = np.searchsorted(b.draws, a.draws)
    inside = place < len(b.draws)
    same = np.zeros(len(a.draws), dtype=bool)
    at = place[inside]
    same[inside] = (b.draws[at] == a.draws[inside]) & (b.versions[at] == a.versions[inside])
    return ~same
