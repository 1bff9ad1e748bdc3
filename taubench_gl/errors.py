"""Errors that a user can cause.

A message is one line: what is wrong, where, and how to fix it.  Modules raise; only the command line (``apps.cli``)
turns an error into exit code 2 and one printed line.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

MOST_CHARACTERS = 2000
"""Limit on each part of a printed error; values and names in files may have megabytes."""


def choice_hint(name: object, names: Iterable[str], ending: str = "", shown: Iterable[str] | None = None) -> str:
    """``did you mean X?`` for the nearest of ``names``, else ``choose from A, B`` and ``ending``.

    ``shown``: ``names`` as they are listed.
    """
    names = tuple(names)
    near = difflib.get_close_matches(str(name), names, 1)
    return f"did you mean {near[0]}?" if near else f"choose from {', '.join(shown or names)}{ending}"


class TaubenchError(Exception):
    """Base class of errors that a user can cause.  ``what`` is wrong, ``where`` and ``hint`` may be None;
    ``str(error)`` is one printable line.
    """

    def __init__(self, what: str, *, where: str | None = None, hint: str | None = None):
        self.what, self.where, self.hint = what, where, hint
        line = _shortened(what) if where is None else f"{_shortened(where)}: {_shortened(what)}"
        super().__init__(_one_line(line if hint is None else f"{line} ({_shortened(hint)})"))


class SceneError(TaubenchError):
    """A scene file is missing, unreadable, invalid, or uses an unsupported feature.

    ``where`` is ``file#/json/pointer`` for glTF and ``file:line`` for text formats.
    """


class PathTracedError(TaubenchError):
    """A path-traced file, sequence or camera cannot be used, or Blender failed."""


class SettingsError(TaubenchError):
    """An option or argument has an invalid value; ``setting``: the name of the field of ``Settings``, if it is one."""

    def __init__(self, what: str, *, where: str | None = None, hint: str | None = None, setting: str | None = None):
        super().__init__(what, where=where, hint=hint)
        self.setting = setting


class GraphicsError(TaubenchError):
    """No usable OpenGL context, a shader that does not compile, or a limit of the device."""


class DatasetError(TaubenchError):
    """A scene of the registry is unknown, or its file cannot be used."""


class MethodError(TaubenchError):
    """A reuse method violates its contract, does not compile, or failed while running."""


class OutputError(TaubenchError):
    """A result cannot be written, or a stored run cannot be read."""


def _shortened(text: str) -> str:
    excess = len(text) - MOST_CHARACTERS
    return text if excess <= 0 else f"{text[:MOST_CHARACTERS]} ... and {excess:,} more characters"


def _one_line(text: str) -> str:
    """``text`` without line breaks and control characters, which names inside files may contain."""
    return " ".join(printable(text).split())


def printable(text: str) -> str:
    """``text`` with a space for each control character but line breaks and tabs: names in files may hold commands of
    terminals.  Lone surrogates, bytes of a path that are not UTF-8, are shown as escapes.
    """
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return "".join(c if c.isprintable() or c in "\n\t" else " " for c in text)
