"""Metered exposure: the factor that maps the log-average luminance of lit surfaces to middle gray.

Source: Reinhard et al., Photographic Tone Reproduction for Digital Images, 2002, Eqs. (1) and (2) with key 0.18; pixels
below ``LEAST_SHARE`` of the brightest one take no part, so no offset is needed for black ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

MIDDLE_GRAY = 0.18
LEAST_SHARE = 1e-3
"""Pixels take part whose luminance is above this share of the largest one of all frames."""

LEAST_METERED = 0.1
"""If a smaller share of the lit pixels takes part, these are highlights, such as the sun in a mirror: the others are
metered without them."""

EXPOSURE_DIGITS = 4
"""Significant decimal digits of a metered exposure."""


def surface_luminance(radiance: Array, position: Array) -> Array:
    """Luminance of surface pixels, (n,) float64: ``radiance`` (h, w, >= 3) linear RGB, ``position`` (h, w, 4) as the
    channel, w = 0 where no surface is visible.  Pixels that are not finite are left out."""
    lit = radiance[position[..., 3] > 0.0][:, :3].astype(np.float64) @ LUMINANCE
    return lit[np.isfinite(lit)]


def metered_exposure(frames: Sequence[Array]) -> float | None:
    """The exposure of frames whose surfaces have these luminances, arrays (n,) float64; None if all is black."""
    luminance = np.concatenate([np.zeros(0), *frames])
    lit = luminance[luminance > 0.0]
    if not len(lit):
        return None
    used = lit > LEAST_SHARE * lit.max()
    while np.mean(used) < LEAST_METERED:  # ends: pixels within a factor of 1000 all take part
        lit = lit[~used]
        used = lit > LEAST_SHARE * lit.max()
    return float(MIDDLE_GRAY / np.exp(np.mean(np.log(lit[used]))))


def rounded(exposure: float) -> float:
    """``exposure`` with ``EXPOSURE_DIGITS`` significant digits."""
    return float(f"{exposure:.{EXPOSURE_DIGITS - 1}e}")
