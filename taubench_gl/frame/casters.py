"""What casts shadows, and the shadow-map cache: which part of each map is out of date.  NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.frame.shadow_faces import Face

Array = np.ndarray
Rect = tuple[int, int, int, int]
"""x, y, width, height, texels of a face."""


class Casters:
    """World bounds of every draw, and a version number that grows when a draw moves, bends, appears or vanishes."""

    def __init__(self, count: int):
        self.centers, self.radii = np.zeros((count, 3)), np.zeros(count)
        self.versions = np.zeros(count, dtype=np.int64)
        self.visible = np.zeros(count, dtype=bool)
        self._poses: list[bytes] = [b""] * count

    def update(self, bounds: tuple[Array, Array], poses: list[bytes], visible: Array) -> None:
        """``bounds``: centers (D, 3) and radii (D,), world; ``poses``: equal bytes for equal pose, per draw."""
        self.centers, self.radii = bounds
        for i, pose in enumerate(poses):
            if pose != self._poses[i]:
                self._poses[i] = pose
                self.versions[i] += 1
        self.visible = visible

    def key(self) -> bytes:
        """Equal exactly while nothing moves, bends, appears or vanishes."""
        return self.visible.tobytes() + self.versions[self.visible].tobytes()

    def seen_by(self, face: Face) -> tuple[Array, bytes]:
        """Draws that can be seen in ``face``, and bytes that are equal while the image of the face is."""
        seen = np.flatnonzero(self.visible & face.sees(self.centers, self.radii))
        return seen, face.key + seen.tobytes() + self.versions[seen].tobytes()


@dataclass(frozen=True, slots=True)
class _Cached:
    """What a face of the atlas was drawn from."""

    face: bytes  # where it looks
    state: bytes  # equal while its image is
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

    def update(self, i: int, face: Face, casters: Casters) -> tuple[Rect, Array] | None:
        """Dirty rectangle of face i and the draws to draw there; None if its map is up to date.

        The map counts as drawn after this call.
        """
        before = self._cached[i]
        seen, state = casters.seen_by(face)
        if before is not None and before.state == state:
            return None
        cover = face.cover(casters.centers[seen], casters.radii[seen])
        self._cached[i] = now = _Cached(face.key, state, seen, casters.versions[seen], *cover)
        if before is None or before.face != now.face:
            return (0, 0, face.resolution, face.resolution), seen
        moved = [_differ(now, before), _differ(before, now)]
        low = np.concatenate([now.low[moved[0]], before.low[moved[1]]])
        high = np.concatenate([now.high[moved[0]], before.high[moved[1]]])
        full = np.all(high > low, axis=1)
        if not full.any():
            return None
        corner, end = low[full].min(axis=0), high[full].max(axis=0)
        there = np.all((now.low < end) & (now.high > corner), axis=1)
        return (*corner.tolist(), *(end - corner).tolist()), seen[there]


def _differ(a: _Cached, b: _Cached) -> Array:
    """Which draws of a are not in b, or have another version there.  (K,) bool."""
    place = np.searchsorted(b.draws, a.draws)
    inside = place < len(b.draws)
    same = np.zeros(len(a.draws), dtype=bool)
    at = place[inside]
    same[inside] = (b.draws[at] == a.draws[inside]) & (b.versions[at] == a.versions[inside])
    return ~same
