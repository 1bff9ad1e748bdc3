"""Directions drawn for the metallic-roughness BRDF and their density, in float64.

Reference for shaders/common/brdf_sampling.glsl.  Sources: Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with
Spherical Caps"; Eto and Tokuyoshi 2023, "Bounded VNDF Sampling for Smith-GGX Reflections"; Duff et al. 2017, "Building
an Orthonormal Basis, Revisited".
"""

from __future__ import annotations

import numpy as np

from taubench_gl.math3d import normalize
from taubench_gl.metrics.lighting import MIN_ALPHA, SurfaceMaterial

Array = np.ndarray
LEAST_N_V = 1e-4
"""Views below the surface are lifted to this cosine."""


def glossy_share(material: SurfaceMaterial, n: Array, v: Array) -> Array:
    """Probability that a direction is drawn from the GGX lobe, the rest is the cosine lobe.  (...)."""
    schlick = (1.0 - np.clip(np.sum(n * v, axis=-1), 0.0, 1.0)) ** 5
    color = np.max(material.base_color, axis=-1)
    metallic = np.asarray(material.metallic, dtype=np.float64)
    diffuse = (1.0 - metallic) * color
    dielectric = material.specular * (0.04 + 0.96 * schlick)
    glossy = (1.0 - metallic) * dielectric + metallic * (color + (1.0 - color) * schlick)
    return glossy / np.where(glossy > 0, diffuse + glossy, 1.0)


def basis_around(n: Array) -> tuple[Array, Array]:
    """Unit vectors (..., 3) that are the x and y axis of a right-handed basis with z = ``n`` (..., 3)."""
    x, y, z = n[..., 0], n[..., 1], n[..., 2]
    s = np.where(z >= 0, 1.0, -1.0)
    a = -1.0 / (s + z)
    b = x * y * a
    return np.stack([1.0 + s * x * x * a, s * b, -s * x], axis=-1), np.stack([b, s + y * y * a, -y], axis=-1)


def sample_brdf(material: SurfaceMaterial, n: Array, v: Array, u: Array) -> tuple[Array, Array]:
    """A direction for each ``u`` (..., 3) in [0, 1) (xy: direction, z: lobe) and its density.

    Unit vectors ``n`` and ``v`` (..., 3): normal, to the viewer.  -> (..., 3) unit, (...) 1/sr; density 0 where the
    direction is below the surface.
    """
    n, v = np.broadcast_arrays(np.asarray(n, dtype=np.float64), np.asarray(v, dtype=np.float64))
    alpha = _alpha(material)
    x_axis, y_axis = basis_around(n)
    around = 2.0 * np.pi * u[..., 0]
    # GGX: a normal from the part of the cap that can reflect above the surface.
    lifted = _lobe_view(n, v)
    local = np.stack([np.sum(lifted * axis, axis=-1) for axis in (x_axis, y_axis, n)], axis=-1)
    stretch = np.stack([alpha, alpha, np.ones_like(alpha)], axis=-1)
    stretched = normalize(local * stretch)
    z = 1.0 - u[..., 1] * (1.0 + _cap_bound(local[..., 2], alpha**2) * stretched[..., 2])
    r = np.sqrt(np.clip(1.0 - z * z, 0.0, 1.0))
    h = normalize((np.stack([r * np.cos(around), r * np.sin(around), z], axis=-1) + stretched) * stretch)
    glossy = 2.0 * np.sum(local * h, axis=-1, keepdims=True) * h - local
    # The cosine lobe.
    r = np.sqrt(u[..., 1])
    diffuse = np.stack([r * np.cos(around), r * np.sin(around), np.sqrt(1.0 - u[..., 1])], axis=-1)
    chosen = np.where((u[..., 2] < glossy_share(material, n, v))[..., None], glossy, diffuse)
    to_light = normalize(chosen[..., :1] * x_axis + chosen[..., 1:2] * y_axis + chosen[..., 2:] * n)
    return to_light, brdf_pdf(material, n, v, to_light)


def brdf_pdf(material: SurfaceMaterial, n: Array, v: Array, to_light: Array) -> Array:
    """Density of ``sample_brdf`` at unit vectors ``to_light`` (..., 3), 1/sr; 0 below the surface.  (...)."""
    n, v = np.broadcast_arrays(np.asarray(n, dtype=np.float64), np.asarray(v, dtype=np.float64))
    share, n_l = glossy_share(material, n, v), np.sum(n * to_light, axis=-1)
    pdf = (1.0 - share) * n_l / np.pi + share * _ggx_pdf(_alpha(material), n, _lobe_view(n, v), to_light)
    return np.where(n_l > 0, pdf, 0.0)


def _alpha(material: SurfaceMaterial) -> Array:
    return np.maximum(np.asarray(material.roughness, dtype=np.float64) ** 2, MIN_ALPHA)


def _lobe_view(n: Array, v: Array) -> Array:
    n_v = np.sum(n * v, axis=-1, keepdims=True)
    return np.where(n_v >= LEAST_N_V, v, normalize(v + (LEAST_N_V - n_v) * n))


def _cap_bound(n_v: Array, a2: Array) -> Array:
    """Eto and Tokuyoshi, equation 5."""
    s2 = (1.0 + np.sqrt(np.maximum(0.0, 1.0 - n_v**2))) ** 2
    return (1.0 - a2) * s2 / (s2 + a2 * n_v**2)


def _ggx_pdf(alpha: Array, n: Array, v: Array, to_light: Array) -> Array:
    """Eto and Tokuyoshi, equation 8."""
    a2, n_v = alpha**2, np.sum(n * v, axis=-1)
    h = to_light + v
    h = h / np.maximum(np.linalg.norm(h, axis=-1, keepdims=True), 1e-300)
    n_h = np.clip(np.sum(n * h, axis=-1), 0.0, 1.0)
    d = a2 / (np.pi * (n_h**2 * (a2 - 1.0) + 1.0) ** 2)
    return 0.5 * d / (_cap_bound(n_v, a2) * n_v + np.sqrt(a2 * np.maximum(0.0, 1.0 - n_v**2) + n_v**2))
