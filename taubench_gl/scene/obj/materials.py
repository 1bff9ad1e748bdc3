"""MTL materials as metallic-roughness materials.

Kd, Ks and Ke are linear (as in Blender), images of colors are sRGB.  The exponent Ns becomes a roughness of
(2 / (Ns + 2)) ^ 1/4 unless Pr states it; a material with a black Ks, or without Ks, Pr and Pm, is Lambertian.  ``d``
below 1 (or ``Tr`` above 0) becomes glTF's BLEND.  Maps are scaled by -s and moved by -o.  Notes count what is not
simulated.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.scene.build import Phong
from taubench_gl.scene.files import LARGEST, ImagePool, find_referenced, number_of, read_any_text
from taubench_gl.scene.model import Material, Texture
from taubench_gl.scene.notes import Notes

OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-mm": 2, "-bm": 1, "-boost": 1, "-texres": 1,
           "-imfchan": 1, "-type": 1, "-o": 3, "-s": 3, "-t": 3}  # fmt: skip
"""Options of map statements -> number of arguments; -o, -s and -t can have fewer."""

COLORS, NUMBERS = ("Kd", "Ks", "Ke"), ("d", "Tr", "Ns", "Pm", "Pr")
MAPS = ("map_Kd", "map_Ke", "map_Pm", "map_Pr", "norm")
BY_LETTERS = {name.lower(): name for name in ("newmtl", *COLORS, *NUMBERS, *MAPS)}
MEANINGLESS = {"ka", "map_ka", "illum", "sharpness", "map_aat"}
"""Statements of ambient light, of renderers' modes and of filters: nothing is lost without them."""
NEUTRAL = {"ni": {"1", "1.45", "1.5"}, "tf": {"1"}, "aniso": {"0"}, "anisor": {"0"}, "pc": {"0"}, "pcr": {"0.03", "0"},
           "ps": {"0"}}  # fmt: skip
"""Statements that are not simulated -> numbers with which they change nothing here."""
CLAMP = 33071  # GL_CLAMP_TO_EDGE


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
            line = re.split(r"(?:^|(?<=\s))#", line, maxsplit=1)[0].strip()  # names can hold one inside a word
            words = line.split()
            if not words:
                continue
            where = f"{path.name}:{number}"
            kind = BY_LETTERS.get(words[0].lower(), words[0])
            if kind in (*COLORS, *NUMBERS):
                words = line.split("#", 1)[0].split()
            if kind != words[0]:
                fault = SceneError(f"{words[0]!r} is spelled {kind!r}", where=where)
                self.notes.repair("mtl-case", fault, detail=words[0])
                words[0] = kind
            if kind == "newmtl":
                self._add(path, name, values)
                name, values = line[6:].strip(), {}
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
        if kind in COLORS:
            if words[1:2] and words[1] in ("spectral", "xyz"):
                self.notes.remark("mtl-unsupported", where, detail=f"{kind} {words[1]}")
                return
            numbers = _numbers(words[1:], (1, 3), where)
            values[kind] = tuple(max(x, 0.0) for x in (numbers * 3 if len(numbers) == 1 else numbers))
        elif kind in NUMBERS:
            values[kind] = _numbers([w for w in words[1:] if w != "-halo"], (1,), where)[0]
        elif kind in MAPS:
            values[kind] = (words, where)
        elif kind.lower() not in MEANINGLESS:
            neutral = NEUTRAL.get(kind.lower(), ())
            if not (neutral and all(f"{number_of(w):g}" in neutral for w in words[1:])):
                detail = "map_d, the opacity is d" if kind == "map_d" else kind[:40]
                self.notes.remark("mtl-unsupported", where, detail=detail)

    def _add(self, path: Path, name: str | None, values: dict) -> None:
        if not name:
            return
        if name in self.index:
            self.notes.remark("material-twice", path.name, detail=name, key=f"{path.name} {name}")
            return
        self.index[name] = len(self.materials)
        alpha = float(np.clip(values.get("d", 1.0 - values.get("Tr", 0.0)), 0.0, 1.0))
        color = values.get("Kd")
        texture, _ = self._texture(values, "map_Kd")
        if color is None or (texture is not None and not any(color)):
            color = (1.0, 1.0, 1.0) if texture is not None else (0.8, 0.8, 0.8)
        emission = values.get("Ke", (0.0, 0.0, 0.0))
        glow = self._texture(values, "map_Ke")[0] if any(emission) else None
        look = Phong(color, values.get("Ks", ()), values.get("Ns", 0.0), alpha, texture, emission, glow)
        self.materials.append(self._physical(look.material(name), values))

    def _physical(self, material: Material, values: dict) -> Material:
        """``material`` with what Pr, Pm, norm and their maps state."""
        roughness, metallic = (self._texture(values, kind)[0] for kind in ("map_Pr", "map_Pm"))
        normals, strength = self._texture(values, "norm")
        stated = not values.keys().isdisjoint(("Pr", "Pm", "map_Pr", "map_Pm"))
        return replace(
            material,
            metallic=1.0 if metallic is not None else float(np.clip(values.get("Pm", 0.0), 0.0, 1.0)),
            roughness=1.0 if roughness is not None else float(np.clip(values.get("Pr", material.roughness), 0.0, 1.0)),
            metallic_roughness_texture=self.images.packed(roughness, metallic),
            normal_texture=normals,
            normal_scale=strength,
            specular=1.0 if stated and "Ks" not in values else material.specular,
        )

    def _texture(self, values: dict, kind: str) -> tuple[Texture | None, float]:
        """The texture of one map statement and its -bm; None without the statement or its image."""
        if kind not in values:
            return None, 1.0
        words, where = values[kind]
        options, name = _options(words[1:])
        target = find_referenced(self.folder, " ".join(name))
        if isinstance(target, str):
            self.notes.remark("texture-missing", where, detail=target)
            return None, 1.0
        for option in options.keys() - {"-s", "-o", "-clamp", "-bm", "-type"}:
            self.notes.remark("mtl-unsupported", where, detail=f"{option} of {kind}")
        texture = self.images.texture(target, data=kind not in ("map_Kd", "map_Ke"))
        if texture is None:
            return None, 1.0
        (su, sv), (ou, ov) = (_pair(options.get(o, []), default) for o, default in (("-s", 1.0), ("-o", 0.0)))
        # The file counts v upwards, textures downwards: 1 - v' = sv (1 - v) + ov.
        transform = np.array([[su, 0.0, ou], [0.0, sv, 1.0 - sv - ov]])
        sampler = replace(texture.sampler, wrap_s=CLAMP, wrap_t=CLAMP) if options.get("-clamp") == ["on"] else None
        texture = replace(texture, uv_transform=transform, sampler=sampler or texture.sampler)
        return texture, _pair(options.get("-bm", []), 1.0)[0]


def _options(words: list[str]) -> tuple[dict[str, list[str]], list[str]]:
    """The options in front of a map's file name, with their arguments, and the words of the name."""
    options: dict[str, list[str]] = {}
    i = 0
    while i < len(words) and words[i] in OPTIONS:
        most, arguments = OPTIONS[words[i]], options.setdefault(words[i], [])
        i += 1
        for _ in range(most):
            if i < len(words) and (most < 3 or re.fullmatch(r"[-+.\deE]+", words[i])):
                arguments.append(words[i])
                i += 1
    return options, words[i:]


def _pair(arguments: list[str], default: float) -> tuple[float, float]:
    """The first two of ``arguments``, ``default`` for what is missing or no finite number."""
    numbers = [x if abs(x := number_of(word)) < LARGEST else default for word in arguments[:2]]
    first, second = [*numbers, default, default][:2]
    return first, second


def _numbers(words: list[str], counts: tuple[int, ...], where: str) -> list[float]:
    if len(words) not in counts:
        raise SceneError(f"{len(words)} numbers, expected {' or '.join(map(str, counts))}", where=where)
    out = [number_of(w) for w in words]
    if not all(abs(x) < LARGEST for x in out):
        raise SceneError(f"{' '.join(words)[:40]!r} instead of numbers below {LARGEST:g}", where=where)
    return out
