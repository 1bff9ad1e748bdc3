"""The shadow pass: depth maps of the lights that get shadows, redrawn only where what they see has moved."""

from __future__ import annotations

import moderngl
import numpy as np

from taubench_gl.animation import FrameState, View
from taubench_gl.frame.lights import LightTable
from taubench_gl.frame.materials import MaterialKey, MaterialTable
from taubench_gl.frame.passes.gbuffer import FRAME, geometry_preamble
from taubench_gl.frame.scene_buffers import COMMAND, Group, SceneBuffers, variant
from taubench_gl.frame.shadow_faces import FACE, Face, light_faces, pack
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import column_major
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.math3d import normalize
from taubench_gl.scene.model import Scene

Array = np.ndarray


class Casters:
    """World bounds of every draw, and a version number that grows when a draw moves, bends, appears or vanishes."""

    def __init__(self, count: int):
        self.centers, self.radii = np.zeros((count, 3)), np.zeros(count)
        self.versions = np.zeros(count, dtype=np.int64)
        self.visible = np.zeros(count, dtype=bool)
        self._poses: list[bytes] = [b""] * count

    def update(self, bounds: tuple[Array, Array], poses: list[bytes], visible: Array) -> None:
        """``bounds``: centres (D, 3) and radii (D,), world; ``poses``: equal bytes for equal pose, per draw."""
        self.centers, self.radii = bounds
        for i, pose in enumerate(poses):
            if pose != self._poses[i]:
                self._poses[i] = pose
                self.versions[i] += 1
        self.visible = visible


class ShadowPass:
    """Owns the atlas.  ``lights`` are rows of the light table; each keeps its place in the atlas for good."""

    def __init__(
        self,
        gpu: Gpu,
        shaders: ShaderCache,
        scene: Scene,
        table: LightTable,
        lights: list[int],
        bounds: tuple[Array, float],
        *,
        resolution: int,
        colored_materials: frozenset[int],
    ):
        self._gpu, self._shaders, self._scene = gpu, shaders, scene
        self._lights, self._nodes, self._bounds = lights, table.nodes, bounds
        self._index = scene.nodes.light[table.nodes]
        self._resolution, self._colored = resolution, colored_materials
        self._drawn: list[bytes] = []
        self.redrawn = 0  # faces drawn in the last run
        faces = self._faces(None)
        self._offsets, size = pack(faces)
        self._drawn = [b""] * len(faces)
        self.atlas = gpu.ctx.depth_texture(size)
        self.atlas.compare_func = ""
        self.atlas.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._framebuffer = gpu.ctx.framebuffer(depth_attachment=self.atlas)
        self._framebuffer.clear(depth=0.0)
        self.rows = FACE.zeros(max(len(faces), 1))
        self.buffer = gpu.ctx.buffer(reserve=self.rows.nbytes, dynamic=True)
        self._frame = gpu.ctx.buffer(reserve=FRAME.dtype.itemsize, dynamic=True)
        self._commands = gpu.ctx.buffer(reserve=COMMAND.itemsize * 1024, dynamic=True)

    @property
    def bytes(self) -> int:
        return 4 * self.atlas.width * self.atlas.height

    def _faces(self, state: FrameState | None) -> list[Face]:
        out = []
        for row in self._lights:
            node = int(self._nodes[row])
            light = (self._scene.lights if state is None else state.lights)[int(self._index[row])]
            world = np.eye(4) if state is None else state.world[node]
            direction = -normalize(world[:3, 2])
            # A directional map covers the whole scene: give it the texels of four by four ordinary maps' sides.
            size = self._resolution * (4 if light.kind == "directional" else 1)
            out += light_faces(row, light, world[:3, 3].copy(), direction, self._bounds, size)
        return out

    def run(
        self,
        state: FrameState,
        view: View,
        light_rows: Array,
        scene: SceneBuffers,
        materials: MaterialTable,
        casters: Casters,
    ) -> None:
        """Redraw stale faces and fill in the face table and the lights' shadow fields for this frame's camera."""
        faces = self._faces(state)
        light_rows["color"][:, 3] = -1.0
        light_rows["spot"][:, 2] = 0.0
        stale: list[tuple[Face, tuple[int, int], list[tuple[Group, int, int]]]] = []
        payload: list[Array] = []
        size = 0
        for i, face in enumerate(faces):
            self._fill(i, face, view)
            if light_rows["color"][face.light, 3] < 0:
                light_rows["color"][face.light, 3] = i
            light_rows["spot"][face.light, 2] += 1
            if not np.any(light_rows["color"][face.light, :3]):
                continue  # off: nobody asks its map
            seen = np.flatnonzero(casters.visible & face.sees(casters.centers, casters.radii))
            key = face.key + seen.tobytes() + casters.versions[seen].tobytes()
            if key == self._drawn[i]:
                continue
            self._drawn[i] = key
            commands, groups = scene.subset(seen)
            stale.append((face, self._offsets[i], [(g, first + size, count) for g, first, count in groups]))
            payload.append(commands)
            size += len(commands)
        self.buffer.write(self.rows.tobytes())
        self.redrawn = len(stale)
        if stale:
            self._upload(np.concatenate(payload))
            self._draw(stale, view, scene, materials)

    def _fill(self, i: int, face: Face, view: View) -> None:
        row, (x, y) = self.rows[i], self._offsets[i]
        row["origin"] = (*(face.origin - view.position), float(face.parallel))
        row["right"], row["up"] = (*(face.right / face.half), x), (*(face.up / face.half), y)
        row["forward"] = (*face.forward, face.near)
        row["extent"][:2] = face.resolution, 2.0 * face.half / face.resolution

    def _upload(self, commands: Array) -> None:
        if self._commands.size < commands.nbytes:
            self._commands.release()
            self._commands = self._gpu.ctx.buffer(reserve=commands.nbytes * 3 // 2, dynamic=True)
        self._commands.write(commands.tobytes())

    def _draw(self, stale: list, view: View, scene: SceneBuffers, materials: MaterialTable) -> None:
        ctx = self._gpu.ctx
        self._framebuffer.use()
        ctx.enable_only(moderngl.DEPTH_TEST)
        ctx.depth_func = ">"
        scene.records.bind_to_storage_buffer(0)
        materials.buffer.bind_to_storage_buffer(1)
        for face, (x, y), groups in stale:
            viewport = (x, y, face.resolution, face.resolution)
            self._framebuffer.clear(depth=0.0, viewport=viewport)
            self._framebuffer.viewport = viewport
            record = FRAME.zeros()
            record["clip_from_relative"] = column_major(face.clip_from_relative(view.position))
            self._frame.write(record.tobytes())
            self._frame.bind_to_storage_buffer(2)
            for group, first, count in groups:
                program = self._program(group, materials)
                if materials.keys[group.material + 1].alpha_test:
                    materials.bind(group.material, program, ("base_color",))
                scene.draw_commands(group, program, self._commands, first, count)
        materials.unbind()

    def _program(self, group: Group, materials: MaterialTable) -> moderngl.Program:
        key = materials.keys[group.material + 1]
        slots = tuple(s for s in key.slots if s == "base_color") if key.alpha_test else ()
        defines = variant(
            MaterialKey(slots, key.alpha_test, True),
            group.posed,
            (),
            key.alpha_test and group.material in self._colored,
        )
        return self._shaders.render(
            "gbuffer/gbuffer.vert.glsl", "shadow/shadow.frag.glsl", defines, geometry_preamble()
        )

    def release(self) -> None:
        for item in (self._framebuffer, self.atlas, self.buffer, self._frame, self._commands):
            item.release()
