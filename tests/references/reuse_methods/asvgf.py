"""A-SVGF (Schied, Peters, Dachsbacher 2018): temporal gradients of 3x3 blocks, and frames of SVGF adapted by them.

Arrays of blocks are (blocks y, blocks x, ...) with row 0 at the bottom, because blocks start at the bottom left pixel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from references.reuse_methods.history import sample_history, shifted
from references.reuse_methods.svgf import (
    KERNEL,
    LUMINANCE_FLOOR,
    EdgeStopping,
    depth_slope,
    inverse_depth,
    moments_variance,
)
from references.reuse_methods.svgf_frames import Svgf, new_weight
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray
BLOCK = 3


def gradient_budget(inputs: Mapping[str, Array], exposure: float) -> dict[str, Array]:
    """``inputs`` whose radiance and direct light are those of the gradient sample where there is one."""
    again = inputs["reshaded"][..., 3:] > 0.5
    light = {"radiance": inputs["reshaded"][..., :3] + exposure * inputs["emission"][..., :3],
             "direct": inputs["reshaded_direct"][..., :3]}  # fmt: skip
    return dict(inputs) | {name: np.where(again, rgb, inputs[name][..., :3]) for name, rgb in light.items()}


def gradient_samples(inputs: Mapping[str, Array], exposure: float = 1.0) -> tuple[Array, Array]:
    """Gradient, normalization and weight of every block, and mean and variance of the luminance of its pixels.

    gradient = luminance now - luminance then of a sample that is shaded again; normalization: the larger of both.
    ``inputs``: radiance, emission, reshaded, reshaded_before.  The luminance of the pixels is without emission.
     -> (m, n, 3), (m, n, 2).
    """
    now, then = (inputs[n][..., :3].astype(np.float64) @ LUMINANCE for n in ("reshaded", "reshaded_before"))
    sampled = inputs["reshaded"][..., 3] > 0.5
    sample = np.stack([now - then, np.maximum(now, then), np.ones_like(now)], axis=-1) * sampled[..., None]
    light = inputs["radiance"][..., :3].astype(np.float64) - exposure * inputs["emission"][..., :3]
    luminance = light @ LUMINANCE
    moments = _block_sums(np.stack([luminance, luminance**2, np.ones_like(luminance)], axis=-1))
    mean, square = moments[..., 0] / moments[..., 2], moments[..., 1] / moments[..., 2]
    return _block_sums(sample), np.stack([mean, moments_variance(mean, square)], axis=-1)


def _block_sums(values: Array) -> Array:
    """Sums over the pixels of each block.  (h, w, c), row 0 at the top -> (m, n, c), row 0 at the bottom."""
    h, w, c = values.shape
    m, n = -(-h // BLOCK), -(-w // BLOCK)
    wide = np.zeros((m * BLOCK, n * BLOCK, c))
    wide[:h, :w] = values[::-1]
    return wide.reshape(m, BLOCK, n, BLOCK, c).sum(axis=(1, 3))


def _of_blocks(values: Array) -> Array:
    """The values of the central pixels of the blocks.  (h, w, ...), row 0 at the top -> (m, n, ...)."""
    h, w = values.shape[:2]
    row = np.minimum(BLOCK * np.arange(-(-h // BLOCK)) + 1, h - 1)
    column = np.minimum(BLOCK * np.arange(-(-w // BLOCK)) + 1, w - 1)
    return values[::-1][row[:, None], column]


@dataclass(frozen=True)
class BlockEdges:
    """Edge stopping between blocks: that of SVGF between their central pixels, and by the luminance of the blocks."""

    inputs: Mapping[str, Array]
    luminance: Array  # (m, n, 2) mean and variance
    sigma_z: float = 1.0
    sigma_n: float = 128.0
    sigma_l: float = 4.0

    def weights(self, dx: int, dy: int) -> Array:
        """Between each block and the one at (dx, dy), rows up; 0 where that is outside.  -> (m, n)."""
        depth = self.inputs["position"][..., 3].astype(np.float64)
        slope = _of_blocks(depth_slope(inverse_depth(depth))) * [1, -1]  # rows up
        place = np.stack(np.meshgrid(*(np.arange(n) for n in depth.shape[::-1])), axis=-1)
        place = place * [1, -1] + [0, depth.shape[0] - 1]
        p, (q, _) = _of_blocks(place), shifted(_of_blocks(place), dx, dy)
        edges = EdgeStopping(
            _of_blocks(depth),
            _of_blocks(self.inputs["normal"][..., :3].astype(np.float64)),
            self.sigma_z,
            self.sigma_n,
            self.sigma_l,
        )
        other, exists = shifted(edges.depth, dx, dy)
        w = edges.geometry(other, shifted(edges.normal, dx, dy)[0], np.abs((slope * (q - p)).sum(axis=-1)))
        mean, variance = self.luminance[..., 0], self.luminance[..., 1]
        difference = np.abs(mean - shifted(mean, dx, dy)[0])
        return np.where(exists, w * np.exp(-difference / (self.sigma_l * np.sqrt(variance) + LUMINANCE_FLOOR)), 0.0)


def gradient_level(gradient: Array, edges: BlockEdges, level: int) -> Array:
    """One a-trous level over blocks with a sample; step 2^level blocks.

    ``gradient`` (m, n, 3): gradient, normalization, weight.  -> the same, weight 0 or 1.
    """
    sums = np.zeros_like(gradient)
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            step = 1 << level
            other, _ = shifted(gradient, step * dx, step * dy)
            w = edges.weights(step * dx, step * dy) * (KERNEL[abs(dx)] * KERNEL[abs(dy)]) * (other[..., 2] > 0)
            mean = other / np.where(other[..., 2] > 0, other[..., 2], 1.0)[..., None]
            sums += w[..., None] * mean
    return sums / np.where(sums[..., 2] > 0, sums[..., 2], 1.0)[..., None]


def gradient_lambda(gradient: Array, size: tuple[int, int]) -> Array:
    """lambda = min(1, |gradient| / normalization), bilinear between the centers of the blocks.

    ``size`` (width, height).  -> (h, w), row 0 at the top.
    """
    w, h = size
    up = np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1)
    g = sample_history(gradient, (up - 1.0) / BLOCK)[::-1]
    return np.where(g[..., 1] > 0, np.minimum(np.abs(g[..., 0]) / np.where(g[..., 1] > 0, g[..., 1], 1.0), 1.0), 0.0)


def adaptive_weight(weight: Array, change: Array) -> Array:
    """alpha' = (1 - lambda) alpha + lambda.  (h, w) each."""
    return (1.0 - change) * weight + change


@dataclass
class Asvgf(Svgf):
    """Frames of A-SVGF in order."""

    gradient_budget: bool = True
    gradient_levels: int = 5

    def frame(self, inputs: Mapping[str, Array], prev_forward: Array, exposure: float = 1.0) -> Array:
        if self.gradient_budget:
            inputs = gradient_budget(inputs, exposure)
        gradient, luminance = gradient_samples(inputs, exposure)
        edges = BlockEdges(inputs, luminance, self.sigma_z, self.sigma_n, self.sigma_l)
        for level in range(self.gradient_levels):
            gradient = gradient_level(gradient, edges, level)
        h, w = inputs["radiance"].shape[:2]
        self._change = gradient_lambda(gradient, (w, h))
        return super().frame(inputs, prev_forward, exposure)

    def new_frame_weights(self, frames: Array, alive: Array) -> tuple[Array, Array, Array]:
        one = np.ones_like(frames)
        light, moments = (
            adaptive_weight(new_weight(frames + 1.0, alive, alpha), np.where(alive, self._change, one))
            for alpha in (self.alpha, self.alpha_moments)
        )
        return (1.0 - self._change) * frames, light, moments
