"""Estimates from a few random lights in float64: twin of shaders/lighting/stochastic.comp.glsl."""

from __future__ import annotations

import numpy as np

from taubench_gl.metrics.random_numbers import random4

Array = np.ndarray

INDIRECT_DRAW = 0x8000
"""Draws of virtual lights are numbered from here, those of lights from 0."""

UNIFORM_SHARE = 0.5
"""Of the probability, shared out evenly among the lights that are on; the rest goes by power.  A weak light close by
is then never weighted by more than twice the number of lights."""


def light_choice(power: Array) -> Array:
    """Cumulative probability and probability of each light.  ``power`` (N,) >= 0 -> (N, 2) float32.

    A light of power 0 is off and never chosen.  The probabilities are the differences of the *rounded* cumulative ones,
    so that the shader's choice and its weight agree exactly.  All off: zeros.
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


def choose(u: Array, choice: Array) -> Array:
    """Rows of the lights that numbers ``u`` in [0, 1) choose: the first whose cumulative probability is above u."""
    return np.searchsorted(choice[:, 0].astype(np.float64), u, side="right")


def estimate_direct(
    per_light: Array, choice: Array, size: tuple[int, int], frame: int, seed: int, samples: int
) -> Array:
    """Mean over ``samples`` draws of (what the chosen light gives) / (its probability).

    ``per_light`` (N, h, w, 3): radiance that each light alone gives.  -> (h, w, 3) float64; its expectation over seeds
    is ``per_light.sum(axis=0)``.
    """
    rows, columns = np.indices(size[::-1])
    total = np.zeros(per_light.shape[1:])
    for draw in range(samples):
        chosen = choose(random4(size, frame, seed, draw)[..., 0], choice)
        total += per_light[chosen, rows, columns] / choice[chosen, 1].astype(np.float64)[..., None]
    return total / samples


def estimate_indirect(per_light: Array, size: tuple[int, int], frame: int, seed: int, samples: int) -> Array:
    """The same over virtual lights, all equally likely.  ``per_light`` (V, h, w, 3) -> (h, w, 3)."""
    rows, columns = np.indices(size[::-1])
    total, count = np.zeros(per_light.shape[1:]), len(per_light)
    for draw in range(samples):
        u = random4(size, frame, seed, INDIRECT_DRAW + draw)[..., 0]
        total += per_light[np.minimum((u * count).astype(np.int64), count - 1), rows, columns]
    return total * count / samples
