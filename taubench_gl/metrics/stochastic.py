"""The choice of a light by chance.  Reference for shaders/common/light_choice.glsl."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

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
