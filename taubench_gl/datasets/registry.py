"""The registry of named scenes: those of the package and the user's.

A registry is a TOML file with one table per scene (``[my-scene]``): ``title`` and ``format`` (gltf, obj, obj sequence,
aff, fbx, blend), and if known ``authors``, ``license``, ``homepage``, ``url`` (http or https), ``sha256`` of the file
at the URL, ``scene`` (path or pattern of the scene inside the archive), ``unit_scale`` (units per meter), ``fps``,
``frames`` ([first, last + 1]), ``camera``, ``paper`` (its row in the paper's tables), ``note``. A name in a later file
replaces the same name in an earlier one.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import msgspec

from taubench_gl.errors import DatasetError

FORMATS = ("gltf", "obj", "obj sequence", "aff", "fbx", "blend")
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
    frames: tuple[int, int] | None = None
    camera: str | None = None
    paper: str | None = None
    note: str = ""

    def settings(self) -> dict[str, Any]:
        """Settings of this scene.  ``frames`` are numbers at its ``fps``."""
        known = {"fps": self.fps, "frames": self.frames, "camera": self.camera}
        out = {name: value for name, value in known.items() if value is not None}
        return out | ({} if self.unit_scale == 1.0 else {"unit_scale": self.unit_scale})

    def options(self) -> str:
        """The same settings as options of ``taubench-gl evaluate``."""
        words = []
        if self.fps is not None:
            words.append(f"--fps {self.fps:g}")
        if self.frames is not None:
            words.append(f"--frames {self.frames[0]}:{self.frames[1]}")
        if self.camera is not None:
            words.append(f"--camera {self.camera}")
        if self.unit_scale != 1.0:
            words.append(f"--unit-scale {self.unit_scale:g}")
        return " ".join(words)


def load_registry(extra: Sequence[Path] = ()) -> dict[str, Entry]:
    """All scenes by name, those of the package first.  Raises DatasetError with the file and the table."""
    own = files("taubench_gl.datasets") / "registry.toml"
    out = parse_registry(own.read_text(encoding="utf-8"), "registry.toml")
    for path in extra:
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            raise DatasetError("is not UTF-8 text", where=str(path)) from None
        except OSError as e:
            raise DatasetError(f"cannot be read: {e.strerror}", where=str(path)) from None
        out |= parse_registry(text, path.name)
    return out


def parse_registry(text: str, where: str) -> dict[str, Entry]:
    """Entries of one TOML text.  Raises DatasetError."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as e:
        raise DatasetError(f"is not valid TOML: {e}", where=where) from None
    out = {}
    for name, table in tables.items():
        if isinstance(table, dict) and "licence" in table:  # the key in releases before 0.2
            table.setdefault("license", table.pop("licence"))
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


def known_name(entries: dict[str, Entry], name: str) -> str:
    """The registry's spelling of ``name``, which may be the paper's (BistroInterior).  Raises DatasetError."""
    alike = [name] if name in entries else [known for known in entries if _letters(known) == _letters(name)]
    if len(alike) != 1:
        raise DatasetError(f"no scene is named {name!r}", hint=f"known: {', '.join(sorted(entries))}")
    return alike[0]


def find_entry(entries: dict[str, Entry], name: str) -> tuple[str, Entry]:
    """The registry's name and entry of a scene.  Raises DatasetError."""
    known = known_name(entries, name)
    return known, entries[known]


def _check(entry: Entry, at: str) -> None:
    if entry.format not in FORMATS:
        raise DatasetError(f"format {entry.format!r} is none of {', '.join(FORMATS)}", where=at)
    if entry.url is not None and not re.match(r"https?://[^/\s]+/\S", entry.url):
        raise DatasetError("url must be http:// or https:// and name a file", where=at)
    if entry.sha256 is not None and not re.fullmatch(r"[0-9a-f]{64}", entry.sha256):
        raise DatasetError("sha256 must be 64 hexadecimal digits", where=at)
    if not entry.unit_scale > 0 or not (entry.fps is None or entry.fps > 0):
        raise DatasetError("unit_scale and fps must be positive", where=at)
    if entry.frames is not None and not 0 <= entry.frames[0] < entry.frames[1]:
        raise DatasetError("frames must be [first, last + 1]", where=at)
    inside = entry.scene is None or not (Path(entry.scene).is_absolute() or ".." in Path(entry.scene).parts)
    if not inside:
        raise DatasetError("scene must lie inside the archive", where=at)


def _letters(name: str) -> str:
    """Letters and digits of a name, without case, for comparison with the paper's spelling."""
    return "".join(c for c in name.casefold() if c.isalnum())
