"""The section of thresholds: a slider for each feature, with the histogram of its distances inside."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.features import FEATURE_BIT, FEATURES, TABLE
from taubench_gl.glossary import COLUMNS
from taubench_gl.metrics.counts import edges
from taubench_gl.report.palette import color_of
from taubench_gl.viewer.widgets import Widgets, bar

LEAST = 1e-4
MOST = {feature.name: feature.most for feature in TABLE if feature.most}
"""Upper end of the slider, 10 for the other features."""
HEIGHT = 30.0
_EDGES = np.append(0.0, edges())


def columns(counts: np.ndarray, high: float, width: int) -> np.ndarray:
    """Pixels per column of a logarithmic axis from LEAST to ``high``, (width,) float64.

    ``counts``: (HISTOGRAM_BINS,) pixels per bin of distance; a bin is spread over the columns that it covers.
    Distances below LEAST are in the first column, those above ``high`` in the last.
    """
    total = np.zeros(len(counts) + 1)
    np.cumsum(counts, out=total[1:])
    inner = np.interp(np.arange(1, width), _places(high, width), total)
    return np.diff(inner, prepend=0.0, append=total[-1])


@lru_cache(maxsize=16)
def _places(high: float, width: int) -> np.ndarray:
    """Edges of the bins on the axis of ``columns``, (HISTOGRAM_BINS + 1,) columns."""
    with np.errstate(divide="ignore"):
        at = np.log(np.append(_EDGES, np.inf) / LEAST) / math.log(high / LEAST) * width
    return np.clip(at, 0.0, width)


class ThresholdsPanel:
    """Draws the section."""

    def __init__(self, ui: Widgets):
        self._ui = ui

    def draw(self) -> None:
        engine = self._ui.viewer.engine
        width = imgui.get_content_region_avail().x - 66.0
        for feature in FEATURES:
            if feature not in engine.feed.source.unmeasured:
                self._feature(feature, width)

    def _feature(self, feature: str, width: float) -> None:
        s, engine = self._ui.viewer.state, self._ui.viewer.engine
        high = MOST.get(feature, 10.0)
        corner = imgui.get_cursor_screen_pos()
        bar(corner.x, corner.y, width, HEIGHT, (0.195, 0.205, 0.224))  # the slider has no background of its own
        _histogram(engine.histograms.get(feature), feature, s.thresholds[feature], high, (corner.x, corner.y, width))
        for name in ("frame_bg", "frame_bg_hovered", "frame_bg_active"):
            imgui.push_style_color(getattr(imgui.Col_, name).value, ImVec4(0.0, 0.0, 0.0, 0.0))
        imgui.push_style_var(imgui.StyleVar_.frame_padding.value, ImVec2(8, (HEIGHT - imgui.get_font_size()) / 2))
        imgui.set_next_item_width(width)
        changed, value = imgui.slider_float(
            f"{feature}##threshold", s.thresholds[feature], LEAST, high, f"%.4f{s.unit(feature)}",
            imgui.SliderFlags_.logarithmic.value,
        )  # fmt: skip
        imgui.pop_style_var()
        imgui.pop_style_color(3)
        imgui.push_item_width(width)
        self._ui.place(f"threshold.{feature}", slider=True)
        imgui.pop_item_width()
        self._ui.explain(COLUMNS[feature].tooltip)
        if changed:
            s.feature = feature
            s.set_threshold(feature, value)


def _histogram(counts: np.ndarray | None, feature: str, limit: float, high: float, place: tuple[float, ...]) -> None:
    """Bars of a logarithmic number of pixels: those above the threshold in the color of the feature's mask."""
    if counts is None or not counts.any():
        return
    x, y, width = place
    many = columns(counts, high, int(width) // 3)
    heights = np.log1p(many) / np.log1p(many.max())
    cut = math.log(max(limit, LEAST) / LEAST) / math.log(high / LEAST) * len(many)
    over = imgui.get_color_u32(ImVec4(*(c / 255.0 for c in color_of(FEATURE_BIT[feature])), 0.85))
    under, lines = imgui.get_color_u32(ImVec4(0.42, 0.44, 0.48, 0.7)), imgui.get_window_draw_list()
    smooth = lines.flags
    lines.flags = 0  # upright edges between pixels: smoothing them would take five times the triangles
    for i, height in enumerate(heights.tolist()):
        if height > 0.0:
            low, high_end = ImVec2(x + 3 * i, y + HEIGHT * (1.0 - height)), ImVec2(x + 3 * i + 2.0, y + HEIGHT)
            lines.add_rect_filled(low, high_end, over if i + 0.5 >= cut else under)
    lines.flags = smooth
