"""The probes of indirect light: an occupancy grid, what each probe sees of the virtual lights, and their bounces."""

from __future__ import annotations

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.indirect_layout import (
    BRICKS,
    GRID,
    VIRTUAL,
    fixed_draws,
    probe_size,
    virtual_size,
    visibility_bytes,
)
from taubench_gl.frame.materials import MaterialKey, MaterialTable
from taubench_gl.frame.passes.faces import AnchoredRecords, Casters, FaceDrawer, Program
from taubench_gl.frame.passes.gbuffer import geometry_preamble
from taubench_gl.frame.passes.images import bind_images, float_texture, texture_bytes
from taubench_gl.frame.records import Placement
from taubench_gl.frame.scene_buffers import Group, SceneBuffers, variant
from taubench_gl.frame.shadow_faces import Face
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.scene.model import Scene

Array = np.ndarray

WIDE, NARROW = 64, 16
"""Work group sizes: of what has little to do for each virtual light, and of what has much for each probe."""

CHUNK = 60000 // 8 // 32 * 32
"""Virtual lights per dispatch: loop turns of one invocation stay below llvmpipe's silent limit of 65,535."""

BOUNCES = 4
"""Bounces after the first scattering: the virtual lights light each other three times more."""


class ProbeGrid:
    """A grid of ambient-cube probes in scene space (``indirect_layout.INDIRECT``)."""

    def __init__(
        self,
        gpu: Gpu,
        shaders: ShaderCache,
        record: Array,
        center: Array,
        virtual_count: int,
        preamble: str,
        scene: Scene,
        draws: tuple[Draw, ...],
    ):
        """``record``: an INDIRECT record; ``center`` (3,): origin of scene space, world; ``preamble``: its GLSL;
        ``draws``: of ``scene``, in the order of their casters."""
        self._gpu, self._shaders, self._record, self._center = gpu, shaders, record, center
        self._virtual_count = virtual_count
        self._count = int(np.prod(record["probe_counts"][:3]))
        compute, ctx = shaders.compute, gpu.ctx
        # What a probe sees is the same for every bounce: found once, remembered in bits.
        self._sight = compute("indirect/sight.comp.glsl", {"GROUP_X": NARROW}, preamble)
        self._receive = [
            compute("indirect/probes.comp.glsl", {"GROUP_X": NARROW, "FIRST_BOUNCE": first}, preamble)
            for first in (True, False)
        ]
        self._bounce = compute("indirect/bounce.comp.glsl", {"GROUP_X": WIDE}, preamble)
        self._voxel_preamble = geometry_preamble() + "\n" + preamble
        self.probes = float_texture(gpu, probe_size(record))
        columns, rows = virtual_size(virtual_count)
        self._flux = float_texture(gpu, (columns // len(VIRTUAL.fields), rows))
        # Fragments set bits of a buffer; rays read bricks of them from an image (common/voxels.glsl).
        self._bits = [ctx.buffer(reserve=GRID**3 // 8) for _ in range(2)]  # of what no animation moves, and of the rest
        self._drawn: list[bytes | None] = [None, None]
        self._fixed = fixed_draws(scene, draws)
        self._anchor = AnchoredRecords(gpu, draws, center)
        self.bricks = ctx.texture((BRICKS, BRICKS**2), 4, dtype="u4")
        self._rows = ctx.texture((BRICKS, BRICKS), 1, dtype="u4")
        self._arrange = [
            compute("indirect/bricks.comp.glsl", {"GROUP_X": NARROW, "DISTANCES": after}, preamble)
            for after in (False, True)
        ]
        self._visibility = ctx.buffer(reserve=visibility_bytes(self._count, virtual_count))
        self._depth = ctx.depth_texture((2 * GRID, 2 * GRID))
        self._target = ctx.framebuffer(depth_attachment=self._depth)

    @property
    def bytes(self) -> int:
        """GPU memory, bytes."""
        textures = sum(texture_bytes(t) for t in (self.probes, self._flux))
        return textures + 2 * self._bits[0].size + 16 * BRICKS**3 + 4 * BRICKS**2 + self._visibility.size

    def fill(
        self,
        view: View,
        scene: SceneBuffers,
        materials: MaterialTable,
        casters: Casters,
        placement: Placement,
        drawer: FaceDrawer,
        parameters: moderngl.Buffer,
    ) -> None:
        """Mark every voxel that a surface passes through.  What no animation moves keeps its marks."""
        parameters.bind_to_uniform_block(3)
        self._anchor.update(placement, scene.order)
        stale = False
        for k, seen in enumerate((casters.visible & self._fixed, casters.visible & ~self._fixed)):
            key = seen.tobytes() + casters.versions[seen].tobytes()
            if key == self._drawn[k]:
                continue
            self._drawn[k], stale = key, True
            self._bits[k].clear()
            self._bits[k].bind_to_storage_buffer(4)
            self._mark(np.flatnonzero(seen), view, scene, materials, drawer)
        if stale:
            self._pack()

    def _mark(self, seen: Array, view: View, scene: SceneBuffers, materials: MaterialTable, drawer: FaceDrawer) -> None:
        """Draw ``seen`` into the bound grid along three axes, so that no surface is missed edge-on."""
        if not len(seen):
            return
        origin, voxel = self._record["grid_origin"][:3].astype(np.float64), float(self._record["grid_origin"][3])
        half = 0.5 * GRID * voxel
        middle = self._center + origin + half
        axes = np.eye(3)
        faces = []
        for k in range(3):
            forward, up = axes[k], axes[(k + 1) % 3]
            start = middle - forward * half
            faces.append(Face(0, True, start, np.cross(forward, up), up, forward, half, 2.0 * half, 2 * GRID))
        stale = [(face, (0, 0), seen) for face in faces]
        program = self._voxel_program
        drawer.draw(stale, self._target, view, scene, materials, program, depth_test=False, anchor=self._anchor)
        self._gpu.ctx.memory_barrier()

    def _pack(self) -> None:
        """Bits to bricks."""
        self._bits[0].bind_to_storage_buffer(4)
        self._bits[1].bind_to_storage_buffer(6)
        bind_images(bricks=self.bricks, rows=self._rows)
        for program in self._arrange:
            self._dispatch(program, BRICKS**2, NARROW)

    def light(self, virtual_lights: moderngl.Texture, parameters: moderngl.Buffer) -> None:
        """Find what every probe sees of the virtual lights, then let light bounce.  ``fill`` must be up to date."""
        parameters.bind_to_uniform_block(0)
        self._visibility.bind_to_storage_buffer(7)
        bind_images(virtual_lights=virtual_lights, bricks=self.bricks, probes=self.probes, flux=self._flux)
        self._dispatch(self._sight, self._count, NARROW, -(-self._virtual_count // 32))
        for bounce in range(BOUNCES):
            if bounce > 0:
                self._dispatch(self._bounce, self._virtual_count, WIDE)
            program = self._receive[min(bounce, 1)]
            for first in range(0, self._virtual_count, CHUNK):
                program["chunk"] = first, min(first + CHUNK, self._virtual_count)
                self._dispatch(program, self._count, NARROW)

    def occupancy(self) -> Array:
        """Which voxels hold a surface, (GRID, GRID, GRID) bool by z, y, x, as drawn."""
        bits = np.bitwise_or(*(np.frombuffer(b.read(), np.uint8) for b in self._bits))
        return np.unpackbits(bits, bitorder="little").reshape(GRID, GRID, GRID).astype(bool)

    def visibility(self) -> Array:
        """Which virtual lights each probe sees, (probes, virtual lights) bool."""
        words = np.frombuffer(self._visibility.read(), np.uint8).reshape(self._count, -1)
        return np.unpackbits(words, axis=1, bitorder="little")[:, : self._virtual_count].astype(bool)

    def _dispatch(self, program: moderngl.ComputeShader, items: int, group: int, rows: int = 1) -> None:
        program.run(-(-items // group), rows)
        self._gpu.ctx.memory_barrier()

    def _voxel_program(self, group: Group) -> Program:
        defines = variant(MaterialKey((), False, True), group.posed, (), False)
        program = self._shaders.render(
            "gbuffer/gbuffer.vert.glsl", "indirect/voxelize.frag.glsl", defines, self._voxel_preamble
        )
        return Program(program, ())

    def release(self) -> None:
        textures = (self.probes, self._flux, self.bricks, self._rows, self._depth)
        for item in (*textures, *self._bits, self._visibility, self._target, self._anchor):
            item.release()
