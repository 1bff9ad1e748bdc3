"""The panels.  Controls change the state, numbers come from the engine; tooltips are those of actions and glossary."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.animation import OrbitCamera
from taubench_gl.features import FEATURE_BIT, FEATURES, TABLE
from taubench_gl.glossary import COLUMNS, CONCEPTS, EXACT_REASONS, OPTIONS, REASONS, STATISTICS, label_of
from taubench_gl.metrics.counts import edges
from taubench_gl.metrics.reuse_rate import RATES
from taubench_gl.report.labels import lighting_text
from taubench_gl.report.palette import EXACT_COLORS, color_of
from taubench_gl.settings import Settings
from taubench_gl.viewer.actions import help_lines, key_words
from taubench_gl.viewer.display import OUTLINE_COLOR, VISUALIZATIONS
from taubench_gl.viewer.feeds import Feed
from taubench_gl.viewer.image_marks import draw_marks
from taubench_gl.viewer.imgui_renderer import ACCENT
from taubench_gl.viewer.layout import Layout, Rect
from taubench_gl.viewer.model import ViewerModel
from taubench_gl.viewer.pixel_panel import PixelPanel
from taubench_gl.viewer.scene_tree import SceneTree
from taubench_gl.viewer.state import CAMERAS, CONTROLS, EXACT_OVERLAYS, LEFT, OVERLAYS, RIGHT, ViewerState
from taubench_gl.viewer.timeline import Timeline
from taubench_gl.viewer.widgets import FIXED, PANEL_FLAGS, Widgets, bar

SCORES = {
    "wrongly_reused_percent": "wrongly reused, % of pixels",
    "bound_linear_mse": "bound, linear MSE",
    "headroom_db": "headroom, dB",
}
"""Column of ``reuse evaluate`` -> its label in the section compare."""


class Panels:
    """Draws everything except the image.  ``widgets``: rectangle of each control, for scripts."""

    def __init__(self, viewer: ViewerModel):
        self._viewer = viewer
        self._ui = Widgets(viewer)
        self._pixel = PixelPanel(self._ui)
        self._lighting: tuple[Settings | None, str] = (None, "")  # settings and what their light is in words
        self._before: dict[str, Callable[[], None]] = {
            "camera": self._camera, "image": self._channels, "compare": lambda: self._ui.draw("against"),
            "masks": self._reusable, "thresholds": self._thresholds, "probe": self._pixel.draw,
            "effects": self._effects, "time": self._time, "lesson": self._lesson, "scene": ScenePanel(self._ui).draw,
        }  # fmt: skip
        """Section -> function that draws what comes before the widgets of its controls."""
        self._after: dict[str, Callable[[], None]] = {
            "freeze_current": imgui.same_line, "auto_range": self._range, "arrows": self._arrow_scale,
            "method_image": self._scores, "flicker_hz": self._flickering, "overlays": self._opacity,
            "exact": self._legend, "samples": self._size,
        }  # fmt: skip
        """Control -> function that draws what follows its widget."""

    @property
    def widgets(self) -> dict[str, Rect]:
        """Name -> rectangle (x, y, width, height) of each control drawn in the last frame, screen points."""
        return self._ui.rects

    def reveal(self, name: str) -> None:
        """Scroll the panel so that the control ``name`` is in view, when panels are drawn next."""
        self._ui.reveal = name

    def draw(self, layout: Layout) -> None:
        """Draw panels, help and the marks over the images."""
        self._ui.rects.clear()
        lesson = LEFT if self._viewer.state.lesson else tuple(name for name in LEFT if name != "lesson")
        for side, rect, names in (("left", layout.left, lesson), ("right", layout.right, RIGHT)):
            if rect is not None:
                every = (*lesson, *RIGHT) if layout.merged else names
                self._window(side, rect, lambda every=every: self._sections(every))
        if layout.bar is not None:
            self._window("bar", layout.bar, self._bar)
        if self._viewer.state.help:
            self._help()
        else:
            draw_marks(self._viewer, layout)

    def _window(self, name: str, rect: Rect, body: Callable[[], None]) -> None:
        imgui.set_next_window_pos(ImVec2(rect[0], rect[1]))
        imgui.set_next_window_size(ImVec2(rect[2], rect[3]))
        imgui.begin(name, None, PANEL_FLAGS)
        body()
        imgui.end()

    def _sections(self, names: tuple[str, ...]) -> None:
        state = self._viewer.state
        for name in names:
            imgui.set_next_item_open(state.sections[name])
            state.sections[name] = imgui.collapsing_header(name.capitalize())
            self._ui.place(f"section.{name}")
            if state.sections[name]:
                imgui.push_item_width(150)
                self._body(name)
                imgui.pop_item_width()
                imgui.dummy(ImVec2(0, 3))

    def _body(self, section: str) -> None:
        if section in self._before:
            self._before[section]()
        for control in CONTROLS.values():
            if control.section == section and control.visible(self._viewer.state):
                self._ui.draw(control.name)
                if control.name in self._after:
                    self._after[control.name]()

    def _bar(self) -> None:
        viewer, s = self._viewer, self._viewer.state
        draw_timeline(self._ui, viewer.timeline)
        for label, action in (("|<", "first"), ("<", "previous"), ("Pause" if s.playing else "Play", "play"),
                              (">", "next"), (">|", "last")):  # fmt: skip
            if imgui.button(label, ImVec2(56 if action == "play" else 0, 0)):
                viewer.act(action)
            self._ui.place(f"button.{action}")
            self._ui.tip(action)
            imgui.same_line()
        width = imgui.get_content_region_avail().x
        imgui.set_next_item_width(max(width, 40.0))
        changed, frame = imgui.slider_int("##frame", s.frame, s.first, s.last, f"frame %d of {s.last}")
        self._ui.place("frame")
        if changed:
            s.playing = False
            s.go_to(frame)
        low, high = s.range
        loop = f"loop {low}-{high}   " if s.loop is not None else ""
        speed = "" if s.speed == 1.0 else f"speed {s.speed:g}   "
        rate, percent, _ = viewer.engine.reusable()
        label = "reusable" if rate == "shading" else f"reusable {rate}"
        reusable = "" if percent is None else f"{label} {percent:.1f} % of surface pixels   "
        at = f"{s.frame / s.fps:.3f} s at {s.fps:g} fps"
        self._ui.faint(f"{at}   {reusable}{speed}{loop}")
        self._ui.faint(s.message or viewer.hint, wrap=True)

    def _lesson(self) -> None:
        """The text of a session file: its title, then its paragraphs."""
        title, *paragraphs = self._viewer.state.lesson.splitlines()
        imgui.push_text_wrap_pos(0.0)
        imgui.text_colored(ImVec4(*ACCENT, 1.0), title)
        for paragraph in filter(None, paragraphs):
            if paragraph.startswith("- "):
                imgui.bullet()
            imgui.text_wrapped(paragraph.removeprefix("- "))
        imgui.pop_text_wrap_pos()

    def _camera(self) -> None:
        s = self._viewer.state
        for i, mode in enumerate(CAMERAS):
            if i:
                imgui.same_line()
            if imgui.radio_button(self._camera_label(mode), s.camera == mode):
                self._viewer.act("file camera" if mode == "file" else mode)
            self._ui.place(f"camera.{mode}")

    def _camera_label(self, mode: str) -> str:
        """Text beside the radio button of a camera; a file without a camera is seen from an orbit that frames it."""
        framing = isinstance(getattr(self._viewer.engine.feed, "camera", None), OrbitCamera)
        return "framing orbit" if mode == "file" and framing else mode

    def _channels(self) -> None:
        s = self._viewer.state
        if imgui.begin_combo("channel", s.channel.replace("_", " ")):
            for name in s.channels:
                if imgui.selectable(f"{name.replace('_', ' ')}  ({VISUALIZATIONS[name].doc})", name == s.channel)[0]:
                    s.channel = name
            imgui.end_combo()
        self._ui.place("channel")

    def _range(self) -> None:
        s = self._viewer.state
        imgui.same_line()
        step = max((s.high - s.low) * 0.01, 1e-4)
        changed, low, high = imgui.drag_float_range2("range", s.low, s.high, step, 0, 0, "%.3g", "%.3g")
        self._ui.place("range")
        if changed:
            s.set_range(low, high)

    def _arrow_scale(self) -> None:
        s = self._viewer.state
        if s.arrows:
            fitting = f"fitting: {self._viewer.engine.arrow_scale:.3g} x"
            self._ui.draw("arrow_scale", "" if s.arrow_scale else fitting)

    def _scores(self) -> None:
        self._ui.faint("results are colors: show the channel color", wrap=True)
        scores = self._viewer.engine.method_scores(self._viewer.state)
        for name, label in SCORES.items():
            if (value := scores.get(name)) is not None:
                self._ui.pair(label, f"{value:.4g}", 190.0)

    def _flickering(self) -> None:
        s = self._viewer.state
        self._ui.faint(f"shown: {s.against if s.flicker_other else 'this image'}")

    def _opacity(self) -> None:
        imgui.same_line()
        self._ui.draw("opacity")

    def _legend(self) -> None:
        """The masks or exact reasons with their shares."""
        s, percentages = self._viewer.state, self._viewer.engine.percentages()
        self._ui.faint("% of all pixels")
        if s.exact:
            self._exact_legend(percentages)
            return
        for name, reason in OVERLAYS.items():
            percent = percentages.get(name)
            if percent is None or (percent == 0.0 and name in ("first", "cut", "invalid", "behind")):
                continue
            self._ui.swatch(name, color_of(reason))
            term = REASONS[reason]
            self._ui.check(term.label, s.shown[name], f"show {name}", f"show.{name}", term.tooltip)
            self._ui.percent(percent)
        missing = [label_of(OVERLAYS[name]) for name in OVERLAYS if percentages.get(name) is None]
        if missing:
            self._ui.faint(f"not measured: {', '.join(missing)}", wrap=True)

    def _exact_legend(self, percentages: Mapping[str, float | None]) -> None:
        for name, bits in EXACT_OVERLAYS.items():
            self._ui.swatch(name, EXACT_COLORS[bits])
            imgui.text(EXACT_REASONS[bits].label)
            self._ui.explain(EXACT_REASONS[bits].tooltip)
            self._ui.percent(percentages.get(name))

    def _reusable(self) -> None:
        """The reuse rates of the pair, sky and the largest reasons; the reprojection mode beside them."""
        engine = self._viewer.engine
        percentages, (_, _, words) = engine.percentages(), engine.reusable()
        lines = {f"reusable_{rate}": (f"reusable {rate}", CONCEPTS[rate]) for rate in RATES}
        lines["sky"] = "sky, of all pixels", STATISTICS["sky_percent"]
        for name, (label, term) in lines.items():
            imgui.text(label)
            self._ui.explain(term.tooltip)
            self._ui.percent(percentages.get(name))
        metrics = engine.feed.settings.metrics
        mode = metrics.reprojection + (f", {OPTIONS['eye'].label}" if metrics.stereo else " reprojection")
        self._ui.faint(words if engine.other_counts is not None else f"{mode}: {words}", wrap=True)

    def _thresholds(self) -> None:
        """A slider for each measured feature, with the histogram of its distances inside."""
        engine = self._viewer.engine
        width = imgui.get_content_region_avail().x - 66.0
        for feature in FEATURES:
            if feature not in engine.feed.source.unmeasured:
                self._threshold(feature, width)

    def _threshold(self, feature: str, width: float) -> None:
        s, engine = self._viewer.state, self._viewer.engine
        high = MOST.get(feature, 10.0)
        corner = imgui.get_cursor_screen_pos()
        bar(corner.x, corner.y, width, SLIDER_HEIGHT, (0.195, 0.205, 0.224))  # the slider has no background of its own
        _histogram(engine.histograms.get(feature), feature, s.thresholds[feature], high, (corner.x, corner.y, width))
        for name in ("frame_bg", "frame_bg_hovered", "frame_bg_active"):
            imgui.push_style_color(getattr(imgui.Col_, name).value, ImVec4(0.0, 0.0, 0.0, 0.0))
        imgui.push_style_var(
            imgui.StyleVar_.frame_padding.value, ImVec2(8, (SLIDER_HEIGHT - imgui.get_font_size()) / 2)
        )
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

    def _size(self) -> None:
        """Size and exposure of the image, which follow from the settings."""
        feed = self._viewer.engine.feed
        width, height = feed.size
        self._ui.faint(f"{width} x {height} pixels, exposure {feed.settings.lighting.exposure_factor:.4g}", wrap=True)

    def _effects(self) -> None:
        viewer, s = self._viewer, self._viewer.state
        if not viewer.engine.feed.effects:
            self._ui.faint("path-traced files: nothing is simulated")
        else:
            self._ui.faint(self._lighting_text(viewer.engine.feed), wrap=True)
        for name, effect in viewer.engine.feed.effects.items():
            label = name.replace("_", " ")
            if name in s.effects:
                changed, _ = imgui.checkbox(f"{label}##effect", name not in s.switched_off)
                self._ui.place(f"effect.{name}")
                if changed:
                    s.effect = name
                    s.toggle_effect(name)
            else:
                self._ui.faint(f"{'enabled ' if effect.enabled else 'disabled'}  {label}")
            if imgui.is_item_hovered():
                imgui.set_tooltip(effect.reason)

    def _lighting_text(self, feed: Feed) -> str:
        if feed.settings is not self._lighting[0]:
            text = lighting_text({"settings": feed.settings.to_dict(), "lighting": dict(feed.lighting)})
            self._lighting = feed.settings, str(text)
        return self._lighting[1]

    def _time(self) -> None:
        """Milliseconds of each pass, as numbers and as shares of their sum; faint: not in the last image."""
        viewer = self._viewer
        times = viewer.timer.ms
        total = sum(times.values())
        latest = sum(times[name] for name in viewer.timer.latest)
        imgui.text(f"{viewer.fps:.1f} frames/s, last image {latest:.1f} ms")
        for name, ms in times.items():
            corner, width = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail().x
            bar(corner.x, corner.y, width * ms / total if total else 0.0, imgui.get_text_line_height(), (0.2, 0.3, 0.4))
            self._ui.faint(name)
            text = f"{ms:.2f} ms"
            imgui.same_line(imgui.get_cursor_pos_x() + width - imgui.calc_text_size(text).x)
            imgui.text(text) if name in viewer.timer.latest else self._ui.faint(text)
            self._ui.place(f"time.{name}")

    def _help(self) -> None:
        width, height = self._viewer.window_size
        size = (min(820.0, width - 20.0), max(height - 40.0, 60.0))
        imgui.set_next_window_pos(ImVec2((width - size[0]) / 2, 20))
        imgui.set_next_window_size(ImVec2(*size))
        imgui.set_next_window_focus()
        imgui.begin("keys", None, FIXED)
        imgui.text(f"Keys   (close: {key_words('SHIFT+SLASH')} or Escape)")
        imgui.separator()
        if imgui.begin_table("keys", 4, imgui.TableFlags_.sizing_fixed_fit.value):
            for column in range(4):
                fixed, stretch = imgui.TableColumnFlags_.width_fixed.value, imgui.TableColumnFlags_.width_stretch.value
                imgui.table_setup_column(f"{column}", stretch if column % 2 else fixed, 0.0 if column % 2 else 120.0)
            for group, lines in help_lines().items():
                imgui.table_next_row()
                imgui.table_next_column()
                imgui.text_colored(ImVec4(*ACCENT, 1.0), group)
                for i, (keys, doc) in enumerate(lines):
                    if i % 2 == 0:
                        imgui.table_next_row()
                    imgui.table_next_column()
                    imgui.text(keys)
                    imgui.table_next_column()
                    self._ui.faint(doc, wrap=True)
            imgui.end_table()
        imgui.end()


LEAST = 1e-4
"""Lower end of a threshold slider."""
MOST = {feature.name: feature.most for feature in TABLE if feature.most}
"""Feature -> upper end of its threshold slider; it is 10 for the other features."""
SLIDER_HEIGHT = 30.0
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
            low, high_end = (
                ImVec2(x + 3 * i, y + SLIDER_HEIGHT * (1.0 - height)),
                ImVec2(x + 3 * i + 2.0, y + SLIDER_HEIGHT),
            )
            lines.add_rect_filled(low, high_end, over if i + 0.5 >= cut else under)
    lines.flags = smooth


TIMELINE_HEIGHT = 44.0
"""Height of the timeline, screen points."""
HEADROOM = 1.15
"""The largest share of a discard is this much below the upper edge."""
RATE_COLOR = (1.0, 1.0, 1.0, 0.95)


def draw_timeline(ui: Widgets, timeline: Timeline) -> None:
    """Small images, curves of the masks that are shown and of the reuse rate (white), a line at the frame.

    A click goes to a frame; the mouse over it names its rates.
    """
    s = ui.viewer.state
    corner, width = imgui.get_cursor_screen_pos(), max(imgui.get_content_region_avail().x, 40.0)
    imgui.image(imgui.ImTextureRef(timeline.texture.glo), ImVec2(width, TIMELINE_HEIGHT))
    bar(corner.x, corner.y, width, TIMELINE_HEIGHT, (0.0, 0.0, 0.0, 0.55))
    imgui.set_cursor_screen_pos(corner)
    imgui.invisible_button("##timeline", ImVec2(width, TIMELINE_HEIGHT))
    ui.place("timeline")
    at = timeline.frame_at((imgui.get_mouse_pos().x - corner.x) / width)
    if imgui.is_item_active():
        s.playing = False
        s.go_to(at)
    elif imgui.is_item_hovered():
        imgui.set_tooltip(_words(timeline, s, at))

    def point(frame: int, share: float) -> ImVec2:
        return ImVec2(corner.x + timeline.place(frame) * width, corner.y + TIMELINE_HEIGHT * (1.0 - share))

    for color, shares in _curves(timeline, s):
        drawn = imgui.get_color_u32(ImVec4(*color))
        for frame, share in shares.items():
            if frame + 1 in shares:
                ends = point(frame, share), point(frame + 1, shares[frame + 1])
                imgui.get_window_draw_list().add_line(*ends, drawn, 1.5)
    bar(point(s.frame, 1.0).x - 1.0, corner.y, 2.0, TIMELINE_HEIGHT, (1.0, 0.85, 0.3))


def _curves(timeline: Timeline, s: ViewerState) -> list[tuple[tuple[float, ...], dict[int, float]]]:
    """Color and height (0 to 1) by frame of each curve; discards have the scale of the largest one."""
    rates = dict(sorted(timeline.rates.items()))
    names = [n for n in s.active_overlays() if n in OVERLAYS]
    shares = {n: {f: r.percent[n] for f, r in rates.items() if r.percent.get(n) is not None} for n in names}
    most = HEADROOM * max((p for by in shares.values() for p in by.values()), default=1.0) or 1.0
    curves = [
        ((*(c / 255.0 for c in color_of(OVERLAYS[n])), 1.0), {f: p / most for f, p in by.items()})
        for n, by in shares.items()
    ]
    return [*curves, (RATE_COLOR, {f: r.reusable / 100.0 for f, r in rates.items() if r.reusable is not None})]


def _words(timeline: Timeline, s: ViewerState, frame: int) -> str:
    rates = timeline.rates.get(frame)
    if rates is None:
        return f"frame {frame}: not shown yet"
    lines = [f"frame {frame}"]
    lines += [] if rates.reusable is None else [f"reusable {rates.reusable:.1f} % of surface pixels"]
    percent = {n: rates.percent.get(n) for n in s.active_overlays() if n in OVERLAYS}
    lines += [f"{n.replace('_', ' ')} {p:.2f} % of all pixels" for n, p in percent.items() if p is not None]
    return "\n".join([*lines, *(["light is coarse"] if rates.coarse else [])])


INDENT = 12.0
"""Indentation of one level of the scene tree, screen points."""
_NODE = imgui.TreeNodeFlags_.no_tree_push_on_open.value | imgui.TreeNodeFlags_.open_on_arrow.value


class ScenePanel:
    """Draws the section of the scene: its nodes as a tree, in which one can be selected.

    Only the rows in view are built: a scene can have thousands of nodes.
    """

    def __init__(self, ui: Widgets):
        self._ui = ui
        self._tree: SceneTree | None = None
        self._open: set[int] = set()  # nodes whose children are listed
        self._search = ""
        self._rows: list[tuple[int, int]] | None = None  # node and depth of each row; None: to be made again
        self._followed: int | None = None  # the selection that the rows were scrolled to

    def draw(self) -> None:
        viewer = self._ui.viewer
        s, tree = viewer.state, viewer.engine.feed.tree
        if tree is None:
            self._ui.faint("path-traced files have no nodes")
            return
        if tree is not self._tree:
            self._tree, self._open, self._search, self._rows, self._followed = tree, set(), "", None, None
        if s.selection != self._followed:
            self._followed = s.selection
            if s.selection is not None:
                self._open |= tree.ancestors(s.selection)
                self._search, self._rows = "", None
                self._ui.reveal = f"node.{tree.labels[s.selection]}"
        # Another name after a selection: a text field that is being edited keeps its own text.
        changed, self._search = imgui.input_text_with_hint(f"##search {self._followed}", "search", self._search)
        self._ui.place("search", slider=True)
        if changed or self._rows is None:
            self._rows = self._listed()
        clipper = imgui.ListClipper()
        clipper.begin(len(self._rows), imgui.get_text_line_height_with_spacing())
        if (self._ui.reveal or "").startswith("node."):  # a row that is to be scrolled to must be built
            shown = (i for i, (node, _) in enumerate(self._rows) if self._ui.reveal == f"node.{tree.labels[node]}")
            for row in shown:
                clipper.include_item_by_index(row)
        while clipper.step():
            for node, depth in self._rows[clipper.display_start : clipper.display_end]:
                self._row(node, depth)

    def _listed(self) -> list[tuple[int, int]]:
        """Nodes whose name contains the search text, or without one the open part of the tree."""
        tree, text, rows = self._tree, self._search.lower(), []
        stack = [(node, 0) for node in reversed(tree.roots)]
        while stack:
            node, depth = stack.pop()
            if text in tree.labels[node].lower():
                rows.append((node, 0 if text else depth))
            if text or node in self._open:
                stack += [(child, depth + 1) for child in reversed(tree.children[node])]
        return rows

    def _row(self, node: int, depth: int) -> None:
        s, tree = self._ui.viewer.state, self._tree
        label = tree.labels[node]
        leaf = bool(self._search) or not tree.children[node]
        flags = _NODE | imgui.TreeNodeFlags_.leaf.value * leaf
        imgui.dummy(ImVec2(INDENT * depth, 0.0))
        imgui.same_line(0.0, 0.0)
        imgui.set_next_item_open(node in self._open)
        color = ImVec4(*OUTLINE_COLOR) if s.selection == node else imgui.get_style_color_vec4(imgui.Col_.text.value)
        imgui.push_style_color(imgui.Col_.text.value, color)
        imgui.tree_node_ex(str(node), flags, label)
        imgui.pop_style_color()
        self._ui.place(f"node.{label}")
        if imgui.is_item_toggled_open():
            self._open ^= {node}
            self._rows = None
        elif imgui.is_item_clicked():
            s.selection = self._followed = None if s.selection == node else node
        hidden = not self._ui.viewer.engine.visible(node)
        words = [tree.kinds[node], *["animated"] * bool(tree.animated[node]), *["hidden"] * hidden]
        imgui.same_line()
        self._ui.faint(", ".join(filter(None, words)))
