"""Maps of Cube 2 (.ogz), versions 20 to 33: header, variables, entities, texture slots, and cubes.

The cubes are a tree of eight parts whose leaves are cubes with moved corners.  They are read in one pass over the bytes
that notes where the values of each lie; all else is NumPy.  Lightmaps and visibility, which follow, are not read.
Layout: the engine's ``src/engine/worldio.cpp``.  Lengths are cubes, axes are the engine's: left-handed, +Z up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from taubench_gl.capture.cube2.packed import Reader, unpacked
from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import require

Array = np.ndarray

LIGHT, MODEL, SPOTLIGHT = 1, 2, 7
"""Kinds of entities."""
OLDEST, CURRENT = 20, 33
"""Versions that are read; before 29, a face or two of a map may differ from the engine's."""
_CHANGES = (("scale", "f"), ("rotation", "i"), ("offset", "2i"), ("scroll", "2f"), ("layer", "i"), ("alpha", "2f"),
            ("color", "3f"))  # fmt: skip


CORNERS = np.array(
    [[[0, 1, 1], [0, 1, 0], [0, 0, 0], [0, 0, 1]], [[1, 1, 1], [1, 0, 1], [1, 0, 0], [1, 1, 0]],
     [[1, 0, 1], [0, 0, 1], [0, 0, 0], [1, 0, 0]], [[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]],
     [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]], [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]]
)  # fmt: skip
"""(6, 4, 3) corners of the faces -x, +x, -y, +y, -z, +z, clockwise seen from outside in the left-handed axes."""
_FIRST, _SECOND = np.array([2, 0, 1]), np.array([1, 2, 0])
"""The axes along a face in the order in which corners of merged faces are stored."""
_CHILDREN, _EMPTY, _SOLID, _CUT = range(4)
MOST_CORNERS = 15
ALPHA = 0x400
"""Bit of ``material``: the cube is drawn see-through."""
_CUBE_BYTES = 600  # of one cube while a map is read and its faces are found


@dataclass(frozen=True)
class Cubes:
    """The n cubes of a map in the order of its file, which is the Z order of their places.

    ``edges``: both ends of each of 12 edges as half bytes, in eighths; ``slots``: texture of each face; ``merged``: a
    bit of each face that belongs to a larger polygon, and eight higher of each that is drawn whole.  ``polygons``:
    (m, 3) cube, face and number of corners of stored polygons; ``stored``: (m, 15, 3) their corners in eighths of a
    cube.
    """

    size: int
    sizes: Array  # (n,)
    edges: Array  # (n, 12) uint8
    slots: Array  # (n, 6)
    material: Array  # (n,) volume in bits 0 to 2
    merged: Array  # (n,)
    polygons: Array
    stored: Array

    @cached_property
    def codes(self) -> Array:
        """Places of the cubes along the Z order, (n,), in cubes of size 1."""
        volume = self.sizes**3
        return np.cumsum(volume) - volume

    @cached_property
    def origins(self) -> Array:
        """The corner of each cube with the least coordinates, (n, 3)."""
        bits = np.arange(16)
        return np.stack([((self.codes[:, None] >> (3 * bits + axis) & 1) << bits).sum(1) for axis in range(3)], 1)

    @cached_property
    def empty(self) -> Array:
        """Whether cubes are empty, (n,) bool; as in the engine, also those whose edges cross, or that are flat along an
        axis.
        """
        low, high = self.edges & 15, self.edges >> 4
        flat = (low == high).reshape(-1, 3, 4).all(2) | (high < low).reshape(-1, 3, 4).any(2)
        return flat.any(1)

    @cached_property
    def solid(self) -> Array:
        return (self.edges == 0x80).all(1)

    def find(self, places: Array) -> Array:
        """Numbers of the cubes at whole ``places`` (k, 3), (k,); -1 outside of the map."""
        inside = ((places >= 0) & (places < self.size)).all(1)
        bits = np.arange(16)
        spread = (np.where(inside[:, None], places, 0)[..., None] >> bits & 1) << (3 * bits)
        code = (spread.sum(2) << np.arange(3)).sum(1)
        return np.where(inside, np.searchsorted(self.codes, code, "right") - 1, -1)

    def corners(self, cubes: Array, faces: Array) -> Array:
        """Corners of faces, (k, 4, 3), in eighths of the cube's size."""
        at, axes = CORNERS[faces], []
        for a in range(3):
            edge = self.edges[cubes[:, None], 4 * a + at[..., (a + 1) % 3] + 2 * at[..., (a + 2) % 3]]
            axes.append(np.where(at[..., a], edge >> 4, edge & 15))
        return np.stack(axes, -1).astype(np.int64)


@dataclass(frozen=True)
class Level:
    """A map.  ``entities``: ``place``, ``values`` (5), ``kind``; ``slots``: by the number that
    faces have, the slot that each is a change of, -1: none, and what is changed."""

    version: int
    variables: dict[str, Any]
    entities: Array
    slots: list[tuple[int, dict[str, Any]]]
    cubes: Cubes


def read_level(data: bytes, where: str) -> Level:
    """A map of the file ``where``.  Raises SceneError for what is none, damaged, or of another version."""
    content, _ = unpacked(data, where, "map of Cube 2 (.ogz)")
    r = Reader(content, where)
    if content[:4] != b"OCTA":
        raise SceneError("is no map of Cube 2 (.ogz)", where=where, hint="it does not begin with OCTA")
    r.bytes(4)
    version, header, size, entities, _, _ = r.get("6i")
    if not OLDEST <= version <= CURRENT:
        hint = f"save it again in Cube 2: versions {OLDEST} to {CURRENT} are read"
        raise SceneError(f"is a map of version {version}", where=where, hint=hint)
    if not 2 <= size <= 1 << 16 or size & (size - 1):
        raise r.bad(f"has a size of {size} cubes")
    variables, slots = {}, 0
    if version > 28:
        _, count, slots = (*r.get("2i"), 0) if version == 29 else r.get("3i")
        for _ in range(count):
            kind, length = r.get("BH")
            name = r.text(length)
            variables[name] = r.text(r.get("H")) if kind == 2 else r.get("if"[kind & 1])
    else:
        r.bytes(header - r.at)
    r.text(r.get("B") + 1)
    extra, length = r.get("2H")
    r.bytes(length)
    r.bytes(2 * r.get("H"))
    fields = [("place", "<f4", 3), ("values", "<i2", 5), ("kind", "u1"), ("pad", "u1"), ("extra", "u1", (extra,))]
    row = np.dtype(fields)
    table = np.frombuffer(r.bytes(max(entities, 0) * row.itemsize), row)
    if not np.isfinite(table["place"]).all():
        raise r.bad("has entities whose places are no numbers")
    read = _read_slots(r, slots)
    return Level(version, variables, table, read, read_cubes(r, size, version))


def _read_slots(r: Reader, count: int) -> list[tuple[int, dict[str, Any]]]:
    """Texture slots as (slot that this one changes, what it changes), -1: no slot.  In the file a negative number
    stands for that many slots without changes.
    """
    out: list[tuple[int, dict[str, Any]]] = []
    while count > 0:
        changed = r.get("i")
        if changed < 0:
            require((len(out) - changed) * 200, "its texture slots", SceneError, r.where)
            out += [(-1, {})] * min(-changed, count)
            count += changed
            continue
        previous, changes = r.get("i"), {"shader": changed & 1}
        if changed >> 8:
            raise r.bad(f"has a texture slot of unknown kind {changed}")
        for _ in range(r.get("H") if changed & 1 else 0):
            r.bytes(r.get("H") + 16)  # a parameter of a shader
        for bit, (name, form) in enumerate(_CHANGES, 1):
            if changed >> bit & 1:
                changes[name] = r.get(form)
                if not np.isfinite(changes[name]).all():
                    raise r.bad("has a texture slot with values that are no numbers")
        out.append((previous, changes))
        count -= 1
    return out


def _layout(flags: Array, count: Array) -> tuple[Array, Array, Array, Array]:
    """Layout of stored polygons: whether two corners of a box stand for all four, bytes before the corners, bytes of
    each, bytes after all.  ``flags``, ``count``: the two bytes that say so, as numbers or arrays.
    """
    four, twice = count & MOST_CORNERS == 4, 1 + (count >> 7)
    box, same_uv, same_normal = four & (flags & 5 == 5), four & (flags & 0x42 == 0x42), flags & 0x88 == 0x88
    uv = 4 * (flags >> 6 & 1) * (1 - same_uv)
    each = 4 * (flags >> 2 & 1) * (1 - box) + uv + 2 * (flags >> 7) * (1 - same_normal)
    return box, 8 * box + 8 * twice * same_uv + 2 * same_normal, each, (twice - 1) * uv * (count & MOST_CORNERS)


@cache
def _polygon_bytes(flags: int, count: int) -> int:
    """Bytes of a stored polygon after the four of its head."""
    _, before, each, after = _layout(flags, count)
    return int(before + each * (count & MOST_CORNERS) + after) if count & MOST_CORNERS else 0


def read_cubes(reader: Reader, size: int, version: int) -> Cubes:
    """The cubes at the place of the reader, which then is after them.  Raises SceneError."""
    data, where = reader.data, reader.where
    try:
        rows, polygons, reader.at = _scan(data, reader.at, size, version, where)
        reader.bytes(0)
    except IndexError:
        raise SceneError("ends inside of its cubes", where=where, hint="the map is damaged") from None
    kind, level, at, material, merged = np.array(rows, np.int64).reshape(-1, 5).T
    raw = np.frombuffer(data, np.uint8)
    edges = np.where(kind == _SOLID, 0x80, 0).astype(np.uint8)[:, None].repeat(12, 1)
    cut = kind == _CUT
    edges[cut] = raw[at[cut, None] + np.arange(12)]
    after = at + 12 * cut
    slots = raw[after[:, None] + np.arange(12)].view("<u2").astype(np.int64)
    if version < 33:  # numbers of other materials before version 27: left out
        material = (material & 7 | (material >> 3 & 3) << 5 | (material >> 5 & 7) << 8) * (version > 26)
    table = np.array(polygons, np.int64).reshape(-1, 3)
    cubes = Cubes(size, size >> level, edges, slots, material, merged, table, table)
    polygons, stored = _stored(cubes, raw, table, version)
    return replace(cubes, polygons=polygons, stored=stored)


def _scan(data: bytes, at: int, size: int, version: int, where: str) -> tuple[list[int], list[int], int]:
    """What a pass over the bytes finds.  Five numbers a cube: kind, depth, byte of its values, material, merged faces;
    three numbers a stored polygon: cube, face, byte; and the byte after all.
    """
    rows: list[int] = []
    polygons: list[int] = []
    left, deepest, number, new = [8], size.bit_length() - 1, 0, version > 31
    while left:
        if not left[-1]:
            left.pop()
            continue
        left[-1] -= 1
        kind = data[at]
        at += 1
        which, material, merged, start = kind & 7, 0, 0, at
        if which > _CUT or (which == _CHILDREN and len(left) >= deepest):
            raise SceneError(f"byte {at - 1} holds no cube", where=where, hint="the map is damaged")
        if which == _CHILDREN:
            left.append(8)
            continue
        at += 24 if which == _CUT else 12
        if new:
            if kind & 0x40:
                material = data[at] if version == 32 else data[at] | data[at + 1] << 8
                at += 1 if version == 32 else 2
            if kind & 0x80:
                merged = data[at]
                at += 1
            if kind & 0x20:
                at = _scan_polygons(data, at, number, polygons)
        else:
            material, merged, at = _scan_old(data, at, kind, number, polygons)
        rows += (which, len(left), start, material, merged)
        number += 1
        if number & 0xFFFF == 0:
            require(number * _CUBE_BYTES, "its cubes", SceneError, where)
    require(number * _CUBE_BYTES, "its cubes", SceneError, where)
    return rows, polygons, at


def _scan_polygons(data: bytes, at: int, number: int, polygons: list[int]) -> int:
    """The byte after the stored polygons of a cube of version 32 or 33."""
    mask, at = data[at], at + 2
    for face in range(6):
        if mask >> face & 1:
            flags, count = data[at + 2], data[at + 3]
            if count & MOST_CORNERS:
                polygons += (number, face, at)
            at += 4 + _polygon_bytes(flags, count)
    return at


def _scan_old(data: bytes, at: int, kind: int, number: int, polygons: list[int]) -> tuple[int, int, int]:
    """Material and merged faces of a cube before version 32, and the byte after it."""
    mask, material, merged = data[at], 0, 0
    at += 1
    if mask & 0x80:
        material = data[at]
        at += 1
    second_layers = lit = 0
    for face in range(6):
        if mask >> face & 1:
            second_layers += data[at + 15] >> 1 & 1  # a second layer follows
            lit |= (data[at + 14] > 5 or data[at + 15] > 0) << face  # with a lightmap
            at += 28 if mask & 0x40 else 16
    at += 16 * second_layers
    whole = 0
    if kind & 0x80:
        merged = data[at]
        at += 1
        if merged & 0x80:
            whole, at = data[at], at + 1
            for face in range(6):
                if whole >> face & 1:
                    polygons += (number, face, at)
                    at += 8
    return material, merged & 0x3F & (whole | ~lit) | lit << 8, at  # a face with a light of its own is drawn alone


def _stored(cubes: Cubes, raw: Array, table: Array, version: int) -> tuple[Array, Array]:
    """``polygons`` and ``stored`` of Cubes.  Two coordinates of a corner are stored, the third lies in the plane of its
    face; all count from the nearest multiple of 4096 cubes."""
    cube, face, at = table.T
    corner = cubes.corners(cube, face)
    origin = (cubes.origins[cube] & 0xFFF) * 8
    places = corner * cubes.sizes[cube][:, None, None] + origin[:, None]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    if version > 31:
        other = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 0])
        normal = np.where(normal.any(1)[:, None], normal, other)
    bias = -(normal * places[:, 0]).sum(1)
    out = np.zeros((len(table), MOST_CORNERS, 3), np.int64)

    def put(rows: Array, k: int, one: Array, two: Array) -> None:
        dim = face[rows] >> 1
        across = np.take_along_axis(normal[rows], np.stack([dim, _FIRST[dim], _SECOND[dim]], 1), 1)
        total = -(bias[rows] + across[:, 1] * one + across[:, 2] * two)
        third = np.abs(total) // np.maximum(np.abs(across[:, 0]), 1) * np.sign(total) * np.sign(across[:, 0])  # as in C
        third = np.where(across[:, 0] == 0, origin[rows, dim], third)
        out[rows, k, dim], out[rows, k, _FIRST[dim]], out[rows, k, _SECOND[dim]] = third, one, two

    def word(rows: Array, offset: Array | int) -> Array:
        start = at[rows] + offset
        return raw[start].astype(np.int64) | raw[start + 1].astype(np.int64) << 8

    rows = np.arange(len(table))
    if version < 32:  # boxes of the corners' least and greatest coordinates
        box = [word(rows, 2 * k) for k in range(4)]
        if version < 26:
            box = [(value - (box[k & 2] & 0xE000)) * 4 & 0xFFFF for k, value in enumerate(box)]
        for k in range(4):
            high = CORNERS[face, k]
            sides = (
                np.where(high[rows, axis[face >> 1]], box[i + 1], box[i]) for i, axis in ((0, _FIRST), (2, _SECOND))
            )
            put(rows, k, *sides)
        count, good = np.full(len(table), 4), (box[0] < box[1]) & (box[2] < box[3])
    else:
        flags, layers = raw[at + 2].astype(np.int64), raw[at + 3].astype(np.int64)
        count, (boxes, before, each, _) = layers & MOST_CORNERS, _layout(flags, layers)
        good = count > 2
        plain = rows[flags & 4 == 0]  # the corners of the cube's face itself
        for k in range(4):
            skip = (count[plain] < 4) & (flags[plain] & 2 != 0) & (k > 0)
            out[plain, k] = places[plain, (flags[plain] & 1) + k + skip & 3]
        box, free = rows[boxes], rows[(flags & 4 != 0) & ~boxes]
        sides = [word(box, 4 + 2 * k) for k in range(4)]
        for k, (one, two) in enumerate(((0, 1), (0, 3), (2, 3), (2, 1))):
            put(box, k, sides[one], sides[two])
        for k in range(MOST_CORNERS):
            cornered = free[count[free] > k]
            put(cornered, k, *(word(cornered, 4 + before[cornered] + k * each[cornered] + i) for i in (0, 2)))
    out += ((cubes.origins[cube] & ~0xFFF) * 8)[:, None]
    return np.stack([cube, face, count], 1)[good], out[good]


# --------------------------------------------------------------------------------------------------- what is drawn
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
