"""State of the viewer as plain values, without window or OpenGL, and the one table of controls.

A field that declares a control holds its name in scripts, its values, its widget, its keys and what it restarts
(``controls``).  ``set_variable`` and ``variables`` access controls by name: ``threshold.normal``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from taubench_gl.conventions import FRUSTUM, Reason, Visibility
from taubench_gl.errors import SettingsError
from taubench_gl.features import BY_BIT, COUNTED_BITS, FEATURES
from taubench_gl.glossary import EXACT_REASONS, key_of, label_of
from taubench_gl.reuse.loading import builtin_methods
from taubench_gl.settings import HISTORIES, LIGHTS, REPROJECTIONS, SAMPLINGS
from taubench_gl.viewer.controls import (
    MASKS,
    NOTHING,
    SOURCE,
    Action,
    Choice,
    Control,
    Flag,
    Members,
    Number,
    Special,
    control,
    controls_of,
    declared,
    flag,
    number,
    pixel,
)

CAMERAS = ("file", "fly", "orbit")
COMPARISONS = ("off", "split", "flicker", "difference", "error", "ghost")
NO_NODE = "none"
"""The selection without a node; no node has this label."""
HISTORY = ("history", "reprojected")
"""What every image can be compared with: the previous frame, and that frame looked up where motion leads."""
SECTIONS = (
    "playback", "camera", "image", "compare", "masks", "thresholds", "probe", "settings", "effects", "time", "lesson",
    "scene",
)  # fmt: skip
LEFT = ("lesson", "probe", "thresholds", "scene")
RIGHT = ("camera", "image", "compare", "masks", "settings", "effects", "time")
"""Sections of the side panels, from the top."""
SPEEDS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
MIN_THRESHOLD, MAX_THRESHOLD = 1e-5, 100.0

OVERLAYS: dict[str, Reason] = {
    key_of(reason): reason
    for reason in (
        FRUSTUM, *(f.bit for f in BY_BIT), *(bit for f in BY_BIT for bit in f.details), Reason.BEHIND, Reason.OUTSIDE,
        Reason.SKY, Reason.HISTORY_SKY, Reason.INVALID, Reason.FIRST, Reason.CUT,
    )
}  # fmt: skip
"""Mask overlays by key, in the order of the legend and of the number keys."""

EXACT_OVERLAYS: dict[str, Visibility] = {f"exact_{term.key}": bits for bits, term in EXACT_REASONS.items()}
"""Overlays of exact reasons, in the order of the legend."""

SHIFT = COUNTED_BITS
"""In the mask that the image shows, the bits of ``Visibility`` are this far above those of ``Reason``."""


METHOD_INPUTS = ("full", "jittered", "noisy", "noisy+jittered", "path-traced", "path-traced+jittered")
"""Kinds of frames that reuse methods get."""
METHOD_IMAGES = ("result", "bound")
"""Images of a reuse method: what it computes, and the blend of its history and input nearest to the exact frame."""
MOVING_LIGHTS = ("full", "half", "quarter", "unshadowed")
SCALES = ("0.25", "0.5", "1", "2")
"""Factors on width and height of the image, as text."""
MOST_SAMPLES = 65536
STOPS = 20.0
"""Largest change of the exposure, up or down, in stops."""


# Changes that actions make


def following(items: tuple[str, ...], item: str, step: int = 1) -> str:
    """The item ``step`` places after ``item``, cyclic; the first if ``item`` is not in ``items``."""
    return items[(items.index(item) + step) % len(items)] if item in items else items[0]


def _next(s: ViewerState, name: str, report: str, step: int = 1) -> None:
    """Choose the next value of the control ``name``; ``report``: how the message about it begins."""
    if choices := CONTROLS[name].choices(s):
        setattr(s, name, following(choices, getattr(s, name), step))
        s.message = f"{report}: {getattr(s, name).replace('_', ' ')}"


def _change_speed(s: ViewerState, step: int) -> None:
    nearest = min(range(len(SPEEDS)), key=lambda i: abs(SPEEDS[i] - s.speed))
    s.speed = SPEEDS[min(max(nearest + step, 0), len(SPEEDS) - 1)]
    s.message = f"speed {s.speed:g}"


def _object_motion(s: ViewerState) -> None:
    s.channel = s.channels[0] if s.channel == "object_motion" else "object_motion"


def _move_range(s: ViewerState, low: float, high: float) -> None:
    """Move the ends of the display range by shares of it."""
    s.set_range(s.low + low * (s.high - s.low), s.high + high * (s.high - s.low))


def _move_split(s: ViewerState, by: float) -> None:
    s.split = min(max(s.split + by, 0.0), 1.0)


def _switch_mask(s: ViewerState, name: str) -> None:
    """Show or hide one mask; showing it shows the masks."""
    s.shown[name] = not s.shown[name]
    s.overlays = s.overlays or s.shown[name]


def _change_opacity(s: ViewerState, by: float) -> None:
    s.opacity = round(min(max(s.opacity + by, 0.0), 1.0), 3)
    s.message = f"opacity {s.opacity:.2f}"


def _next_threshold(s: ViewerState) -> None:
    s.feature = following(FEATURES, s.feature)
    s.scale_threshold(1.0)


def _move_probe(s: ViewerState, dx: int, dy: int) -> None:
    """Pin the probe ``dx`` pixels to the right and ``dy`` down, within the image; without a probe from its middle."""
    x, y = s.probe or (s.size[0] // 2, s.size[1] // 2)
    s.probe_pinned = True
    s.probe = (min(max(x + dx, 0), s.size[0] - 1), min(max(y + dy, 0), s.size[1] - 1))


def _pin(s: ViewerState) -> None:
    if s.probe_pinned:
        s.probe_pinned = False
    else:
        _move_probe(s, 0, 0)


def _toggle_effect(s: ViewerState) -> None:
    if s.effect:
        s.toggle_effect(s.effect)


def _switch_section(s: ViewerState, name: str) -> None:
    s.sections[name] = not s.sections[name]


# Values with rules of their own


def _write_loop(s: ViewerState, name: str, text: str) -> None:
    s.set_loop(**{"low" if name == "loop.first" else "high": round(number(name, text))})


def _write_range(s: ViewerState, name: str, text: str) -> None:
    value = number(name, text)
    s.set_range(*((value, max(value, s.high)) if name == "range.low" else (min(value, s.low), value)))


def _write_probe(s: ViewerState, name: str, text: str) -> None:
    s.probe = pixel(name, text, s.size)


def _write_magnified(s: ViewerState, name: str, text: str) -> None:
    s.magnified = 2 * (min(max(round(number(name, text)), 3), 61) // 2) + 1


def _write_selection(s: ViewerState, name: str, text: str) -> None:
    if text not in (NO_NODE, *s.nodes):
        raise SettingsError(f"there is no node {text!r}", hint=f"give a name of the tree, or {NO_NODE}")
    s.selection = None if text == NO_NODE else s.nodes.index(text)


def _write_effect(s: ViewerState, name: str, text: str) -> None:
    effect = frozenset({name.partition(".")[2]})
    s.switched_off = s.switched_off - effect if flag(name, text) else s.switched_off | effect


def _with_method(s: ViewerState) -> bool:
    return s.against == "method"


_setting = partial(Choice, section="settings", restarts=SOURCE)


@dataclass(frozen=True, slots=True)
class Live:
    """Settings that change while looking at a scene; the defaults leave those of the source as they are."""

    reprojection: str = control("camera", _setting(REPROJECTIONS))
    sampling: str = control("nearest", _setting(SAMPLINGS))
    light: str = control("auto", _setting(LIGHTS))
    scale: float = control(1.0, _setting(SCALES, numeric=True))  # a factor on the size of the image
    history: str = control("frame", _setting(HISTORIES[:2]))
    stops: float = control(0.0, Number(
        -STOPS, STOPS, slider=(-8.0, 8.0), text="%+.2f stops", section="settings", label="exposure", restarts=SOURCE,
    ))  # fmt: skip

    @property
    def exposure(self) -> float:
        """Factor on the exposure of the source."""
        return 2.0**self.stops


@dataclass(slots=True)
class ViewerState:
    """Everything the user can set, and what of the source limits it.

    ``first`` and ``last`` are the first and last frame of the sequence.
    """

    # playback
    first: int = 0
    last: int = 0
    fps: float = 24.0
    playing: bool = control(False, Flag(
        "SPACE", "play or pause", "play", group="playback", restarts=NOTHING, in_session=False,
    ))  # fmt: skip
    frame: int = control(0, Special(
        lambda s: {"frame": s.frame}, lambda s, name, text: s.go_to(round(number(name, text))),
        group="playback", restarts=NOTHING),
        Action("next", "RIGHT", "next frame", lambda s: s.step(1)),
        Action("previous", "LEFT", "previous frame", lambda s: s.step(-1)),
        Action("forward", "SHIFT+RIGHT", "ten frames forward", lambda s: s.step(10)),
        Action("back", "SHIFT+LEFT", "ten frames back", lambda s: s.step(-10)),
        Action("first", "HOME", "first frame", lambda s: s.step(s.first - s.frame)),
        Action("last", "END", "last frame", lambda s: s.step(s.last - s.frame)),
    )  # fmt: skip
    loop: tuple[int, int] | None = control(None, Special(  # first and last frame; None: the whole sequence
        lambda s: dict(zip(("loop.first", "loop.last"), s.range, strict=True)), _write_loop,
        group="playback", restarts=NOTHING),
        Action("loop from", "LEFT_BRACKET", "loop starts at this frame", lambda s: s.set_loop(low=s.frame)),
        Action("loop to", "RIGHT_BRACKET", "loop ends at this frame", lambda s: s.set_loop(high=s.frame)),
        Action("loop all", "BACKSLASH", "loop over the whole sequence", lambda s: setattr(s, "loop", None)),
    )  # fmt: skip
    speed: float = control(1.0, Number(0.01, 16.0, preference=True, group="playback", restarts=NOTHING),
        Action("slower", "COMMA", "play slower", lambda s: _change_speed(s, -1)),
        Action("faster", "PERIOD", "play faster", lambda s: _change_speed(s, 1)),
    )  # fmt: skip

    # camera
    camera: str = control("file", Choice(CAMERAS, group="camera", restarts=NOTHING),
        Action("file camera", "V", "camera of the scene file", lambda s: setattr(s, "camera", "file")),
        Action("fly", "F", "fly: W A S D move, Q E down and up, Shift faster, drag or I J K L turn",
               lambda s: setattr(s, "camera", "fly")),
        Action("orbit", "O", "orbit: drag or I J K L rotate, wheel or W S zoom",
               lambda s: setattr(s, "camera", "orbit")),
        Action("reset camera", "R", "reset fly and orbit to the camera of the scene file"),
    )  # fmt: skip
    freeze_current: bool = control(False, Flag(
        "C", "freeze the current camera and view it from outside", group="camera", section="camera",
    ))  # fmt: skip
    freeze_previous: bool = control(False, Flag("X", "freeze the previous camera", group="camera", section="camera"))
    frusta: bool = control(True, Flag("B", "outlines of frozen cameras", group="camera", preference=True))

    # image
    channels: tuple[str, ...] = ("headlight",)  # keys of ``display.VISUALIZATIONS`` that the source has
    channel: str = control("headlight", Choice(lambda s: s.channels, group="image"),
        Action("next channel", "N", "show the next channel", lambda s: _next(s, "channel", "channel")),
        Action("previous channel", "SHIFT+N", "show the previous channel",
               lambda s: _next(s, "channel", "channel", -1)),
        Action("object motion", "SHIFT+U", "show object motion, or the first channel again", _object_motion),
    )  # fmt: skip
    auto_range: bool = control(True, Flag(
        "M", "display range from the smallest and largest value", group="image", section="image", label="auto",
    ))  # fmt: skip
    display_range: tuple[float, float] = control((0.0, 1.0), Special(
        lambda s: dict(zip(("range.low", "range.high"), s.display_range, strict=True)), _write_range,
        group="image"),
        Action("range up", "UP", "raise the upper end of the range", lambda s: _move_range(s, 0.0, 0.1)),
        Action("range down", "DOWN", "lower the upper end of the range", lambda s: _move_range(s, 0.0, -0.1)),
        Action("low up", "SHIFT+UP", "raise the lower end of the range", lambda s: _move_range(s, 0.1, 0.0)),
        Action("low down", "SHIFT+DOWN", "lower the lower end of the range", lambda s: _move_range(s, -0.1, 0.0)),
    )  # fmt: skip
    arrows: bool = control(False, Flag(
        "U", "motion vectors as arrows to the previous position", group="image", section="image",
        label="motion arrows", preference=True,
    ))  # fmt: skip
    arrow_scale: float = control(0.0, Number(  # length of an arrow per pixel of motion; 0: as long as the grid allows
        0.0, 100.0, text="%.3g x", logarithmic=True, label="length",
    ))  # fmt: skip

    # comparison
    comparison: str = control("off", Choice(lambda s: s.comparisons, section="compare", label="mode", group="image"),
        Action("compare", "Y", f"comparison: {', '.join(COMPARISONS)}", lambda s: _next(s, "comparison", "comparison")),
    )  # fmt: skip
    others: tuple[str, ...] = HISTORY  # what the image can be compared with
    against: str = control("reprojected", Choice(lambda s: s.others, label="with", group="image"),
        Action("compare with", "SHIFT+Y", "compare with the next: history, reprojected history, reference, run, method",
               lambda s: _next(s, "against", "compared with")),
    )  # fmt: skip
    beside: bool = control(False, Flag(
        "Z", "the other image and the error map beside the image", group="image", section="compare",
        label="beside the image, with the error map",
    ))  # fmt: skip
    methods: tuple[str, ...] = field(default_factory=builtin_methods)  # reuse methods to compare with
    method: str = control("taa_clamp", Choice(lambda s: s.methods, section="compare", visible=_with_method))
    method_input: str = control("noisy", Choice(METHOD_INPUTS, section="compare", label="input", visible=_with_method))
    method_image: str = control("result", Choice(
        lambda s: s.method_images, section="compare", label="image", visible=_with_method,
    ))  # fmt: skip
    gain: float = control(4.0, Number(  # factor of the difference image
        0.01, 1e4, slider=(0.1, 100.0), text="%.3g", logarithmic=True, section="compare", preference=True,
        visible=lambda s: s.beside or s.comparison in ("difference", "error", "ghost"),
    ))  # fmt: skip
    split: float = control(0.5, Number(  # fraction of the image width
        0.0, 1.0, section="compare", visible=lambda s: s.comparison == "split", group="image"),
        Action("split left", "SEMICOLON", "move the split line left", lambda s: _move_split(s, -0.02)),
        Action("split right", "APOSTROPHE", "move the split line right", lambda s: _move_split(s, 0.02)),
    )  # fmt: skip
    flicker_hz: float = control(2.0, Number(  # changes per second between the image and the other
        0.25, 30.0, text="%.2g per second", logarithmic=True, section="compare", label="flicker", restarts=NOTHING,
        visible=lambda s: s.comparison == "flicker",
    ))  # fmt: skip
    flicker_other: bool = False  # whether the other is shown now

    # masks and thresholds
    shown: dict[str, bool] = field(
        default_factory=lambda: {n: n in ("frustum", "position", "normal") for n in OVERLAYS},
        metadata=declared(Members("show", Flag(), preference=True, group="masks"), *(
            Action(f"show {name}", f"{'SHIFT+' if i >= 10 else ''}{(i + 1) % 10}", f"mask: {label_of(reason)}",
                   partial(_switch_mask, name=name))
            for i, (name, reason) in enumerate(OVERLAYS.items())
        )),
    )  # fmt: skip
    overlays: bool = control(True, Flag(  # all overlays together
        "H", "hide or show all masks", group="masks", section="masks", label="masks", preference=True,
    ))  # fmt: skip
    exact: bool = control(False, Flag(
        "SHIFT+H", "exact reasons instead of the masks: by rays and the light of the same points", group="masks",
        section="masks", label="exact reasons",
    ))  # fmt: skip
    opacity: float = control(0.7, Number(0.0, 1.0, preference=True, group="masks"),
        Action("opacity down", "MINUS", "more transparent masks", lambda s: _change_opacity(s, -0.1)),
        Action("opacity up", "EQUAL", "more opaque masks", lambda s: _change_opacity(s, 0.1)),
    )  # fmt: skip
    # the feature whose threshold the keys change
    feature: str = control("position", Choice(FEATURES, group="thresholds", restarts=NOTHING),
        Action("next threshold", "T", "select the next threshold", _next_threshold),
    )  # fmt: skip
    thresholds: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(FEATURES, 32 / 255),
        metadata=declared(Members("threshold", Number(0.0, MAX_THRESHOLD), restarts=MASKS, group="thresholds"),
            Action("threshold up", "PAGE_UP", "raise the selected threshold by 10 %", lambda s: s.scale_threshold(1.1)),
            Action("threshold down", "PAGE_DOWN", "lower the selected threshold by 10 %",
                   lambda s: s.scale_threshold(1 / 1.1)),
            Action("threshold double", "SHIFT+PAGE_UP", "double the selected threshold",
                   lambda s: s.scale_threshold(2.0)),
            Action("threshold half", "SHIFT+PAGE_DOWN", "halve the selected threshold",
                   lambda s: s.scale_threshold(0.5)),
            Action("threshold default", "BACKSPACE", "reset the selected threshold",
                   lambda s: s.set_threshold(s.feature, s.default_thresholds[s.feature])),
        ),
    )  # fmt: skip
    default_thresholds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(FEATURES, 32 / 255))
    unit_scale: float = 1.0  # scene units per meter

    # settings
    live: Live = Live()
    moving_light: str = control("quarter", Choice(  # light while the image moves
        MOVING_LIGHTS, section="settings", label="while moving", restarts=NOTHING,
    ))  # fmt: skip
    samples: int = control(64, Number(  # path-traced samples per pixel while the image is still; 0: none
        0, MOST_SAMPLES, whole=True, slider=(0, 1024), text="%d samples", logarithmic=True, section="settings",
        label="path tracing", restarts=NOTHING,
    ))  # fmt: skip
    moving: bool = False  # whether the image moves: playback, or a camera that the user moves
    elapsed: float = 0.0  # seconds of the last step of time
    still_seconds: float = 0.0  # since it moved last

    # probe and scene
    probe_pinned: bool = control(False, Flag(group="probe", restarts=NOTHING),
        Action("pin probe", "P", "pin the probe, or let it follow the mouse", _pin),
    )  # fmt: skip
    probe: tuple[int, int] | None = control(None, Special(  # pixel (x, row from the top)
        lambda s: {"probe": "none" if s.probe is None else f"{s.probe[0]},{s.probe[1]}"}, _write_probe,
        group="probe", restarts=NOTHING),
        Action("probe left", "CTRL+LEFT", "probe one pixel left", lambda s: _move_probe(s, -1, 0)),
        Action("probe right", "CTRL+RIGHT", "probe one pixel right", lambda s: _move_probe(s, 1, 0)),
        Action("probe up", "CTRL+UP", "probe one pixel up", lambda s: _move_probe(s, 0, -1)),
        Action("probe down", "CTRL+DOWN", "probe one pixel down", lambda s: _move_probe(s, 0, 1)),
    )  # fmt: skip
    magnified: int = control(11, Special(  # pixels along a side of the magnified images, odd
        lambda s: {"magnified": s.magnified}, _write_magnified, restarts=NOTHING,
    ))  # fmt: skip
    nodes: tuple[str, ...] = ()  # labels of the scene's nodes, by index
    selection: int | None = control(None, Special(  # the selected node, whose pixels are outlined
        lambda s: {"selection": NO_NODE if s.selection is None else s.nodes[s.selection]}, _write_selection,
        group="probe"),
        Action("select", "SHIFT+P", "select the node at the probe, as a right click on the image does",
               lambda s: setattr(s, "pick", s.probe)),
    )  # fmt: skip
    pick: tuple[int, int] | None = None  # pixel whose node is to be selected

    # effects
    effects: tuple[str, ...] = ()  # effects that can be toggled
    effect: str = control("", Choice(  # the effect that the keys toggle
        lambda s: s.effects, group="effects", restarts=NOTHING),
        Action("next effect", "G", "select the next effect", lambda s: _next(s, "effect", "effect")),
    )  # fmt: skip
    switched_off: frozenset[str] = control(frozenset(), Special(
        lambda s: {f"effect.{n}": int(n not in s.switched_off) for n in s.effects}, _write_effect,
        group="effects", restarts=SOURCE),
        Action("toggle effect", "ENTER", "disable or enable the selected effect", _toggle_effect),
    )  # fmt: skip

    # window
    panels: bool = control(True, Flag(
        "TAB", "hide or show the panels", group="window", restarts=NOTHING, preference=True,
    ))  # fmt: skip
    help: bool = control(False, Flag(
        "SHIFT+SLASH F1", "show this list", group="window", restarts=NOTHING, in_session=False,
    ))  # fmt: skip
    sections: dict[str, bool] = field(  # measuring time is slow
        default_factory=lambda: {n: n != "time" for n in SECTIONS},
        metadata=declared(Members("section", Flag(), preference=True, group="window", restarts=NOTHING), *(
            Action(f"section {name}", f"SHIFT+F{i}" if i < 12 else "SHIFT+T", f"open or close {name}",
                   partial(_switch_section, name=name))
            for i, name in enumerate(SECTIONS, 1)
        )),
    )  # fmt: skip
    size: tuple[int, int] = (1, 1)  # image width and height, pixels
    message: str = ""
    lesson: str = ""  # text of a session file: a title, then paragraphs; empty: no section
    requests: list[str] = field(default_factory=list)  # actions that the model serves: screenshot, quit, ...
    clock: float = 0.0  # frames due while playing, fractional
    flicker_clock: float = 0.0  # seconds since the flicker changed images

    @property
    def low(self) -> float:
        """Lower end of the display range."""
        return self.display_range[0]

    @property
    def high(self) -> float:
        """Upper end of the display range."""
        return self.display_range[1]

    @property
    def range(self) -> tuple[int, int]:
        """First and last frame of playback."""
        return self.loop if self.loop is not None else (self.first, self.last)

    def go_to(self, frame: int) -> None:
        """Show ``frame``, clamped to the sequence."""
        self.frame = min(max(int(frame), self.first), self.last)

    def step(self, frames: int) -> None:
        """Stop playback and go ``frames`` forward, or back if it is negative."""
        self.playing = False
        self.go_to(self.frame + frames)

    def advance(self, seconds: float) -> None:
        """Advance playback by ``seconds``, by at most one frame: no pair is skipped, a slow machine plays slower."""
        self._flicker(seconds)
        self.elapsed = seconds
        self.still_seconds = 0.0 if self.moving or self.playing else self.still_seconds + seconds
        if not self.playing:
            self.clock = 0.0
            return
        self.clock += seconds * self.fps * self.speed
        if self.clock < 1.0:
            return
        self.clock = min(self.clock - 1.0, 1.0)
        self.frame = self.next_frame

    @property
    def next_frame(self) -> int:
        """The frame after this one in playback."""
        low, high = self.range
        return self.frame + 1 if low <= self.frame < high else low

    def _flicker(self, seconds: float) -> None:
        """Advance the clock that exchanges the image with the other one, while they flicker."""
        if self.comparison != "flicker":
            self.flicker_clock, self.flicker_other = 0.0, False
            return
        self.flicker_clock += seconds
        if self.flicker_clock >= 1.0 / self.flicker_hz:
            self.flicker_clock, self.flicker_other = 0.0, not self.flicker_other

    @property
    def busy(self) -> bool:
        """Whether the image changes by itself."""
        return self.playing or self.comparison == "flicker"

    def set_loop(self, low: int | None = None, high: int | None = None) -> None:
        """Move one end of the loop; the other end follows if they would cross."""
        a, b = self.range
        a, b = (min(max(v, self.first), self.last) for v in (a if low is None else low, b if high is None else high))
        if a > b:
            a, b = (a, a) if low is not None else (b, b)
        self.loop = None if (a, b) == (self.first, self.last) else (a, b)

    def set_threshold(self, feature: str, value: float) -> None:
        """Set the threshold of a feature, clamped to 0 .. MAX_THRESHOLD, in scene units for positions."""
        self.thresholds[feature] = min(max(float(value), 0.0), MAX_THRESHOLD)

    def unit(self, feature: str) -> str:
        """Unit of a threshold or distance as a suffix: positions are in scene units, which are often meters."""
        return "" if feature != "position" else " m" if self.unit_scale == 1.0 else " units"

    def scale_threshold(self, factor: float) -> None:
        """Multiply the selected threshold; from 0 it restarts at the smallest value."""
        value = self.thresholds[self.feature]
        self.set_threshold(self.feature, max(value * factor, MIN_THRESHOLD if factor > 1 else 0.0))
        self.message = f"{self.feature} threshold {self.thresholds[self.feature]:.4g}"

    def set_range(self, low: float, high: float) -> None:
        """Set a manual display range; the ends never coincide."""
        if math.isfinite(low) and math.isfinite(high):
            self.auto_range = False
            self.display_range = float(low), max(float(high), float(low) + 1e-6 * max(1.0, abs(low)))

    @property
    def has_exact_frames(self) -> bool:
        """Whether the method's input has exact frames, with which ghosts and the bound are compared."""
        return not self.method_input.startswith("path-traced")

    @property
    def comparisons(self) -> tuple[str, ...]:
        """The members of COMPARISONS that the method's input allows, in their order."""
        return COMPARISONS if self.has_exact_frames else tuple(name for name in COMPARISONS if name != "ghost")

    @property
    def method_images(self) -> tuple[str, ...]:
        """The members of METHOD_IMAGES that the method's input allows, in their order."""
        return METHOD_IMAGES if self.has_exact_frames else ("result",)

    def toggle_effect(self, effect: str) -> None:
        """Disable an enabled effect, or enable it again."""
        self.switched_off = self.switched_off ^ {effect}

    def active_overlays(self) -> tuple[str, ...]:
        """Keys of the masks, or of the exact reasons, that are drawn over the image."""
        if not self.overlays:
            return ()
        return tuple(EXACT_OVERLAYS) if self.exact else tuple(n for n, on in self.shown.items() if on)

    def restarted_by(self, *parts: str) -> tuple[Any, ...]:
        """Values of the controls that restart ``parts`` (IMAGE, MASKS, SOURCE); they compare equal while none does."""
        values = (c.get(self) for c in CONTROLS.values() if c.restarts in parts)
        return tuple(tuple(value.items()) if isinstance(value, dict) else value for value in values)


CONTROLS: dict[str, Control] = {c.name: c for c in [*controls_of(Live, live=True), *controls_of(ViewerState)]}
"""Every control by the name of its field."""


def _named(state: ViewerState) -> dict[str, Control]:
    """Every name that scripts can set, with its control."""
    return {name: c for c in CONTROLS.values() for name in c.read(state)}


def set_variable(state: ViewerState, name: str, text: str) -> None:
    """Set ``name`` to the value that ``text`` spells.  Raises SettingsError that lists the names or values."""
    named = _named(state)
    if name not in named:
        raise SettingsError(f"there is no {name!r}", hint=f"choose from {', '.join(named)}")
    named[name].write(state, name, text)


def set_variables(state: ViewerState, values: Mapping[str, str | int | float]) -> list[str]:
    """Set many variables, as a file of this or another version names them; the names that do not fit ``state``."""
    misfits = []
    for name, value in values.items():
        try:
            set_variable(state, name, str(value))
        except SettingsError:
            misfits.append(name)
    return misfits


def variables(state: ViewerState) -> dict[str, Any]:
    """Every name of ``set_variable`` with its value, a number or text, and some that can only be read."""
    values = {name: value for c in CONTROLS.values() for name, value in c.read(state).items()}
    x, y = state.probe or (-1, -1)
    fixed = {"first": state.first, "last": state.last, "probe.x": x, "probe.y": y}
    return values | fixed | {"message": state.message}
