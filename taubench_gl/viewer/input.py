"""Mouse and keyboard: events that the panels do not use move cameras, the split line and the probe."""

from __future__ import annotations

import math

from imgui_bundle import imgui

from taubench_gl.viewer.actions import KEYS, MOVEMENT, chord
from taubench_gl.viewer.model import ViewerModel

SPLIT_REACH = 8.0
"""Distance from the split line, screen points, within which it can be dragged."""
CLICK_REACH = 3.0
"""Screen points that the mouse may move between press and release of a click."""
_EDIT = ("BACKSPACE", "ENTER", "LEFT_ARROW", "RIGHT_ARROW", "TAB", "ESCAPE")


ANSWERED = 8
"""Number of frames after an event in which the panels are composed again."""


class Input:
    """Handlers of window events.  Positions are screen points, y down."""

    def __init__(self, viewer: ViewerModel):
        self._viewer = viewer
        self.mouse = (-1.0, -1.0)
        self.held: set[str] = set()
        self._drag: str | None = None
        self._pressed_at: tuple[float, float] | None = None  # on the image
        self.answers = 0  # frames in which the panels still answer to events

    def _events(self) -> imgui.IO:
        """ImGui's queue of events, which it spreads over several frames: the panels answer in all of them."""
        self.answers = ANSWERED
        return imgui.get_io()

    def resize(self, width: int, height: int) -> None:
        """The window has a new size; 0 x 0 while it is minimized."""
        self._viewer.window_size = (max(width, 0), max(height, 0))

    def mouse_move(self, x: float, y: float) -> None:
        """The mouse is at a window position: drag the split line or the camera, move the probe."""
        viewer, s = self._viewer, self._viewer.state
        dx, dy = x - self.mouse[0], y - self.mouse[1]
        self.mouse = (x, y)
        self._events().add_mouse_pos_event(x, y)
        pixel = viewer.layout.pixel(x, y, viewer.engine.feed.size)
        if self._drag == "split":
            left, _, width, _ = viewer.layout.image
            s.split = min(max((x - left) / max(width, 1), 0.0), 1.0)
        elif self._drag == "camera" and s.camera == "fly":
            viewer.engine.user.look(dx, dy)
        elif self._drag == "camera" and s.camera == "orbit":
            viewer.engine.user.turn_about(dx, dy)
        if not s.probe_pinned:
            s.probe = pixel

    def mouse_button(self, button: int, pressed: bool) -> None:
        """A mouse button was pressed, or released.  ``button``: 0 left, 1 right, 2 middle."""
        self._events().add_mouse_button_event(button, pressed)
        if not pressed and self._drag == "camera":
            self._click(button)
        self._drag = None
        if pressed and self._on_image():
            self._drag, self._pressed_at = "split" if self._on_split() else "camera", self.mouse

    def _click(self, button: int) -> None:
        """Pin the pixel under the mouse, or release the pinned one; with the right button select the node there."""
        viewer, s = self._viewer, self._viewer.state
        if math.dist(self.mouse, self._pressed_at) > CLICK_REACH:
            return
        pixel = viewer.layout.pixel(*self.mouse, viewer.engine.feed.size)
        if button == 1:
            s.pick = pixel
        elif pixel is not None and button == 0:
            s.probe_pinned = not (s.probe_pinned and s.probe == pixel)
            s.probe = pixel

    def scroll(self, dx: float, dy: float) -> None:
        """The wheel turned by ``dy`` steps: zoom the orbit camera."""
        self._events().add_mouse_wheel_event(dx, dy)
        if self._on_image() and self._viewer.state.camera == "orbit":
            self._viewer.engine.user.zoom(dy)

    def char(self, code: int) -> None:
        """A character was typed; ``code``: its Unicode number."""
        self._events().add_input_character(code)

    def key(self, name: str, pressed: bool, *, ctrl: bool = False, alt: bool = False, shift: bool = False) -> None:
        """A key was pressed, or released.  ``name``: of GLFW, without KEY_. A key repeat counts as a press."""
        self._forward_key(name, pressed, ctrl, shift)
        if not pressed:
            self.held.discard(name)
            return
        if not ctrl:
            self.held.add(name)
        if imgui.get_io().want_text_input:
            return
        name = {"KP_ENTER": "ENTER", "KP_SUBTRACT": "MINUS", "KP_ADD": "EQUAL"}.get(name, name)
        action = KEYS.get(chord(name, ctrl=ctrl, alt=alt, shift=shift))
        if action is not None:
            self._viewer.act(action)

    def lose_focus(self) -> None:
        """Release all keys: a window without focus gets no release events."""
        self.held.clear()
        self._drag = None

    @property
    def moves_camera(self) -> bool:
        """Whether held keys or a drag move a camera now."""
        return self._viewer.state.camera != "file" and bool(self.held & MOVEMENT or self._drag == "camera")

    def move_camera(self, seconds: float) -> None:
        """Move the camera by the held keys for ``seconds``."""
        s, keys = self._viewer.state, self.held & MOVEMENT
        if not keys or s.camera == "file" or imgui.get_io().want_text_input:
            return
        fast = {"SHIFT"} if self.held & {"LEFT_SHIFT", "RIGHT_SHIFT", "SHIFT"} else set()
        self._viewer.engine.user.move(keys | fast, min(seconds, 0.1), s.camera)

    def _on_image(self) -> bool:
        viewer = self._viewer
        return viewer.layout.pixel(*self.mouse, viewer.engine.feed.size) is not None and not viewer.state.help

    def _on_split(self) -> bool:
        s = self._viewer.state
        left, _, width, _ = self._viewer.layout.image
        return s.comparison == "split" and abs(self.mouse[0] - left - s.split * width) <= SPLIT_REACH

    def _forward_key(self, name: str, pressed: bool, ctrl: bool, shift: bool) -> None:
        io = self._events()
        io.add_key_event(imgui.Key.mod_ctrl, ctrl)
        io.add_key_event(imgui.Key.mod_shift, shift)
        other = {"LEFT": "left_arrow", "RIGHT": "right_arrow"}.get(name, name.lower())
        if other.upper() in _EDIT and hasattr(imgui.Key, other):
            io.add_key_event(getattr(imgui.Key, other), pressed)
