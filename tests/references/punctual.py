"""Light of punctual lights in float64: the reference for shaders/common/lights.glsl.  Source: KHR_lights_punctual."""

from __future__ import annotations

import numpy as np

from taubench_gl.metrics.lighting import MIN_LIGHT_DISTANCE, spot_terms
from taubench_gl.scene.model import Light

Array = np.ndarray


def incident(light: Light, position: Array, direction: Array, points: Array) -> tuple[Array, Array]:
    """Unit vectors towards the light, and the irradiance of a surface that faces it.

    ``position`` (3,) and unit ``direction`` (3,) of the light, and ``points`` (..., 3), all in world space.
    -> (..., 3), (..., 3).
    """
    points = np.asarray(points, dtype=np.float64)
    color = np.asarray(light.color, dtype=np.float64) * light.intensity
    if light.kind == "directional":
        return np.broadcast_to(-direction, points.shape), np.broadcast_to(color, points.shape)
    offset = position - points
    d2 = np.maximum(np.sum(offset**2, axis=-1, keepdims=True), MIN_LIGHT_DISTANCE**2)
    length = np.linalg.norm(offset, axis=-1, keepdims=True)
    to_light = np.where(length > 0, offset / np.where(length > 0, length, 1.0), 0.0)
    out = color * np.ones_like(d2) if light.constant else color / d2
    if np.isfinite(light.range) and light.range > 0:
        out = out * np.clip(1.0 - (d2 / light.range**2) ** 2, 0.0, 1.0)
    if light.kind == "spot":
        scale, shift, smooth = spot_terms(light)
        cone = np.clip(np.sum(direction * -to_light, axis=-1, keepdims=True) * scale + shift, 0.0, 1.0)
        out = out * cone**2 * (1.0 + smooth * (2.0 - 2.0 * cone))
    return to_light, out
