"""Rejection tests in float64: what each compares with its threshold.  Reference for taubench_gl/reject/tests.

Arrays have one row per pixel, (K,) or (K, n); names as in ``shaders/reject/contract.glsl``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from references.reuse_methods.history import shifted

Array = np.ndarray


@dataclass(frozen=True)
class PointRows:
    """``Point`` of the contract, one row per pixel."""

    position: Array
    depth: Array
    normal: Array
    facing: Array
    object: Array
    motion: Array
    radiance: Array | None = None


@dataclass(frozen=True)
class PixelRows:
    """``Pixel`` of the contract; ``low``, ``high``: box of the radiance in the 3x3 neighborhood."""

    depth_gradient: Array
    normal_change: Array
    footprint: Array
    image_height: Array
    cosine: Array
    low: Array | None = None
    high: Array | None = None


def _distance(a: Array, b: Array) -> Array:
    return np.linalg.norm(a - b, axis=-1)


def _off_plane(now: PointRows, history: PointRows) -> Array:
    return np.abs(np.sum((history.position - now.position) * now.facing, axis=-1))


def _svgf(now: PointRows, history: PointRows, pixel: PixelRows, s: Mapping[str, float]) -> Array:
    change = np.abs(pixel.depth_gradient).sum(axis=-1)
    depth = np.abs(history.depth - now.depth) / (change + s["bias"])
    normal = _distance(now.normal, history.normal) / (pixel.normal_change + s["bias"])
    return np.maximum(depth / s["depth_changes"], normal / s["normal_changes"])


def _footprint_depth(now: PointRows, history: PointRows, pixel: PixelRows, s: Mapping[str, float]) -> Array:
    change = np.abs(pixel.depth_gradient).sum(axis=-1)
    return np.abs(history.depth - now.depth) / (change + s["least"] * now.depth)


def _color_clamp(now: PointRows, history: PointRows, pixel: PixelRows, s: Mapping[str, float]) -> Array:
    return _distance(history.radiance, np.clip(history.radiance, pixel.low, pixel.high))


REFERENCES: Mapping[str, Callable[[PointRows, PointRows, PixelRows, Mapping[str, float]], Array]] = {
    "position": lambda now, history, pixel, s: _distance(now.position, history.position),
    "normal": lambda now, history, pixel, s: _distance(now.normal, history.normal),
    "normal_dot": lambda now, history, pixel, s: np.maximum(1.0 - np.sum(now.normal * history.normal, axis=-1), 0.0),
    "relative_depth": lambda now, history, pixel, s: np.abs(history.depth - now.depth) / now.depth,
    "svgf": _svgf,
    "plane_distance": lambda now, history, pixel, s: (
        _off_plane(now, history) * np.maximum(pixel.cosine, 0.05) / pixel.image_height
    ),
    "object_id": lambda now, history, pixel, s: (now.object != history.object).astype(np.float64),
    "velocity": lambda now, history, pixel, s: _distance(now.motion, history.motion),
    "footprint_position": lambda now, history, pixel, s: (
        _distance(now.position, history.position) * np.maximum(pixel.cosine, s["least_cosine"]) / pixel.footprint
    ),
    "footprint_plane": lambda now, history, pixel, s: _off_plane(now, history) / pixel.footprint,
    "footprint_depth": _footprint_depth,
    "color_clamp": _color_clamp,
}
"""Built-in test -> (now, history, pixel, settings) -> (K,) float64."""


def smaller_change(values: Array, surface: Array, axis: int) -> Array:
    """Signed change of ``values`` (h, w, ...) to the next pixel up (axis 0) or right (axis 1): the smaller.

    Only to neighbors with a ``surface`` (h, w); 0 without one.  Row 0 is the top.
    """
    best = np.full(values.shape, np.inf)
    for side in (1, -1):
        other, there = _beside(values, surface, axis, side)
        change = side * (other - values)
        best = np.where(there & (np.abs(change) < np.abs(best)), change, best)
    return np.where(np.isfinite(best), best, 0.0)


def _beside(values: Array, surface: Array, axis: int, side: int) -> tuple[Array, Array]:
    """``values`` of the next pixel up (axis 0; -``side``: down) or right, and whether that is a surface (h, w)."""
    offset = (side, 0) if axis == 1 else (0, -side)  # up is towards row 0
    (other, exists), (there, _) = shifted(values, *offset), shifted(surface, *offset)
    return other, there & exists


def smaller_turn(normal: Array, surface: Array, axis: int) -> Array:
    """As ``smaller_change``, of the distance between unit normals (h, w, 3).  (h, w)."""
    best = np.full(surface.shape, np.inf)
    for side in (1, -1):
        other, there = _beside(normal, surface, axis, side)
        best = np.where(there, np.minimum(best, _distance(other, normal)), best)
    return np.where(np.isfinite(best), best, 0.0)
