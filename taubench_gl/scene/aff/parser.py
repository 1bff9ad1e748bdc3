"""Statements of AFF and NFF files, collected by a ``Parser``.

The format is described at BART's home page (aff.html); the order of a mesh's index triples (vertices, normals, texture
coordinates) and what is optional follow its sample parser."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from taubench_gl import math3d
from taubench_gl.errors import SceneError
from taubench_gl.scene.aff import surfaces
from taubench_gl.scene.aff.surfaces import Collector, Surface
from taubench_gl.scene.build import NodeList
from taubench_gl.scene.files import LARGEST, Identity, find_referenced, number_of, read_text_file, shortened
from taubench_gl.scene.notes import Notes

Array = np.ndarray


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
        return not self.at_end() and not math.isnan(number_of(self.words[self.at]))

    def floats(self, count: int, subject: str) -> Array:
        """The next ``count`` words as numbers.  (count,) float64, finite."""
        words = self.words[self.at : self.at + count]
        if len(words) < count:
            hint = "the file may be truncated"
            raise self.error(f"{subject} needs {count} numbers; {len(words)} words are left", hint)
        out = np.fromiter(map(number_of, words), dtype=np.float64, count=count)
        self._require(np.abs(out) < LARGEST, f"{subject} needs a number below {LARGEST:g}")
        self.at += count
        return out

    def table(self, rows: int, columns: int, subject: str) -> Array:
        """The next ``rows * columns`` words as numbers, (rows, columns) float64.  Raises SceneError for other words."""
        return self.floats(rows * columns, subject).reshape(rows, columns)

    def integer(self, subject: str, low: int, high: int) -> int:
        value = int(self.indices(1, 1, subject)[0, 0])
        if not low <= value <= high:
            raise self.error(f"{subject} is {shortened(self.words[self.at - 1], 40)}; it must be in {low}..{high}")
        return value

    def indices(self, rows: int, columns: int, subject: str) -> Array:
        """The next ``rows * columns`` words as integers, (rows, columns) int64.  Raises SceneError for other words."""
        start = self.at
        values = self.floats(rows * columns, subject)
        self._require(values == np.floor(values), f"{subject} needs an integer", start)
        return np.clip(values, -(2.0**53), 2.0**53).astype(np.int64).reshape(rows, columns)

    def _require(self, good: Array, what: str, start: int | None = None) -> None:
        """Raise SceneError at the first word, from ``start`` or the next one on, that is not ``good`` (n,) bool."""
        if not good.all():
            at = (self.at if start is None else start) + int(np.argmin(good))
            raise self.error(f"{shortened(self.words[at], 40)} where {what}", at=at)


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


MAX_DEPTH = 64
MAX_INCLUDES = 20_000
MAX_VERTICES = 50_000_000
"""Limits on includes: nesting depth, total number of includes, and total number of vertices."""
COUNT = 2**31 - 1


MESH_TABLES = {"vertices": 3, "normals": 3, "texturecoords": 2}
"""Table of a mesh -> numbers per row, in the order of its index triples."""
TRACKS = {"transl": 7, "scale": 7, "rot": 8, "visibility": 2}
"""Kind of key -> numbers per key."""


class Parser:
    """The content of one AFF or NFF file and all that it includes.  Raises SceneError with file and line."""

    def __init__(self, path: Path, notes: Notes):
        self.notes, self.identity, self.nodes = notes, Identity(), NodeList()
        self.drawn: dict[int, Collector] = {}  # by node
        self.fills: dict[Fill, int] = {}
        self.movers: dict[str, list[int]] = {}  # animation name -> nodes
        self.motions: dict[str, Motion] = {}
        self.lights: list[tuple[int, Array, Array]] = []  # parent, position, color
        self.camera: dict[str, Any] | None = None
        self.window: tuple[float, float, int] | None = None  # start, end, frames
        self.ambient = np.zeros(3)
        self._folder, self._stack = path.parent, [self.nodes.add(path.stem)]
        self._fill_number, self._current = -1, None
        self._detail_level = self._vertices = self._includes = 0
        self._tokens: dict[Path, Tokens] = {}
        self._chain: tuple[Path, ...] = ()  # files that include each other, down to the one that is read
        polygon = self._polygon
        self._statements = {
            "v": self._viewpoint, "l": self._light, "la": partial(self._light, animated=True), "b": self._background,
            "f": self._fill, "fm": self._material, "c": self._cone, "s": self._sphere, "p": polygon,
            "pp": partial(polygon, patch=True), "tt": partial(polygon, textured=True),
            "ttp": partial(polygon, patch=True, textured=True), "tpa": self._animated_triangle, "m": self._mesh,
            "mesh": self._mesh, "xs": self._static, "x": self._transform, "k": self._keys, "a": self._animation,
            "am": self._ambient, "i": self._include, "d": self._detail,
        }  # fmt: skip
        self._run(path, None)

    def _run(self, path: Path, where: str | None) -> None:
        outer, resolved = self._chain, Path(os.path.realpath(path))  # Path.resolve raises for a loop of links
        if resolved in outer:
            names = " > ".join(p.name for p in (*outer[outer.index(resolved) :], resolved))
            raise SceneError(f"files include each other: {names}", where=where)
        if len(outer) >= MAX_DEPTH:
            raise SceneError(f"includes are nested deeper than {MAX_DEPTH}", where=where)
        if resolved not in self._tokens:
            data = read_text_file(path, where)
            self._tokens[resolved] = Tokens(path, data)
            self.identity.add(data)
        t = self._tokens[resolved]
        t.at, self._chain = 0, (*outer, resolved)
        depth, opened = len(self._stack), []
        while not t.at_end():
            word = t.word("a statement")
            if word == "}":
                if len(self._stack) <= depth:
                    raise t.error("} without an open block", "every x and xs opens one block with {")
                self._stack.pop()
                opened.pop()
                continue
            if word not in self._statements:
                raise t.error(f"{word[:40]!r} is not an AFF statement", f"known: {' '.join(self._statements)}")
            if word in ("x", "xs"):
                opened.append(t.at - 1)
            self._statements[word](t)
        if opened:
            raise t.error("this block is never closed with }", at=opened[-1])
        self._chain = outer

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
        if self.camera is not None:
            self.notes.remark("aff-viewpoint", t.where(at))
        self.camera = view

    def _light(self, t: Tokens, animated: bool = False) -> None:
        parent = self._mover(t.word("the name of an animated light")) if animated else self._stack[-1]
        position = t.floats(3, "a light's position")
        color = t.floats(3, "a light's color") if t.number_follows() else np.ones(3)
        if np.any(color < 0.0):
            raise t.error("a light's color must not be negative")
        self.lights.append((parent, position, color))

    def _mover(self, name: str) -> int:
        """A new node that the animation ``name`` moves."""
        node = self.nodes.add(name, self._stack[-1])
        self.movers.setdefault(name, []).append(node)
        return node

    def _background(self, t: Tokens) -> None:
        t.floats(3, "the background")
        self.notes.remark("aff-background", t.where())

    def _ambient(self, t: Tokens) -> None:
        self.ambient = np.maximum(t.floats(3, "the ambient light"), 0.0)
        self.notes.remark("aff-ambient", t.where())

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
        self._current, self._fill_number = fill, self._number_of(fill)

    def _number_of(self, fill: Fill) -> int:
        return self.fills.setdefault(fill, len(self.fills))

    def _with_texture(self, name: str, t: Tokens) -> int:
        """The current fill with a texture, or without it if the image cannot be read."""
        target = find_referenced(self._folder, name)
        if isinstance(target, str):  # BART keeps the textures of all its scenes in one folder beside theirs
            shared = find_referenced(self._folder.parent / "TextureFiles", PurePosixPath(name).name)
            target = shared if isinstance(shared, Path) else target
        if isinstance(target, str):
            self.notes.remark("texture-missing", t.where(), detail=target)
            return self._fill_number
        base = self._current or Fill((0.0,) * 3, (1.0,) * 3, (0.0,) * 3, 0.0, 0.0)
        return self._number_of(replace(base, texture=target))

    # ------------------------------------------------------------------------------------------------------ surfaces
    def _draw(self, t: Tokens, surface: Surface, material: int | None = None) -> None:
        self._collector(t, len(surface.positions)).add(surface, self._fill_number if material is None else material)

    def _collector(self, t: Tokens, vertices: int) -> Collector:
        """The collector of the open block, to which so many ``vertices`` are added."""
        self._vertices += vertices
        if self._vertices > MAX_VERTICES:
            raise t.error(f"the scene has more than {MAX_VERTICES} vertices", "every include adds its vertices again")
        return self.drawn.setdefault(self._stack[-1], Collector())

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

    def _polygon(self, t: Tokens, patch: bool = False, textured: bool = False) -> None:
        """A polygon; ``patch``: with normals; ``textured``: a triangle with texture coordinates."""
        material = self._with_texture(t.word("a texture"), t) if textured else None
        count = 3 if textured else t.integer("the number of corners", 3, COUNT)
        rows = t.table(count, 3 + 3 * patch + 2 * textured, "a polygon")
        normals, texcoords = rows[:, 3:6] if patch else None, rows[:, -2:] if textured else None
        self._draw(t, surfaces.polygon(rows[:, :3], normals, texcoords), material)

    def _animated_triangle(self, t: Tokens) -> None:
        count = t.integer("the number of times", 1, COUNT)
        rows = t.table(count, 19, "an animated triangle")
        later = np.concatenate([[True], rows[1:, 0] > np.maximum.accumulate(rows[:, 0])[:-1]])
        if not np.all(later):
            self.notes.remark("aff-triangle-times", t.where())
            rows = rows[later]
        times, frames = tuple(rows[:, 0].tolist()), rows[:, 1:].reshape(-1, 3, 6)
        self._collector(t, 3 * len(rows)).add_moving(times, frames, self._fill_number)

    def _mesh(self, t: Tokens) -> None:
        tables, material, word = [], self._fill_number, t.word("vertices of a mesh")
        for name, width in MESH_TABLES.items():
            if word == name:
                count = t.integer(f"the number of {name}", 0, COUNT)
                if name == "texturecoords":
                    material = self._with_texture(t.word("the texture of a mesh"), t)
                tables.append((name, t.table(count, width, f"{name} of a mesh")))
                word = t.word("triangles of a mesh")
        if word != "triangles" or not tables or tables[0][0] != "vertices":
            raise t.error(f"{word[:40]!r} instead of 'vertices' or 'triangles' in a mesh")
        count, start = t.integer("the number of triangles", 0, COUNT), t.at
        corners = t.indices(count, 3 * len(tables), "triangles of a mesh").reshape(count, len(tables), 3)
        for k, (name, table) in enumerate(tables):
            bad = (corners[:, k] < 0) | (corners[:, k] >= len(table))
            if np.any(bad):
                row, column = (int(x) for x in np.argwhere(bad)[0])
                at = start + (row * len(tables) + k) * 3 + column
                raise t.error(f"index {t.words[at][:20]} in a mesh of {len(table)} {name}", at=at)
        if count:
            self._draw(t, _with_shared_vertices(dict(tables), corners), material)

    # ---------------------------------------------------------------------------------------------------- transforms
    def _static(self, t: Tokens) -> None:
        values = t.floats(10, "a static transform")
        axis, degrees = values[3:6], values[6]
        if not np.any(axis) and degrees != 0.0:
            self.notes.remark("aff-axis", t.where())
        rotation = math3d.quat_from_axis_angle(axis, np.radians(degrees)) if np.any(axis) else (0.0, 0.0, 0.0, 1.0)
        t.expect("{", "a static transform")
        parent, name = self._stack[-1], f"xs {t.where()}"
        self._open(t, self.nodes.add(name, parent, translation=values[7:], rotation=rotation, scale=values[:3]))

    def _transform(self, t: Tokens) -> None:
        name = t.word("the name of a transform")
        t.expect("{", f"the transform {name[:40]}")
        self._open(t, self._mover(name))

    def _open(self, t: Tokens, node: int) -> None:
        self._stack.append(node)
        if len(self._stack) > MAX_DEPTH:
            raise t.error(f"transforms are nested deeper than {MAX_DEPTH}")

    # ----------------------------------------------------------------------------------------------------- animation
    def _animation(self, t: Tokens) -> None:
        start, end = t.floats(2, "the animation's times").tolist()
        frames = t.integer("the number of frames", 1, COUNT)
        if end < start:
            raise t.error(f"the animation ends at {end:g} before it starts at {start:g}")
        self.window = (start, end, frames)

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
                self.notes.remark("aff-key-times", where, detail=f"{kind} of {shortened(name, 40)}")
            motion.tracks[kind] = rows
        if name in self.motions:
            self.notes.remark("aff-animation-twice", motion.where, detail=shortened(name, 40))
        self.motions[name] = motion

    # ------------------------------------------------------------------------------------------------------ includes
    def _detail(self, t: Tokens) -> None:
        self._detail_level = t.integer("the detail level", -COUNT, COUNT)

    def _include(self, t: Tokens) -> None:
        level = t.integer("the detail level of an include", -COUNT, COUNT)
        name, where = t.word("the file to include"), t.where()
        if level > self._detail_level:
            about = f"{shortened(name, 40)}: {level} > {self._detail_level}"
            self.notes.remark("aff-detail", where, detail=about)
            return
        self._includes += 1
        if self._includes > MAX_INCLUDES:
            raise t.error(f"more than {MAX_INCLUDES} files are included")
        target = find_referenced(self._folder, name)
        if isinstance(target, str):
            raise t.error(f"include {target}", "put the file into the scene's folder and use a relative path")
        self._run(target, where)


def _with_shared_vertices(tables: dict[str, Array], corners: Array) -> Surface:
    """One vertex per distinct combination of indices into ``tables``.  ``corners`` (T, tables, 3)."""
    flat = corners.transpose(0, 2, 1).reshape(-1, corners.shape[1])
    rows, inverse = np.unique(flat, axis=0, return_inverse=True)
    columns = {name: table[rows[:, k]] for k, (name, table) in enumerate(tables.items())}
    normals = surfaces.usable_normals(columns.get("normals"))
    return Surface(columns["vertices"], inverse.reshape(-1, 3), normals, columns.get("texturecoords"))
