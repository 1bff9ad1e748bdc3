"""The window of a viewer session: GLFW callbacks become events of the viewer, its context becomes a Gpu."""

from __future__ import annotations

import ctypes
import gc
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import glfw
import moderngl

from taubench_gl.errors import GraphicsError
from taubench_gl.gpu.context import Gpu, adopt_context
from taubench_gl.viewer import prefs
from taubench_gl.viewer.app import Viewer
from taubench_gl.viewer.feeds import OpenRequest
from taubench_gl.viewer.layout import script_size, start_size
from taubench_gl.viewer.script import ScriptRunner, parse

MIN_SIZE = (320, 200)
MARGIN = 40  # screen points left free beside a new window
TITLE = "taubench-gl"


class Window:
    """A window with an OpenGL 4.5 core context, current in this thread.  Raises GraphicsError without a display."""

    def __init__(self, size: tuple[int, int], *, vsync: bool = True):
        self._errors: list[str] = []
        self._title = TITLE
        glfw.set_error_callback(lambda code, text: self._errors.append(text.decode(errors="replace")))
        if not glfw.init():
            raise GraphicsError(f"no window can be opened: {self._why('there is no display')}", hint=_NO_DISPLAY)
        for hint, value in (
            (glfw.CONTEXT_VERSION_MAJOR, 4), (glfw.CONTEXT_VERSION_MINOR, 5),
            (glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE), (glfw.OPENGL_FORWARD_COMPAT, True), (glfw.SAMPLES, 0),
            (glfw.DEPTH_BITS, 0),
        ):  # fmt: skip
            glfw.window_hint(hint, value)
        self.handle = glfw.create_window(*_fitting(size), TITLE, None, None)
        if not self.handle:
            glfw.terminate()
            raise GraphicsError(f"no window can be opened: {self._why('no OpenGL 4.5')}", hint=_NO_DISPLAY)
        glfw.make_context_current(self.handle)
        glfw.swap_interval(1 if vsync else 0)
        self._size = glfw.get_framebuffer_size(self.handle)  # asking in each frame would wait for the window system
        glfw.set_framebuffer_size_callback(self.handle, lambda _, w, h: setattr(self, "_size", (w, h)))
        glfw.set_window_size_limits(self.handle, *MIN_SIZE, glfw.DONT_CARE, glfw.DONT_CARE)
        try:
            keep = _WindowContext(self.handle)
            self.gpu: Gpu = adopt_context(moderngl.create_context(context=keep), "window", _address, keep)
        except Exception as error:  # drivers and loaders raise errors of any type
            self.close()
            raise GraphicsError(
                f"the window's OpenGL cannot be used: {error}", hint="see 'taubench-gl doctor'"
            ) from None

    def _why(self, otherwise: str) -> str:
        return self._errors[-1] if self._errors else otherwise

    def attach(self, viewer: Viewer) -> None:
        """Forward the events of this window to ``viewer``."""
        events, handle = viewer.input, self.handle
        events.resize(*glfw.get_window_size(handle))
        glfw.set_window_size_callback(handle, lambda _, w, h: events.resize(w, h))
        glfw.set_window_iconify_callback(
            handle, lambda _, gone: events.resize(*((0, 0) if gone else glfw.get_window_size(handle)))
        )
        glfw.set_window_focus_callback(handle, lambda _, has: None if has else events.lose_focus())
        glfw.set_cursor_pos_callback(handle, lambda _, x, y: events.mouse_move(x, y))
        glfw.set_mouse_button_callback(handle, lambda _, b, action, mods: events.mouse_button(b, action == glfw.PRESS))
        glfw.set_scroll_callback(handle, lambda _, dx, dy: events.scroll(dx, dy))
        glfw.set_char_callback(handle, lambda _, code: events.char(code))
        glfw.set_drop_callback(handle, lambda _, paths: viewer.drop(list(paths)))
        glfw.set_key_callback(handle, lambda _, key, code, action, mods: _key(viewer, key, action, mods))

    def run(self, viewer: Viewer) -> None:
        """Run until the window is closed; waits for events while nothing moves."""
        last = time.perf_counter()
        while not (viewer.done or glfw.window_should_close(self.handle)):
            busy = viewer.busy or viewer.input.held
            glfw.poll_events() if busy else glfw.wait_events_timeout(0.25)
            now = time.perf_counter()
            viewer.tick(min(now - last, 0.25))
            last = now
            self.present(viewer)

    def step(self, viewer: Viewer) -> None:
        """Process pending events, then show a frame."""
        glfw.poll_events()
        self.present(viewer)

    def resize(self, width: int, height: int) -> tuple[int, int]:
        """Request a size, wait for the window system, return the actual size.  Restores a minimized window."""
        glfw.restore_window(self.handle)
        glfw.set_window_size(self.handle, width, height)
        for _ in range(50):
            glfw.wait_events_timeout(0.02)
            if glfw.get_window_size(self.handle) == (width, height):
                break
        return glfw.get_window_size(self.handle)

    def present(self, viewer: Viewer) -> None:
        """Draw and show one frame."""
        if min(viewer.window_size) <= 0:
            return
        title = f"{viewer.engine.feed.name} - {TITLE}"
        if title != self._title:
            glfw.set_window_title(self.handle, title)
            self._title = title
        framebuffer = self.gpu.ctx.detect_framebuffer(0)
        framebuffer.viewport = (0, 0, *self._size)
        viewer.draw(_Screen(framebuffer, self._size))
        self.gpu.flush()
        viewer.engine.prepare(viewer.state)
        glfw.swap_buffers(self.handle)

    def close(self) -> None:
        """Destroy the window and end the window library."""
        glfw.destroy_window(self.handle)
        glfw.terminate()


_NO_DISPLAY = "run it on a desktop, or under xvfb-run; 'evaluate' needs no display"


def _size_of(session: Session) -> tuple[int, int]:
    """Size of the window: the given one, the stored one, or one for the image.  Screen points."""
    stored = prefs.load(session.folder)[0].window if session.folder is not None else None
    sequence = session.request.settings.sequence
    for_image = start_size if session.script is None else script_size
    return session.window or stored or for_image((sequence.width, sequence.height))


class _Screen:
    """The default framebuffer with its size, which moderngl does not know."""

    def __init__(self, framebuffer: moderngl.Framebuffer, size: tuple[int, int]):
        self._framebuffer, self.size = framebuffer, size

    def __getattr__(self, name: str) -> object:
        return getattr(self._framebuffer, name)

    @property
    def scissor(self) -> object:
        return self._framebuffer.scissor

    @scissor.setter
    def scissor(self, value: tuple[int, int, int, int] | None) -> None:
        self._framebuffer.scissor = value


def _fitting(size: tuple[int, int]) -> tuple[int, int]:
    """The size of a new window, ``size`` where the monitor is large enough for it; screen points."""
    monitor = glfw.get_primary_monitor()
    if not monitor:
        return size
    _, _, width, height = glfw.get_monitor_workarea(monitor)
    fits = (
        size[0] if width <= 0 else min(size[0], width - MARGIN),
        size[1] if height <= 0 else min(size[1], height - MARGIN),
    )
    return max(fits[0], MIN_SIZE[0]), max(fits[1], MIN_SIZE[1])


class _WindowContext:
    """The context of the window in the interface that moderngl expects, for any window system."""

    def __init__(self, handle: object):
        self._handle = handle

    def load_opengl_function(self, name: str) -> int:
        """Address of a GL function, 0 if unknown; moderngl calls this."""
        return _address(name)

    load = load_opengl_function

    def __enter__(self) -> _WindowContext:
        glfw.make_context_current(self._handle)
        return self

    def __exit__(self, *exc: object) -> None:
        pass

    def release(self) -> None:
        pass


def _address(name: str) -> int:
    return ctypes.cast(glfw.get_proc_address(name), ctypes.c_void_p).value or 0


_NAMES = {
    value: name.removeprefix("KEY_")
    for name, value in vars(glfw).items()
    if name.startswith("KEY_") and isinstance(value, int) and name not in ("KEY_LAST", "KEY_UNKNOWN")
}


def _key(viewer: Viewer, key: int, action: int, mods: int) -> None:
    if key in _NAMES:
        viewer.input.key(
            _NAMES[key],
            action != glfw.RELEASE,
            ctrl=bool(mods & glfw.MOD_CONTROL),
            alt=bool(mods & glfw.MOD_ALT),
            shift=bool(mods & glfw.MOD_SHIFT),
        )


@dataclass(frozen=True, slots=True)
class Session:
    """Options of a viewer session, which a user or a script drives.

    ``window``: size in screen points, None for a fitting one; ``screenshots``: folder of screenshots and clips;
    ``folder``: where preferences are stored, None for nowhere; ``report`` prints a line.
    """

    request: OpenRequest
    light: bool | None = None
    window: tuple[int, int] | None = None
    screenshots: Path = Path(".")
    script: Path | None = None
    folder: Path | None = None
    report: Callable[[str], None] = print


def run_session(session: Session) -> None:
    """Run until the user or the script ends.  Raises TaubenchError."""
    lines = parse(session.script) if session.script is not None else None
    window = Window(_size_of(session), vsync=lines is None)
    viewer = None
    try:
        with window.gpu:
            gc.freeze()  # libraries and shaders stay: looking at them again and again takes 1 ms a frame
            viewer = Viewer(window.gpu, session.request, light=session.light, folder=session.folder)
            viewer.screenshots = session.screenshots
            window.attach(viewer)
            if lines is not None:
                ScriptRunner(viewer, lambda: window.step(viewer), window.resize, session.report).run(lines)
            else:
                window.run(viewer)
            window.gpu.check("the viewer")
    finally:
        gc.unfreeze()
        with window.gpu:
            if viewer is not None:
                viewer.close()
        window.close()
