"""The panels.  Controls change the state, numbers come from the engine; tooltips are those of actions and glossary."""

from __future__ import annotations

import textwrap
from collections.abc import Callable

from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.conventions import FEATURES
from taubench_gl.glossary import COLUMNS, CONCEPTS, REASONS, label_of
from taubench_gl.metrics.reuse_rate import RATES
from taubench_gl.report.labels import lighting_text
from taubench_gl.report.palette import color_of
from taubench_gl.viewer.actions import ACTIONS, KEYS, help_lines, key_words
from taubench_gl.viewer.display import VISUALIZATIONS
from taubench_gl.viewer.imgui_renderer import ACCENT, FAINT
from taubench_gl.viewer.layout import Layout, Rect
from taubench_gl.viewer.model import ViewerModel
from taubench_gl.viewer.state import CAMERAS, COMPARISONS, OVERLAYS, SECTIONS

_FIXED = (
    imgui.WindowFlags_.no_move.value | imgui.WindowFlags_.no_resize.value | imgui.WindowFlags_.no_collapse.value
    | imgui.WindowFlags_.no_title_bar.value | imgui.WindowFlags_.no_saved_settings.value
    | imgui.WindowFlags_.no_nav.value
)  # fmt: skip
_FAINT = ImVec4(*FAINT, 1.0)


class Panels:
    """Draws everything except the image.  ``widgets``: rectangle of each control, for scripts."""

    def __init__(self, viewer: ViewerModel):
        self._viewer = viewer
        self.widgets: dict[str, Rect] = {}
        self.reveal: str | None = None  # name of a control to scroll to

    def draw(self, layout: Layout) -> None:
        self.widgets.clear()
        if layout.side is not None:
            self._window("side", layout.side, self._side)
        if layout.bar is not None:
            self._window("bar", layout.bar, self._bar)
        if self._viewer.state.help:
            self._help()

    def _window(self, name: str, rect: Rect, body: Callable[[], None]) -> None:
        imgui.set_next_window_pos(ImVec2(rect[0], rect[1]))
        imgui.set_next_window_size(ImVec2(rect[2], rect[3]))
        imgui.begin(name, None, _FIXED)
        body()
        imgui.end()

    def _place(self, name: str, slider: bool = False) -> None:
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        width = min(high.x - low.x, imgui.calc_item_width()) if slider else high.x - low.x  # excludes the label
        self.widgets[name] = (low.x, low.y, width, high.y - low.y)
        if self.reveal == name:
            imgui.set_scroll_here_y(0.5)
            self.reveal = None

    def _faint(self, text: str, wrap: bool = False) -> None:
        imgui.push_style_color(imgui.Col_.text.value, _FAINT)
        (imgui.text_wrapped if wrap else imgui.text)(text)
        imgui.pop_style_color()

    def _tip(self, action: str, definition: str = "") -> None:
        """Tooltip of the last item: the action with its keys, below the definition if there is one."""
        if imgui.is_item_hovered():
            keys = " or ".join(key_words(c) for c, name in KEYS.items() if name == action)
            text = f"{ACTIONS[action].doc}  [{keys}]"
            imgui.set_tooltip(_wrapped(f"{definition}\n{text}" if definition else text))

    def _check(self, label: str, on: bool, action: str, name: str, definition: str = "") -> None:
        changed, _ = imgui.checkbox(label, on)
        self._place(name)
        self._tip(action, definition)
        if changed:
            self._viewer.act(action)

    def _slider(self, name: str, low: float, high: float, text: str, flags: int = 0) -> None:
        """A slider for a number of the state, which is set only when the user moves it: ImGui has float32 values."""
        s = self._viewer.state
        changed, value = imgui.slider_float(name, getattr(s, name), low, high, text, flags)
        self._place(name, slider=True)
        if changed:
            setattr(s, name, value)

    def _side(self) -> None:
        bodies = {
            "camera": self._camera, "image": self._image, "masks": self._masks, "thresholds": self._thresholds,
            "probe": self._probe, "effects": self._effects, "time": self._time,
        }  # fmt: skip
        state = self._viewer.state
        for name in SECTIONS:
            if name not in bodies:
                continue
            imgui.set_next_item_open(state.sections[name])
            state.sections[name] = imgui.collapsing_header(name.capitalize())
            self._place(f"section.{name}")
            if state.sections[name]:
                imgui.push_item_width(150)
                bodies[name]()
                imgui.pop_item_width()
                imgui.dummy(ImVec2(0, 3))

    def _bar(self) -> None:
        viewer, s = self._viewer, self._viewer.state
        for label, action in (("|<", "first"), ("<", "previous"), ("Pause" if s.playing else "Play", "play"),
                              (">", "next"), (">|", "last")):  # fmt: skip
            if imgui.button(label, ImVec2(56 if action == "play" else 0, 0)):
                viewer.act(action)
            self._place(f"button.{action}")
            self._tip(action)
            imgui.same_line()
        width = imgui.get_content_region_avail().x
        imgui.set_next_item_width(max(width, 40.0))
        changed, frame = imgui.slider_int("##frame", s.frame, s.first, s.last, f"frame %d of {s.last}")
        self._place("frame")
        if changed:
            s.playing = False
            s.go_to(frame)
        low, high = s.range
        loop = f"loop {low}-{high}   " if s.loop is not None else ""
        speed = "" if s.speed == 1.0 else f"speed {s.speed:g}   "
        rate, percent, _ = viewer.engine.reusable()
        reusable = (
            ""
            if percent is None
            else f"{'reusable' if rate == 'shading' else f'reusable {rate}'} {percent:.1f} % of all pixels   "
        )
        at = f"{s.frame / s.fps:.3f} s at {s.fps:g} fps"
        self._faint(f"{at}   {reusable}{speed}{loop}{s.message or viewer.hint}")

    def _camera(self) -> None:
        s = self._viewer.state
        for i, mode in enumerate(CAMERAS):
            if i:
                imgui.same_line()
            if imgui.radio_button(mode, s.camera == mode):
                self._viewer.act("file camera" if mode == "file" else mode)
            self._place(f"camera.{mode}")
        self._check("freeze current", s.freeze_current, "freeze current", "freeze_current")
        imgui.same_line()
        self._check("freeze previous", s.freeze_previous, "freeze previous", "freeze_previous")

    def _image(self) -> None:
        s = self._viewer.state
        if imgui.begin_combo("channel", s.channel.replace("_", " ")):
            for name in s.channels:
                if imgui.selectable(f"{name.replace('_', ' ')}  ({VISUALIZATIONS[name].doc})", name == s.channel)[0]:
                    s.channel = name
            imgui.end_combo()
        self._place("channel")
        self._check("auto", s.auto_range, "auto range", "auto_range")
        imgui.same_line()
        step = max((s.high - s.low) * 0.01, 1e-4)
        changed, low, high = imgui.drag_float_range2("range", s.low, s.high, step, 0, 0, "%.3g", "%.3g")
        self._place("range")
        if changed:
            s.set_range(low, high)
        self._check("motion arrows", s.arrows, "arrows", "arrows")
        if self._viewer.engine.comparison is None:
            return
        for i, name in enumerate(COMPARISONS):
            if i:
                imgui.same_line()
            if imgui.radio_button(f"{name}##comparison", s.comparison == name):
                s.comparison = name
        if s.comparison == "split":
            self._slider("split", 0.0, 1.0, "%.2f")
        elif s.comparison == "difference":
            self._slider("gain", 0.1, 100.0, "%.3g", imgui.SliderFlags_.logarithmic.value)

    def _masks(self) -> None:
        s, percentages = self._viewer.state, self._viewer.engine.percentages()
        self._reusable()
        self._check("masks", s.overlays, "overlays", "overlays")
        imgui.same_line()
        self._slider("opacity", 0.0, 1.0, "%.2f")
        self._faint("% of all pixels")
        right = imgui.get_content_region_avail().x
        for name in OVERLAYS:
            percent = percentages.get(name)
            if percent is None or (percent == 0.0 and name in ("first", "cut", "invalid", "behind")):
                continue
            color = ImVec4(*(c / 255.0 for c in color_of(OVERLAYS[name])), 1.0)
            imgui.color_button(f"##{name}", color, imgui.ColorEditFlags_.no_tooltip.value, ImVec2(12, 18))
            imgui.same_line()
            term = REASONS[OVERLAYS[name]]
            self._check(term.label, s.shown[name], f"show {name}", f"show.{name}", term.tooltip)
            text = f"{percent:.2f} %"
            imgui.same_line(right - imgui.calc_text_size(text).x)
            imgui.text(text)
        missing = [label_of(OVERLAYS[name]) for name in OVERLAYS if percentages.get(name) is None]
        if missing:
            self._faint(f"not measured: {', '.join(missing)}", wrap=True)

    def _reusable(self) -> None:
        """The reuse rates of the pair and the largest reasons; the reprojection mode beside them."""
        engine = self._viewer.engine
        percentages, (_, _, words) = engine.percentages(), engine.reusable()
        for rate in RATES:
            percent = percentages.get(f"reusable_{rate}")
            imgui.text(f"reusable {rate}")
            if imgui.is_item_hovered():
                imgui.set_tooltip(_wrapped(CONCEPTS[rate].tooltip))
            text = "not measured" if percent is None else f"{percent:.2f} %"
            imgui.same_line(imgui.get_content_region_avail().x - imgui.calc_text_size(text).x)
            imgui.text(text)
        self._faint(f"{engine.feed.settings.metrics.reprojection} reprojection: {words}", wrap=True)

    def _thresholds(self) -> None:
        s, source = self._viewer.state, self._viewer.engine.feed.source
        for feature in FEATURES:
            if feature in source.unmeasured:
                continue
            high = 2.0 if feature in ("normal", "color") else 10.0
            flags = imgui.SliderFlags_.logarithmic.value
            shown = f"%.4f{s.unit(feature)}"
            changed, value = imgui.slider_float(
                f"{feature}##threshold", s.thresholds[feature], 1e-4, high, shown, flags
            )
            self._place(f"threshold.{feature}", slider=True)
            if imgui.is_item_hovered():
                imgui.set_tooltip(_wrapped(COLUMNS[feature].tooltip))
            if changed:
                s.feature = feature
                s.set_threshold(feature, value)

    def _probe(self) -> None:
        s, found = self._viewer.state, self._viewer.probe()
        self._check("pin", s.probe_pinned, "pin probe", "probe_pinned")
        imgui.same_line()
        if found is None:
            self._faint("move the mouse over the image")
            return
        imgui.text(f"pixel {found.pixel[0]}, {found.pixel[1]}")
        where = "none" if found.at is None else f"{found.at[0]:.2f}, {found.at[1]:.2f}"
        imgui.text(f"history at {where}  ({found.motion_px[0]:+.2f}, {found.motion_px[1]:+.2f} px)")
        imgui.text_wrapped(found.reason)
        for name, f in found.features.items():
            distance = "-" if f.distance is None else f"{f.distance:.4g}"
            sign, unit = ">" if f.discarded else "<=", s.unit(name)
            imgui.text(f"{name}: {distance}" + ("" if f.distance is None else f" {sign} {f.threshold:.4g}{unit}"))
            self._faint(f"  current {_triple(f.current)}")
            if f.history is not None:
                self._faint(f"  history {_triple(f.history)}")

    def _effects(self) -> None:
        viewer, s = self._viewer, self._viewer.state
        if not viewer.engine.feed.effects:
            self._faint("path-traced files: nothing is simulated")
        else:
            feed = viewer.engine.feed
            lighting = lighting_text({"settings": feed.settings.to_dict(), "lighting": dict(feed.lighting)})
            self._faint(str(lighting), wrap=True)
        for name, effect in viewer.engine.feed.effects.items():
            label = name.replace("_", " ")
            if name in s.effects:
                changed, _ = imgui.checkbox(f"{label}##effect", name not in s.switched_off)
                self._place(f"effect.{name}")
                if changed:
                    s.effect = name
                    s.toggle_effect(name)
            else:
                self._faint(f"{'enabled ' if effect.enabled else 'disabled'}  {label}")
            if imgui.is_item_hovered():
                imgui.set_tooltip(effect.reason)

    def _time(self) -> None:
        viewer = self._viewer
        imgui.text(f"{viewer.fps:.1f} frames/s")
        for name, ms in viewer.timer.ms.items():
            self._faint(name)
            imgui.same_line(150)
            imgui.text(f"{ms:7.2f} ms")

    def _help(self) -> None:
        width, height = self._viewer.window_size
        size = (min(820.0, width - 20.0), max(height - 40.0, 60.0))
        imgui.set_next_window_pos(ImVec2((width - size[0]) / 2, 20))
        imgui.set_next_window_size(ImVec2(*size))
        imgui.set_next_window_focus()
        imgui.begin("keys", None, _FIXED)
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
                    self._faint(doc, wrap=True)
            imgui.end_table()
        imgui.end()


def _wrapped(text: str) -> str:
    return "\n".join(textwrap.fill(line, 60) for line in text.splitlines())


def _triple(values: object) -> str:
    return " ".join(f"{float(v):.4g}" for v in values)  # type: ignore[attr-defined]
