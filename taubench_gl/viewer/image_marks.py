"""Marks over the image: the pinned pixel and its history position."""

from __future__ import annotations

from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.viewer.layout import Layout
from taubench_gl.viewer.model import ViewerModel

PIXEL_COLOR, HISTORY_COLOR = (0.35, 0.85, 1.0), (1.0, 0.6, 0.2)
LEAST_SIDE = 7.0


def draw_marks(viewer: ViewerModel, layout: Layout) -> None:
    """A frame around the pinned pixel, blue, and around its history position, orange, in every image."""
    s, found = viewer.state, viewer.probe()
    if not s.probe_pinned or found is None:
        return
    size = viewer.engine.feed.size
    for tile, rect in enumerate(layout.images):
        side = max(rect[2] / size[0], LEAST_SIDE)
        if found.at is not None:
            at = layout.place(*found.at, size, tile)
            _box(at, side, HISTORY_COLOR)
            _line(at, layout.place(*found.pixel, size, tile))
        _box(layout.place(*found.pixel, size, tile), side, PIXEL_COLOR)


def _box(at: tuple[float, float], side: float, color: tuple[float, float, float]) -> None:
    low, high = (ImVec2(at[0] + f * side / 2, at[1] + f * side / 2) for f in (-1, 1))
    lines = imgui.get_background_draw_list()
    lines.add_rect(
        ImVec2(low.x - 1, low.y - 1), ImVec2(high.x + 1, high.y + 1), imgui.get_color_u32(ImVec4(0, 0, 0, 1))
    )
    lines.add_rect(low, high, imgui.get_color_u32(ImVec4(*color, 1.0)), 0.0, 2.0)


def _line(start: tuple[float, float], end: tuple[float, float]) -> None:
    color = imgui.get_color_u32(ImVec4(*HISTORY_COLOR, 0.8))
    imgui.get_background_draw_list().add_line(ImVec2(*start), ImVec2(*end), color, 1.0)
