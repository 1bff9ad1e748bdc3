"""Maps of the Quake 3 family (IBSP version 46): entities, models, and the triangles that are drawn.

Layout of the file: ioquake3 (``code/qcommon/qfiles.h``).
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

import numpy as np

from taubench_gl.errors import SceneError
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
LUMPS = {"shaders": (1, SHADER), "models": (7, MODEL), "vertices": (10, VERTEX), "indices": (11, np.dtype("<i4")),
         "surfaces": (13, SURFACE)}  # fmt: skip
PLANAR, PATCH, TRIANGLES, FLARE = 1, 2, 3, 4
STEPS = 4
"""Edges into which each side of a curved piece is divided."""
MAX_PATCH = 129
"""Most control points along a side of a patch."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of one shader of one model.  Units and axes of the map; ``triangles`` (t, 3), clockwise as in it."""

    places: Array  # (n, 3)
    normals: Array  # (n, 3)
    uvs: Array  # (n, 2)
    triangles: Array


class Bsp:
    """A map.  Raises SceneError for a damaged file; ``where``: names it."""

    def __init__(self, data: bytes, where: str):
        self._where = where
        if len(data) < 144 or data[:4] != b"IBSP" or struct.unpack_from("<i", data, 4)[0] != 46:
            raise self._bad("is no map of Quake 3 (IBSP, version 46)")
        lumps = [struct.unpack_from("<ii", data, 8 + 8 * i) for i in range(17)]
        for at, size in lumps:
            if at < 0 or size < 0 or at + size > len(data):
                raise self._bad(f"a part at byte {at} of {size} bytes lies outside the file")
        arrays = {}
        for name, (lump, kind) in LUMPS.items():
            at, size = lumps[lump]
            arrays[name] = np.frombuffer(data, kind, size // kind.itemsize, at)
        self.vertices, self._indices, self.surfaces = arrays["vertices"], arrays["indices"], arrays["surfaces"]
        self.models = arrays["models"]
        # Names hold arbitrary bytes after their end.
        self.shaders = [s.split(b"\0")[0].decode("latin-1").lower() for s in arrays["shaders"]["name"].tolist()]
        text = data[lumps[0][0] : sum(lumps[0])].split(b"\0")[0].decode("latin-1")
        self.entities = [dict(re.findall(r'"([^"]*)"\s+"([^"]*)"', e)) for e in re.findall(r"\{([^{}]*)\}", text)]
        self._check()

    def _bad(self, what: str) -> SceneError:
        return SceneError(what, where=self._where, hint="the map is damaged, or of another game")

    def _check(self) -> None:
        s = self.surfaces
        counts = [("vertex", "vertices", len(self.vertices)), ("index", "indices", len(self._indices))]
        for first, count, most in counts:
            end = s[first].astype(np.int64) + s[count]
            if ((s[first] < 0) | (s[count] < 0) | (end > most)).any():
                raise self._bad(f"a surface has {count} outside the map")
        if ((s["shader"] < 0) | (s["shader"] >= len(self.shaders))).any():
            raise self._bad("a surface has an unknown shader")
        w, h, curved = s["width"], s["height"], s["kind"] == PATCH
        fits = (w > 2) & (h > 2) & (w % 2 == 1) & (h % 2 == 1) & (w <= MAX_PATCH) & (h <= MAX_PATCH)
        if not (fits & (w.astype(np.int64) * h == s["vertices"]))[curved].all():
            raise self._bad("a curved surface has an invalid number of control points")
        m = self.models
        end = m["surface"].astype(np.int64) + m["surfaces"]
        if not len(m) or ((m["surface"] < 0) | (m["surfaces"] < 0) | (end > len(s))).any():
            raise self._bad("a model has surfaces outside the map")
        if not all(np.isfinite(self.vertices[name]).all() for name in ("place", "uv", "normal")):
            raise self._bad("vertices have values that are no numbers")
        flat = np.isin(s["kind"], (PLANAR, TRIANGLES))
        size = int(s["indices"][flat].astype(np.int64).sum()) * 8
        size += int((s["vertices"][curved].astype(np.int64) * STEPS**2).sum()) * (VERTEX.itemsize + 48)
        require(size * max(len(m), 1) if size > 1 << 24 else size, "its surfaces", SceneError, self._where)

    def meshes(self, model: int) -> dict[int, Mesh]:
        """Shader number -> what is drawn of a model; 0 is the world.  Raises SceneError for an invalid index."""
        m = self.models[model]
        surfaces = self.surfaces[m["surface"] : m["surface"] + m["surfaces"]]
        patches = _patches(self.vertices, surfaces[surfaces["kind"] == PATCH])
        out = {}
        for shader in np.unique(surfaces["shader"]).tolist():
            flat = surfaces[(surfaces["shader"] == shader) & np.isin(surfaces["kind"], (PLANAR, TRIANGLES))]
            parts = [(self.vertices, self._corners(flat)), *patches.get(shader, ())]
            vertices, triangles = _joined(parts)
            if len(triangles):
                out[shader] = Mesh(*_cleaned(vertices), triangles)
        return out

    def _corners(self, surfaces: Array) -> Array:
        """(t, 3) numbers of vertices in the map."""
        count = surfaces["indices"] // 3 * 3
        starts = np.repeat(surfaces["index"] - np.cumsum(count) + count, count)
        local = self._indices[starts + np.arange(len(starts))]
        if ((local < 0) | (local >= np.repeat(surfaces["vertices"], count))).any():
            raise self._bad("a triangle has a corner outside its surface")
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


def _cleaned(vertices: Array) -> tuple[Array, Array, Array]:
    """Places, unit normals (up where there is none) and texture coordinates."""
    normals = vertices["normal"].astype(float)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-6, normals / np.where(length > 0, length, 1), [0.0, 0.0, 1.0])
    return vertices["place"].astype(float), normals, vertices["uv"]


def _patches(vertices: Array, surfaces: Array) -> dict[int, list[tuple[Array, Array]]]:
    """Shader number -> (vertices, corners) of its curved surfaces; those of one size are divided together."""
    out: dict[int, list[tuple[Array, Array]]] = {}
    sizes = surfaces["width"].astype(np.int64) << 16 | surfaces["height"]
    for size in np.unique(sizes).tolist():
        group = surfaces[sizes == size]
        width, height = size >> 16, size & 0xFFFF
        across, along = _curve(width), _curve(height)
        points = vertices[group["vertex"][:, None] + np.arange(width * height)].reshape(-1, height, width)
        fine = np.zeros((len(group), len(along), len(across)), VERTEX)
        for name in ("place", "uv", "normal"):
            fine[name] = np.einsum("ij,njkc,lk->nilc", along, points[name].astype(float), across, optimize=True)
        rows, columns = fine.shape[1:]
        a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        corners = np.stack([a, a + columns, a + 1, a + 1, a + columns, a + columns + 1], 1).reshape(-1, 3)
        for shader in np.unique(group["shader"]).tolist():
            own = fine[group["shader"] == shader]
            each = np.arange(len(own))[:, None, None] * (rows * columns)
            out.setdefault(shader, []).append((own.ravel(), (each + corners).reshape(-1, 3)))
    return out


def _curve(points: int) -> Array:
    """(m, points) weights of quadratic Bezier pieces that share their end points, at STEPS steps each."""
    t = np.linspace(0, 1, STEPS + 1)
    piece = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], 1)
    out = np.zeros(((points - 1) // 2 * STEPS + 1, points))
    for k in range((points - 1) // 2):
        out[k * STEPS : (k + 1) * STEPS + 1, 2 * k : 2 * k + 3] = piece
    return out
