"""The bound of methods that blend a frame with reprojected history, and how much of the history they use.

A pixel has three colors, linear radiance (..., 3): the input I of this frame, the history H that the method fetched
along the motion, and the result P.  A method blends if P = I + w (H - I) with one weight w in [0, 1] for all channels:
P is on the segment from I to H.  No point of the segment is nearer to the reference R than the projection of R on it,
so no such method can have a smaller squared error, in any pixel, than I + w* (H - I) with w* of ``nearest_weight``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import numpy as np

Array = np.ndarray

ON_SEGMENT = 1e-5
"""A result is on the segment within this share of its largest color: a few roundings of float32, also after YCoCg."""


def channels(operation: Callable[[Array, Array], Array], values: Array) -> Array:
    """``operation``, such as ``np.add``, over the last axis of (..., c).

    NumPy's reduction has the same order and takes 16 times as long for three channels.
    """
    return reduce(operation, np.moveaxis(values, -1, 0))


def nearest_weight(reference: Array, now: Array, history: Array) -> Array:
    """w* = clamp(<R - I, H - I> / <H - I, H - I>, 0, 1); 0 where H equals I.  (..., 3) each -> (...) float64."""
    reference, now, history = (np.asarray(x, dtype=np.float64) for x in (reference, now, history))
    direction = history - now
    square = channels(np.add, direction**2)
    along = channels(np.add, (reference - now) * direction)
    return np.clip(np.divide(along, square, out=np.zeros_like(square), where=square > 0), 0.0, 1.0)


def nearest_clipped_weight(reference: Array, now: Array, history: Array, white: float, weight: Array) -> Array:
    """The weight w in [0, 1] for which min(I + w (H - I), ``white``) is nearest to min(R, ``white``).

    (n, m, 3) each, and ``weight`` (n, m) of ``nearest_weight`` -> (n, m) float64.  Between the weights at which a
    channel crosses white, the squared error is a parabola in w; the smallest of its minima is that of all weights.
    """
    # Clipping changes nothing elsewhere.
    bright = channels(np.logical_or, np.maximum(np.maximum(now, history), reference) > white)
    reference, now, history = (np.asarray(x[bright], dtype=np.float64) for x in (reference, now, history))
    weight = weight.copy()
    weight[bright] = _least_of_parts(np.minimum(reference, white), now, history, white)
    return weight


def _least_of_parts(reference: Array, now: Array, history: Array, white: float) -> Array:
    """``nearest_clipped_weight`` of (k, 3) colors and a clipped reference -> (k,)."""
    direction = history - now
    crossing = np.divide(white - now, direction, out=np.zeros_like(now), where=direction != 0.0)
    ends = np.clip(np.pad(crossing, ((0, 0), (1, 1)), constant_values=(0.0, 1.0)), 0.0, 1.0)
    ends.sort(axis=-1)
    best, least = np.zeros(len(now)), np.full(len(now), np.inf)
    for low, high in zip(ends.T, ends.T[1:], strict=False):
        varies = direction * (blend(now, history, 0.5 * (low + high)) < white)
        square, along = channels(np.add, varies**2), channels(np.add, (reference - now) * varies)
        weight = np.clip(np.divide(along, square, out=low.copy(), where=square > 0.0), low, high)
        error = channels(np.add, (np.minimum(blend(now, history, weight), white) - reference) ** 2)
        best, least = np.where(error < least, weight, best), np.minimum(error, least)
    return best


def blend(now: Array, history: Array, weight: Array) -> Array:
    """I + w (H - I).  (..., 3), (..., 3), (...) -> (..., 3) float64."""
    now = np.asarray(now, dtype=np.float64)
    return now + np.asarray(weight, dtype=np.float64)[..., None] * (np.asarray(history, dtype=np.float64) - now)


def on_segment(result: Array, now: Array, history: Array) -> Array:
    """Whether a result is a blend of input and history, up to rounding (ON_SEGMENT).  (..., 3) each -> (...) bool."""
    off = result - blend(now, history, nearest_weight(result, now, history))
    largest = channels(np.maximum, reduce(np.maximum, (np.abs(x) for x in (result, now, history))))
    distance = np.sqrt(channels(np.add, off**2))
    return distance <= ON_SEGMENT * largest + 1e-9


def effective_weight(weight: Array, now: Array, fetched: Array, used: Array) -> Array:
    """The weight of history less what rectification replaced.  (...), 3 x (..., 3) -> (...) float64 in [0, ``weight``].

    w (1 - min(1, |H' - H| / |H - I|)), H the fetched and H' the used history: w where H' = H, 0 where rectification
    moved the history as far as the input is away, such as onto the input.  Where H = I there is nothing to lose: w.
    """
    now, fetched, used = (np.asarray(x, dtype=np.float64) for x in (now, fetched, used))
    moved, away = (np.sqrt(channels(np.add, x**2)) for x in (used - fetched, fetched - now))
    moved = np.maximum(moved - ON_SEGMENT * channels(np.maximum, np.abs(fetched)), 0.0)  # rounding is no rectification
    share = np.divide(moved, away, out=np.zeros_like(away), where=away > 0)
    return np.asarray(weight, dtype=np.float64) * (1.0 - np.minimum(share, 1.0))


def used_history(result: Array, now: Array, fetched: Array, weight: Array) -> Array:
    """H' = I + (P - I) / w, the history that a blend with weight w used; the fetched one where w is 0.

    (..., 3) x 3, (...) -> (..., 3) float64.
    """
    result, now, fetched = (np.asarray(x, dtype=np.float64) for x in (result, now, fetched))
    weight = np.asarray(weight, dtype=np.float64)[..., None]
    return np.where(weight > 0, now + (result - now) / np.where(weight > 0, weight, 1.0), fetched)
