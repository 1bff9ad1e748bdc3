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

import itertools
import logging
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.frame.context import FrameContext
from taubench_gl.frame.materials import tests_alpha
from taubench_gl.frame.raytracing import texels
from taubench_gl.frame.raytracing.instances import SCALE_STEP, InstanceTable, instance_table
from taubench_gl.frame.raytracing.refit import PosedTrees
from taubench_gl.frame.raytracing.texels import INSTANCE_TEXELS, Grid, Texels, write_texels
from taubench_gl.frame.raytracing.trees import HINT, STRUCTURE, StoredTrees, Trees
from taubench_gl.gpu.declare import BUFFER, IMAGE, TEXTURE, UPDATE, ComputePass, Resource, Use
from taubench_gl.gpu.memory import require_memory
from taubench_gl.gpu.shared import Held
from taubench_gl.stage_log import lasting

if TYPE_CHECKING:
    from taubench_gl.frame.renderer import Renderer

log = logging.getLogger(__name__)
Array = np.ndarray

MAX_STEPS = 16_384
"""Nodes and triangles that one ray may visit; a ray that needs more is counted in ``trace_overflow``."""

TRIANGLE_BYTES = 150
"""Memory that a triangle takes while its tree is built: its vertices, box, nodes and texels; measured: 127."""


def trace_uses(*, software: bool) -> list[Use]:
    """What ``raytracing/trace.glsl`` reads and counts.  llvmpipe reads images faster, GPUs have few of them."""
    names = ("trace_nodes", "trace_triangles", "trace_instances")
    form, kind = (IMAGE, "rgba32ui") if software else (TEXTURE, "usampler2D")
    images = [Use(form, name, kind, filled=True) for name in names]
    return [*images, Use(BUFFER, "trace_overflow", "uint", access=UPDATE, filled=True)]


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
        self._moments = 1 + keep_previous
        posed = self.table.posed
        self._posed = [PosedTrees(renderer, posed, self._alpha) for _ in range(self._moments)] if len(posed) else []
        self._stored = self._hold()
        self._deforming = [Trees.of(posed.trees) for posed in self._posed]
        trees, count = self._stored.value, INSTANCE_TEXELS * (self.table.count + 1) * self._moments
        self._fixed, self._tops = trees.fixed, [trees.free.pop() for _ in range(self._moments)]
        self._rigid = np.concatenate([np.zeros(len(self.table.merged), np.int64), self.table.rigid])
        instances = Resource.texture("trace_instances", Texels(count).size, dtype="u4", what=STRUCTURE, hint=HINT)
        self._own = {
            "trace_instances": self._context.allocate(instances),
            "trace_overflow": self._gpu.ctx.buffer(bytes(4)),
        }
        self.resources: dict[str, Any] = trees.textures | self._own
        """Textures and buffers that ``declare`` names."""
        self.memory = trees.memory | {"trace_instances": instances.bytes}
        """GPU memory of the structure, bytes by name."""
        for posed_trees in self._posed:
            posed_trees.upload(self._context)
            for name, size in posed_trees.memory.items():
                self.memory[name] = self.memory.get(name, 0) + size

    def _hold(self) -> Held[StoredTrees]:
        """Trees with room for the top levels of this structure: those of another structure where nothing deforms."""
        if self._posed:
            trees = self._make()
            return Held(trees, trees.release)
        scene, shared = self._scene, self._gpu.shared
        key = id(scene.meshes), id(scene.channels), self._alpha.tobytes()
        for copy in itertools.count():
            held = shared.hold(scene.nodes, ("trees", key, copy), self._make)
            if len(held.value.free) >= self._moments:
                return held
            held.release()

    def _make(self) -> StoredTrees:
        primitives = {(self._draws[row].mesh, self._draws[row].primitive): row for row in self.table.rigid.tolist()}
        merged = [row for group in self.table.merged for row in group.draws.tolist()]
        rows = (*merged, *primitives.values(), *self._moments * self.table.posed.tolist())
        total = sum(self._draws[row].index_count // 3 for row in rows)
        require_memory(self._gpu, TRIANGLE_BYTES * total, f"{STRUCTURE} of {total} triangles", HINT)
        with lasting(log, "building trees for rays: %s triangles", f"{total:,}"):
            return StoredTrees(self._context, self._scene, self._draws, self.table, self._alpha, self._posed, total)

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
            if self._posed:
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

    def _write_top(self, number: int, trees: Trees, matrices: Array, visible: Array, draws: Array) -> None:
        """Write the instances and the tree over them.  ``number``: 0 this frame, 1 the frame before; ``matrices``
        (I, 4, 4) float64 relative_from_space; ``visible`` (I,); ``draws`` (I,): added to what the triangles say."""
        from taubench_gl.frame.raytracing.bvh import build

        inverse, regular = _inverses(matrices)
        at = np.flatnonzero(visible & regular & (trees.words[:, 1] > 0))
        first, first_node = number * (self.table.count + 1), self._tops[number] * self._stored.value.top_nodes
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
            words[0, :3] = top.matrix[:3].astype(np.float32).view(np.uint32)
            words[0, 3, :2] = first_node, len(tree)
            words[0, 3, 3] = np.float32(reach[~far].max()).view(np.uint32)
            at, far = at[tree.order], far[tree.order]
            grid_from_relative = inverse[at, :3] * trees.scale[at, :, None]
            grid_from_relative[:, :, 3] -= trees.center[at] * trees.scale[at]
            words[1:, :3] = grid_from_relative.astype(np.float32).view(np.uint32)
            words[1:, 3] = trees.words[at]
            words[1:, 3, 2] = np.where(far, texels.FAR_SLACK, 0.0).astype(np.float32).view(np.uint32)
            words[1:, 3, 3] = draws[at]
            write_texels(self.resources["trace_nodes"], first_node, texels.node_texels(tree, first + 1))
        write_texels(self.resources["trace_instances"], first * INSTANCE_TEXELS, words.reshape(-1, 4))

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
        self._stored.value.free += self._tops
        for item in (*self._own.values(), *self._posed, self._stored):
            item.release()


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
