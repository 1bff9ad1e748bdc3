"""What of a map's cubes is drawn: polygons, without the faces that other cubes hide.

A face of a cube is two triangles.  Where a larger polygon was stored for several of them, one cube has it, and the
others have nothing.  The rules by which a triangle is hidden are the engine's (``visibletris``, ``occludesface`` in
``src/engine/octa.cpp``): the cubes on the other side of its plane cover it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.capture.cube2.octree import ALPHA, MOST_CORNERS, Cubes

Array = np.ndarray

SKY = 0
"""Slot of faces through which the sky is seen."""
_ORDERS = np.array([[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]])
"""(2, 2, 3) triangles of a face by the corner at which it begins."""


@dataclass(frozen=True)
class Faces:
    """m convex polygons, clockwise seen from outside in the map's left-handed axes."""

    slots: Array  # (m,)
    sides: Array  # (m,) which of -x, +x, -y, +y, -z, +z
    counts: Array  # (m,) corners, at least 3
    places: Array  # (m, 15, 3) cubes; those from the count on are not used


def drawn_faces(cubes: Cubes) -> Faces:
    """Every polygon that is drawn; those of the sky are left out."""
    stored = np.full((len(cubes.sizes), 6), -1)
    stored[cubes.polygons[:, 0], cubes.polygons[:, 1]] = np.arange(len(cubes.polygons))
    parts = [_side(cubes, side, stored[:, side]) for side in range(6)]
    return Faces(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _side(cubes: Cubes, side: int, stored: Array) -> tuple[Array, Array, Array, Array]:
    """The fields of Faces for one of six sides; ``stored``: (n,) number of each cube's polygon, -1: none."""
    dim, out = side >> 1, side & 1
    cube = np.flatnonzero(~cubes.empty & (cubes.slots[:, side] != SKY))
    merged = (cubes.merged[cube] >> side & 1).astype(bool)
    cube, merged = (values[~merged | (stored[cube] >= 0)] for values in (cube, merged))
    step = np.zeros(3, int)
    step[dim] = 1
    beyond = cubes.find(cubes.origins[cube] + np.where(out, cubes.sizes[cube], -1)[:, None] * step)
    corner = cubes.corners(cube, np.full(len(cube), side))
    touches = corner[..., dim] == 8 * out
    wall = (beyond < 0) | cubes.solid[beyond] & (cubes.sizes[beyond] >= cubes.sizes[cube]) & _opaque(
        cubes, beyond, cube
    )
    keep = ~(touches.all(1) & wall)
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

    drawn = shown(order)
    # A face both of whose triangles are seen may have one that is not if it is divided the other way.
    other = touches.all(1) & drawn.all(1) & (order == 0) & ~merged
    turned = shown(np.where(other, 1, order))
    other &= ~turned.all(1)
    order, drawn = np.where(other, 1, order), np.where(other[:, None], turned, drawn)
    seen = drawn.any(1) | merged
    cube, order, drawn, places = (values[seen] for values in (cube, order, drawn, places))
    number, rows = stored[cube], np.arange(len(cube))
    full = np.zeros((len(cube), MOST_CORNERS, 3), np.int64)
    whole = drawn.all(1)
    full[:, :4] = places[rows[:, None], (order[:, None] + np.arange(4)) & 3]
    single = _ORDERS[order, np.where(drawn[:, 0], 0, 1)]
    full[~whole, :3] = places[rows[:, None], single][~whole]
    counts = np.where(whole, 4, 3)
    has = number >= 0
    full[has], counts[has] = cubes.stored[number[has]], cubes.polygons[number[has], 2]
    return cubes.slots[cube, side], np.full(len(cube), side), counts, full / 8


def _opaque(cubes: Cubes, beyond: Array, cube: Array) -> Array:
    """Whether the cubes ``beyond`` can hide faces of ``cube``: those that are see-through hide each other only."""
    return (cubes.material[beyond] & ALPHA == 0) | (cubes.material[cube] & ALPHA != 0)


def _covered(cubes: Cubes, cube: Array, side: int, triangles: Array) -> Array:
    """Whether the cubes on the other side hide (k, 3, 2) triangles in the plane of a side, in eighths of a cube."""
    dim, out = side >> 1, side & 1
    across = [(dim + 1) % 3, (dim + 2) % 3]
    place, size, row = cubes.origins[cube].copy(), cubes.sizes[cube], np.arange(len(cube))
    place[:, dim] += np.where(out, size, -1)
    covered = np.ones(len(cube), bool)
    while len(row):
        beyond = cubes.find(place)
        # A triangle lies in the square of its cube: cubes beyond it are as large, or parts of it.
        whole = (beyond < 0) | (cubes.sizes[beyond] >= size)
        done = whole & (beyond >= 0)
        covered[row[done][~_hidden(cubes, beyond[done], cube[row[done]], side, triangles[row[done]])]] = False
        again = ~whole & covered[row]
        half = size[again] // 2
        corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
        parts = np.repeat(place[again][:, None], 4, 1)
        parts[..., across] += corners * half[:, None, None]
        place, size, row = parts.reshape(-1, 3), half.repeat(4), row[again].repeat(4)
    return covered


def _hidden(cubes: Cubes, beyond: Array, cube: Array, side: int, triangles: Array) -> Array:
    """Whether each cube ``beyond`` hides its triangle as far as the triangle lies before it."""
    dim, out = side >> 1, side & 1
    across = [(dim + 1) % 3, (dim + 2) % 3]
    low = 8 * cubes.origins[beyond][:, across]
    high = low + 8 * cubes.sizes[beyond][:, None]
    turn = _turn(triangles[:, 0], triangles[:, 1], triangles[:, 2])
    triangles = np.where((turn < 0)[:, None, None], triangles[:, ::-1], triangles)
    box = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)], 1)
    apart = (triangles.max(1) <= low).any(1) | (triangles.min(1) >= high).any(1)
    ends = np.roll(triangles, -1, 1)
    edges = _turn(triangles[:, :, None], ends[:, :, None], box[:, None])  # (k, edge, corner of the box)
    apart |= (edges <= 0).all(2).any(1)
    hides = ~cubes.empty[beyond] & _opaque(cubes, beyond, cube)
    sure = apart | hides & cubes.solid[beyond]
    rest = np.flatnonzero(~sure & hides)
    corner = cubes.corners(beyond[rest], np.full(len(rest), side ^ 1))
    there = corner[..., dim] == 8 * (1 - out)
    shape = corner[..., across] * cubes.sizes[beyond[rest]][:, None, None] + low[rest][:, None]
    # A corner that lies deeper than the plane is replaced by one before it: an edge without length.
    for k in (1, 2, 3, 0, 1, 2):
        shape[:, k] = np.where(there[:, k, None], shape[:, k], shape[:, k - 1])
    turn = _turn(shape[:, 0], shape[:, 1], shape[:, 2]) + _turn(shape[:, 0], shape[:, 2], shape[:, 3])
    shape = np.where((turn < 0)[:, None, None], shape[:, ::-1], shape)
    points, valid = _overlap(triangles[rest], ends[rest], low[rest], high[rest], box[rest], edges[rest])
    after = np.roll(shape, -1, 1)
    beside = _turn(shape[:, :, None], after[:, :, None], points[:, None])
    slack = 1e-6 * np.abs(after - shape).sum(2)[..., None]
    inside = ((beside >= -slack) | ~valid[:, None]).all((1, 2))
    sure[rest] = (there.sum(1) > 2) & (turn != 0) & inside
    return sure


def _turn(a: Array, b: Array, c: Array) -> Array:
    """Twice the signed area of triangles of 2D points; broadcasts."""
    return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])


def _overlap(a: Array, b: Array, low: Array, high: Array, box: Array, edges: Array) -> tuple[Array, Array]:
    """(k, 19, 2) points among which are the corners of triangle and box in common, and (k, 19) which of them are.

    ``a``, ``b``: (k, 3, 2) ends of the triangle's edges; ``edges``: (k, 3, 4) sides of them on which the box's corners
    are.
    """
    points, valid = [a, box], [((a >= low[:, None]) & (a <= high[:, None])).all(2), (edges >= 0).all(1)]
    for axis in (0, 1):
        for wall in (low, high):
            length = b[..., axis] - a[..., axis]
            share = (wall[:, axis, None] - a[..., axis]) / np.where(length == 0, 1, length)
            crossing = a + share[..., None] * (b - a)
            crossing[..., axis] = wall[:, axis, None]
            along = crossing[..., 1 - axis]
            on = (along >= low[:, 1 - axis, None]) & (along <= high[:, 1 - axis, None])
            points.append(crossing)
            valid.append((length != 0) & (share >= 0) & (share <= 1) & on)
    return np.concatenate(points, 1), np.concatenate(valid, 1)
