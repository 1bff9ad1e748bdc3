"""A dark, quiet look: greys, one accent, no borders where space will do."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from imgui_bundle import ImVec2, ImVec4, imgui

FONT_PX = 15.0
ACCENT = (0.34, 0.71, 0.91)
TEXT, FAINT, PANEL, FIELD = (0.86, 0.87, 0.89), (0.52, 0.54, 0.58), (0.105, 0.11, 0.12), (0.17, 0.18, 0.20)
BACKGROUND = (0.06, 0.063, 0.07)


def apply() -> None:
    """Colours, spacing and font of the current ImGui context."""
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
        (col.header, PANEL, 1), (col.header_hovered, FIELD, 1), (col.header_active, lighter, 1),
        (col.slider_grab, ACCENT, 0.45), (col.slider_grab_active, ACCENT, 1), (col.check_mark, ACCENT, 1),
        (col.separator, FIELD, 1), (col.scrollbar_bg, PANEL, 1), (col.scrollbar_grab, FIELD, 1),
        (col.plot_histogram, ACCENT, 0.8),
    ):  # fmt: skip
        style.set_color_(name.value, ImVec4(*color, alpha))
    _font()


def _font() -> None:
    """The bundle's Roboto, or ImGui's own font where it is not there."""
    found = importlib.util.find_spec("imgui_bundle")
    fonts = Path(found.origin).parent / "assets" / "fonts" if found and found.origin else Path()
    path = next((p for p in (fonts / "Roboto" / "Roboto-Regular.ttf", fonts / "DroidSans.ttf") if p.is_file()), None)
    if path is not None:
        imgui.get_io().fonts.add_font_from_file_ttf(str(path), FONT_PX)
