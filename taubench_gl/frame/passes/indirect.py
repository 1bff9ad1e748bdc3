"""Indirect light, a ladder: ``rsm`` (virtual lights, no visibility) and ``probes`` (visibility, more bounces).

Both start from reflective shadow maps of the lights that have shadows.  Nothing is random: the same frame gives the
same result, and while lights and surfaces stand still only ``apply`` runs, whatever the camera does.
"""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np

from taubench_gl.animation import FrameState, View
from taubench_gl.channels import CHANNELS
from taubench_gl.frame.indirect_layout import (
    CHANNEL_NAMES,
    GRID,
    INDIRECT,
    SCALE,
    VIRTUAL,
    indirect_layout,
    rsm_resolution,
    visibility_bytes,
)
from taubench_gl.frame.lights import LIGHT
from taubench_gl.frame.materials import MaterialKey, MaterialTable, wanted_slots
from taubench_gl.frame.passes.faces import Casters, FaceDrawer, Program
from taubench_gl.frame.passes.gbuffer import GBufferPass, geometry_preamble
from taubench_gl.frame.passes.lighting import storage_defines
from taubench_gl.frame.scene_buffers import Group, SceneBuffers, variant
from taubench_gl.frame.shadow_faces import FACE, Face, faces_of, pack
from taubench_gl.frame.targets import Targets
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.metrics.lighting import MIN_LIGHT_DISTANCE
from taubench_gl.metrics.shading_rate import RATES, invocations, phase
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray

CHUNK = 60000 // (3 * GRID + 8) // 32 * 32
"""Virtual lights per dispatch: loop turns of one invocation stay below llvmpipe's silent limit of 65,535."""

BOUNCES = {"rsm": 1, "probes": 4}
"""Bounces after the first scattering: ``probes`` lets the virtual lights light each other three times more."""


class IndirectPass:
    """Writes ``indirect``.  ``box``: low and high corner (3,) of all geometry over the animation, world."""

    def __init__(
        self,
        gpu: Gpu,
        shaders: ShaderCache,
        scene: Scene,
        lights: list[int],
        bounds: tuple[Array, float],
        box: tuple[Array, Array],
        size: tuple[int, int],
        settings: Settings,
        colored_materials: frozenset[int],
        *,
        rate: str = "full",
        gather_each: bool = False,
    ):
        """``rate``: shade only part of the pixels; ``gather_each``: the rsm rung gathers at every pixel."""
        self._rate, self._gather_each = rate, gather_each
        self._gpu, self._shaders, self._scene, self._size = gpu, shaders, scene, size
        self._lights, self._bounds, self._colored = lights, bounds, colored_materials
        self._probes = settings.indirect == "probes"
        self._storage = storage_defines(settings)
        self._bounces = BOUNCES[settings.indirect]
        self._resolution = rsm_resolution(scene, lights, settings.indirect_samples)
        faces = faces_of(scene, None, lights, bounds, self._resolution)
        self._offsets, atlas = pack(faces)
        self._center = 0.5 * (box[0] + box[1])
        self._record = indirect_layout(box, size, settings)
        ctx = gpu.ctx
        self._depth = gpu.depth_texture(atlas)
        self._atlas = Targets(gpu, atlas, CHANNEL_NAMES, self._depth)
        self._gbuffer = GBufferPass(gpu, shaders, CHANNEL_NAMES, colored_materials)
        self._drawer = FaceDrawer(gpu)
        texels = _texel_table(faces, self._offsets)
        self.count = len(texels)
        self._record["counts"][0] = self.count
        self._texels = ctx.buffer(texels.tobytes())
        self._rows = FACE.zeros(len(faces))
        self._faces = ctx.buffer(reserve=self._rows.nbytes, dynamic=True)
        self._light_rows = ctx.buffer(reserve=LIGHT.dtype.itemsize * max(len(scene.light_nodes), 1), dynamic=True)
        self._virtual = [ctx.buffer(reserve=VIRTUAL.dtype.itemsize * self.count) for _ in range(2)]
        self._parameters = ctx.buffer(reserve=INDIRECT.dtype.itemsize, dynamic=True)
        self._solved: bytes | None = None
        self._occupancy: bytes | None = None
        self._make_programs()
        self._make_rung()

    def _make_programs(self) -> None:
        self._group = (32, 1) if self._gpu.software else (8, 8)
        preamble = "\n".join(
            (
                INDIRECT.glsl,
                VIRTUAL.glsl,
                LIGHT.glsl,
                FACE.glsl,
                f"const int GRID = {GRID};",
                f"const int SCALE = {SCALE};",
            )
        )
        preamble += f"\nconst float MIN_LIGHT_DISTANCE = {MIN_LIGHT_DISTANCE};"
        group = {"GROUP_X": self._group[0], "GROUP_Y": self._group[1]}
        compute = self._shaders.compute
        self._make_virtual = compute("indirect/vpl.comp.glsl", {}, preamble)
        defines = {"PROBES": self._probes, "GATHER_EACH": self._gather_each, "SHADING_RATE": RATES.index(self._rate)}
        self._apply = compute("indirect/apply.comp.glsl", {**defines, **group, **self._storage}, preamble)
        if self._probes:
            # What a probe sees is the same for every bounce: found once, remembered in bits.
            self._light_probes = [
                compute("indirect/probes.comp.glsl", {"FIRST_BOUNCE": first}, preamble) for first in (True, False)
            ]
            self._bounce = compute("indirect/bounce.comp.glsl", {}, preamble)
            self._voxel_preamble = geometry_preamble() + "\n" + preamble
        else:
            self._gather = compute("indirect/gather.comp.glsl", group, preamble)

    def _make_rung(self) -> None:
        ctx = self._gpu.ctx
        self._owned: list = []
        if self._probes:
            self._probe_count = int(np.prod(self._record["probe_counts"][:3]))
            self._probe_buffer = ctx.buffer(reserve=6 * 16 * self._probe_count)
            self._voxels = ctx.buffer(reserve=GRID**3 // 8)
            self._visibility = ctx.buffer(reserve=visibility_bytes(self._probe_count, self.count))
            self._voxel_depth = ctx.depth_texture((2 * GRID, 2 * GRID))
            self._voxel_target = ctx.framebuffer(depth_attachment=self._voxel_depth)
            self._owned = [self._probe_buffer, self._voxels, self._visibility, self._voxel_depth, self._voxel_target]
        else:
            self._irradiance = ctx.texture(tuple(int(n) for n in self._record["size"][2:]), 4, dtype="f4")
            self._owned = [self._irradiance]

    @property
    def bytes(self) -> int:
        """GPU memory, bytes."""
        width, height = self._atlas.size
        texel = 4 + sum(CHANNELS[n].components * int(CHANNELS[n].dtype[1]) for n in CHANNEL_NAMES)
        own = 2 * self._virtual[0].size + width * height * texel
        if self._probes:
            return own + self._probe_buffer.size + self._voxels.size + self._visibility.size
        return own + 16 * self._irradiance.width * self._irradiance.height

    def run(
        self,
        state: FrameState,
        view: View,
        light_rows: Array,
        scene: SceneBuffers,
        materials: MaterialTable,
        casters: Casters,
        textures: Mapping[str, moderngl.Texture],
        frame: int = 0,
        *,
        write: bool = True,
    ) -> None:
        """Write ``indirect`` of the frame in ``textures``; not ``write``: only find its virtual lights."""
        self._record["counts"][1] = phase(self._rate, frame)
        self._record["scene_from_relative"][:3] = view.position - self._center
        self._parameters.write(self._record.tobytes())
        faces = faces_of(self._scene, state, self._lights, self._bounds, self._resolution)
        lit = light_rows["color"][self._lights, :3].tobytes()
        key = casters.key() + lit + b"".join(face.key for face in faces)
        if key != self._solved:
            self._solved = key
            self._solve(faces, view, light_rows, scene, materials, casters)
        if write:
            self._write(textures)

    def _solve(
        self,
        faces: list[Face],
        view: View,
        light_rows: Array,
        scene: SceneBuffers,
        materials: MaterialTable,
        casters: Casters,
    ) -> None:
        """Virtual lights of this moment, and with ``probes`` what they give every probe."""
        stale = [(f, o, casters.seen_by(f)[0]) for f, o in zip(faces, self._offsets, strict=True)]
        self._drawer.draw(stale, self._atlas.framebuffer, view, scene, materials, lambda g: self._program(g, materials))
        for row, face in zip(self._rows, faces, strict=True):
            row["origin"] = (*(face.origin - view.position), float(face.parallel))
            row["forward"] = (*face.forward, face.near)
            row["extent"][:2] = face.resolution, 2.0 * face.half / face.resolution
        self._faces.write(self._rows.tobytes())
        self._light_rows.write(light_rows.tobytes())
        self._parameters.bind_to_storage_buffer(0)
        self._light_rows.bind_to_storage_buffer(1)
        self._virtual[0].bind_to_storage_buffer(2)
        self._texels.bind_to_storage_buffer(3)
        self._faces.bind_to_storage_buffer(5)
        self._bind(self._make_virtual, self._atlas.textures, CHANNEL_NAMES)
        self._dispatch(self._make_virtual, self.count, 64)
        if not self._probes:
            return
        if casters.key() != self._occupancy:
            self._occupancy = casters.key()
            self._voxelize(view, scene, materials, casters)
        for bounce in range(self._bounces):
            source = self._virtual[0 if bounce == 0 else 1]
            self._parameters.bind_to_storage_buffer(0)
            self._voxels.bind_to_storage_buffer(4)
            self._probe_buffer.bind_to_storage_buffer(6)
            source.bind_to_storage_buffer(2)
            self._visibility.bind_to_storage_buffer(7)
            program = self._light_probes[min(bounce, 1)]
            for first in range(0, self.count, CHUNK):
                program["chunk"] = first, min(first + CHUNK, self.count)
                self._dispatch(program, self._probe_count, 16)
            if bounce + 1 < self._bounces:
                self._gpu.ctx.copy_buffer(self._virtual[1], self._virtual[0])
                self._virtual[1].bind_to_storage_buffer(2)
                self._virtual[0].bind_to_storage_buffer(7)
                self._dispatch(self._bounce, self.count, 64)

    def _voxelize(self, view: View, scene: SceneBuffers, materials: MaterialTable, casters: Casters) -> None:
        """Mark every voxel that a surface passes through, seen along three axes so that none is missed edge-on."""
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
        self._voxels.clear()
        self._parameters.bind_to_storage_buffer(3)
        self._voxels.bind_to_storage_buffer(4)
        stale = [(face, (0, 0), seen) for face in faces]
        self._drawer.draw(
            stale, self._voxel_target, view, scene, materials, lambda g: self._voxel_program(g), depth_test=False
        )
        self._gpu.ctx.memory_barrier()

    def _write(self, textures: Mapping[str, moderngl.Texture]) -> None:
        self._parameters.bind_to_storage_buffer(0)
        columns, rows = invocations(self._rate, self._size)
        tiles = -(-columns // self._group[0]), -(-rows // self._group[1])
        inputs = ("position", "normal", "base_color", "material")
        if self._probes:
            self._probe_buffer.bind_to_storage_buffer(6)
        else:
            self._virtual[0].bind_to_storage_buffer(2)
            if not self._gather_each:
                self._gather_coarsely(textures)
                self._irradiance.use(len(inputs))
                self._apply["irradiance"] = len(inputs)
        self._bind(self._apply, textures, inputs)
        textures["indirect"].bind_to_image(0, read=False, write=True)
        self._apply.run(*tiles)
        self._gpu.ctx.memory_barrier()

    def _gather_coarsely(self, textures: Mapping[str, moderngl.Texture]) -> None:
        self._bind(self._gather, textures, ("position", "normal"))
        self._irradiance.bind_to_image(0, read=False, write=True)
        small = self._irradiance.size
        self._gather.run(-(-small[0] // self._group[0]), -(-small[1] // self._group[1]))
        self._gpu.ctx.memory_barrier()

    def _bind(self, program, textures: Mapping[str, moderngl.Texture], names: tuple[str, ...]) -> None:
        for unit, name in enumerate(names):
            textures[name].use(unit)
            if name in program:
                program[name] = unit

    def _dispatch(self, program, items: int, group: int) -> None:
        program.run(-(-items // group))
        self._gpu.ctx.memory_barrier()

    def _program(self, group: Group, materials: MaterialTable) -> Program:
        material = materials.material(group.material)
        slots = wanted_slots(CHANNEL_NAMES, material)
        known = tuple(s for s in slots if s in materials.keys[group.material + 1].slots)
        return Program(self._gbuffer.program(group, materials), known)

    def _voxel_program(self, group: Group) -> Program:
        defines = variant(MaterialKey((), False, True), group.posed, (), False)
        program = self._shaders.render(
            "gbuffer/gbuffer.vert.glsl", "indirect/voxelize.frag.glsl", defines, self._voxel_preamble
        )
        return Program(program, ())

    @property
    def virtual_buffer(self) -> moderngl.Buffer:
        """``count`` VIRTUAL records of this frame."""
        return self._virtual[0]

    @property
    def scene_from_relative(self) -> Array:
        """(3,) what to add to a position relative to this frame's camera, metres."""
        return self._record["scene_from_relative"][:3]

    def virtual_lights(self) -> Array:
        """This frame's virtual lights, (V,) VIRTUAL records in scene space."""
        return np.frombuffer(self._virtual[0].read(), dtype=VIRTUAL.dtype)

    def release(self) -> None:
        for item in (
            self._atlas,
            self._depth,
            self._drawer,
            self._gbuffer,
            self._texels,
            self._faces,
            self._light_rows,
        ):
            item.release()
        for item in (*self._virtual, self._parameters, *self._owned):
            item.release()


def _texel_table(faces: list[Face], offsets: list[tuple[int, int]]) -> Array:
    """(V, 4) uint32: atlas x and y, face, light row of every texel."""
    parts = []
    for i, (face, (x, y)) in enumerate(zip(faces, offsets, strict=True)):
        at = np.stack(np.meshgrid(np.arange(face.resolution), np.arange(face.resolution)), axis=-1).reshape(-1, 2)
        tail = np.broadcast_to([i, face.light], (len(at), 2))
        parts.append(np.concatenate([at + [x, y], tail], axis=1))
    return np.concatenate(parts).astype(np.uint32)
