"""The probes of indirect light: an occupancy grid, what each probe sees of the virtual lights, and their bounces."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.frame.indirect_layout import GRID, VIRTUAL, probe_size, virtual_size, visibility_bytes
from taubench_gl.frame.materials import MaterialKey, MaterialTable
from taubench_gl.frame.passes.faces import Casters, FaceDrawer, Program
from taubench_gl.frame.passes.gbuffer import geometry_preamble
from taubench_gl.frame.scene_buffers import Group, SceneBuffers, variant
from taubench_gl.frame.shadow_faces import Face
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache

Array = np.ndarray

WIDE, NARROW = 64, 16
"""Work group sizes: of what has little to do for each virtual light, and of what has much for each probe."""

CHUNK = 60000 // 8 // 32 * 32
"""Virtual lights per dispatch: loop turns of one invocation stay below llvmpipe's silent limit of 65,535."""

BOUNCES = 4
"""Bounces after the first scattering: the virtual lights light each other three times more."""


class ProbeGrid:
    """A grid of ambient-cube probes in scene space (``indirect_layout.INDIRECT``)."""

    def __init__(self, gpu: Gpu, shaders: ShaderCache, record: Array, center: Array, virtual_count: int, preamble: str):
        """``record``: an INDIRECT record; ``center`` (3,): origin of scene space, world; ``preamble``: its GLSL."""
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
        # Fragments set bits of a buffer; rays read a texture, which is faster (common/indirect.glsl).
        self._bits = ctx.buffer(reserve=GRID**3 // 8)
        self.voxels = ctx.texture((GRID // 32, GRID**2), 1, dtype="u4")
        self._visibility = ctx.buffer(reserve=visibility_bytes(self._count, virtual_count))
        self._depth = ctx.depth_texture((2 * GRID, 2 * GRID))
        self._target = ctx.framebuffer(depth_attachment=self._depth)
        self._occupancy: bytes | None = None

    @property
    def bytes(self) -> int:
        """GPU memory, bytes."""
        textures = sum(texture_bytes(t) for t in (self.probes, self._flux))
        return textures + 2 * self._bits.size + self._visibility.size

    def fill(
        self,
        view: View,
        scene: SceneBuffers,
        materials: MaterialTable,
        casters: Casters,
        drawer: FaceDrawer,
        parameters: moderngl.Buffer,
    ) -> None:
        """Mark every voxel that a surface passes through, seen along three axes so that none is missed edge-on."""
        key = casters.key()
        if key == self._occupancy:
            return
        self._occupancy = key
        origin, voxel = self._record["grid_origin"][:3].astype(np.float64), float(self._record["grid_origin"][3])
        half = 0.5 * GRID * voxel
        middle = self._center + origin + half
        axes = np.eye(3)
        seen = np.flatnonzero(casters.visible)
        faces = []
        for k in range(3):
            forward, up = axes[k], axes[(k + 1) % 3]
            start = middle - forward * half
            faces.append(Face(0, True, start, np.cross(forward, up), up, forward, half, 2.0 * half, 2 * GRID))
        self._bits.clear()
        parameters.bind_to_uniform_block(3)
        self._bits.bind_to_storage_buffer(4)
        stale = [(face, (0, 0), seen) for face in faces]
        drawer.draw(stale, self._target, view, scene, materials, self._voxel_program, depth_test=False)
        self._gpu.ctx.memory_barrier()
        self.voxels.write(self._bits)

    def light(self, virtual_lights: moderngl.Texture, parameters: moderngl.Buffer) -> None:
        """Find what every probe sees of the virtual lights, then let light bounce.  ``fill`` must be up to date."""
        parameters.bind_to_uniform_block(0)
        self._visibility.bind_to_storage_buffer(7)
        sampled = {"virtual_lights": virtual_lights, "voxels": self.voxels}
        bind(self._sight, sampled)
        self._dispatch(self._sight, self._count, NARROW, -(-self._virtual_count // 32))
        sampled["flux"] = self._flux
        received = {"virtual_lights": virtual_lights, "probes": self.probes}
        for bounce in range(BOUNCES):
            if bounce > 0:
                bind(self._bounce, received)
                self._flux.bind_to_image(0, read=False, write=True)
                self._dispatch(self._bounce, self._virtual_count, WIDE)
            program = self._receive[min(bounce, 1)]
            bind(program, sampled)
            self.probes.bind_to_image(0, read=True, write=True)
            for first in range(0, self._virtual_count, CHUNK):
                program["chunk"] = first, min(first + CHUNK, self._virtual_count)
                self._dispatch(program, self._count, NARROW)

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
        for item in (self.probes, self._flux, self._bits, self.voxels, self._visibility, self._target, self._depth):
            item.release()


def float_texture(gpu: Gpu, size: tuple[int, int]) -> moderngl.Texture:
    """Four floats a texel."""
    return gpu.ctx.texture(size, 4, dtype="f4")


def texture_bytes(texture: moderngl.Texture) -> int:
    """Of a texture of four floats a texel."""
    return 16 * texture.width * texture.height


def bind(program: moderngl.ComputeShader, textures: Mapping[str, moderngl.Texture]) -> None:
    """Give each texture a unit, and the samplers that ``program`` has by their names."""
    for unit, (name, texture) in enumerate(textures.items()):
        texture.use(unit)
        if name in program:
            program[name] = unit
