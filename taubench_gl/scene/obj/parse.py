"""The statements of one OBJ file as arrays.

Lines are grouped by keyword with array operations, and the numbers of each group are converted at once.  Only if that
fails, the lines are searched one by one for the error.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.scene.files import LARGEST, number_of, read_any_text
from taubench_gl.scene.notes import Notes
from taubench_gl.scene.polygons import cut_polygons
from taubench_gl.srgb import srgb_decode

Array = np.ndarray

SPACE, SLASH, NEWLINE = 32, 47, 10
MISSING = -1
"""Index of a corner without texture coordinate or normal."""

COUNTS = {b"v": (3, 4, 6, 7, 8), b"vt": (1, 2, 3), b"vn": (3,)}
"""Allowed counts of numbers per line; the weight of v is ignored."""
COLORED = (6, 7)
"""Counts of numbers of a v that has a color, sRGB, behind its position."""
NAMED = (b"o", b"g", b"usemtl", b"mtllib")
"""Statements whose text can hold a ``#`` inside a word."""
STATES = (b"o", b"g", b"usemtl")
IGNORED = (b"s", b"vp", b"mg", b"lod", b"bevel", b"c_interp", b"d_interp", b"shadow_obj", b"trace_obj", b"maplib",
           b"usemap")  # fmt: skip
CURVES = (b"curv", b"curv2", b"surf", b"cstype", b"deg", b"parm", b"end", b"bmat", b"step", b"call", b"trim", b"hole")


@dataclass(slots=True)
class Part:
    """Triangles of one object and material: for each corner v, vt, vn, from 0, int64."""

    object: str
    material: str
    corners: Array  # (T, 3, 3) drawn
    fans: Array  # (F, 3, 3) every polygon as a fan, which names its corners whatever its shape


@dataclass(slots=True)
class ObjFile:
    """One file.  ``undrawn`` counts statements that are not simulated."""

    path: Path
    data: bytes
    v: Array  # (V, 3) float64
    colors: Array | None  # (V, 3) float64, linear; None: no vertex has one
    vt: Array  # (T, 2) float64, v upwards as in the file
    vn: Array  # (N, 3) float64, not normalized
    parts: list[Part]
    libraries: list[tuple[str, str]]  # name, file:line
    undrawn: dict[str, int] = field(default_factory=dict)


LINES_SHARE = 0.3
"""Share of the time of reading a file that it takes to find its lines and words."""


def parse_obj(path: Path, notes: Notes, watch: Callable[[float], None] = lambda share: None) -> ObjFile:
    """Read one OBJ file; ``notes`` counts the repairs.  Raises SceneError with file and line.

    ``watch`` gets the share of the work that is done, now and then.
    """
    raw, text = read_any_text(path, notes)
    return _Lines(path, text, notes).file(raw, watch)


class _Lines:
    def __init__(self, path: Path, raw: bytes, notes: Notes):
        self.path, self.notes = path, notes
        if b"\r" in raw:
            # All replacements preserve the length, and with it the line numbers.
            raw = raw.replace(b"\\\r\n", b" \\\n").replace(b"\r\n", b" \n").replace(b"\r", b"\n")
        self.breaks = np.flatnonzero(np.frombuffer(raw, np.uint8) == NEWLINE)
        raw = raw.replace(b"\\\n", b"  ")
        data = np.frombuffer(raw, np.uint8).copy()
        ends = np.append(np.flatnonzero(data == NEWLINE), len(data))
        starts = np.concatenate([[0], ends[:-1] + 1])
        if b"#" in raw:
            marks = np.flatnonzero(data == ord("#"))
            first = np.unique(np.searchsorted(ends, marks), return_index=True)
            for line, at in zip(first[0].tolist(), marks[first[1]].tolist()):
                text = data[starts[line] : ends[line]].tobytes()
                if text.split(None, 1)[0] in NAMED and (comment := re.search(rb"(?<=\s)#", text)) is not None:
                    at = starts[line] + comment.start()
                elif text.split(None, 1)[0] in NAMED:
                    continue
                data[at : ends[line]] = SPACE
        data[(data < SPACE) & (data != NEWLINE)] = SPACE
        blank = data <= SPACE
        before = np.concatenate([[True], blank[:-1]])
        self.words = np.flatnonzero(~blank & before)
        after = np.concatenate([blank[1:], [True]])
        self.word_ends = np.flatnonzero(~blank & after) + 1
        self.data, self.starts, self.ends = data, starts, ends
        so_far = np.searchsorted(self.words, ends)
        counts = np.diff(so_far, prepend=0)
        self.used = np.flatnonzero(counts)  # lines with words, in order
        self.count = counts[self.used]
        self.first = so_far[self.used] - self.count
        self.text = data.tobytes()
        self.kinds, self.names = self._kinds()
        self._rows: dict[bytes, Array] = {}

    def _kinds(self) -> tuple[Array, dict[bytes, int]]:
        """Keyword number of every used line, and the numbers by keyword."""
        a, b = self.words[self.first], self.word_ends[self.first]
        # Keywords of one and two letters, nearly all, are encoded directly as numbers.
        code = self.data[a].astype(np.int64) * 256 + np.where(b - a == 2, self.data[b - 1], 0)
        names: dict[bytes, int] = {}
        for i in np.flatnonzero(b - a > 2).tolist():
            code[i] = names.setdefault(self.text[a[i] : b[i]], 65536 + len(names))
        for value in np.unique(code[code < 65536]).tolist():
            names[bytes([value >> 8]) + (bytes([value & 255]) if value & 255 else b"")] = value
        return code, names

    def where(self, row: int) -> str:
        """file:line of a used line (of the first part of a continued line)."""
        line = int(np.searchsorted(self.breaks, self.words[self.first[row]])) + 1
        return f"{self.path.name}:{line}"

    def error(self, row: int, message: str, hint: str | None = None) -> SceneError:
        return SceneError(message, where=self.where(row), hint=hint)

    def repair(self, kind: str, rows: Array, message: str, hint: str | None = None, detail: str = "") -> None:
        """Count the used lines ``rows`` as departures; strict: raise the error of the first."""
        row = int(rows[0])
        self.notes.repair(kind, self.error(row, message, hint), count=len(rows), detail=detail)

    def rest(self, row: int) -> str:
        """The text after the keyword of a used line."""
        line = self.used[row]
        text = self.text[self.word_ends[self.first[row]] : self.ends[line]]
        return text.decode("utf-8", errors="replace").strip()

    def rows(self, kind: bytes) -> Array:
        """Used lines of one kind, in order."""
        if kind not in self._rows:
            self._rows[kind] = np.flatnonzero(self.kinds == self.names.get(kind, -1))
        return self._rows[kind]

    def numbers(self, kind: bytes, width: int) -> Array:
        """The first ``width`` numbers of every line of a kind, missing ones 0.  (rows, width) float64."""
        rows = self.rows(kind)
        counts = self.count[rows] - 1
        bad = ~np.isin(counts, COUNTS[kind])
        if np.any(bad):
            message = f"{kind.decode()} with {counts[np.argmax(bad)]} numbers"
            if np.any(counts[bad] < COUNTS[kind][0]):
                raise self.error(rows[np.argmax(bad)], message)
            self.repair("statement-numbers", rows[bad], message, detail=kind.decode())
        out = np.zeros((len(rows), width))
        for count in np.unique(counts).tolist():
            lines = rows[counts == count]
            try:
                values = np.array(list(map(float, self._joined(lines).split())))
            except ValueError:
                fault = self._not_a_number(lines, float)
                if kind == b"v" or self.notes.strict:
                    raise fault from None
                values = np.array([number_of(word) for word in self._joined(lines).split()])
            values = values.reshape(-1, count)[:, :width]
            ok = np.abs(values) < LARGEST
            if not np.all(ok):
                wrong = lines[~np.all(ok, axis=1)]
                message = "contains a number that is not finite or too large"
                if kind == b"v":
                    raise self.error(wrong[0], message)
                self.repair("statement-nonfinite", wrong, message, detail=kind.decode())
                values = np.where(ok, values, 0.0)
            out[counts == count, : values.shape[1]] = values
        return out

    def _joined(self, rows: Array) -> bytes:
        """The text of these used lines without their keywords."""
        begin, end = self.word_ends[self.first[rows]], self.ends[self.used[rows]]
        text = self.text
        # Consecutive lines of one kind are extracted as one block.
        if len(rows) > 1 and rows[-1] - rows[0] == len(rows) - 1:
            blanked = self.data[begin[0] : end[-1]].copy()
            at = self.words[self.first[rows[1:]]] - begin[0]
            for k in range(int((begin - self.words[self.first[rows]]).max())):
                blanked[at + k] = SPACE
            return blanked.tobytes()
        return b"\n".join([text[i:j] for i, j in zip(begin.tolist(), end.tolist())])

    def _not_a_number(self, rows: Array, convert: type) -> SceneError:
        for row in rows.tolist():
            for word in self.rest(row).replace("/", " ").split():
                try:
                    convert(word)
                except ValueError:
                    return self.error(row, f"{word[:40]!r} instead of a number")
        return self.error(int(rows[0]), "contains a word that is not a number")

    def file(self, raw: bytes, watch: Callable[[float], None]) -> ObjFile:
        self._check_kinds()
        done, arrays = 0, []
        for kind, width in ((b"v", 3), (b"vt", 2), (b"vn", 3)):
            watch(LINES_SHARE + (1.0 - LINES_SHARE) * done / max(len(self.data), 1))
            arrays.append(self.numbers(kind, width))
            lines = self.used[self.rows(kind)]
            done += int((self.ends[lines] - self.starts[lines]).sum())
        watch(LINES_SHARE + (1.0 - LINES_SHARE) * done / max(len(self.data), 1))
        v, vt, vn = arrays
        undrawn = {name: n for kind, name in ((b"l", "lines"), (b"p", "points")) if (n := len(self.rows(kind)))}
        libraries = []
        for row in self.rows(b"mtllib").tolist():
            names = self.rest(row)
            if not names:
                self.repair("library-name", np.array([row]), "mtllib without a file name")
                continue
            libraries.append((names, self.where(row)))
        parts = self._parts(v, len(vt), len(vn))
        return ObjFile(self.path, raw, v, self._colors(), vt, vn, parts, libraries, undrawn)

    def _colors(self) -> Array | None:
        """Colors behind positions as linear RGB (V, 3), white for a vertex without; None where no vertex has one."""
        rows = self.rows(b"v")
        colored = np.isin(self.count[rows] - 1, COLORED)
        if not np.any(colored):
            return None
        colors = np.where(colored[:, None], self.numbers(b"v", 6)[:, 3:], 1.0)
        outside = np.any((colors < 0.0) | (colors > 1.0), axis=1)
        if np.any(outside):
            self.repair("color-range", rows[outside], "a vertex color is outside 0..1")
        return srgb_decode(np.clip(colors, 0.0, 1.0))

    def _check_kinds(self) -> None:
        keywords = {b"v", b"vt", b"vn", b"f", b"l", b"p", b"mtllib", *STATES, *IGNORED}
        unknown = [(int(self.rows(kind)[0]), kind) for kind in self.names.keys() - keywords]
        if not unknown:
            return
        for row, kind in sorted(unknown):
            name = kind.decode("utf-8", errors="replace")[:20]
            if kind in CURVES:
                message = f"{name!r}: curves and surfaces are not supported"
                self.repair("curve", self.rows(kind), message, "export triangles", name)
                continue
            message, hint = f"{name!r} is not an OBJ statement", "check the file format"
            if not len(self.rows(b"v")):
                raise self.error(row, message, hint)
            self.repair("unknown-statement", self.rows(kind), message, hint, name)

    # --------------------------------------------------------------------------------------------------------- faces
    def _parts(self, v: Array, nt: int, nn: int) -> list[Part]:
        rows = self.rows(b"f")
        if not len(rows):
            return []
        sizes = self.count[rows] - 1
        if np.any(sizes < 3):
            self.repair("face-corners", rows[sizes < 3], f"a face with {sizes[np.argmax(sizes < 3)]} corners")
            rows, sizes = rows[sizes >= 3], sizes[sizes >= 3]
        corners = self._corners(rows, sizes)
        drawn = self._resolve(rows, sizes, corners, (len(v), nt, nn))
        if not np.all(drawn):
            corners = corners[np.repeat(drawn, sizes)]
            rows, sizes = rows[drawn], sizes[drawn]
        if not len(rows):
            return []
        fans, drawn, crossing = cut_polygons(v[corners[:, 0]], sizes)
        if len(crossing):
            self.notes.remark("polygon-crossing", self.where(rows[crossing[0]]), count=len(crossing))
        objects, materials = self._states(rows)
        label = objects[0] * len(materials[1]) + materials[0]
        owner = np.repeat(np.arange(len(rows)), sizes)
        fan_label, drawn_label = label[owner[fans[:, 0]]], label[owner[drawn[:, 0]]]
        parts = []
        for value in np.unique(label).tolist():
            part_fans = corners[fans[fan_label == value]]
            part_drawn = part_fans if drawn is fans else corners[drawn[drawn_label == value]]
            object_, material = divmod(value, len(materials[1]))
            parts.append(Part(objects[1][object_], materials[1][material], part_drawn, part_fans))
        return parts

    def _corners(self, rows: Array, sizes: Array) -> Array:
        """(corners, 3) int64 as in the file: 0 for a missing index."""
        word = np.repeat(self.first[rows] + 1, sizes) + _counting(sizes)
        self._without_last_slashes(np.repeat(rows, sizes), word)
        slashes = np.flatnonzero(self.data == SLASH)
        low, high = np.searchsorted(slashes, self.words[word]), np.searchsorted(slashes, self.word_ends[word])
        count = high - low
        twice = np.zeros(len(word), dtype=bool)
        two = np.flatnonzero(count == 2)
        twice[two] = slashes[low[two] + 1] == slashes[low[two]] + 1
        text = self._joined(rows).replace(b"//", b" 0 ").replace(b"/", b" ")
        try:
            values = np.array(list(map(int, text.split())), dtype=np.int64)
        except (ValueError, OverflowError):
            raise self._not_a_number(rows, int) from None
        if np.any(count > 2) or len(values) != int((count + 1).sum()):
            raise self._bad_corner(rows)
        out = np.zeros((len(word), 3), dtype=np.int64)
        at = np.cumsum(count + 1) - (count + 1)
        out[:, 0] = values[at]
        has_t = (count >= 1) & ~twice
        out[has_t, 1] = values[at[has_t] + 1]
        out[two, 2] = values[at[two] + 2]
        return out

    def _without_last_slashes(self, owner: Array, word: Array) -> None:
        """Blank the slashes that end corners, ``1//`` and ``1/1/``.  ``owner``: used line of each corner."""
        trailing = self.data[self.word_ends[word] - 1] == SLASH
        if not np.any(trailing):
            return
        first = word[np.argmax(trailing)]
        text = self.text[self.words[first] : self.word_ends[first]].decode("utf-8", errors="replace")
        self.repair(
            "corner-slash", owner[trailing], f"corner {text[:40]!r} ends in a slash", "v, v/vt, v//vn or v/vt/vn"
        )
        while np.any(trailing):
            self.word_ends[word[trailing]] -= 1
            self.data[self.word_ends[word[trailing]]] = SPACE
            trailing = self.data[self.word_ends[word] - 1] == SLASH
        self.text = self.data.tobytes()

    def _bad_corner(self, rows: Array) -> SceneError:
        for row in rows.tolist():
            for word in self.rest(row).split():
                numbers = word.split("/")
                if len(numbers) > 3 or not numbers[0] or not numbers[-1]:
                    return self.error(row, f"{word[:40]!r} is not a corner", "v, v/vt, v//vn or v/vt/vn")
        return self.error(int(rows[0]), "contains an invalid corner")

    def _resolve(self, rows: Array, sizes: Array, corners: Array, totals: tuple[int, int, int]) -> Array:
        """Convert to indices from 0, in place; negative indices are relative to the line of the face.

        Returns which faces have only positions that exist, (faces,) bool.
        """
        drawn = np.ones(len(rows), dtype=bool)
        for column, (kind, total) in enumerate(zip((b"v", b"vt", b"vn"), totals)):
            values = corners[:, column]
            so_far = np.repeat(np.searchsorted(self.rows(kind), rows), sizes)
            resolved = np.where(values > 0, values - 1, np.where(values < 0, so_far + values, MISSING))
            bad = (resolved >= total) | ((values < 0) & (resolved < 0)) | ((values == 0) & (column == 0))
            if np.any(bad):
                at = int(np.argmax(bad))
                owner = np.repeat(np.arange(len(rows)), sizes)
                faces = np.unique(owner[bad])
                message = f"index {values[at]}; the file has {total} {kind.decode()}"
                self.repair("face-index", rows[faces], message, detail=kind.decode())
                resolved = np.where(bad, MISSING, resolved)
                if column == 0:
                    drawn[faces] = False
            corners[:, column] = resolved
        return drawn

    def _states(self, rows: Array) -> tuple[tuple[Array, list[str]], tuple[Array, list[str]]]:
        """Object and material number of every face line, and their names."""
        kind = b"o" if len(self.rows(b"o")) else b"g"
        return self._state(rows, kind), self._state(rows, b"usemtl")

    def _state(self, rows: Array, kind: bytes) -> tuple[Array, list[str]]:
        at = self.rows(kind)
        numbers: dict[str, int] = {"": 0}
        values = np.array([0, *(numbers.setdefault(self.rest(r), len(numbers)) for r in at.tolist())], dtype=np.int64)
        return values[np.searchsorted(at, rows)], list(numbers)


def _counting(sizes: Array) -> Array:
    """0 .. n-1 for each n of ``sizes``, concatenated."""
    return np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
