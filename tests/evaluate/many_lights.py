"""Many shadowed lights over a floor, without OpenGL: the direct light of a point in closed form, and samples of it.

Light j is a lamp at height ``HEIGHT`` over ``x_j``.  A wall hides it from all points left of an edge, which moves from
frame to frame.  The camera stands still: the history of a pixel is the pixel.
"""

from __future__ import annotations

import numpy as np
from fixed import fixed_settings

from taubench_gl.evaluation.decided_light import counts_of_images
from taubench_gl.evaluation.decided_pixels import DecidedPixels, PreviewPair
from taubench_gl.evaluation.sampled_light import round_of
from taubench_gl.features import FEATURE_BIT
from taubench_gl.metrics.counts import Counts
from taubench_gl.metrics.pair_sample import sample_pairs
from taubench_gl.metrics.pixel_sample import Interval, PixelStrata
from taubench_gl.metrics.sampled_light import STRATA, LightEstimate, SampledPixels, draw_pixels, strata_of

SIZE = (64, 36)
LIGHTS, PAIRS, LIMIT = 100, 6, 0.5
HEIGHT, WIDTH = 0.4, 8.0
DIRECT = np.uint32(FEATURE_BIT["direct"])


class ManyLights:
    """Points of the floor, lights and edges.  ``radiance(frame)``: (pixels, lights) float64 of each light alone."""

    def __init__(self, seed: int = 5):
        rng = np.random.default_rng(seed)
        pixels = SIZE[0] * SIZE[1]
        self.points = np.stack([rng.uniform(0.0, WIDTH, pixels), rng.uniform(0.0, 2.0, pixels)], axis=-1)
        self.lights = np.stack([rng.uniform(0.0, WIDTH, LIGHTS), rng.uniform(0.0, 2.0, LIGHTS)], axis=-1)
        self.power = rng.lognormal(0.0, 1.0, LIGHTS) * 0.12
        self.chance = 0.5 / LIGHTS + 0.5 * self.power / self.power.sum()  # of each light in a sample
        self.edges = rng.uniform(-0.5, 0.5, LIGHTS) + np.cumsum(rng.normal(0.0, 0.1, (PAIRS + 1, LIGHTS)), axis=0)

    def radiance(self, frame: int) -> np.ndarray:
        away = self.points[:, None] - self.lights[None]
        seen = away[..., 0] > self.edges[frame]
        return np.where(seen, self.power * HEIGHT / ((away**2).sum(axis=-1) + HEIGHT**2) ** 1.5, 0.0)

    def distances(self, frame: int) -> np.ndarray:
        """Distance of direct light between ``frame`` - 1 and ``frame``.  (pixels,) float64."""
        change = self.radiance(frame).sum(axis=1) - self.radiance(frame - 1).sum(axis=1)
        return np.sqrt(3.0) * np.abs(change)


class SampledLights:
    """In the place of a source: each sample is one light, half by power, the same one in both frames of a pixel."""

    listed_lobes, eye = ("direct_diffuse", "indirect_diffuse"), None

    def __init__(self, scene: ManyLights, seed: int):
        self._scene, self._seed = scene, seed

    def draw(self, frame: int) -> None:
        self._radiance = self._scene.radiance(frame) / self._scene.chance

    def draw_history(self, frame: int) -> None:
        self.draw(frame - 1)

    def listed_light(self, frame, pixels, keys, samples, *, drawn, parts):
        number = np.uint64(keys[:, 1] * SIZE[0] + keys[:, 0])[:, None] * np.uint64(1 << 20) + np.arange(
            samples.start, samples.stop, dtype=np.uint64
        )
        for multiplier in (0xBF58476D1CE4E5B9, 0x94D049BB133111EB):  # SplitMix64's mixing
            number = (number + np.uint64(self._seed * 0x9E3779B97F4A7C15 % 2**64)) * np.uint64(multiplier)
            number ^= number >> np.uint64(31)
        uniform = (number >> np.uint64(11)) * 2.0**-53
        light = np.minimum(np.searchsorted(np.cumsum(self._scene.chance), uniform), LIGHTS - 1)
        value = self._radiance[(pixels[:, 1] * SIZE[0] + pixels[:, 0])[:, None], light]
        out = np.zeros((*value.shape, 2, 3))
        out[..., 0, :] = value[..., None]
        return out


def decided_pixels(scene: ManyLights, seed: int) -> DecidedPixels:
    sources = iter([SampledLights(scene, seed) for _ in range(2)])
    settings = fixed_settings(width=SIZE[0], height=SIZE[1], thresholds={"direct": LIMIT}, exposure=1.0, light="auto")
    return DecidedPixels(lambda *_, **__: next(sources), settings, ("direct",))


def preview_of(scene: ManyLights, frame: int, shown: int) -> PreviewPair:
    """A preview that knows the first ``shown`` lights only."""
    change = (scene.radiance(frame) - scene.radiance(frame - 1))[:, :shown].sum(axis=1)
    distance = (np.sqrt(3.0) * np.abs(change)).reshape(SIZE[::-1]).astype(np.float32)
    words = np.where(distance > LIMIT, DIRECT, np.uint32(0))
    across, down = np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float))
    surface = np.full(words.shape, True)
    return PreviewPair(frame, words, {"direct": distance}, np.stack([across, down], -1), (surface, surface), None, None)


def counts_of_preview(pair: PreviewPair) -> Counts:
    return counts_of_images(pair.words, pair.distances)


def estimate(scene: ManyLights, seed: int, within: float, limit: int) -> tuple[LightEstimate, dict[tuple, Interval]]:
    """Rounds of sampled light as of a run with ``seed``, until the intervals are within ``within`` points."""
    pixels = decided_pixels(scene, seed)
    light = LightEstimate(("direct",), {"direct": LIMIT}, False, within)
    pairs = [preview_of(scene, frame, LIGHTS // 2) for frame in range(1, PAIRS + 1)]
    for position, pair in enumerate(pairs):
        light.add_preview(position, counts_of_preview(pair))
    sample, rounds, narrow = sample_pairs(PAIRS, "all"), 0, False
    while not narrow:
        for position, number in round_of(rounds, PAIRS, seed):
            pair = pairs[position]
            strata = PixelStrata.of(
                strata_of(pair.words, pair.distances, light.thresholds, pair.traced), STRATA, (seed, position)
            )
            flat, stratum = draw_pixels(strata, number, 128)
            pixels.draw(pair)
            at = np.stack([flat % SIZE[0], flat // SIZE[0]], axis=-1)
            audit = np.random.default_rng([seed, position, number]).random(len(flat))
            found = pixels.decide(at, limit, audit, halves=True)
            sampled = SampledPixels(
                stratum, pair.words.ravel()[flat], {"direct": pair.distances["direct"].ravel()[flat].astype(float)},
                found.first, found.end, found.audited,
            )  # fmt: skip
            light.add(light.visit(position, strata.sizes, sampled, found.undecided, found.samples))
        rounds += 1
        intervals = light.intervals(sample)
        narrow = light.narrow(intervals)
    return light, intervals
