"""The trees of a scene's draws on the GPU, which all acceleration structures of the scene share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.raytracing import texels
from taubench_gl.frame.raytracing.instances import InstanceTable
from taubench_gl.frame.raytracing.refit import PosedTrees
from taubench_gl.frame.raytracing.texels import AT_ONCE, Grid, PlacedTree, Texels
from taubench_gl.gpu.declare import Resource
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.math3d import bounds
from taubench_gl.scene.model import Scene
from taubench_gl.stage_log import progressed

if TYPE_CHECKING:
    import moderngl

Array = np.ndarray

STRUCTURE = "the acceleration structure"
HINT = "leave out --light path-traced, or simplify the scene"

TOPS = 4
"""Top levels that there is room for: of a pair of sources, each with this frame and the one before."""


@dataclass(frozen=True, slots=True)
class _Part:
    """Triangles of one draw that have only finite corners."""

    vertices: Array  # (V, 3) float64, in the space of the tree
    triangles: Array  # (T, 3)
    number: Array  # (T,) uint32: triangle of the primitive
    draw: int = 0  # what hits name, of merged draws

    @property
    def box(self) -> tuple[Array, Array]:
        """Low and high corner (3,) of at least one triangle."""
        used = np.zeros(len(self.vertices), dtype=bool)
        used[self.triangles] = True
        return bounds(self.vertices if used.all() else self.vertices[used])


class Trees:
    """The trees of all instances, one array for each property."""

    def __init__(self, words: Array, low: Array, high: Array, center: Array, scale: Array):
        self.words = words  # (I, 4) uint32: first node, nodes, 0, 0
        self.low, self.high = low, high  # (I, 3) float64 boxes in the spaces of the trees
        self.center, self.scale = center, scale  # (I, 3) float64 of their grids

    @classmethod
    def of(cls, trees: list[PlacedTree]) -> Trees:
        words = np.array([(t.first, t.nodes, 0, 0) for t in trees], np.uint32).reshape(-1, 4)
        columns = [(t.low, t.high, t.grid.center, t.grid.scale) for t in trees]
        return cls(words, *np.array(columns, np.float64).reshape(-1, 4, 3).transpose(1, 0, 2))

    def moved(self, boxes: list[tuple[Array, Array]], grids: list[Grid]) -> Trees:
        """These trees with other boxes and grids."""
        low, high = np.array(boxes).reshape(-1, 2, 3).transpose(1, 0, 2)
        return Trees(self.words, low, high, np.array([g.center for g in grids]), np.array([g.scale for g in grids]))

    def joined(self, other: Trees) -> Trees:
        names = ("words", "low", "high", "center", "scale")
        return Trees(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))


class StoredTrees:
    """Trees of all draws; behind the reserved top levels, which each structure writes for itself."""

    def __init__(
        self, context: GpuContext, scene: Scene, draws: tuple[Draw, ...], table: InstanceTable, alpha: Array,
        posed: list[PosedTrees], total: int,
    ):  # fmt: skip
        """``alpha`` (D,) bool: draws whose material tests alpha; ``posed``: gets the places of the trees it renews;
        ``total``: triangles of all trees, of which progress is a share."""
        self._scene, self._draws, self._table, self._alpha = scene, draws, table, alpha
        self.top_nodes = 2 * max(table.count, 1) - 1
        self.free = list(range(TOPS))
        self._placed, self._total = 0, total
        self._nodes, self._triangles = Texels(TOPS * self.top_nodes), Texels()
        trees = [self._merged_tree(merged.draws, merged.origin) for merged in table.merged]
        made: dict[tuple[int, int], PlacedTree] = {}
        for row in table.rigid.tolist():
            key = draws[row].mesh, draws[row].primitive
            if key not in made:
                made[key] = self._tree([self._part(row)], alpha[[row]])
            trees.append(made[key])
        for posed_trees in posed:
            posed_trees.place(self._nodes, self._triangles)
        self.fixed = Trees.of(trees)
        self.textures: dict[str, moderngl.Texture] = {}
        self.memory: dict[str, int] = {}
        for name, part in {"trace_nodes": self._nodes, "trace_triangles": self._triangles}.items():
            resource = Resource.texture(name, part.size, dtype="u4", what=STRUCTURE, hint=HINT)
            self.textures[name] = context.allocate(resource)
            self.memory[name] = resource.bytes
            part.write(self.textures[name])
        del self._nodes, self._triangles

    def _part(self, row: int) -> _Part:
        """The triangles of a draw in its own space."""
        draw = self._draws[row]
        primitive = self._scene.meshes[draw.mesh].primitives[draw.primitive]
        vertices, triangles = primitive.positions.astype(np.float64), primitive.triangles
        finite = np.isfinite(vertices).all(axis=1)
        if finite.all():
            return _Part(vertices, triangles, np.arange(len(triangles), dtype=np.uint32))
        number = np.flatnonzero(finite[triangles].all(axis=1)).astype(np.uint32)
        return _Part(vertices, triangles[number], number)

    def _merged_tree(self, draws: Array, origin: Array) -> PlacedTree:
        parts = []
        for row in draws.tolist():
            part, world = self._part(row), self._table.world[row]
            vertices = part.vertices @ world[:3, :3].T + (world[:3, 3] - origin)
            parts.append(_Part(vertices, part.triangles, part.number, row))
        return self._tree(parts, self._alpha[draws])

    def _tree(self, parts: list[_Part], alpha: Array) -> PlacedTree:
        """Build the tree over the triangles of ``parts``, which it empties, and append its nodes and triangles.

        ``alpha`` (parts,) bool: where they test alpha.
        """
        from taubench_gl.frame.raytracing.bvh import build_over

        counts = [len(part.triangles) for part in parts]
        if not sum(counts):
            return PlacedTree(0, 0, np.zeros(3), np.zeros(3), Grid.around(np.zeros(3), np.zeros(3)))
        boxes = [part.box for part in parts if len(part.triangles)]
        low, high = np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
        grid, starts = Grid.around(low, high), np.cumsum([0, *(len(part.vertices) for part in parts)])
        vertices, at = np.zeros((starts[-1], 4), np.float32), np.cumsum([0, *counts])  # w: room for a word
        triangles = np.empty((at[-1], 3), np.uint32)
        for i, part in enumerate(parts):
            vertices[starts[i] : starts[i + 1], :3] = (part.vertices - grid.center) * grid.scale
            np.add(part.triangles, np.uint32(starts[i]), out=triangles[at[i] : at[i + 1]])
        number, draw = np.concatenate([p.number for p in parts]), np.repeat(np.uint32([p.draw for p in parts]), counts)
        flags = np.repeat(alpha.astype(np.uint32), counts)
        parts.clear()  # the caller has the list
        before, self._placed = self._placed, self._placed + len(triangles)
        tree = build_over(vertices, triangles, lambda done: progressed((before + done) / self._total))
        first = self._nodes.add(texels.node_texels(tree, self._triangles.count // texels.TRIANGLE_TEXELS))
        nodes, order = len(tree), tree.order
        del tree  # larger than what is left of it

        def made() -> Iterator[Array]:
            for at in range(0, len(order), AT_ONCE):
                o = order[at : at + AT_ONCE]
                # ``take`` copies rows, indexing their numbers one by one, which takes three times as long.
                corners = vertices.take(triangles.take(o, axis=0), axis=0)
                yield texels.triangle_texels(corners, number[o], draw[o], flags[o])

        self._triangles.add_later(texels.TRIANGLE_TEXELS * len(order), made)
        return PlacedTree(first, nodes, low, high, grid)

    def release(self) -> None:
        for texture in self.textures.values():
            texture.release()
