"""Trees of posed draws: built once from the pose at time 0, their bounds and triangles renewed on the GPU every frame.

The deform pass leaves camera-relative positions in the posed vertex pool.  One pass over all leaves moves their
triangles into the grid of their tree and bounds them; one pass for each height above unites the bounds of two children,
which are integers, so that nothing is rounded twice.  The shape of a tree never changes: it depends on the scene alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.animation import FrameState
from taubench_gl.animation.pose import pose_once
from taubench_gl.frame.geometry import instance_numbers
from taubench_gl.frame.raytracing import texels
from taubench_gl.frame.raytracing.texels import Grid, PlacedTree, Texels
from taubench_gl.gpu.declare import UPDATE, WRITE, ComputePass, Resource
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.passes import GpuContext, fitted

if TYPE_CHECKING:
    from taubench_gl.frame.renderer import Renderer

Array = np.ndarray

JOB = Struct(
    "RefitJob",
    Field("center", "vec4", "xyz: camera-relative point at the origin of the grid"),
    Field("scale", "vec4", "xyz: grid units to a length of 1"),
)
GROUP = 64
LARGEST = 1e12
"""Meters of a box.  In a larger grid the products of three edges are no normal floats, and GPUs flush those to 0."""

MARGIN = 1.01
"""Factor on the box of a pose: its bounds are computed in another way than its vertices."""


def refit_passes(leaves: int, heights: list[int]) -> list[ComputePass]:
    """Declarations of the passes that renew trees.  ``leaves``: of all trees; ``heights``: inner nodes of each height
    from 1 on.
    """
    leaf = (
        ComputePass("refit", ("raytracing/refit_leaves.comp.glsl",))
        .glsl(texels.GLSL)
        .image("refit_leaves", "rgba32ui", filled=True)
        .image("refit_corners", "rgba32ui", filled=True)
        .image("trace_triangles_out", "rgba32ui", access=WRITE, resource="trace_triangles")
        .image("trace_nodes_out", "rgba32ui", access=WRITE, resource="trace_nodes")
        .buffer("refit_jobs", JOB, filled=True)
        .buffer("position", "float", filled=True)
        .dispatch(leaves, GROUP)
    )
    inner = [
        ComputePass("refit", ("raytracing/refit_inner.comp.glsl",))
        .glsl(texels.GLSL)
        .image("refit_inner", "rgba32ui", filled=True)
        .image("trace_nodes", "rgba32ui", access=UPDATE, filled=True)
        .dispatch(count, GROUP)
        for count in heights
    ]
    return [leaf, *inner]


class PosedTrees:
    """The trees of a renderer's posed draws and the passes that renew them."""

    def __init__(self, renderer: Renderer, rows: Array, alpha: Array):
        """``rows`` (P,): posed draws; ``alpha`` (D,): whether a draw's material tests alpha."""
        self._rows, self._renderer, self._alpha = rows, renderer, alpha
        self._bounds = renderer.bounds
        self._instances = instance_numbers(renderer.draws)
        self.trees: list[PlacedTree] = []
        self._leaves, self._corners = Texels(), Texels()
        self._inner: list[tuple[int, Array]] = []
        self._tables: dict[str, Any] = {}
        self.memory: dict[str, int] = {}

    def place(self, nodes: Texels, triangles: Texels) -> None:
        """Build every tree and append its nodes and triangles, still empty."""
        from taubench_gl.frame.raytracing.bvh import build, heights

        by_height: dict[int, list[Array]] = {}
        self._first_slot = triangles.count // texels.TRIANGLE_TEXELS
        state, posed = self._renderer.poser.sample(0.0), {}
        for job, row in enumerate(self._rows.tolist()):
            corners, index = self._pose(row, state, posed)
            if not len(corners):
                self.trees.append(PlacedTree(0, 0, np.zeros(3), np.zeros(3), Grid.around(np.zeros(3), np.zeros(3))))
                continue
            tree = build(corners.min(axis=1), corners.max(axis=1))
            slot = triangles.add(np.zeros((len(corners) * texels.TRIANGLE_TEXELS, 4), np.uint32))
            slot //= texels.TRIANGLE_TEXELS
            words = np.zeros((len(tree), 4), np.uint32)
            words[:, 3] = texels.last_words(tree, slot)
            first = nodes.add(words)
            self.trees.append(PlacedTree(first, len(tree), np.zeros(3), np.zeros(3), Grid(np.zeros(3), np.ones(3))))
            self._corners.add(
                np.column_stack([index[tree.order], tree.order.astype(np.uint32) | int(self._alpha[row]) << 31])
            )
            leaf = np.flatnonzero(tree.count > 0)
            self._leaves.add(
                np.column_stack(
                    [first + leaf, slot + tree.first[leaf], tree.count[leaf], np.full(len(leaf), job)]
                ).astype(np.uint32)
            )
            height = heights(tree)
            for h in range(1, int(height.max()) + 1):
                n = np.flatnonzero(height == h)
                by_height.setdefault(h, []).append(
                    np.column_stack([first + n, first + n + 1, first + tree.right[n], words[n, 3]])
                )
        self._inner = [np.concatenate(by_height[h]).astype(np.uint32) for h in sorted(by_height)]

    def _pose(self, row: int, state: FrameState, posed: dict[tuple, Array]) -> tuple[Array, Array]:
        """Corners (T, 3, 3) of a draw's triangles, world, float64, and their vertices in the posed pool.

        ``posed``: vertices of this state that were posed before.
        """
        renderer = self._renderer
        draw, scene = renderer.draws[row], renderer.scene
        primitive = scene.meshes[draw.mesh].primitives[draw.primitive]
        world = pose_once(posed, scene, state, draw.node, primitive, self._instances[row])
        corners = np.nan_to_num(world[primitive.triangles], nan=0.0, posinf=1e30, neginf=-1e30)
        count = len(primitive.triangles)
        triangles = np.arange(3 * count).reshape(-1, 3) if draw.flat else primitive.triangles
        return corners, (draw.base_vertex + triangles).astype(np.uint32)

    def upload(self, context: GpuContext) -> None:
        """Make the passes and their tables."""
        lists = Texels()
        starts = [lists.add(rows) for rows in self._inner]
        images = {"refit_leaves": self._leaves, "refit_corners": self._corners, "refit_inner": lists}
        for name, part in images.items():
            resource = Resource.texture(name, part.size, dtype="u4", what="trees of moving surfaces")
            self._tables[name] = context.allocate(resource)
            part.write(self._tables[name])
            self.memory[name] = resource.bytes
        self._tables["refit_jobs"] = context.gpu.ctx.buffer(reserve=JOB.dtype.itemsize, dynamic=True)
        passes = refit_passes(self._leaves.count, [len(rows) for rows in self._inner])
        self._passes = [context.compute(p) for p in passes]
        self._starts = [(self._first_slot, self._leaves.count), *zip(starts, map(len, self._inner), strict=True)]
        self._gpu = context.gpu
        del self._leaves, self._corners, self._inner

    def boxes(self, state, view, world: Array) -> list[tuple[Array, Array]]:
        """Camera-relative boxes of the posed draws in ``state``: (3,), (3,) each."""
        with np.errstate(over="ignore", invalid="ignore"):
            centers, radii = self._bounds.at(state, world)
        # A pose that reaches to infinity has the largest bounds there can be.
        centers = np.nan_to_num(centers[self._rows], posinf=0.0, neginf=0.0) - view.position
        radii = np.minimum(np.nan_to_num(MARGIN * radii[self._rows, None], nan=LARGEST), LARGEST)
        return list(zip(centers - radii, centers + radii, strict=True))

    def run(self, boxes: list[tuple[Array, Array]], resources: dict[str, Any], positions: Any) -> list[Grid]:
        """Renew all trees from the vertex buffer ``positions``; the grids they are in."""
        grids = [Grid.around(*box) for box in boxes]
        jobs = JOB.zeros(len(grids))
        for job, grid in zip(jobs, grids, strict=True):
            job["center"][:3], job["scale"][:3] = grid.center, grid.scale
        self._tables["refit_jobs"] = fitted(self._gpu, self._tables["refit_jobs"], jobs)
        tables = {**self._tables, **resources, "position": positions}
        for compiled, (first, count) in zip(self._passes, self._starts, strict=True):
            compiled.run(None, tables, first=first, count=count)
        return grids

    def release(self) -> None:
        for item in (*self._passes, *self._tables.values()):
            item.release()
