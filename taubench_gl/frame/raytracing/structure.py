"""The acceleration structure on the GPU: trees of triangles, and each frame a tree over their visible instances.

Every tree has a *grid* of its own: its space, scaled and shifted so that the tree's box is [-32767, 32767] along each
axis.  Node bounds are 16-bit integers of that grid, rounded outwards, so that a node is one texel; triangle corners are
float32 in the same space.  An instance is one affine matrix, grid_from_relative, composed in float64: rays are relative
to the current camera, and no world offset ever meets a float32.

Nodes lie in depth-first order, and a ray that misses a node skips its subtree: no stack, and the same order for all
rays.  (Nearer children first, with a copy of the nodes for each octant of directions, was 10 % faster with equal
numbers in all pixels and 15 % slower with independent ones, on llvmpipe.)  ``raytracing.texels`` describes the images.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.materials import tests_alpha
from taubench_gl.frame.raytracing import texels
from taubench_gl.frame.raytracing.instances import SCALE_STEP, InstanceTable, instance_table
from taubench_gl.frame.raytracing.refit import PosedTrees
from taubench_gl.frame.raytracing.texels import INSTANCE_TEXELS, ROW_BITS, Grid, PlacedTree, Texels
from taubench_gl.gpu.declare import BUFFER, IMAGE, TEXTURE, UPDATE, ComputePass, Resource, Use
from taubench_gl.gpu.memory import require_memory
from taubench_gl.stage_log import lasting

if TYPE_CHECKING:
    from taubench_gl.frame.renderer import Renderer

log = logging.getLogger(__name__)
Array = np.ndarray

MAX_STEPS = 16_384
"""Nodes and triangles that one ray may visit; a ray that needs more is counted in ``trace_overflow``."""

TRIANGLE_BYTES = 350
"""Memory that a triangle takes while its tree is built: corners in float64 and float32, boxes, nodes and texels."""

AT_ONCE = 1 << 18
"""Triangles whose texels are made at a time."""

HINT = "leave out --light path-traced, or simplify the scene"


def trace_uses(*, software: bool) -> list[Use]:
    """What ``raytracing/trace.glsl`` reads and counts.  llvmpipe reads images faster, GPUs have few of them."""
    names = ("trace_nodes", "trace_triangles", "trace_instances")
    form, kind = (IMAGE, "rgba32ui") if software else (TEXTURE, "usampler2D")
    images = [Use(form, name, kind, filled=True) for name in names]
    return [*images, Use(BUFFER, "trace_overflow", "uint", access=UPDATE, filled=True)]


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
        corners = self.vertices[used]
        return corners.min(axis=0), corners.max(axis=0)


class SceneStructure:
    """Trees of one renderer's scene.  ``update`` before the passes of a frame that trace rays."""

    def __init__(self, renderer: Renderer, *, alpha_test: bool = True, keep_previous: bool = False):
        """``alpha_test``: surfaces whose material tests alpha let rays through where it is below the cutoff;
        ``keep_previous``: also hold the structure of the frame before, for a renderer with the channel prev_position.
        """
        if keep_previous and "prev_position" not in renderer.channels:
            raise ValueError("the structure of the frame before needs a renderer with the channel prev_position")
        self._context, self._gpu, self._scene = renderer.context, renderer.context.gpu, renderer.scene
        self._draws, self._previous = renderer.draws, keep_previous
        self._buffers = renderer.buffers
        self.table: InstanceTable = instance_table(self._scene, self._draws, renderer.poser)
        tested = {i for i, material in enumerate(self._scene.materials) if alpha_test and tests_alpha(material)}
        self._alpha = np.array([d.material in tested for d in self._draws], dtype=bool)
        self.memory: dict[str, int] = {}
        """GPU memory of the structure, bytes by name."""
        self.resources: dict[str, Any] = {}
        """Textures and buffers that ``declare`` names."""
        self._moments = 1 + keep_previous
        self._posed = [PosedTrees(renderer, self.table.posed, self._alpha) for _ in range(self._moments)]
        with lasting(log, "building trees for rays: %s triangles", f"{self._stored_triangles:,}"):
            self._build()

    # --- building
    def _build(self) -> None:
        total = self._stored_triangles
        require_memory(self._gpu, TRIANGLE_BYTES * total, f"the acceleration structure of {total} triangles", HINT)
        self._top_nodes = 2 * max(self.table.count, 1) - 1
        self._nodes = Texels(self._moments * self._top_nodes)
        self._triangles = Texels()
        trees = [self._merged_tree(merged.draws, merged.origin) for merged in self.table.merged]
        made: dict[tuple[int, int], PlacedTree] = {}
        for row in self.table.rigid.tolist():
            key = self._draws[row].mesh, self._draws[row].primitive
            if key not in made:
                made[key] = self._tree([self._part(row)], self._alpha[[row]])
            trees.append(made[key])
        for posed in self._posed:
            posed.place(self._nodes, self._triangles)
        self._fixed = _Trees.of(trees)
        self._deforming = [_Trees.of(posed.trees) for posed in self._posed]
        self._rigid = np.concatenate([np.zeros(len(self.table.merged), np.int64), self.table.rigid])
        images = {"trace_nodes": self._nodes, "trace_triangles": self._triangles}
        images["trace_instances"] = Texels(INSTANCE_TEXELS * (self.table.count + 1) * self._moments)
        for name, part in images.items():
            resource = Resource.texture(name, part.size, dtype="u4", what="the acceleration structure", hint=HINT)
            self.resources[name] = self._context.allocate(resource)
            self.memory[name] = resource.bytes
            for at, rows in part.taken():
                self._write(name, at, rows)
        self.resources["trace_overflow"] = self._gpu.ctx.buffer(bytes(4))
        for posed in self._posed if len(self.table.posed) else ():
            posed.upload(self._context)
            for name, size in posed.memory.items():
                self.memory[name] = self.memory.get(name, 0) + size
        del self._nodes, self._triangles

    @property
    def _stored_triangles(self) -> int:
        """Number of triangles in all trees."""
        merged = [row for group in self.table.merged for row in group.draws.tolist()]
        primitives = {(self._draws[row].mesh, self._draws[row].primitive): row for row in self.table.rigid.tolist()}
        posed = self._moments * self.table.posed.tolist()
        return sum(self._draws[row].index_count // 3 for row in (*merged, *primitives.values(), *posed))

    def _part(self, row: int) -> _Part:
        """The triangles of a draw in its own space."""
        draw = self._draws[row]
        primitive = self._scene.meshes[draw.mesh].primitives[draw.primitive]
        vertices, triangles = primitive.positions.astype(np.float64), primitive.triangles
        finite = np.isfinite(vertices).all(axis=1)
        number = np.flatnonzero(finite[triangles].all(axis=1)).astype(np.uint32)
        return _Part(vertices, triangles[number], number)

    def _merged_tree(self, draws: Array, origin: Array) -> PlacedTree:
        parts = []
        for row in draws.tolist():
            part, world = self._part(row), self.table.world[row]
            vertices = part.vertices @ world[:3, :3].T + (world[:3, 3] - origin)
            parts.append(_Part(vertices, part.triangles, part.number, row))
        return self._tree(parts, self._alpha[draws])

    def _tree(self, parts: list[_Part], alpha: Array) -> PlacedTree:
        """Build the tree over the triangles of ``parts`` and append its nodes and triangles; ``alpha`` (parts,)."""
        from taubench_gl.frame.raytracing.bvh import build_over

        counts = [len(part.triangles) for part in parts]
        if not sum(counts):
            return PlacedTree(0, 0, np.zeros(3), np.zeros(3), Grid.around(np.zeros(3), np.zeros(3)))
        boxes = [part.box for part in parts if len(part.triangles)]
        low, high = np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
        grid, corners, end = Grid.around(low, high), np.empty((sum(counts), 3, 3), np.float32), 0
        for part, count in zip(parts, counts, strict=True):
            vertices = ((part.vertices - grid.center) * grid.scale).astype(np.float32)
            corners[end : end + count], end = vertices[part.triangles], end + count
        number, draw = np.concatenate([p.number for p in parts]), np.repeat(np.uint32([p.draw for p in parts]), counts)
        flags = np.repeat(alpha.astype(np.uint32), counts)
        del parts
        tree = build_over(corners)
        first = self._nodes.add(texels.node_texels(tree, self._triangles.count // texels.TRIANGLE_TEXELS))
        for at in range(0, len(corners), AT_ONCE):
            o = tree.order[at : at + AT_ONCE]
            self._triangles.add(texels.triangle_texels(corners[o], number[o], draw[o], flags[o]))
        return PlacedTree(first, len(tree), low, high, grid)

    # --- every frame
    def update(self, frame: FrameContext) -> None:
        """Renew the trees of posed draws, place the visible instances and build the tree over them."""
        moments = [(frame.state, frame.view, frame.placement, "positions")]
        if self._previous:
            moments.append((*frame.before, "prev_positions"))
        origin = frame.view.position
        for number, (state, view, placement, positions) in enumerate(moments):
            matrices = placement.world[self._rigid]
            for i, merged in enumerate(self.table.merged):
                matrices[i] = np.eye(4)
                matrices[i, :3, 3] = merged.origin
            matrices[:, :3, 3] -= origin
            visible = placement.visible[self._rigid]
            visible[: len(self.table.merged)] = True
            trees, draws = self._fixed, self._rigid
            if len(self.table.posed):
                posed = self._posed[number]
                boxes = posed.boxes(state, view, placement.world)
                grids = posed.run(boxes, self.resources, self._buffers.pools[True][positions])
                from_camera = np.tile(np.eye(4), (len(boxes), 1, 1))  # posed vertices are relative to their own camera
                from_camera[:, :3, 3] = view.position - origin
                trees = trees.joined(self._deforming[number].moved(boxes, grids))
                matrices = np.concatenate([matrices, from_camera])
                visible = np.concatenate([visible, placement.visible[self.table.posed]])
                draws = np.concatenate([draws, self.table.posed])
            self._write_top(number, trees, matrices, visible, draws)

    def _write_top(self, number: int, trees: _Trees, matrices: Array, visible: Array, draws: Array) -> None:
        """Write the instances and the tree over them.  ``number``: 0 this frame, 1 the frame before; ``matrices``
        (I, 4, 4) float64 relative_from_space; ``visible`` (I,); ``draws`` (I,): added to what the triangles say."""
        from taubench_gl.frame.raytracing.bvh import build

        inverse, regular = _inverses(matrices)
        at = np.flatnonzero(visible & regular & (trees.words[:, 1] > 0))
        first = number * (self.table.count + 1)
        words = np.zeros((len(at) + 1, INSTANCE_TEXELS, 4), np.uint32)
        if len(at):
            center, half = 0.5 * (trees.low + trees.high)[at], 0.5 * (trees.high - trees.low)[at]
            linear, offset = matrices[at, :3, :3], matrices[at, :3, 3]
            center = np.einsum("nij,nj->ni", linear, center) + offset
            half = np.einsum("nij,nj->ni", np.abs(linear), half)
            top = Grid.around((center - half).min(axis=0), (center + half).max(axis=0))
            low, high = (center - half - top.center) * top.scale, (center + half - top.center) * top.scale
            low = np.nextafter(low.astype(np.float32), np.float32(-np.inf))
            tree = build(low, np.nextafter(high.astype(np.float32), np.float32(np.inf)), leaf=1)
            # What is far larger than the rest does not count as the extent of the scene: a dome, or wide terrain.
            reach = half.max(axis=1)
            core = reach[0] if at[0] < len(self.table.merged) else np.median(reach)
            far = reach > SCALE_STEP * core
            first_node = number * self._top_nodes
            texels.fill_instance(words[0], top.matrix, (first_node, len(tree), 0, 0))
            words[0, 3, 3] = np.float32(reach[~far].max()).view(np.uint32)
            at, far = at[tree.order], far[tree.order]
            grid_from_relative = inverse[at, :3] * trees.scale[at, :, None]
            grid_from_relative[:, :, 3] -= trees.center[at] * trees.scale[at]
            words[1:, :3] = grid_from_relative.astype(np.float32).view(np.uint32)
            words[1:, 3] = trees.words[at]
            words[1:, 3, 2] = np.where(far, texels.FAR_SLACK, 0.0).astype(np.float32).view(np.uint32)
            words[1:, 3, 3] = draws[at]
            self._write("trace_nodes", first_node, texels.node_texels(tree, first + 1))
        self._write("trace_instances", first * INSTANCE_TEXELS, words.reshape(-1, 4))

    def _write(self, name: str, first: int, rows: Array) -> None:
        """Overwrite texels ``rows`` (N, 4) from number ``first`` on."""
        width, done = 1 << ROW_BITS, 0
        while done < len(rows):
            y, x = divmod(first + done, width)
            whole = (len(rows) - done) // width if x == 0 else 0
            size = (width, whole) if whole else (min(width - x, len(rows) - done), 1)
            part = rows[done : done + size[0] * size[1]]
            self.resources[name].write(np.ascontiguousarray(part), viewport=(x, y, *size))
            done += len(part)

    # --- for passes
    def declare(self, p: ComputePass) -> ComputePass:
        """Add what ``raytracing/trace.glsl`` needs to a pass."""
        previous = self.table.count + 1
        p.glsl(texels.GLSL, f"const int TRACE_MAX_STEPS = {MAX_STEPS}, TRACE_PREVIOUS_TOP = {previous};")
        p.define(TRACE_ALPHA=bool(self._alpha.any()), TRACE_PREVIOUS=self._previous)
        return p.use(*trace_uses(software=self._gpu.software))

    @property
    def unfinished_rays(self) -> int:
        """Rays of all frames so far that visited MAX_STEPS nodes without an end.  Waits for the GPU."""
        self._gpu.hazards.publish()
        return int(np.frombuffer(self.resources["trace_overflow"].read(), np.uint32)[0])

    def release(self) -> None:
        for item in self.resources.values():
            item.release()
        for posed in self._posed if len(self.table.posed) else ():
            posed.release()


class _Trees:
    """The trees of all instances, one array for each property."""

    def __init__(self, words: Array, low: Array, high: Array, center: Array, scale: Array):
        self.words = words  # (I, 4) uint32: first node, nodes, 0, 0
        self.low, self.high = low, high  # (I, 3) float64 boxes in the spaces of the trees
        self.center, self.scale = center, scale  # (I, 3) float64 of their grids

    @classmethod
    def of(cls, trees: list[PlacedTree]) -> _Trees:
        words = np.array([(t.first, t.nodes, 0, 0) for t in trees], np.uint32).reshape(-1, 4)
        columns = [(t.low, t.high, t.grid.center, t.grid.scale) for t in trees]
        return cls(words, *np.array(columns, np.float64).reshape(-1, 4, 3).transpose(1, 0, 2))

    def moved(self, boxes: list[tuple[Array, Array]], grids: list[Grid]) -> _Trees:
        """These trees with other boxes and grids."""
        low, high = np.array(boxes).reshape(-1, 2, 3).transpose(1, 0, 2)
        return _Trees(self.words, low, high, np.array([g.center for g in grids]), np.array([g.scale for g in grids]))

    def joined(self, other: _Trees) -> _Trees:
        names = ("words", "low", "high", "center", "scale")
        return _Trees(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))


def _inverses(matrices: Array) -> tuple[Array, Array]:
    """Inverses of affine matrices (I, 4, 4), and which are regular (I,): the others flatten what they place."""
    linear = matrices[:, :3, :3]
    size = np.abs(linear).max(axis=(1, 2), initial=0.0)
    regular = np.isfinite(matrices).all(axis=(1, 2)) & (size > 0.0)
    unit = np.where(regular[:, None, None], linear, np.eye(3)) / np.where(regular, size, 1.0)[:, None, None]
    x, y, z = unit[:, 0], unit[:, 1], unit[:, 2]
    adjugate = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)
    determinant = np.einsum("ni,ni->n", x, adjugate[:, :, 0])
    regular &= np.abs(determinant) > 1e-30
    out = np.tile(np.eye(4), (len(matrices), 1, 1))
    out[:, :3, :3] = adjugate / np.where(regular, determinant * np.where(regular, size, 1.0), 1.0)[:, None, None]
    out[:, :3, 3] = -np.einsum("nij,nj->ni", out[:, :3, :3], np.where(regular[:, None], matrices[:, :3, 3], 0.0))
    return out, regular
