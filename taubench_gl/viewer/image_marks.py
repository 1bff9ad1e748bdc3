"""Marks over the image: the pinned pixel and its history position."""

from __future__ import annotations

import math

from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.viewer.display import ARROW_COLOR
from taubench_gl.viewer.layout import Layout
from taubench_gl.viewer.model import ViewerModel

PIXEL_COLOR, HISTORY_COLOR = (0.35, 0.85, 1.0), (1.0, 0.6, 0.2)
LEAST_SIDE = 7.0
"""Smallest side of a frame around a pixel, screen points."""


def draw_marks(viewer: ViewerModel, layout: Layout) -> None:
    """Draw everything over the images: frames around the pinned pixel, titles, and the legend of the arrows."""
    _pinned(viewer, layout)
    _titles(viewer, layout)
    if viewer.state.arrows and not viewer.state.freeze_current:
        _arrow_legend(viewer, layout)


def legend_length(px_per_point: float, wanted: float = 60.0) -> float:
    """A motion of 1, 2 or 5 times a power of ten, pixels, whose arrow is at most ``wanted`` screen points long."""
    most = wanted * px_per_point
    power = 10.0 ** math.floor(math.log10(most))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= most * (1.0 + 1e-9))


def _arrow_legend(viewer: ViewerModel, layout: Layout) -> None:
    """An arrow of known length in the lower left corner of the image."""
    left, top, width, height = layout.image
    points = viewer.engine.arrow_scale * width / viewer.engine.feed.size[0]  # per pixel of motion
    motion = legend_length(1.0 / points)
    start, end = (left + 12, top + height - 16), (left + 12 + motion * points, top + height - 16)
    lines, color = imgui.get_background_draw_list(), imgui.get_color_u32(ImVec4(*ARROW_COLOR))
    text = f"{motion:g} px"
    right = end[0] + 8 + imgui.calc_text_size(text).x
    shade = imgui.get_color_u32(ImVec4(0, 0, 0, 0.6))
    lines.add_rect_filled(ImVec2(start[0] - 6, start[1] - 12), ImVec2(right + 6, start[1] + 12), shade, 3.0)
    lines.add_line(ImVec2(*start), ImVec2(*end), color, 1.5)
    for side in (-3, 3):
        lines.add_line(ImVec2(*end), ImVec2(end[0] - 5, end[1] + side), color, 1.5)
    lines.add_text(ImVec2(end[0] + 8, end[1] - 8), color, text)


def _titles(viewer: ViewerModel, layout: Layout) -> None:
    """How light is drawn, or what an image shows, in the corner of each image and of each half of a split."""
    s, places, texts = viewer.state, list(layout.images), viewer.engine.titles(viewer.state)
    if len(texts) > len(places):
        left, top, width, height = places[0]
        at = s.split * width
        places[:1] = [(left, top, at, height), (left + at, top, width - at, height)]
    for text, (left, top, width, _) in zip(texts, places, strict=True):
        text = text or viewer.engine.lights.text(s)
        if not text or width < 40.0:
            continue
        lines, size = imgui.get_background_draw_list(), imgui.calc_text_size(text, False, width - 20.0)
        shade = imgui.get_color_u32(ImVec4(0, 0, 0, 0.6))
        lines.add_rect_filled(ImVec2(left + 6, top + 6), ImVec2(left + size.x + 18, top + size.y + 12), shade, 3.0)
        font, height = imgui.get_font(), imgui.get_font_size()
        color = imgui.get_color_u32(ImVec4(1, 1, 1, 0.9))
        lines.add_text(font, height, ImVec2(left + 12, top + 9), color, text, width - 20.0)


def _pinned(viewer: ViewerModel, layout: Layout) -> None:
    """A frame around the pinned pixel, blue, and around its history position, orange, in every image."""
    s, explained = viewer.state, viewer.probe()
    if not s.probe_pinned or explained is None:
        return
    size = viewer.engine.feed.size
    for tile, rect in enumerate(layout.images):
        side = max(rect[2] / size[0], LEAST_SIDE)
        if explained.at is not None:
            at = layout.place(*explained.at, size, tile)
            _box(at, side, HISTORY_COLOR)
            _line(at, layout.place(*explained.pixel, size, tile))
        _box(layout.place(*explained.pixel, size, tile), side, PIXEL_COLOR)


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
