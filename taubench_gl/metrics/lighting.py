"""Falloff of spot lights and the metallic-roughness BRDF, in float64.

Reference for shaders/common/brdf.glsl.  Sources: KHR_lights_punctual; glTF 2.0, appendix B.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

Array = np.ndarray


class SpotLight(Protocol):
    """The fields of ``scene.model.Light`` that are used here: half angles of the cones, radians."""

    inner_cone: float
    outer_cone: float


MIN_LIGHT_DISTANCE = 1e-3
"""Least distance to point and spot lights, meters: smaller ones count as this."""


LEAST_CONE = 1e-3
"""Least width of a spot's falloff, in the cosine of the angle to its axis (KHR_lights_punctual)."""


def spot_terms(light: SpotLight, cycles_cone: bool = False) -> tuple[float, float, float]:
    """``scale``, ``offset`` and ``smooth`` of the spot falloff: x = clamp(cos scale + offset, 0, 1), x^2 or smoothstep.

    ``smooth`` 0 gives x^2, the falloff that KHR_lights_punctual recommends, from the outer to the inner angle.
    ``cycles_cone`` gives ``smooth`` 1, x^2 (3 - 2x), over the width of Cycles (scene/light.cpp, kernel/light/spot.h):
    the share ``blend`` of 1 - cos(outer), which Blender's exporter writes as inner = outer (1 - blend).
    """
    outer = np.cos(light.outer_cone)
    if cycles_cone:
        width = (1.0 - outer) * (1.0 - light.inner_cone / light.outer_cone) if light.outer_cone > 0.0 else 0.0
    else:
        width = np.cos(light.inner_cone) - outer
    scale = 1.0 / max(LEAST_CONE, width)
    return float(scale), float(-outer * scale), float(cycles_cone)


MIN_ALPHA = 1e-3
"""Lower limit of roughness squared: narrower highlights are smaller than a pixel and add noise between frames."""

ALBEDO_TABLE = 32
"""Rows (perceptual roughness) and columns (cosine of the view angle) of the albedo table, both ends included."""


@dataclass(frozen=True)
class SurfaceMaterial:
    """Material of shaded points: ``base_color`` (..., 3) linear; ``metallic`` and perceptual ``roughness`` (...).

    ``specular`` scales the dielectric lobe (KHR_materials_specular).
    """

    base_color: Array
    metallic: Array
    roughness: Array
    specular: Array | float = 1.0


def evaluate_brdf(material: SurfaceMaterial, n: Array, v: Array, to_light: Array) -> tuple[Array, Array]:
    """Diffuse and glossy brdf * cos(theta_l), 1/sr.

    Unit vectors (..., 3): normal, to the viewer, to the light.  -> (..., 3), (..., 3); 0 where the light is below the
    surface.
    """
    base_color, n, v, to_light = (np.asarray(x, dtype=np.float64) for x in (material.base_color, n, v, to_light))
    metallic, alpha = np.asarray(material.metallic)[..., None], (np.asarray(material.roughness) ** 2)[..., None]
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
    dielectric = np.asarray(material.specular)[..., None] * (0.04 + 0.96 * schlick)
    metal = base_color + (1 - base_color) * schlick
    diffuse = (1 - metallic) * (1 - dielectric) * base_color / np.pi * n_l
    glossy = ((1 - metallic) * dielectric + metallic * metal) * d * visibility * n_l
    return np.where(lit, diffuse, 0.0), np.where(lit, glossy, 0.0)


@lru_cache(maxsize=1)
def albedo_table(samples: int = 24) -> Array:
    """Directional albedo of each lobe: the radiance it reflects to the viewer under a uniform sky of radiance 1.

    -> (ALBEDO_TABLE, ALBEDO_TABLE, 4) float32, rows roughness 0..1, columns n.v 0..1.  x, y: the glossy lobe reflects
    F0 x + F90 y.  z: mean of (1 - v.h)^5 over the cosine lobe, which the Fresnel factor removes from the diffuse lobe.
    w: 0.  Midpoint rule, ``samples``^2 directions each: over visible normals (Heitz 2018, "Sampling the GGX
    Distribution of Visible Normals") and over the cosine lobe.
    """
    grid = np.linspace(0.0, 1.0, ALBEDO_TABLE)
    roughness, n_v = (x[..., None] for x in np.meshgrid(grid, np.maximum(grid, 1e-4), indexing="ij"))
    u = (np.arange(samples) + 0.5) / samples
    u1, u2 = (x.ravel() for x in np.meshgrid(u, u))
    a = np.maximum(roughness**2, MIN_ALPHA)
    sine = np.sqrt(1.0 - n_v**2)
    length = np.sqrt((a * sine) ** 2 + n_v**2)
    x, z = a * sine / length, n_v / length  # view direction, stretched to the hemisphere of unit roughness
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
    fresnel = (1.0 - np.sqrt(0.5 * (1.0 + v_l))) ** 5  # v.h is the cosine of half the angle between v and l
    columns = [weight * (1.0 - schlick), weight * schlick, np.broadcast_to(fresnel, weight.shape), 0.0 * weight]
    return np.stack([np.mean(c, axis=-1) for c in columns], axis=-1).astype(np.float32)
