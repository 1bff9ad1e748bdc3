"""Kinds of display images of channels, the scalar color scale, and the distance of motion fields."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
KINDS = ("encoded", "radiance", "headlight", "unit", "vector", "depth", "ids", "motion", "object_motion")
BACKGROUND = 0.06
"""Gray level of pixels without a surface, for kinds that are undefined there."""

SCALE = np.array(
    [(0.05, 0.03, 0.20), (0.23, 0.18, 0.54), (0.15, 0.42, 0.60), (0.12, 0.63, 0.53), (0.48, 0.80, 0.32),
     (0.98, 0.93, 0.25)]
)  # fmt: skip
"""Stops of the scalar color scale, with increasing luminance."""


def scale_glsl() -> str:
    """SCALE and the number of its colors as GLSL constants."""
    stops = ", ".join(f"vec3({r}, {g}, {b})" for r, g, b in SCALE)
    return f"const int STOPS = {len(SCALE)};\nconst vec3 SCALE[STOPS] = vec3[]({stops});"


def object_motion(supplied_px: Array, expected_px: Array) -> Array:
    """Distance of two motion fields, pixels.  (h, w, 2) each -> (h, w); 0 where either is undefined."""
    return np.nan_to_num(
        np.linalg.norm(np.asarray(supplied_px, np.float64) - expected_px, axis=-1), nan=0.0, posinf=0.0
    )
