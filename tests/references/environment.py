"""Glossy light of an environment, in float64.  Reference for shaders/common/environment.glsl."""

from __future__ import annotations

import numpy as np

from taubench_gl.metrics.environment import LOBE_LEVELS, EnvironmentMaps, lookup

Array = np.ndarray


def glossy_radiance(maps: EnvironmentMaps, mirror: Array, roughness: Array) -> Array:
    """Mean radiance around unit directions ``mirror`` (..., 3), as a lobe of perceptual ``roughness`` (...) sees it."""
    levels = [lookup(maps.seen, mirror), *(lookup(m, mirror) for m in maps.lobes[1:])]
    at = np.clip(np.asarray(roughness, dtype=np.float64), 0.0, 1.0) * LOBE_LEVELS
    low = np.minimum(at.astype(int), LOBE_LEVELS - 1)
    f = (at - low)[..., None]
    stack = np.stack(levels)

    def take(level: Array) -> Array:
        level = np.broadcast_to(level, mirror.shape[:-1])
        return np.take_along_axis(stack, level[None, ..., None], axis=0)[0]

    return take(low) * (1.0 - f) + take(low + 1) * f
