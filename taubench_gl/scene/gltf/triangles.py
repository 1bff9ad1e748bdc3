"""Triangle strips and fans as triangle lists."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

POINTS, LINES, LINE_LOOP, LINE_STRIP, TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = range(7)


def triangle_list(mode: int, indices: Array) -> Array:
    """Corners of every triangle, wound as glTF says.  (n,) -> (T, 3) uint32.

    A list keeps its degenerate triangles (the file's count stays the file's); those of strips and fans, which only
    stitch pieces together, are dropped.  Indices left over at the end make no triangle.
    """
    indices = indices.astype(np.uint32, copy=False)
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    count = max(len(indices) - 2, 0)
    i = np.arange(count)
    if mode == TRIANGLE_STRIP:
        corners = np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)
    elif mode == TRIANGLE_FAN:
        corners = np.stack([i + 1, i + 2, np.zeros_like(i)], axis=1)
    else:
        raise ValueError(f"mode {mode} has no triangles")
    triangles = indices[corners].reshape(-1, 3)
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def line_count(mode: int, count: int) -> int:
    """Segments that ``count`` indices make in a line mode."""
    return {LINES: count // 2, LINE_LOOP: count if count > 1 else 0, LINE_STRIP: max(count - 1, 0)}[mode]
