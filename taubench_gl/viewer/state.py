"""State of the viewer as plain values, without window or OpenGL.  Actions change it, the engine draws it.

``set_variable`` and ``variables`` give scripts and preferences access by name: ``threshold.normal``, ``show.position``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from taubench_gl.conventions import FRUSTUM, Reason, Visibility
from taubench_gl.errors import SettingsError
from taubench_gl.features import BY_BIT, COUNTED_BITS, FEATURES
from taubench_gl.glossary import EXACT_REASONS, key_of
from taubench_gl.reuse.loading import builtin_methods
from taubench_gl.settings import HISTORIES, LIGHTS, REPROJECTIONS, SAMPLINGS

CAMERAS = ("file", "fly", "orbit")
COMPARISONS = ("off", "split", "flicker", "difference", "error", "ghost")
NO_NODE = "none"
"""The selection without a node; no node has this label."""
HISTORY = ("history", "reprojected")
"""What every image can be compared with: the previous frame, and that frame looked up where motion leads."""
SECTIONS = (
    "playback",
    "camera",
    "image",
    "compare",
    "masks",
    "thresholds",
    "probe",
    "settings",
    "effects",
    "time",
    "lesson",
    "scene",
)
DOCKS = ("left", "right")
DOCKED = (
    "lesson", "probe", "thresholds", "scene", "camera", "image", "compare", "masks", "settings", "effects", "time",
)  # fmt: skip
"""Sections of the side panels, from the top."""
_LEFT = ("lesson", "probe", "thresholds", "scene")
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
SCALES = (0.25, 0.5, 1.0, 2.0)
"""Factors on the size of the image."""
MOST_SAMPLES = 65536
STOPS = 20.0
"""Range of the exposure in stops, either way."""


@dataclass(frozen=True, slots=True)
class Live:
    """Settings that change while looking at a scene; the defaults leave those of the source as they are."""

    reprojection: str = "camera"
    sampling: str = "nearest"
    light: str = "auto"
    history: str = "frame"  # frame | eye
    stops: float = 0.0  # exposure: a factor of 2^stops
    scale: float = 1.0  # of SCALES: a factor on the size of the image

    @property
    def exposure(self) -> float:
        """Factor on the exposure of the source."""
        return 2.0**self.stops


@dataclass(slots=True)
class ViewerState:
    """Everything the user can set.  ``first`` and ``last`` are the first and last frame of the sequence."""

    first: int = 0
    last: int = 0
    fps: float = 24.0
    frame: int = 0
    playing: bool = False
    speed: float = 1.0
    loop: tuple[int, int] | None = None  # first and last frame of the loop; None: the whole sequence
    camera: str = "file"
    freeze_current: bool = False
    freeze_previous: bool = False
    frusta: bool = True  # outlines of frozen cameras
    channels: tuple[str, ...] = ("headlight",)  # keys of ``display.VISUALIZATIONS`` that the source has
    channel: str = "headlight"
    auto_range: bool = True
    low: float = 0.0
    high: float = 1.0
    overlays: bool = True  # all overlays together
    shown: dict[str, bool] = field(
        default_factory=lambda: {n: n in ("frustum", "position", "normal") for n in OVERLAYS}
    )
    exact: bool = False  # exact reasons instead of the masks
    opacity: float = 0.7
    thresholds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(FEATURES, 32 / 255))
    default_thresholds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(FEATURES, 32 / 255))
    feature: str = "position"  # the feature whose threshold the keys change
    unit_scale: float = 1.0  # scene units per meter
    comparison: str = "off"
    against: str = "reprojected"  # of ``others``
    others: tuple[str, ...] = HISTORY  # what the image can be compared with
    beside: bool = False  # the other image and the error map beside the image
    methods: tuple[str, ...] = field(default_factory=builtin_methods)  # reuse methods to compare with
    method: str = "taa_clamp"  # of ``methods``
    method_input: str = "noisy"  # of METHOD_INPUTS
    method_image: str = "result"  # of METHOD_IMAGES
    flicker_hz: float = 2.0  # changes per second between the image and the other
    flicker_other: bool = False  # whether the other is shown now
    split: float = 0.5  # fraction of the image width
    gain: float = 4.0  # factor of the difference image
    arrows: bool = False
    arrow_scale: float = 0.0  # length of an arrow per pixel of motion; 0: the longest arrows reach their neighbors
    live: Live = Live()
    moving_light: str = "quarter"  # of MOVING_LIGHTS: light while the image moves
    samples: int = 64  # path-traced samples per pixel while the image is still; 0: none
    moving: bool = False  # whether the image moves: playback, or a camera that the user moves
    elapsed: float = 0.0  # seconds of the last step of time
    still_seconds: float = 0.0  # since it moved last
    effects: tuple[str, ...] = ()  # effects that can be toggled
    effect: str = ""  # the effect that the keys toggle
    switched_off: frozenset[str] = frozenset()
    panels: bool = True
    sections: dict[str, bool] = field(default_factory=lambda: {n: n != "time" for n in SECTIONS})  # timing is slow
    docks: dict[str, str] = field(default_factory=lambda: {n: DOCKS[n not in _LEFT] for n in DOCKED})
    help: bool = False
    probe: tuple[int, int] | None = None  # pixel (x, row from the top)
    probe_pinned: bool = False
    nodes: tuple[str, ...] = ()  # labels of the scene's nodes, by index
    selection: int | None = None  # the selected node, whose pixels are outlined
    pick: tuple[int, int] | None = None  # pixel whose node is to be selected
    magnified: int = 11  # pixels along a side of the magnified images, odd
    size: tuple[int, int] = (1, 1)  # image width and height, pixels
    message: str = ""
    lesson: str = ""  # text of a session file: a title, then paragraphs; empty: no section
    requests: list[str] = field(default_factory=list)  # actions that the model serves: screenshot, quit, ...
    clock: float = 0.0  # frames due while playing, fractional
    flicker_clock: float = 0.0  # seconds since the flicker changed images

    @property
    def range(self) -> tuple[int, int]:
        """First and last frame of playback."""
        return self.loop if self.loop is not None else (self.first, self.last)

    def go_to(self, frame: int) -> None:
        """Show ``frame``, clamped to the sequence."""
        self.frame = min(max(int(frame), self.first), self.last)

    def step(self, frames: int) -> None:
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
            self.low, self.high = float(low), max(float(high), float(low) + 1e-6 * max(1.0, abs(low)))

    @property
    def has_exact_frames(self) -> bool:
        """Whether the method's input has exact frames, with which ghosts and the bound are compared."""
        return not self.method_input.startswith("path-traced")

    @property
    def comparisons(self) -> tuple[str, ...]:
        """Those of COMPARISONS that the method's input allows."""
        return COMPARISONS if self.has_exact_frames else tuple(name for name in COMPARISONS if name != "ghost")

    @property
    def method_images(self) -> tuple[str, ...]:
        """Those of METHOD_IMAGES that the method's input allows."""
        return METHOD_IMAGES if self.has_exact_frames else ("result",)

    def toggle_effect(self, effect: str) -> None:
        self.switched_off = self.switched_off ^ {effect}

    def active_overlays(self) -> tuple[str, ...]:
        if not self.overlays:
            return ()
        return tuple(EXACT_OVERLAYS) if self.exact else tuple(n for n, on in self.shown.items() if on)


def following(items: tuple[str, ...], item: str, step: int = 1) -> str:
    """The item ``step`` places after ``item``, cyclic; the first if ``item`` is not in ``items``."""
    return items[(items.index(item) + step) % len(items)] if item in items else items[0]


# Variables: everything that scripts can set or read

_FLAGS = (
    "playing", "freeze_current", "freeze_previous", "frusta", "auto_range", "overlays", "arrows", "panels", "help",
    "probe_pinned", "beside", "exact",
)  # fmt: skip
_NUMBERS = {"speed": (0.01, 16.0), "opacity": (0.0, 1.0), "split": (0.0, 1.0), "gain": (0.01, 1e4),
            "flicker_hz": (0.25, 30.0), "arrow_scale": (0.0, 100.0)}  # fmt: skip
_CHOICES: dict[str, Callable[[ViewerState], tuple[str, ...]]] = {
    "camera": lambda s: CAMERAS,
    "channel": lambda s: s.channels,
    "comparison": lambda s: s.comparisons,
    "against": lambda s: s.others,
    "method": lambda s: s.methods,
    "method_input": lambda s: METHOD_INPUTS,
    "method_image": lambda s: s.method_images,
    "moving_light": lambda s: MOVING_LIGHTS,
    "feature": lambda s: tuple(s.thresholds),
    "effect": lambda s: s.effects,
}
LIVE_CHOICES: dict[str, tuple[str, ...]] = {
    "reprojection": REPROJECTIONS, "sampling": SAMPLINGS, "light": LIGHTS, "scale": tuple(f"{s:g}" for s in SCALES),
    "history": HISTORIES[:2],
}  # fmt: skip


def variable_names(state: ViewerState) -> list[str]:
    """Every name that ``set_variable`` takes."""
    groups = [("show", state.shown), ("threshold", state.thresholds), ("section", state.sections)]
    dotted = [f"{group}.{name}" for group, members in groups for name in members]
    dotted += [f"effect.{name}" for name in state.effects]
    dotted += [f"dock.{name}" for name in state.docks]
    plain = ["frame", "probe", "magnified", "samples", "stops", "loop.first", "loop.last", "range.low", "range.high"]
    return [*plain, "selection", *LIVE_CHOICES, *_FLAGS, *_NUMBERS, *_CHOICES, *dotted]


def set_variable(state: ViewerState, name: str, text: str) -> None:
    """Set ``name`` to the value that ``text`` spells.  Raises SettingsError that lists the names or values."""
    group, _, member = name.partition(".")
    if name == "frame":
        state.go_to(round(_number(name, text)))
    elif name == "probe":
        state.probe = _pixel(name, text, state.size)
    elif name == "selection":
        if text not in (NO_NODE, *state.nodes):
            raise SettingsError(f"there is no node {text!r}", hint=f"give a name of the tree, or {NO_NODE}")
        state.selection = None if text == NO_NODE else state.nodes.index(text)
    elif name == "samples":
        state.samples = min(max(round(_number(name, text)), 0), MOST_SAMPLES)
    elif name == "magnified":
        state.magnified = 2 * (min(max(round(_number(name, text)), 3), 61) // 2) + 1
    elif group == "loop" and member in ("first", "last"):
        state.set_loop(**{"low" if member == "first" else "high": round(_number(name, text))})
    elif group == "range" and member in ("low", "high"):
        value = _number(name, text)
        state.set_range(*((value, max(value, state.high)) if member == "low" else (min(value, state.low), value)))
    elif name in LIVE_CHOICES:
        text = f"{_number(name, text):g}" if name == "scale" else text
        text = _chosen(name, text, LIVE_CHOICES[name])
        state.live = replace(state.live, **{name: float(text) if name == "scale" else text})
    elif name == "stops":
        state.live = replace(state.live, stops=min(max(_number(name, text), -STOPS), STOPS))
    elif name in _FLAGS:
        setattr(state, name, _flag(name, text))
    elif name in _NUMBERS:
        low, high = _NUMBERS[name]
        setattr(state, name, min(max(_number(name, text), low), high))
    elif name in _CHOICES:
        setattr(state, name, _chosen(name, text, _CHOICES[name](state)))
    elif group == "show" and member in state.shown:
        state.shown[member] = _flag(name, text)
    elif group == "section" and member in state.sections:
        state.sections[member] = _flag(name, text)
    elif group == "dock" and member in state.docks:
        state.docks[member] = _chosen(name, text, DOCKS)
    elif group == "threshold" and member in state.thresholds:
        state.set_threshold(member, _number(name, text))
    elif group == "effect" and member in state.effects:
        state.switched_off = (state.switched_off - {member}) | (frozenset() if _flag(name, text) else {member})
    else:
        raise SettingsError(f"there is no {name!r}", hint=f"choose from {', '.join(variable_names(state))}")


def variables(state: ViewerState) -> dict[str, Any]:
    """Every name of ``set_variable`` with its value, a number or text, and some that can only be read."""
    low, high = state.range
    out: dict[str, Any] = {
        "frame": state.frame, "probe": _pixel_text(state.probe), "magnified": state.magnified,
        "selection": NO_NODE if state.selection is None else state.nodes[state.selection],
        "samples": state.samples,
        "first": state.first, "last": state.last, "loop.first": low, "loop.last": high,
        "range.low": state.low, "range.high": state.high,
    }  # fmt: skip
    out |= {name: getattr(state.live, name) for name in ("stops", *LIVE_CHOICES)}
    out |= {name: int(getattr(state, name)) for name in _FLAGS}
    out |= {name: getattr(state, name) for name in (*_NUMBERS, *_CHOICES)}
    out |= {f"show.{n}": int(on) for n, on in state.shown.items()}
    out |= {f"section.{n}": int(on) for n, on in state.sections.items()}
    out |= {f"dock.{n}": side for n, side in state.docks.items()}
    out |= {f"threshold.{n}": v for n, v in state.thresholds.items()}
    out |= {f"effect.{n}": int(n not in state.switched_off) for n in state.effects}
    out["probe.x"], out["probe.y"] = state.probe or (-1, -1)
    return out | {"message": state.message}


def _pixel(name: str, text: str, size: tuple[int, int]) -> tuple[int, int] | None:
    """``X,Y`` within an image of ``size``, row from the top; ``none``."""
    if text == "none":
        return None
    match = re.fullmatch(r"(\d{1,6}),(\d{1,6})", text)
    if match is None or int(match[1]) >= size[0] or int(match[2]) >= size[1]:
        raise SettingsError(f"{name} cannot be {text!r}", hint=f"give X,Y below {size[0]},{size[1]}, or none")
    return int(match[1]), int(match[2])


def _pixel_text(pixel: tuple[int, int] | None) -> str:
    return "none" if pixel is None else f"{pixel[0]},{pixel[1]}"


def _chosen(name: str, text: str, allowed: tuple[str, ...]) -> str:
    if text not in allowed:
        raise SettingsError(f"{name} cannot be {text!r}", hint=f"choose from {', '.join(allowed) or 'nothing'}")
    return text


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e30:
        raise SettingsError(f"{name} cannot be {text!r}", hint="give a number")
    return value


def _flag(name: str, text: str) -> bool:
    flags = {"1": True, "on": True, "true": True, "yes": True, "0": False, "off": False, "false": False, "no": False}
    if text.lower() not in flags:
        raise SettingsError(f"{name} cannot be {text!r}", hint="give on or off")
    return flags[text.lower()]
