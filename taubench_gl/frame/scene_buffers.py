"""A scene's geometry on the GPU: vertex pools, and the indirect draw commands grouped by state."""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from taubench_gl.frame.draw_bounds import DrawBounds
from taubench_gl.frame.geometry import Draw, Pool, build_geometry
from taubench_gl.frame.materials import MaterialTable
from taubench_gl.frame.records import RECORD, Placement
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shared import Held
from taubench_gl.scene.model import Scene

if TYPE_CHECKING:
    import moderngl

Array = np.ndarray
COMMAND = np.dtype(
    [("count", "u4"), ("instances", "u4"), ("first", "u4"), ("base_vertex", "i4"), ("base_instance", "u4")]
)
_ATTRIBUTES = (  # name in the shader, pool array, format
    ("in_position", "positions", "3f"),
    ("in_normal", "normals", "3f"),
    ("in_tangent", "tangents", "4f"),
    ("in_texcoord0", "texcoords0", "2f"),
    ("in_texcoord1", "texcoords1", "2f"),
    ("in_color", "colors", "4f"),
    ("in_prev_position", "prev_positions", "3f"),
)


KEPT_SUBSETS = 256
"""Lists of draws whose commands are kept: shadow faces see the same draws in most frames."""


@dataclass(frozen=True, slots=True)
class Group:
    """Consecutive commands that share every piece of state."""

    posed: bool
    material: int
    cull: bool
    mirrored: bool
    first: int
    count: int

    def joins(self, other: Group) -> bool:
        """Whether ``other`` follows and differs at most in the material."""
        same = (self.posed, self.cull, self.mirrored) == (other.posed, other.cull, other.mirrored)
        return same and self.first + self.count == other.first


class StoredGeometry:
    """Draws of a scene, with the vertices that no renderer changes on the GPU: all renderers of the scene share it."""

    def __init__(self, gpu: Gpu, scene: Scene):
        geometry = build_geometry(scene)
        self.scene, self.draws, self.posed = scene, geometry.draws, geometry.posed
        self.posed_vertices = geometry.posed_vertices
        self.fixed = _upload(gpu, geometry.fixed)
        self.bounds = DrawBounds(scene, geometry.draws)

    @classmethod
    def held(cls, gpu: Gpu, scene: Scene) -> Held[StoredGeometry]:
        """The geometry of ``scene``, which the caller releases."""
        mapped = tuple(None if m.normal_texture is None else m.normal_texture.texcoord for m in scene.materials)
        return gpu.shared.hold(scene.nodes, ("geometry", id(scene.meshes), mapped), lambda: cls(gpu, scene))

    def release(self) -> None:
        for buffer in self.fixed.values():
            buffer.release()


def _upload(gpu: Gpu, pool: Pool) -> dict[str, moderngl.Buffer]:
    out = {}
    for name in ("positions", "normals", "tangents", "texcoords0", "texcoords1", "colors", "indices"):
        array = np.ascontiguousarray(getattr(pool, name))
        out[name] = gpu.ctx.buffer(array) if array.nbytes else gpu.ctx.buffer(reserve=16)
    return out


class SceneBuffers:
    """Pools, the record table and draw commands.

    ``arrange`` regroups, only when visibility or handedness changes; ``show`` then chooses what the camera may see.
    """

    def __init__(self, gpu: Gpu, stored: StoredGeometry):
        self._gpu, self._draws = gpu, stored.draws
        ctx = gpu.ctx
        self.pools = {False: stored.fixed, True: _upload(gpu, stored.posed)}
        self.records = ctx.buffer(reserve=max(len(self._draws), 1) * RECORD.dtype.itemsize, dynamic=True)
        self._commands = ctx.buffer(reserve=max(len(self._draws), 1) * COMMAND.itemsize, dynamic=True)
        self.order = np.zeros(0, dtype=np.int64)  # visible draws as the commands count them
        self._written = np.zeros((0, RECORD.dtype.itemsize // 4), dtype=np.uint32)
        self._vaos: dict[tuple[bool, int, int], moderngl.VertexArray] = {}
        self._arranged: tuple[bytes, bytes] | None = None
        self._subsets: dict[bytes, tuple[Array, list[tuple[Group, int, int]]]] = {}  # of this arrangement
        self.groups: list[Group] = []
        self.seen_groups: list[Group] = []
        self.seen = np.zeros(0, dtype=bool)  # (D,) what ``show`` got
        self.alone = np.zeros(0, dtype=bool)  # (D,) which draws are all of their command
        self.shown: Array | None = None  # (commands,) bool: which the camera may see
        self.shown_triangles = 0  # of those commands, every instance counted
        self._table = np.array(
            [(d.index_count, 1, d.first_index, d.base_vertex, 0) for d in self._draws], dtype=COMMAND
        ).reshape(-1)
        self.triangles = triangles_of(self._table)  # (D,)

    def arrange(self, placement: Placement, materials: MaterialTable, *, culling: bool) -> None:
        """Sort visible draws, without those that repeat others, by state into groups and upload their commands."""
        state = (placement.visible.tobytes(), placement.mirrored.tobytes())
        if state == self._arranged:
            return
        self._arranged = state

        def key(i: int) -> tuple:
            d: Draw = self._draws[i]
            cull = culling and not materials.keys[d.material + 1].double_sided
            return d.posed, d.material, cull, bool(placement.mirrored[i]), d.base_vertex

        visible = sorted((i for i in np.flatnonzero(placement.visible).tolist() if not self._draws[i].repeats), key=key)
        commands = self._table[visible].copy()
        commands["base_instance"] = np.arange(len(visible))
        # Draws of the same primitive in a row become one instanced command.
        keep, self.groups = [], []
        owner = np.full(len(visible), -1)
        for position, i in enumerate(visible):
            k = key(i)
            if keep and k == key(visible[position - 1]) and not k[0]:
                commands["instances"][keep[-1]] += 1
                continue
            if not self.groups or k[:4] != self._group_key():
                self.groups.append(Group(*k[:4], first=len(keep), count=0))
            last = self.groups[-1]
            self.groups[-1] = Group(*k[:4], first=last.first, count=last.count + 1)
            keep.append(position)
            owner[position] = len(self.groups) - 1
        self._group_of = _fill_forward(owner)
        self._subsets.clear()
        self.order = np.array(visible, dtype=np.int64)
        self._command_of = np.cumsum(np.isin(np.arange(len(visible)), keep)) - 1
        self._whole = commands[keep]
        self.alone = np.zeros(len(self._draws), dtype=bool)
        self.alone[self.order] = self._whole["instances"][self._command_of] == 1
        self.shown = None

    def show(self, seen: Array) -> None:
        """Make the commands and ``seen_groups`` draw only what is in ``seen`` (D,) bool, in their order."""
        self.seen = seen
        shown = np.zeros(len(self._whole), dtype=bool)
        shown[self._command_of[seen[self.order]]] = True
        if self.shown is not None and np.array_equal(shown, self.shown):
            return
        self.shown = shown
        commands = self._whole.copy()
        commands["instances"][~shown] = 0
        self._triangles = triangles_of(commands)
        self.shown_triangles = int(self._triangles.sum())
        self.seen_groups = [g for g in self.groups if shown[g.first : g.first + g.count].any()]
        if len(commands):
            self._commands.write(commands.tobytes())

    def write_records(self, rows: Array) -> None:
        """Upload the RECORD rows (D,) of visible draws, in ``order``; only the range that has changed.

        Under a moving camera that is all of them (their matrices are relative to it), 112 bytes a draw.
        """
        words = rows[self.order].view(np.uint32).reshape(len(self.order), RECORD.dtype.itemsize // 4)
        stale = np.arange(len(words))
        if words.shape == self._written.shape:
            stale = np.flatnonzero((words != self._written).any(axis=1))
        if len(stale):
            first, stop = int(stale[0]), int(stale[-1]) + 1
            self.records.write(words[first:stop].tobytes(), offset=first * RECORD.dtype.itemsize)
            self._written = words

    def subset(self, seen: Array) -> tuple[Array, list[tuple[Group, int, int]]]:
        """Commands of those visible draws that are in ``seen`` (K,), and (group, first, count) runs within them."""
        key = seen.tobytes()
        if key not in self._subsets:
            if len(self._subsets) >= KEPT_SUBSETS:
                self._subsets.clear()
            self._subsets[key] = self._subset(seen)
        return self._subsets[key]

    def _subset(self, seen: Array) -> tuple[Array, list[tuple[Group, int, int]]]:
        positions = np.flatnonzero(np.isin(self.order, seen))
        commands = self._table[self.order[positions]]
        commands["base_instance"] = positions
        owner = self._group_of[positions]
        runs = []
        for g in np.unique(owner):
            at = np.flatnonzero(owner == g)
            runs.append((self.groups[g], int(at[0]), len(at)))
        return commands, runs

    def _group_key(self) -> tuple:
        g = self.groups[-1]
        return g.posed, g.material, g.cull, g.mirrored

    def draw(self, group: Group, program: moderngl.Program) -> None:
        """Issue the commands of one group with ``program`` (its state must be set)."""
        triangles = self._triangles[group.first : group.first + group.count]
        self.draw_commands(group, program, self._commands, group.first, triangles, self.records)

    def draw_commands(
        self,
        group: Group,
        program: moderngl.Program,
        commands: moderngl.Buffer,
        first: int,
        triangles: Array,
        records: moderngl.Buffer,
    ) -> None:
        """Issue the commands from ``first`` on, of so many ``triangles`` (N,), of a buffer made by ``subset``.

        All of them are of ``group``.  ``records``: RECORD rows of the draws in ``order``.
        """
        key = (group.posed, program.glo, records.glo)
        if key not in self._vaos:
            self._vaos[key] = self._vertex_array(self.pools[group.posed], program, records)
        for begin, end in self._gpu.portions(triangles):
            self._vaos[key].render_indirect(commands, self._gpu.ctx.TRIANGLES, end - begin, first + begin)

    def _vertex_array(
        self, pool: dict[str, moderngl.Buffer], program: moderngl.Program, records: moderngl.Buffer
    ) -> moderngl.VertexArray:
        content = [(pool[array], form, name) for name, array, form in _ATTRIBUTES if name in program]
        form, names = record_attributes(program)
        if names:  # a posed draw that writes no ids needs nothing of its record
            content.append((records, form, *names))
        return self._gpu.ctx.vertex_array(program, content, index_buffer=pool["indices"], index_element_size=4)

    @property
    def posed_buffers(self) -> Iterable[moderngl.Buffer]:
        """Vertex buffers that the deform pass writes."""
        return self.pools[True].values()

    @property
    def bytes(self) -> int:
        """GPU memory of the pools, bytes."""
        return sum(b.size for pool in self.pools.values() for b in pool.values())

    def release(self) -> None:
        for vao in self._vaos.values():
            vao.release()
        for buffer in (*self.pools[True].values(), self.records, self._commands):
            buffer.release()


def triangles_of(commands: Array) -> Array:
    """Triangles of COMMAND records, every instance counted.  (N,) int64."""
    return commands["count"].astype(np.int64) * commands["instances"] // 3


def record_attributes(names: Container[str]) -> tuple[str, list[str]]:
    """Layout of RECORD rows as per-instance attributes ``record_<field>``: those in ``names``, the rest skipped.

    llvmpipe fetches an instance's attributes once, what lies in a storage buffer once per vertex and lane.
    """
    used = [f"record_{field.name}" for field in RECORD.fields if f"record_{field.name}" in names]
    kinds = {"vec4": "4f", "uvec4": "4u"}
    parts = [kinds[field.type] if f"record_{field.name}" in used else "16x" for field in RECORD.fields]
    return " ".join(parts) + " /i", used


def _fill_forward(owner: Array) -> Array:
    """Merged draws belong to the group of the command they were merged into."""
    at = np.maximum.accumulate(np.where(owner >= 0, np.arange(len(owner)), 0))
    return owner[at] if len(owner) else owner
