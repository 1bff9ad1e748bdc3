"""Controls of the panels, whose rectangles scripts and tests look up by name."""

from __future__ import annotations

import textwrap

from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.viewer.actions import ACTIONS, chords_of
from taubench_gl.viewer.controls import Choice, Flag, Number
from taubench_gl.viewer.imgui_renderer import FAINT
from taubench_gl.viewer.layout import Rect
from taubench_gl.viewer.model import ViewerModel
from taubench_gl.viewer.state import CONTROLS

FIXED = (
    imgui.WindowFlags_.no_move.value | imgui.WindowFlags_.no_resize.value | imgui.WindowFlags_.no_collapse.value
    | imgui.WindowFlags_.no_title_bar.value | imgui.WindowFlags_.no_saved_settings.value
    | imgui.WindowFlags_.no_nav.value
)  # fmt: skip
PANEL_FLAGS = FIXED | imgui.WindowFlags_.no_background.value
"""Flags of panels without a background: the window is cleared to it, blending would cost milliseconds on a CPU."""
_FAINT = ImVec4(*FAINT, 1.0)


class Widgets:
    """Draws controls.  ``rects``: rectangle of each control drawn in this frame; ``reveal``: name of a control to
    scroll to.
    """

    def __init__(self, viewer: ViewerModel):
        self.viewer = viewer
        self.rects: dict[str, Rect] = {}
        self.reveal: str | None = None

    def place(self, name: str, slider: bool = False) -> None:
        """Record the rectangle of the last item."""
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        width = min(high.x - low.x, imgui.calc_item_width()) if slider else high.x - low.x  # excludes the label
        self.rects[name] = (low.x, low.y, width, high.y - low.y)
        if self.reveal == name:
            imgui.set_scroll_here_y(0.5)
            self.reveal = None

    def faint(self, text: str, wrap: bool = False) -> None:
        """Text in a fainter color; ``wrap``: broken at the edge of the panel."""
        imgui.push_style_color(imgui.Col_.text.value, _FAINT)
        (imgui.text_wrapped if wrap else imgui.text)(text)
        imgui.pop_style_color()

    def pair(self, name: str, text: str, column: float = 70.0) -> None:
        """A faint name, and wrapped text in a column beside it."""
        self.faint(name)
        imgui.same_line(column)
        imgui.push_text_wrap_pos(0.0)
        imgui.text_wrapped(text)
        imgui.pop_text_wrap_pos()

    def explain(self, definition: str) -> None:
        """Tooltip of the last item."""
        if imgui.is_item_hovered():
            imgui.set_tooltip(wrapped(definition))

    def percent(self, percent: float | None) -> None:
        """A share at the right end of the line of the last item."""
        text = "not measured" if percent is None else f"{percent:.2f} %"
        imgui.same_line(imgui.get_content_region_avail().x - imgui.calc_text_size(text).x)
        imgui.text(text)

    def swatch(self, name: str, color: tuple[int, int, int]) -> None:
        """A small rectangle of an 8-bit color; the next item is beside it."""
        value = ImVec4(*(c / 255.0 for c in color), 1.0)
        imgui.color_button(f"##{name}", value, imgui.ColorEditFlags_.no_tooltip.value, ImVec2(12, 18))
        imgui.same_line()

    def tip(self, action: str, definition: str = "") -> None:
        """Tooltip of the last item: the action with its keys, below the definition if there is one."""
        if imgui.is_item_hovered():
            text = f"{ACTIONS[action].doc}  [{chords_of(action)}]"
            imgui.set_tooltip(wrapped(f"{definition}\n{text}" if definition else text))

    def check(self, label: str, on: bool, action: str, name: str, definition: str = "") -> None:
        """A checkbox that shows ``on`` and runs ``action``.  ``name``: key of ``rects``; ``definition``: a tooltip."""
        changed, _ = imgui.checkbox(label, on)
        self.place(name)
        self.tip(action, definition)
        if changed:
            self.viewer.act(action)

    def draw(self, name: str, text: str = "") -> None:
        """The widget of a control.  ``text``: shown in a slider instead of its value, in printf format."""
        control, s = CONTROLS[name], self.viewer.state
        label = control.label or name.replace("_", " ")
        if isinstance(control, Flag):
            self.check(label, control.get(s), control.switch, name)
        elif isinstance(control, Choice):
            self._list(control, label)
        elif isinstance(control, Number):
            self._slider(control, f"{label}##{name}", text or control.text)

    def _slider(self, control: Number, label: str, text: str) -> None:
        """The slider of a number, which sets the value only when the user moves it: ImGui has float32 values."""
        s, (low, high) = self.viewer.state, control.slider or (control.low, control.high)
        flags = imgui.SliderFlags_.logarithmic.value if control.logarithmic else 0
        moved = imgui.slider_int if control.whole else imgui.slider_float
        changed, value = moved(label, control.get(s), low, high, text, flags)
        self.place(control.name, slider=True)
        if changed:
            control.set(s, value)

    def _list(self, control: Choice, label: str) -> None:
        s, name = self.viewer.state, control.name
        value = control.spelled(s)
        if imgui.begin_combo(f"{label}##{name}", value.replace("_", " ")):
            for choice in control.choices(s):
                if imgui.selectable(choice.replace("_", " "), choice == value)[0]:
                    control.write(s, name, choice)
                self.place(f"{name}.{choice}")
            imgui.end_combo()
        self.place(name, slider=True)


def wrapped(text: str) -> str:
    """``text`` broken into lines of at most 60 characters, for tooltips."""
    return "\n".join(textwrap.fill(line, 60) for line in text.splitlines())


def bar(x: float, y: float, width: float, height: float, color: tuple[float, ...]) -> None:
    """A filled rectangle in the current window, color (r, g, b[, a]) in [0, 1]."""
    color = (*color, 1.0) if len(color) == 3 else color
    imgui.get_window_draw_list().add_rect_filled(
        ImVec2(x, y), ImVec2(x + width, y + height), imgui.get_color_u32(ImVec4(*color))
    )
