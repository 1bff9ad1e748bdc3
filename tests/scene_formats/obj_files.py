"""OBJ text for tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def write(folder: Path, text: str | bytes, name: str = "scene.obj") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def grid(place: Callable[[np.ndarray, np.ndarray], np.ndarray], side: int = 5, *, smooth: bool = True) -> str:
    """A sheet of side x side vertices over [-1, 1]^2 at ``place(x, y)`` (n, 3), with normals where smooth."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side)))
    lines = ["o sheet"] + ["v {:.9g} {:.9g} {:.9g}".format(*p) for p in place(x, y)]
    h = 1e-5
    normals = np.cross(place(x + h, y) - place(x - h, y), place(x, y + h) - place(x, y - h))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lines += ["vn {:.9g} {:.9g} {:.9g}".format(*n) for n in normals] if smooth else []
    for row in range(side - 1):
        for column in range(side - 1):
            a = row * side + column + 1
            corners = (a, a + 1, a + side + 1, a + side)
            lines.append("f " + " ".join(f"{c}//{c}" if smooth else str(c) for c in corners))
    return "\n".join(lines) + "\n"
