"""BMFR: blockwise multi-order feature regression, after Koskela et al. 2019."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from references.stochastic import pcg4d

Array = np.ndarray

BLOCK = 32
"""Width and height of a block, pixels."""

FEATURES = 10
"""1, normal (3), scaled position (3), its squares (3): feature fitting."""

FEWEST = 2 * FEATURES
"""Surface pixels in a block for a fit of all features; with fewer, the constant alone is fitted."""

LEAST_RANGE = 1e-3
"""Meters: a position that varies less within a block is scaled as if it varied by this much."""

_OFFSET_NUMBER = 3
"""Random numbers 0 to 2 of a pixel are the noise of its features."""


def accept_taps(
    inputs: Mapping[str, Array], position_limit: float, normal_limit: float
) -> Callable[[Array, Array], Array]:
    """Pre-processing: taps whose previous position and normal are near those of the pixel; for ``consistent_blend``.

    ``inputs``: position, prev_position, normal, history_position, history_normal, (h, w, >= 3).
    """
    there, normals = inputs["history_position"].astype(np.float64), inputs["history_normal"].astype(np.float64)
    surface = inputs["position"][..., 3] > 0

    def accept(row: Array, column: Array) -> Array:
        far = np.linalg.norm(there[row, column, :3] - inputs["prev_position"][..., :3], axis=-1) > position_limit
        turned = np.linalg.norm(normals[row, column, :3] - inputs["normal"][..., :3], axis=-1) > normal_limit
        return ((there[row, column, 3] > 0) == surface) & ~(surface & (far | turned))

    return accept


def _random(x: Array, up: Array, frame: int, number: int) -> Array:
    """Four random numbers in [0, 1) of pixels (x, up), which may lie outside the image.  -> (..., 4)."""
    x, up = (np.asarray(v).astype(np.int32).view(np.uint32) for v in (x, up))
    rest = (np.broadcast_to(np.uint32(v), x.shape) for v in (frame, number))
    return (pcg4d(np.stack([x, up, *rest], axis=-1)) >> np.uint32(8)).astype(np.float64) / (1 << 24)


def block_offset(frame: int) -> tuple[int, int]:
    """Feature fitting: pixels by which the grid of blocks is shifted to the left and down in a frame."""
    zero = np.zeros(1, dtype=np.int64)
    x, up = np.floor(_random(zero, zero, frame, _OFFSET_NUMBER)[0, :2] * BLOCK).astype(int)
    return int(x), int(up)


def feature_noise(x: Array, up: Array, frame: int) -> Array:
    """Uniform noise in [-1, 1) of the features of pixels (x, up) of a block; none of the constant.  -> (..., 10)."""
    noise = np.concatenate([2 * _random(x, up, frame, i) - 1 for i in range(3)], axis=-1)
    return np.concatenate([np.zeros((*noise.shape[:-1], 1)), noise[..., : FEATURES - 1]], axis=-1)


def block_features(position: Array, normal: Array) -> Array:
    """Feature fitting: features of the surface pixels of one block; positions are scaled to [0, 1] within it.

    ``position``, ``normal`` (n, 3) -> (n, 10).
    """
    low = position.min(axis=0)
    scaled = (position - low) / np.maximum(position.max(axis=0) - low, LEAST_RANGE)
    return np.concatenate([np.ones((len(position), 1)), normal, scaled, scaled**2], axis=-1)


def mirrored(index: Array, size: int) -> Array:
    """Pixels outside the image are mirrored at its edge, then limited to the image."""
    index = np.where(index < 0, -index - 1, index)
    index = np.where(index >= size, 2 * size - index - 1, index)
    return np.clip(index, 0, size - 1)


def block_regression(color: Array, position: Array, normal: Array, frame: int) -> Array:
    """Feature fitting: least-squares fit of the color in each block, evaluated without the noise, at least 0.

    ``color`` (h, w, 3); ``position`` (h, w, 4), w = 0 for sky, which keeps its color; ``normal`` (h, w, 3).
    -> (h, w, 3).
    """
    # Rows from the bottom, as in the shader: its noise and its blocks are numbered from there.
    color, position, normal = (np.asarray(v, dtype=np.float64)[::-1] for v in (color, position, normal))
    h, w = color.shape[:2]
    out = color.copy()
    left, down = block_offset(frame)
    for first_up in range(-down, h, BLOCK):
        for first in range(-left, w, BLOCK):
            up, x = (v.ravel() for v in np.mgrid[first_up : first_up + BLOCK, first : first + BLOCK])
            row, column = mirrored(up, h), mirrored(x, w)
            surface = position[row, column, 3] > 0
            if not surface.any():
                continue
            up, x, row, column = up[surface], x[surface], row[surface], column[surface]
            exact = block_features(position[row, column, :3], normal[row, column, :3])
            noisy = exact + 0.01 * feature_noise(x, up, frame)
            used = FEATURES if len(x) >= FEWEST else 1
            weights = np.linalg.lstsq(noisy[:, :used], color[row, column], rcond=None)[0]
            inside = (x >= 0) & (x < w) & (up >= 0) & (up < h)
            out[up[inside], x[inside]] = np.maximum(exact[inside, :used] @ weights, 0.0)
    return out[::-1]


def display_encoded(color: Array) -> Array:
    """Color -> color^(1 / 2.2); negative values become 0."""
    return np.maximum(color, 0.0) ** (1 / 2.2)


def display_decoded(color: Array) -> Array:
    """The inverse of ``display_encoded``."""
    return np.maximum(color, 0.0) ** 2.2
