"""Polygons of files that have more than three corners, cut into triangles in their own plane."""

from __future__ import annotations

import numpy as np
from mapbox_earcut import triangulate_float64

Array = np.ndarray

TOLERANCE = 1e-6
"""Share of a polygon's area below which an area is rounding."""


def cut_polygons(points: Array, sizes: Array) -> tuple[Array, Array, Array]:
    """Triangles of polygons whose corners follow each other in ``points`` (corners, 3) float64, scene units.

    ``sizes`` (P,), P > 0: corners of each polygon, 3 at least.  A polygon is a fan around its first corner where that
    covers it exactly, as it does every convex one; else it is cut by ear clipping in the plane of its Newell normal.  A
    hole is part of the outline, connected by a bridge of two coincident edges.  Corners on a straight edge may be left
    out.

    Returns the fans (T, 3) and the triangles drawn (T', 3), both int64 indices into ``points`` in the winding of the
    polygon, and the polygons whose outline crosses itself (C,), which stay fans.  Where all polygons are fans, both are
    one array.
    """
    first = np.cumsum(sizes) - sizes
    counts = sizes - 2
    polygon = np.repeat(np.arange(len(sizes)), counts)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(counts) - counts, counts)
    start = first[polygon]
    fans = np.stack([start, start + step + 1, start + step + 2], axis=1)
    areas = _double_areas(points, fans)
    normals, total = (np.add.reduceat(a, np.cumsum(counts) - counts) for a in (areas, np.linalg.norm(areas, axis=1)))
    lengths = np.linalg.norm(normals, axis=1)
    flat = lengths <= TOLERANCE * total  # the halves of a bow tie cancel
    units = normals / np.where(flat, np.inf, lengths)[:, None]
    folded = np.einsum("tk,tk->t", areas, units[polygon]) < -TOLERANCE * lengths[polygon]
    pieces, cut, crossing = [], np.zeros(len(sizes), dtype=bool), np.flatnonzero(flat & (total > 0.0)).tolist()
    for p in np.unique(polygon[folded]).tolist():
        corners = slice(first[p], first[p] + sizes[p])
        triangles = first[p] + _ears(points[corners], units[p])
        areas = _double_areas(points, triangles) @ units[p]
        if abs(np.abs(areas).sum() - lengths[p]) > TOLERANCE * lengths[p]:
            crossing.append(p)
            continue
        pieces.append(np.where((areas < 0.0)[:, None], triangles[:, ::-1], triangles))
        cut[p] = True
    if not pieces:
        return fans, fans, np.array(sorted(crossing), dtype=np.int64)
    owner = np.concatenate([polygon[~cut[polygon]], np.repeat(np.flatnonzero(cut), [len(t) for t in pieces])])
    drawn = np.concatenate([fans[~cut[polygon]], *pieces])[np.argsort(owner, kind="stable")]
    return fans, drawn, np.array(sorted(crossing), dtype=np.int64)


def _double_areas(points: Array, triangles: Array) -> Array:
    """Twice the area vector of each triangle, (T, 3)."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _ears(points: Array, normal: Array) -> Array:
    """Triangles of one polygon (n, 3), seen along its unit ``normal``; indices (T, 3) int64 of any winding."""
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    plane = np.stack([across, np.cross(normal, across)], axis=1)
    flat = np.ascontiguousarray((points - points[0]) @ plane)
    return triangulate_float64(flat, np.array([len(points)], dtype=np.uint32)).reshape(-1, 3).astype(np.int64)
