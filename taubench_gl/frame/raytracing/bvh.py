"""Bounding volume hierarchies by the surface-area heuristic, compiled by Numba when first needed.  No OpenGL.

Binned splits (Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007), stored depth first with
skip pointers, which need no stack to traverse (Smits, "Efficiency Issues for Ray Tracing", 1998).

A tree is a pure function of its boxes.  Its depth is bounded: boxes that no plane separates are halved by number.
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


def _compiled(function: Callable) -> Callable:
    """``function`` compiled; the machine code is kept on disk where there is a folder for it."""
    try:
        return njit(cache=True, nogil=True)(function)
    except RuntimeError:  # neither the package's folder nor the user's can be written
        return njit(nogil=True)(function)


def build(low: Array, high: Array, leaf: int = LEAF_TRIANGLES) -> Tree:
    """A tree over the boxes ``low``, ``high`` (T, 3), finite; T >= 1.  ``leaf``: most boxes of a leaf."""
    low, high = (np.ascontiguousarray(a, dtype=np.float32) for a in (low, high))
    return Tree(*_build(low, high, leaf))


def skips(tree: Tree) -> Array:
    """The node after the subtree of every node, where a ray goes on that misses its box.  (N,) int32."""
    return _skips(tree.right)


def heights(tree: Tree) -> Array:
    """Height of every node above its lowest leaf: 0 for leaves.  (N,) int32."""
    return _heights(tree.right)


@_compiled
def _area(low, high):
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return x * y + y * z + z * x


@_compiled
def _extend(low, high, other_low, other_high):
    """Extend the box ``low``, ``high`` (3,) to contain the other."""
    for k in range(3):
        low[k] = min(low[k], other_low[k])
        high[k] = max(high[k], other_high[k])


@_compiled
def _bounds(low, high, order, begin, end, out_low, out_high):
    """Fill the bounds (3,) of the boxes ``order[begin:end]``."""
    out_low[:], out_high[:] = np.inf, -np.inf
    for i in range(begin, end):
        _extend(out_low, out_high, low[order[i]], high[order[i]])


@_compiled
def _scale_to_bins(low, high, order, begin, end, center_low, scale):
    """Fill the lowest center of the boxes ``order[begin:end]`` along each axis, and bins for each meter; 0: no extent.

    Centers are times 2, which saves a product.
    """
    center_high = np.empty(3, np.float32)
    center_low[:], center_high[:] = np.inf, -np.inf
    for i in range(begin, end):
        t = order[i]
        for k in range(3):
            c = low[t, k] + high[t, k]
            center_low[k] = min(center_low[k], c)
            center_high[k] = max(center_high[k], c)
    for k in range(3):
        extent = center_high[k] - center_low[k]
        scale[k] = np.float32(BINS) / extent if extent > 0 else np.float32(0)
        if not np.isfinite(scale[k]):
            scale[k] = np.float32(0)


@_compiled
def _bin_of(low, high, t, k, center_low, scale):
    """The bin along axis ``k`` that the center of box ``t`` is in."""
    return min(np.int64((low[t, k] + high[t, k] - center_low[k]) * scale[k]), BINS - 1)


@_compiled
def _fill_bins(low, high, order, begin, end, center_low, scale, bin_low, bin_high, bin_count):
    """Bounds (3, BINS, 3) and number (3, BINS) of the boxes ``order[begin:end]`` in the bins along each axis."""
    bin_low[:], bin_high[:], bin_count[:] = np.inf, -np.inf, 0
    for i in range(begin, end):
        t = order[i]
        for k in range(3):
            if scale[k] > 0:
                b = _bin_of(low, high, t, k, center_low, scale)
                bin_count[k, b] += 1
                _extend(bin_low[k, b], bin_high[k, b], low[t], high[t])


@_compiled
def _cheapest_plane(scale, bin_low, bin_high, bin_count):
    """Axis, last bin before the plane, and area times number of boxes of both sides; axis -1: no plane separates."""
    axis, last_bin, least_cost = -1, 0, np.inf
    right_area, right_count = np.empty(BINS), np.empty(BINS, np.int64)
    run_low, run_high = np.empty(3, np.float32), np.empty(3, np.float32)
    for k in range(3):
        if scale[k] == 0:
            continue
        run_low[:], run_high[:] = np.inf, -np.inf
        running = 0
        for b in range(BINS - 1, 0, -1):
            running += bin_count[k, b]
            _extend(run_low, run_high, bin_low[k, b], bin_high[k, b])
            right_count[b] = running
            right_area[b] = _area(run_low, run_high)  # read where there are boxes
        run_low[:], run_high[:] = np.inf, -np.inf
        running = 0
        for b in range(BINS - 1):
            running += bin_count[k, b]
            _extend(run_low, run_high, bin_low[k, b], bin_high[k, b])
            if running and right_count[b + 1]:
                cost = _area(run_low, run_high) * running + right_area[b + 1] * right_count[b + 1]
                if cost < least_cost:
                    axis, last_bin, least_cost = k, b, cost
    return axis, last_bin, least_cost


@_compiled
def _partition(low, high, order, spare, begin, end, axis, last_bin, center_low, scale):
    """Move the boxes of ``order[begin:end]`` in front of the plane to the front; where the others begin.

    Stable, so that equal boxes keep their order.
    """
    middle, rest = begin, 0
    for i in range(begin, end):
        t = order[i]
        if _bin_of(low, high, t, axis, center_low, scale) <= last_bin:
            order[middle] = t
            middle += 1
        else:
            spare[rest] = t
            rest += 1
    for i in range(rest):
        order[middle + i] = spare[i]
    return middle


@_compiled
def _build(low, high, leaf):
    """The arrays of a Tree, in the order of its fields."""
    n = len(low)
    order = np.arange(n).astype(np.int32)
    size = max(2 * n - 1, 1)
    node_low, node_high = np.empty((size, 3), np.float32), np.empty((size, 3), np.float32)
    right, first, count = np.full(size, -1, np.int32), np.zeros(size, np.int32), np.zeros(size, np.int32)
    # Ranges still to do: begin, end, depth, node whose second child this is (-1: none).
    stack = np.empty((MAX_DEPTH + 64, 4), np.int64)
    stack[0] = (0, n, 0, -1)
    top, nodes = 1, 0
    bin_low, bin_high = np.empty((3, BINS, 3), np.float32), np.empty((3, BINS, 3), np.float32)
    bin_count, spare = np.empty((3, BINS), np.int64), np.empty(n, np.int32)
    center_low, scale = np.empty(3, np.float32), np.empty(3, np.float32)
    while top > 0:
        top -= 1
        begin, end, depth, parent = stack[top]
        node = nodes
        nodes += 1
        if parent >= 0:
            right[parent] = node
        _bounds(low, high, order, begin, end, node_low[node], node_high[node])
        total = end - begin
        axis, last_bin, least_cost = -1, 0, np.inf
        if total > 1 and depth < MAX_DEPTH:
            _scale_to_bins(low, high, order, begin, end, center_low, scale)
            _fill_bins(low, high, order, begin, end, center_low, scale, bin_low, bin_high, bin_count)
            axis, last_bin, least_cost = _cheapest_plane(scale, bin_low, bin_high, bin_count)
        area = _area(node_low[node], node_high[node])
        if total <= leaf:
            split_cost = NODE_COST * 2.0 * area + TRIANGLE_COST * least_cost
            if axis < 0 or split_cost >= TRIANGLE_COST * area * total:
                first[node], count[node] = begin, total
                order[begin:end].sort()
                continue
        middle = begin + total // 2
        if axis >= 0:
            middle = _partition(low, high, order, spare, begin, end, axis, last_bin, center_low, scale)
        stack[top] = (middle, end, depth + 1, node)
        stack[top + 1] = (begin, middle, depth + 1, -1)
        top += 2
    return (
        node_low[:nodes].copy(), node_high[:nodes].copy(), right[:nodes].copy(), first[:nodes].copy(),
        count[:nodes].copy(), order,
    )  # fmt: skip


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
