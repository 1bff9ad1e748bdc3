"""Surfaces that light goes through, in float64: reference for shaders/common/dielectric.glsl and brdf_sampling.glsl.

Walter et al. 2007, "Microfacet Models for Refraction through Rough Surfaces"; Heitz 2018, "Sampling the GGX
Distribution of Visible Normals".  The normal is +z.  Radiance in a medium is that over its squared index of refraction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taubench_gl.metrics.lighting import MIN_ALPHA

Array = np.ndarray


def fresnel(cosine: Array, eta: Array | float) -> Array:
    """Reflectance of unpolarized light by Fresnel's equations, from the angles on both sides.

    ``eta``: index of refraction beyond the surface over that before it; 1 where light is totally reflected.
    """
    cosine, eta = np.asarray(cosine, dtype=np.float64), np.asarray(eta, dtype=np.float64)
    beyond = np.emath.sqrt(1.0 - (1.0 - cosine**2) / eta**2)
    s = (cosine - eta * beyond) / (cosine + eta * beyond)
    p = (eta * cosine - beyond) / (eta * cosine + beyond)
    return 0.5 * (np.abs(s) ** 2 + np.abs(p) ** 2)


def slab(f: Array, left: Array) -> tuple[Array, Array]:
    """Reflectance and transmittance of a slab whose faces reflect ``f``; ``left``: of light after one way through."""
    through = (1.0 - f) ** 2 * left / (1.0 - f**2 * left**2)
    return f + f * left * through, through


@dataclass(frozen=True)
class Glass:
    """A white dielectric that lets ``transmission`` of the light under its lobe through; arrays (...) or numbers."""

    roughness: Array | float
    eta: Array | float = 1.5  # as of ``fresnel``
    thick: bool = True
    transmission: Array | float = 1.0
    specular: Array | float = 1.0
    tint: Array | float = 1.0  # of the reflectance at normal incidence

    @property
    def alpha(self) -> Array:
        return np.maximum(np.asarray(self.roughness, dtype=np.float64) ** 2, MIN_ALPHA)

    def reflectance(self, cosine: Array) -> Array:
        """Reflectance of the lobe at a normal whose cosine to the view is ``cosine``."""
        normal, exact = fresnel(1.0, self.eta), fresnel(cosine, self.eta)
        f0 = np.minimum(normal * self.tint, 1.0) * self.specular
        total = 1.0 - np.asarray(cosine) ** 2 >= np.asarray(self.eta) ** 2
        return np.where(total, 1.0, f0 + (self.specular - f0) * (exact - normal) / (1.0 - normal))

    def density(self, h: Array) -> Array:
        """GGX's distribution of normals, 1/sr."""
        a2 = self.alpha**2
        return a2 / (np.pi * (h[..., 2] ** 2 * (a2 - 1.0) + 1.0) ** 2)

    def _slope(self, cosine: Array) -> Array:
        """1 + 2 Lambda of Smith's masking."""
        return np.sqrt(1.0 + self.alpha**2 * (1.0 - cosine**2) / cosine**2)

    def half(self, v: Array, to_light: Array) -> Array:
        """Normals at which light from ``to_light`` goes to ``v``; 0 where there is none."""
        above = to_light[..., 2:] > 0
        mirrored = to_light * [1.0, 1.0, -1.0]
        beyond = v + np.asarray(self.eta)[..., None] * to_light if self.thick else v + mirrored
        h = np.where(above, v + to_light, beyond)
        h = h / np.linalg.norm(h, axis=-1, keepdims=True)
        h = np.where(h[..., 2:] < 0, -h, h)
        side = np.sum(h * to_light, axis=-1) < 0 if self.thick else np.ones(h.shape[:-1], bool)
        real = (np.sum(h * v, axis=-1) > 0) & (above[..., 0] | side)
        return np.where(real[..., None], h, 0.0)

    def jacobian(self, v: Array, to_light: Array, h: Array) -> Array:
        """Solid angle of normals for that of directions to the light."""
        v_h, l_h = np.sum(v * h, axis=-1), np.sum(to_light * h, axis=-1)
        mirror = 0.25 / np.where(v_h > 0, v_h, 1.0)
        if not self.thick:
            return mirror
        across = v_h + self.eta * l_h
        bent = self.eta**2 * np.abs(l_h) / np.where(across != 0, across, 1.0) ** 2
        return np.where(to_light[..., 2] > 0, mirror, bent)

    def evaluate(self, v: Array, to_light: Array) -> tuple[Array, Array]:
        """Glossy and transmitted bsdf * |cos(theta_l)|, 1/sr.  Unit vectors (..., 3), ``v`` above the surface."""
        h = self.half(v, to_light)
        v_h, above = np.clip(np.sum(v * h, axis=-1), 0.0, 1.0), to_light[..., 2] > 0
        n_v, n_l = v[..., 2], np.abs(to_light[..., 2])
        masking = 2.0 / (self._slope(n_v) + self._slope(n_l))
        lobe = self.density(h) * masking * v_h / n_v * self.jacobian(v, to_light, h)
        f = self.reflectance(v_h)
        lobe = np.where(h[..., 2] > 0, lobe, 0.0)
        return np.where(above, f * lobe, 0.0), np.where(above, 0.0, (1.0 - f) * self.transmission * lobe)

    def sample(self, v: Array, u: Array) -> tuple[Array, Array]:
        """Directions to the light for ``u`` (..., 3) in [0, 1), with weights f / pdf; weight 0: on the wrong side.

        Of a surface without diffuse lobe: reflected by ``reflectance`` at a visible normal, else transmitted.
        """
        alpha = np.broadcast_to(self.alpha, v.shape[:-1])
        stretch = np.stack([alpha, alpha, np.ones_like(alpha)], axis=-1)
        stretched = v * stretch / np.linalg.norm(v * stretch, axis=-1, keepdims=True)
        z = 1.0 - u[..., 1] * (1.0 + stretched[..., 2])
        r, around = np.sqrt(np.clip(1.0 - z * z, 0.0, 1.0)), 2.0 * np.pi * u[..., 0]
        h = (np.stack([r * np.cos(around), r * np.sin(around), z], axis=-1) + stretched) * stretch
        h /= np.linalg.norm(h, axis=-1, keepdims=True)
        v_h = np.sum(v * h, axis=-1)
        reflected = 2.0 * v_h[..., None] * h - v
        f = self.reflectance(np.clip(v_h, 0.0, 1.0))
        if self.thick:
            eta = np.broadcast_to(np.asarray(self.eta, dtype=np.float64), v_h.shape)
            root = np.sqrt(np.maximum(1.0 - (1.0 - v_h**2) / eta**2, 0.0))
            beyond = -v / eta[..., None] + (v_h / eta - root)[..., None] * h
        else:
            beyond = reflected * [1.0, 1.0, -1.0]
        goes_through = u[..., 2] < 1.0 - f
        to_light = np.where(goes_through[..., None], beyond, reflected)
        right = np.where(goes_through, to_light[..., 2] < 0, to_light[..., 2] > 0)
        # G2 / G1 of the view.
        slope, other = self._slope(v[..., 2]), self._slope(np.where(to_light[..., 2] != 0, to_light[..., 2], 1.0))
        masking = (1.0 + slope) / (slope + other)
        weight = np.where(goes_through, self.transmission, 1.0) * masking
        return to_light, np.where(right, weight, 0.0)


def rough_slab(glass: Glass, n_v: float, optical_depth: float, count: int, seed: int, most: int = 64) -> Array:
    """Random walks through a slab with two equal rough faces: (4,) means and (4,) standard errors.

    Reflected at the first face; reflected after the inside; transmitted; left inside after ``most`` events.  From the
    outside ``glass.eta`` is the index of refraction; ``optical_depth``: of the way straight through.
    """
    rng = np.random.default_rng(seed)
    inside = Glass(glass.roughness, 1.0 / glass.eta, True, glass.transmission)
    v = np.broadcast_to([np.sqrt(1.0 - n_v**2), 0.0, n_v], (count, 3)).copy()
    out = np.zeros((count, 4))
    to_light, weight = glass.sample(v, rng.random((count, 3)))
    first = to_light[:, 2] > 0
    out[first, 0] = weight[first]
    alive, at_back = ~first & (weight > 0), np.ones(count, bool)
    for _ in range(most - 1):
        if not alive.any():
            break
        weight = weight * np.exp(-optical_depth / np.maximum(np.abs(to_light[:, 2]), 1e-12))
        v = np.concatenate([-to_light[:, :2], np.abs(to_light[:, 2:])], axis=1)  # inside, above the face that is next
        local, w = inside.sample(v, rng.random((count, 3)))
        leaves = alive & (local[:, 2] < 0)
        weight = weight * w
        out[leaves & at_back, 2], out[leaves & ~at_back, 1] = weight[leaves & at_back], weight[leaves & ~at_back]
        stays = alive & (local[:, 2] > 0) & (weight > 0)
        to_light, at_back, alive = local, np.where(stays, ~at_back, at_back), stays
    out[alive, 3] = weight[alive]
    return np.stack([out.mean(axis=0), out.std(axis=0) / np.sqrt(count)])
