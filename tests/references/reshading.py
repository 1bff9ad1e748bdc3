"""Choice and motion of re-shaded samples in float64: reference of ``reuse/reshade_select`` and ``reshade_surface``."""

from __future__ import annotations

import numpy as np

from references.stochastic import pcg4d
from taubench_gl.reuse.reshade import BLOCK

Array = np.ndarray


def chosen_pixels(usable: Array, frame: int, seed: int) -> Array:
    """(h, w) bool: the pixel of every 3x3 block whose sample is chosen.  Blocks count from the bottom left.

    ``usable`` (h, w) bool, row 0 at the top: pixels with a surface whose history no geometry mask discards and whose
    nearest pixel of the previous frame is inside the image and shows a surface.
    """
    up = usable[::-1]
    height, width = up.shape
    out = np.zeros_like(up)
    for y in range(-(-height // BLOCK)):
        for x in range(-(-width // BLOCK)):
            numbers = np.array([x, y, frame, seed], dtype=np.uint32)
            first = int(np.ravel(pcg4d(numbers))[0]) % 9
            for k in range(9):
                i = (first + k) % 9
                column, row = BLOCK * x + i % BLOCK, BLOCK * y + i // BLOCK
                if column < width and row < height and up[row, column]:
                    out[row, column] = True
                    break
    return out[::-1]


def moved_positions(history: Array, position: Array, prev_position: Array, camera_delta: Array) -> Array:
    """Samples of the previous frame in this frame, (..., 3) float64 relative to the current camera.

    ``history``: the sample, relative to the previous camera; ``position``, ``prev_position``: the surface point of the
    current pixel now (relative to the current camera) and before (relative to the previous one); ``camera_delta``:
    current minus previous camera position.
    """
    sample, now, before = (np.asarray(a, dtype=np.float64)[..., :3] for a in (history, position, prev_position))
    return sample - camera_delta + (now - (before - camera_delta))
