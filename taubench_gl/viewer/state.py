"""What the viewer shows, as plain values: no window, no OpenGL.  Actions change it, the engine draws it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from taubench_gl.conventions import FEATURES, FRUSTUM, Reason
from taubench_gl.errors import SettingsError
from taubench_gl.glossary import key_of

CAMERAS = ("file", "fly", "orbit")
COMPARISONS = ("off", "split", "difference")
SECTIONS = ("playback", "camera", "picture", "masks", "thresholds", "probe", "effects", "time")
SPEEDS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
MIN_THRESHOLD, MAX_THRESHOLD = 1e-5, 100.0

OVERLAYS: dict[str, Reason] = {
    key_of(reason): reason
    for reason in (
        FRUSTUM, Reason.POSITION, Reason.NORMAL, Reason.DIRECT, Reason.INDIRECT, Reason.COLOR, Reason.DISOCCLUDED,
        Reason.OCCLUDING, Reason.LIT, Reason.SHADOWED, Reason.BEHIND, Reason.OUTSIDE, Reason.SKY, Reason.HISTORY_SKY,
        Reason.INVALID, Reason.FIRST, Reason.CUT,
    )
}  # fmt: skip
"""Mask overlays by name, in the order of the legend and of the keys."""


@dataclass(slots=True)
class ViewerState:
    """Everything a person can set.  ``first`` and ``last``: the frames there are."""

    first: int = 0
    last: int = 0
    fps: float = 24.0
    frame: int = 0
    playing: bool = False
    speed: float = 1.0
    loop: tuple[int, int] | None = None  # first and last frame of the loop; None: all
    camera: str = "file"
    freeze_current: bool = False
    freeze_previous: bool = False
    frusta: bool = True  # outlines of frozen cameras
    channels: tuple[str, ...] = ("shape",)  # names of ``pictures.PICTURES`` that can be shown
    channel: str = "shape"
    auto_range: bool = True
    low: float = 0.0
    high: float = 1.0
    overlays: bool = True  # all of them together
    shown: dict[str, bool] = field(
        default_factory=lambda: {n: n in ("frustum", "position", "normal") for n in OVERLAYS}
    )
    opacity: float = 0.7
    thresholds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(FEATURES, 32 / 255))
    default_thresholds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(FEATURES, 32 / 255))
    feature: str = "position"  # whose threshold the keys change
    unit_scale: float = 1.0  # scene units per metre
    comparison: str = "off"
    split: float = 0.5  # of the picture's width
    gain: float = 4.0  # of the difference view
    arrows: bool = False
    effects: tuple[str, ...] = ()  # that can be switched
    effect: str = ""  # the one the keys switch
    switched_off: frozenset[str] = frozenset()
    panels: bool = True
    sections: dict[str, bool] = field(default_factory=lambda: {n: n != "time" for n in SECTIONS})  # timing costs time
    help: bool = False
    probe: tuple[int, int] | None = None  # pixel (x, row from the top)
    probe_pinned: bool = False
    size: tuple[int, int] = (1, 1)  # of the picture
    message: str = ""
    requests: list[str] = field(default_factory=list)  # what only the application can do: screenshot, quit, ...
    clock: float = 0.0  # seconds owed to the next frame while playing

    @property
    def range(self) -> tuple[int, int]:
        """First and last frame that playing visits."""
        return self.loop if self.loop is not None else (self.first, self.last)

    def go_to(self, frame: int) -> None:
        """Show ``frame``, or the nearest there is."""
        self.frame = min(max(int(frame), self.first), self.last)

    def step(self, frames: int) -> None:
        self.playing = False
        self.go_to(self.frame + frames)

    def advance(self, seconds: float) -> None:
        """Let ``seconds`` pass.  At most one frame per call: every pair is shown, a slow machine plays slower."""
        if not self.playing:
            self.clock = 0.0
            return
        self.clock += seconds * self.fps * self.speed
        if self.clock < 1.0:
            return
        self.clock = min(self.clock - 1.0, 1.0)
        low, high = self.range
        self.frame = self.frame + 1 if low <= self.frame < high else low

    def set_loop(self, low: int | None = None, high: int | None = None) -> None:
        """Move one end of the loop; the other gives way."""
        a, b = self.range
        a, b = (min(max(v, self.first), self.last) for v in (a if low is None else low, b if high is None else high))
        if a > b:
            a, b = (a, a) if low is not None else (b, b)
        self.loop = None if (a, b) == (self.first, self.last) else (a, b)

    def set_threshold(self, feature: str, value: float) -> None:
        self.thresholds[feature] = min(max(float(value), 0.0), MAX_THRESHOLD)

    def unit(self, feature: str) -> str:
        """What follows a threshold or a distance: positions are in scene units, which may be metres."""
        return "" if feature != "position" else " m" if self.unit_scale == 1.0 else " units"

    def scale_threshold(self, factor: float) -> None:
        """Multiply the selected threshold; 0 starts again from the smallest."""
        value = self.thresholds[self.feature]
        self.set_threshold(self.feature, max(value * factor, MIN_THRESHOLD if factor > 1 else 0.0))
        self.message = f"{self.feature} threshold {self.thresholds[self.feature]:.4g}"

    def set_range(self, low: float, high: float) -> None:
        """A manual range; the two ends never meet."""
        if math.isfinite(low) and math.isfinite(high):
            self.auto_range = False
            self.low, self.high = float(low), max(float(high), float(low) + 1e-6 * max(1.0, abs(low)))

    def switch(self, effect: str) -> None:
        self.switched_off = self.switched_off ^ {effect}

    def active_overlays(self) -> tuple[str, ...]:
        return tuple(n for n, on in self.shown.items() if on) if self.overlays else ()


def following(items: tuple[str, ...], item: str, step: int = 1) -> str:
    """The item ``step`` places on, round the end; the first where ``item`` is not among them."""
    return items[(items.index(item) + step) % len(items)] if item in items else items[0]


_FLAGS = (
    "playing", "freeze_current", "freeze_previous", "frusta", "auto_range", "overlays", "arrows", "panels", "help",
    "probe_pinned",
)  # fmt: skip
_NUMBERS = {"speed": (0.01, 16.0), "opacity": (0.0, 1.0), "split": (0.0, 1.0), "gain": (0.01, 1e4)}
_CHOICES: dict[str, Callable[[ViewerState], tuple[str, ...]]] = {
    "camera": lambda s: CAMERAS,
    "channel": lambda s: s.channels,
    "comparison": lambda s: COMPARISONS,
    "feature": lambda s: tuple(s.thresholds),
    "effect": lambda s: s.effects,
}


def variable_names(state: ViewerState) -> list[str]:
    """Every name that ``set_variable`` takes."""
    groups = [("show", state.shown), ("threshold", state.thresholds), ("section", state.sections)]
    dotted = [f"{group}.{name}" for group, members in groups for name in members]
    dotted += [f"effect.{name}" for name in state.effects]
    return ["frame", "loop.first", "loop.last", "range.low", "range.high", *_FLAGS, *_NUMBERS, *_CHOICES, *dotted]


def set_variable(state: ViewerState, name: str, text: str) -> None:
    """Set ``name`` to the value that ``text`` spells.  Raises SettingsError naming what there is."""
    group, _, member = name.partition(".")
    if name == "frame":
        state.go_to(round(_number(name, text)))
    elif group == "loop" and member in ("first", "last"):
        state.set_loop(**{"low" if member == "first" else "high": round(_number(name, text))})
    elif group == "range" and member in ("low", "high"):
        value = _number(name, text)
        state.set_range(*((value, max(value, state.high)) if member == "low" else (min(value, state.low), value)))
    elif name in _FLAGS:
        setattr(state, name, _flag(name, text))
    elif name in _NUMBERS:
        low, high = _NUMBERS[name]
        setattr(state, name, min(max(_number(name, text), low), high))
    elif name in _CHOICES:
        allowed = _CHOICES[name](state)
        if text not in allowed:
            raise SettingsError(f"{name} cannot be {text!r}", hint=f"choose from {', '.join(allowed) or 'nothing'}")
        setattr(state, name, text)
    elif group == "show" and member in state.shown:
        state.shown[member] = _flag(name, text)
    elif group == "section" and member in state.sections:
        state.sections[member] = _flag(name, text)
    elif group == "threshold" and member in state.thresholds:
        state.set_threshold(member, _number(name, text))
    elif group == "effect" and member in state.effects:
        state.switched_off = (state.switched_off - {member}) | (frozenset() if _flag(name, text) else {member})
    else:
        raise SettingsError(f"there is no {name!r}", hint=f"choose from {', '.join(variable_names(state))}")


def variables(state: ViewerState) -> dict[str, Any]:
    """Every name of ``set_variable`` with its value: numbers, or text for choices."""
    low, high = state.range
    out: dict[str, Any] = {
        "frame": state.frame, "first": state.first, "last": state.last, "loop.first": low, "loop.last": high,
        "range.low": state.low, "range.high": state.high,
    }  # fmt: skip
    out |= {name: int(getattr(state, name)) for name in _FLAGS}
    out |= {name: getattr(state, name) for name in (*_NUMBERS, *_CHOICES)}
    out |= {f"show.{n}": int(on) for n, on in state.shown.items()}
    out |= {f"section.{n}": int(on) for n, on in state.sections.items()}
    out |= {f"threshold.{n}": v for n, v in state.thresholds.items()}
    out |= {f"effect.{n}": int(n not in state.switched_off) for n in state.effects}
    out["probe.x"], out["probe.y"] = state.probe or (-1, -1)
    return out | {"message": state.message}


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
