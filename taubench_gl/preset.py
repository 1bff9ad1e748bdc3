"""Presets: settings as a TOML file for ``evaluate --preset``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec

from taubench_gl.data_files import read_toml
from taubench_gl.errors import SettingsError
from taubench_gl.fields import unknown_field
from taubench_gl.outputs import plain_text, write_atomically
from taubench_gl.settings import FIELDS, SELECTING, Settings

PRESET_SCHEMA = "taubench-gl/preset/1"


class _File(msgspec.Struct, forbid_unknown_fields=True):
    """The keys of a preset; ``measured`` is for people and is not read back."""

    schema: Literal["taubench-gl/preset/1"]
    settings: dict[str, Any]
    measured: dict[str, Any] = {}


def save_preset(path: Path, settings: Settings, measured: Mapping[str, Any]) -> None:
    """Write the size, every field that differs from its default, and ``measured``.  Raises OutputError."""
    default = {n: v for n, v in Settings().to_dict().items() if n not in ("width", "height")}
    every = {n: v for n, v in settings.to_dict().items() if n not in SELECTING}
    values = {n: v for n, v in every.items() if n not in default or v != default[n]}
    lines = [f'schema = "{PRESET_SCHEMA}"', "", "[settings]", *(f"{k} = {_toml(v)}" for k, v in values.items())]
    lines += ["", "[measured]  # for the reader, not read back", *(f"{k} = {_toml(v)}" for k, v in measured.items())]
    write_atomically(path, "\n".join(lines) + "\n")


def load_preset(path: str | Path) -> dict[str, Any]:
    """Fields of ``Settings`` by name, checked.  Raises SettingsError for any other file and for invalid values."""
    file = read_toml(path, _File, SettingsError, hint="'taubench-gl cost' writes presets")
    allowed = tuple(name for name in FIELDS if name not in SELECTING)
    try:
        if unknown := next((name for name in file.settings if name not in allowed), None):
            raise unknown_field(unknown, allowed)
        settings = Settings.from_dict(file.settings)
    except SettingsError as error:
        raise SettingsError(error.what, where=str(path), hint=error.hint) from None
    return {name: settings.get(name) for name in file.settings}


def _toml(value: Any) -> str:
    """A string, number, list or one level of tables as TOML 1.0 writes it; None as an empty string."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # A JSON string is a TOML basic string, except for lone surrogates (paths that are not UTF-8).
        return json.dumps(plain_text(value), ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(str(k))} = {_toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return repr(value) if value is not None else '""'
