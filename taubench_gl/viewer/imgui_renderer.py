"""Theme of the panels, and a renderer of Dear ImGui draw lists with moderngl.

The PyOpenGL back end of imgui-bundle raises OpenGL errors on a core profile.
"""

from __future__ import annotations

import ctypes
import importlib.util
from pathlib import Path

import moderngl
import numpy as np
from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.shader import ShaderCache


class ImguiRenderer(Owner):
    """Renderer of one ImGui context.  ImGui adds glyphs to its textures on demand; they are mirrored in moderngl."""

    def __init__(self, gpu: Gpu):
        super().__init__()
        self._gpu = gpu
        self._shaders = self.own(ShaderCache(gpu.ctx))
        self._program = self._shaders.render("viewer/panel.vert.glsl", "viewer/panel.frag.glsl")
        self._vertices = self.own(gpu.ctx.buffer(reserve=1 << 16, dynamic=True))
        self._indices = self.own(gpu.ctx.buffer(reserve=1 << 16, dynamic=True))
        self._textures: dict[int, moderngl.Texture] = {}
        self._shown: dict[int, moderngl.Texture] = {}  # of others, by number, until the frame is drawn
        imgui.get_io().backend_flags |= imgui.BackendFlags_.renderer_has_textures.value
        self._array = self._make_array()

    def _make_array(self) -> moderngl.VertexArray:
        layout = (self._vertices, "2f 2f 4f1", "in_position", "in_uv", "in_color")
        size = imgui.INDEX_SIZE
        return self.own(self._gpu.ctx.vertex_array(self._program, [layout], self._indices, index_element_size=size))

    def update_textures(self) -> None:
        """Create, update and delete textures as ImGui requests."""
        status = imgui.ImTextureStatus
        for texture in imgui.get_platform_io().textures:
            if texture.status in (status.want_create, status.want_updates):
                size, data = (texture.width, texture.height), np.ascontiguousarray(texture.get_pixels_array())
                if texture.status == status.want_create:
                    made = self.own(self._gpu.ctx.texture(size, 4, data.tobytes()))
                    self._textures[made.glo] = made
                    texture.set_tex_id(made.glo)
                else:
                    self._textures[texture.get_tex_id()].write(data.tobytes())
                texture.set_status(status.ok)
            elif texture.status == status.want_destroy and texture.unused_frames > 0:
                self.free_parts(self._textures.pop(texture.get_tex_id(), None))
                texture.set_tex_id(0)
                texture.set_status(status.destroyed)

    def show(self, texture: moderngl.Texture) -> None:
        """Let panels draw ``texture`` by its number; the caller keeps it."""
        self._shown[texture.glo] = texture

    def render(self, framebuffer: moderngl.Framebuffer) -> None:
        """Draw the lists of ``imgui.render()`` over the content of ``framebuffer``."""
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
                number = command.tex_ref.get_tex_id()
                texture = self._textures.get(number) or self._shown.get(number)
                if right <= left or bottom <= top or texture is None:
                    continue
                framebuffer.scissor = (left, height - bottom, right - left, bottom - top)
                texture.use(0)
                # Indices are 32 bits wide, so no command has a vertex offset.
                self._array.render(moderngl.TRIANGLES, vertices=command.elem_count, first=command.idx_offset)
        framebuffer.scissor = None
        ctx.disable(moderngl.BLEND)
        self._shown.clear()

    def _upload(self, commands: imgui.ImDrawList) -> None:
        for name, source, size in (
            ("_vertices", commands.vtx_buffer, imgui.VERTEX_SIZE),
            ("_indices", commands.idx_buffer, imgui.INDEX_SIZE),
        ):
            data = ctypes.string_at(source.data_address(), source.size() * size) if source.size() else b""
            buffer: moderngl.Buffer = getattr(self, name)
            if len(data) > buffer.size:
                self.free_parts(self._array, buffer)
                setattr(self, name, self.own(self._gpu.ctx.buffer(reserve=2 * len(data), dynamic=True)))
                self._array = self._make_array()
            getattr(self, name).orphan()
            getattr(self, name).write(data)

    def release(self) -> None:
        for texture in imgui.get_platform_io().textures:
            texture.set_tex_id(0)
            texture.set_status(imgui.ImTextureStatus.destroyed)
        super().release()
        self._textures.clear()


FONT_PX = 15.0
ACCENT = (0.34, 0.71, 0.91)
TEXT, FAINT, PANEL, FIELD = (0.86, 0.87, 0.89), (0.52, 0.54, 0.58), (0.105, 0.11, 0.12), (0.17, 0.18, 0.20)
BACKGROUND = (0.06, 0.063, 0.07)


def apply_theme() -> None:
    """Set colors, spacing and font of the current ImGui context."""
    style, col = imgui.get_style(), imgui.Col_
    imgui.style_colors_dark()
    style.window_padding, style.frame_padding, style.item_spacing = ImVec2(12, 10), ImVec2(8, 3), ImVec2(8, 5)
    style.window_border_size = style.frame_border_size = 0.0
    style.window_rounding, style.frame_rounding, style.grab_rounding, style.scrollbar_rounding = 0.0, 3.0, 3.0, 3.0
    style.scrollbar_size, style.grab_min_size = 10.0, 8.0
    style.anti_aliased_lines = style.anti_aliased_fill = True
    lighter, lightest = tuple(c + 0.05 for c in FIELD), tuple(c + 0.10 for c in FIELD)
    for name, color, alpha in (
        (col.text, TEXT, 1), (col.text_disabled, FAINT, 1), (col.window_bg, PANEL, 1), (col.popup_bg, PANEL, 0.98),
        (col.frame_bg, FIELD, 1), (col.frame_bg_hovered, lighter, 1), (col.frame_bg_active, lightest, 1),
        (col.button, FIELD, 1), (col.button_hovered, lighter, 1), (col.button_active, lightest, 1),
        (col.header, PANEL, 0), (col.header_hovered, FIELD, 1), (col.header_active, lighter, 1),
        (col.slider_grab, ACCENT, 0.45), (col.slider_grab_active, ACCENT, 0.65), (col.check_mark, ACCENT, 1),
        (col.separator, FIELD, 1), (col.scrollbar_bg, PANEL, 0), (col.scrollbar_grab, FIELD, 1),
        (col.plot_histogram, ACCENT, 0.8),
    ):  # fmt: skip
        style.set_color_(name.value, ImVec4(*color, alpha))
    _font()


def _font() -> None:
    """Load Roboto from imgui-bundle; without the file ImGui uses its built-in font."""
    spec = importlib.util.find_spec("imgui_bundle")
    fonts = Path(spec.origin).parent / "assets" / "fonts" if spec and spec.origin else Path()
    path = next((p for p in (fonts / "Roboto" / "Roboto-Regular.ttf", fonts / "DroidSans.ttf") if p.is_file()), None)
    if path is not None:
        imgui.get_io().fonts.add_font_from_file_ttf(str(path), FONT_PX)
