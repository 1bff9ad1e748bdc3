"""Preferences stored between sessions: window size and display options, never the scene or results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec

from taubench_gl.data_files import read_json
from taubench_gl.errors import OutputError, TaubenchError
from taubench_gl.outputs import cannot_write, write_atomically
from taubench_gl.viewer.state import CONTROLS, ViewerState, set_variable

FILE = "viewer.json"
_Width = Annotated[int, msgspec.Meta(ge=200, le=16384)]
_Height = Annotated[int, msgspec.Meta(ge=150, le=16384)]


class Prefs(msgspec.Struct):
    """Content of FILE.  ``window``: size in screen points; ``values``: preferences by name, as ``variables``."""

    window: tuple[_Width, _Height] | None = None
    values: dict[str, str | int | float] = {}

    def apply(self, state: ViewerState) -> None:
        """Set the stored values; names and values that are unknown are skipped."""
        names = kept(state)
        for name, value in self.values.items():
            if name in names:
                try:
                    set_variable(state, name, str(value))
                except TaubenchError:  # written by another version
                    continue


def kept(state: ViewerState) -> dict[str, str | int | float]:
    """The preferences that ``state`` has, by name."""
    return {name: v for control in CONTROLS.values() if control.preference for name, v in control.read(state).items()}


def load(folder: Path) -> tuple[Prefs, str]:
    """The stored preferences, and a note if the file is unusable, which is then ignored."""
    path = folder / FILE
    if not path.exists():
        return Prefs(), ""
    try:
        return msgspec.convert(read_json(path, Prefs), Prefs), ""
    except OutputError:
        return Prefs(), f"{FILE} cannot be read and is ignored"


def save(folder: Path, state: ViewerState, window: tuple[int, int] | None) -> str:
    """Store window size and display options; returns a note if that fails, else an empty string."""
    file = msgspec.json.encode(Prefs(window, kept(state)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / FILE, msgspec.json.format(file, indent=1).decode() + "\n")
    except OutputError as error:
        return str(error)
    except OSError as error:
        return str(cannot_write(folder, error))
    return ""
