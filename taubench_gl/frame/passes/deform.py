"""The deform pass: morphs and skins every posed vertex, for this frame and the one before, in one dispatch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.animation import FrameState, View, skin_matrices
from taubench_gl.frame.geometry import Draw, VertexData
from taubench_gl.frame.scene_buffers import StoredGeometry
from taubench_gl.frame.spec import FrameSpec
from taubench_gl.gpu.declare import WRITE, ComputePass, Pass, Resource, stage
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.passes import GpuContext, fitted
from taubench_gl.scene.model import Primitive, Scene

if TYPE_CHECKING:
    import moderngl

Array = np.ndarray

JOB = Struct(
    "DeformJob",
    Field("vertex_count", "uint", "vertices of this draw"),
    Field("posed_vertex", "uint", "first vertex in the posed pool"),
    Field("positions", "uint", "float offset of source positions"),
    Field("normals", "uint", "float offset of source normals"),
    Field("tangents", "uint", "float offset of source tangents"),
    Field("weights", "uint", "float offset of skin weights"),
    Field("joints", "uint", "offset of joint indices"),
    Field("influences", "uint", "joints per vertex; 0: one matrix for all"),
    Field("palette", "uint", "first matrix of the palette of this frame"),
    Field("prev_palette", "uint", "first matrix of the palette of the frame before"),
    Field("first_morph", "uint", "first MorphUse"),
    Field("morph_count", "uint", "targets with a weight in either frame"),
    Field("mirror", "float", "-1 if the pose mirrors, else 1"),
    Field("collapsed", "uint", "1: a vertex scaled to zero has no position in the frame before"),
)
MORPH = Struct(
    "MorphUse",
    Field("positions", "uint", "float offset of position displacements"),
    Field("normals", "uint", "float offset of normal displacements, or NOTHING"),
    Field("tangents", "uint", "float offset of tangent displacements, or NOTHING"),
    Field("weight", "float", "in this frame"),
    Field("prev_weight", "float", "in the frame before"),
)
NOTHING = 0xFFFFFFFF
GROUP = 64


def deform_passes(*, previous: bool, flat: bool, vertices: int, groups: tuple[int, int] = (1, 1)) -> list[Pass]:
    """Declarations of the passes that pose vertices.  ``previous``: also pose the frame before; ``flat``: some posed
    primitive has no normals; ``vertices``: of the posed pool; ``groups``: work groups of both passes.
    """

    def pose(name: str, count: int) -> ComputePass:
        p = ComputePass("deform", (f"deform/{name}.comp.glsl",)).glsl(f"const uint NOTHING = {NOTHING}u;")
        return p.dispatch(GROUP * count, GROUP)

    deform = (
        pose("deform", groups[0])
        .define(HAS_PREVIOUS=previous)
        .buffer("groups", "uvec2", filled=True)
        .buffer("jobs", JOB, filled=True)
        .buffer("palettes", "vec4", filled=True)
        .buffer("morphs", MORPH, filled=True)
        .buffer("source", "float", filled=True)
        .buffer("joints", "uint", filled=True)
        .buffer("out_position", "float", access=WRITE, resource="positions")
        .buffer("out_normal", "float", access=WRITE, resource="normals")
        .buffer("out_tangent", "float", access=WRITE, resource="tangents")
    )
    if previous:
        deform.buffer("out_previous", "float", access=WRITE, resource="prev_positions")
        deform.allocate(Resource.buffer("prev_positions", max(12 * vertices, 4), label="previous vertices"))
    if not flat:
        return [deform]
    normals = (
        pose("flat_normals", groups[1])
        .buffer("groups", "uvec2", resource="flat_groups", filled=True)
        .buffer("jobs", JOB, filled=True)
        .buffer("position", "float", resource="positions")
        .buffer("out_normal", "float", access=WRITE, resource="normals")
    )
    return [deform, normals]


@stage(options=("skinning", "morphing", "previous_pose"))
def deform(spec: FrameSpec) -> Sequence[Pass]:
    posed = [(node, p) for node, p in spec.animated.drawn if spec.is_posed(node, p)]
    if not posed:
        return ()
    instances = spec.scene.nodes.instances
    vertices = sum(_vertex_count(p) * len(instances.get(node, (None,))) for node, p in posed)
    previous = "previous_pose" in spec.enabled or "prev_position" in spec.extra
    return deform_passes(previous=previous, flat=any(p.normals is None for _, p in posed), vertices=vertices)


def _vertex_count(p: Primitive) -> int:
    """Vertices of a primitive as it is drawn: flat primitives have three to each triangle."""
    return 3 * len(p.triangles) if p.normals is None else len(p.positions)


class _Floats:
    """Appends float arrays and remembers where each went: primitives that share vertices share them here too."""

    def __init__(self) -> None:
        self.parts: list[Array] = []
        self.size = 0
        self._known: dict[int, tuple[int, Array]] = {}  # by id; with the array, which keeps its id

    def add(self, values: Array) -> int:
        if id(values) not in self._known:
            self._known[id(values)] = self.size, values
            self.parts.append(np.ascontiguousarray(values, dtype=np.float32).reshape(-1))
            self.size += self.parts[-1].size
        return self._known[id(values)][0]


class DeformPass:
    """Owns sources, job tables and palettes; writes into the posed pool's buffers."""

    def __init__(self, context: GpuContext, scene: Scene, geometry: StoredGeometry, *, previous: bool):
        self._gpu, self._scene, self._previous = context.gpu, scene, previous
        self._draws: list[tuple[int, Draw]] = [(i, d) for i, d in enumerate(geometry.draws) if d.posed]
        self._upload_sources(geometry)
        ctx = self._gpu.ctx
        counts = [d.vertex_count for _, d in self._draws]
        flat = [(d.vertex_count if d.flat else 0) for _, d in self._draws]
        groups, flat_groups = _work_groups(counts, 1), _work_groups(flat, 3)
        passes = deform_passes(
            previous=previous,
            flat=any(d.flat for _, d in self._draws),
            vertices=len(geometry.posed.positions),
            groups=(len(groups), len(flat_groups)),
        )
        self._passes = [context.compute(p) for p in passes]
        self.outputs = context.allocate_all(passes)
        """Vertex buffers of the posed pool that only this pass needs."""
        self._tables |= {
            "groups": ctx.buffer(groups.tobytes()),
            "flat_groups": ctx.buffer(flat_groups.tobytes() or bytes(8)),
            "jobs": ctx.buffer(reserve=len(self._draws) * JOB.dtype.itemsize, dynamic=True),
            "palettes": ctx.buffer(reserve=64 * 1024, dynamic=True),
            "morphs": ctx.buffer(reserve=1024, dynamic=True),
        }

    def _upload_sources(self, geometry: StoredGeometry) -> None:
        floats, joints = _Floats(), []
        joint_count = 0
        self._jobs = JOB.zeros(len(self._draws))
        self._targets: list[list[tuple[int, int, int]]] = []  # per draw: offsets of each target
        stored: dict[tuple[int, int], tuple] = {}
        for row, (_, draw) in enumerate(self._draws):
            key = (draw.mesh, draw.primitive)
            if key not in stored:
                vertices = geometry.posed_vertices[key]
                primitive = self._scene.meshes[draw.mesh].primitives[draw.primitive]
                skin_offsets = (0, 0, 0)
                if primitive.joints is not None:
                    taken = primitive.joints[vertices.source]
                    skin_offsets = (floats.add(vertices.of(primitive.weights)), joint_count, taken.shape[1])
                    joints.append(taken.astype(np.uint32).reshape(-1))
                    joint_count += taken.size
                base = (floats.add(vertices.positions), floats.add(vertices.normals), floats.add(vertices.tangents))
                stored[key] = (base, skin_offsets, [_add_target(floats, t, vertices) for t in primitive.targets])
            (positions, normals, tangents), (weights, joint_at, influences), targets = stored[key]
            job = self._jobs[row]
            job["vertex_count"], job["posed_vertex"] = draw.vertex_count, draw.base_vertex
            job["positions"], job["normals"], job["tangents"] = positions, normals, tangents
            skinned = self._scene.nodes.skin[draw.node] >= 0
            job["weights"], job["joints"], job["influences"] = weights, joint_at, influences if skinned else 0
            self._targets.append(targets)
        ctx = self._gpu.ctx
        self._tables = {
            "source": ctx.buffer(np.concatenate([*floats.parts, np.zeros(4, np.float32)])),
            "joints": ctx.buffer(np.concatenate([*joints, np.zeros(4, np.uint32)])),
        }

    def run(
        self,
        now: tuple[FrameState, View],
        before: tuple[FrameState, View],
        pool: Mapping[str, moderngl.Buffer],
        collapsed: bool = False,
    ) -> Array:
        """Pose everything into ``pool``, as it is ``now`` and was ``before``.  (D_posed,) bool: which poses mirror.

        ``collapsed``: as for ``Renderer.draw``.
        """
        matrices, self._jobs["palette"], mirrored = self._palettes(*now)
        if self._previous:
            prev_matrices, first, _ = self._palettes(*before)
            self._jobs["prev_palette"] = len(matrices) + first
            matrices = np.concatenate([matrices, prev_matrices])
        self._jobs["collapsed"] = collapsed
        self._jobs["mirror"] = np.where(mirrored, -1.0, 1.0)
        for name, rows in (
            ("palettes", matrices[:, :3].astype(np.float32)),
            ("morphs", self._morph_uses(now[0], before[0])),
            ("jobs", self._jobs),
        ):
            self._tables[name] = fitted(self._gpu, self._tables[name], rows)
        for compiled in self._passes:
            compiled.run(None, {**self._tables, **pool})
        return mirrored

    def _palettes(self, state: FrameState, view: View) -> tuple[Array, Array, Array]:
        """Camera-relative matrices (J, 4, 4) float64; of every posed draw, its first one and whether it mirrors.

        The draws of one skin share its matrices.
        """
        parts: list[Array] = []
        part_of: dict[int, int] = {}  # skin -> index in ``parts``
        used = np.zeros(len(self._draws), dtype=np.int64)  # index in ``parts``
        for row, (_, draw) in enumerate(self._draws):
            skin = int(self._scene.nodes.skin[draw.node])
            if skin < 0 or not self._jobs["influences"][row]:
                used[row] = len(parts)
                matrix = state.world[draw.node][None]
                parts.append(matrix.copy() if draw.local is None else matrix @ draw.local)
                continue
            if skin not in part_of:
                part_of[skin] = len(parts)
                parts.append(skin_matrices(self._scene, state, skin))
            used[row] = part_of[skin]
        mirrored = np.array([np.linalg.det(part[0, :3, :3]) < 0 for part in parts], dtype=bool)
        first = np.cumsum([0, *(len(part) for part in parts)])
        matrices = np.concatenate(parts)
        # Weights sum to 1, so shifting every matrix shifts the blended point by the same.
        matrices[:, :3, 3] -= view.position
        return matrices, first[used], mirrored[used]

    def _morph_uses(self, state: FrameState, before: FrameState) -> Array:
        rows = []
        for row, (_, draw) in enumerate(self._draws):
            self._jobs["first_morph"][row] = len(rows)
            count = len(self._targets[row])
            if count:
                now = state.weights.get(draw.node, np.zeros(count))
                then = before.weights.get(draw.node, np.zeros(count))
                used = np.flatnonzero((now[:count] != 0) | (then[:count] != 0))
                rows.extend((*self._targets[row][t], now[t], then[t]) for t in used)
            self._jobs["morph_count"][row] = len(rows) - int(self._jobs["first_morph"][row])
        return np.array(rows or [(0, NOTHING, NOTHING, 0.0, 0.0)], dtype=MORPH.dtype)

    def release(self) -> None:
        for buffer in self._tables.values():
            buffer.release()


def _add_target(floats: _Floats, target, vertices: VertexData) -> tuple[int, int, int]:
    count = len(vertices.source)
    positions = np.zeros((count, 3), np.float32) if target.positions is None else vertices.of(target.positions)
    normals = NOTHING if target.normals is None or vertices.flat else floats.add(vertices.of(target.normals))
    tangents = NOTHING if target.tangents is None else floats.add(vertices.of(target.tangents))
    return floats.add(positions), normals, tangents


def _work_groups(counts: list[int], per_thread: int) -> Array:
    """(G, 2) uint32: job and first thread of every work group."""
    rows = [(job, first) for job, count in enumerate(counts) for first in range(0, count // per_thread, GROUP)]
    return np.array(rows, dtype=np.uint32).reshape(-1, 2)
