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
    VIRTUAL_ROW,
    indirect_layout,
    rsm_resolution,
    virtual_size,
)
from taubench_gl.frame.lights import LIGHT, LIGHT_ROW, LightTexture
from taubench_gl.frame.materials import MaterialTable, wanted_slots
from taubench_gl.frame.passes.faces import Casters, FaceDrawer, Program
from taubench_gl.frame.passes.gbuffer import GBufferPass
from taubench_gl.frame.passes.lighting import storage_defines
from taubench_gl.frame.passes.probes import WIDE, ProbeGrid, bind, float_texture, texture_bytes
from taubench_gl.frame.scene_buffers import Group, SceneBuffers
from taubench_gl.frame.shadow_faces import FACE, Face, faces_of, pack
from taubench_gl.frame.targets import Targets
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.metrics.lighting import MIN_LIGHT_DISTANCE
from taubench_gl.metrics.shading_rate import RATES, invocations, phase
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray


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
        glossy: bool = True,
    ):
        """``rate``: shade only part of the pixels; ``gather_each``: the rsm rung gathers at every pixel;
        ``glossy``: some material has a glossy lobe."""
        self._rate, self._gather_each, self._glossy = rate, gather_each, glossy
        self._gpu, self._shaders, self._scene, self._size = gpu, shaders, scene, size
        self._lights, self._bounds, self._colored = lights, bounds, colored_materials
        self._probes = settings.indirect == "probes"
        self._storage = storage_defines(settings)
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
        self._record["counts"][0], self._record["counts"][2] = self.count, len(faces)
        self._texels = ctx.buffer(texels.tobytes())
        self._rows = FACE.zeros(len(faces))
        self._faces = ctx.buffer(reserve=self._rows.nbytes, dynamic=True)
        self._light_table = LightTexture(gpu, len(scene.light_nodes))
        self._virtual = float_texture(gpu, virtual_size(self.count))
        self._parameters = ctx.buffer(reserve=INDIRECT.dtype.itemsize, dynamic=True)
        self._solved: bytes | None = None
        self._make_programs()

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
                f"const int VIRTUAL_ROW = {VIRTUAL_ROW};",
                f"const int LIGHT_ROW = {LIGHT_ROW};",
            )
        )
        preamble += f"\nconst float MIN_LIGHT_DISTANCE = {MIN_LIGHT_DISTANCE};"
        group = {"GROUP_X": self._group[0], "GROUP_Y": self._group[1]}
        compute = self._shaders.compute
        self._make_virtual = compute("indirect/vpl.comp.glsl", {"GROUP_X": WIDE, "PROBES": self._probes}, preamble)
        defines = {"PROBES": self._probes, "GATHER_EACH": self._gather_each, "GLOSSY": self._glossy}
        defines["SHADING_RATE"] = RATES.index(self._rate)
        self._apply = compute("indirect/apply.comp.glsl", {**defines, **group, **self._storage}, preamble)
        if self._probes:
            self._grid = ProbeGrid(self._gpu, self._shaders, self._record, self._center, self.count, preamble)
        else:
            self._gather = compute("indirect/gather.comp.glsl", group, preamble)
            self._irradiance = float_texture(self._gpu, tuple(int(n) for n in self._record["size"][2:]))

    @property
    def bytes(self) -> int:
        """GPU memory, bytes."""
        width, height = self._atlas.size
        texel = 4 + sum(CHANNELS[n].components * int(CHANNELS[n].dtype[1]) for n in CHANNEL_NAMES)
        own = texture_bytes(self._virtual) + width * height * texel
        return own + (self._grid.bytes if self._probes else texture_bytes(self._irradiance))

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
        # A light that is off has no virtual lights: its faces are cleared.
        on = np.any(light_rows["color"][:, :3] != 0.0, axis=1)
        nothing = np.zeros(0, dtype=np.int64)
        seen = [casters.seen_by(face)[0] if on[face.light] else nothing for face in faces]
        stale = list(zip(faces, self._offsets, seen, strict=True))
        self._drawer.draw(stale, self._atlas.framebuffer, view, scene, materials, lambda g: self._program(g, materials))
        for row, face in zip(self._rows, faces, strict=True):
            row["origin"] = (*(face.origin - view.position), float(face.parallel))
            row["forward"] = (*face.forward, face.near)
            row["right"][:3], row["up"][:3] = face.right / face.half, face.up / face.half
            texel = 2.0 * face.half / face.resolution
            row["extent"] = face.resolution, texel, float(on[face.light]), face.light
        self._faces.write(self._rows.tobytes())
        self._light_table.write(light_rows)
        if self._probes:
            self._grid.fill(view, scene, materials, casters, self._drawer, self._parameters)
        self._parameters.bind_to_uniform_block(0)
        self._virtual.bind_to_image(0, read=False, write=True)
        self._texels.bind_to_storage_buffer(3)
        self._faces.bind_to_storage_buffer(5)
        sampled = {name: self._atlas.textures[name] for name in CHANNEL_NAMES}
        sampled["light_table"] = self._light_table.texture
        if self._probes:
            sampled["voxels"] = self._grid.voxels
        bind(self._make_virtual, sampled)
        self._make_virtual.run(-(-self.count // WIDE))
        self._gpu.ctx.memory_barrier()
        if self._probes:
            self._grid.light(self._virtual, self._parameters)

    def _write(self, textures: Mapping[str, moderngl.Texture]) -> None:
        self._parameters.bind_to_uniform_block(0)
        columns, rows = invocations(self._rate, self._size)
        tiles = -(-columns // self._group[0]), -(-rows // self._group[1])
        sampled = {name: textures[name] for name in CHANNEL_NAMES}
        if self._probes:
            sampled["probes"] = self._grid.probes
        else:
            sampled["virtual_lights"] = self._virtual
            if not self._gather_each:
                self._gather_coarsely(textures)
                sampled["irradiance"] = self._irradiance
        bind(self._apply, sampled)
        textures["indirect"].bind_to_image(0, read=False, write=True)
        self._apply.run(*tiles)
        self._gpu.ctx.memory_barrier()

    def _gather_coarsely(self, textures: Mapping[str, moderngl.Texture]) -> None:
        sampled = {"position": textures["position"], "normal": textures["normal"], "virtual_lights": self._virtual}
        bind(self._gather, sampled)
        self._irradiance.bind_to_image(0, read=False, write=True)
        small = self._irradiance.size
        self._gather.run(-(-small[0] // self._group[0]), -(-small[1] // self._group[1]))
        self._gpu.ctx.memory_barrier()

    def _program(self, group: Group, materials: MaterialTable) -> Program:
        material = materials.material(group.material)
        slots = wanted_slots(CHANNEL_NAMES, material)
        known = tuple(s for s in slots if s in materials.keys[group.material + 1].slots)
        return Program(self._gbuffer.program(group, materials), known)

    @property
    def virtual_texture(self) -> moderngl.Texture:
        """``count`` VIRTUAL records of this frame, a texel for each field, VIRTUAL_ROW of them in a row."""
        return self._virtual

    @property
    def scene_from_relative(self) -> Array:
        """(3,) what to add to a position relative to this frame's camera, metres."""
        return self._record["scene_from_relative"][:3]

    def virtual_lights(self) -> Array:
        """This frame's virtual lights, (V,) VIRTUAL records in scene space."""
        return np.frombuffer(self._virtual.read(), dtype=VIRTUAL.dtype)[: self.count]

    def release(self) -> None:
        for item in (
            self._atlas,
            self._depth,
            self._drawer,
            self._gbuffer,
            self._texels,
            self._faces,
            self._light_table,
            self._virtual,
            self._parameters,
            self._grid if self._probes else self._irradiance,
        ):
            item.release()


def _texel_table(faces: list[Face], offsets: list[tuple[int, int]]) -> Array:
    """(V, 4) uint32: atlas x and y, face, light row of every texel."""
    parts = []
    for i, (face, (x, y)) in enumerate(zip(faces, offsets, strict=True)):
        at = np.stack(np.meshgrid(np.arange(face.resolution), np.arange(face.resolution)), axis=-1).reshape(-1, 2)
        tail = np.broadcast_to([i, face.light], (len(at), 2))
        parts.append(np.concatenate([at + [x, y], tail], axis=1))
    return np.concatenate(parts).astype(np.uint32)
