"""What casts shadows, and the shadow-map cache: which part of each map is out of date.  NumPy only."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from taubench_gl.frame.occlusion import Rect, Shown
from taubench_gl.frame.shadow_faces import FaceTable

Array = np.ndarray


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
        """What may be in each face: draws, ascending, that cover the middle of a texel."""
        owner, draws = np.nonzero(self.visible & faces.sees(self.centers, self.halves))
        every = faces.shown(owner, draws, self.centers[draws], self.halves[draws])
        covers = np.all(every.high > every.low, axis=1)
        ends = np.searchsorted(owner[covers], np.arange(1, len(faces.near) + 1)).tolist()
        every = every.chosen(covers)
        return [every.chosen(slice(start, end)) for start, end in zip([0, *ends], ends)]


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
        # Where each face looks, what it shows, and versions of that.
        self._cached: list[tuple[bytes, Shown, Array] | None] = [None] * count

    def update(self, rows: Array, faces: FaceTable, casters: Casters) -> list[StaleFace]:
        """Faces among numbers ``rows`` (F,) that are out of date.  Their maps count as drawn after this call."""
        stale = []
        shown = casters.shown_by(faces)
        for row, key, side, now in zip(rows.tolist(), faces.keys(), faces.resolution.tolist(), shown, strict=True):
            before, versions = self._cached[row], casters.versions[now.draws]
            self._cached[row] = key, now, versions
            if before is None or before[0] != key:
                stale.append(StaleFace(row, (0, 0, side, side), now))
            elif (dirty := _dirty(now, versions, *before[1:])) is not None:
                stale.append(StaleFace(row, *dirty))
        return stale


def _dirty(now: Shown, versions: Array, before: Shown, versions_before: Array) -> tuple[Rect, Shown] | None:
    """The rectangle where one view of two moments may differ, and what is there; None where it does not."""
    came = _differ(now.draws, versions, before.draws, versions_before)
    gone = _differ(before.draws, versions_before, now.draws, versions)
    if not (came.any() or gone.any()):
        return None
    corner = np.concatenate([now.low[came], before.low[gone]]).min(axis=0)
    end = np.concatenate([now.high[came], before.high[gone]]).max(axis=0)
    there = np.all((now.low < end) & (now.high > corner), axis=1)
    return (*corner.tolist(), *(end - corner).tolist()), now.chosen(there)


def _differ(a: Array, a_versions: Array, b: Array, b_versions: Array) -> Array:
    """Which draws of a (K,) are not in b (L,), or have another version there.  (K,) bool."""
    if np.array_equal(a, b):
        return a_versions != b_versions
    place = np.searchsorted(b, a)
    inside = place < len(b)
    same = np.zeros(len(a), dtype=bool)
    at = place[inside]
    same[inside] = (b[at] == a[inside]) & (b_versions[at] == a_versions[inside])
    return ~same
