"""Counter-based random numbers and stochastic light estimates, in float64.

References for shaders/common/random.glsl, equal bit for bit, and shaders/lighting/stochastic.comp.glsl.
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


def random4(size: tuple[int, int], frame: int, seed: int, sample: int) -> Array:
    """Four random numbers in [0, 1) per pixel, multiples of 2^-24.  -> (h, w, 4) float64, row 0 at the top.

    ``seed`` and ``sample`` are 16-bit numbers.  The result is a function of (pixel, frame, seed, sample).
    """
    w, h = size
    x, y = np.meshgrid(np.arange(w, dtype=np.uint32), np.arange(h - 1, -1, -1, dtype=np.uint32))
    key = np.broadcast_to(np.uint32(seed << 16 | sample), x.shape)
    counter = np.stack([x, y, np.broadcast_to(np.uint32(frame), x.shape), key], axis=-1)
    return (pcg4d(counter) >> np.uint32(8)).astype(np.float64) / (1 << 24)


FIRST_VPL_SAMPLE = 0x8000
"""Samples of virtual point lights are numbered from here, those of lights from 0."""


def choose(u: Array, choice: Array) -> Array:
    """Indices of the lights chosen by ``u`` in [0, 1): the first with a cumulative probability above u."""
    return np.searchsorted(choice[:, 0].astype(np.float64), u, side="right")


def estimate_direct(
    per_light: Array, choice: Array, size: tuple[int, int], frame: int, seed: int, samples: int
) -> Array:
    """Mean over ``samples`` samples of (radiance from the chosen light) / (its probability).

    ``per_light`` (N, h, w, 3): radiance from each light alone.  -> (h, w, 3) float64; its expectation over seeds
    is ``per_light.sum(axis=0)``.
    """
    rows, columns = np.indices(size[::-1])
    total = np.zeros(per_light.shape[1:])
    for sample in range(samples):
        chosen = choose(random4(size, frame, seed, sample)[..., 0], choice)
        total += per_light[chosen, rows, columns] / choice[chosen, 1].astype(np.float64)[..., None]
    return total / samples


def estimate_indirect(per_light: Array, size: tuple[int, int], frame: int, seed: int, samples: int) -> Array:
    """Indirect light estimated from VPLs with equal probabilities.  ``per_light`` (V, h, w, 3) -> (h, w, 3)."""
    rows, columns = np.indices(size[::-1])
    total, count = np.zeros(per_light.shape[1:]), len(per_light)
    for sample in range(samples):
        u = random4(size, frame, seed, FIRST_VPL_SAMPLE + sample)[..., 0]
        total += per_light[np.minimum((u * count).astype(np.int64), count - 1), rows, columns]
    return total * count / samples
