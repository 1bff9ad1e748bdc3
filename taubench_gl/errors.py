"""The one family of errors this package raises on purpose.

Every message answers three questions in one line: what is wrong, where, and what to do about it.  Libraries raise,
only the command line (``apps.cli``) turns an error into an exit code (2) and one printed line.
"""

from __future__ import annotations

import sys


class TaubenchError(Exception):
    """Base of everything a user can cause.  ``str(error)`` is one line, fit to be printed as it is."""

    def __init__(self, what: str, *, where: str | None = None, hint: str | None = None):
        self.what, self.where, self.hint = what, where, hint
        line = what if where is None else f"{where}: {what}"
        super().__init__(_one_line(line if hint is None else f"{line} ({hint})"))


class SceneError(TaubenchError):
    """A scene file is missing, unreadable, invalid or asks for what we do not support.

    ``where`` is ``file#/json/pointer`` for glTF and ``file:line`` for text formats.
    """


class PathTracedError(TaubenchError):
    """A path-traced reference (EXR file, sequence, sidecar) cannot be used as it is."""


class SettingsError(TaubenchError):
    """An option or argument has a value that cannot be meant."""


class GraphicsError(TaubenchError):
    """No usable OpenGL context, a shader that does not compile, or a limit of the device."""


class DatasetError(TaubenchError):
    """A scene of the registry is unknown, cannot be fetched, or is not what it was."""


class MethodError(TaubenchError):
    """A reuse method is not what the contract asks for, does not compile, or failed while it ran."""


class OutputError(TaubenchError):
    """A result cannot be written where it was asked for, or a stored run cannot be read."""


def _one_line(text: str) -> str:
    """Collapse line breaks and control characters: names inside files are not ours to trust.

    Bytes of a path that are no UTF-8 stay to be seen, as ``outputs.text_bytes`` writes them.
    """
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def note_renamed(old: str, new: str) -> None:
    """Print one line on standard error: the user gave ``old``, a name of the last release, instead of ``new``."""
    print(f"taubench-gl: {old} is now {new}", file=sys.stderr)
