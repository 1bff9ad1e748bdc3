"""From radiance to display color: exposure, tone mapping, sRGB.  Reference for shaders/color/color.comp.glsl."""

from __future__ import annotations

from collections.abc import Sequence

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


PRIMARIES = {
    "rec709": (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290),
    "rec2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "p3-d65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
    "ap0": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767),
    "ap1": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
}
"""Chromaticities xy of red, green, blue and white (ITU-R BT.709, BT.2020, SMPTE EG 432-1, SMPTE ST 2065-1, ACEScg)."""

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def rec709_from(chromaticities: Sequence[float]) -> Array:
    """(3, 3) float64 that makes linear Rec. 709 RGB of linear RGB with ``chromaticities``, in the order of PRIMARIES.

    White stays white: Bradford's chromatic adaptation (Lam 1985).  Raises LinAlgError for what are no primaries.
    """

    def adapted(xy: Sequence[float]) -> Array:  # RGB -> XYZ, divided by white in Bradford's cone space
        x, y = np.asarray(xy, dtype=np.float64).reshape(4, 2).T
        red, green, blue, white = np.stack([x, y, 1.0 - x - y], axis=-1) / y[:, None]
        columns = np.stack([red, green, blue], axis=-1)
        columns = columns * np.linalg.solve(columns, white)
        return (_BRADFORD @ columns) / (_BRADFORD @ white)[:, None]

    with np.errstate(divide="ignore", invalid="ignore"):
        matrix = np.linalg.solve(adapted(PRIMARIES["rec709"]), adapted(chromaticities))
    if not np.isfinite(matrix).all():
        raise np.linalg.LinAlgError("not finite")
    return matrix


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
