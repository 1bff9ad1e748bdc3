"""glTF 2.0 metallic-roughness BRDF (specification, appendix B), float64: twin of shaders/common/brdf.glsl."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def evaluate_brdf(
    base_color: Array, metallic: Array, roughness: Array, n: Array, v: Array, to_light: Array, specular: float = 1.0
) -> tuple[Array, Array]:
    """Diffuse and glossy brdf * cos(theta_l), 1/sr.

    ``base_color`` (..., 3) linear; ``metallic``, perceptual ``roughness`` (...); unit vectors (..., 3).  ``specular``
    scales the dielectric lobe (KHR_materials_specular).  -> (..., 3), (..., 3); 0 where the light is below the surface.
    """
    base_color, n, v, to_light = (np.asarray(x, dtype=np.float64) for x in (base_color, n, v, to_light))
    metallic, alpha = np.asarray(metallic)[..., None], (np.asarray(roughness) ** 2)[..., None]
    alpha = np.maximum(alpha, 1e-3)

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
