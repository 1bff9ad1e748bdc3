"""RIS and ReSTIR DI in float64: references for ``methods/ris`` and ``methods/restir-di``.

Images have row 0 at the top.  Lights are punctual: rows of ``frame.lights.LIGHT``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from references import own_light
from references.stochastic import random4
from taubench_gl.metrics.stochastic import light_choice
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray


@dataclass(frozen=True)
class Moment:
    """One frame: ``surfaces`` (h, w) records, ``rows`` of lights, ``triangles`` (T, 3, 3), random numbers by n."""

    surfaces: Array
    rows: Array
    triangles: Array
    frame: int
    seed: int

    def random(self, n: int) -> Array:
        return random4(self.surfaces.shape[::-1], self.frame, self.seed, n)

    def reflected(self) -> Array:
        """Radiance of every light without shadow, (N, h, w, 3)."""
        return np.stack([own_light.reflected(self.surfaces, row) for row in self.rows])

    def visible(self) -> Array:
        """(N, h, w) bool."""
        return np.stack([~own_light.shadowed(self.surfaces, row, self.triangles) for row in self.rows])


@dataclass
class Reservoirs:
    """``light`` (h, w), -1: none; ``target``, ``sum`` of weights; ``count``: samples they stand for."""

    light: Array
    target: Array
    sum: Array
    count: Array

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> Reservoirs:
        return cls(np.full(shape, -1), np.zeros(shape), np.zeros(shape), np.zeros(shape))

    def offer(self, light: Array, target: Array, weight: Array, u: Array) -> Array:
        """Keep ``light`` with probability weight / sum.  -> where it was kept."""
        weight = np.where(weight > 0, weight, 0.0)
        self.sum = self.sum + weight
        kept = (weight > 0) & (u * self.sum < weight)
        self.light = np.where(kept, light, self.light)
        self.target = np.where(kept, target, self.target)
        return kept


def at_lights(values: Array, light: Array) -> Array:
    """``values`` (N, h, w, ...) of each pixel's light; 0 where it is -1."""
    y, x = np.indices(light.shape)
    picked = values[np.maximum(light, 0), y, x]
    return np.where((light >= 0).reshape(light.shape + (1,) * (picked.ndim - 2)), picked, 0)


def candidates(now: Moment, count: int) -> Reservoirs:
    """The winner of ``count`` light samples by luminance of reflected light over density (Talbot et al. 2005)."""
    targets = now.reflected() @ LUMINANCE
    choice = light_choice(now.rows["color"][:, :3].max(axis=-1))
    out = Reservoirs.empty(now.surfaces.shape)
    for k in range(count):
        u = now.random(k)
        light, density = own_light.sample_light(u, choice)
        target = at_lights(targets, light)
        out.offer(light, target, target / np.where(density > 0, density, 1.0), u[..., 3])
    return out


def ris(now: Moment, count: int) -> Array:
    """Direct light (h, w, 3): Eq. (5) of Talbot et al. 2005 with one shadow ray."""
    r = candidates(now, count)
    weight = np.where(r.target > 0, r.sum / (count * np.where(r.target > 0, r.target, 1.0)), 0.0)
    seen = at_lights(now.visible(), r.light)
    return at_lights(now.reflected(), r.light) * (weight * seen)[..., None]
