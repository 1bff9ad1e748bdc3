"""Counter-based random numbers and the choice of lights.

References for shaders/common/random.glsl, equal bit for bit, and shaders/common/light_choice.glsl.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def pcg4d(v: Array) -> Array:
    """Hash of four words (Jarzynski and Olano 2020, listing 1).  (..., 4) uint32 -> (..., 4) uint32."""
    x, y, z, w = (np.asarray(v[..., k], dtype=np.uint32) for k in range(4))
    with np.errstate(over="ignore"):
        x, y, z, w = (c * np.uint32(1664525) + np.uint32(1013904223) for c in (x, y, z, w))
        for turn in range(2):
            x = x + y * w
            y = y + z * x
            z = z + x * y
            w = w + y * z
            if turn == 0:
                x, y, z, w = (c ^ (c >> np.uint32(16)) for c in (x, y, z, w))
    return np.stack([x, y, z, w], axis=-1)


UNIFORM_SHARE = 0.5
"""Share of the probability that is uniform over all lights that are on; the rest is proportional to power.  The weight
of a sample is therefore at most twice the number of lights, also for a weak light that is close."""


def light_choice(power: Array) -> Array:
    """Cumulative probability and probability of each light.  ``power`` (N,) >= 0 -> (N, 2) float32.

    A light of power 0 is off and never chosen.  Probabilities are differences of the *rounded* cumulative ones, so that
    the choice and the weight agree exactly in the shader.  All zero if all lights are off.
    """
    power = np.asarray(power, dtype=np.float64)
    on = power > 0
    out = np.zeros((len(power), 2), dtype=np.float32)
    if not on.any():
        return out
    share = (1.0 - UNIFORM_SHARE) * power / power.sum() + UNIFORM_SHARE * on / on.sum()
    cumulative = np.cumsum(share)
    cumulative[np.flatnonzero(on)[-1] :] = 1.0
    out[:, 0] = cumulative
    out[:, 1] = np.diff(out[:, 0], prepend=np.float32(0))
    return out
