"""Punctual lights in float64 (KHR_lights_punctual): twin of shaders/common/lights.glsl."""

from __future__ import annotations

from typing import Protocol

import numpy as np

Array = np.ndarray


class PunctualLight(Protocol):
    """What is needed of ``scene.model.Light``."""

    kind: str
    color: tuple[float, float, float]
    intensity: float
    range: float
    inner_cone: float
    outer_cone: float


MIN_LIGHT_DISTANCE = 1e-3
"""Metres: a surface nearer to a point or spot light than this is lit as if it were this far away."""


def incident(light: PunctualLight, position: Array, direction: Array, points: Array) -> tuple[Array, Array]:
    """Unit vectors towards the light, and the irradiance it gives a surface that faces it.

    ``position`` (3,) and unit ``direction`` (3,) of the light and ``points`` (..., 3), world.  -> (..., 3), (..., 3).
    """
    points = np.asarray(points, dtype=np.float64)
    color = np.asarray(light.color, dtype=np.float64) * light.intensity
    if light.kind == "directional":
        return np.broadcast_to(-direction, points.shape), np.broadcast_to(color, points.shape)
    offset = position - points
    d2 = np.maximum(np.sum(offset**2, axis=-1, keepdims=True), MIN_LIGHT_DISTANCE**2)
    length = np.linalg.norm(offset, axis=-1, keepdims=True)
    to_light = np.where(length > 0, offset / np.where(length > 0, length, 1.0), 0.0)
    out = color / d2
    if np.isfinite(light.range) and light.range > 0:
        out = out * np.clip(1.0 - (d2 / light.range**2) ** 2, 0.0, 1.0)
    if light.kind == "spot":
        scale, shift = spot_terms(light)
        cone = np.clip(np.sum(direction * -to_light, axis=-1, keepdims=True) * scale + shift, 0.0, 1.0)
        out = out * cone**2
    return to_light, out


def spot_terms(light: PunctualLight) -> tuple[float, float]:
    """``scale`` and ``offset`` of the extension's recommended spot falloff: clamp(cos * scale + offset, 0, 1)^2."""
    scale = 1.0 / max(0.001, np.cos(light.inner_cone) - np.cos(light.outer_cone))
    return float(scale), float(-np.cos(light.outer_cone) * scale)
