"""The geometry pass: everything visible, once, into the requested channels."""

from __future__ import annotations

import moderngl

from taubench_gl.animation import View
from taubench_gl.channels import CHANNELS
from taubench_gl.frame.material_slots import MaterialKey
from taubench_gl.frame.materials import MATERIAL, SLOTS, MaterialTable
from taubench_gl.frame.scene_buffers import Group, SceneBuffers, variant
from taubench_gl.frame.targets import Targets
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct, column_major
from taubench_gl.gpu.shader import ShaderCache

FRAME = Struct(
    "FrameRecord",
    Field("clip_from_relative", "mat4", "clip, reversed Z in [0, 1] <- relative to the current camera, world axes"),
    Field("forward", "vec4", "xyz: unit, where the camera looks: dot with a relative position is planar depth"),
)
_GLSL_TYPE = {("f4", 4): "vec4", ("f2", 4): "vec4", ("u4", 2): "uvec2"}
PIXELS_PER_TRIANGLE = 4
"""Fewer than this in the picture, and drawing its triangles twice may cost more than hidden surfaces' channels do."""

BEHIND = (-1.0, -4.0)
"""Polygon offset of the depth laid down first: so many slopes per pixel, and smallest steps of depth, too far away.

Only what rounding can take from a depth has to be less: each pixel's surface is still found by the pass itself.
"""


def attachments(channels: tuple[str, ...]) -> tuple[str, ...]:
    """Of the requested channels, those the geometry pass writes, in the table's order."""
    return tuple(name for name, info in CHANNELS.items() if info.attachment and name in channels)


def geometry_preamble() -> str:
    """GLSL structs and slot numbers shared by every pass that draws the scene's geometry."""
    slots = [f"const int SLOT_{name.upper()} = {i};" for i, name in enumerate(SLOTS)]
    return "\n".join((FRAME.glsl, MATERIAL.glsl, *slots))


class GBufferPass:
    """Writes ``channels``; compiles a shader variant for a group of draws when the first such group appears.

    Where triangles are large, the depth of what no alpha mask cuts out is laid down first, a little too far away, so
    that hidden surfaces cost no channels.  It changes nothing of the picture: of the surfaces at a pixel's least
    distance the first one drawn is kept, with or without it.
    """

    def __init__(self, gpu: Gpu, shaders: ShaderCache, channels: tuple[str, ...], colored_materials: frozenset[int]):
        self._gpu, self._shaders, self._channels = gpu, shaders, channels
        self._colored = colored_materials
        self._frame = gpu.ctx.buffer(reserve=FRAME.dtype.itemsize, dynamic=True)
        outputs = [
            f"layout(location = {i}) out {_GLSL_TYPE[CHANNELS[n].dtype, CHANNELS[n].components]} out_{n};"
            for i, n in enumerate(channels)
        ]
        self._outputs = "\n".join(outputs)
        self._plain = ShaderCache(gpu.ctx)  # what every frame has alike: no part of the plan of a scene's shaders
        self._depth: moderngl.Framebuffer | None = None

    def program(self, group: Group, materials: MaterialTable) -> moderngl.Program:
        """The shader variant that draws ``group``."""
        key = materials.keys[group.material + 1]
        defines = variant(key, group.posed, self._channels, group.material in self._colored)
        defines |= {f"OUTPUT_{name.upper()}": name in self._channels for name, c in CHANNELS.items() if c.attachment}
        # Vertex colours matter only where the base colour does.
        defines["COLORS"] = defines["COLORS"] and (key.alpha_test or "base_color" in self._channels)
        return self._shaders.render(
            "gbuffer/gbuffer.vert.glsl",
            "gbuffer/gbuffer.frag.glsl",
            defines,
            geometry_preamble(),
            self._outputs,
        )

    def run(self, view: View, targets: Targets, scene: SceneBuffers, materials: MaterialTable) -> None:
        """Draw one frame.  The record table and commands of ``scene`` must be up to date."""
        ctx = self._gpu.ctx
        record = FRAME.zeros()
        record["clip_from_relative"] = column_major(view.clip_from_relative(*targets.size))
        record["forward"][:3] = -view.world_from_view[:, 2]
        self._frame.write(record.tobytes())
        self._frame.bind_to_uniform_block(2)
        ctx.enable_only(moderngl.DEPTH_TEST)
        ctx.depth_func = ">"
        laid = PIXELS_PER_TRIANGLE * scene.shown_triangles <= targets.size[0] * targets.size[1]
        if laid:
            self._lay_depth(targets, scene, materials)
        targets.framebuffer.use()
        targets.framebuffer.depth_mask = not laid  # what is laid down stays
        targets.clear()
        targets.framebuffer.depth_mask = True
        for group in scene.seen_groups:
            program = self.program(group, materials)
            materials.bind(group.material, program)
            self._set_facing(group)
            scene.draw(group, program)
        materials.unbind()
        ctx.front_face = "ccw"
        ctx.disable(moderngl.CULL_FACE)

    def _lay_depth(self, targets: Targets, scene: SceneBuffers, materials: MaterialTable) -> None:
        """The depth of what no alpha mask cuts out, from infinitely far (0, reversed Z)."""
        ctx = self._gpu.ctx
        depth = targets.framebuffer.depth_attachment
        if self._depth is None or self._depth.depth_attachment is not depth:
            self._release_depth()
            self._depth = ctx.framebuffer((), depth)
        self._depth.use()
        self._depth.clear(depth=0.0)
        ctx.polygon_offset = BEHIND
        for group in scene.seen_groups:
            key = materials.keys[group.material + 1]
            if not key.alpha_test:
                self._set_facing(group)
                scene.draw(group, self._depth_program(group))
        ctx.polygon_offset = 0.0, 0.0

    def _set_facing(self, group: Group) -> None:
        ctx = self._gpu.ctx
        if group.cull:
            ctx.enable(moderngl.CULL_FACE)
        else:
            ctx.disable(moderngl.CULL_FACE)
        ctx.front_face = "cw" if group.mirrored else "ccw"

    def _depth_program(self, group: Group) -> moderngl.Program:
        defines = variant(MaterialKey((), False, False), group.posed, (), False)
        return self._plain.render("gbuffer/gbuffer.vert.glsl", "gbuffer/depth.frag.glsl", defines, geometry_preamble())

    def _release_depth(self) -> None:
        if self._depth is not None:
            self._gpu.unbind_framebuffer()
            self._depth.release()

    def release(self) -> None:
        self._release_depth()
        self._plain.release()
        self._frame.release()
