"""The deform pass: morphs and skins every posed vertex on the GPU, now and one frame ago, in one dispatch."""

from __future__ import annotations

import numpy as np

from taubench_gl.animation import FrameState, View, skin_matrices
from taubench_gl.frame.geometry import Draw, Geometry, Soup
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.scene.model import Scene

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
    Field("palette", "uint", "first matrix of the palette now"),
    Field("prev_palette", "uint", "first matrix of the palette one frame ago"),
    Field("first_morph", "uint", "first MorphUse"),
    Field("morph_count", "uint", "targets with a weight now or one frame ago"),
    Field("mirror", "float", "-1 if the pose mirrors, else 1"),
)
MORPH = Struct(
    "MorphUse",
    Field("positions", "uint", "float offset of position displacements"),
    Field("normals", "uint", "float offset of normal displacements, or NOTHING"),
    Field("tangents", "uint", "float offset of tangent displacements, or NOTHING"),
    Field("weight", "float", "now"),
    Field("prev_weight", "float", "one frame ago"),
)
NOTHING = 0xFFFFFFFF
GROUP = 64


class _Floats:
    """Appends float arrays and remembers where each went."""

    def __init__(self) -> None:
        self.parts: list[Array] = []
        self.size = 0

    def add(self, values: Array) -> int:
        offset = self.size
        self.parts.append(np.ascontiguousarray(values, dtype=np.float32).reshape(-1))
        self.size += self.parts[-1].size
        return offset


class DeformPass:
    """Owns sources, job tables and palettes; writes into the posed pool's buffers."""

    def __init__(self, gpu: Gpu, shaders: ShaderCache, scene: Scene, geometry: Geometry, *, previous: bool):
        self._gpu, self._scene, self._previous = gpu, scene, previous
        self._draws: list[tuple[int, Draw]] = [(i, d) for i, d in enumerate(geometry.draws) if d.posed]
        preamble = "\n".join((JOB.glsl, MORPH.glsl, f"const uint NOTHING = {NOTHING}u;"))
        self._deform = shaders.compute("deform/deform.comp.glsl", {"HAS_PREVIOUS": previous}, preamble)
        self._flat = None
        if any(d.flat for _, d in self._draws):
            self._flat = shaders.compute("deform/flat_normals.comp.glsl", {}, preamble)
        self._upload_sources(geometry)
        ctx = gpu.ctx
        counts = [d.vertex_count for _, d in self._draws]
        self._groups = ctx.buffer(_work_groups(counts, 1).tobytes())
        self._group_count = sum(-(-c // GROUP) for c in counts)
        flat = [(d.vertex_count if d.flat else 0) for _, d in self._draws]
        self._flat_group_count = sum(-(-c // 3 // GROUP) for c in flat)
        self._flat_groups = ctx.buffer(_work_groups(flat, 3).tobytes() or bytes(8))
        self._job_buffer = ctx.buffer(reserve=len(self._draws) * JOB.dtype.itemsize, dynamic=True)
        self._palette_buffer = ctx.buffer(reserve=64 * 1024, dynamic=True)
        self._morph_buffer = ctx.buffer(reserve=1024, dynamic=True)

    def _upload_sources(self, geometry: Geometry) -> None:
        floats, joints = _Floats(), []
        joint_count = 0
        self._jobs = JOB.zeros(len(self._draws))
        self._targets: list[list[tuple[int, int, int]]] = []  # per draw: offsets of each target
        stored: dict[tuple[int, int], tuple] = {}
        for row, (_, draw) in enumerate(self._draws):
            key = (draw.mesh, draw.primitive)
            if key not in stored:
                soup = geometry.posed_soups[key]
                primitive = self._scene.meshes[draw.mesh].primitives[draw.primitive]
                skin_offsets = (0, 0, 0)
                if primitive.joints is not None:
                    taken = primitive.joints[soup.source]
                    skin_offsets = (floats.add(primitive.weights[soup.source]), joint_count, taken.shape[1])
                    joints.append(taken.astype(np.uint32).reshape(-1))
                    joint_count += taken.size
                base = (floats.add(soup.positions), floats.add(soup.normals), floats.add(soup.tangents))
                stored[key] = (base, skin_offsets, [_add_target(floats, t, soup) for t in primitive.targets])
            (positions, normals, tangents), (weights, joint_at, influences), targets = stored[key]
            job = self._jobs[row]
            job["vertex_count"], job["posed_vertex"] = draw.vertex_count, draw.base_vertex
            job["positions"], job["normals"], job["tangents"] = positions, normals, tangents
            skinned = self._scene.nodes.skin[draw.node] >= 0
            job["weights"], job["joints"], job["influences"] = weights, joint_at, influences if skinned else 0
            self._targets.append(targets)
        ctx = self._gpu.ctx
        self._floats = ctx.buffer(np.concatenate([*floats.parts, np.zeros(4, np.float32)]).tobytes())
        self._joints = ctx.buffer(np.concatenate([*joints, np.zeros(4, np.uint32)]).tobytes())

    def run(self, state: FrameState, view: View, before: FrameState, before_view: View, pool_buffers: dict) -> Array:
        """Pose everything at ``state`` (and ``before``).  Returns (D_posed,) bool: which poses mirror."""
        palettes, mirrored = self._palettes(state, view)
        prev_palettes, _ = self._palettes(before, before_view) if self._previous else ([], None)
        offset = 0
        for name, group in (("palette", palettes), ("prev_palette", prev_palettes)):
            for row, matrices in enumerate(group):
                self._jobs[name][row] = offset
                offset += len(matrices)
        self._jobs["mirror"] = np.where(mirrored, -1.0, 1.0)
        matrices = np.concatenate([*palettes, *prev_palettes])
        self._palette_buffer = self._fit(self._palette_buffer, matrices[:, :3].astype(np.float32).tobytes())
        self._morph_buffer = self._fit(self._morph_buffer, self._morph_uses(state, before).tobytes())
        self._job_buffer.write(self._jobs.tobytes())
        for binding, buffer in enumerate(
            (self._groups, self._job_buffer, self._palette_buffer, self._morph_buffer, self._floats, self._joints)
        ):
            buffer.bind_to_storage_buffer(binding)
        pool_buffers["positions"].bind_to_storage_buffer(6)
        pool_buffers["normals"].bind_to_storage_buffer(7)
        pool_buffers["tangents"].bind_to_storage_buffer(8)
        if self._previous:
            pool_buffers["prev_positions"].bind_to_storage_buffer(9)
        self._deform.run(self._group_count)
        self._gpu.ctx.memory_barrier()
        if self._flat is not None:
            self._flat_groups.bind_to_storage_buffer(0)
            self._flat.run(self._flat_group_count)
            self._gpu.ctx.memory_barrier()
        return mirrored

    def _palettes(self, state: FrameState, view: View) -> tuple[list[Array], Array]:
        """Camera-relative matrices of every posed draw, float64 (J, 4, 4) each, and whether they mirror."""
        skins: dict[int, Array] = {}
        out, mirrored = [], np.zeros(len(self._draws), dtype=bool)
        for row, (_, draw) in enumerate(self._draws):
            skin = int(self._scene.nodes.skin[draw.node])
            if skin >= 0 and self._jobs["influences"][row]:
                if skin not in skins:
                    skins[skin] = skin_matrices(self._scene, state, skin)
                matrices = skins[skin].copy()
            else:
                matrices = state.world[draw.node][None].copy()
                if draw.local is not None:
                    matrices = matrices @ draw.local
            mirrored[row] = np.linalg.det(matrices[0, :3, :3]) < 0
            # Weights sum to 1, so shifting every matrix shifts the blended point by the same.
            matrices[:, :3, 3] -= view.position
            out.append(matrices)
        return out, mirrored

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

    def _fit(self, buffer, payload: bytes):
        """``buffer`` with ``payload`` in it, reallocated only when it has grown."""
        if buffer.size < len(payload):
            buffer.release()
            buffer = self._gpu.ctx.buffer(reserve=len(payload) * 3 // 2, dynamic=True)
        buffer.write(payload)
        return buffer

    def release(self) -> None:
        for buffer in (self._groups, self._flat_groups, self._job_buffer, self._palette_buffer, self._morph_buffer):
            buffer.release()
        self._floats.release()
        self._joints.release()


def _add_target(floats: _Floats, target, soup: Soup) -> tuple[int, int, int]:
    count = len(soup.source)
    positions = np.zeros((count, 3), np.float32) if target.positions is None else target.positions[soup.source]
    normals = NOTHING if target.normals is None or soup.flat else floats.add(target.normals[soup.source])
    tangents = NOTHING if target.tangents is None else floats.add(target.tangents[soup.source])
    return floats.add(positions), normals, tangents


def _work_groups(counts: list[int], per_thread: int) -> Array:
    """(G, 2) uint32: job and first thread of every work group."""
    rows = [(job, first) for job, count in enumerate(counts) for first in range(0, count // per_thread, GROUP)]
    return np.array(rows, dtype=np.uint32).reshape(-1, 2)
