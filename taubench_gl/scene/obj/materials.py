"""MTL materials as metallic-roughness materials.

Kd, Ks and Ke are linear (as in Blender), images are sRGB.  The exponent Ns becomes a roughness of (2 / (Ns + 2)) ^ 1/4;
a material with a black or missing Ks is Lambertian.  ``d`` below 1 (or ``Tr`` above 0) becomes glTF's BLEND.  map_d is
ignored, with a note.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.scene.build import Phong
from taubench_gl.scene.files import ImagePool, find_referenced, read_any_text
from taubench_gl.scene.model import Material, Texture
from taubench_gl.scene.notes import Notes

OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-mm": 2, "-bm": 1, "-boost": 1, "-texres": 1,
           "-imfchan": 1, "-type": 1, "-o": 3, "-s": 3, "-t": 3}  # fmt: skip
"""Options of map statements -> number of arguments; -o, -s and -t can have fewer."""


class Library:
    """Materials and images of all material libraries of a scene, in the order of first use."""

    def __init__(self, folder: Path, notes: Notes):
        self.folder, self.notes = folder, notes
        self.materials: list[Material] = []
        self.images = ImagePool(notes)
        self.index: dict[str, int] = {}  # of materials, by name
        self.data: dict[Path, bytes] = {}  # contents of the libraries, in order

    def read(self, names: str, where: str) -> None:
        """Read the libraries of ``mtllib``: one, whose name may have spaces, or several.  Missing ones are noted."""
        target = find_referenced(self.folder, names)
        several = [names] if isinstance(target, Path) else names.split()
        for name in several:
            target = find_referenced(self.folder, name)
            if isinstance(target, str):
                self.notes.remark("library-missing", where, detail=target)
            elif target not in self.data:
                self.data[target], text = read_any_text(target, self.notes, where)
                self._parse(target, text)

    def use(self, name: str) -> int:
        """Index of a material; -1 for none and, with a note, for an unknown name."""
        if name and name not in self.index:
            self.notes.remark("material-unknown", detail=name, key=name)
        return self.index.get(name, -1)

    def _parse(self, path: Path, data: bytes) -> None:
        text = data.decode("utf-8", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
        name, values, lines = None, {}, text.replace("\\\n", "  ").split("\n")
        for number, line in enumerate(lines, start=1):
            words = line.split("#", 1)[0].split()
            if not words:
                continue
            where = f"{path.name}:{number}"
            if words[0] == "newmtl":
                self._add(path, name, values)
                name, values = line.split("#", 1)[0].strip()[6:].strip(), {}
                if not name:
                    self._skipped(SceneError("newmtl without a name", where=where))
            elif name is None:
                self._skipped(SceneError(f"{words[0][:40]!r} comes before the first newmtl", where=where))
            else:
                try:
                    self._statement(words, values, where)
                except SceneError as error:
                    self._skipped(error)
        self._add(path, name, values)

    def _skipped(self, error: SceneError) -> None:
        """A statement that cannot be read: ignored, or the error where the scene is read strictly."""
        self.notes.repair("mtl-statement", error)

    def _statement(self, words: list[str], values: dict, where: str) -> None:
        kind = words[0]
        if kind in ("Kd", "Ks", "Ke"):
            if words[1:2] and words[1] in ("spectral", "xyz"):
                self.notes.remark("mtl-unsupported", where, detail=f"{kind} {words[1]}")
                return
            numbers = _numbers(words[1:], (1, 3), where)
            values[kind] = tuple(max(x, 0.0) for x in (numbers * 3 if len(numbers) == 1 else numbers))
        elif kind in ("d", "Tr", "Ns"):
            values[kind] = _numbers([w for w in words[1:] if w != "-halo"], (1,), where)[0]
        elif kind in ("map_Kd", "map_Ke"):
            values[kind] = (words[1:], where)
        elif kind == "map_d":
            self.notes.remark("mtl-unsupported", where, detail="map_d, the opacity is d")

    def _add(self, path: Path, name: str | None, values: dict) -> None:
        if not name:
            return
        if name in self.index:
            self.notes.remark("material-twice", path.name, detail=name, key=f"{path.name} {name}")
            return
        self.index[name] = len(self.materials)
        alpha = float(np.clip(values.get("d", 1.0 - values.get("Tr", 0.0)), 0.0, 1.0))
        color = values.get("Kd")
        texture = self._texture(*values["map_Kd"]) if "map_Kd" in values else None
        if color is None or (texture is not None and not any(color)):
            color = (1.0, 1.0, 1.0) if texture is not None else (0.8, 0.8, 0.8)
        emission = values.get("Ke", (0.0, 0.0, 0.0))
        glow = self._texture(*values["map_Ke"]) if "map_Ke" in values and any(emission) else None
        look = Phong(color, values.get("Ks", ()), values.get("Ns", 0.0), alpha, texture, emission, glow)
        self.materials.append(look.material(name))

    def _texture(self, words: list[str], where: str) -> Texture | None:
        target = find_referenced(self.folder, " ".join(_without_options(words)))
        if isinstance(target, str):
            self.notes.remark("texture-missing", where, detail=target)
            return None
        return self.images.texture(target)


def _without_options(words: list[str]) -> list[str]:
    i = 0
    while i < len(words) and words[i] in OPTIONS:
        most = OPTIONS[words[i]]
        i += 1
        for _ in range(most):
            if i < len(words) and (most < 3 or re.fullmatch(r"[-+.\deE]+", words[i])):
                i += 1
    return words[i:]


def _numbers(words: list[str], counts: tuple[int, ...], where: str) -> list[float]:
    if len(words) not in counts:
        raise SceneError(f"{len(words)} numbers, expected {' or '.join(map(str, counts))}", where=where)
    try:
        out = [float(w) for w in words]
    except ValueError:
        raise SceneError(f"{' '.join(words)[:40]!r} instead of numbers", where=where) from None
    if not all(abs(x) < 1e30 for x in out):
        raise SceneError("contains a number that is not finite or too large", where=where)
    return out
