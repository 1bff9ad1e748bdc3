"""Counter-based random numbers: twin of shaders/common/random.glsl, equal bit for bit."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def pcg4d(v: Array) -> Array:
    """Hash of four words (Jarzynski and Olano 2020, listing 1).  (..., 4) uint32 -> (..., 4) uint32."""
    x, y, z, w = (np.asarray(v[..., k], dtype=np.uint32) for k in range(4))
    with np.errstate(over="ignore"):
        x, y, z, w = (c * np.uint32(1664525) + np.uint32(1013904223) for c in (x, y, z, w))
        for turn in range(2):
            x = x + y * w
            y = y + z * x
            z = z + x * y
            w = w + y * z
            if turn == 0:
                x, y, z, w = (c ^ (c >> np.uint32(16)) for c in (x, y, z, w))
    return np.stack([x, y, z, w], axis=-1)


def random4(size: tuple[int, int], frame: int, seed: int, draw: int) -> Array:
    """Four numbers in [0, 1) of every pixel, multiples of 2^-24.  -> (h, w, 4) float64, row 0 at the top.

    ``seed`` and ``draw`` are 16-bit numbers; the same (pixel, frame, seed, draw) always gives the same numbers.
    """
    w, h = size
    x, y = np.meshgrid(np.arange(w, dtype=np.uint32), np.arange(h - 1, -1, -1, dtype=np.uint32))
    key = np.broadcast_to(np.uint32(seed << 16 | draw), x.shape)
    counter = np.stack([x, y, np.broadcast_to(np.uint32(frame), x.shape), key], axis=-1)
    return (pcg4d(counter) >> np.uint32(8)).astype(np.float64) / (1 << 24)
