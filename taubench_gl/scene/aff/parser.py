"""Statements of AFF and NFF files, collected in an ``AffFile``.

The format is described at BART's home page (aff.html); the order of a mesh's index triples (vertices, normals, texture
coordinates) and what is optional follow its sample parser."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from taubench_gl import math3d
from taubench_gl.errors import SceneError
from taubench_gl.scene.aff import surfaces
from taubench_gl.scene.aff.surfaces import Collector, Surface
from taubench_gl.scene.build import NodeList
from taubench_gl.scene.files import Identity, find_referenced, read_text_file, shortened
from taubench_gl.scene.notes import Notes

Array = np.ndarray

LARGEST = 1e30
"""Limit on the magnitude of numbers: values fit a float32, their squares a float64."""


class Tokens:
    """Whitespace-separated words with line numbers.  ``#`` and ``%`` start comments; braces are words."""

    def __init__(self, path: Path, data: bytes):
        self.path = path
        self.words: list[str] = []
        ends = []
        text = data.decode("utf-8", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
        for line in text.split("\n"):
            line = line.partition("#")[0].partition("%")[0]
            if "{" in line or "}" in line:
                line = line.replace("{", " { ").replace("}", " } ")
            self.words += line.split()
            ends.append(len(self.words))
        self._ends = np.array(ends, dtype=np.int64)
        self.at = 0

    def line(self, at: int | None = None) -> int:
        """Line number, from 1, of word ``at``; None: of the last word read."""
        at = max(self.at - 1, 0) if at is None else min(at, max(len(self.words) - 1, 0))
        return int(np.searchsorted(self._ends, at, side="right")) + 1

    def where(self, at: int | None = None) -> str:
        return f"{self.path.name}:{self.line(at)}"

    def error(self, message: str, hint: str | None = None, at: int | None = None) -> SceneError:
        """A SceneError at file and line of word ``at``, for the caller to raise."""
        return SceneError(message, where=self.where(at), hint=hint)

    def at_end(self) -> bool:
        return self.at >= len(self.words)

    def word(self, subject: str) -> str:
        if self.at_end():
            raise self.error(f"the file ends before {subject}", "the file may be truncated")
        self.at += 1
        return self.words[self.at - 1]

    def expect(self, word: str, subject: str) -> None:
        actual = self.word(f"{word!r} of {subject}")
        if actual != word:
            raise self.error(f"{shortened(actual, 40)} instead of {word!r} in {subject}")

    def number_follows(self) -> bool:
        if self.at_end():
            return False
        try:
            float(self.words[self.at])
        except ValueError:
            return False
        return True

    def floats(self, count: int, subject: str) -> Array:
        """The next ``count`` words as numbers.  (count,) float64, finite."""
        words = self.words[self.at : self.at + count]
        if len(words) < count:
            raise self.error(
                f"{subject} needs {count} numbers; {len(words)} words are left", "the file may be truncated"
            )
        try:
            out = np.fromiter(map(float, words), dtype=np.float64, count=count)
        except ValueError:
            for i, word in enumerate(words):
                try:
                    float(word)
                except ValueError:
                    raise self.error(f"{shortened(word, 40)} where {subject} needs a number", at=self.at + i) from None
            raise
        bad = ~(np.abs(out) < LARGEST)
        if np.any(bad):
            i = int(np.argmax(bad))
            raise self.error(f"{shortened(words[i], 40)} in {subject} is not a usable number", at=self.at + i)
        self.at += count
        return out

    def table(self, rows: int, columns: int, subject: str) -> Array:
        """The next ``rows * columns`` words as numbers, (rows, columns) float64.  Raises SceneError for other words."""
        return self.floats(rows * columns, subject).reshape(rows, columns)

    def integer(self, subject: str, low: int, high: int) -> int:
        word = self.word(subject)
        try:
            value = int(word)
        except ValueError:
            raise self.error(f"{shortened(word, 40)} where {subject} must be an integer") from None
        if not low <= value <= high:
            raise self.error(f"{subject} is {shortened(word, 40)}; it must be in {low}..{high}")
        return value

    def indices(self, rows: int, columns: int, subject: str) -> Array:
        """The next ``rows * columns`` words as integers, (rows, columns) int64.  Raises SceneError for other words."""
        start = self.at
        values = self.floats(rows * columns, subject)
        bad = values != np.floor(values)
        if np.any(bad):
            at = start + int(np.argmax(bad))
            raise self.error(f"{shortened(self.words[at], 40)} where {subject} needs an integer", at=at)
        return np.clip(values, -(2.0**53), 2.0**53).astype(np.int64).reshape(rows, columns)


def read_tokens(path: Path, where: str | None = None) -> tuple[Tokens, bytes]:
    """Words and raw bytes of one file.  Raises SceneError."""
    data = read_text_file(path, where)
    return Tokens(path, data), data


@dataclass(frozen=True, slots=True)
class Fill:
    """A surface description: colors are linear coefficients, ``shine`` is a Phong exponent."""

    ambient: tuple[float, ...]
    diffuse: tuple[float, ...]
    specular: tuple[float, ...]
    shine: float
    transmittance: float
    texture: Path | None = None


@dataclass(slots=True)
class Motion:
    """One ``k`` statement.  Rows: transl and scale (t, xyz, tcb), rot (t, axis, degrees, tcb), visibility (t, on)."""

    name: str
    where: str
    tracks: dict[str, Array] = field(default_factory=dict)


@dataclass(slots=True)
class AffFile:
    """The content of all files, before it is converted to a Scene."""

    nodes: NodeList = field(default_factory=NodeList)
    drawn: dict[int, Collector] = field(default_factory=dict)  # by node
    fills: dict[Fill, int] = field(default_factory=dict)
    movers: dict[str, list[int]] = field(default_factory=dict)  # animation name -> nodes
    motions: dict[str, Motion] = field(default_factory=dict)
    lights: list[tuple[int, Array, Array]] = field(default_factory=list)  # parent, position, color
    camera: dict[str, Any] | None = None
    window: tuple[float, float, int] | None = None  # start, end, frames
    ambient: Array = field(default_factory=lambda: np.zeros(3))
    identity: Identity = field(default_factory=Identity)
    notes: Notes = field(default_factory=Notes)


MAX_DEPTH = 64
MAX_INCLUDES = 20_000
MAX_VERTICES = 50_000_000
"""Limits on includes: nesting depth, total number of includes, and total number of vertices."""
COUNT = 2**31 - 1


TRACKS = {"transl": 7, "scale": 7, "rot": 8, "visibility": 2}
"""Kind of key -> numbers per key."""


class Parser:
    """Reads one AFF or NFF file and all it includes.  Raises SceneError with file and line."""

    def __init__(self, path: Path, notes: Notes):
        self.path = path
        self.file = AffFile(notes=notes)
        self.stack = [self.file.nodes.add(path.stem)]
        self.fill = -1
        self.current: Fill | None = None
        self.detail = 0
        self.vertices = 0
        self.includes = 0
        self._cache: dict[Path, Tokens] = {}
        self._statements = {
            "v": self._viewpoint, "l": self._light, "la": self._animated_light, "b": self._background,
            "f": self._fill, "fm": self._material, "c": self._cone, "s": self._sphere,
            "p": self._polygon, "pp": self._patch, "tt": self._textured, "ttp": self._textured_patch,
            "tpa": self._animated_triangle, "m": self._mesh, "mesh": self._mesh, "xs": self._static,
            "x": self._transform, "k": self._keys, "a": self._animation, "am": self._ambient,
            "i": self._include, "d": self._detail,
        }  # fmt: skip

    def parse(self) -> AffFile:
        self._run(self.path, (), None)
        return self.file

    def _run(self, path: Path, chain: tuple[Path, ...], where: str | None) -> None:
        resolved = Path(os.path.realpath(path))  # Path.resolve raises for a loop of links
        if resolved in chain:
            names = " > ".join(p.name for p in (*chain[chain.index(resolved) :], resolved))
            raise SceneError(f"files include each other: {names}", where=where)
        if len(chain) >= MAX_DEPTH:
            raise SceneError(f"includes are nested deeper than {MAX_DEPTH}", where=where)
        if resolved not in self._cache:
            self._cache[resolved], data = read_tokens(path, where)
            self.file.identity.add(data)
        cached = self._cache[resolved]
        t = _rewound(cached)
        depth = len(self.stack)
        opened: list[int] = []
        self.chain = (*chain, resolved)
        while not t.at_end():
            word = t.word("a statement")
            if word == "}":
                if len(self.stack) <= depth:
                    raise t.error("} without an open block", "every x and xs opens one block with {")
                self.stack.pop()
                opened.pop()
                continue
            statement = self._statements.get(word)
            if statement is None:
                raise t.error(f"{word[:40]!r} is not an AFF statement", f"known: {' '.join(self._statements)}")
            if word in ("x", "xs"):
                opened.append(t.at - 1)
            statement(t)
            self.chain = (*chain, resolved)
        if opened:
            raise t.error("this block is never closed with }", at=opened[-1])

    # ------------------------------------------------------------------------------------------------ view and light
    def _viewpoint(self, t: Tokens) -> None:
        at = t.at - 1
        view: dict[str, Any] = {}
        for name, count in (("from", 3), ("at", 3), ("up", 3), ("angle", 1), ("hither", 1), ("resolution", 2)):
            t.expect(name, "the viewpoint")
            view[name] = t.floats(count, f"{name} of the viewpoint")
        if not np.any(view["from"] - view["at"]):
            raise t.error("the viewpoint has no direction: from equals at", at=at)
        if not 0.0 < view["angle"][0] < 180.0:
            raise t.error(f"angle of the viewpoint is {view['angle'][0]:g}; it must be in 0..180 degrees", at=at)
        if not np.all(view["resolution"] >= 1):
            raise t.error("resolution of the viewpoint must be positive", at=at)
        if self.file.camera is not None:
            self.file.notes.remark("aff-viewpoint", t.where(at))
        self.file.camera = view

    def _light(self, t: Tokens) -> None:
        self._add_light(t, self.stack[-1])

    def _animated_light(self, t: Tokens) -> None:
        name = t.word("the name of an animated light")
        node = self.file.nodes.add(name, self.stack[-1])
        self.file.movers.setdefault(name, []).append(node)
        self._add_light(t, node)

    def _add_light(self, t: Tokens, parent: int) -> None:
        position = t.floats(3, "a light's position")
        color = t.floats(3, "a light's color") if t.number_follows() else np.ones(3)
        if np.any(color < 0.0):
            raise t.error("a light's color must not be negative")
        self.file.lights.append((parent, position, color))

    def _background(self, t: Tokens) -> None:
        t.floats(3, "the background")
        self.file.notes.remark("aff-background", t.where())

    def _ambient(self, t: Tokens) -> None:
        self.file.ambient = np.maximum(t.floats(3, "the ambient light"), 0.0)
        self.file.notes.remark("aff-ambient", t.where())

    # ----------------------------------------------------------------------------------------------------- materials
    def _fill(self, t: Tokens) -> None:
        r, g, b, kd, ks, shine, transmittance, _ = t.floats(8, "a fill").tolist()
        color = np.maximum([r, g, b], 0.0)
        self._use(Fill(tuple(color), tuple(color * max(kd, 0.0)), (max(ks, 0.0),) * 3, shine, transmittance))

    def _material(self, t: Tokens) -> None:
        values = t.floats(12, "a material")
        a, d, s = (tuple(np.maximum(part, 0.0).tolist()) for part in values[:9].reshape(3, 3))
        self._use(Fill(a, d, s, float(values[9]), float(values[10])))

    def _use(self, fill: Fill) -> None:
        self.current = fill
        self.fill = self.file.fills.setdefault(fill, len(self.file.fills))

    def _with_texture(self, name: str, t: Tokens) -> int:
        """The current fill with a texture, or without it if the image cannot be read."""
        target = find_referenced(self.path.parent, name)
        if isinstance(target, str):  # BART keeps the textures of all its scenes in one folder beside theirs
            shared = find_referenced(self.path.parent.parent / "TextureFiles", PurePosixPath(name).name)
            target = shared if isinstance(shared, Path) else target
        if isinstance(target, str):
            self.file.notes.remark("texture-missing", t.where(), detail=target)
            return self.fill
        base = self.current or Fill((0.0,) * 3, (1.0,) * 3, (0.0,) * 3, 0.0, 0.0)
        fill = Fill(base.ambient, base.diffuse, base.specular, base.shine, base.transmittance, target)
        return self.file.fills.setdefault(fill, len(self.file.fills))

    # ------------------------------------------------------------------------------------------------------ surfaces
    def _draw(self, t: Tokens, surface: Surface, material: int | None = None) -> None:
        self._count(t, len(surface.positions))
        collector = self.file.drawn.setdefault(self.stack[-1], Collector())
        collector.add(surface, self.fill if material is None else material)

    def _count(self, t: Tokens, vertices: int) -> None:
        self.vertices += vertices
        if self.vertices > MAX_VERTICES:
            raise t.error(f"the scene has more than {MAX_VERTICES} vertices", "every include adds its vertices again")

    def _sphere(self, t: Tokens) -> None:
        values = t.floats(4, "a sphere")
        if values[3] == 0.0:
            raise t.error("a sphere has radius 0")
        self._draw(t, surfaces.sphere(values[:3], float(values[3])))

    def _cone(self, t: Tokens) -> None:
        values = t.floats(8, "a cone")
        if not np.any(values[:3] - values[4:7]) or not np.any(values[[3, 7]]):
            raise t.error("a cone has height 0 or radius 0")
        self._draw(t, surfaces.cone(values[:3], float(values[3]), values[4:7], float(values[7])))

    def _polygon(self, t: Tokens) -> None:
        count = t.integer("the number of corners", 3, COUNT)
        self._draw(t, surfaces.polygon(t.table(count, 3, "a polygon")))

    def _patch(self, t: Tokens) -> None:
        count = t.integer("the number of corners", 3, COUNT)
        rows = t.table(count, 6, "a patch")
        self._draw(t, surfaces.polygon(rows[:, :3], rows[:, 3:]))

    def _textured(self, t: Tokens) -> None:
        material = self._with_texture(t.word("a texture"), t)
        rows = t.table(3, 5, "a textured triangle")
        self._draw(t, surfaces.polygon(rows[:, :3], None, rows[:, 3:]), material)

    def _textured_patch(self, t: Tokens) -> None:
        material = self._with_texture(t.word("a texture"), t)
        rows = t.table(3, 8, "a textured patch")
        self._draw(t, surfaces.polygon(rows[:, :3], rows[:, 3:6], rows[:, 6:]), material)

    def _animated_triangle(self, t: Tokens) -> None:
        count = t.integer("the number of times", 1, COUNT)
        rows = t.table(count, 19, "an animated triangle")
        later = np.concatenate([[True], rows[1:, 0] > np.maximum.accumulate(rows[:, 0])[:-1]])
        if not np.all(later):
            self.file.notes.remark("aff-triangle-times", t.where())
            rows = rows[later]
        self._count(t, 3 * len(rows))
        collector = self.file.drawn.setdefault(self.stack[-1], Collector())
        collector.add_moving(tuple(rows[:, 0].tolist()), rows[:, 1:].reshape(-1, 3, 6), self.fill)

    def _mesh(self, t: Tokens) -> None:
        t.expect("vertices", "a mesh")
        positions = t.table(t.integer("the number of vertices", 0, COUNT), 3, "vertices of a mesh")
        normals = texcoords = None
        material = self.fill
        word = t.word("triangles of a mesh")
        if word == "normals":
            normals = t.table(t.integer("the number of normals", 0, COUNT), 3, "normals of a mesh")
            word = t.word("triangles of a mesh")
        if word == "texturecoords":
            count = t.integer("the number of texture coordinates", 0, COUNT)
            material = self._with_texture(t.word("the texture of a mesh"), t)
            texcoords = t.table(count, 2, "texture coordinates of a mesh")
            word = t.word("triangles of a mesh")
        if word != "triangles":
            raise t.error(f"{word[:40]!r} instead of 'triangles' in a mesh")
        count, start = t.integer("the number of triangles", 0, COUNT), t.at
        parts = [a for a in (positions, normals, texcoords) if a is not None]
        corners = t.indices(count, 3 * len(parts), "triangles of a mesh").reshape(count, len(parts), 3)
        for k, part in enumerate(parts):
            bad = (corners[:, k] < 0) | (corners[:, k] >= len(part))
            if np.any(bad):
                row, column = (int(x) for x in np.argwhere(bad)[0])
                noun = "vertices" if k == 0 else "normals" if part is normals else "texture coordinates"
                at = start + (row * len(parts) + k) * 3 + column
                raise t.error(f"index {t.words[at][:20]} in a mesh of {len(part)} {noun}", at=at)
        if count:
            self._draw(t, _with_shared_vertices(positions, normals, texcoords, corners), material)

    # ---------------------------------------------------------------------------------------------------- transforms
    def _static(self, t: Tokens) -> None:
        values = t.floats(10, "a static transform")
        axis, degrees = values[3:6], values[6]
        if not np.any(axis) and degrees != 0.0:
            self.file.notes.remark("aff-axis", t.where())
        rotation = math3d.quat_from_axis_angle(axis, np.radians(degrees)) if np.any(axis) else (0.0, 0.0, 0.0, 1.0)
        t.expect("{", "a static transform")
        node = self.file.nodes.add(
            f"xs {t.where()}", self.stack[-1], translation=values[7:], rotation=rotation, scale=values[:3]
        )
        self._open(t, node)

    def _transform(self, t: Tokens) -> None:
        name = t.word("the name of a transform")
        t.expect("{", f"the transform {name[:40]}")
        node = self.file.nodes.add(name, self.stack[-1])
        self.file.movers.setdefault(name, []).append(node)
        self._open(t, node)

    def _open(self, t: Tokens, node: int) -> None:
        self.stack.append(node)
        if len(self.stack) > MAX_DEPTH:
            raise t.error(f"transforms are nested deeper than {MAX_DEPTH}")

    # ----------------------------------------------------------------------------------------------------- animation
    def _animation(self, t: Tokens) -> None:
        start, end = t.floats(2, "the animation's times").tolist()
        frames = t.integer("the number of frames", 1, COUNT)
        if end < start:
            raise t.error(f"the animation ends at {end:g} before it starts at {start:g}")
        self.file.window = (start, end, frames)

    def _keys(self, t: Tokens) -> None:
        name = t.word("the name of an animation")
        motion = Motion(name, t.where())
        t.expect("{", f"the animation {name[:40]}")
        while (kind := t.word("} of an animation")) != "}":
            if kind not in TRACKS:
                raise t.error(f"{kind[:40]!r} is not a kind of key", f"known: {' '.join(TRACKS)}")
            least = 1 if kind == "visibility" else 4
            count, where = t.integer(f"the number of {kind} keys", least, COUNT), t.where()
            rows = t.table(count, TRACKS[kind], f"{kind} keys of {name[:40]}")
            if np.any(np.diff(rows[:, 0]) <= 0):
                self.file.notes.remark("aff-key-times", where, detail=f"{kind} of {shortened(name, 40)}")
            motion.tracks[kind] = rows
        if name in self.file.motions:
            self.file.notes.remark("aff-animation-twice", motion.where, detail=shortened(name, 40))
        self.file.motions[name] = motion

    # ------------------------------------------------------------------------------------------------------ includes
    def _detail(self, t: Tokens) -> None:
        self.detail = t.integer("the detail level", -COUNT, COUNT)

    def _include(self, t: Tokens) -> None:
        level = t.integer("the detail level of an include", -COUNT, COUNT)
        name, where = t.word("the file to include"), t.where()
        if level > self.detail:
            about = f"{shortened(name, 40)}: {level} > {self.detail}"
            self.file.notes.remark("aff-detail", where, detail=about)
            return
        self.includes += 1
        if self.includes > MAX_INCLUDES:
            raise t.error(f"more than {MAX_INCLUDES} files are included")
        target = find_referenced(self.path.parent, name)
        if isinstance(target, str):
            raise t.error(f"include {target}", "put the file into the scene's folder and use a relative path")
        self._run(target, self.chain, where)


def _rewound(cached: Tokens) -> Tokens:
    """A reader of the same words that starts at the first."""
    t = object.__new__(Tokens)
    t.__dict__ = dict(cached.__dict__)
    t.at = 0
    return t


def _with_shared_vertices(positions: Array, normals: Array | None, texcoords: Array | None, corners: Array) -> Surface:
    """One vertex per distinct combination of indices.  ``corners`` (T, parts, 3)."""
    flat = corners.transpose(0, 2, 1).reshape(-1, corners.shape[1])
    vertices, inverse = np.unique(flat, axis=0, return_inverse=True)
    normal_column = None if normals is None else vertices[:, 1]
    return Surface(
        positions[vertices[:, 0]],
        inverse.reshape(-1, 3),
        None if normals is None else surfaces.usable_normals(normals[normal_column]),
        None if texcoords is None else texcoords[vertices[:, -1]],
    )
