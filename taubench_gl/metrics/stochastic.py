"""The choice of a light by chance.  Reference for shaders/common/light_choice.glsl and pathtracing/light_cells.glsl."""

from __future__ import annotations

import math
from dataclasses import dataclass

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


CELL_UNIFORM_SHARE = 0.25
"""Share of a cell's probability that is uniform over the lights that reach it: importance knows no walls."""


@dataclass(frozen=True, slots=True)
class LightCells:
    """Cubic cells of a box, each with the lights that may shine into it and their probabilities.

    Many lights are chosen by what they bring to a cell of a grid (Shirley, Wang and Zimmerman, "Monte Carlo Techniques
    for Direct Lighting Calculations", ACM TOG 1996, section 5; Boksansky, Jukarainen and Wyman, "Rendering Many Lights
    with Grid-Based Reservoirs", Ray Tracing Gems II 2021).
    """

    low: Array  # (3,) float64, corner of the box
    side: float  # of a cell
    counts: tuple[int, int, int]  # of cells along each axis; the last axis varies fastest

    @classmethod
    def of_box(cls, low: Array, high: Array, most: int) -> LightCells:
        """At most ``most`` cells over the box from ``low`` to ``high`` (3,), with a margin: walls are its faces."""
        low, high = (np.asarray(corner, np.float64) for corner in (low, high))
        margin = max(0.01 * float(np.max(high - low)), 1e-6)
        size = high - low + 2.0 * margin
        side = float(np.prod(size) / most) ** (1.0 / 3.0)
        while np.prod(counts := np.ceil(size / side)) > most:
            side *= 1.02
        return cls(low - margin, side, tuple(int(n) for n in counts))

    def importance(
        self, positions: Array, power: Array, ranges: Array, faded: Array, extents: Array | float = 0.0
    ) -> Array:
        """What each light brings to each cell, (1 + cells, L) float64; 0 only where it cannot shine.

        ``positions`` (L, 3); ``power`` (L,): largest channel; ``ranges`` (L,): 0: unlimited; ``faded`` (L,) bool:
        whether it falls off with distance; ``extents`` (L,): square meters over which a light is spread.  Row 0 is of
        points outside of the box: power alone.  A cell: power times the range window at its nearest point, over the
        squared distance of its center, at least a quarter of its squared side, and at least the extent.
        """
        across = [
            low + self.side * (np.arange(count)[:, None] + 0.5) - at
            for low, count, at in zip(self.low, self.counts, np.transpose(positions), strict=True)
        ]
        out = np.empty((1 + math.prod(self.counts), len(power)))
        out[0] = power
        cells = out[1:].reshape(*self.counts, len(power))
        _sums_of_axes([x**2 for x in across], cells)  # squared distances of the centers, which the rest replaces
        np.maximum(cells, np.maximum(0.25 * self.side**2, extents), out=cells)
        cells[..., ~faded] = 1.0
        np.divide(1.0, cells, out=cells)
        cells *= power
        if (ranges > 0.0).any():
            nearest = _sums_of_axes([np.maximum(np.abs(x) - 0.501 * self.side, 0.0) ** 2 for x in across])
            window = 1.0 - (nearest / np.where(ranges > 0.0, ranges, np.inf) ** 2) ** 2
            cells *= np.clip(window, 0.0, 1.0)
        return out


def _sums_of_axes(parts: list[Array], out: Array | None = None) -> Array:
    """Sums of a number of each axis of a grid, ``parts`` (n, L) of each of three axes: (n0, n1, n2, L)."""
    x, y, z = parts
    return np.add(x[:, None, None] + y[:, None], z, out=out)


def cell_choice(importance: Array) -> tuple[Array, Array]:
    """First entry of each row of ``importance`` (n, L) >= 0 and the end, (n + 1,) int32; entries, (m, 2) float32.

    The entries of a row are its lights above 0, in order: cumulative probability and number of the light.  A light's
    probability is the difference of the *rounded* cumulative ones, as of ``light_choice``.
    """
    reached = importance > 0.0
    counts = np.count_nonzero(reached, axis=1)
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    scale = np.divide(1.0 - CELL_UNIFORM_SHARE, importance.sum(axis=1), out=np.zeros(len(counts)), where=counts > 0)
    share = importance * scale[:, None]
    share += reached * (CELL_UNIFORM_SHARE / np.maximum(counts, 1))[:, None]
    entries = np.empty((first[-1], 2), np.float32)
    entries[:, 0] = np.cumsum(share, axis=1, out=share)[reached]
    entries[first[1:][counts > 0] - 1, 0] = 1.0
    entries[:, 1] = np.broadcast_to(np.arange(importance.shape[1], dtype=np.float32), importance.shape)[reached]
    return first, entries
