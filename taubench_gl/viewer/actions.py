"""Actions that keys, buttons and scripts run on the state, and the table of keys.

The help in the window and the tables of docs/viewer.md are generated from here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from taubench_gl.features import FEATURES
from taubench_gl.glossary import label_of
from taubench_gl.viewer.state import OVERLAYS, SECTIONS, SPEEDS, ViewerState, following

Change = Callable[[ViewerState], None]


@dataclass(frozen=True, slots=True)
class Action:
    """``group``: heading in the help; ``doc``: what the action does, also the tooltip."""

    name: str
    group: str
    doc: str
    run: Change


def _flip(attribute: str) -> Change:
    return lambda s: setattr(s, attribute, not getattr(s, attribute))


def _assign(attribute: str, value: object) -> Change:
    return lambda s: setattr(s, attribute, value)


def _speed(step: int) -> Change:
    def change(s: ViewerState) -> None:
        nearest = min(range(len(SPEEDS)), key=lambda i: abs(SPEEDS[i] - s.speed))
        s.speed = SPEEDS[min(max(nearest + step, 0), len(SPEEDS) - 1)]
        s.message = f"speed {s.speed:g}"

    return change


def _channel(step: int) -> Change:
    def change(s: ViewerState) -> None:
        s.channel = following(s.channels, s.channel, step)
        s.message = f"channel: {s.channel.replace('_', ' ')}"

    return change


def _object_motion(s: ViewerState) -> None:
    s.channel = s.channels[0] if s.channel == "object_motion" else "object_motion"


def _range(low: float, high: float) -> Change:
    """Move the ends of the display range by shares of it."""
    return lambda s: s.set_range(s.low + low * (s.high - s.low), s.high + high * (s.high - s.low))


def _compare(s: ViewerState) -> None:
    s.comparison = following(s.comparisons, s.comparison)
    s.message = f"comparison: {s.comparison}"


def _against(s: ViewerState) -> None:
    s.against = following(s.others, s.against)
    s.message = f"compared with: {s.against}"


def _split(by: float) -> Change:
    return lambda s: setattr(s, "split", min(max(s.split + by, 0.0), 1.0))


def _show(overlay: str) -> Change:
    def change(s: ViewerState) -> None:
        s.shown[overlay] = not s.shown[overlay]
        s.overlays = s.overlays or s.shown[overlay]

    return change


def _opacity(by: float) -> Change:
    def change(s: ViewerState) -> None:
        s.opacity = round(min(max(s.opacity + by, 0.0), 1.0), 3)
        s.message = f"opacity {s.opacity:.2f}"

    return change


def _next_threshold(s: ViewerState) -> None:
    s.feature = following(FEATURES, s.feature)
    s.message = f"{s.feature} threshold {s.thresholds[s.feature]:.4g}"


def _probe(dx: int, dy: int) -> Change:
    def change(s: ViewerState) -> None:
        x, y = s.probe or (s.size[0] // 2, s.size[1] // 2)
        s.probe_pinned = True
        s.probe = (min(max(x + dx, 0), s.size[0] - 1), min(max(y + dy, 0), s.size[1] - 1))

    return change


def _pin(s: ViewerState) -> None:
    if s.probe_pinned:
        s.probe_pinned = False
    else:
        _probe(0, 0)(s)


def _next_effect(s: ViewerState) -> None:
    if s.effects:
        s.effect = following(s.effects, s.effect)
        s.message = f"effect: {s.effect.replace('_', ' ')}"


def _toggle_effect(s: ViewerState) -> None:
    if s.effect:
        s.toggle_effect(s.effect)


def _section(name: str) -> Change:
    return lambda s: s.sections.update({name: not s.sections[name]})


def _escape(s: ViewerState) -> None:
    if s.help:
        s.help = False
    else:
        s.freeze_current = s.freeze_previous = False
        s.selection = None


_TABLE: dict[str, tuple[tuple[str, str, str, Change | None], ...]] = {
    "playback": (
        ("play", "SPACE", "play or pause", _flip("playing")),
        ("next", "RIGHT", "next frame", lambda s: s.step(1)),
        ("previous", "LEFT", "previous frame", lambda s: s.step(-1)),
        ("forward", "SHIFT+RIGHT", "ten frames forward", lambda s: s.step(10)),
        ("back", "SHIFT+LEFT", "ten frames back", lambda s: s.step(-10)),
        ("first", "HOME", "first frame", lambda s: s.step(s.first - s.frame)),
        ("last", "END", "last frame", lambda s: s.step(s.last - s.frame)),
        ("loop from", "LEFT_BRACKET", "loop starts at this frame", lambda s: s.set_loop(low=s.frame)),
        ("loop to", "RIGHT_BRACKET", "loop ends at this frame", lambda s: s.set_loop(high=s.frame)),
        ("loop all", "BACKSLASH", "loop over the whole sequence", _assign("loop", None)),
        ("slower", "COMMA", "play slower", _speed(-1)),
        ("faster", "PERIOD", "play faster", _speed(1)),
    ),
    "camera": (
        ("file camera", "V", "camera of the scene file", _assign("camera", "file")),
        ("fly", "F", "fly: W A S D move, Q E down and up, Shift faster, drag or I J K L turn",
         _assign("camera", "fly")),
        ("orbit", "O", "orbit: drag or I J K L rotate, wheel or W S zoom", _assign("camera", "orbit")),
        ("reset camera", "R", "reset fly and orbit to the camera of the scene file", None),
        ("freeze current", "C", "freeze the current camera and view it from outside", _flip("freeze_current")),
        ("freeze previous", "X", "freeze the previous camera", _flip("freeze_previous")),
        ("frusta", "B", "outlines of frozen cameras", _flip("frusta")),
    ),
    "image": (
        ("next channel", "N", "show the next channel", _channel(1)),
        ("previous channel", "SHIFT+N", "show the previous channel", _channel(-1)),
        ("object motion", "SHIFT+U", "show object motion, or the first channel again", _object_motion),
        ("auto range", "M", "display range from the smallest and largest value", _flip("auto_range")),
        ("range up", "UP", "raise the upper end of the range", _range(0.0, 0.1)),
        ("range down", "DOWN", "lower the upper end of the range", _range(0.0, -0.1)),
        ("low up", "SHIFT+UP", "raise the lower end of the range", _range(0.1, 0.0)),
        ("low down", "SHIFT+DOWN", "lower the lower end of the range", _range(-0.1, 0.0)),
        ("arrows", "U", "motion vectors as arrows to the previous position", _flip("arrows")),
        ("compare", "Y", "comparison: off, split, flicker, difference, error, ghost", _compare),
        ("compare with", "SHIFT+Y", "compare with the next: history, reprojected history, reference, run, method",
         _against),
        ("beside", "Z", "the other image and the error map beside the image", _flip("beside")),
        ("split left", "SEMICOLON", "move the split line left", _split(-0.02)),
        ("split right", "APOSTROPHE", "move the split line right", _split(0.02)),
    ),
    "masks": (
        *((f"show {name}", f"{'SHIFT+' if i >= 10 else ''}{(i + 1) % 10}", f"mask: {label_of(reason)}", _show(name))
          for i, (name, reason) in enumerate(OVERLAYS.items())),
        ("overlays", "H", "hide or show all masks", _flip("overlays")),
        ("exact", "SHIFT+H", "exact reasons instead of the masks: by rays and the light of the same points",
         _flip("exact")),
        ("opacity down", "MINUS", "more transparent masks", _opacity(-0.1)),
        ("opacity up", "EQUAL", "more opaque masks", _opacity(0.1)),
    ),
    "thresholds": (
        ("next threshold", "T", "select the next threshold", _next_threshold),
        ("threshold up", "PAGE_UP", "raise the selected threshold by 10 %", lambda s: s.scale_threshold(1.1)),
        ("threshold down", "PAGE_DOWN", "lower the selected threshold by 10 %", lambda s: s.scale_threshold(1 / 1.1)),
        ("threshold double", "SHIFT+PAGE_UP", "double the selected threshold", lambda s: s.scale_threshold(2.0)),
        ("threshold half", "SHIFT+PAGE_DOWN", "halve the selected threshold", lambda s: s.scale_threshold(0.5)),
        ("threshold default", "BACKSPACE", "reset the selected threshold",
         lambda s: s.set_threshold(s.feature, s.default_thresholds[s.feature])),
    ),
    "probe": (
        ("pin probe", "P", "pin the probe, or let it follow the mouse", _pin),
        ("probe left", "CTRL+LEFT", "probe one pixel left", _probe(-1, 0)),
        ("probe right", "CTRL+RIGHT", "probe one pixel right", _probe(1, 0)),
        ("probe up", "CTRL+UP", "probe one pixel up", _probe(0, -1)),
        ("probe down", "CTRL+DOWN", "probe one pixel down", _probe(0, 1)),
        ("select", "SHIFT+P", "select the node at the probe, as a right click on the image does",
         lambda s: setattr(s, "pick", s.probe)),
    ),
    "effects": (
        ("next effect", "G", "select the next effect", _next_effect),
        ("toggle effect", "ENTER", "disable or enable the selected effect", _toggle_effect),
    ),
    "window": (
        ("panels", "TAB", "hide or show the panels", _flip("panels")),
        ("help", "SHIFT+SLASH F1", "show this list", _flip("help")),
        *((f"section {name}", f"SHIFT+F{i}" if i < 12 else "SHIFT+T", f"open or close {name}", _section(name))
          for i, name in enumerate(SECTIONS, 1)),
        ("screenshot", "F12", "save the image as PNG", None),
        ("window screenshot", "SHIFT+F12", "save the whole window as PNG", None),
        ("clip", "F9", "start or stop recording a clip (mp4)", None),
        ("save session", "CTRL+S", "save what is open and how it is shown as a session file", None),
        ("reload", "F5", "reload the scene from disk", None),
        ("escape", "ESCAPE", "close the help, unfreeze the cameras, select no node", _escape),
        ("quit", "CTRL+Q", "quit", None),
    ),
}  # fmt: skip
"""Group -> name, keys, what it does, and the change of the state; None: a request, which the model serves."""


def _request(name: str) -> Change:
    return lambda s: s.requests.append(name)


ACTIONS: dict[str, Action] = {
    name: Action(name, group, doc, change or _request(name))
    for group, rows in _TABLE.items()
    for name, _, doc, change in rows
}
KEYS: dict[str, str] = {key: name for rows in _TABLE.values() for name, keys, _, _ in rows for key in keys.split()}
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
