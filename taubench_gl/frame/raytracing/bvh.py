"""Bounding volume hierarchies by the surface-area heuristic, compiled by Numba when first needed.  No OpenGL.

Binned splits (Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007), large nodes by a sample of
their boxes, stored depth first with skip pointers, which need no stack to traverse (Smits, "Efficiency Issues for Ray
Tracing", 1998).

A tree is a pure function of its boxes.  Its depth is bounded: boxes that no plane separates are halved by number.
Two triangles in a row that fill much the same box, as those of a quad do, enter as one box (PAIR): they would share a
leaf in any case, and half as many boxes take half the time and memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

try:  # declared in pyproject.toml; the import itself takes a while, so nothing else imports this module early
    from numba import njit
except ImportError as error:  # pragma: no cover - a broken installation
    raise ImportError("ray tracing needs the package numba") from error

Array = np.ndarray

LEAF_TRIANGLES = 4
"""Default of the most triangles of a leaf."""

BINS = 16
"""Bins along each axis: one more than candidate planes."""

NODE_COST, TRIANGLE_COST = 1.0, 1.6
"""Time of a step to a node and of one triangle test, relative to each other (measured on llvmpipe)."""

MAX_DEPTH = 96
"""Depth below which nodes are halved by number; 2^32 triangles would end 32 levels later."""


@dataclass(frozen=True, slots=True)
class Tree:
    """A binary tree over boxes, nodes in depth-first order, the root first."""

    low: Array  # (N, 3) float32
    high: Array  # (N, 3) float32
    right: Array  # (N,) int32: second child of an inner node, whose first child is the node after it; -1: a leaf
    first: Array  # (N,) int32: first entry of ``order`` of a leaf
    count: Array  # (N,) int32: entries of a leaf; 0: an inner node
    order: Array  # (T,) int32: boxes as the leaves hold them

    def __len__(self) -> int:
        return len(self.right)


AT_ONCE = 1 << 17
"""Boxes that get their leaf between two reports of how far the builder is."""

SAMPLED = 2048
"""The plane of a node of twice as many boxes is found from this many to twice as many, one of each n in a row.

Which one of the n changes by the golden ratio: every n-th box of a mesh whose rows have n triangles is one column.
"""

ONE_AXIS = 128
"""Most boxes of a node that is split along the longest axis of their centers, without a look at the others."""

PAIR = 0.75
"""Two triangles in a row share a box whose area is at most so much of the sum of theirs.

It is half of it for the two of a quad, and all of it for neighbors of two quads.
"""

FEW = 16
"""Most boxes of a node whose planes are found by sorting: a fifth of the time of bins for nodes of a few boxes."""


def _compiled(function: Callable) -> Callable:
    """``function`` compiled; the machine code is kept on disk where there is a folder for it."""
    try:
        return njit(cache=True, nogil=True)(function)
    except RuntimeError:  # neither the package's folder nor the user's can be written
        return njit(nogil=True)(function)


_inlined = njit(inline="always")
"""Decorates what the builder calls for every node: calls between compiled functions took a quarter of the time."""


def build(low: Array, high: Array, leaf: int = LEAF_TRIANGLES) -> Tree:
    """A tree over the boxes ``low``, ``high`` (T, 3), finite; T >= 1.  ``leaf``: most boxes of a leaf."""
    boxes = np.zeros((len(low), 8), np.float32)
    boxes[:, :3], boxes[:, 3], boxes[:, 4:7] = low, 1, -np.asarray(high)
    return _build(boxes, np.arange(len(low) + 1, dtype=np.int32), leaf)


def build_over(vertices: Array, triangles: Array, watch: Callable[[int], None]) -> Tree:
    """A tree over the boxes of ``triangles`` (T, 3), rows of ``vertices`` (V, 3) float32, finite; T >= 1.

    ``watch`` gets the number of triangles that have their leaf, now and then.
    """
    return _build(*_boxes(vertices, triangles), LEAF_TRIANGLES, watch)


def _build(boxes: Array, starts: Array, leaf: int, watch: Callable[[int], None] = lambda done: None) -> Tree:
    """``starts`` (B + 1,) int32: first triangle of each of the ``boxes`` (B, 8), and the number of triangles."""
    n = len(boxes)
    size = max(2 * n - 1, 1)
    nodes_of, order = np.empty((size, 8), np.float32), np.arange(n, dtype=np.int32)
    right, first, count = (np.empty(size, np.int32) for _ in range(3))
    # Ranges still to do: begin, end, depth, node whose second child this is (-1: none).
    stack, state, spare = np.empty((MAX_DEPTH + 64, 4), np.int64), np.array([1, 0, 0]), np.empty(n, np.int32)
    stack[0], found = (0, n, 0, -1), np.empty(starts[-1], np.int32)
    while state[0]:
        _grow(boxes, starts, leaf, order, found, nodes_of, right, first, count, stack, state, spare)
        watch(int(state[2]))
    nodes = state[1]
    high = np.negative(nodes_of[:nodes, 4:7], out=nodes_of[:nodes, 4:7])
    # Views: what lies behind them was never touched and takes no memory, copies would at the moment when most is taken.
    return Tree(nodes_of[:nodes, :3], high, right[:nodes], first[:nodes], count[:nodes], found)


def skips(tree: Tree) -> Array:
    """The node after the subtree of every node, where a ray goes on that misses its box.  (N,) int32."""
    return _skips(tree.right)


def heights(tree: Tree) -> Array:
    """Height of every node above its lowest leaf: 0 for leaves.  (N,) int32."""
    return _heights(tree.right)


# A box is eight numbers: its low corner, its triangles, its negated high corner, 0.  So a union is eight minima, one
# instruction; that of two boxes does not say how many triangles it has.


@_inlined
def _area(box):
    x, y, z = -box[4] - box[0], -box[5] - box[1], -box[6] - box[2]
    return x * y + y * z + z * x


@_inlined
def _extend(box, other):
    """Extend ``box`` (8,) to contain ``other``."""
    for k in range(8):
        box[k] = other[k] if other[k] < box[k] else box[k]


@_compiled
def _boxes(vertices, triangles):
    """Boxes (B, 8) of one triangle or of two in a row (PAIR), and their first triangles (B + 1,), the last one: T."""
    boxes, starts = np.zeros((len(triangles), 8), np.float32), np.zeros(len(triangles) + 1, np.int32)
    last, both = 0, np.empty(8, np.float32)
    for t in range(len(triangles)):
        box = boxes[last + 1 if t else 0]
        for k in range(3):
            a, b, c = vertices[triangles[t, 0], k], vertices[triangles[t, 1], k], vertices[triangles[t, 2], k]
            box[k] = min(a, b, c)
            box[4 + k] = -max(a, b, c)
        box[3] = 1
        if t:
            both[:] = box
            _extend(both, boxes[last])
            if boxes[last, 3] == 1 and _area(both) <= np.float32(PAIR) * (_area(boxes[last]) + _area(box)):
                boxes[last] = both
                boxes[last, 3] = 2
            else:
                last += 1
                starts[last] = t
    starts[last + 1] = len(triangles)
    return boxes[: last + 1], starts[: last + 2]


@_inlined
def _measure(boxes, order, begin, end, center_low, scale):
    """Fill the lowest center of the boxes ``order[begin:end]`` along each axis, and bins for each meter.

    Centers are times 2, which saves a product; 0 bins for each meter: no extent, or an axis that is not looked at.
    """
    longest = 0
    for k in range(3):
        lowest, highest = np.float32(np.inf), np.float32(-np.inf)
        for i in range(begin, end):
            c = boxes[order[i], k] - boxes[order[i], 4 + k]
            lowest, highest = c if c < lowest else lowest, c if c > highest else highest
        center_low[k] = lowest
        extent = highest - lowest
        scale[k] = np.float32(BINS) / extent if extent > 0 else np.float32(0)
        if not np.isfinite(scale[k]):
            scale[k] = np.float32(0)
        if k and end - begin <= ONE_AXIS and scale[k] > 0:
            if scale[longest] == 0 or scale[k] < scale[longest]:
                scale[longest], longest = np.float32(0), k
            else:
                scale[k] = np.float32(0)


@_inlined
def _bin_of(boxes, t, k, center_low, scale):
    """The bin along axis ``k`` that the center of box ``t`` is in."""
    return np.int64(min((boxes[t, k] - boxes[t, 4 + k] - center_low[k]) * scale[k], np.float32(BINS - 1)))


@_compiled
def _plane_of_many(boxes, order, begin, end, center_low, scale, bins, counts, right_area, run):
    """Axis, last bin before the cheapest plane, area times triangles of both sides; axis -1: none separates.

    ``bins`` (3, BINS, 8), ``counts`` (3, BINS): room for boxes and triangles of each bin.
    """
    bins.fill(np.inf)
    counts.fill(0)
    total = 0
    for i in range(begin, end):
        t = order[i]
        size = np.int64(boxes[t, 3])
        total += size
        for k in range(3):
            if scale[k] > 0:
                b = _bin_of(boxes, t, k, center_low, scale)
                counts[k, b] += size
                _extend(bins[k, b], boxes[t])
    axis, last_bin, least_cost = -1, 0, np.inf
    for k in range(3):
        if scale[k] == 0:
            continue
        run.fill(np.inf)
        for b in range(BINS - 1, 0, -1):
            _extend(run, bins[k, b])
            right_area[b] = _area(run)  # read where there are boxes
        run.fill(np.inf)
        running = 0
        for b in range(BINS - 1):
            running += counts[k, b]
            _extend(run, bins[k, b])
            rest = total - running
            if running and rest:
                cost = _area(run) * running + right_area[b + 1] * rest
                if cost < least_cost:
                    axis, last_bin, least_cost = k, b, cost
    return axis, last_bin, least_cost


@_compiled
def _plane_of_few(boxes, order, begin, end, center_low, scale, at, bins, right_area, run):
    """``_plane_of_many`` of at most FEW boxes, which sorts them by bin; ``at``, ``bins`` (FEW,): room for that."""
    axis, last_bin, least_cost, n, total = -1, 0, np.inf, end - begin, 0
    for i in range(begin, end):
        total += np.int64(boxes[order[i], 3])
    for k in range(3):
        if scale[k] == 0:
            continue
        for i in range(n):
            t = order[begin + i]
            b, j = _bin_of(boxes, t, k, center_low, scale), i
            while j > 0 and bins[j - 1] > b:
                at[j], bins[j] = at[j - 1], bins[j - 1]
                j -= 1
            at[j], bins[j] = t, b
        run.fill(np.inf)
        for i in range(n - 1, 0, -1):
            _extend(run, boxes[at[i]])
            right_area[i] = _area(run)
        run.fill(np.inf)
        running = 0
        for i in range(n - 1):
            running += np.int64(boxes[at[i], 3])
            _extend(run, boxes[at[i]])
            if bins[i] < bins[i + 1]:
                cost = _area(run) * running + right_area[i + 1] * (total - running)
                if cost < least_cost:
                    axis, last_bin, least_cost = k, bins[i], cost
    return axis, last_bin, least_cost


@_inlined
def _partition(boxes, order, spare, begin, end, axis, last_bin, center_low, scale):
    """Move the boxes of ``order[begin:end]`` in front of the plane to the front; where the others begin.

    Stable, so that equal boxes keep their order.
    """
    middle, rest = begin, 0
    for i in range(begin, end):
        t = order[i]
        if _bin_of(boxes, t, axis, center_low, scale) <= last_bin:
            order[middle] = t
            middle += 1
        else:
            spare[rest] = t
            rest += 1
    for i in range(rest):
        order[middle + i] = spare[i]
    return middle


@_inlined
def _sort(order, begin, end):
    for i in range(begin + 1, end):
        t, j = order[i], i
        while j > begin and order[j - 1] > t:
            order[j] = order[j - 1]
            j -= 1
        order[j] = t


@_inlined
def _push(stack, top, begin, end, depth, parent):
    stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = begin, end, depth, parent


@_compiled
def _enclose(nodes_of, right, count, nodes):
    """Give the inner ones of the first ``nodes`` nodes the union of their children's boxes."""
    for node in range(nodes - 1, -1, -1):  # children come after their parent
        if count[node] == 0:
            for k in range(8):
                nodes_of[node, k] = min(nodes_of[node + 1, k], nodes_of[right[node], k])


@_compiled
def _grow(boxes, starts, leaf, order, found, nodes_of, right, first, count, stack, state, spare):
    """Add nodes until AT_ONCE more triangles have their leaf, or all have.

    ``order`` (B,): boxes, ``found`` (T,): triangles as the leaves hold them; ``state``: ranges in ``stack``, nodes so
    far, and triangles that have their leaf; ``spare`` (B,): room.
    """
    top, nodes, done, end_of_call = state[0], state[1], state[2], state[2] + AT_ONCE
    at, bin_of = np.empty(FEW, np.int32), np.empty(FEW, np.int64)
    bins, counts = np.empty((3, BINS, 8), np.float32), np.empty((3, BINS), np.int64)
    areas, run = np.empty(max(BINS, FEW)), np.empty(8, np.float32)
    center_low, scale = np.empty(3, np.float32), np.empty(3, np.float32)
    while top > 0 and done < end_of_call:
        top -= 1
        begin, end, depth, parent = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        node = nodes
        nodes += 1
        if parent >= 0:
            right[parent] = node
        total = end - begin
        step = total // SAMPLED
        sample, low, high = order, begin, end
        if step > 1:
            sample, low, high = spare, 0, total // step
            for i in range(high):
                spare[i] = order[begin + i * step + ((i * 40503 % 65536) * step >> 16)]
        _measure(boxes, sample, low, high, center_low, scale)
        axis, last_bin, least_cost = -1, 0, np.inf
        if total > 1 and depth < MAX_DEPTH:
            if total <= FEW:
                plane = _plane_of_few(boxes, order, begin, end, center_low, scale, at, bin_of, areas, run)
            else:
                plane = _plane_of_many(boxes, sample, low, high, center_low, scale, bins, counts, areas, run)
            axis, last_bin, least_cost = plane
        right[node], first[node], count[node] = -1, 0, 0
        if total <= leaf:
            box = nodes_of[node]
            box.fill(np.inf)
            size = 0
            for i in range(begin, end):
                size += np.int64(boxes[order[i], 3])
                _extend(box, boxes[order[i]])
            area = _area(box)
            split_cost = NODE_COST * 2.0 * area + TRIANGLE_COST * least_cost
            if size <= leaf and (axis < 0 or split_cost >= TRIANGLE_COST * area * size):
                first[node], count[node] = done, size
                _sort(order, begin, end)
                for i in range(begin, end):
                    for t in range(starts[order[i]], starts[order[i] + 1]):
                        found[done] = t
                        done += 1
                continue
        middle = begin + total // 2
        if axis >= 0:
            middle = _partition(boxes, order, spare, begin, end, axis, last_bin, center_low, scale)
        _push(stack, top, middle, end, depth + 1, node)
        _push(stack, top + 1, begin, middle, depth + 1, -1)
        top += 2
    if top == 0:
        _enclose(nodes_of, right, count, nodes)
    state[0], state[1], state[2] = top, nodes, done


@_compiled
def _skips(right):
    out = np.empty(len(right), np.int32)
    for node in range(len(right) - 1, -1, -1):  # a subtree ends where that of its second child does
        out[node] = node + 1 if right[node] < 0 else out[right[node]]
    return out


@_compiled
def _heights(right):
    out = np.zeros(len(right), np.int32)
    for node in range(len(right) - 1, -1, -1):
        if right[node] >= 0:
            out[node] = max(out[node + 1], out[right[node]]) + 1
    return out
