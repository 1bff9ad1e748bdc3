"""The viewer without its window: takes events, keeps state and engine together, draws into a framebuffer.

A window forwards its callbacks here, a script calls the same methods.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

import moderngl
import numpy as np
from imgui_bundle import ImVec2, imgui

from taubench_gl.conventions import FEATURES
from taubench_gl.errors import TaubenchError
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.outputs import write_png
from taubench_gl.viewer import prefs, theme
from taubench_gl.viewer.actions import ACTIONS
from taubench_gl.viewer.capture import Clip, free_name
from taubench_gl.viewer.engine import ViewerEngine
from taubench_gl.viewer.feeds import PathTracedFeed
from taubench_gl.viewer.imgui_renderer import ImguiRenderer
from taubench_gl.viewer.input import Input
from taubench_gl.viewer.layout import Layout, arrange
from taubench_gl.viewer.opening import Asked, open_feed
from taubench_gl.viewer.panels import Panels
from taubench_gl.viewer.path_traced_comparison import PathTracedComparison
from taubench_gl.viewer.probe import Probe, probe_pixel
from taubench_gl.viewer.state import ViewerState
from taubench_gl.viewer.timing import LiveTimer
from taubench_gl.viewer.variables import values

LIGHT = ("direct", "color", "emission")


class Viewer:
    """``light``: True, False, or None for not at first where OpenGL is software; ``folder``: of prefs, or None."""

    hint = "?: keys"

    def __init__(self, gpu: Gpu, asked: Asked, *, light: bool | None = None, folder: Path | None = None):
        self.gpu, self._asked, self._light, self._folder = gpu, asked, light, folder
        self.timer = LiveTimer(gpu)
        kept, note = prefs.load(folder) if folder is not None else (prefs.Prefs(), "")
        self.window_size = kept.window or (0, 0)
        self.state, self.engine = self._open(asked)
        prefs.apply(kept, self.state)
        self.state.message = note or self.state.message
        self.shots = Path(".")  # where screenshots and clips go
        self.clip: Clip | None = None
        self.done = False
        self.fps = 0.0
        self._seen: tuple[int, object] = (0, None)  # the picture that was shown last, for clips
        self._probed: tuple[object, Probe] | None = None
        self._imgui = imgui.create_context()
        imgui.get_io().set_ini_filename("")
        theme.apply()
        self._renderer = ImguiRenderer(gpu)
        self._shaders = ShaderCache(gpu.ctx)
        self._blit = self._shaders.render("viewer/fullscreen.vert.glsl", "viewer/blit.frag.glsl")
        self._triangle = gpu.ctx.vertex_array(self._blit, [])
        self.panels = Panels(self)
        self.input = Input(self)

    # -- opening

    def _open(self, asked: Asked) -> tuple[ViewerState, ViewerEngine]:
        opened = open_feed(self.gpu, asked, self.timer)
        feed = opened.feed
        try:
            comparison = None
            if asked.reference is not None:
                settings = feed.settings.replace(frames=(None, None))
                reference = PathTracedFeed(self.gpu, asked.reference, settings, asked.options)
                comparison = PathTracedComparison(reference, feed.size, feed.frames[0])
        except TaubenchError:
            feed.release()
            raise
        limits = {f: feed.settings.metrics.threshold(f) for f in FEATURES}
        channel = "color" if "color" in feed.pictures() else "shape"
        state = ViewerState(
            first=feed.frames[0], last=feed.frames[-1], fps=feed.settings.sequence.fps, size=feed.size,
            effects=feed.switchable,
            thresholds=dict(limits), default_thresholds=limits, channel=channel,
            unit_scale=feed.settings.metrics.unit_scale,
        )  # fmt: skip
        state.effect = state.effects[0] if state.effects else ""
        state.go_to(state.first + 1 if opened.frame is None else opened.frame)
        state.message = "; ".join(opened.notes)
        dark = self._light is False or (self._light is None and self.gpu.software)
        if dark and set(LIGHT) & set(state.effects) and opened.frame is None:
            state.switched_off = frozenset(LIGHT) & set(state.effects)
            state.channel = "shape"
            state.message = "software OpenGL: light is off until switched on (effects, or --light)"
        engine = ViewerEngine(self.gpu, feed, self.timer, comparison)
        try:
            engine.update(state)  # what cannot be drawn is refused here, not shown later
        except TaubenchError:
            engine.release()
            raise
        return state, engine

    def reopen(self, asked: Asked) -> bool:
        """Show something else, or the same read again; False, and everything as it was, where that cannot be opened."""
        try:
            state, engine = self._open(asked)
        except TaubenchError as error:
            self.state.message = str(error)
            return False
        if self.clip is not None:
            self._toggle_clip()
        kept = prefs.Prefs(values=values(self.state))
        prefs.apply(kept, state)
        self.engine.release()
        self._asked, self.state, self.engine, self._probed = asked, state, engine, None
        return True

    # -- what happens

    def act(self, name: str) -> None:
        """Run an action, and what it asks of the application."""
        ACTIONS[name].run(self.state)
        for request in self.state.requests:
            self._serve(request)
        self.state.requests.clear()

    def _serve(self, request: str) -> None:
        if request == "quit":
            self.done = True
        elif request == "reset camera":
            self.engine.reset_camera(self.state)
        elif request == "reload":
            if self.reopen(self._asked):
                self.state.message = "read again from disk"
        elif request == "clip":
            self._toggle_clip()
        elif request == "screenshot":
            self.screenshot(free_name(self.shots, self._stem, ".png"))
        elif request == "window screenshot":
            self.screenshot(free_name(self.shots, f"{self._stem}-window", ".png"), window=True)

    @property
    def _stem(self) -> str:
        name = "".join(c if c.isalnum() or c in "-_" else "-" for c in self.engine.feed.name) or "view"
        return f"{name}-{self.state.frame:05d}"

    def drop(self, paths: list[str]) -> None:
        """A file was dropped on the window: open it."""
        if paths:
            path = Path(paths[0])
            exr = path.is_dir() and any(path.glob("[!.]*.exr"))
            self.reopen(dataclasses.replace(self._asked, text=f"exr:{path}" if exr else str(path), reference=None))

    def screenshot(self, path: Path, window: bool = False) -> bool:
        """Save the picture, or the whole window, as PNG; whether that worked."""
        try:
            write_png(path, self.window_image() if window else self.engine.image())
        except TaubenchError as error:
            self.state.message = str(error)
            return False
        self.state.message = f"saved {path.name}"
        return True

    def window_image(self) -> np.ndarray:
        """The window as drawn, (h, w, 3) uint8, row 0 at the top; drawn anew into a framebuffer of its own."""
        width, height = (max(n, 1) for n in self.window_size)
        texture = self.gpu.ctx.texture((width, height), 4)
        framebuffer = self.gpu.ctx.framebuffer([texture])
        self.draw(framebuffer)
        self.gpu.finish()
        out = np.frombuffer(texture.read(), np.uint8).reshape(height, width, 4)[::-1, :, :3].copy()
        self.gpu.unbind_framebuffer()
        framebuffer.release()
        texture.release()
        return out

    def _toggle_clip(self) -> None:
        try:
            if self.clip is None:
                path = free_name(self.shots, self._stem, ".mp4")
                self.clip = Clip(path, self.state.size, self.state.fps)
                self.state.message = f"recording {path.name}: F9 ends it"
            else:
                self.clip.close()
                self.state.message, self.clip = f"saved {self.clip.path.name}, {self.clip.pictures} pictures", None
        except (TaubenchError, OSError) as error:
            self.state.message, self.clip = str(error), None

    # -- one frame

    def tick(self, seconds: float) -> None:
        """Let time pass, and bring the picture up to date."""
        self.state.advance(seconds)
        self.input.hold(seconds)
        self.timer.enabled = self.state.sections["time"] and self.state.panels
        try:
            self.engine.update(self.state)
        except TaubenchError as error:  # a file that vanished, a picture that does not fit: say so, stay where we were
            self.state.message, self.state.playing = str(error), False
        new = (self.engine.drawn.pictures, self.engine)
        if self.clip is not None and (self.clip.pictures == 0 or new != self._seen):
            try:
                self.clip.add(self.engine.image())
            except TaubenchError as error:
                self.state.message, self.clip = str(error), None
        self._seen = new
        if seconds > 0 and (self.state.playing or self.input.held):
            rate = 1.0 / seconds
            self.fps = rate if self.fps == 0 else self.fps + 0.1 * (rate - self.fps)

    @property
    def layout(self) -> Layout:
        return arrange(self.window_size, self.engine.feed.size, self.state.panels)

    def draw(self, framebuffer: moderngl.Framebuffer) -> None:
        """The window: picture and panels.  A window without area draws nothing."""
        width, height = self.window_size
        if width <= 0 or height <= 0:
            return
        imgui.set_current_context(self._imgui)
        io = imgui.get_io()
        io.display_size = ImVec2(width, height)
        io.display_framebuffer_scale = ImVec2(framebuffer.size[0] / width, framebuffer.size[1] / height)
        io.delta_time = 1.0 / 60.0
        layout = self.layout
        imgui.new_frame()
        self.panels.draw(layout)
        imgui.render()
        framebuffer.use()
        framebuffer.scissor = None
        framebuffer.clear(*theme.BACKGROUND, 1.0)
        self._draw_picture(framebuffer, layout)
        self._renderer.render(framebuffer)

    def _draw_picture(self, framebuffer: moderngl.Framebuffer, layout: Layout) -> None:
        left, top, width, height = layout.picture
        scale = framebuffer.size[0] / self.window_size[0]
        x, y = left * scale, (self.window_size[1] - top - height) * scale
        picture, ctx = self.engine.picture, self.gpu.ctx
        whole = (width * scale) % picture.size[0] == 0
        picture.filter = (moderngl.NEAREST, moderngl.NEAREST) if whole else (moderngl.LINEAR, moderngl.LINEAR)
        ctx.viewport = (int(x), int(y), max(int(width * scale), 1), max(int(height * scale), 1))
        ctx.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)
        picture.use(0)
        self._blit["picture"] = 0
        self._triangle.render(moderngl.TRIANGLES, vertices=3)

    def probe(self) -> Probe | None:
        """What the probe sees, asked again only when the pair or the place changed."""
        s = self.state
        if s.probe is None or self.engine.pair is None or s.freeze_current:
            return None
        key = (s.probe, self.engine.drawn.masks, self.engine.drawn.plans)
        if self._probed is None or self._probed[0] != key:
            self._probed = (key, probe_pixel(self.engine, s, *s.probe))
        return self._probed[1]

    def bench(self, frames: int, present: Callable[[], None]) -> float:
        """Median interactive frames a second while playing: every frame is drawn, judged and shown."""
        taken = []
        for i in range(frames + 3):
            start = time.perf_counter()
            s = self.state
            s.frame = s.frame + 1 if s.frame < s.last else s.first
            self.tick(0.0)
            present()
            self.gpu.finish()
            if i >= 3:  # shaders compile in the first ones
                taken.append(time.perf_counter() - start)
        return 1.0 / float(np.median(taken))

    def close(self) -> None:
        """Keep the prefs, finish what is open, free everything."""
        if self.clip is not None:
            self._toggle_clip()
        if self._folder is not None:
            prefs.save(self._folder, self.state, self.window_size if min(self.window_size) > 0 else None)
        imgui.set_current_context(self._imgui)
        self._renderer.release()
        self._triangle.release()
        self._shaders.release()
        self.engine.release()
        imgui.destroy_context(self._imgui)
