"""Draws Dear ImGui's lists with moderngl: the bundle's own PyOpenGL back end leaves errors behind on a core profile."""

from __future__ import annotations

import ctypes

import moderngl
import numpy as np
from imgui_bundle import imgui

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache


class ImguiRenderer:
    """One per ImGui context.  Keeps ImGui's textures (glyphs grow as they are needed) as moderngl textures."""

    def __init__(self, gpu: Gpu):
        self._gpu = gpu
        self._shaders = ShaderCache(gpu.ctx)
        self._program = self._shaders.render("viewer/panel.vert.glsl", "viewer/panel.frag.glsl")
        self._vertices = gpu.ctx.buffer(reserve=1 << 16, dynamic=True)
        self._indices = gpu.ctx.buffer(reserve=1 << 16, dynamic=True)
        self._textures: dict[int, moderngl.Texture] = {}
        imgui.get_io().backend_flags |= imgui.BackendFlags_.renderer_has_textures.value
        self._array = self._make_array()

    def _make_array(self) -> moderngl.VertexArray:
        layout = (self._vertices, "2f 2f 4f1", "in_position", "in_uv", "in_color")
        return self._gpu.ctx.vertex_array(self._program, [layout], self._indices, index_element_size=imgui.INDEX_SIZE)

    def update_textures(self) -> None:
        """Create, change and drop textures as ImGui asks."""
        status = imgui.ImTextureStatus
        for texture in imgui.get_platform_io().textures:
            if texture.status in (status.want_create, status.want_updates):
                size, data = (texture.width, texture.height), np.ascontiguousarray(texture.get_pixels_array())
                if texture.status == status.want_create:
                    made = self._gpu.ctx.texture(size, 4, data.tobytes())
                    self._textures[made.glo] = made
                    texture.set_tex_id(made.glo)
                else:
                    self._textures[texture.get_tex_id()].write(data.tobytes())
                texture.set_status(status.ok)
            elif texture.status == status.want_destroy and texture.unused_frames > 0:
                gone = self._textures.pop(texture.get_tex_id(), None)
                if gone is not None:
                    gone.release()
                texture.set_tex_id(0)
                texture.set_status(status.destroyed)

    def render(self, framebuffer: moderngl.Framebuffer) -> None:
        """Draw what ``imgui.render()`` has prepared, over what is in ``framebuffer``."""
        data, ctx = imgui.get_draw_data(), self._gpu.ctx
        self.update_textures()
        width, height = framebuffer.size
        scale_x, scale_y = data.framebuffer_scale
        if width == 0 or height == 0 or data.display_size[0] <= 0:
            return
        framebuffer.use()
        ctx.viewport = (0, 0, width, height)
        ctx.enable_only(moderngl.BLEND)
        ctx.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
        self._program["points"] = (data.display_size[0], data.display_size[1])
        self._program["glyphs"] = 0
        for commands in data.cmd_lists:
            self._upload(commands)
            for command in commands.cmd_buffer:
                x0, y0, x1, y1 = command.clip_rect
                left, top = max(int(x0 * scale_x), 0), max(int(y0 * scale_y), 0)
                right, bottom = min(int(x1 * scale_x), width), min(int(y1 * scale_y), height)
                texture = self._textures.get(command.tex_ref.get_tex_id())
                if right <= left or bottom <= top or texture is None:
                    continue
                framebuffer.scissor = (left, height - bottom, right - left, bottom - top)
                texture.use(0)
                # Indices are 32 bits wide, so no command has a vertex offset.
                self._array.render(moderngl.TRIANGLES, vertices=command.elem_count, first=command.idx_offset)
        framebuffer.scissor = None
        ctx.disable(moderngl.BLEND)

    def _upload(self, commands: imgui.ImDrawList) -> None:
        for name, source, size in (
            ("_vertices", commands.vtx_buffer, imgui.VERTEX_SIZE),
            ("_indices", commands.idx_buffer, imgui.INDEX_SIZE),
        ):
            data = ctypes.string_at(source.data_address(), source.size() * size) if source.size() else b""
            buffer: moderngl.Buffer = getattr(self, name)
            if len(data) > buffer.size:
                self._array.release()
                buffer.release()
                setattr(self, name, self._gpu.ctx.buffer(reserve=2 * len(data), dynamic=True))
                self._array = self._make_array()
            getattr(self, name).orphan()
            getattr(self, name).write(data)

    def release(self) -> None:
        for texture in imgui.get_platform_io().textures:
            texture.set_tex_id(0)
            texture.set_status(imgui.ImTextureStatus.destroyed)
        for item in (*self._textures.values(), self._array, self._vertices, self._indices, self._shaders):
            item.release()
        self._textures.clear()
