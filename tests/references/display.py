"""Channels as display images, in float64.  Reference for shaders/viewer/display.frag.glsl."""

from __future__ import annotations

import numpy as np

from taubench_gl.metrics.display import BACKGROUND, SCALE
from taubench_gl.srgb import srgb_encode

Array = np.ndarray


def color_scale(t: Array) -> Array:
    """The scalar color scale at t in [0, 1] (clipped).  (...) -> (..., 3)."""
    x = np.clip(t, 0.0, 1.0) * (len(SCALE) - 1)
    i = np.minimum(np.floor(x).astype(int), len(SCALE) - 2)
    f = (x - i)[..., None]
    return SCALE[i] * (1.0 - f) + SCALE[i + 1] * f


def hue(turn: Array) -> Array:
    """Saturated colors of the hue circle, ``turn`` in [0, 1).  (...) -> (..., 3)."""
    return np.clip(np.abs(np.mod(turn[..., None] * 6.0 + np.array([0.0, 4.0, 2.0]), 6.0) - 3.0) - 1.0, 0.0, 1.0)


def id_color(ids: Array) -> Array:
    """One color per id, black for 0.  (...) uint32 -> (..., 3)."""
    x = np.asarray(ids, dtype=np.uint64)
    x = (x * 2654435761) & 0xFFFFFFFF
    parts = np.stack([x & 255, (x >> 8) & 255, (x >> 16) & 255], axis=-1) / 255.0
    return np.where((np.asarray(ids) == 0)[..., None], 0.0, 0.25 + 0.75 * parts)


def channel_rgb(kind: str, values: Array, low: float, high: float, *, position: Array | None = None) -> Array:
    """Display colors in [0, 1] of a channel.  ``values`` (h, w, n), ``position`` (h, w, 4) -> (h, w, 3).

    ``motion`` is in pixels, +y up as in GPU memory.  Values that are not finite become magenta.  Raises KeyError for
    an unknown kind.
    """
    values = np.asarray(values, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        out = _COLOR[kind](values, low, max(high - low, 1e-12), position)
    if kind not in ("encoded", "radiance", "ids", "motion") and position is not None:
        out = np.where((position[..., 3] > 0)[..., None] | ~np.isfinite(position[..., 3:]), out, BACKGROUND)
    bad = ~np.isfinite(values[..., :3]).all(axis=-1)
    return np.where(bad[..., None], np.array([1.0, 0.0, 1.0]), np.clip(out, 0.0, 1.0))


def outline(selected: Array) -> Array:
    """Pixels beside one in the other state, by their four neighbors.  (h, w) bool -> (h, w) bool.

    Reference for shaders/viewer/outline.frag.glsl.
    """
    padded, out = np.pad(selected, 1, mode="edge"), np.zeros_like(selected)
    for x, y in ((0, 1), (2, 1), (1, 0), (1, 2)):
        out |= padded[y : y + selected.shape[0], x : x + selected.shape[1]] != selected
    return out


def _headlight(values: Array, low: float, span: float, position: Array) -> Array:
    ray = position[..., :3]
    length = np.linalg.norm(ray, axis=-1)
    facing = np.abs(np.sum(values[..., :3] * ray, axis=-1)) / np.where(length > 0, length, 1.0)
    return np.repeat((0.25 + 0.75 * facing)[..., None], 3, axis=-1)


def _motion(values: Array, low: float, span: float, position: Array | None) -> Array:
    turn = np.mod(np.arctan2(values[..., 1], values[..., 0]) / (2 * np.pi), 1.0)
    length = np.hypot(values[..., 0], values[..., 1])
    strength = np.where(length > 0, np.clip((length - low) / span, 0.0, 1.0), 0.0)  # zero motion has no direction
    return hue(turn) * strength[..., None]


_COLOR = {
    "encoded": lambda v, low, span, p: v[..., :3],
    "radiance": lambda v, low, span, p: srgb_encode(np.clip((v[..., :3] - low) / span, 0.0, 1.0)),
    "headlight": _headlight,
    "unit": lambda v, low, span, p: 0.5 + 0.5 * v[..., :3],
    "vector": lambda v, low, span, p: (v[..., :3] - low) / span,
    "depth": lambda v, low, span, p: color_scale((v[..., 3] - low) / span),
    "ids": lambda v, low, span, p: id_color(v[..., 0].astype(np.uint32)),
    "motion": _motion,
    "object_motion": lambda v, low, span, p: color_scale((v[..., 0] - low) / span),
}


def overlay_mask(image: Array, mask: Array, bits: Array, colors: Array, opacity: float, stripe: int = 4) -> Array:
    """Mask colors over an image, striped where a pixel has several bits.

    ``image`` (h, w, 3), ``mask`` (h, w) uint32, ``bits`` (K,) uint32, ``colors`` (K, 3) in [0, 1] -> (h, w, 3).
    """
    out = np.array(image, dtype=np.float64)
    if not len(bits):
        return out
    hits = np.stack([(mask & np.uint32(bit)) != 0 for bit in bits])
    rows, columns = np.indices(mask.shape)
    turn = ((rows + columns) // stripe) % np.maximum(hits.sum(axis=0), 1)
    place = np.cumsum(hits, axis=0) - 1
    for hit, where, color in zip(hits, place, np.asarray(colors), strict=True):
        chosen = hit & (where == turn)
        out[chosen] = (1.0 - opacity) * out[chosen] + opacity * color
    return out
