"""A view as the matrices that people who read the files need.  Float64; matrices act on column vectors."""

from __future__ import annotations

import numpy as np

from taubench_gl import math3d
from taubench_gl.animation import View

Array = np.ndarray
CV_FROM_VIEW = np.diag([1.0, -1.0, -1.0])
"""glTF's view axes (+Y up, looks along -Z) -> computer vision's (+Y down, looks along +Z)."""


def intrinsics(view: View, width: int, height: int) -> Array:
    """K (3, 3): pixel-index coordinates (centre of the top left pixel is (0, 0), +y down) from computer vision axes.

    Perspective: pixel = K @ (X / Z, Y / Z, 1).  Orthographic: pixel = K @ (X, Y, 1).  Jitter is not in it.
    """
    clip = view.centered().clip_from_view(width, height)
    focal_x, focal_y = 0.5 * width * clip[0, 0], 0.5 * height * clip[1, 1]
    return np.array([[focal_x, 0.0, 0.5 * (width - 1)], [0.0, focal_y, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])


def extrinsics(view: View) -> Array:
    """(3, 4): computer vision camera axes <- world."""
    rotation = CV_FROM_VIEW @ view.world_from_view.T
    return np.column_stack([rotation, -rotation @ view.position])


def matrices(view: View, width: int, height: int) -> dict[str, Array]:
    """Camera arrays of one frame, by the names they have in files.

    ``world_from_view`` (4, 4); ``clip_from_view`` (4, 4), reversed Z in [0, 1], without jitter; ``intrinsics`` (3, 3);
    ``jitter_px`` (2,), +x right, +y DOWN: pixel i shows the point at i + jitter.
    """
    return {
        "world_from_view": math3d.affine(view.world_from_view, view.position),
        "clip_from_view": view.centered().clip_from_view(width, height),
        "intrinsics": intrinsics(view, width, height),
        "jitter_px": np.asarray(view.jitter_px, dtype=np.float64) * [1.0, -1.0] + 0.0,
    }
