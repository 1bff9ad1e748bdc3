"""What shadow maps hold already, and which part of each is no longer true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.frame.passes.faces import Casters
from taubench_gl.frame.shadow_faces import Face

Array = np.ndarray
Rect = tuple[int, int, int, int]
"""x, y, width, height, texels of a face."""


@dataclass(frozen=True, slots=True)
class _Held:
    face: bytes  # where it looks
    state: bytes  # equal while its picture is
    draws: Array  # (K,) that the map shows
    versions: Array  # (K,)
    low: Array  # (K, 2) texels each may cover
    high: Array  # (K, 2)


class HeldFaces:
    """Remembers what every face was drawn from.

    A texel shows the nearest of the draws whose spheres cover it, so only where a draw that moved was and where it is
    now can anything change; what else lies there is drawn again with it.
    """

    def __init__(self, count: int):
        self._held: list[_Held | None] = [None] * count

    def renew(self, i: int, face: Face, casters: Casters) -> tuple[Rect, Array] | None:
        """The part of face i that must be drawn and the draws to draw there; None if its map is still true.

        From now on the map counts as drawn.
        """
        before = self._held[i]
        seen, state = casters.seen_by(face)
        if before is not None and before.state == state:
            return None
        cover = face.cover(casters.centers[seen], casters.radii[seen])
        self._held[i] = now = _Held(face.key, state, seen, casters.versions[seen], *cover)
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


def _differ(a: _Held, b: _Held) -> Array:
    """Which draws of a are not in b, or otherwise.  (K,) bool."""
    place = np.searchsorted(b.draws, a.draws)
    inside = place < len(b.draws)
    same = np.zeros(len(a.draws), dtype=bool)
    at = place[inside]
    same[inside] = (b.draws[at] == a.draws[inside]) & (b.versions[at] == a.versions[inside])
    return ~same
