"""The tree builder: every box in one leaf, bounds that hold, bounded depth, the same bits every time."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.frame.raytracing import bvh
from taubench_gl.frame.raytracing.bvh import LEAF_TRIANGLES, MAX_DEPTH, Tree, build, build_over, heights, skips

Array = np.ndarray


def some_boxes(kind: str, count: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(count)
    low = rng.normal(size=(count, 3))
    if kind == "equal":
        low[:] = low[0]
    if kind == "line":
        low[:, 1:] = 0.0
    if kind == "huge":
        low *= 1e18
    if kind == "clustered":
        low = low[0] + 10.0 ** rng.uniform(-30, 4, (count, 1)) * low
    return low, low + (0.0 if kind in ("equal", "line") else 0.01) * rng.random((count, 3))


def check(tree: Tree, low: Array, high: Array) -> None:
    assert sorted(tree.order.tolist()) == list(range(len(low)))
    leaf = tree.count > 0
    assert (tree.right[leaf] == -1).all() and (tree.count[leaf] <= LEAF_TRIANGLES).all()
    assert tree.count.sum() == len(low) and len(tree) == 2 * leaf.sum() - 1
    first = tree.first[leaf]
    np.testing.assert_array_equal(first, np.cumsum(tree.count[leaf]) - tree.count[leaf])
    low, high = (corner[tree.order].astype(np.float32) for corner in (low, high))
    np.testing.assert_array_equal(tree.low[leaf], np.minimum.reduceat(low, first))
    np.testing.assert_array_equal(tree.high[leaf], np.maximum.reduceat(high, first))
    inner = np.flatnonzero(~leaf)
    left, right = inner + 1, tree.right[inner]
    np.testing.assert_array_equal(tree.low[inner], np.minimum(tree.low[left], tree.low[right]))
    np.testing.assert_array_equal(tree.high[inner], np.maximum(tree.high[left], tree.high[right]))
    skip = skips(tree)
    assert skip[0] == len(tree) and (skip[left] == right).all() and (skip[right] == skip[inner]).all()
    assert heights(tree)[0] <= MAX_DEPTH + 32


@pytest.mark.parametrize("count", [1, 2, 5, 3000])
@pytest.mark.parametrize("kind", ["cloud", "equal", "line", "huge", "clustered"])
def test_trees_hold_every_box(kind, count):
    low, high = some_boxes(kind, count)
    check(build(low, high), low, high)


def terrain(quads: int) -> tuple[Array, Array]:
    """A height field in rows: vertices (V, 3) float32, and triangles (T, 3)."""
    x, y = np.meshgrid(np.arange(quads + 1), np.arange(quads + 1))
    vertices = np.stack([x, 3.0 * np.sin(x / 17.0) * np.cos(y / 23.0), y], axis=-1).reshape(-1, 3)
    first = (x + (quads + 1) * y)[:-1, :-1].reshape(-1, 1)
    return vertices.astype(np.float32), (first + [0, 1, quads + 1, 1, quads + 2, quads + 1]).reshape(-1, 3)


def expected_visits(tree: Tree) -> float:
    """Nodes and triangles that a random ray through the box of the tree visits, by the surface-area heuristic."""
    x, y, z = (tree.high.astype(np.float64) - tree.low).T
    area = x * y + y * z + z * x
    return float(area @ np.maximum(tree.count, 1) / area[0])


def test_a_tree_over_triangles_holds_their_boxes_and_says_how_far_it_is():
    rng = np.random.default_rng(3)
    vertices, quads = terrain(400)
    triangles = np.concatenate([rng.integers(0, len(vertices), (bvh.AT_ONCE, 3)), quads]).astype(np.uint32)
    done: list[int] = []
    tree = build_over(vertices, triangles, done.append)
    corners = vertices[triangles]
    check(tree, corners.min(axis=1), corners.max(axis=1))
    assert len(done) >= 3 and done == sorted(set(done)) and done[-1] == len(triangles)
    assert max(np.diff([0, *done])) < bvh.AT_ONCE + LEAF_TRIANGLES


def test_the_two_triangles_of_a_quad_share_a_leaf():
    vertices, triangles = terrain(64)
    tree = build_over(vertices, np.concatenate([triangles[:1], triangles]).astype(np.uint32), lambda done: None)
    for first, count in zip(tree.first[tree.count > 0], tree.count[tree.count > 0], strict=True):
        inside = tree.order[first : first + count]
        assert 1 <= count <= LEAF_TRIANGLES and (np.diff(inside) > 0).all()
    quad = np.empty(len(tree.order), int)
    quad[tree.order] = np.repeat(np.arange(np.count_nonzero(tree.count)), tree.count[tree.count > 0])
    assert (quad[1::2] == quad[2::2]).mean() > 0.9


@pytest.mark.parametrize(("quads", "layers"), [(512, 1), (256, 2)])
def test_the_order_of_triangles_in_a_file_costs_rays_nothing(quads, layers):
    """Rows of 2^n triangles, and two layers whose triangles alternate: a sample with a period sees a part of them."""
    vertices, triangles = terrain(quads)
    every = np.stack([triangles + layer * len(vertices) for layer in range(layers)], axis=1).reshape(-1, 3)
    vertices = np.concatenate([vertices + np.float32([0, 5000 * layer, 0]) for layer in range(layers)])
    mixed = np.random.default_rng(1).permutation(every)
    in_rows, at_random = (build_over(vertices, t.astype(np.uint32), lambda done: None) for t in (every, mixed))
    assert expected_visits(in_rows) < 1.1 * expected_visits(at_random)
