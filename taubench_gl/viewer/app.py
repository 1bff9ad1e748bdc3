"""The viewer with input and panels, drawn into a framebuffer.

The window forwards its callbacks to ``Viewer.input``; scripts call the same methods.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import moderngl
import numpy as np
from imgui_bundle import ImVec2, imgui

from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.owner import Owner
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.outputs import write_png
from taubench_gl.viewer.feeds import OpenRequest
from taubench_gl.viewer.imgui_renderer import BACKGROUND, PANEL, ImguiRenderer, apply_theme
from taubench_gl.viewer.input import Input
from taubench_gl.viewer.layout import Layout, around
from taubench_gl.viewer.model import ViewerModel, free_name
from taubench_gl.viewer.panels import Panels

PANELS_KEPT = 2
"""Frames of playback that show the panels of the frame before them."""


class Viewer(ViewerModel):
    """A ViewerModel with an ImGui context, input and panels."""

    def __init__(self, gpu: Gpu, request: OpenRequest, *, light: bool | None = None, folder: Path | None = None):
        super().__init__(gpu, request, light=light, folder=folder)
        self._imgui = imgui.create_context()
        imgui.set_current_context(self._imgui)  # a viewer that is open already stays intact
        imgui.get_io().set_ini_filename("")
        apply_theme()
        self._renderer = self.own(ImguiRenderer(gpu))
        self._shaders = self.own(ShaderCache(gpu.ctx))
        self._blit = self._shaders.render("viewer/fullscreen.vert.glsl", "viewer/blit.frag.glsl")
        self._triangle = self.own(gpu.ctx.vertex_array(self._blit, []))
        self.panels = Panels(self)
        self.input = Input(self)
        self._composed: tuple[int, int] | None = None  # the window's size when panels were composed last
        self._kept = 0  # frames since

    def _serve(self, request: str) -> None:
        if request == "window screenshot":
            self.window_screenshot(free_name(self.screenshots, f"{self.stem}-window", ".png"))
        else:
            super()._serve(request)

    def window_screenshot(self, path: Path) -> bool:
        """Save the whole window as PNG; False, with a message, if that fails."""
        return self._saved(path, lambda: write_png(path, self.window_image()))

    def window_image(self) -> np.ndarray:
        """The window, redrawn into a framebuffer.  (h, w, 3) uint8, row 0 at the top."""
        width, height = (max(n, 1) for n in self.window_size)
        with Owner() as drawn:
            texture = drawn.own(self.gpu.ctx.texture((width, height), 4))
            self.draw(drawn.own(self.gpu.ctx.framebuffer([texture])))
            self.gpu.finish()
            # GL's row 0 is at the bottom
            out = np.frombuffer(texture.read(), np.uint8).reshape(height, width, 4)[::-1, :, :3].copy()
            self.gpu.unbind_framebuffer()
        return out

    def tick(self, seconds: float) -> None:
        """Advance time by ``seconds``, move the camera by the held keys, update the image."""
        self.input.move_camera(seconds)
        self.camera_moves = self.input.moves_camera
        super().tick(seconds)
        if seconds > 0 and (self.state.playing or self.input.held):
            rate = 1.0 / seconds
            self.fps = rate if self.fps == 0 else self.fps + 0.1 * (rate - self.fps)

    def draw(self, framebuffer: moderngl.Framebuffer) -> None:
        """Draw image and panels.  A window without area draws nothing."""
        width, height = self.window_size
        if width <= 0 or height <= 0:
            return
        imgui.set_current_context(self._imgui)
        io = imgui.get_io()
        io.display_size = ImVec2(width, height)
        io.display_framebuffer_scale = ImVec2(framebuffer.size[0] / width, framebuffer.size[1] / height)
        io.delta_time = 1.0 / 60.0
        layout = self.layout
        if self._panels_due():
            imgui.new_frame()
            self.panels.draw(layout)
            imgui.render()
        for texture in (self.timeline.texture, self.engine.magnified):
            if texture is not None:
                self._renderer.show(texture)
        framebuffer.use()
        framebuffer.scissor = None
        self._clear(framebuffer, layout)
        self._draw_image(framebuffer, layout)
        self._renderer.render(framebuffer)

    def _panels_due(self) -> bool:
        """Whether to compose the panels: during playback without input, those of one frame stay for the next two."""
        kept = self.state.playing and self.input.answers == 0 and self._composed == self.window_size
        due = not kept or self._kept >= PANELS_KEPT
        self.input.answers = max(self.input.answers - 1, 0)
        self._composed, self._kept = self.window_size, 0 if due else self._kept + 1
        return due

    def _clear(self, framebuffer: moderngl.Framebuffer, layout: Layout) -> None:
        """Panels and what is around the images: clearing costs a fraction of blending the panels' backgrounds."""
        scale, (width, height) = framebuffer.size[0] / self.window_size[0], self.window_size
        framebuffer.clear(*PANEL, 1.0)
        left = 0 if layout.left is None else layout.left[2]
        right = width - (0 if layout.right is None else layout.right[2])
        bottom = height - (0 if layout.bar is None else layout.bar[3])
        for x0, y0, x1, y1 in around((left, 0, right, bottom), layout.images):
            area = (x0, height - y1, x1 - x0, y1 - y0)
            framebuffer.clear(*BACKGROUND, 1.0, viewport=tuple(round(n * scale) for n in area))

    def _draw_image(self, framebuffer: moderngl.Framebuffer, layout: Layout) -> None:
        scale, ctx = framebuffer.size[0] / self.window_size[0], self.gpu.ctx
        ctx.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)
        for texture, (left, top, width, height) in zip(self.engine.textures, layout.images, strict=True):
            x, y = left * scale, (self.window_size[1] - top - height) * scale
            whole = (width * scale) % texture.size[0] == 0  # an integer multiple shows exact pixels
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST) if whole else (moderngl.LINEAR, moderngl.LINEAR)
            ctx.viewport = (int(x), int(y), max(int(width * scale), 1), max(int(height * scale), 1))
            texture.use(0)
            self._blit["image"] = 0
            self._triangle.render(moderngl.TRIANGLES, vertices=3)

    def bench(self, frames: int, present: Callable[[], None]) -> float:
        """Median frames per second while playing; every frame is drawn, classified and shown."""
        seconds, playing = [], self.state.playing
        self.state.playing = True
        for i in range(frames + 3):
            start = time.perf_counter()
            self.state.frame = self.state.next_frame
            self.tick(0.0)
            present()
            self.gpu.finish()
            if i >= 3:  # the first frames compile shaders
                seconds.append(time.perf_counter() - start)
        self.state.playing = playing
        return 1.0 / float(np.median(seconds))

    def close(self) -> None:
        """Store the preferences, finish the clip, free the GPU resources."""
        imgui.set_current_context(self._imgui)
        super().close()
        imgui.destroy_context(self._imgui)
