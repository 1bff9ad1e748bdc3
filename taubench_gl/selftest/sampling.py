"""Cases: pixels decided under path-traced light, and shares estimated at random pixels."""

from __future__ import annotations

import dataclasses
import math
from itertools import combinations, product
from typing import Any

import numpy as np

from taubench_gl.animation import choose_camera
from taubench_gl.conventions import HISTOGRAM_BINS, Reason
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.evaluation.pairs import Pair
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
from taubench_gl.run import Run
from taubench_gl.scene.model import Channel, Scene
from taubench_gl.selftest.bench import Bench, pixel_grid
from taubench_gl.selftest.case import Naive, Outcome, case, count, field, scalar, worst
from taubench_gl.selftest.direct import lambert
from taubench_gl.selftest.geometry import one_metre_per_pixel
from taubench_gl.selftest.scenes import SceneBuilder, quad, sphere

Array = np.ndarray
SIZE = (24, 16)
ROUNDED = "float64: rounding of some hundred operations"
HEIGHT, INTENSITY, ALBEDO = 4.0, 60.0, 0.5
LIMIT_OF_DIRECT = 0.1


def _decided(bench: Bench, scene: Scene, **settings: Any) -> tuple[Run, list[Pair]]:
    """A run with all lobes that decides every pixel of a small image, and its pairs with distances."""
    own = {"light": "path-traced", "fps": 1.0, "width": SIZE[0], "height": SIZE[1], "camera": 0}
    values, pairs = bench._settings({"indirect": "auto"} | own | settings), []
    observers, camera = Observers(on_pair=pairs.append, distances=True), choose_camera(scene)
    return evaluate_scene(scene, values, observers, camera=camera, sampled=True, lobes=("diffuse", "glossy")), pairs


def _lamp_before_a_wall(bench: Bench) -> Scene:
    """A lamp that moves by 5 and 2 m before a wall, and a camera that moves by 3 and 1 pixels."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(100.0, 100.0, material=lambert(b, ALBEDO))), translation=(0.0, 0.0, -10.0))
    lamp = b.light(translation=(-6.0, 0.0, HEIGHT - 10.0), intensity=INTENSITY)
    b.animate(lamp, "translation", [0.0, 1.0, 2.0], [(x, 0.0, HEIGHT - 10.0) for x in (-6.0, -1.0, 1.0)])
    with Bench(bench.gpu, SIZE) as small:
        camera = one_metre_per_pixel(b, small)
    b.animate(camera, "translation", [0.0, 1.0, 2.0], [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0), (3.0, 1.0, 0.0)])
    return b.build()


def _changes_of_light(pair: int) -> Array:
    """Direct radiance of ``_lamp_before_a_wall`` now less that before.  (h, w) float64."""
    lamp, camera = ((-6.0, -1.0, 1.0), ((0.0, 0.0), (3.0, 0.0), (3.0, 1.0)))
    at = (pixel_grid(SIZE) - (np.array(SIZE) - 1) / 2) * (1.0, -1.0) + camera[pair + 1]

    def radiance(x: float) -> Array:
        square = (at[..., 0] - x) ** 2 + at[..., 1] ** 2 + HEIGHT**2
        return ALBEDO / np.pi * INTENSITY * HEIGHT / square**1.5

    return radiance(lamp[pair + 1]) - radiance(lamp[pair])


@case(
    "decided-direct",
    description="a lamp and a camera that move before a wall: distances of direct light of all decided pixels, masks, "
    "brighter and darker pixels, and samples",
    elsewhere="a noisy image is compared with another one, and its noise is counted as change",
    here="the history of a pixel is traced with the pixel's numbers; light without noise needs the fewest samples",
    tolerance=2e-5,
    source="float32: 64 ulps of a radiance of 2; a wrong mask or count is an error of 1",
)
def decided_direct(bench: Bench) -> Outcome:
    columns = ("frustum", "direct", "indirect", "color")
    run, pairs = _decided(bench, _lamp_before_a_wall(bench), columns=columns, thresholds={"direct": LIMIT_OF_DIRECT})
    errors, audited = [], 0
    for number, pair in enumerate(pairs):
        change, comparable = _changes_of_light(number), (pair.mask & np.uint32(Reason.OUTSIDE)) == 0
        distance = np.sqrt(3.0) * np.abs(change)
        errors.append((pair.distances.features["direct"] - distance)[comparable])
        errors.append((pair.distances.luminance - change)[comparable])
        over = comparable & (distance > LIMIT_OF_DIRECT)
        words = {Reason.DIRECT: over, Reason.LIT: over & (change > 0), Reason.SHADOWED: over & (change < 0)}
        words |= {Reason.INDIRECT: np.zeros_like(over)}
        wrong = sum(int((((pair.mask & np.uint32(bit)) != 0) != where).sum()) for bit, where in words.items())
        row, pixels = pair.row, int(comparable.sum())
        wrong += abs(row["direct"] - int(over.sum())) + abs(row["traced"] - pixels)
        wrong += row["undecided"] + row["audited_wrong"]
        wrong += abs(row["light_samples"] - 2 * (LEAST * pixels + (LIMIT - LEAST) * row["audited"]))
        audited += row["audited"]
        errors.append(np.array([wrong]))
    lobes = run.summary["lobes"]
    shares = [of["direct"]["mean_percent"] for of in (run.summary["discard"], lobes["diffuse"], lobes["glossy"])]
    errors.append(np.array([shares[0] - shares[1], shares[2], 0.0 if 0 < audited < 200 else 1.0]))
    return field("albedo / pi I cos / r^2", np.concatenate([e.ravel() for e in errors]))


RADIUS, BOUNCES = 4.0, 12


def _in_a_sphere(intensity: float) -> float:
    """Indirect radiance inside a sphere of ALBEDO with a lamp: the first reflection is even, whatever its place."""
    of_first = ALBEDO**2 * intensity / (np.pi * RADIUS**2)
    return of_first * sum(ALBEDO**k for k in range(BOUNCES - 1))


@case(
    "decided-indirect",
    description="a lamp in a closed sphere moves, and becomes stronger in the next frame: indirect light changes in no "
    "pixel and then in all; mean distance",
    elsewhere="noise at a moving lamp is counted as a change of indirect light",
    here="distances without what noise adds to squares; as many samples as a yes or no needs",
    tolerance=1.5e-2,
    source="relative to the change; the sphere's triangles have 0.4 % less than its area, and sampling noise; a wrong "
    "mask is an error of 1",
)
def decided_indirect(bench: Bench) -> Outcome:
    b = SceneBuilder()
    inside = dataclasses.replace(sphere(RADIUS, 32), material=lambert(b, ALBEDO, double_sided=True))
    b.node(mesh=b.mesh(inside))
    lamp = b.light(translation=(0.0, 1.0, 0.0), intensity=8.0)
    b.animate(lamp, "translation", [0.0, 1.0], [(0.0, 1.0, 0.0), (0.5, 1.0, 0.0)])
    b._channels.append(Channel("light", 0, "intensity", "LINEAR", np.array([1.0, 2.0]), np.array([[8.0], [24.0]])))
    b.camera(translation=(0.0, 0.0, 1.0), yfov=np.radians(60.0))
    columns = ("frustum", "direct", "indirect")
    _, pairs = _decided(bench, b.build(), columns=columns, thresholds={"indirect": 0.25}, width=12, height=8)
    changed = [int((pair.mask & np.uint32(Reason.INDIRECT) != 0).sum()) for pair in pairs]
    expected = np.sqrt(3.0) * (_in_a_sphere(24.0) - _in_a_sphere(8.0))
    still, grown = (pair.distances.features["indirect"] for pair in pairs)
    wrong = abs(changed[0]) + abs(changed[1] - still.size) + int((still > 0.1).sum())
    return scalar(expected, float(grown.mean()) + wrong * expected, relative=True)


@case(
    "sampled-direct",
    description="the same lamp, wall and camera, direct light estimated at random pixels: the interval against the "
    "closed form",
    elsewhere="an estimate has no interval, or one from pixels that have been chosen by their result",
    here="random pixels, with the preview of every pixel as control; rounds until the interval is narrow",
    source="exact count: the truth is outside an interval, or an interval is wider than asked for",
)
def sampled_direct(bench: Bench) -> Outcome:
    own = {"light": "auto", "fps": 1.0, "width": SIZE[0], "height": SIZE[1], "camera": 0, "shadow_lights": 0}
    columns = ("frustum", "position", "normal", "direct")
    settings = bench._settings(own | {"columns": columns, "thresholds": {"direct": LIMIT_OF_DIRECT}})
    scene = _lamp_before_a_wall(bench)
    summary = evaluate_scene(scene, settings, camera=choose_camera(scene), sampled=True).summary
    outside = np.zeros((2, SIZE[1], SIZE[0]), bool)
    outside[0, :, -3:] = outside[1, 0] = True
    over = np.stack([np.sqrt(3.0) * np.abs(_changes_of_light(k)) > LIMIT_OF_DIRECT for k in range(2)]) & ~outside
    sampled, entry = summary["sampled_light"], summary["discard"]["direct"]
    low, high = entry["interval95_percent"]
    truth, preview = 100.0 * over.mean(), entry["preview_percent"]
    wrong = [
        not low <= truth <= high, high - low > 2.0 or high == low, abs(preview - truth) > 1e-9,
        sampled["pixels"] != entry["pixels"], not sampled["narrow"], sampled["audited_wrong"] > 0,
        not 0 < sampled["audited"] < 0.5 * sampled["pixels"], entry["undecided_percent"] > 0, sampled["pairs"] != 2,
    ]  # fmt: skip
    return count(0, sum(wrong))


@case(
    "parts-of-samples",
    description=f"{LIMIT} samples in {PARTS} parts: values of a part that are not one in each 1/{LIMIT // PARTS}, of "
    "every dimension; parts that are equal",
    elsewhere="parts of one sequence are not independent, so that their spread is not the error of the mean",
    here="each part is a scrambled sequence of its own, and grows with the number of samples",
    source="exact: a Sobol sequence has one value in each interval",
)
def parts_of_samples(bench: Bench) -> Outcome:
    words, start, end = [[] for _ in range(PARTS)], 0, LEAST
    while start < LIMIT:  # as a pixel gets them
        for part, rows in enumerate(np.split(part_table(start, end - start), PARTS)):
            words[part].append(rows)
        start, end = end, 2 * end
        if start == LEAST:
            first = np.stack([np.concatenate(own) for own in words])
    table = np.stack([np.concatenate(own) for own in words]).reshape(PARTS, LIMIT // PARTS, -1)
    wrong = 0
    for numbers in (first.reshape(PARTS, LEAST // PARTS, -1), table):
        cells = np.sort((numbers.astype(np.uint64) * np.uint64(numbers.shape[1])) >> np.uint64(32), axis=1)
        wrong += int((cells != np.arange(numbers.shape[1], dtype=np.uint64)[None, :, None]).sum())
    wrong += sum(bool((table[a] == table[b]).all()) for a, b in combinations(range(PARTS), 2))
    wrong += int((part_table(40, 100) != part_table(0, 140)[40:]).sum())
    return count(0, wrong)


@case(
    "every-sample-of-pixels",
    description="three pairs of 7 pixels in two strata: mean of the estimated share over all samples of two pairs "
    "and three pixels of each",
    elsewhere="pixels are counted with equal weight, although strata are sampled unevenly",
    here="y = x + d: the difference estimator with the weights of strata",
    tolerance=1e-12,
    source=ROUNDED,
)
def every_sample_of_pixels(bench: Bench) -> Outcome:
    x = np.array([[1, 0, 0, 0, 1, 1, 0], [0, 1, 1, 0, 0, 0, 0], [1, 1, 1, 0, 1, 0, 0]], float)
    y = np.array([[1, 1, 0, 0, 0, 1, 0], [0, 1, 1, 0, 0, 0, 0], [0, 1, 0, 0, 1, 1, 0]], float)
    stratum = np.array([0, 0, 0, 1, 1, 1, -1])  # the last pixel is known
    places = [np.flatnonzero(stratum == k) for k in (0, 1)]
    drawn = [np.array([*a, b]) for a in combinations(places[0], 2) for b in places[1]]
    means = []
    for rows in combinations(range(3), 2):
        for pixels in product(drawn, repeat=2):
            visited = [
                SampledPair(7, np.array([3, 3]), stratum[at], (y[row] - x[row])[at][:, None])
                for row, at in zip(rows, pixels, strict=True)
            ]
            differences, within = pair_differences(visited)
            sample = sample_pairs(3, "all")
            means.append(estimate_share(sample, x.mean(axis=1), rows, differences[:, 0], within[:, 0]).mean)
    return scalar(float(y.mean()), float(np.mean(means)), Naive("the preview", float(x.mean()), abs((x - y).mean())))


@case(
    "interval-of-pixels",
    description="4 of 10 pairs known, 3 of them visited, one or two strata: half widths against their formulas, and "
    "of 60 equal pixels",
    elsewhere="the variance between pairs, or the covariance with the known share, is left out",
    here="two stages (Cochran Eq. 10.14), Student's t at Satterthwaite's degrees of freedom, rule of three",
    tolerance=1e-9,
    source="relative; float64, and SciPy's distribution of t against its tables in ten digits",
)
def interval_of_pixels(bench: Bench) -> Outcome:
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
    from scipy.stats import t

    half = float(t.ppf(0.975, variance**2 / of_pairs**2 * 2)) * math.sqrt(variance)
    inside = (1 / 3 - 1 / 4) * between
    known_pairs = float(t.ppf(0.975, (inside + inner / 4) ** 2 / inside**2 * 2)) * math.sqrt(inside + inner / 4)
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
    return field("Cochran Eq. 10.14", np.array(measured) / np.array(expected) - 1.0)


@case(
    "variance-of-strata",
    description="two pairs, three strata, one pixel to 40 of each: means and variances of pairs against their sums",
    elsewhere="the variance of a few equal values is 0, or a stratum without a pixel is left out",
    here="variances over all pairs, at least that of the rule of three; means of other pairs",
    tolerance=1e-12,
    source=ROUNDED,
)
def variance_of_strata(bench: Bench) -> Outcome:
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
    errors = [*(measured - [first, second, within, other]), pair_differences([few])[1][0, 0] - least]
    return field("sum of W^2 (1 - n / N) s^2 / n", errors)


@case(
    "pixels-of-a-visit",
    description="visits of a pair of 600 pixels: pixels drawn twice or never, of a wrong stratum or number",
    elsewhere="later visits draw pixels again, or a small stratum is never seen",
    here="a random order of each stratum; by size and density, at least one pixel",
    source="exact: counts",
)
def pixels_of_a_visit(bench: Bench) -> Outcome:
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
    wrong = int((image != expected).sum())
    strata = PixelStrata.of(image, STRATA, (1, 2))
    sizes = np.bincount(image[image >= 0], minlength=STRATA)
    demand = sizes * np.where(np.arange(STRATA) % 2, 0.5, 0.15)
    each = np.minimum(np.maximum(np.rint(60 * demand / demand.sum()), np.minimum(sizes, 1)), sizes)
    visits = [draw_pixels(strata, k, 60) for k in range(60)]
    flat, drawn = (np.concatenate(values) for values in zip(*visits, strict=True))
    wrong += int((strata.sizes != sizes).sum()) + int((np.bincount(visits[0][1], minlength=STRATA) != each).sum())
    wrong += int((image.ravel()[flat] != drawn).sum()) + abs(len(np.unique(flat)) - int(traced.sum()))
    return count(0, wrong + len(flat) - int(traced.sum()))


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


@case(
    "estimates-of-all-pixels",
    description="two pairs of 600 pixels, a preview and other masks, every pixel asked: columns, rates, lobes "
    "and exposures against their definitions",
    elsewhere="a column is estimated, and the rate or its reasons are still those of the preview",
    here="every number that depends on light is one statistic of masks and distances",
    tolerance=1e-9,
    source="percent; float64",
)
def estimates_of_all_pixels(bench: Bench) -> Outcome:
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
    errors = [found[at].mean - value for at, value in expected.items()]
    errors += [found[at].half_width for at in expected if at[0] != "lobes"]
    errors.append(estimate.samples - 2 * LEAST * sum(sizes))
    curves = estimate._curve("direct")
    every = np.concatenate([bin_of(d["direct"][(w & np.uint32(Reason.OUTSIDE)) == 0]) for w, d in truth])
    errors += [*(np.bincount(every, minlength=HISTOGRAM_BINS) - np.array(curves["counts"]))]
    return field("of the true masks", errors)


@case(
    "audited-pixels",
    description="decided, audited and undecided pixels: the mean of their differences over all audits",
    elsewhere="a pixel that was decided wrongly is corrected where it was audited, and counts as any other",
    here="an audited pixel stands for all that were not: its correction is divided by its probability",
    tolerance=1e-12,
    source=ROUNDED,
)
def audited_pixels(bench: Bench) -> Outcome:
    bit = np.uint32(FEATURE_BIT["direct"])
    preview = np.array([0, 1, 0, 1, 0, 1], np.uint32) * bit
    first = np.array([1, 1, 0, 0, 1, 0], np.uint32) * bit
    end = np.array([0, 1, 1, 0, 0, 0], np.uint32) * bit
    halves = np.repeat(first[:, None], 4, axis=1)
    halves[5] = np.array([1, 0, 1, 1]) * bit  # the last pixel is undecided: 2 x 0 - 3 / 4
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
    return Outcome("of the last words", str(total.round(3).tolist()), worst(total - expected))
