"""The panels.  Controls change the state, numbers come from the engine; tooltips are those of actions and glossary."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.animation import OrbitCamera
from taubench_gl.glossary import CONCEPTS, EXACT_REASONS, OPTIONS, REASONS, STATISTICS, label_of
from taubench_gl.metrics.reuse_rate import RATES
from taubench_gl.report.labels import lighting_text
from taubench_gl.report.palette import EXACT_COLORS, color_of
from taubench_gl.settings import Settings
from taubench_gl.viewer.actions import help_lines, key_words
from taubench_gl.viewer.display import VISUALIZATIONS
from taubench_gl.viewer.feeds import Feed
from taubench_gl.viewer.image_marks import draw_marks
from taubench_gl.viewer.imgui_renderer import ACCENT
from taubench_gl.viewer.layout import Layout, Rect
from taubench_gl.viewer.model import ViewerModel
from taubench_gl.viewer.pixel_panel import PixelPanel
from taubench_gl.viewer.scene_panel import ScenePanel
from taubench_gl.viewer.state import (
    CAMERAS,
    DOCKED,
    EXACT_OVERLAYS,
    LIVE_CHOICES,
    METHOD_INPUTS,
    MOVING_LIGHTS,
    OVERLAYS,
    set_variable,
)
from taubench_gl.viewer.thresholds_panel import ThresholdsPanel
from taubench_gl.viewer.timeline_panel import draw_timeline
from taubench_gl.viewer.widgets import FIXED, PANEL_FLAGS, Widgets, bar

SCORES = {
    "wrongly_reused_percent": "wrongly reused, % of pixels",
    "bound_linear_mse": "bound, linear MSE",
    "headroom_db": "headroom, dB",
}
"""Columns of ``reuse evaluate`` -> how the section compare names them."""
LOGARITHMIC = imgui.SliderFlags_.logarithmic.value


class Panels:
    """Draws everything except the image.  ``widgets``: rectangle of each control, for scripts."""

    def __init__(self, viewer: ViewerModel):
        self._viewer = viewer
        self._ui = Widgets(viewer)
        self._pixel = PixelPanel(self._ui)
        self._lighting: tuple[Settings | None, str] = (None, "")  # settings and what their light is in words
        self._bodies: dict[str, Callable[[], None]] = {
            "camera": self._camera, "image": self._image, "compare": self._compare, "masks": self._masks,
            "thresholds": ThresholdsPanel(self._ui).draw, "probe": self._pixel.draw, "settings": self._settings,
            "effects": self._effects, "time": self._time, "lesson": self._lesson,
            "scene": ScenePanel(self._ui).draw,
        }  # fmt: skip

    @property
    def widgets(self) -> dict[str, Rect]:
        return self._ui.rects

    def reveal(self, name: str) -> None:
        """Scroll to a control."""
        self._ui.reveal = name

    def draw(self, layout: Layout) -> None:
        self._ui.rects.clear()
        docks, shown = self._viewer.state.docks, [n for n in DOCKED if n != "lesson" or self._viewer.state.lesson]
        for side, rect in (("left", layout.left), ("right", layout.right)):
            if rect is not None:
                names = [n for n in shown if n in self._bodies and (layout.merged or docks[n] == side)]
                self._window(side, rect, lambda names=names: self._sections(names, layout.merged))
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

    def _sections(self, names: list[str], merged: bool) -> None:
        state = self._viewer.state
        for name in names:
            right = imgui.get_cursor_pos_x() + imgui.get_content_region_avail().x
            imgui.set_next_item_open(state.sections[name])
            imgui.set_next_item_allow_overlap()
            state.sections[name] = imgui.collapsing_header(name.capitalize())
            self._ui.place(f"section.{name}")
            if not merged:
                self._move_button(name, right)
            if state.sections[name]:
                imgui.push_item_width(150)
                self._bodies[name]()
                imgui.pop_item_width()
                imgui.dummy(ImVec2(0, 3))

    def _move_button(self, name: str, right: float) -> None:
        """Moves a section to the other side panel."""
        docks = self._viewer.state.docks
        imgui.same_line(right - 18.0)
        if imgui.small_button(("<" if docks[name] == "right" else ">") + f"##{name}"):
            docks[name] = "left" if docks[name] == "right" else "right"
        self._ui.place(f"dock.{name}")
        if imgui.is_item_hovered():
            imgui.set_tooltip(f"move {name} to the other side")

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
        self._ui.check("freeze current", s.freeze_current, "freeze current", "freeze_current")
        imgui.same_line()
        self._ui.check("freeze previous", s.freeze_previous, "freeze previous", "freeze_previous")

    def _camera_label(self, mode: str) -> str:
        """A file without a camera is seen from an orbit that frames it."""
        framing = isinstance(getattr(self._viewer.engine.feed, "camera", None), OrbitCamera)
        return "framing orbit" if mode == "file" and framing else mode

    def _image(self) -> None:
        s = self._viewer.state
        if imgui.begin_combo("channel", s.channel.replace("_", " ")):
            for name in s.channels:
                if imgui.selectable(f"{name.replace('_', ' ')}  ({VISUALIZATIONS[name].doc})", name == s.channel)[0]:
                    s.channel = name
            imgui.end_combo()
        self._ui.place("channel")
        self._ui.check("auto", s.auto_range, "auto range", "auto_range")
        imgui.same_line()
        step = max((s.high - s.low) * 0.01, 1e-4)
        changed, low, high = imgui.drag_float_range2("range", s.low, s.high, step, 0, 0, "%.3g", "%.3g")
        self._ui.place("range")
        if changed:
            s.set_range(low, high)
        self._ui.check("motion arrows", s.arrows, "arrows", "arrows")
        if s.arrows:
            text = "%.3g x" if s.arrow_scale else f"fitting: {self._viewer.engine.arrow_scale:.3g} x"
            self._ui.slider("arrow_scale", 0.0, 100.0, text, LOGARITHMIC, "length")

    def _compare(self) -> None:
        s = self._viewer.state
        self._ui.pick("with", "against", s.others)
        self._ui.pick("mode", "comparison", s.comparisons)
        self._ui.check("beside the image, with the error map", s.beside, "beside", "beside")
        if s.against == "method":
            self._ui.pick("method", "method", s.methods)
            self._ui.pick("input", "method_input", METHOD_INPUTS)
            self._ui.pick("image", "method_image", s.method_images)
            self._ui.faint("results are colors: show the channel color", wrap=True)
            for name, label in SCORES.items():
                if (value := self._viewer.engine.method_scores(s).get(name)) is not None:
                    self._ui.pair(label, f"{value:.4g}", 190.0)
        if s.beside or s.comparison in ("difference", "error", "ghost"):
            self._ui.slider("gain", 0.1, 100.0, "%.3g", LOGARITHMIC)
        if s.comparison == "split":
            self._ui.slider("split", 0.0, 1.0, "%.2f")
        elif s.comparison == "flicker":
            self._ui.slider("flicker_hz", 0.25, 30.0, "%.2g per second", LOGARITHMIC)
            self._ui.faint(f"shown: {s.against if s.flicker_other else 'this image'}")

    def _masks(self) -> None:
        s, percentages = self._viewer.state, self._viewer.engine.percentages()
        self._reusable()
        self._ui.check("masks", s.overlays, "overlays", "overlays")
        imgui.same_line()
        self._ui.slider("opacity", 0.0, 1.0, "%.2f")
        self._ui.check("exact reasons", s.exact, "exact", "exact")
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
        self._ui.faint(f"{mode}: {words}", wrap=True)

    def _settings(self) -> None:
        """Settings that change while looking, and what they result in."""
        s, feed = self._viewer.state, self._viewer.engine.feed
        for name, choices in LIVE_CHOICES.items():
            value = f"{getattr(s.live, name):g}" if name == "scale" else getattr(s.live, name)
            picked = self._ui.choose(name, value, choices)
            if picked is not None:
                set_variable(s, name, picked)
        changed, stops = imgui.slider_float("exposure", s.live.stops, -8.0, 8.0, "%+.2f stops")
        self._ui.place("stops", slider=True)
        if changed:
            set_variable(s, "stops", str(stops))
        self._ui.pick("while moving", "moving_light", MOVING_LIGHTS)
        samples = self._ui.number("path tracing", s.samples, 0, 1024, "%d samples", "samples", LOGARITHMIC)
        s.samples = s.samples if samples is None else samples
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
