"""From radiance to display color: exposure, tone mapping, sRGB.  Reference for shaders/color/color.comp.glsl."""

from __future__ import annotations

import numpy as np

from taubench_gl.srgb import srgb_decode, srgb_encode

Array = np.ndarray

TONE_MAPS = {
    "linear": lambda x: x,
    # Reinhard et al. 2002, Eq. (3), per channel.
    "reinhard": lambda x: x / (1.0 + x),
    # Narkowicz 2015, "ACES Filmic Tone Mapping Curve": a rational fit per channel.
    "aces": lambda x: x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14),
}
"""Curves from exposed linear radiance >= 0 to display-linear values; the result is clamped to [0, 1]."""


def tone_map(radiance: Array, curve: str = "linear") -> Array:
    """Display-linear values in [0, 1] of linear radiance; negative radiance counts as 0.  (...) -> (...)."""
    # Radiance is limited where all curves have reached 1, so that they do not overflow.
    return np.clip(TONE_MAPS[curve](np.clip(radiance, 0.0, 1e6)), 0.0, 1.0)


def display_color(radiance: Array, exposure: float = 1.0, curve: str = "linear") -> Array:
    """The color that the color mask compares: exposure, ``curve``, clamp, sRGB.  (..., 3) -> (..., 3) in [0, 1].

    NaN stays NaN.  Infinite radiance is invalid and becomes NaN, which the masks count as INVALID.
    """
    exposed = np.where(np.isinf(radiance), np.nan, radiance) * exposure
    return srgb_encode(tone_map(exposed, curve))


__all__ = ["TONE_MAPS", "display_color", "srgb_decode", "srgb_encode", "tone_map"]
