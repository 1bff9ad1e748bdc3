"""Simple triangle meshes as dicts of glTF attributes: POSITION, NORMAL, TEXCOORD_0 and indices (T, 3)."""

from __future__ import annotations

import math

import numpy as np

Shape = dict[str, np.ndarray]


def quad(origin, u, v, uv_scale: float = 1.0) -> Shape:
    """A parallelogram with corners origin, +u, +v, facing u x v; texture coordinates in meters * uv_scale."""
    origin, u, v = (np.array(x, dtype=float) for x in (origin, u, v))
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    lu, lv = np.linalg.norm(u) * uv_scale, np.linalg.norm(v) * uv_scale
    return {
        "POSITION": np.array([origin, origin + u, origin + u + v, origin + v]),
        "NORMAL": np.tile(normal, (4, 1)),
        "TEXCOORD_0": np.array([[0, lv], [lu, lv], [lu, 0], [0, 0]]),
        "indices": np.array([[0, 1, 2], [0, 2, 3]]),
    }


def box(low, high, uv_scale: float = 1.0, inside: bool = False, faces: str = "xXyYzZ") -> Shape:
    """An axis-aligned box.  ``faces``: the faces to build (lower case: the low side); ``inside``: they face inwards."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    size = high - low
    parts = []
    for face in faces:
        axis = "xyz".index(face.lower())
        # v is the vertical edge, so that textures on walls are upright.
        a, b = {0: (2, 1), 1: (2, 0), 2: (0, 1)}[axis]
        u, v = np.zeros(3), np.zeros(3)
        u[a], v[b] = size[a], size[b]
        origin = low.copy()
        if face.isupper():
            origin[axis] = high[axis]
        outward = 1.0 if face.isupper() else -1.0
        if (np.cross(u, v)[axis] * outward > 0) == inside:
            origin, u = origin + u, -u
        parts.append(quad(origin, u, v, uv_scale))
    return join(parts)


def join(parts: list[Shape]) -> Shape:
    """Several shapes as one."""
    first = np.cumsum([0, *(len(p["POSITION"]) for p in parts[:-1])])
    out = {name: np.concatenate([p[name] for p in parts]) for name in parts[0] if name != "indices"}
    out["indices"] = np.concatenate([p["indices"] + base for p, base in zip(parts, first)])
    return out


def moved(shape: Shape, by) -> Shape:
    return shape | {"POSITION": shape["POSITION"] + np.array(by, dtype=float)}


def grid_indices(rows: int, columns: int) -> np.ndarray:
    """Triangles of a (rows + 1) x (columns + 1) grid of vertices, row by row."""
    r, c = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    a = (r * (columns + 1) + c).reshape(-1)
    b, d, e = a + 1, a + columns + 1, a + columns + 2
    return np.stack([np.stack([a, d, b], axis=-1), np.stack([b, d, e], axis=-1)], axis=1).reshape(-1, 3)


def sphere(radius: float, rows: int = 14, columns: int = 24) -> Shape:
    polar, turn = np.meshgrid(
        np.linspace(0, math.pi, rows + 1), np.linspace(0, 2 * math.pi, columns + 1), indexing="ij"
    )
    normal = np.stack([np.sin(polar) * np.cos(turn), np.cos(polar), -np.sin(polar) * np.sin(turn)], axis=-1)
    normal = normal.reshape(-1, 3)
    return {
        "POSITION": normal * radius,
        "NORMAL": normal,
        "TEXCOORD_0": np.stack([turn / (2 * math.pi), polar / math.pi], axis=-1).reshape(-1, 2),
        "indices": grid_indices(rows, columns),
    }


def tube(radii: np.ndarray, heights: np.ndarray, columns: int = 16) -> Shape:
    """A surface of revolution about +Y, bottom to top; ends are open."""
    rows = len(heights) - 1
    turn = np.linspace(0, 2 * math.pi, columns + 1)
    slope = np.gradient(radii, heights)
    ring = np.stack([np.cos(turn), np.zeros_like(turn), -np.sin(turn)], axis=-1)
    normal = ring[None] - np.array([0, 1.0, 0]) * slope[:, None, None]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    position = ring[None] * radii[:, None, None] + np.array([0, 1.0, 0]) * heights[:, None, None]
    uv = np.stack(np.broadcast_arrays(turn[None] / (2 * math.pi) * 4, -heights[:, None]), axis=-1)
    return {
        "POSITION": position.reshape(-1, 3),
        "NORMAL": normal.reshape(-1, 3),
        "TEXCOORD_0": uv.reshape(-1, 2),
        "indices": grid_indices(rows, columns)[:, ::-1],
    }
