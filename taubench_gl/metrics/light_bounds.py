"""Which lights culling may leave out of a tile, in float64: twin of shaders/lighting/cull.comp.glsl."""

from __future__ import annotations

import numpy as np

from taubench_gl.metrics.brdf import MIN_ALPHA
from taubench_gl.metrics.lighting import MIN_LIGHT_DISTANCE

Array = np.ndarray

LOWEST, BINS = -32, 40
"""Bounds are sorted into ``BINS`` powers of two from 2^LOWEST up; whole bins are left out, faintest first."""


def tile_boxes(position: Array, material: Array, tile: int, *, glossy: bool = True) -> tuple[Array, Array, Array]:
    """Low and high corners (T, 3) of what each tile shows, and its largest brdf (T,), 1/sr.

    ``position`` (h, w, 4), w = 0 where nothing is; ``material`` (h, w, 4) as in ``channels``; row 0 at the *bottom*, as
    in GL memory.  Tiles row by row from the bottom left; an empty tile has low = +Inf.
    """
    h, w = position.shape[:2]
    low, high, brdf = [], [], []
    for y in range(0, h, tile):
        for x in range(0, w, tile):
            p, m = (a[y : y + tile, x : x + tile].reshape(-1, 4).astype(np.float64) for a in (position, material))
            m, p = m[p[:, 3] > 0], p[p[:, 3] > 0]
            low.append(p[:, :3].min(axis=0, initial=np.inf))
            high.append(p[:, :3].max(axis=0, initial=-np.inf))
            shiny = glossy & ((m[:, 3] > 0) | (m[:, 0] > 0))
            alpha = np.maximum(m[shiny, 1] ** 2, MIN_ALPHA).min(initial=1.0)
            brdf.append(1.0 / np.pi + (1.0 / (2.0 * np.pi * alpha**3) if glossy else 0.0))
    return np.array(low), np.array(high), np.array(brdf)


def light_bounds(low: Array, high: Array, brdf: Array, place: Array, peak: Array, reach: Array) -> Array:
    """Upper bound of the radiance that a point light gives any pixel of each tile.  (T, L).

    ``place`` (L, 3) in the space of the boxes, metres; ``peak`` (L,) largest channel of colour x intensity; ``reach``
    (L,) range in metres, Inf where unlimited.
    """
    low, high = low[:, None], high[:, None]
    nearest = np.clip(place, low, high) - place
    d2 = np.maximum(np.sum(nearest**2, axis=-1), MIN_LIGHT_DISTANCE**2)
    window = np.clip(1.0 - (d2 / reach**2) ** 2, 0.0, 1.0)
    return np.where(np.isfinite(low[..., 0]), peak * brdf[:, None] * window / d2, 0.0)


def kept_lights(bounds: Array, error: float) -> Array:
    """Which lights each tile keeps: what is left out adds up to at most ``error``.  (T, L) -> (T, L) bool."""
    with np.errstate(divide="ignore"):
        bins = np.clip(np.ceil(np.log2(bounds)) - LOWEST, 0, BINS - 1).astype(int)
    cut = np.zeros(len(bounds), dtype=int)
    left_out = np.zeros(len(bounds))
    open_ = np.ones(len(bounds), dtype=bool)
    for b in range(BINS):
        total = np.sum(np.where(bins == b, bounds, 0.0), axis=1)
        open_ &= left_out + total <= error
        left_out += np.where(open_, total, 0.0)
        cut += open_
    return (bounds > 0) & (bins >= cut[:, None])
