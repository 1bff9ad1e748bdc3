"""Path-traced light against stored Cycles renders: a statistical test of every 4x4 pixels, and columns of a pair.

tools/cycles_references renders them.  Without Blender.

Left out of the blocks, and counted: silhouettes, where the rasterizer and Cycles see another surface; and single pixels
on the edge of a hard shadow or of a texel (``EDGE_PIXELS``): Cycles' filter is 0.01 pixels wide, and the rasterizer
rounds vertices to 1/256 pixel.  Spot cones and skinned normals need no mask: light unit watt has Cycles' cone, and the
scenes have the normals of faces, which Blender does not rebuild.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from light_transport import BLOCK, FRAMES, GLASS, GLASS_LOBES, MAPPING, Reference, references
from references.significance import Estimate, block_means, relative_difference, welch_p_values

from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.metrics.bootstrap import holm_adjusted
from taubench_gl.pathtraced.sequence import PathTracedSequence

Array = np.ndarray
SIGNIFICANCE = 0.01
"""Probability that Holm's test rejects any block, bounce or channel of a scene although the renderers agree."""

MEAN_LIMIT = 0.01
"""Relative difference of the mean radiance of a frame."""

TOLERANCE = 0.002
"""Relative difference of a block's mean that is not tested: half floats, texels, float32 light."""

EDGE_PIXELS, SILHOUETTES = 8, 0.05
SEEDS, SAMPLES = range(8), 8
SAMPLED_LIMIT, GLASS_SAMPLES, GLASS_MEAN_LIMIT = 0.5, 16, 0.03
BOUNCES = ("direct", "indirect")
NAMES = sorted(references())
SAMPLED = "sun_and_sky"
"""Scene of the independent samples of the normal run; rendered once for both of its tests."""


@dataclass(frozen=True)
class Samples:
    """Renders of the second frame of a pair with several seeds."""

    radiance: Array  # (seed, bounce, h, w, 3)
    depth: Array  # (h, w), planar; inf: sky


@cache
def render(reference: Reference) -> Samples:
    found, depths = [], []

    def keep(pair):
        found.append(np.stack([pair.read(bounce)[..., :3] for bounce in BOUNCES]))
        position = pair.read("position")
        depths.append(np.where(position[..., 3] > 0, -position[..., :3] @ pair.view.world_from_view[:, 2], np.inf))

    for seed in SEEDS:
        values = {"light": "path-traced", "pattern": "independent", "spp": SAMPLES, "seed": seed}
        evaluate_scene(reference.scene, reference.settings(**values), Observers(on_pair=keep))
    return Samples(np.array(found, dtype=np.float64), depths[0])


def disagreements(ours: Samples, reference: Reference) -> tuple[Array, Array]:
    """(rejected blocks without silhouettes, edge pixels left out), each (n, 3): bounce, row, column."""
    stored = PathTracedSequence.open(f"exr:{reference.frames}", mapping=MAPPING).read(FRAMES[-1])
    theirs, noise = bounces_of(reference)
    images = np.stack([stored.radiance[bounce] for bounce in BOUNCES]).astype(np.float64)
    own = ours.radiance.copy()
    edges = []
    for _ in range(BLOCK):  # a block may hold several edge pixels
        rejected = rejected_blocks(own, images, theirs, noise) & ~silhouettes(ours.depth, stored)
        if not rejected[0].any():
            break
        for row, column in np.argwhere(rejected[0]):
            inside = np.s_[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK]
            difference = (own[:, 0].mean(axis=0)[inside] - images[0][inside]).sum(axis=-1)
            y, x = np.unravel_index(np.argmax(np.abs(difference)), difference.shape)
            y, x = y + row * BLOCK, x + column * BLOCK
            own[:, 0, y, x] = images[0, y, x]
            edges.append((0, y, x))
    return np.argwhere(rejected), np.array(edges).reshape(-1, 3)


def bounces_of(reference: Reference) -> tuple[Estimate, Array]:
    """The stored blocks of each bounce; the variance of a seed of ours if a sample had that of Cycles."""
    blocks = reference.blocks()
    rows = [reference.kinds.index(bounce) for bounce in BOUNCES]
    estimate = Estimate(blocks.mean[rows], blocks.variance[rows], blocks.count)
    return estimate, estimate.variance * (reference.samples / SAMPLES)


def rejected_blocks(own: Array, images: Array, theirs: Estimate, noise: Array) -> Array:
    """(bounce, rows, columns) bool.

    Where few samples find the light, their own variance is too small: it is at least Cycles' for as many samples.
    """
    found = Estimate.of(block_means(own, BLOCK))
    ours = Estimate(found.mean, np.maximum(found.variance, noise), found.count)
    expected = Estimate(block_means(images, BLOCK), theirs.variance, theirs.count)
    return (holm_adjusted(welch_p_values(ours, expected, TOLERANCE * theirs.mean)) <= SIGNIFICANCE).any(axis=-1)


def silhouettes(depth: Array, stored) -> Array:
    """Blocks where a pixel shows another surface than Cycles', by depth.  (rows, columns) bool."""
    sky = ~np.isfinite(depth)
    with np.errstate(invalid="ignore"):
        differs = np.where(sky | stored.sky, sky != stored.sky, np.abs(depth - stored.depth) > 2e-3 * depth)
    return block_means(differs[..., None], BLOCK)[..., 0] > 0


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name == SAMPLED else pytest.mark.long) for name in NAMES if name not in GLASS],
)
def test_independent_samples_have_the_expectation_of_cycles(name):
    reference = references()[name]
    ours = render(reference)
    stored = PathTracedSequence.open(f"exr:{reference.frames}", mapping=MAPPING).read(FRAMES[-1])
    assert silhouettes(ours.depth, stored).mean() <= SILHOUETTES
    rejected, edges = disagreements(ours, reference)
    assert not len(rejected), f"blocks (bounce, row, column): {rejected.tolist()}"
    assert len(edges) <= EDGE_PIXELS, edges.tolist()
    theirs, _ = bounces_of(reference)
    for i, bounce in enumerate(BOUNCES):
        a = Estimate.of(block_means(ours.radiance[:, i], BLOCK))
        difference, error = relative_difference(a, Estimate(theirs.mean[i], theirs.variance[i], theirs.count))
        assert abs(difference) < MEAN_LIMIT and error < 0.5 * MEAN_LIMIT, (bounce, difference, error)


@pytest.mark.parametrize("change", ["none", "2 % more light", "20 % more light in one block"])
def test_a_bias_of_two_percent_and_a_wrong_block_are_found(change):
    """The test of the test, on samples that are drawn with the stored mean and variance of each block."""
    reference = references()[SAMPLED]
    stored = PathTracedSequence.open(f"exr:{reference.frames}", mapping=MAPPING).read(FRAMES[-1])
    images = np.stack([stored.radiance[bounce] for bounce in BOUNCES]).astype(np.float64)
    theirs, noise = bounces_of(reference)
    drawn = np.sqrt(noise) * np.random.default_rng(0).normal(size=(len(SEEDS), *noise.shape))
    radiance = images + drawn.repeat(BLOCK, axis=2).repeat(BLOCK, axis=3)
    radiance *= 1.02 if change.startswith("2 %") else 1.0
    radiance[:, :, 40:44, 40:44] *= 1.2 if "one block" in change else 1.0
    mean = Estimate.of(block_means(radiance[:, 0], BLOCK))
    difference, _ = relative_difference(mean, Estimate(theirs.mean[0], theirs.variance[0], theirs.count))
    assert (abs(difference) > MEAN_LIMIT) == change.startswith("2 %")
    depth = np.where(stored.sky, np.inf, stored.depth)
    rejected, edges = disagreements(Samples(radiance, depth), reference)
    if not change.startswith("2 %"):
        assert (len(rejected) > 0 or len(edges) > EDGE_PIXELS) == ("one block" in change)


@pytest.mark.long
@pytest.mark.parametrize("name", GLASS)
def test_lobes_of_glass_have_the_mean_of_cycles(name):
    """Mean radiance of the frame by lobe: within 3 %, or four standard errors of lobes that are noisier."""
    reference, found = references()[name], []
    channels = tuple("_".join(reversed(lobe.split("_"))) for lobe in GLASS_LOBES)

    def keep(pair):
        found.append([pair.read(channel)[..., :3].mean(dtype=np.float64) for channel in channels])

    for seed in SEEDS:
        values = {"light": "path-traced", "pattern": "independent", "spp": GLASS_SAMPLES, "seed": seed}
        evaluate_scene(reference.scene, reference.settings(**values), Observers(on_pair=keep, channels=channels))
    blocks = reference.blocks()
    for k, lobe in enumerate(GLASS_LOBES):
        ours = np.array(found)[:, k]
        expected, noise = blocks.mean[k].mean(), np.sqrt(blocks.error2[k].sum()) / blocks.mean[k].size
        error = np.hypot(ours.std(ddof=1) / np.sqrt(len(ours)), noise)
        bound = max(GLASS_MEAN_LIMIT * expected, 4.0 * error, 1e-6)
        assert abs(ours.mean() - expected) < bound, (lobe, ours.mean(), expected, error)
        assert expected < 1e-3 or error < 0.05 * expected, (lobe, expected, error)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "foliage" else pytest.mark.long) for name in NAMES]
)
def test_sampled_columns_hold_those_of_converged_cycles(name):
    """The default: intervals of 95 %, and 0.5 points for what the two renderers define differently."""
    reference = references()[name]
    ours = evaluate_scene(reference.scene, reference.settings(light="auto"), sampled=True).summary["discard"]
    theirs = reference.evaluate().summary["discard"]
    for column in BOUNCES:
        low, high = ours[column]["interval95_percent"]
        assert low - SAMPLED_LIMIT < theirs[column]["mean_percent"] < high + SAMPLED_LIMIT, column
        assert high - low < 4.0
