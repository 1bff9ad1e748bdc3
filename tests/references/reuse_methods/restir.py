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


def pair_share(others: Array, theirs: Array, count: Array, target: Array) -> Array:
    """Share of a sample of ``target`` and ``count`` that a pair leaves to the other reservoirs."""
    total = others * theirs + count * target
    return others * theirs / np.where(total > 0, total, 1.0)


FIRST_TEMPORAL, FIRST_SPATIAL = 256, 272
"""Random numbers of the passes after the candidates."""


@dataclass(frozen=True)
class Kept:
    """Reservoirs of ReSTIR (h, w): ``light``, W ``weight``, M ``count``."""

    light: Array
    weight: Array
    count: Array

    def at(self, y: Array, x: Array) -> Kept:
        return Kept(self.light[y, x], self.weight[y, x], self.count[y, x])


@dataclass(frozen=True)
class Restir:
    """The method with its settings; see ``methods/restir-di``."""

    candidates: int = 32
    history_limit: int = 20
    neighbors: int = 3
    rounds: int = 1
    radius: float = 0.0278
    visibility_reuse: bool = False
    combination: str = "pairwise"

    def frame(self, now: Moment, before: Moment | None, past: Kept | None, at: Array, reusable: Array):
        """Direct light (h, w, 3) and the reservoirs of the next frame.

        ``at`` (h, w, 2): column and row of each pixel's history; ``reusable`` (h, w): whether there is any.
        """
        targets, seen = now.reflected() @ LUMINANCE, now.visible()
        kept = self.initial(now, seen)
        kept = self.temporal(now, before, kept, past, at, reusable, targets, seen)
        for turn in range(self.rounds if self.neighbors else 0):
            kept = self.spatial(now, kept, targets, seen, turn)
        visible = at_lights(seen, kept.light)
        light = at_lights(now.reflected(), kept.light) * (kept.weight * visible)[..., None]
        if self.visibility_reuse and self.combination != "biased":
            kept = Kept(kept.light, np.where(visible, kept.weight, 0.0), kept.count)
        return light, kept

    def initial(self, now: Moment, seen: Array) -> Kept:
        r = candidates(now, self.candidates)
        lit = now.surfaces["position"][..., 3] > 0
        weight = np.where(r.target > 0, r.sum / np.where(r.target > 0, self.candidates * r.target, 1.0), 0.0)
        if self.visibility_reuse:
            weight = np.where(at_lights(seen, r.light), weight, 0.0)
        return Kept(r.light, weight, np.where(lit, float(self.candidates), 0.0))

    @property
    def pairwise(self) -> bool:
        return self.combination == "pairwise"

    def closed(self, r: Reservoirs, z: Array, here: Array) -> Kept:
        z = {"biased": r.count, "unbiased": np.where(here, z, 0.0), "pairwise": np.ones(r.sum.shape)}[self.combination]
        good = (z > 0) & (r.target > 0)
        return Kept(r.light, np.where(good, r.sum / np.where(good, z * r.target, 1.0), 0.0), r.count)

    def could_hold(self, targets: Array, seen: Array) -> Array:
        """Target of every light for a reservoir that holds no other, (N, h, w)."""
        return targets * seen if self.visibility_reuse else targets

    def temporal(self, now, before, fresh: Kept, past: Kept | None, at, reusable, targets: Array, seen: Array) -> Kept:
        lit = now.surfaces["position"][..., 3] > 0
        if past is None:
            old = Kept(np.full(lit.shape, -1), np.zeros(lit.shape), np.zeros(lit.shape))
        else:
            x, y = np.moveaxis(at, -1, 0)
            inside = (x >= 0) & (y >= 0) & (x < lit.shape[1]) & (y < lit.shape[0])
            x, y = np.clip(x, 0, lit.shape[1] - 1), np.clip(y, 0, lit.shape[0] - 1)
            old, good = past.at(y, x), inside & reusable & lit
            count = np.where(good, np.minimum(old.count, self.history_limit * fresh.count), 0.0)
            old = Kept(np.where(good, old.light, -1), np.where(good, old.weight, 0.0), count)
        u = now.random(FIRST_TEMPORAL)
        r, own = Reservoirs.empty(lit.shape), np.zeros(lit.shape, dtype=bool)
        here = self.could_hold(targets, seen) if self.pairwise else targets
        there = self.could_hold(before.reflected() @ LUMINANCE, before.visible())[:, y, x] if past is not None else here
        weights = fresh.count, old.count
        if self.pairwise:
            shares = (pair_share(old.count, at_lights(there, k.light), fresh.count, at_lights(here, k.light))
                      for k in (fresh, old))  # fmt: skip
            weights = 1.0 - next(shares), next(shares)
        for number, (kept, weight) in enumerate(zip((fresh, old), weights)):
            target = at_lights(here, kept.light)
            taken = r.offer(kept.light, target, target * kept.weight * weight, u[..., number])
            own = np.where(taken, number == 0, own)
        r.count = fresh.count + old.count
        here = own | at_lights(seen, r.light) if self.visibility_reuse else np.ones(lit.shape, dtype=bool)
        z = np.where(here, fresh.count, 0.0)
        if past is not None:
            held = at_lights((before.reflected() @ LUMINANCE > 0)[:, y, x], r.light)
            if self.visibility_reuse:
                held = held & (~own | at_lights(before.visible()[:, y, x], r.light))
            z = z + np.where(held, old.count, 0.0)
        return self.closed(r, z, here)

    def neighbor(self, now: Moment, turn: int, i: int) -> tuple[Array, Array, Array]:
        """Row and column of neighbor ``i``, clipped, and whether its surface is similar."""
        h, w = now.surfaces.shape
        y, x = np.indices((h, w))
        if i == 0:
            return y, x, np.ones((h, w), dtype=bool)
        u = now.random(FIRST_SPATIAL + 16 * turn + i)
        angle, length = 2 * np.pi * u[..., 1], max(self.radius * h, 2.0) * np.sqrt(u[..., 0])
        x = x + np.floor(length * np.cos(angle) + 0.5).astype(int)
        y = y - np.floor(length * np.sin(angle) + 0.5).astype(int)  # rows of images go down
        inside = (x >= 0) & (y >= 0) & (x < w) & (y < h)
        x, y = np.clip(x, 0, w - 1), np.clip(y, 0, h - 1)
        here, there = now.surfaces, now.surfaces[y, x]
        depth, other = (np.linalg.norm(s["position"][..., :3].astype(np.float64), axis=-1) for s in (here, there))
        facing = np.sum(here["normal"][..., :3].astype(np.float64) * there["normal"][..., :3], axis=-1)
        good = (facing > np.cos(np.radians(25.0))) & (np.abs(depth - other) < 0.1 * depth)
        return y, x, inside & (there["position"][..., 3] > 0) & good

    def spatial(self, now: Moment, kept: Kept, targets: Array, seen: Array, turn: int) -> Kept:
        lit = now.surfaces["position"][..., 3] > 0
        r, origin, places = Reservoirs.empty(lit.shape), np.full(lit.shape, -1), []
        for i in range(self.neighbors + 1):
            y, x, good = self.neighbor(now, turn, i)
            places.append((y, x, good, np.where(good, kept.count[y, x], 0.0)))
        others = sum(count for *_, count in places[1:])
        here = self.could_hold(targets, seen) if self.pairwise else targets
        share_of_own = np.ones(lit.shape) if self.pairwise else kept.count
        for i in (*range(1, self.neighbors + 1), 0):
            y, x, good, count = places[i]
            there, share = kept.at(y, x), count if i else share_of_own
            target = at_lights(here, there.light)
            if self.pairwise and i:
                theirs, part = self.could_hold(targets, seen)[:, y, x], count / np.where(others > 0, others, 1.0)
                share = part * pair_share(others, at_lights(theirs, there.light), kept.count, target)
                lost = pair_share(others, at_lights(theirs, kept.light), kept.count, at_lights(here, kept.light))
                share_of_own = share_of_own - part * lost
            u = now.random(FIRST_SPATIAL + 16 * turn + i)[..., 2]
            origin = np.where(r.offer(there.light, target, target * there.weight * share, u), i, origin)
            r.count = r.count + count
        z, here = np.zeros(lit.shape), None
        for i, (y, x, good, count) in enumerate(places):
            held = good & at_lights(targets[:, y, x] > 0, r.light)
            if self.visibility_reuse:
                held = held & ((origin == i) | at_lights(seen[:, y, x], r.light))
            z, here = z + np.where(held, count, 0.0), held if here is None else here
        out = self.closed(r, z, here)
        return Kept(*(np.where(lit, getattr(out, n), getattr(kept, n)) for n in ("light", "weight", "count")))
