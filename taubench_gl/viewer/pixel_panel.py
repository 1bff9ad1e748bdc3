"""The section of the probe: one pixel of three images magnified, its names, its distances and why it is discarded."""

from __future__ import annotations

from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.evaluation.explain import Explanation, FeatureValues
from taubench_gl.features import FEATURE_BIT
from taubench_gl.report.palette import color_of
from taubench_gl.viewer.display import TILES
from taubench_gl.viewer.image_marks import HISTORY_COLOR, PIXEL_COLOR
from taubench_gl.viewer.widgets import Widgets, bar

MARK = {"previous": HISTORY_COLOR, "reprojected": PIXEL_COLOR, "current": PIXEL_COLOR}
GAP = 5.0
REACH = 2.0
"""Right end of a distance bar, in thresholds: the threshold is in the middle."""


class PixelPanel:
    """Draws the section of the probe."""

    def __init__(self, ui: Widgets):
        self._ui = ui

    def draw(self) -> None:
        viewer, s = self._ui.viewer, self._ui.viewer.state
        explained = viewer.probe()
        self._ui.check("pin", s.probe_pinned, "pin probe", "probe_pinned")
        imgui.same_line()
        if explained is None:
            self._ui.faint("click a pixel of the image")
            return
        imgui.text(f"pixel {explained.pixel[0]}, {explained.pixel[1]}")
        if s.probe_pinned:
            self._strip(explained)
        imgui.text_wrapped(explained.reason)
        exact = viewer.engine.exact_words(*explained.pixel) if s.exact else None
        if exact is not None:
            self._ui.pair("exact", exact)
        reservoir = viewer.engine.reservoir_words(s, *explained.pixel)
        if reservoir is not None:
            self._ui.pair("reservoir", reservoir)
        self._names(explained)
        for name, values in explained.features.items():
            self._feature(name, values)

    def _strip(self, explained: Explanation) -> None:
        """The three magnified images side by side, with the pixel marked in each."""
        viewer, s = self._ui.viewer, self._ui.viewer.state
        texture = viewer.engine.magnify(s, explained)
        side = int((imgui.get_content_region_avail().x - GAP * (len(TILES) - 1)) / len(TILES))
        corner = imgui.get_cursor_screen_pos()
        for i, name in enumerate(TILES):
            x = corner.x + i * (side + GAP)
            imgui.set_cursor_screen_pos(ImVec2(x, corner.y))
            low, high = i / len(TILES), (i + 1) / len(TILES)
            imgui.image(imgui.ImTextureRef(texture.glo), ImVec2(side, side), ImVec2(low, 1), ImVec2(high, 0))
            self._ui.place(f"tile.{name}")
            if name != "previous" or explained.at is not None:
                _mark(x, corner.y, side, s.magnified, MARK[name])
            imgui.set_cursor_screen_pos(ImVec2(x, corner.y + side + 2))
            self._ui.faint(name)
        text = f"{s.magnified} x {s.magnified}"
        changed, half = imgui.slider_int("pixels", s.magnified // 2, 1, 30, text)
        self._ui.place("magnified", slider=True)
        if changed:
            s.magnified = 2 * half + 1

    def _names(self, explained: Explanation) -> None:
        where = "none" if explained.at is None else f"{explained.at[0]:.2f}, {explained.at[1]:.2f}"
        self._ui.pair("history", f"{where}  ({explained.motion_px[0]:+.2f}, {explained.motion_px[1]:+.2f} px)")
        if explained.vector_px is not None:
            self._ui.pair("file's vector", f"{explained.vector_px[0]:+.2f}, {explained.vector_px[1]:+.2f} px")
        names = self._ui.viewer.probe_names()
        if names is not None:
            self._ui.pair("object", names.object)
            self._ui.pair("material", names.material)

    def _feature(self, name: str, f: FeatureValues) -> None:
        """The distance as a bar against the threshold, and both values below."""
        unit = self._ui.viewer.state.unit(name)
        text = "not compared" if f.distance is None else f"{f.distance:.4g} of {f.threshold:.4g}{unit}"
        right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
        imgui.text(name)
        imgui.same_line(right - imgui.calc_text_size(text).x)
        imgui.text(text)
        corner, width = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail().x
        bar(corner.x, corner.y, width, 8.0, (0.17, 0.18, 0.20))
        if f.distance is not None:
            color = tuple(c / 255.0 for c in color_of(FEATURE_BIT[name])) if f.discarded else (0.45, 0.48, 0.52)
            bar(corner.x, corner.y, width * bar_share(f.distance, f.threshold), 8.0, color)
        bar(corner.x + width / REACH - 1.0, corner.y - 2.0, 2.0, 12.0, (0.95, 0.95, 0.95))
        imgui.dummy(ImVec2(width, 9.0))
        self._ui.place(f"bar.{name}")
        self._ui.faint(f"current {_triple(f.current)}")
        if f.history is not None:
            self._ui.faint(f"history {_triple(f.history)}")


def bar_share(distance: float, threshold: float) -> float:
    """Length of a distance bar as a share of its full length; full from REACH thresholds on."""
    return min(distance / (REACH * threshold), 1.0) if threshold > 0.0 else float(distance > 0.0)


def _mark(x: float, y: float, side: float, pixels: int, color: tuple[float, float, float]) -> None:
    """A frame around the middle pixel of a magnified image."""
    size = side / pixels
    low = ImVec2(x + size * (pixels // 2), y + size * (pixels // 2))
    line = imgui.get_color_u32(ImVec4(*color, 1.0))
    imgui.get_window_draw_list().add_rect(low, ImVec2(low.x + size, low.y + size), line, 0.0, 2.0)


def _triple(values: object) -> str:
    return " ".join(f"{float(v):.4g}" for v in values)  # type: ignore[attr-defined]
