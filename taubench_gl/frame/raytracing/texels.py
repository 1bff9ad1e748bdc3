"""How trees, triangles and instances are laid out in the images that ``raytracing/trace.glsl`` reads.  NumPy only.

All images are RGBA32UI and 2^ROW_BITS texels wide.

Node       x, y, z: low and high bound along an axis, two signed 16-bit integers, the low one in the low half;
           w: of an inner node, the place after its subtree; of a leaf LEAF_BIT, triangles - 1, number of the first
Triangle   three texels, xyz: a corner, float32 in grid units; w: triangle of its primitive; draw (merged draws) or 0;
           1 where its material tests alpha
Instance   four texels: the rows of grid_from_relative, float32; first node, number of nodes, distance from the plane
           of a triangle within which a ray that starts there does not meet it (float32), draw (0 for merged draws).
           The first instance is the tree over all others; instead of a draw it has the extent of the scene.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import moderngl

    from taubench_gl.frame.raytracing.bvh import Tree

Array = np.ndarray

ROW_BITS = 12
"""Images are 2^ROW_BITS texels wide."""

AT_ONCE = 1 << 18
"""Triangles or vertices whose texels are made at a time."""

HALF_GRID = 32767
"""Grid coordinates of a tree's box: -HALF_GRID to HALF_GRID."""

FAR_SLACK = 0.02
"""Grid units by which float32 may move a point of a surface that is far larger than the rest of the scene: ten
roundings of a grid coordinate.  Origins of rays are offset by the extent of that rest, which is less."""

LEAF_BIT = 1 << 31
LEAF_COUNT_SHIFT = 28
LEAF_FIRST_MASK = (1 << LEAF_COUNT_SHIFT) - 1
TRIANGLE_TEXELS, INSTANCE_TEXELS = 3, 4

GLSL = f"""const int TRACE_ROW_BITS = {ROW_BITS};
const float TRACE_HALF_GRID = {HALF_GRID}.0;
const uint TRACE_LEAF_FIRST = {LEAF_FIRST_MASK}u;
const int TRACE_LEAF_COUNT_SHIFT = {LEAF_COUNT_SHIFT};"""


@dataclass(frozen=True, slots=True)
class Grid:
    """The map from the space of a tree to its grid: grid = (space - center) * scale, along each axis."""

    center: Array  # (3,) float64
    scale: Array  # (3,) float64

    @classmethod
    def around(cls, low: Array, high: Array) -> Grid:
        """The grid of the box from ``low`` to ``high``, (3,) each."""
        low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
        half = 0.5 * (high - low)
        # A flat box has a depth of 1/1024 of its width; a point has any.
        half = np.maximum(half, max(half.max() / 1024.0, 1e-20))
        return cls(0.5 * (low + high), HALF_GRID / half)

    @property
    def matrix(self) -> Array:
        """The transform grid_from_space, (4, 4) float64."""
        out = np.diag([*self.scale, 1.0])
        out[:3, 3] = -self.center * self.scale
        return out


@dataclass(frozen=True, slots=True)
class PlacedTree:
    """A tree in the node image."""

    first: int  # node
    nodes: int
    low: Array  # (3,) float64 box, in the space of the tree
    high: Array
    grid: Grid


def last_words(tree: Tree, first_triangle: int) -> Array:
    """Word w of every node.  (N,) uint32."""
    from taubench_gl.frame.raytracing.bvh import skips

    leaf = (np.maximum(tree.count, 1) - 1).astype(np.uint32) << LEAF_COUNT_SHIFT
    leaf |= LEAF_BIT | (first_triangle + tree.first).astype(np.uint32)
    return np.where(tree.count > 0, leaf, skips(tree).view(np.uint32))


def node_texels(tree: Tree, first_triangle: int) -> Array:
    """Nodes of ``tree``, whose boxes are in grid units.  (N, 4) uint32."""
    out = np.empty((len(tree), 4), np.uint32)
    for at in range(0, len(tree), AT_ONCE):
        part = slice(at, at + AT_ONCE)
        down = np.clip(np.floor(tree.low[part]), -32768, 32767).astype(np.int16).view(np.uint16)
        up = np.clip(np.ceil(tree.high[part]), -32768, 32767).astype(np.int16).view(np.uint16)
        out[part, :3] = down | up.astype(np.uint32) << 16
    out[:, 3] = last_words(tree, first_triangle)
    return out


def triangle_texels(corners: Array, triangle: Array, draw: Array, flags: Array) -> Array:
    """Texels (T, 3, 4) uint32 of triangles; the rest (T,).

    ``corners`` (T, 3, 4) float32: in grid units, and a number that the texels take the place of.
    """
    out = corners.view(np.uint32)
    out[:, 0, 3], out[:, 1, 3], out[:, 2, 3] = triangle, draw, flags
    return out


class Texels:
    """An array of texels of four 32-bit words, which grows part by part and is written to a texture in the end."""

    def __init__(self, reserved: int = 0, row_bits: int = ROW_BITS):
        """``reserved``: texels at the start that are written later; images are 2^``row_bits`` texels wide."""
        self._parts: deque[Callable[[], Iterable[Array]]] = deque()
        self.count, self._row_bits = 0, row_bits
        self.add(np.zeros((reserved, 4), np.uint32))

    def add(self, texels: Array) -> int:
        """Append ``texels`` (..., 4) of 32 bits; the number of the first."""
        words = np.ascontiguousarray(texels).reshape(-1, 4)
        return self.add_later(len(words), lambda: (words,))

    def add_later(self, count: int, make: Callable[[], Iterable[Array]]) -> int:
        """Append ``count`` texels; the number of the first.

        ``make`` returns them array by array when they are written, so that a large table is not held beside the texture
        that it becomes.
        """
        first = self.count
        self._parts.append(make)
        self.count += count
        return first

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of an image of all texels, the last row filled up."""
        return 1 << self._row_bits, max(-(-self.count >> self._row_bits), 1)

    def write(self, texture: moderngl.Texture) -> None:
        """Write all texels to ``texture``, of ``size``; what is written is no longer held here."""
        at = 0
        while self._parts:
            for part in self._parts.popleft()():
                words = part.reshape(-1, 4).view(np.uint32)
                write_texels(texture, at, words)
                at += len(words)


def write_texels(texture: moderngl.Texture, first: int, rows: Array) -> None:
    """Overwrite texels ``rows`` (N, 4) of an image, counted row by row, from number ``first`` on."""
    width, done = texture.width, 0
    while done < len(rows):
        y, x = divmod(first + done, width)
        whole = (len(rows) - done) // width if x == 0 else 0
        size = (width, whole) if whole else (min(width - x, len(rows) - done), 1)
        part = rows[done : done + size[0] * size[1]]
        texture.write(np.ascontiguousarray(part), viewport=(x, y, *size))
        done += len(part)
