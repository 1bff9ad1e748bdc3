"""Which files a numbered sequence has, and what of each object stays the same from one to the next."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.scene.obj.parse import MISSING, ObjFile, Part

Array = np.ndarray

PREFIX = "seq:"
DEFAULT_FPS = 24.0
MAX_FRAMES = 100_000

_RATE = re.compile(r"@(\d+(?:\.\d+)?)$")
_PLACE = re.compile(r"%0?\d*d|\*")
_NUMBER = re.compile(r"(\d+)(?=\D*$)")


def is_sequence(text: str) -> bool:
    """Does ``text`` name a sequence: ``seq:...``, a pattern with ``*`` or ``%04d``, or a folder with OBJ files?"""
    if text.startswith(PREFIX):
        return True
    bare = Path(_RATE.sub("", text))
    if bare.suffix.lower() == ".obj" and _PLACE.search(bare.name):
        return True
    try:
        return bare.is_dir() and any(p.suffix.lower() == ".obj" for p in bare.iterdir())
    except OSError:
        return False


def find_frames(text: str) -> tuple[list[Path], float, list[str]]:
    """Files in order of their number, frames per second, and what is odd about them.  Raises SceneError.

    ``text`` is a folder or a pattern, with or without ``seq:`` before and ``@FPS`` behind.
    """
    bare = text.removeprefix(PREFIX)
    rate = _RATE.search(bare)
    fps = float(rate[1]) if rate else DEFAULT_FPS
    if not 0 < fps <= 1e6:
        raise SceneError(f"{fps:g} frames per second cannot be meant", where=text)
    path = Path(bare[: rate.start()] if rate else bare)
    folder, place = (path, None) if path.is_dir() else (path.parent, _PLACE.search(path.name))
    if place is None and folder != path:
        raise SceneError("is neither a folder nor a pattern", where=text, hint="write name%04d.obj or name*.obj")
    pattern = re.compile(r"(.*?)(\d+)(\D*\.obj)", re.IGNORECASE)
    if place is not None:
        before, after = (re.escape(part) for part in (path.name[: place.start()], path.name[place.end() :]))
        pattern = re.compile(rf"({before})(\d+)({after})")
    try:
        names = sorted(p.name for p in folder.iterdir())
    except OSError as e:
        raise SceneError(f"cannot be read: {e.strerror}", where=str(folder)) from None
    found = [m for m in map(pattern.fullmatch, names) if m]
    if not found:
        raise SceneError("no numbered .obj file matches", where=text, hint="files are called name000.obj, name001.obj")
    stems = {(m[1], m[3]) for m in found}
    if len(stems) > 1:
        shown = ", ".join(f"{a}*{b}" for a, b in sorted(stems)[:4])
        raise SceneError(f"the folder holds several sequences: {shown}", where=text, hint="name one of them")
    if len(found) > MAX_FRAMES:
        raise SceneError(f"{len(found)} files, more than {MAX_FRAMES}", where=text)
    found.sort(key=lambda m: (int(m[2]), m[2]))
    numbers = [int(m[2]) for m in found]
    odd = []
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        odd.append("the numbers of the files have gaps or repeat: frames follow each other as the files do")
    return [folder / m[0] for m in found], fps, odd


@dataclass(slots=True)
class Shape:
    """One object in one frame.  ``corners`` count from the object's own lowest indices."""

    materials: tuple[str, ...]
    corners: tuple[Array, ...]  # per material (T, 3, 3) int64
    v: Array  # (n, 3) the object's stretch of the file's positions
    vt: Array
    vn: Array

    def same_topology(self, other: Shape) -> bool:
        return (
            self.materials == other.materials
            and self.v.shape == other.v.shape
            and self.vn.shape == other.vn.shape
            and self.vt.shape == other.vt.shape
            and all(np.array_equal(a, b) for a, b in zip(self.corners, other.corners, strict=True))
        )


def shapes(file: ObjFile) -> dict[str, Shape]:
    """The objects of one file by name, in the file's order."""
    groups: dict[str, list[Part]] = {}
    for part in file.parts:
        groups.setdefault(part.object, []).append(part)
    return {name: _shape(file, parts) for name, parts in groups.items()}


def _shape(file: ObjFile, parts: list[Part]) -> Shape:
    """An object whose indices moved because another one grew has not changed itself."""
    joined = np.concatenate([p.corners.reshape(-1, 3) for p in parts])
    low, arrays = np.zeros(3, dtype=np.int64), []
    for column, values in enumerate((file.v, file.vt, file.vn)):
        used = joined[:, column][joined[:, column] != MISSING]
        low[column] = used.min() if len(used) else 0
        arrays.append(values[low[column] : used.max() + 1] if len(used) else values[:0])
    corners = tuple(np.where(p.corners == MISSING, MISSING, p.corners - low) for p in parts)
    return Shape(tuple(p.material for p in parts), corners, *arrays)
