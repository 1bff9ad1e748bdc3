"""The keyboard: which key does what.  The help in the window and docs/viewer.md are made from this table."""

from __future__ import annotations

from taubench_gl.viewer.actions import ACTIONS
from taubench_gl.viewer.state import OVERLAYS, SECTIONS

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
