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
from taubench_gl.errors import GraphicsError
from taubench_gl.frame.geometry import Draw
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
    visibility_bytes,
)
from taubench_gl.frame.lights import LIGHT, LIGHT_ROW, LightTexture
from taubench_gl.frame.materials import MaterialTable, wanted_slots
from taubench_gl.frame.passes.faces import Casters, FaceDrawer, Program
from taubench_gl.frame.passes.gbuffer import GBufferPass
from taubench_gl.frame.passes.images import (
    bind,
    bind_channels,
    bind_images,
    channel_images,
    float_texture,
    texture_bytes,
)
from taubench_gl.frame.passes.lighting import storage_defines
from taubench_gl.frame.passes.probes import WIDE, ProbeGrid
from taubench_gl.frame.records import Placement
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


CHANNEL_UNIT = 4
"""Image binding of the first of CHANNEL_NAMES where pixels are shaded."""


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
        draws: tuple[Draw, ...],
    ):
        """``rate``: shade only part of the pixels; ``gather_each``: the rsm rung gathers at every pixel;
        ``glossy``: some material has a glossy lobe; ``draws``: of ``scene``, in the order of their casters.

        Raises GraphicsError where the virtual lights need a larger texture or buffer than the device has.
        """
        self._rate, self._gather_each, self._glossy = rate, gather_each, glossy
        self._gpu, self._shaders, self._scene, self._size = gpu, shaders, scene, size
        self._lights, self._bounds, self._colored = lights, bounds, colored_materials
        self._probes = settings.lighting.indirect == "probes"
        self._storage = storage_defines(settings)
        self._channels = "\n" + channel_images(CHANNEL_NAMES, CHANNEL_UNIT, settings)
        self._resolution = rsm_resolution(scene, lights, settings.lighting.indirect_samples)
        faces = faces_of(scene, None, lights, bounds, self._resolution)
        self._offsets, atlas = pack(faces)
        self._center = 0.5 * (box[0] + box[1])
        self._record = indirect_layout(box, size, settings)
        count = sum(f.resolution**2 for f in faces)
        _require_room(gpu, count, len(faces), atlas, self._record, settings)
        ctx = gpu.ctx
        self._depth = gpu.depth_texture(atlas)
        self._atlas = Targets(gpu, atlas, CHANNEL_NAMES, self._depth)
        self._gbuffer = GBufferPass(gpu, shaders, CHANNEL_NAMES, colored_materials)
        self._drawer = FaceDrawer(gpu)
        texels = _texel_table(faces, self._offsets)
        self.count = count
        self._record["counts"][0], self._record["counts"][2] = self.count, len(faces)
        self._texels = ctx.buffer(texels.tobytes())
        self._rows = FACE.zeros(len(faces))
        self._faces = ctx.buffer(reserve=self._rows.nbytes, dynamic=True)
        self._light_table = LightTexture(gpu, len(scene.light_nodes))
        self._virtual = float_texture(gpu, virtual_size(self.count))
        self._parameters = ctx.buffer(reserve=INDIRECT.dtype.itemsize, dynamic=True)
        self._solved: bytes | None = None
        self._make_programs(draws)

    def _make_programs(self, draws: tuple[Draw, ...]) -> None:
        self._group = (64, 1) if self._gpu.software else (8, 8)
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
        pixels = preamble + self._channels
        self._apply = compute("indirect/apply.comp.glsl", {**defines, **group, **self._storage}, pixels)
        if self._probes:
            record, center = self._record, self._center
            shaders, scene = self._shaders, self._scene
            self.grid = ProbeGrid(self._gpu, shaders, record, center, self.count, preamble, scene, draws)
        else:
            self._gather = compute("indirect/gather.comp.glsl", group, pixels)
            self._irradiance = float_texture(self._gpu, tuple(int(n) for n in self._record["size"][2:]))

    @property
    def bytes(self) -> int:
        """GPU memory, bytes."""
        width, height = self._atlas.size
        texel = 4 + sum(CHANNELS[n].components * int(CHANNELS[n].dtype[1]) for n in CHANNEL_NAMES)
        own = texture_bytes(self._virtual) + width * height * texel
        return own + (self.grid.bytes if self._probes else texture_bytes(self._irradiance))

    def run(
        self,
        state: FrameState,
        view: View,
        light_rows: Array,
        scene: SceneBuffers,
        materials: MaterialTable,
        casters: Casters,
        placement: Placement,
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
        rows = light_rows[self._lights]
        lit = b"".join(a.tobytes() for a in (rows["color"][:, :3], rows["position"][:, 3], rows["spot"][:, :2]))
        key = casters.key() + lit + b"".join(face.key for face in faces)
        if key != self._solved:
            self._solved = key
            self._solve(faces, view, light_rows, scene, materials, casters, placement)
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
        placement: Placement,
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
            self.grid.fill(view, scene, materials, casters, placement, self._drawer, self._parameters)
        self._parameters.bind_to_uniform_block(0)
        self._texels.bind_to_storage_buffer(3)
        self._faces.bind_to_storage_buffer(5)
        sampled = {name: self._atlas.textures[name] for name in CHANNEL_NAMES}
        sampled["light_table"] = self._light_table.texture
        bind(self._make_virtual, sampled)
        bind_images(out=self._virtual)
        if self._probes:
            bind_images(bricks=self.grid.bricks)
        self._make_virtual.run(-(-self.count // WIDE))
        self._gpu.ctx.memory_barrier()
        if self._probes:
            self.grid.light(self._virtual, self._parameters)

    def _write(self, textures: Mapping[str, moderngl.Texture]) -> None:
        self._parameters.bind_to_uniform_block(0)
        columns, rows = invocations(self._rate, self._size)
        tiles = -(-columns // self._group[0]), -(-rows // self._group[1])
        bind_channels(self._gpu, CHANNEL_NAMES, CHANNEL_UNIT, textures)
        if self._probes:
            bind_images(probes=self.grid.probes)
        else:
            bind_images(virtual_lights=self._virtual)
            if not self._gather_each:
                self._gather_coarsely()
                bind(self._apply, {"irradiance": self._irradiance})
        bind_images(out=textures["indirect"])
        self._apply.run(*tiles)
        self._gpu.ctx.memory_barrier()

    def _gather_coarsely(self) -> None:
        bind_images(out=self._irradiance)
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
    def record(self) -> Array:
        """The INDIRECT record of this frame."""
        return self._record

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
            self.grid if self._probes else self._irradiance,
        ):
            item.release()


def _require_room(gpu: Gpu, count: int, faces: int, atlas: tuple[int, int], record: Array, settings: Settings) -> None:
    """Raise GraphicsError where ``count`` virtual lights need a texture or buffer larger than the device has."""
    what = f"{count} virtual lights in {faces} reflective shadow map{'s' * (faces != 1)}"
    hint = "lower --shadow-lights or indirect_samples"
    limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
    for width, height in (atlas, virtual_size(count)):
        if max(width, height) > limit:
            needed = f"{width}x{height} texels"
            raise GraphicsError(f"{what} would need {needed}, this device's textures end at {limit}", hint=hint)
    if settings.lighting.indirect != "probes":
        return
    probes = int(np.prod(record["probe_counts"][:3]))
    needed, limit = visibility_bytes(probes, count), gpu.ctx.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"]
    if needed > limit:
        raise GraphicsError(
            f"what {probes} probes see of {what} needs {needed} bytes, this device's buffers end at {limit}",
            hint="lower probes or indirect_samples",
        )


def _texel_table(faces: list[Face], offsets: list[tuple[int, int]]) -> Array:
    """(V, 4) uint32: atlas x and y, face, light row of every texel."""
    parts = []
    for i, (face, (x, y)) in enumerate(zip(faces, offsets, strict=True)):
        at = np.stack(np.meshgrid(np.arange(face.resolution), np.arange(face.resolution)), axis=-1).reshape(-1, 2)
        tail = np.broadcast_to([i, face.light], (len(at), 2))
        parts.append(np.concatenate([at + [x, y], tail], axis=1))
    return np.concatenate(parts).astype(np.uint32)
