"""Actions that keys, buttons and scripts run on the state, and the table of keys.

The help in the window and the tables of docs/viewer.md are generated from here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from taubench_gl.features import FEATURES
from taubench_gl.glossary import label_of
from taubench_gl.viewer.state import COMPARISONS, OVERLAYS, SECTIONS, SPEEDS, ViewerState, following

Change = Callable[[ViewerState], None]


@dataclass(frozen=True, slots=True)
class Action:
    """``group``: heading in the help; ``doc``: what the action does, also the tooltip."""

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
    ("forward", 10, "ten frames forward"),
    ("back", -10, "ten frames back"),
):
    _action(_name, "playback", _doc)(lambda s, step=_step: s.step(step))
_action("first", "playback", "first frame")(lambda s: s.step(s.first - s.frame))
_action("last", "playback", "last frame")(lambda s: s.step(s.last - s.frame))
_action("loop from", "playback", "loop starts at this frame")(lambda s: s.set_loop(low=s.frame))
_action("loop to", "playback", "loop ends at this frame")(lambda s: s.set_loop(high=s.frame))
_assign("loop all", "playback", "loop over the whole sequence", "loop", None)


def _speed(s: ViewerState, step: int) -> None:
    nearest = min(range(len(SPEEDS)), key=lambda i: abs(SPEEDS[i] - s.speed))
    s.speed = SPEEDS[min(max(nearest + step, 0), len(SPEEDS) - 1)]
    s.message = f"speed {s.speed:g}"


_action("slower", "playback", "play slower")(lambda s: _speed(s, -1))
_action("faster", "playback", "play faster")(lambda s: _speed(s, 1))

_assign("file camera", "camera", "camera of the scene file", "camera", "file")
_assign("fly", "camera", "fly: W A S D move, Q E down and up, Shift faster, drag or I J K L turn", "camera", "fly")
_assign("orbit", "camera", "orbit: drag or I J K L rotate, wheel or W S zoom", "camera", "orbit")
_request("reset camera", "camera", "reset fly and orbit to the camera of the scene file")
_toggle("freeze current", "camera", "freeze the current camera and view it from outside", "freeze_current")
_toggle("freeze previous", "camera", "freeze the previous camera", "freeze_previous")
_toggle("frusta", "camera", "outlines of frozen cameras", "frusta")


def _channel(s: ViewerState, step: int) -> None:
    s.channel = following(s.channels, s.channel, step)
    s.message = f"channel: {s.channel.replace('_', ' ')}"


_action("next channel", "image", "show the next channel")(lambda s: _channel(s, 1))
_action("previous channel", "image", "show the previous channel")(lambda s: _channel(s, -1))


@_action("object motion", "image", "show object motion, or the first channel again")
def _object_motion(s: ViewerState) -> None:
    s.channel = s.channels[0] if s.channel == "object_motion" else "object_motion"


_toggle("auto range", "image", "display range from the smallest and largest value", "auto_range")
_action("range up", "image", "raise the upper end of the range")(
    lambda s: s.set_range(s.low, s.high + 0.1 * (s.high - s.low))
)
_action("range down", "image", "lower the upper end of the range")(
    lambda s: s.set_range(s.low, s.high - 0.1 * (s.high - s.low))
)
_action("low up", "image", "raise the lower end of the range")(
    lambda s: s.set_range(s.low + 0.1 * (s.high - s.low), s.high)
)
_action("low down", "image", "lower the lower end of the range")(
    lambda s: s.set_range(s.low - 0.1 * (s.high - s.low), s.high)
)
_toggle("arrows", "image", "motion vectors as arrows to the previous position", "arrows")


@_action("compare", "image", "comparison: off, split, flicker, difference, error")
def _compare(s: ViewerState) -> None:
    s.comparison = following(COMPARISONS, s.comparison)
    s.message = f"comparison: {s.comparison}"


@_action("compare with", "image", "compare with the next: history, reprojected history, reference, run, method")
def _against(s: ViewerState) -> None:
    s.against = following(s.others, s.against)
    s.message = f"compared with: {s.against}"


_toggle("beside", "image", "the other image and the error map beside the image", "beside")


def _split(s: ViewerState, by: float) -> None:
    s.split = min(max(s.split + by, 0.0), 1.0)


_action("split left", "image", "move the split line left")(lambda s: _split(s, -0.02))
_action("split right", "image", "move the split line right")(lambda s: _split(s, 0.02))

for _name, _reason in OVERLAYS.items():

    @_action(f"show {_name}", "masks", f"mask: {label_of(_reason)}")
    def _show(s: ViewerState, name: str = _name) -> None:
        s.shown[name] = not s.shown[name]
        s.overlays = s.overlays or s.shown[name]


_toggle("overlays", "masks", "hide or show all masks", "overlays")
_toggle("exact", "masks", "exact reasons instead of the masks: by rays and the light of the same points", "exact")


def _opacity(s: ViewerState, by: float) -> None:
    s.opacity = round(min(max(s.opacity + by, 0.0), 1.0), 3)
    s.message = f"opacity {s.opacity:.2f}"


_action("opacity down", "masks", "more transparent masks")(lambda s: _opacity(s, -0.1))
_action("opacity up", "masks", "more opaque masks")(lambda s: _opacity(s, 0.1))


@_action("next threshold", "thresholds", "select the next threshold")
def _next_threshold(s: ViewerState) -> None:
    s.feature = following(FEATURES, s.feature)
    s.message = f"{s.feature} threshold {s.thresholds[s.feature]:.4g}"


_action("threshold up", "thresholds", "raise the selected threshold by 10 %")(lambda s: s.scale_threshold(1.1))
_action("threshold down", "thresholds", "lower the selected threshold by 10 %")(lambda s: s.scale_threshold(1 / 1.1))
_action("threshold double", "thresholds", "double the selected threshold")(lambda s: s.scale_threshold(2.0))
_action("threshold half", "thresholds", "halve the selected threshold")(lambda s: s.scale_threshold(0.5))
_action("threshold default", "thresholds", "reset the selected threshold")(
    lambda s: s.set_threshold(s.feature, s.default_thresholds[s.feature])
)


def _probe(s: ViewerState, dx: int, dy: int) -> None:
    x, y = s.probe or (s.size[0] // 2, s.size[1] // 2)
    s.probe_pinned = True
    s.probe = (min(max(x + dx, 0), s.size[0] - 1), min(max(y + dy, 0), s.size[1] - 1))


@_action("pin probe", "probe", "pin the probe, or let it follow the mouse")
def _pin(s: ViewerState) -> None:
    if s.probe_pinned:
        s.probe_pinned = False
    else:
        _probe(s, 0, 0)


for _name, _dx, _dy in (("left", -1, 0), ("right", 1, 0), ("up", 0, -1), ("down", 0, 1)):
    _action(f"probe {_name}", "probe", f"probe one pixel {_name}")(lambda s, dx=_dx, dy=_dy: _probe(s, dx, dy))


@_action("next effect", "effects", "select the next effect")
def _next_effect(s: ViewerState) -> None:
    if s.effects:
        s.effect = following(s.effects, s.effect)
        s.message = f"effect: {s.effect.replace('_', ' ')}"


@_action("toggle effect", "effects", "disable or enable the selected effect")
def _toggle_effect(s: ViewerState) -> None:
    if s.effect:
        s.toggle_effect(s.effect)


_toggle("panels", "window", "hide or show the panels", "panels")
_toggle("help", "window", "show this list", "help")
for _name in SECTIONS:

    @_action(f"section {_name}", "window", f"open or close {_name}")
    def _section(s: ViewerState, name: str = _name) -> None:
        s.sections[name] = not s.sections[name]


_request("screenshot", "window", "save the image as PNG")
_request("window screenshot", "window", "save the whole window as PNG")
_request("clip", "window", "start or stop recording a clip (mp4)")
_request("save session", "window", "save what is open and how it is shown as a session file")
_request("reload", "window", "reload the scene from disk")


@_action("escape", "window", "close the help, unfreeze the cameras")
def _escape(s: ViewerState) -> None:
    if s.help:
        s.help = False
    else:
        s.freeze_current = s.freeze_previous = False


_request("quit", "window", "quit")


# Keys

KEYS: dict[str, str] = {
    "SPACE": "play", "RIGHT": "next", "LEFT": "previous", "SHIFT+RIGHT": "forward", "SHIFT+LEFT": "back",
    "HOME": "first", "END": "last", "LEFT_BRACKET": "loop from", "RIGHT_BRACKET": "loop to",
    "BACKSLASH": "loop all", "COMMA": "slower", "PERIOD": "faster",
    "V": "file camera", "F": "fly", "O": "orbit", "R": "reset camera", "C": "freeze current",
    "X": "freeze previous", "B": "frusta",
    "N": "next channel", "SHIFT+N": "previous channel", "SHIFT+U": "object motion", "M": "auto range",
    "UP": "range up", "DOWN": "range down", "SHIFT+UP": "low up", "SHIFT+DOWN": "low down", "U": "arrows",
    "Y": "compare", "SHIFT+Y": "compare with", "Z": "beside", "CTRL+S": "save session",
    "SEMICOLON": "split left", "APOSTROPHE": "split right",
    **{f"{'SHIFT+' if i >= 10 else ''}{(i + 1) % 10}": f"show {name}" for i, name in enumerate(OVERLAYS)},
    "H": "overlays", "SHIFT+H": "exact", "MINUS": "opacity down", "EQUAL": "opacity up",
    "T": "next threshold", "PAGE_UP": "threshold up", "PAGE_DOWN": "threshold down",
    "SHIFT+PAGE_UP": "threshold double", "SHIFT+PAGE_DOWN": "threshold half", "BACKSPACE": "threshold default",
    "P": "pin probe", "CTRL+LEFT": "probe left", "CTRL+RIGHT": "probe right", "CTRL+UP": "probe up",
    "CTRL+DOWN": "probe down",
    "G": "next effect", "ENTER": "toggle effect",
    "TAB": "panels", "SHIFT+SLASH": "help", "F1": "help",
    **{f"SHIFT+F{i}": f"section {name}" for i, name in enumerate(SECTIONS, 1)},
    "F12": "screenshot", "SHIFT+F12": "window screenshot", "F9": "clip", "F5": "reload", "ESCAPE": "escape",
    "CTRL+Q": "quit",
}  # fmt: skip
"""Chord -> action.  Modifiers come first, in the order CTRL+ALT+SHIFT+; keys are named as GLFW names them."""

MOVEMENT = frozenset("WASDQEIJKL")
"""Keys that move the camera while they are held, in fly and orbit."""

_SIGNS = {
    "SHIFT+SLASH": "?", "COMMA": ",", "PERIOD": ".", "LEFT_BRACKET": "[", "RIGHT_BRACKET": "]", "BACKSLASH": "\\",
    "SEMICOLON": ";", "APOSTROPHE": "'", "MINUS": "-", "EQUAL": "=",
}  # fmt: skip


def chord(key: str, *, ctrl: bool = False, alt: bool = False, shift: bool = False) -> str:
    """A key with its modifiers, as in KEYS."""
    return f"{'CTRL+' if ctrl else ''}{'ALT+' if alt else ''}{'SHIFT+' if shift else ''}{key}"


def split_chord(text: str) -> tuple[str, set[str]]:
    """``ctrl+q`` -> ("Q", {"CTRL"}); raises ValueError for an unknown modifier."""
    *modifiers, key = ("SHIFT+SLASH" if text == "?" else text.upper()).split("+")
    if not key or set(modifiers) - {"CTRL", "ALT", "SHIFT"}:
        raise ValueError(f"{text!r} is not a key such as SPACE, N or SHIFT+N")
    return key, set(modifiers)


def key_words(text: str) -> str:
    """A chord for display: ``Shift+N``, ``?``."""
    if text in _SIGNS:
        return _SIGNS[text]
    return "+".join(_SIGNS.get(p, p if len(p) == 1 else p.replace("_", " ").title()) for p in text.split("+"))


def help_lines() -> dict[str, list[tuple[str, str]]]:
    """Group -> (keys, doc), in the order of the actions."""
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
        out += [f"### {group.capitalize()}", "", "| key | action |", "| --- | --- |"]
        out += [f"| `{keys}` | {doc} |" for keys, doc in lines]
        out.append("")
    return "\n".join(out)
