"""The reprojection of a frame pair as shaders read it: fields of a struct, and their values."""

from __future__ import annotations

import numpy as np

from taubench_gl.gpu.layout import Field, column_major
from taubench_gl.metrics.reprojection import Reprojection

PAIR_FIELDS = (
    Field("clip_from_current", "mat4", "clip from points relative to the current camera, world axes"),
    Field("prev_clip_from_prev", "mat4", "previous clip from points relative to the previous camera, world axes"),
    Field("sky_origin", "vec4", "view ray of pixel (0, 0), world axes; w = 0 direction, 1 far-plane point"),
    Field("sky_dx", "vec4", "its step per pixel to the right"),
    Field("sky_dy", "vec4", "its step per pixel up"),
    Field("prev_forward", "vec4", "xyz: unit view direction of the previous camera"),
    Field("camera_delta", "vec4", "xyz: current - previous camera position, meters"),
)
"""The first fields of a struct that reprojects pixels."""


def pair_values(pair: Reprojection) -> dict[str, np.ndarray]:
    """``PAIR_FIELDS`` of ``pair``: matrices (4, 4) float32 with columns first, all others (4,) float64."""
    return {
        "clip_from_current": column_major(pair.clip_from_current),
        "prev_clip_from_prev": column_major(pair.prev_clip_from_prev),
        "sky_origin": pair.sky_origin,
        "sky_dx": pair.sky_dx,
        "sky_dy": pair.sky_dy,
        "prev_forward": np.append(pair.prev_forward, 0.0),
        "camera_delta": np.append(pair.camera_delta, 0.0),
    }
