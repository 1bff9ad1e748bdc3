"""Statistics of light that is estimated at random pixels, against closed forms and sums over all pixels."""

from __future__ import annotations

import math
from itertools import combinations, product

import numpy as np
import pytest
from scipy.stats import t as student

from taubench_gl.conventions import HISTOGRAM_BINS, Reason
from taubench_gl.features import FEATURE_BIT, FEATURES, LIGHT_FEATURES, MASK_WORDS, RADIANCE_FEATURES
from taubench_gl.metrics.counts import Counts, bin_of, edges
from taubench_gl.metrics.pair_sample import PairSample, sample_pairs
from taubench_gl.metrics.path_samples import LEAST, LIMIT, PARTS, part_table
from taubench_gl.metrics.pixel_sample import NORMAL_95, PixelStrata, SampledPair, estimate_share, pair_differences
from taubench_gl.metrics.sampled_light import (
    STRATA,
    LightEstimate,
    PixelMasks,
    SampledPixels,
    draw_pixels,
    lobe_distance,
    strata_of,
)

Array = np.ndarray


def test_samples_of_a_part_are_stratified():
    """Every part has one value in each equal interval of each dimension, after the least and after all samples."""
    words, start, end = [[] for _ in range(PARTS)], 0, LEAST
    while start < LIMIT:  # as a pixel gets them
        for part, rows in enumerate(np.split(part_table(start, end - start), PARTS)):
            words[part].append(rows)
        start, end = end, 2 * end
        if start == LEAST:
            first = np.stack([np.concatenate(of_part) for of_part in words])
    table = np.stack([np.concatenate(of_part) for of_part in words]).reshape(PARTS, LIMIT // PARTS, -1)
    for numbers in (first.reshape(PARTS, LEAST // PARTS, -1), table):
        cells = np.sort((numbers.astype(np.uint64) * np.uint64(numbers.shape[1])) >> np.uint64(32), axis=1)
        assert (cells == np.arange(numbers.shape[1], dtype=np.uint64)[None, :, None]).all()
    assert not any(np.array_equal(table[a], table[b]) for a, b in combinations(range(PARTS), 2))
    assert np.array_equal(part_table(40, 100), part_table(0, 140)[40:])


def test_half_widths_of_two_stages():
    """Cochran, Sampling Techniques, Eq. 10.14; degrees of freedom by Satterthwaite; rule of three."""
    sample, visited = PairSample(10, ((10, (0, 3, 4, 8)),)), [0, 2, 3]
    known, base = np.array([0.10, 0.30, 0.20, 0.40]), np.array([0.9, 0.8, 0.6, 0.7])
    d, within = np.array([0.01, 0.06, 0.05]), np.array([1e-4, 3e-4, 2e-4])
    t3, t2 = 3.182446305284263, 4.302652729749464  # of 3 and 2 degrees of freedom, 97.5 %
    mean = (0.25 + 0.04) / 0.75
    left = known - mean * base
    between, inner = 0.0007, 2e-4
    covariance = float((known[visited] - 0.7 / 3) @ (d - 0.04)) / 2
    of_pairs = (1 / 3 - 1 / 10) * between
    variance = of_pairs + inner / 10 + 2 * (1 / 4 - 1 / 10) * covariance
    of_known = t3 * math.sqrt(0.6 * left.var(ddof=1) / 4)
    half = float(student.ppf(0.975, variance**2 / of_pairs**2 * 2)) * math.sqrt(variance)
    inside = (1 / 3 - 1 / 4) * between
    known_pairs = float(student.ppf(0.975, (inside + inner / 4) ** 2 / inside**2 * 2)) * math.sqrt(inside + inner / 4)
    found = estimate_share(sample, known, visited, d, within, base)
    equal = SampledPair(1000, np.array([400]), np.zeros(60, int), np.zeros((60, 1)))
    single = estimate_share(sample_pairs(1, "all"), np.array([0.5]), [0], *(v[:, 0] for v in pair_differences([equal])))
    two = estimate_share(sample_pairs(2, "all"), np.array([0.5, 0.5]), [0, 1], np.array([0.1, 0.2]), np.zeros(2))
    plain = estimate_share(sample_pairs(9, "all"), np.full(9, 0.5), [0, 1, 2], d, np.zeros(3))
    expected = [
        mean, math.hypot(half, of_known) / 0.75, known_pairs / 0.75, 0.4 * 3 / 60 * math.sqrt(1 - 60 / 400), 0.65,
        1.0, t2 * math.sqrt((1 / 3 - 1 / 9) * between),
    ]  # fmt: skip
    measured = [
        found.mean, found.half_width, found.of_pixels, single.half_width, two.mean, 1.0 + two.half_width,
        plain.half_width,
    ]  # fmt: skip
    assert measured == pytest.approx(expected, rel=1e-9)


def test_variances_of_strata():
    """Sum of W^2 (1 - n / N) s^2 / n over strata with 1 to 40 pixels, at least the rule of three."""
    one = [0.0] * 30 + [1.0] * 8 + [-1.0] * 2
    pairs = [
        SampledPair(200, np.array([100, 50, 0]), np.repeat([0, 1], [40, 1]), np.array([*one, 1.0])[:, None]),
        SampledPair(400, np.array([80, 60, 20]), np.zeros(8, int), np.array([1.0, 0, 0, 0, 0, 0, 0, -1.0])[:, None]),
    ]
    every = [*one, 1.0, 0, 0, 0, 0, 0, 0, -1.0]
    mean = sum(every) / 48
    spread = sum((v - mean) ** 2 for v in every) / 47
    first = 100 / 200 * sum(one) / 40 + 50 / 200 * 1.0
    within = 0.5**2 * (1 - 40 / 100) * spread / 40 + 0.25**2 * (1 - 1 / 50) * 1.0
    second = 60 / 400 * 1.0  # the mean of the other pair's only pixel of the stratum
    other = 0.2**2 * (1 - 8 / 80) * spread / 8 + 0.15**2 * 1.0 + 0.05**2 * 1.0
    means, variances = pair_differences(pairs)
    measured = np.concatenate([means[:, 0], variances[:, 0]])
    few = SampledPair(100, np.array([100]), np.zeros(10, int), np.zeros((10, 1)))
    least = (3 / 10 / NORMAL_95) ** 2 * (1 - 10 / 100)
    assert measured == pytest.approx([first, second, within, other], abs=1e-12)
    assert pair_differences([few])[1][0, 0] == pytest.approx(least, abs=1e-12)


def test_visits_draw_every_pixel_of_its_stratum_once():
    """Strata by reason word and nearness to a threshold; visits by size and density, at least one pixel of each."""
    words = np.zeros((20, 30), np.uint32)
    words[:4] = FEATURE_BIT["direct"]
    words[4:6] = FEATURE_BIT["color"] | FEATURE_BIT["normal"]
    words[0, 0] |= FEATURE_BIT["indirect"]
    direct = np.full((20, 30), 0.026)  # near a threshold of 0.1: from 0.025 to 0.4
    direct[::2] = 0.024
    direct[5::2] = 0.41
    direct[7] = 0.39
    traced = np.ones((20, 30), bool)
    traced[-1] = False
    image = strata_of(words, {"direct": direct}, {"direct": 0.1, "color": 0.1}, traced)
    near = (direct > 0.025) & (direct < 0.4)
    places = {name: 2 << k for k, name in enumerate(LIGHT_FEATURES)}
    expected = near + np.where(words & np.uint32(FEATURE_BIT["direct"]), places["direct"], 0)
    expected += np.where(words & np.uint32(FEATURE_BIT["color"]), places["color"], 0)
    expected[0, 0] += places["indirect"]
    expected[-1] = -1
    assert np.array_equal(image, expected)
    differs = np.arange(30) % 3 == 0  # of which every pixel is in one of two strata
    apart = strata_of(words, {"direct": direct}, {"direct": 0.1, "color": 0.1}, traced, differs & traced)
    assert np.array_equal(apart, np.where(differs & traced, 16 + near, expected)) and apart.max() == STRATA - 1
    strata = PixelStrata.of(image, STRATA, (1, 2))
    sizes = np.bincount(image[image >= 0], minlength=STRATA)
    demand = sizes * np.where(np.arange(STRATA) % 2, 0.5, 0.15)
    each = np.minimum(np.maximum(np.rint(60 * demand / demand.sum()), np.minimum(sizes, 1)), sizes)
    visits = [draw_pixels(strata, k, 60) for k in range(60)]
    flat, drawn = (np.concatenate(values) for values in zip(*visits, strict=True))
    assert np.array_equal(strata.sizes, sizes) and np.array_equal(np.bincount(visits[0][1], minlength=STRATA), each)
    assert np.array_equal(image.ravel()[flat], drawn) and len(np.unique(flat)) == len(flat) == traced.sum()


EDGE = 0.125
"""A threshold that is an edge of the histogram, as its half and double are: there the preview's counts are exact."""


def _words_and_distances(rng: np.random.Generator, pixels: int) -> tuple[Array, dict[str, Array]]:
    """Random reason words, with distances that fit to them: on the upper edges of the histogram's bins."""
    bounds = edges()
    distances = {n: bounds[rng.integers(np.searchsorted(bounds, 0.02), np.searchsorted(bounds, 0.6), pixels)] * 1.01
                 for n in LIGHT_FEATURES}  # fmt: skip
    distances |= {lobe_distance("direct", "diffuse"): distances["direct"] * rng.random(pixels)}
    words = np.where(rng.random(pixels) < 0.1, np.uint32(Reason.POSITION), np.uint32(0))
    for name in LIGHT_FEATURES:
        words |= np.where(distances[name] > EDGE, np.uint32(FEATURE_BIT[name]), np.uint32(0))
    outside, sky = rng.random(pixels) < 0.1, rng.random(pixels) < 0.1
    words = np.where(outside, np.uint32(Reason.OUTSIDE), words)
    for values in distances.values():
        values[outside] = 0.0
    return np.where(sky & ~outside, words | np.uint32(Reason.SKY), words).astype(np.uint32), distances


def _counts_of_words(words: Array, distances: dict[str, Array]) -> Counts:
    histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS), np.int64)
    comparable = (words & np.uint32(Reason.OUTSIDE)) == 0
    for name, values in distances.items():
        if name in FEATURES:
            histograms[FEATURES.index(name)] = np.bincount(bin_of(values[comparable]), minlength=HISTOGRAM_BINS)
    histograms[:, 0] = 0
    return Counts(np.bincount(words, minlength=MASK_WORDS), histograms)


def _of_masks(words: list[Array], distances: list[dict[str, Array]]) -> dict[tuple[str, ...], float]:
    """Columns, rates and reasons of pairs with words (n,) and distances, in percent, from their definitions."""
    bits = {name: np.uint32(FEATURE_BIT[name]) for name in LIGHT_FEATURES}
    every, out = np.concatenate(words), {}
    surface, outside = (every & np.uint32(Reason.SKY)) == 0, (every & np.uint32(Reason.OUTSIDE)) != 0
    for name, bit in bits.items():
        has = [(w & bit) != 0 for w in words]
        comparable = [(w & np.uint32(Reason.OUTSIDE)) == 0 for w in words]
        out["discard", name, "mean_percent"] = np.mean([h.mean() for h in has])
        out["discard", name, "comparable_mean_percent"] = np.mean(
            [h.sum() / c.sum() for h, c in zip(has, comparable, strict=True)]
        )
    for name in RADIANCE_FEATURES:
        for key, limit in (("at_half_exposure_percent", 2 * EDGE), ("at_twice_exposure_percent", EDGE / 2)):
            out["discard", name, key] = np.mean([(d[name] > limit).mean() for d in distances])
    kept = surface & ((every & np.uint32(Reason.OUTSIDE | Reason.POSITION | Reason.DIRECT | Reason.INDIRECT)) == 0)
    out["reusable", "shading", "mean_percent"] = kept.sum() / surface.sum()
    out["reusable", "shading", "of_picture_percent"] = kept.mean()
    color = kept & ((every & bits["color"]) != 0)
    out["reusable", "color_only", "mean_percent"] = color.sum() / surface.sum()
    first = surface & outside
    out["reusable", "reasons", "outside", "mean_percent"] = first.sum() / surface.sum()
    lobe = np.mean([(d["direct_diffuse"] > EDGE).mean() for d in distances])
    out["lobes", "diffuse", "direct", "mean_percent"] = lobe
    return {at: 100.0 * float(value) for at, value in out.items()}


def test_estimates_from_all_pixels_are_those_of_the_masks():
    """Columns, rates, lobes and other exposures of two pairs, whose preview has other masks than the truth."""
    rng, sizes = np.random.default_rng(8), (600, 600)
    preview, truth = ([_words_and_distances(rng, n) for n in sizes] for _ in range(2))
    # What does not depend on light is equal in both.
    fixed = np.uint32(Reason.SKY | Reason.OUTSIDE | Reason.POSITION)
    for k, (words, distances) in enumerate(preview):
        kept = truth[k][0] & fixed
        outside = (kept & np.uint32(Reason.OUTSIDE)) != 0
        for values in distances.values():
            values[outside] = 0.0
        light = np.zeros(len(words), np.uint32)
        for name in LIGHT_FEATURES:
            light |= np.where(distances[name] > EDGE, np.uint32(FEATURE_BIT[name]), np.uint32(0))
        preview[k] = (kept | light, {name: distances[name] for name in LIGHT_FEATURES})
    estimate = LightEstimate(LIGHT_FEATURES, dict.fromkeys(LIGHT_FEATURES, EDGE), True, 1.0, ("diffuse",))
    for k, n in enumerate(sizes):
        estimate.add_preview(k, _counts_of_words(*preview[k]))
        none, whole = np.zeros(n), np.zeros(n, np.int64)
        strata = np.bincount(whole, minlength=STRATA)
        words, distances = truth[k]
        masks = PixelMasks(words, distances, words[:, None], {name: of[:, None] for name, of in distances.items()})
        pixels = SampledPixels(whole, *preview[k], masks, masks, none)
        estimate.add(estimate.visit(k, strata, pixels, none > 0, whole + LEAST))
    found = estimate.intervals(sample_pairs(2, "all"))
    expected = _of_masks([words for words, _ in truth], [distances for _, distances in truth])
    assert {at: found[at].mean for at in expected} == pytest.approx(expected, abs=1e-9)
    assert max(found[at].half_width for at in expected if at[0] != "lobes") < 1e-9
    assert estimate.samples == 2 * LEAST * sum(sizes)
    curves = estimate._curve("direct")
    every = np.concatenate([bin_of(d["direct"][(w & np.uint32(Reason.OUTSIDE)) == 0]) for w, d in truth])
    assert np.array_equal(np.bincount(every, minlength=HISTOGRAM_BINS), curves["counts"])


def test_an_audited_pixel_stands_for_all_that_were_not():
    """The mean of differences over all audits is that of the last words; an undecided pixel counts 2 x 0 - 3 / 4."""
    bit = np.uint32(FEATURE_BIT["direct"])
    preview = np.array([0, 1, 0, 1, 0, 1], np.uint32) * bit
    first = np.array([1, 1, 0, 0, 1, 0], np.uint32) * bit
    end = np.array([0, 1, 1, 0, 0, 0], np.uint32) * bit
    halves = np.repeat(first[:, None], 4, axis=1)
    halves[5] = np.array([1, 0, 1, 1]) * bit
    none, one = {}, np.ones(6, np.int64)

    def differences(audited: Array) -> Array:
        words = np.where(audited > 0, end, first)
        at_end = PixelMasks(words, none, np.repeat(words[:, None], 4, axis=1), none)
        pixels = SampledPixels(one, preview, none, PixelMasks(first, none, halves, none), at_end, audited)
        return pixels.difference(lambda words, _: (words & bit) != 0)

    share = np.array([0.25, 0.25, 0.5, 0.5, 0.25, 0.0])
    total = np.zeros(6)
    for draws in product((False, True), repeat=5):
        audited = np.array([*draws, False])
        chance = np.prod(np.where(audited, share, 1.0 - share))
        total += chance * differences(np.where(audited, share, 0.0))
    expected = np.array([0.0, 1.0, 1.0, 0.0, 0.0, -0.75]) - (preview != 0)
    assert total == pytest.approx(expected, abs=1e-12)
