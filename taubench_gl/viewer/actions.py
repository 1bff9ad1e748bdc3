"""Every action by name and by key: those of the controls, and those of the window.

The help in the window and the tables of docs/viewer.md are generated from here.
"""

from __future__ import annotations

from taubench_gl.viewer.controls import Action
from taubench_gl.viewer.state import CONTROLS, ViewerState


def _escape(s: ViewerState) -> None:
    if s.help:
        s.help = False
    else:
        s.freeze_current = s.freeze_previous = False
        s.selection = None


_OF_WINDOW = (
    Action("screenshot", "F12", "save the image as PNG"),
    Action("window screenshot", "SHIFT+F12", "save the whole window as PNG"),
    Action("clip", "F9", "start or stop recording a clip (mp4)"),
    Action("save session", "CTRL+S", "save what is open and how it is shown as a session file"),
    Action("reload", "F5", "reload the scene from disk"),
    Action("escape", "ESCAPE", "close the help, unfreeze the cameras, select no node", _escape),
    Action("quit", "CTRL+Q", "quit"),
)


def _by_group() -> dict[str, list[Action]]:
    """The actions of the controls by heading, in the order of the controls; those of the window last."""
    groups: dict[str, list[Action]] = {}
    for control in CONTROLS.values():
        groups.setdefault(control.group, []).extend(control.all_actions())
    groups["window"] += _OF_WINDOW
    return {group: actions for group, actions in groups.items() if actions}


GROUPS = _by_group()
"""Heading of the help -> the actions below it."""
ACTIONS: dict[str, Action] = {action.name: action for actions in GROUPS.values() for action in actions}
KEYS: dict[str, str] = {chord: action.name for action in ACTIONS.values() for chord in action.keys.split()}
"""Chord -> action.  Modifiers come first, in the order CTRL+ALT+SHIFT+; keys are named as GLFW names them."""


def run_action(name: str, state: ViewerState) -> None:
    """Change ``state``, or add a request for the model to it.  Raises KeyError for an unknown action."""
    change = ACTIONS[name].run
    state.requests.append(name) if change is None else change(state)


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


def chords_of(name: str) -> str:
    """The keys of an action for display: ``? or F1``."""
    return " or ".join(map(key_words, ACTIONS[name].keys.split()))


def help_lines() -> dict[str, list[tuple[str, str]]]:
    """Heading of the help -> keys and description of each action below it."""
    return {group: [(chords_of(action.name), action.doc) for action in actions] for group, actions in GROUPS.items()}


def markdown() -> str:
    """The keys as Markdown tables, for docs/viewer.md."""
    out = []
    for group, lines in help_lines().items():
        out += [f"### {group.capitalize()}", "", "| key | action |", "| --- | --- |"]
        out += [f"| `{keys}` | {doc} |" for keys, doc in lines]
        out.append("")
    return "\n".join(out)
