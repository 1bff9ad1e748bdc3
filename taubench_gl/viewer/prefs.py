"""Preferences stored between sessions: window size and display options, never the scene or results."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl.data_files import read_json
from taubench_gl.errors import OutputError, TaubenchError
from taubench_gl.outputs import cannot_write, write_atomically
from taubench_gl.viewer.state import OVERLAYS, SECTIONS, ViewerState, set_variable, variables

FILE = "viewer.json"
_KEPT = ("opacity", "overlays", "arrows", "frusta", "panels", "speed", "gain")


@dataclass(slots=True)
class Prefs:
    window: tuple[int, int] | None = None
    values: dict[str, Any] | None = None


def load(folder: Path) -> tuple[Prefs, str]:
    """The stored preferences, and a note if the file is unusable, which is then ignored."""
    path = folder / FILE
    if not path.exists():
        return Prefs(), ""
    try:
        data = read_json(path)
        window = data.get("window")
        if window is not None:
            window = (int(window[0]), int(window[1]))
            if not (200 <= window[0] <= 16384 and 150 <= window[1] <= 16384):
                raise ValueError("window size")
        values = data.get("values", {})
        if not isinstance(values, dict):
            raise ValueError("values")
    except (OutputError, ValueError, TypeError, AttributeError, IndexError, KeyError):
        return Prefs(), f"{FILE} cannot be read and is ignored"
    return Prefs(window, values), ""


def apply(prefs: Prefs, state: ViewerState) -> None:
    """Set the stored values; unknown names and values are skipped."""
    for name, value in (prefs.values or {}).items():
        if name in _kept():
            try:
                set_variable(state, name, str(value))
            except TaubenchError:  # written by another version
                continue


def save(folder: Path, state: ViewerState, window: tuple[int, int] | None) -> str:
    """Store window size and display options; returns a note if that fails, else an empty string."""
    now = variables(state)
    text = json.dumps({"window": window, "values": {n: now[n] for n in _kept()}}, indent=1) + "\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(folder / FILE, text)
    except OutputError as error:
        return str(error)
    except OSError as error:
        return str(cannot_write(folder, error))
    return ""


def _kept() -> list[str]:
    return [*_KEPT, *(f"show.{n}" for n in OVERLAYS), *(f"section.{n}" for n in SECTIONS)]
