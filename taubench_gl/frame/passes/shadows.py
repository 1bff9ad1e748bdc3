"""The shadow pass: depth maps of the lights that get shadows, redrawn only where what they see has moved."""

from __future__ import annotations

from functools import partial

import moderngl
import numpy as np

from taubench_gl.animation import FrameState, View
from taubench_gl.errors import GraphicsError
from taubench_gl.frame.geometry import Draw
from taubench_gl.frame.materials import MaterialKey, MaterialTable
from taubench_gl.frame.passes.faces import AnchoredRecords, Casters, FaceDrawer, Program
from taubench_gl.frame.passes.gbuffer import geometry_preamble
from taubench_gl.frame.passes.held_faces import HeldFaces, Rect
from taubench_gl.frame.records import Placement
from taubench_gl.frame.scene_buffers import Group, SceneBuffers, variant
from taubench_gl.frame.shadow_faces import FACE, Face, faces_of, pack
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.memory import require_memory
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.scene.model import Scene

Array = np.ndarray


class ShadowPass:
    """Owns the atlas.  ``lights`` are rows of the light table; each keeps its place in the atlas for good."""

    def __init__(
        self,
        gpu: Gpu,
        shaders: ShaderCache,
        scene: Scene,
        lights: list[int],
        bounds: tuple[Array, float],
        *,
        resolution: int,
        colored_materials: frozenset[int],
        draws: tuple[Draw, ...],
    ):
        self._gpu, self._shaders, self._scene = gpu, shaders, scene
        self._lights, self._bounds = lights, bounds
        self._resolution, self._colored = resolution, colored_materials
        self.redrawn = 0  # faces drawn in the last run
        faces = faces_of(scene, None, lights, bounds, resolution)
        self.first_faces = {face.light: i for i, face in reversed(list(enumerate(faces)))}  # row -> first of its faces
        self._offsets, size = pack(faces)
        _require_room(gpu, faces, size)
        self._held = HeldFaces(len(faces))
        self.atlas = gpu.depth_texture(size)
        self.atlas.compare_func = ""
        self.atlas.filter = (moderngl.NEAREST, moderngl.NEAREST)
        self._framebuffer = gpu.ctx.framebuffer(depth_attachment=self.atlas)
        self._framebuffer.clear(depth=0.0)
        self.rows = FACE.zeros(max(len(faces), 1))
        self.faces = gpu.ctx.texture((len(FACE.fields), len(self.rows)), 4, dtype="f4")
        self._drawer = FaceDrawer(gpu)
        self._anchor = AnchoredRecords(gpu, draws, bounds[0])

    @property
    def bytes(self) -> int:
        return 4 * self.atlas.width * self.atlas.height

    def depths(self) -> Array:
        """The atlas, (h, w) float32 reversed Z, row 0 at the bottom."""
        return np.frombuffer(self.atlas.read(), np.float32).reshape(self.atlas.height, self.atlas.width)

    def run(
        self,
        state: FrameState,
        view: View,
        light_rows: Array,
        scene: SceneBuffers,
        materials: MaterialTable,
        casters: Casters,
        placement: Placement,
    ) -> None:
        """Redraw stale faces and fill in the face table and the lights' shadow fields for this frame's camera."""
        faces = faces_of(self._scene, state, self._lights, self._bounds, self._resolution)
        light_rows["color"][:, 3] = -1.0
        stale: list[tuple[Face, tuple[int, int], Array]] = []
        parts: list[Rect] = []
        for row, first in self.first_faces.items():
            light_rows["color"][row, 3] = first
        for i, face in enumerate(faces):
            self._fill(i, face, view)
            if not np.any(light_rows["color"][face.light, :3]):
                continue  # off: nobody asks its map
            renewed = self._held.renew(i, face, casters)
            if renewed is not None:
                parts.append(renewed[0])
                stale.append((face, self._offsets[i], renewed[1]))
        self.faces.write(self.rows.tobytes())
        self.redrawn = len(stale)
        if stale:
            self._anchor.update(placement, scene.order)
        program_of = partial(self._program, materials=materials)
        anchored = {"anchor": self._anchor, "parts": parts}
        self._drawer.draw(stale, self._framebuffer, view, scene, materials, program_of, **anchored)

    def _fill(self, i: int, face: Face, view: View) -> None:
        row, (x, y) = self.rows[i], self._offsets[i]
        row["origin"] = (*(face.origin - view.position), float(face.parallel))
        row["right"], row["up"] = (*(face.right / face.half), x), (*(face.up / face.half), y)
        row["forward"] = (*face.forward, face.near)
        row["extent"][:2] = face.resolution, 2.0 * face.half / face.resolution

    def _program(self, group: Group, materials: MaterialTable) -> Program:
        key = materials.keys[group.material + 1]
        slots = tuple(s for s in key.slots if s == "base_color") if key.alpha_test else ()
        defines = variant(
            MaterialKey(slots, key.alpha_test, True),
            group.posed,
            (),
            key.alpha_test and group.material in self._colored,
        )
        program = self._shaders.render(
            "gbuffer/gbuffer.vert.glsl", "shadow/shadow.frag.glsl", defines, geometry_preamble()
        )
        return Program(program, slots)

    def release(self) -> None:
        for item in (self._framebuffer, self.atlas, self.faces, self._drawer, self._anchor):
            item.release()


def _require_room(gpu: Gpu, faces: list[Face], size: tuple[int, int]) -> None:
    """Raise GraphicsError where the atlas is larger than a texture of the device may be, or than memory is free."""
    hint = "lower --shadow-size or --shadow-lights"
    largest = max((f.resolution for f in faces), default=0)
    what = f"{len(faces)} shadow map{'s' * (len(faces) != 1)} of up to {largest} texels"
    limit = gpu.ctx.info["GL_MAX_TEXTURE_SIZE"]
    if max(size) > limit:
        atlas = f"{size[0]}x{size[1]} texels"
        raise GraphicsError(f"{what} would need {atlas}, this device's textures end at {limit}", hint=hint)
    require_memory(gpu, 4 * size[0] * size[1], f"an atlas of {what}", hint)
