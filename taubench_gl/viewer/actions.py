"""What a key, a button or a script line can do to the state.  One table: name, words for people, function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from taubench_gl.conventions import FEATURES
from taubench_gl.viewer.state import COMPARISONS, OVERLAYS, SECTIONS, SPEEDS, ViewerState, following

Change = Callable[[ViewerState], None]


@dataclass(frozen=True, slots=True)
class Action:
    name: str
    group: str
    doc: str
    run: Change


ACTIONS: dict[str, Action] = {}


def _action(name: str, group: str, doc: str) -> Callable[[Change], Change]:
    def add(function: Change) -> Change:
        ACTIONS[name] = Action(name, group, doc, function)
        return function

    return add


def _toggle(name: str, group: str, doc: str, attribute: str) -> None:
    @_action(name, group, doc)
    def flip(s: ViewerState) -> None:
        setattr(s, attribute, not getattr(s, attribute))


def _request(name: str, group: str, doc: str) -> None:
    _action(name, group, doc)(lambda s: s.requests.append(name))


def _assign(name: str, group: str, doc: str, attribute: str, value: object) -> None:
    _action(name, group, doc)(lambda s: setattr(s, attribute, value))


_toggle("play", "playback", "play or pause", "playing")
for _name, _step, _doc in (
    ("next", 1, "next frame"),
    ("previous", -1, "previous frame"),
    ("forward", 10, "ten frames on"),
    ("back", -10, "ten frames back"),
):
    _action(_name, "playback", _doc)(lambda s, step=_step: s.step(step))
_action("first", "playback", "first frame")(lambda s: s.step(s.first - s.frame))
_action("last", "playback", "last frame")(lambda s: s.step(s.last - s.frame))
_action("loop from", "playback", "loop starts at this frame")(lambda s: s.set_loop(low=s.frame))
_action("loop to", "playback", "loop ends at this frame")(lambda s: s.set_loop(high=s.frame))
_assign("loop all", "playback", "loop over everything", "loop", None)


def _speed(s: ViewerState, step: int) -> None:
    nearest = min(range(len(SPEEDS)), key=lambda i: abs(SPEEDS[i] - s.speed))
    s.speed = SPEEDS[min(max(nearest + step, 0), len(SPEEDS) - 1)]
    s.message = f"speed {s.speed:g}"


_action("slower", "playback", "play slower")(lambda s: _speed(s, -1))
_action("faster", "playback", "play faster")(lambda s: _speed(s, 1))

_assign("file camera", "camera", "the scene's own camera", "camera", "file")
_assign("fly", "camera", "fly: W A S D move, Q E down and up, Shift fast, drag or I J K L look", "camera", "fly")
_assign("orbit", "camera", "orbit: drag or I J K L turn, wheel or W S come near and go far", "camera", "orbit")
_request("reset camera", "camera", "fly and orbit start again from the scene's camera")
_toggle("freeze current", "camera", "hold the current camera; look on from outside", "freeze_current")
_toggle("freeze previous", "camera", "hold the previous camera; walk around its frustum", "freeze_previous")
_toggle("frusta", "camera", "outlines of held cameras", "frusta")


def _channel(s: ViewerState, step: int) -> None:
    s.channel = following(s.channels, s.channel, step)
    s.message = f"picture: {s.channel.replace('_', ' ')}"


_action("next picture", "picture", "next channel as picture")(lambda s: _channel(s, 1))
_action("previous picture", "picture", "previous channel")(lambda s: _channel(s, -1))


@_action("motion error", "picture", "supplied against expected motion, and back")
def _motion_error(s: ViewerState) -> None:
    s.channel = s.channels[0] if s.channel == "motion_error" else "motion_error"


_toggle("auto range", "picture", "range from the picture's least and largest value", "auto_range")
_action("range up", "picture", "upper end of the range up")(
    lambda s: s.set_range(s.low, s.high + 0.1 * (s.high - s.low))
)
_action("range down", "picture", "upper end down")(lambda s: s.set_range(s.low, s.high - 0.1 * (s.high - s.low)))
_action("low up", "picture", "lower end of the range up")(lambda s: s.set_range(s.low + 0.1 * (s.high - s.low), s.high))
_action("low down", "picture", "lower end down")(lambda s: s.set_range(s.low - 0.1 * (s.high - s.low), s.high))
_toggle("arrows", "picture", "arrows from each pixel to where it was", "arrows")


@_action("compare", "picture", "against the reference: off, split, difference")
def _compare(s: ViewerState) -> None:
    s.comparison = following(COMPARISONS, s.comparison)
    s.message = f"comparison: {s.comparison}"


def _split(s: ViewerState, by: float) -> None:
    s.split = min(max(s.split + by, 0.0), 1.0)


_action("split left", "picture", "split line to the left")(lambda s: _split(s, -0.02))
_action("split right", "picture", "split line to the right")(lambda s: _split(s, 0.02))

for _name in OVERLAYS:

    @_action(f"show {_name}", "masks", f"mask of {_name.replace('_', ' ')}")
    def _show(s: ViewerState, name: str = _name) -> None:
        s.shown[name] = not s.shown[name]
        s.overlays = s.overlays or s.shown[name]


_toggle("overlays", "masks", "all masks off, or those chosen", "overlays")


def _opacity(s: ViewerState, by: float) -> None:
    s.opacity = round(min(max(s.opacity + by, 0.0), 1.0), 3)
    s.message = f"opacity {s.opacity:.2f}"


_action("opacity down", "masks", "masks more transparent")(lambda s: _opacity(s, -0.1))
_action("opacity up", "masks", "masks more opaque")(lambda s: _opacity(s, 0.1))


@_action("next threshold", "thresholds", "choose the next feature's threshold")
def _next_threshold(s: ViewerState) -> None:
    s.feature = following(FEATURES, s.feature)
    s.message = f"{s.feature} threshold {s.thresholds[s.feature]:.4g}"


_action("threshold up", "thresholds", "chosen threshold up by a tenth")(lambda s: s.scale_threshold(1.1))
_action("threshold down", "thresholds", "down by a tenth")(lambda s: s.scale_threshold(1 / 1.1))
_action("threshold double", "thresholds", "chosen threshold times two")(lambda s: s.scale_threshold(2.0))
_action("threshold half", "thresholds", "half of it")(lambda s: s.scale_threshold(0.5))
_action("threshold default", "thresholds", "chosen threshold as it was")(
    lambda s: s.set_threshold(s.feature, s.default_thresholds[s.feature])
)


def _probe(s: ViewerState, dx: int, dy: int) -> None:
    x, y = s.probe or (s.size[0] // 2, s.size[1] // 2)
    s.probe_pinned = True
    s.probe = (min(max(x + dx, 0), s.size[0] - 1), min(max(y + dy, 0), s.size[1] - 1))


@_action("pin probe", "probe", "hold the probe where it is, or let it follow the mouse")
def _pin(s: ViewerState) -> None:
    if s.probe_pinned:
        s.probe_pinned = False
    else:
        _probe(s, 0, 0)


for _name, _dx, _dy in (("left", -1, 0), ("right", 1, 0), ("up", 0, -1), ("down", 0, 1)):
    _action(f"probe {_name}", "probe", f"probe one pixel {_name}")(lambda s, dx=_dx, dy=_dy: _probe(s, dx, dy))


@_action("next effect", "effects", "choose the next effect")
def _next_effect(s: ViewerState) -> None:
    if s.effects:
        s.effect = following(s.effects, s.effect)
        s.message = f"effect: {s.effect.replace('_', ' ')}"


@_action("switch effect", "effects", "switch the chosen effect off or on")
def _switch(s: ViewerState) -> None:
    if s.effect:
        s.switch(s.effect)


_toggle("panels", "window", "panels away, or back", "panels")
_toggle("help", "window", "this list", "help")
for _name in SECTIONS:

    @_action(f"section {_name}", "window", f"open or close {_name}")
    def _section(s: ViewerState, name: str = _name) -> None:
        s.sections[name] = not s.sections[name]


_request("screenshot", "window", "save the picture as PNG")
_request("window screenshot", "window", "save the whole window as PNG")
_request("clip", "window", "start or end a clip (mp4)")
_request("reload", "window", "read the scene from disk again")


@_action("escape", "window", "close the help; let go of held cameras")
def _escape(s: ViewerState) -> None:
    if s.help:
        s.help = False
    else:
        s.freeze_current = s.freeze_previous = False


_request("quit", "window", "quit")


KEYS: dict[str, str] = {
    "SPACE": "play", "RIGHT": "next", "LEFT": "previous", "SHIFT+RIGHT": "forward", "SHIFT+LEFT": "back",
    "HOME": "first", "END": "last", "LEFT_BRACKET": "loop from", "RIGHT_BRACKET": "loop to",
    "BACKSLASH": "loop all", "COMMA": "slower", "PERIOD": "faster",
    "V": "file camera", "F": "fly", "O": "orbit", "R": "reset camera", "C": "freeze current",
    "X": "freeze previous", "B": "frusta",
    "N": "next picture", "SHIFT+N": "previous picture", "SHIFT+U": "motion error", "M": "auto range",
    "UP": "range up", "DOWN": "range down", "SHIFT+UP": "low up", "SHIFT+DOWN": "low down", "U": "arrows",
    "Y": "compare", "SEMICOLON": "split left", "APOSTROPHE": "split right",
    **{f"{'SHIFT+' if i >= 10 else ''}{(i + 1) % 10}": f"show {name}" for i, name in enumerate(OVERLAYS)},
    "H": "overlays", "MINUS": "opacity down", "EQUAL": "opacity up",
    "T": "next threshold", "PAGE_UP": "threshold up", "PAGE_DOWN": "threshold down",
    "SHIFT+PAGE_UP": "threshold double", "SHIFT+PAGE_DOWN": "threshold half", "BACKSPACE": "threshold default",
    "P": "pin probe", "CTRL+LEFT": "probe left", "CTRL+RIGHT": "probe right", "CTRL+UP": "probe up",
    "CTRL+DOWN": "probe down",
    "G": "next effect", "ENTER": "switch effect",
    "TAB": "panels", "SHIFT+SLASH": "help", "F1": "help",
    **{f"SHIFT+F{i}": f"section {name}" for i, name in enumerate(SECTIONS, 1)},
    "F12": "screenshot", "SHIFT+F12": "window screenshot", "F9": "clip", "F5": "reload", "ESCAPE": "escape",
    "CTRL+Q": "quit",
}  # fmt: skip
"""Chord -> action.  Modifiers come first, in the order CTRL+ALT+SHIFT+; keys are named as GLFW names them."""

MOVEMENT = frozenset("WASDQEIJKL")
"""Keys that act for as long as they are held, in fly and orbit."""

_SIGNS = {
    "SHIFT+SLASH": "?", "COMMA": ",", "PERIOD": ".", "LEFT_BRACKET": "[", "RIGHT_BRACKET": "]", "BACKSLASH": "\\",
    "SEMICOLON": ";", "APOSTROPHE": "'", "MINUS": "-", "EQUAL": "=",
}  # fmt: skip


def chord(key: str, *, ctrl: bool = False, alt: bool = False, shift: bool = False) -> str:
    """The name of a key with its modifiers, as in KEYS."""
    return f"{'CTRL+' if ctrl else ''}{'ALT+' if alt else ''}{'SHIFT+' if shift else ''}{key}"


def split_chord(text: str) -> tuple[str, set[str]]:
    """``ctrl+q`` -> ("Q", {"CTRL"}); raises ValueError for a modifier there is not."""
    *modifiers, key = ("SHIFT+SLASH" if text == "?" else text.upper()).split("+")
    if not key or set(modifiers) - {"CTRL", "ALT", "SHIFT"}:
        raise ValueError(f"{text!r} is not a key such as SPACE, N or SHIFT+N")
    return key, set(modifiers)


def key_words(text: str) -> str:
    """A chord as people read it: ``Shift+N``, ``?``."""
    if text in _SIGNS:
        return _SIGNS[text]
    return "+".join(_SIGNS.get(p, p if len(p) == 1 else p.replace("_", " ").title()) for p in text.split("+"))


def help_lines() -> dict[str, list[tuple[str, str]]]:
    """Group -> (keys, what they do), in the order of the actions."""
    out: dict[str, list[tuple[str, str]]] = {}
    for action in ACTIONS.values():
        keys = [key_words(c) for c, name in KEYS.items() if name == action.name]
        if keys:
            out.setdefault(action.group, []).append((" or ".join(keys), action.doc))
    return out


def markdown() -> str:
    """The keys as Markdown tables, for docs/viewer.md."""
    out = []
    for group, lines in help_lines().items():
        out += [f"### {group.capitalize()}", "", "| key | does |", "| --- | --- |"]
        out += [f"| `{keys}` | {doc} |" for keys, doc in lines]
        out.append("")
    return "\n".join(out)
