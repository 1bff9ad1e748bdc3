"""Facts of light samples in float64: reference for shaders/reuse/sample_rays.comp.glsl and ``reuse.samples``.

Lights are punctual: rows of ``frame.lights.LIGHT``; moments as of ``references.reuse_methods.restir``.
"""

from __future__ import annotations

import itertools

import numpy as np

from references.reuse_methods.restir import Moment, at_lights
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray


def reaching(moment: Moment) -> Array:
    """(N, h, w) bool: the light reflects there, and nothing lies between."""
    return (moment.reflected() @ LUMINANCE > 0) & moment.visible()


def held_reaches(moment: Moment, samples: Array) -> Array:
    """Whether the light of each pixel's sample (h, w, 4) reaches it."""
    light = samples[..., 0].astype(int)
    return (light >= 0) & (at_lights(reaching(moment), light) > 0)


def count(held: Array, kept: Array, reaches: Array, reason: Array, reasons: int) -> Array:
    """(reasons, 4) by a loop: kept, wrongly kept, rejected, wrongly rejected; ``reason`` -1: not counted."""
    out = np.zeros((reasons, 4), dtype=np.int64)
    for y, x in np.ndindex(held.shape):
        if held[y, x] and reason[y, x] >= 0:
            first = 0 if kept[y, x] else 2
            out[reason[y, x], first] += 1
            out[reason[y, x], first + 1] += bool(kept[y, x]) != bool(reaches[y, x])
    return out


def duplicates(samples: Array, reach: int) -> tuple[int, int]:
    """Pairs of equal samples and all pairs of samples (h, w, 4) at most ``reach`` pixels apart along each axis."""
    h, w = samples.shape[:2]
    pixels = [(y, x) for y, x in np.ndindex(h, w) if samples[y, x, 0] >= 0]
    equal = total = 0
    for (y, x), (v, u) in itertools.combinations(pixels, 2):
        if max(abs(y - v), abs(x - u)) <= reach:
            total += 1
            equal += bool((samples[y, x, :3] == samples[v, u, :3]).all())
    return equal, total
