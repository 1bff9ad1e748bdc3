"""Metered exposure: the factor that maps the log-average luminance of lit surfaces to middle gray.

Source: Reinhard et al., Photographic Tone Reproduction for Digital Images, 2002, Eqs. (1) and (2) with key 0.18.  Two
departures: the darkest and the brightest tenth of the lit pixels take no part, so neither a black corner nor the sun in
a mirror moves the number, and the factor is lowered until few lit pixels clip.
"""

from __future__ import annotations

import math

import numpy as np

from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

MIDDLE_GRAY = 0.18

TRIMMED_PERCENT = 10.0
"""Lit pixels below this percentile of luminance take no part in the average, nor those above 100 minus it."""

MOST_CLIPPED = 0.05
"""Largest share of the lit pixels that have a channel of exposed radiance above 1."""

EXPOSURE_DIGITS = 4
"""Significant decimal digits of a metered exposure."""


def metered_exposure(radiance: Array, weights: Array | None = None) -> float | None:
    """The exposure for surfaces of ``radiance`` (n, 3), linear RGB, float64; None if all is black.

    ``weights`` (n,) > 0: how many pixels each stands for; None: one.
    """
    luminance = radiance @ LUMINANCE
    lit = luminance > 0.0
    if not np.any(lit):
        return None
    weights = np.ones(len(lit)) if weights is None else weights
    radiance, luminance, weights = radiance[lit], luminance[lit], weights[lit]
    order = np.argsort(luminance)
    below = np.cumsum(weights[order]) - weights[order]
    trimmed = np.array([TRIMMED_PERCENT, 100.0 - TRIMMED_PERCENT]) / 100.0
    low, high = np.interp(trimmed, below / max(below[-1], 1.0), luminance[order])
    used = (luminance >= low) & (luminance <= high)
    exposure = MIDDLE_GRAY / math.exp(float(np.average(np.log(luminance[used]), weights=weights[used])))
    brightest = radiance.max(axis=-1)
    order = np.argsort(brightest)[::-1]
    above = np.cumsum(weights[order])  # as many as may clip are brighter
    return min(exposure, 1.0 / brightest[order[np.searchsorted(above, MOST_CLIPPED * above[-1], side="right")]])


def rounded(exposure: float) -> float:
    """``exposure`` with ``EXPOSURE_DIGITS`` significant digits, rounded down: no more pixels clip."""
    nearest = float(f"{exposure:.{EXPOSURE_DIGITS - 1}e}")
    step = 10.0 ** (math.floor(math.log10(exposure)) - EXPOSURE_DIGITS + 1)
    return nearest if nearest <= exposure else float(f"{nearest - step:.{EXPOSURE_DIGITS - 1}e}")
