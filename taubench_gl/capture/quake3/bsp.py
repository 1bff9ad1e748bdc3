"""Maps of the Quake 3 family (IBSP version 46): entities, models, and the triangles that are drawn.

Layout of the file: ioquake3 (``code/qcommon/qfiles.h``).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

import numpy as np

from taubench_gl.errors import SceneError
from taubench_gl.math3d import normalize
from taubench_gl.memory_budget import require

Array = np.ndarray

VERTEX = np.dtype([("place", "<f4", 3), ("uv", "<f4", 2), ("baked", "<f4", 2), ("normal", "<f4", 3), ("rgba", "u1", 4)])
SURFACE = np.dtype(
    [("shader", "<i4"), ("fog", "<i4"), ("kind", "<i4"), ("vertex", "<i4"), ("vertices", "<i4"), ("index", "<i4"),
     ("indices", "<i4"), ("baked", "<i4", 5), ("vectors", "<f4", 12), ("width", "<i4"), ("height", "<i4")]
)  # fmt: skip
SHADER = np.dtype([("name", "S64"), ("flags", "<i4"), ("contents", "<i4")])
MODEL = np.dtype(
    [("low", "<f4", 3), ("high", "<f4", 3), ("surface", "<i4"), ("surfaces", "<i4"), ("brushes", "<i4", 2)]
)
HEADER = np.dtype([("magic", "S4"), ("version", "<i4"), ("lumps", [("at", "<i4"), ("size", "<i4")], 17)])
PLANAR, PATCH, TRIANGLES, FLARE = 1, 2, 3, 4
STEPS = 4
"""Edges into which each side of a curved piece is divided."""
MAX_PATCH = 129
"""Most control points along a side of a patch."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of one shader of one model.  Units and axes of the map; ``triangles`` (t, 3), clockwise as in it."""

    places: Array  # (n, 3)
    normals: Array  # (n, 3) unit, up where the map has none
    uvs: Array  # (n, 2)
    triangles: Array


class Bsp:
    """A map.  Raises SceneError for a damaged file; ``where``: names it."""

    def __init__(self, data: bytes, where: str):
        self._where = where
        self._check(len(data) >= HEADER.itemsize, "is no map of Quake 3: it is too short")
        header = np.frombuffer(data, HEADER, 1)[0]
        known = header["magic"] == b"IBSP" and header["version"] == 46
        self._check(known, "is no map of Quake 3 (IBSP, version 46)")
        lumps = header["lumps"].tolist()
        for at, size in lumps:
            inside = at >= 0 and size >= 0 and at + size <= len(data)
            self._check(inside, f"a part at byte {at} of {size} bytes lies outside the file")

        def lump(number: int, kind: np.dtype) -> Array:
            return np.frombuffer(data, kind, lumps[number][1] // kind.itemsize, lumps[number][0])

        self.vertices, self._indices, self.surfaces = lump(10, VERTEX), lump(11, np.dtype("<i4")), lump(13, SURFACE)
        self.models = lump(7, MODEL)
        # Names hold arbitrary bytes after their end.
        self.shaders = [s.split(b"\0")[0].decode("latin-1").lower() for s in lump(1, SHADER)["name"].tolist()]
        text = data[lumps[0][0] : sum(lumps[0])].split(b"\0")[0].decode("latin-1")
        self.entities = [dict(re.findall(r'"([^"]*)"\s+"([^"]*)"', e)) for e in re.findall(r"\{([^{}]*)\}", text)]
        self._check_values()

    def _check(self, good: bool | np.bool_, what: str) -> None:
        if not good:
            raise SceneError(what, where=self._where, hint="the map is damaged, or of another game")

    def _check_values(self) -> None:
        s, m, v = self.surfaces, self.models, self.vertices
        ranges = [(s, "vertex", "vertices", len(v)), (s, "index", "indices", len(self._indices)),
                  (s, "shader", None, len(self.shaders)), (m, "surface", "surfaces", len(s))]  # fmt: skip
        for rows, first, count, most in ranges:
            number = rows[count].astype(np.int64) if count else 1
            inside = (rows[first] >= 0) & (number >= 0) & (rows[first] + number <= most)
            self._check(inside.all(), f"a {count or first} of a surface or model lies outside the map")
        self._check(len(m) > 0, "holds no model")
        w, h, curved = s["width"], s["height"], s["kind"] == PATCH
        fits = (w > 2) & (h > 2) & (w % 2 == 1) & (h % 2 == 1) & (w <= MAX_PATCH) & (h <= MAX_PATCH)
        fits &= w.astype(np.int64) * h == s["vertices"]
        self._check(fits[curved].all(), "a curved surface has an invalid number of control points")
        finite = all(np.isfinite(v[name]).all() for name in ("place", "uv", "normal"))
        self._check(finite, "vertices have values that are no numbers")
        flat = np.isin(s["kind"], (PLANAR, TRIANGLES))
        size = int(s["indices"][flat].astype(np.int64).sum()) * 8
        size += int((s["vertices"][curved].astype(np.int64) * STEPS**2).sum()) * (VERTEX.itemsize + 48)
        require(size * max(len(m), 1) if size > 1 << 24 else size, "its surfaces", SceneError, self._where)

    def meshes(self, model: int) -> dict[int, Mesh]:
        """Shader number -> what is drawn of a model; 0 is the world.  Raises SceneError for an invalid index."""
        m = self.models[model]
        surfaces = self.surfaces[m["surface"] : m["surface"] + m["surfaces"]]
        out = {}
        for shader in np.unique(surfaces["shader"]).tolist():
            shaded = surfaces[surfaces["shader"] == shader]
            flat, curved = shaded[np.isin(shaded["kind"], (PLANAR, TRIANGLES))], shaded[shaded["kind"] == PATCH]
            parts = [(self.vertices, self._corners(flat)), *(_patch(self.vertices, surface) for surface in curved)]
            vertices, triangles = _joined(parts)
            if len(triangles):
                normals = normalize(vertices["normal"])
                normals[~normals.any(1)] = [0, 0, 1]
                out[shader] = Mesh(vertices["place"].astype(float), normals, vertices["uv"], triangles)
        return out

    def _corners(self, surfaces: Array) -> Array:
        """(t, 3) numbers of vertices in the map."""
        count = surfaces["indices"] // 3 * 3
        starts = np.repeat(surfaces["index"] - np.cumsum(count) + count, count)
        local = self._indices[starts + np.arange(len(starts))]
        inside = (local >= 0) & (local < np.repeat(surfaces["vertices"], count))
        self._check(inside.all(), "a triangle has a corner outside its surface")
        return (local + np.repeat(surfaces["vertex"], count)).reshape(-1, 3)


def _joined(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Vertices that are used, and (t, 3) of them, without triangles of no area."""
    vertices, triangles, first = [], [], 0
    for points, corners in parts:
        a, b, c = (points["place"][corners[:, k]].astype(float) for k in range(3))
        corners = corners[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-6]
        used, corners = np.unique(corners, return_inverse=True)
        vertices.append(points[used])
        triangles.append(corners.reshape(-1, 3) + first)
        first += len(used)
    return np.concatenate(vertices), np.concatenate(triangles)


def _patch(vertices: Array, surface: np.void) -> tuple[Array, Array]:
    """Vertices and (t, 3) corners of a curved surface."""
    width, height = int(surface["width"]), int(surface["height"])
    across, along = _curve(width), _curve(height)
    points = vertices[surface["vertex"] : surface["vertex"] + width * height].reshape(height, width)
    fine = np.zeros((len(along), len(across)), VERTEX)
    for name in ("place", "uv", "normal"):
        fine[name] = np.einsum("ij,jkc,lk->ilc", along, points[name].astype(float), across, optimize=True)
    a = np.arange(fine.size).reshape(fine.shape)[:-1, :-1].ravel()
    below = a + len(across)
    return fine.ravel(), np.stack([a, below, a + 1, a + 1, below, below + 1], 1).reshape(-1, 3)


@cache
def _curve(points: int) -> Array:
    """(m, points) weights of quadratic Bezier pieces that share their end points, at STEPS steps each."""
    t = np.linspace(0, 1, STEPS + 1)
    piece = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], 1)
    out = np.zeros(((points - 1) // 2 * STEPS + 1, points))
    for k in range((points - 1) // 2):
        out[k * STEPS : (k + 1) * STEPS + 1, 2 * k : 2 * k + 3] = piece
    return out
