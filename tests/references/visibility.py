"""Exact visibility in float64 against a list of triangles.  Reference for shaders/visibility/visibility.comp.glsl."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.conventions import Visibility
from taubench_gl.metrics.reprojection import Reprojection, reproject

Array = np.ndarray
CHUNK = 2_000_000
"""Pairs of segment and triangle at once."""

SNAP = 1.0 / 32.0
"""Share of a pixel's width within which a surface before a point does not hide it: rasterized corners are snapped."""


@dataclass(frozen=True, slots=True)
class PreviousSurfaces:
    """What the previous camera saw, relative to it, world axes."""

    corners: Array  # (T, 3, 3) float64, counter-clockwise where the front is seen
    one_sided: Array  # (T,) bool: the back is not drawn


def visibility(
    pair: Reprojection,
    position: Array,
    prev_position: Array,
    surfaces: PreviousSurfaces,
    *,
    footprint: tuple[float, float],
    threshold: float,
    slack: float = 0.0,
) -> Array:
    """Bits of ``conventions.Visibility`` of every pixel, (h, w) uint32, row 0 at the top; never NEW.

    ``position`` (h, w, 4) and ``prev_position`` (h, w, >=3): as the channels; ``footprint``: width of a previous pixel,
    meters and meters for each meter of depth; ``threshold``: meters, of MOVED; ``slack``: meters by which planes of
    triangles may miss a point that lies on them.
    """
    position, prev = np.asarray(position, np.float64), np.asarray(prev_position, np.float64)[..., :3]
    surface = position[..., 3] > 0
    moved = reproject(pair, position, prev)
    bits = np.where(surface, 0, Visibility.SKY).astype(np.uint32)
    far = np.linalg.norm(prev - (position[..., :3] + pair.camera_delta), axis=-1) > threshold
    bits[surface & far] |= np.uint32(Visibility.MOVED)
    bits[moved.behind] |= np.uint32(Visibility.BEHIND)
    bits[moved.outside] |= np.uint32(Visibility.OUTSIDE)
    inside = ~(moved.behind | moved.outside)
    for kind, rows in ((True, inside & surface), (False, inside & ~surface)):
        hidden = _hidden(moved.q[rows], pair, surfaces, footprint, slack, kind)
        bits[rows] |= np.where(hidden, np.uint32(Visibility.OCCLUDED), np.uint32(Visibility.VISIBLE))
    finite = np.isfinite(position).all(axis=-1) & (~surface | np.isfinite(prev).all(axis=-1))
    return np.where(finite, bits, np.uint32(Visibility.INVALID))


def _hidden(
    q: Array, pair: Reprojection, surfaces: PreviousSurfaces, footprint: tuple[float, float], slack: float, ends: bool
) -> Array:
    """Whether a surface is before each point ``q`` (N, 3) of a perspective camera; ``ends``: points, not directions."""
    depth = q @ pair.prev_forward
    near = np.full(len(q), pair.prev_near) / depth
    last = 1.0 - SNAP * (footprint[0] + footprint[1] * depth) / np.linalg.norm(q, axis=-1) if ends else np.inf
    return blocked(np.zeros_like(q), q, surfaces, near, np.broadcast_to(last, len(q)), slack if ends else None)


def blocked(
    origins: Array, directions: Array, surfaces: PreviousSurfaces, first: Array, last: Array, slack: float | None
) -> Array:
    """Whether any triangle meets the rays (N, 3) between ``first`` and ``last`` (N,), in lengths of the directions.

    Möller and Trumbore's test.  ``slack``: planes that hold the rays' ends within it do not count; None: no
    ends.  (N,).
    """
    a = surfaces.corners[:, 0]
    e1, e2 = surfaces.corners[:, 1] - a, surfaces.corners[:, 2] - a
    normal = np.cross(e1, e2)
    length = np.linalg.norm(normal, axis=-1)
    out = np.zeros(len(origins), dtype=bool)
    step = max(CHUNK // max(len(a), 1), 1)
    for begin in range(0, len(origins), step):
        rows = slice(begin, begin + step)
        o, d = origins[rows, None], directions[rows, None]
        p = np.cross(d, e2)
        det = np.sum(p * e1, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = o - a
            u = np.sum(s * p, axis=-1) / det
            cross = np.cross(s, e1)
            v = np.sum(cross * d, axis=-1) / det
            t = np.sum(cross * e2, axis=-1) / det
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > first[rows, None]) & (t < last[rows, None])
        met &= (det > 0) | ~surfaces.one_sided  # det > 0: the front
        if slack is not None:
            met &= np.abs(np.sum((a - (o + d)) * normal, axis=-1)) > slack * length
        out[rows] = met.any(axis=1)
    return out
