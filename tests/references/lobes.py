"""Albedos of the lobes and FSR2's masks in float64: the reference of ``reuse/surface.comp.glsl`` and ``demodulate``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from references.reuse_methods.history import sample_history
from taubench_gl.metrics.lighting import albedo_table
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray


def table_lookup(table: Array, roughness: Array, n_v: Array) -> Array:
    """Bilinear value (..., 3) of ``albedo_table`` at roughness and n.v, each (...) in [0, 1]."""
    at = np.stack(np.broadcast_arrays(n_v, roughness), axis=-1) * (len(table) - 1.0)
    return sample_history(table[..., :3], at)


def lobe_albedos(channels: Mapping[str, Array], least: float) -> tuple[Array, Array]:
    """Albedo of the diffuse and of the glossy lobe, (h, w, 3) float64, no component below ``least``.

    ``channels``: position, normal, base_color and material as ``channels`` defines them, of a perspective camera.
    """
    position, material = channels["position"].astype(np.float64), channels["material"].astype(np.float64)
    color = channels["base_color"][..., :3].astype(np.float64)
    lit = ((position[..., 3] > 0) & (material[..., 3] >= 0))[..., None]
    view = -position[..., :3] / np.maximum(np.linalg.norm(position[..., :3], axis=-1, keepdims=True), 1e-20)
    n_v = np.maximum((channels["normal"][..., :3] * view).sum(-1), 1e-4)
    t = table_lookup(albedo_table(), material[..., 1], n_v)
    metallic, specular = material[..., :1], material[..., 3:]
    dielectric = specular * (0.04 * t[..., :1] + t[..., 1:2])
    glossy = (1 - metallic) * dielectric + metallic * (color * t[..., :1] + t[..., 1:2])
    diffuse = color * (1 - metallic)
    return np.maximum(np.where(lit, diffuse, 0), least), np.maximum(np.where(lit, glossy, 0), least)


def transparency(channels: Mapping[str, Array]) -> Array:
    """(h, w) float64: share of mirror-like reflection."""
    diffuse, glossy = (a @ LUMINANCE for a in lobe_albedos(channels, 0.0))
    roughness = channels["material"][..., 1].astype(np.float64)
    return (1 - roughness) ** 2 * glossy / np.maximum(diffuse + glossy, 1e-6)
