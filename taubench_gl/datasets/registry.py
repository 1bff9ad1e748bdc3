"""The registry of named scenes: those of the package and the user's.

A registry is a TOML file with one table per scene (``[my-scene]``): ``title`` and ``format`` (``FORMATS``), and if
known ``authors``, ``license``, ``homepage``, ``url`` to download it from, ``sha256`` of its file, ``scene`` (path or
pattern of the scene inside the archive), ``paper`` (its row in the paper's tables), ``recording``
(the recorded game that it is made from), ``note``.  What a
reproduction needs: ``unit_scale`` (units per meter), ``fps`` of the images (Table 4) and ``camera_fps`` of camera
activity (Tables 2 and 3), ``frames`` ([first, last + 1], at ``fps``), ``camera``, ``light_unit``, ``exposure``,
``environment`` (as ``--environment``; an image inside the archive), ``thresholds`` (a table, by feature).  A name in
a later file replaces the same name in an earlier one.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.conventions import DEFAULT_FPS
from taubench_gl.data_files import parse_toml, read_text
from taubench_gl.errors import DatasetError, SettingsError
from taubench_gl.settings import Settings

FORMATS = ("gltf", "obj", "obj sequence", "aff", "fbx", "blend", "usd", "alembic", "ply", "stl", "collada")
VARIABLE = "TAUBENCH_SCENES"
"""Environment variable with the user's registries, separated as in PATH."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One scene.  Unknown values are None or empty."""

    title: str
    format: str
    authors: str = ""
    license: str = ""
    homepage: str = ""
    url: str | None = None
    sha256: str | None = None
    scene: str | None = None
    unit_scale: float = 1.0
    fps: float | None = None
    camera_fps: float | None = None
    frames: tuple[int, int] | None = None
    camera: str | None = None
    light_unit: str | None = None
    exposure: float | str | None = None
    environment: str | None = None
    thresholds: dict[str, float] | None = None
    paper: str | None = None
    recording: str | None = None
    note: str = ""

    def settings(self) -> dict[str, Any]:
        """Settings of this scene, of its images (Table 4).  ``frames`` are numbers at its ``fps``."""
        names = ("fps", "frames", "camera", "light_unit", "exposure", "environment", "thresholds")
        out = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return out | ({} if self.unit_scale == 1.0 else {"unit_scale": self.unit_scale})

    def camera_settings(self) -> dict[str, Any]:
        """Settings of camera activity (Tables 2 and 3): the same seconds at ``camera_fps``, if it is known."""
        out = self.settings()
        if self.camera_fps is None:
            return out
        out["fps"] = self.camera_fps
        if self.frames is not None:
            first, end = self.frames
            ratio = self.camera_fps / (self.fps or DEFAULT_FPS)
            out["frames"] = (round(first * ratio), round((end - 1) * ratio) + 1)
        return out

    def options(self) -> str:
        """``settings`` as options of ``taubench-gl evaluate``."""
        return _options(self.settings())

    def camera_options(self) -> str:
        """``camera_settings`` as options of ``taubench-gl evaluate``, with the column that is drawn fastest."""
        return f"{_options(self.camera_settings())} --columns frustum" if self.camera_fps is not None else ""


def _options(settings: dict[str, Any]) -> str:
    words = []
    for name, value in settings.items():
        if name == "frames":
            value = f"{value[0]}:{value[1]}"
        elif name == "thresholds":
            words += [f"--threshold {feature}={threshold:g}" for feature, threshold in value.items()]
            continue
        words.append(f"--{name.replace('_', '-')} {f'{value:g}' if isinstance(value, float) else shlex.quote(value)}")
    return " ".join(words)


def load_registry(extra: Sequence[Path] = ()) -> dict[str, Entry]:
    """All scenes by name, those of the package first.  Raises DatasetError with the file and the table."""
    resources = files("taubench_gl.datasets") / "registry.toml"
    out = parse_registry(resources.read_text(encoding="utf-8"), "registry.toml")
    for path in extra:
        out |= parse_registry(read_text(path, DatasetError), path.name)
    return out


def parse_registry(text: str, where: str) -> dict[str, Entry]:
    """Entries of one TOML text.  Raises DatasetError."""
    try:
        tables = parse_toml(text)
    except (ValueError, RecursionError) as e:
        raise DatasetError(f"is not valid TOML: {e}", where=where) from None
    out = {}
    for name, table in tables.items():
        at = f"{where} [{name}]"
        if not _NAME.fullmatch(name):
            raise DatasetError("a name has letters, digits, dots, dashes and underscores only", where=at)
        try:
            entry = msgspec.convert(table, Entry)
        except msgspec.ValidationError as e:
            raise DatasetError(str(e).replace("`", ""), where=at) from None
        _check(entry, at)
        out[name] = entry
    return out


def find_entry(entries: dict[str, Entry], name: str) -> tuple[str, Entry]:
    """The registry's name and entry of a scene.  ``name``: also as the paper spells it, BistroInterior.

    Raises DatasetError.
    """
    alike = [name] if name in entries else [entry for entry in entries if _letters(entry) == _letters(name)]
    if len(alike) != 1:
        raise DatasetError(f"no scene is named {name!r}", hint=f"known: {', '.join(sorted(entries))}")
    return alike[0], entries[alike[0]]


def _check(entry: Entry, at: str) -> None:
    if entry.format not in FORMATS:
        raise DatasetError(f"format {entry.format!r} is none of {', '.join(FORMATS)}", where=at)
    if entry.sha256 is not None and not re.fullmatch(r"[0-9a-f]{64}", entry.sha256):
        raise DatasetError("sha256 must be 64 hexadecimal digits", where=at)
    rates = (rate for rate in (entry.fps, entry.camera_fps) if rate is not None)
    if not entry.unit_scale > 0 or not all(rate > 0 for rate in rates):
        raise DatasetError("unit_scale, fps and camera_fps must be positive", where=at)
    if entry.frames is not None and not 0 <= entry.frames[0] < entry.frames[1]:
        raise DatasetError("frames must be [first, last + 1]", where=at)
    inside = entry.scene is None or not (Path(entry.scene).is_absolute() or ".." in Path(entry.scene).parts)
    if not inside:
        raise DatasetError("scene must lie inside the archive", where=at)
    try:
        Settings(**{name: value for name, value in entry.settings().items() if name not in ("frames", "camera")})
    except SettingsError as error:
        raise DatasetError(error.what, where=at, hint=error.hint) from None


def _letters(name: str) -> str:
    """Letters and digits of a name, without case, for comparison with the paper's spelling."""
    return "".join(c for c in name.casefold() if c.isalnum())
