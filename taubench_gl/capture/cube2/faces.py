"""What of a map's cubes is drawn: polygons, without the faces that other cubes hide.

A face of a cube is two triangles.  Where a larger polygon was stored for several of them, one cube has it, and the
others have nothing.  The rules by which a triangle is hidden are the engine's (``visibletris``, ``occludesface`` in
``src/engine/octa.cpp``): the cubes on the other side of its plane cover it.
"""

from __future__ import annotations

import numpy as np

from taubench_gl.capture.cube2.level import ALPHA, MOST_CORNERS, Cubes

Array = np.ndarray

SKY = 0
"""Slot of faces through which the sky is seen."""
_ORDERS = np.array([[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]])
"""(2, 2, 3) triangles of a face by the corner at which it begins."""


def drawn_triangles(cubes: Cubes) -> tuple[Array, Array, Array]:
    """Everything that is drawn but the sky: (t,) slots, (t,) sides of the cubes -x, +x, -y, +y, -z, +z, and (t, 3, 3)
    corners in cubes, clockwise seen from outside in the map's left-handed axes."""
    stored = np.full((len(cubes.sizes), 6), -1)
    stored[cubes.polygons[:, 0], cubes.polygons[:, 1]] = np.arange(len(cubes.polygons))
    parts = [_side(cubes, side, stored[:, side]) for side in range(6)]
    cube, sides, corners = (np.concatenate(column) for column in zip(*parts, strict=True))
    solid = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any(1)
    return cubes.slots[cube, sides][solid], sides[solid], corners[solid] / 8


def _side(cubes: Cubes, side: int, stored: Array) -> tuple[Array, Array, Array]:
    """Triangles of one of six sides: cubes, sides, (t, 3, 3) corners in eighths of a cube.

    ``stored``: (n,) number of each cube's polygon, -1: none.
    """
    dim, out = side >> 1, side & 1
    cube = np.flatnonzero(~cubes.empty & (cubes.slots[:, side] != SKY))
    merged = (cubes.merged[cube] >> side & 1).astype(bool)
    cube, merged = (values[~merged | (stored[cube] >= 0)] for values in (cube, merged))
    step = np.where(out, cubes.sizes[cube], -1)[:, None] * np.eye(3, dtype=int)[dim]
    beyond = cubes.find(cubes.origins[cube] + step)
    corner = cubes.corners(cube, np.full(len(cube), side))
    touches = corner[..., dim] == 8 * out
    wall = cubes.solid[beyond] & (cubes.sizes[beyond] >= cubes.sizes[cube]) & _opaque(cubes, beyond, cube)
    keep = ~(touches.all(1) & (wall | (beyond < 0)))
    cube, merged, corner, touches = (values[keep] for values in (cube, merged, corner, touches))
    first = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    order = (((corner[:, 0] - corner[:, 3]) * first).sum(1) < 0).astype(int)
    places = corner * cubes.sizes[cube][:, None, None] + 8 * cubes.origins[cube][:, None]

    def shown(order: Array) -> Array:
        """(k, 2) triangles that are not hidden."""
        at = _ORDERS[order]
        rows = np.arange(len(cube))[:, None, None]
        a, b, c = np.moveaxis(corner[rows, at], 2, 0)
        out_ = np.cross(b - a, c - a).any(2)
        test = out_ & touches[rows, at].all(2) & ~merged[:, None]
        row, which = np.nonzero(test)
        flat = places[row[:, None], at[row, which]][..., [(dim + 1) % 3, (dim + 2) % 3]]
        out_[row, which] = ~_covered(cubes, cube[row], side, flat)
        return out_

    drawn, lit = shown(order), (cubes.merged[cube] >> 8 + side & 1).astype(bool)
    drawn |= (drawn.any(1) & lit)[:, None]
    # A face both of whose triangles are seen may have one that is not if it is divided the other way.
    other = touches.all(1) & drawn.all(1) & (order == 0) & ~merged & ~lit
    turned = shown(np.where(other, 1, order))
    other &= ~turned.all(1)
    order, drawn = np.where(other, 1, order), np.where(other[:, None], turned, drawn)
    number = stored[cube]
    row, which = np.nonzero(drawn & (number < 0)[:, None])
    plain = places[row[:, None], _ORDERS[order[row], which]]
    number = number[(drawn.any(1) | merged) & (number >= 0)]
    polygon, second = np.nonzero(np.arange(2, MOST_CORNERS) < cubes.polygons[number, 2, None])
    corners = cubes.stored[number[polygon, None], np.stack([0 * second, second + 1, second + 2], 1)]
    cube = np.concatenate([cube[row], cubes.polygons[number[polygon], 0]])
    return cube, np.full(len(cube), side), np.concatenate([plain, corners])


def _opaque(cubes: Cubes, beyond: Array, cube: Array) -> Array:
    """Whether the cubes ``beyond`` can hide faces of ``cube``: those that are see-through hide each other only."""
    return (cubes.material[beyond] & ALPHA == 0) | (cubes.material[cube] & ALPHA != 0)


def _covered(cubes: Cubes, cube: Array, side: int, triangles: Array) -> Array:
    """Whether the cubes on the other side hide (k, 3, 2) triangles in the plane of a side, in eighths of a cube: their
    faces, which do not overlap, have the area of the triangle in common with it."""
    dim, out = side >> 1, side & 1
    across = [(dim + 1) % 3, (dim + 2) % 3]
    place, size, row = cubes.origins[cube].copy(), cubes.sizes[cube], np.arange(len(cube))
    place[:, dim] += np.where(out, size, -1)
    origin = triangles[:, :1].copy()
    triangles = triangles - origin
    whole, hidden = _area(triangles), np.zeros(len(cube))
    triangles = np.where((whole < 0)[:, None, None], triangles[:, ::-1], triangles)
    while len(row):
        beyond = cubes.find(place)
        # A triangle lies in the square of its cube: cubes beyond it are as large, or parts of it.
        done = (beyond < 0) | (cubes.sizes[beyond] >= size)
        hides = done & (beyond >= 0) & ~cubes.empty[beyond] & _opaque(cubes, beyond, cube[row])
        other, to = beyond[hides], row[hides]
        corner = cubes.corners(other, np.full(len(other), side ^ 1))
        there = corner[..., dim] == 8 * (1 - out)
        shape = corner[..., across] * cubes.sizes[other][:, None, None] + 8 * cubes.origins[other][:, None, across]
        # A corner that lies deeper than the plane is replaced by one before it: an edge without length.
        for k in (1, 2, 3, 0, 1, 2):
            shape[:, k] = np.where(there[:, k, None], shape[:, k], shape[:, k - 1])
        turn = _area(shape)
        shape = np.where((turn < 0)[:, None, None], shape[:, ::-1], shape) - origin[to]
        common = _swept(triangles[to], shape, True) + _swept(shape, triangles[to], False)
        way = np.roll(shape, -1, 1) - shape
        convex = (_cross(way, np.roll(way, -1, 1)) >= 0).all(1)
        np.add.at(hidden, to, np.where((turn != 0) & convex, common, 0))
        half = size[~done] // 2
        parts = np.repeat(place[~done][:, None], 4, 1)
        parts[..., across] += np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * half[:, None, None]
        place, size, row = parts.reshape(-1, 3), half.repeat(4), row[~done].repeat(4)
    return hidden > np.abs(whole) - 1e-3


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _area(polygons: Array) -> Array:
    """Twice the signed area of (k, n, 2) polygons."""
    return _cross(polygons, np.roll(polygons, -1, 1)).sum(1)


def _swept(a: Array, b: Array, shared: bool) -> Array:
    """(k,) twice the area that the parts of the edges of ``a`` inside of ``b`` sweep as seen from 0.

    Of convex polygons, counter-clockwise.  The sum of both ways is that of what they have in common; ``shared``: with
    edges that lie on one another, which count once.
    """
    way, first, last = np.roll(a, -1, 1) - a, np.zeros(a.shape[:2]), np.ones(a.shape[:2])
    for j in range(b.shape[1]):
        edge = (np.roll(b, -1, 1) - b)[:, j, None]
        inside, rate = _cross(edge, a - b[:, j, None]), _cross(edge, way)
        at = -inside / np.where(rate == 0, 1, rate)
        first, last = np.where(rate > 0, np.maximum(first, at), first), np.where(rate < 0, np.minimum(last, at), last)
        along = (edge * way).sum(2)
        apart = (inside < 0) | (inside == 0) & edge.any(2) & ((along < 0) | (not shared))
        last = np.where((rate == 0) & apart, -1, last)
    return (np.maximum(last - first, 0) * _cross(a, way)).sum(1)
