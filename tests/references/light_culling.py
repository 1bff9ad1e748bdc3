"""The light bounds of tile culling, in float64.  Reference for shaders/lighting/cull.comp.glsl."""

from __future__ import annotations

import numpy as np

from taubench_gl.math3d import normalize
from taubench_gl.metrics.lighting import MIN_ALPHA, MIN_LIGHT_DISTANCE

Array = np.ndarray


LOWEST, BINS = -32, 40
"""Bounds are sorted into ``BINS`` powers of two from 2^LOWEST up.  Whole bins are culled, faintest first."""


def largest_brdf(
    position: Array, normal: Array, base_color: Array, material: Array, parallel_view: Array | None = None
) -> Array:
    """Upper bound of brdf * cos(theta_l), any channel, over all directions of light, 1/sr.  (..., 3 or 4) -> (...).

    Channels as in ``channels``; ``parallel_view`` (3,): unit, towards a parallel camera.  GGX: D <= 1 / (pi a^2), and
    the visibility term times cos(theta_l) is at most 0.5 / sqrt(n_v^2 (1 - a^2) + a^2).  Fresnel: v.h >= n_v / 2,
    because 2 v.h n.h = n_v + n_l.
    """
    position, material = position.astype(np.float64), material.astype(np.float64)
    color = base_color[..., :3].astype(np.float64).max(axis=-1)
    v = normalize(-position[..., :3]) if parallel_view is None else parallel_view
    n_v = np.maximum(np.sum(normal[..., :3] * v, axis=-1), 1e-4)
    metallic, roughness, specular = material[..., 0], material[..., 1], material[..., 3]
    a2 = np.maximum(roughness**2, MIN_ALPHA) ** 2
    peak = 1.0 / (2.0 * np.pi * a2 * np.sqrt(n_v**2 * (1.0 - a2) + a2))
    schlick = np.maximum(1.0 - 0.5 * n_v, 0.0) ** 5
    metal = color + (np.maximum(color, 1.0) - color) * schlick
    fresnel = (1.0 - metallic) * specular * (0.04 + 0.96 * schlick) + metallic * metal
    return np.where(specular < 0, 0.0, (1.0 - metallic) * color / np.pi + fresnel * peak)


def tile_boxes(position: Array, brdf: Array, tile: int) -> tuple[Array, Array, Array]:
    """Bounding box of the surfaces in each tile, low and high corners (T, 3), and the largest brdf (T,), 1/sr.

    ``position`` (h, w, 4), w = 0 without a surface; ``brdf`` (h, w) from ``largest_brdf``; row 0 at the *bottom*, as in
    GL memory.  Tiles row by row from the bottom left; an empty tile has low = +Inf.
    """
    h, w = position.shape[:2]
    low, high, largest = [], [], []
    for y in range(0, h, tile):
        for x in range(0, w, tile):
            p = position[y : y + tile, x : x + tile].reshape(-1, 4).astype(np.float64)
            b = brdf[y : y + tile, x : x + tile].reshape(-1)[p[:, 3] > 0]
            p = p[p[:, 3] > 0]
            low.append(p[:, :3].min(axis=0, initial=np.inf))
            high.append(p[:, :3].max(axis=0, initial=-np.inf))
            largest.append(1.0001 * b.max(initial=0.0))
    return np.array(low), np.array(high), np.array(largest)


def light_bounds(
    low: Array, high: Array, brdf: Array, place: Array, peak: Array, reach: Array, constant: Array | None = None
) -> Array:
    """Upper bound of the radiance that each point light adds to a pixel of each tile.  (T, L).

    ``place`` (L, 3) in the space of the boxes, meters; ``peak`` (L,) largest channel of color x intensity; ``reach``
    (L,) range in meters, Inf where unlimited; ``constant`` (L,) bool, without attenuation (None: none of them).
    """
    low, high = low[:, None], high[:, None]
    nearest = np.clip(place, low, high) - place
    d2 = np.maximum(np.sum(nearest**2, axis=-1), MIN_LIGHT_DISTANCE**2)
    window = np.clip(1.0 - (d2 / reach**2) ** 2, 0.0, 1.0)
    d2 = d2 if constant is None else np.where(constant, 1.0, d2)
    return np.where(np.isfinite(low[..., 0]), peak * brdf[:, None] * window / d2, 0.0)


def kept_lights(bounds: Array, error: float) -> Array:
    """Lights that each tile keeps: the bounds of all others add up to at most ``error``.  (T, L) -> (T, L) bool."""
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
