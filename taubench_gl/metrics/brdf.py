"""glTF 2.0 metallic-roughness BRDF (specification, appendix B), float64: twin of shaders/common/brdf.glsl."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

Array = np.ndarray

MIN_ALPHA = 1e-3
"""Below this roughness squared a highlight is thinner than a pixel and only adds noise between frames."""

ALBEDO_TABLE = 32
"""Rows (perceptual roughness) and columns (cosine of the view angle) of the table of directional albedos, ends in."""


def evaluate_brdf(
    base_color: Array, metallic: Array, roughness: Array, n: Array, v: Array, to_light: Array, specular: float = 1.0
) -> tuple[Array, Array]:
    """Diffuse and glossy brdf * cos(theta_l), 1/sr.

    ``base_color`` (..., 3) linear; ``metallic``, perceptual ``roughness`` (...); unit vectors (..., 3).  ``specular``
    scales the dielectric lobe (KHR_materials_specular).  -> (..., 3), (..., 3); 0 where the light is below the surface.
    """
    base_color, n, v, to_light = (np.asarray(x, dtype=np.float64) for x in (base_color, n, v, to_light))
    metallic, alpha = np.asarray(metallic)[..., None], (np.asarray(roughness) ** 2)[..., None]
    alpha = np.maximum(alpha, MIN_ALPHA)

    def dot(a: Array, b: Array) -> Array:
        return np.sum(a * b, axis=-1, keepdims=True)

    n_l, n_v = dot(n, to_light), np.maximum(dot(n, v), 1e-4)
    lit = n_l > 0
    n_l = np.where(lit, n_l, 1.0)
    h = to_light + v
    h = h / np.maximum(np.linalg.norm(h, axis=-1, keepdims=True), 1e-300)
    n_h, v_h = np.clip(dot(n, h), 0, 1), np.clip(dot(v, h), 0, 1)
    schlick = (1 - v_h) ** 5
    a2 = alpha**2
    d = a2 / (np.pi * (n_h**2 * (a2 - 1) + 1) ** 2)
    visibility = 0.5 / (n_l * np.sqrt(n_v**2 * (1 - a2) + a2) + n_v * np.sqrt(n_l**2 * (1 - a2) + a2))
    dielectric = specular * (0.04 + 0.96 * schlick)
    metal = base_color + (1 - base_color) * schlick
    diffuse = (1 - metallic) * (1 - dielectric) * base_color / np.pi * n_l
    glossy = ((1 - metallic) * dielectric + metallic * metal) * d * visibility * n_l
    return np.where(lit, diffuse, 0.0), np.where(lit, glossy, 0.0)


@lru_cache(maxsize=1)
def albedo_table(samples: int = 24) -> Array:
    """What each lobe sends to the viewer of a uniform sky of radiance 1.

    -> (ALBEDO_TABLE, ALBEDO_TABLE, 4) float32, rows roughness 0..1, columns n.v 0..1; x, y: the glossy lobe gives
    F0 x + F90 y; z: mean of (1 - v.h)^5 over the cosine lobe, what the Fresnel factor takes from the diffuse one; w: 0.
    Midpoint rule, ``samples``^2 directions each: over visible normals (Heitz 2018, "Sampling the GGX Distribution of
    Visible Normals") and over the cosine lobe.
    """
    grid = np.linspace(0.0, 1.0, ALBEDO_TABLE)
    roughness, n_v = (x[..., None] for x in np.meshgrid(grid, np.maximum(grid, 1e-4), indexing="ij"))
    u = (np.arange(samples) + 0.5) / samples
    u1, u2 = (x.ravel() for x in np.meshgrid(u, u))
    a = np.maximum(roughness**2, MIN_ALPHA)
    sine = np.sqrt(1.0 - n_v**2)
    length = np.sqrt((a * sine) ** 2 + n_v**2)
    x, z = a * sine / length, n_v / length  # the viewer where the facets are those of a hemisphere
    r, phi = np.sqrt(u1), 2.0 * np.pi * u2
    t1 = r * np.cos(phi)
    blend = 0.5 * (1.0 + z)
    t2 = (1.0 - blend) * np.sqrt(1.0 - t1**2) + blend * r * np.sin(phi)
    t3 = np.sqrt(np.maximum(0.0, 1.0 - t1**2 - t2**2))
    h = np.stack([a * (-t2 * z + t3 * x), a * t1 + 0.0 * z, np.maximum(0.0, t2 * x + t3 * z)])
    h /= np.linalg.norm(h, axis=0)
    v_h = np.clip(sine * h[0] + n_v * h[2], 0.0, 1.0)
    n_l = 2.0 * v_h * h[2] - n_v

    def smith(cosine: Array) -> Array:
        return 0.5 * (np.sqrt(1.0 + a**2 * (1.0 / cosine**2 - 1.0)) - 1.0)

    safe = np.where(n_l > 0, np.minimum(n_l, 1.0), 1.0)
    weight = np.where(n_l > 0, (1.0 + smith(n_v)) / (1.0 + smith(n_v) + smith(safe)), 0.0)
    schlick = (1.0 - v_h) ** 5
    cosine = np.sqrt(1.0 - u1)
    v_l = np.clip(sine * r * np.cos(phi) + n_v * cosine, -1.0, 1.0)
    taken = (1.0 - np.sqrt(0.5 * (1.0 + v_l))) ** 5  # v.h is the cosine of half the angle between v and l
    columns = [weight * (1.0 - schlick), weight * schlick, np.broadcast_to(taken, weight.shape), 0.0 * weight]
    return np.stack([np.mean(c, axis=-1) for c in columns], axis=-1).astype(np.float32)
