"""Distances in 8 bits: on which side of a level a decoded distance lies, against float64."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
import pytest
from PIL import Image

from taubench_gl.conventions import HISTOGRAM_BINS, Reason
from taubench_gl.features import FEATURES
from taubench_gl.metrics.counts import bin_of, discarded_above, edges
from taubench_gl.metrics.masks import PixelDistances
from taubench_gl.report import distance_planes as dp

RNG = np.random.default_rng(11)
THRESHOLDS = (32 / 255, 0.05, 0.125, 1e-4, 3.0, 700.0)


def distances(threshold: float) -> np.ndarray:
    """Zero, infinity, any size, the threshold, every edge of the curve, and the float32 numbers next to them."""
    special = np.append(edges().astype(np.float32), np.float32(threshold))
    near = [np.nextafter(special, np.float32(bound)) for bound in (0, np.inf)]
    random = RNG.lognormal(np.log(threshold), 5.0, 4000).astype(np.float32)
    return np.concatenate([[0.0, np.inf], special, *near, random]).astype(np.float32)


def expand(reduced: np.ndarray, kept: Sequence[int]) -> np.ndarray:
    """The inverse of ``Levels.reduced``: the highest kept code at or below a distance.  (...) uint8 -> (...) uint8."""
    return np.array([0, *kept], dtype=np.uint8)[reduced]


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_decoded_distances_lie_on_the_side_of_each_level_of_the_original(threshold):
    levels, values = dp.levels_of(threshold), distances(threshold)
    exact = values.astype(np.float64)
    assert len(levels.values) < dp.CODES and levels.values.dtype == np.float32
    for step in range(len(dp.DETAIL)):
        kept = levels.kept_from(step)
        decoded = expand(levels.reduced(levels.codes(values), step), kept)
        for code in kept:
            np.testing.assert_array_equal(decoded >= code, exact >= np.float64(levels.values[code - 1]))
        np.testing.assert_array_equal(decoded >= levels.home, exact > np.float64(np.float32(threshold)))


@pytest.mark.parametrize("threshold", THRESHOLDS)
def test_levels_hold_the_curve_and_16_an_octave_near_the_threshold(threshold):
    levels = dp.levels_of(threshold)
    curve = edges()
    around = curve[(curve > threshold / 2.0**11) & (curve < threshold * 2.0**11)]
    assert np.isin(around.astype(np.float32), levels.values).all()
    octaves = np.log2(levels.values.astype(np.float64) / threshold)
    assert (np.abs(octaves) <= 2).sum() >= 64
    near = levels.values[np.abs(octaves) <= 2].astype(np.float64)
    assert (near[1:] / near[:-1]).max() <= 1 + 1 / 16
    # Each step keeps a part of the levels of the one before, and always the threshold.
    for finer, coarser in zip(levels.kept, levels.kept[1:], strict=False):
        assert set(coarser) < set(finer) and levels.home in coarser
    assert list(levels.kept[-1]) == [levels.home]


def test_counts_equal_the_recorded_curve_at_its_edges():
    """The histogram of codes, summed above a level that is an edge, is the curve that a run records."""
    threshold = 32 / 255
    values = RNG.lognormal(-3, 2, (60, 80)).astype(np.float32)
    levels = dp.levels_of(threshold)
    encoded = dp.EncodedDistances({"normal": levels.codes(values)}, values, values)
    comparable = RNG.random(values.shape) < 0.9
    counted = dp.histogram(encoded, comparable)[0]
    above = discarded_above(np.bincount(bin_of(values[comparable]), minlength=HISTOGRAM_BINS))
    checked = 0
    for edge, recorded in zip(edges().astype(np.float32), above, strict=True):
        at = np.flatnonzero(levels.values == edge)
        if at.size:
            assert counted[at[0] + 1 :].sum() == recorded
            checked += 1
    assert checked > 200
    assert counted[levels.home :].sum() == (values[comparable] > np.float32(threshold)).sum()


def pair(shape=(36, 64)) -> tuple[PixelDistances, dict[str, dp.Levels]]:
    features = {name: RNG.lognormal(-3, 2, shape).astype(np.float32) for name in FEATURES}
    features["position"][0, :5] = np.inf
    depth = (RNG.uniform(-1, 1, shape) * features["position"]).astype(np.float32)
    depth[0, :5] = np.inf
    found = PixelDistances(features, depth, RNG.normal(size=shape).astype(np.float32))
    return found, {name: dp.levels_of(32 / 255) for name in FEATURES}


@pytest.mark.parametrize("step", range(len(dp.DETAIL)))
def test_reasons_follow_from_the_planes(step):
    """Disoccluded, newly occluding, brightened and darkened at every stored level near the threshold."""
    given, levels = pair()
    planes = dp.planes_at(dp.encode(given, levels), levels, step)
    near = levels["position"].lowest_near(step)
    depth = expand(planes["depth"], levels["position"].kept_from(step, near))
    position, direct = (expand(planes[n], levels[n].kept_from(step)) for n in ("position", "direct"))
    nearer, signs = (planes["signs"] & dp.NEARER) != 0, planes["signs"]
    for code in levels["position"].kept_from(step, near):
        limit = np.float64(levels["position"].values[code - 1])
        moved, away = given.features["position"].astype(float) >= limit, given.depth.astype(float)
        np.testing.assert_array_equal(position >= code, moved)
        np.testing.assert_array_equal((depth >= code) & nearer, moved & (away >= limit))
        np.testing.assert_array_equal((depth >= code) & ~nearer, moved & (-away >= limit))
    for code in levels["direct"].kept_from(step, levels["direct"].lowest_near(step)):
        over = given.features["direct"].astype(float) >= np.float64(levels["direct"].values[code - 1])
        np.testing.assert_array_equal((direct >= code) & ((signs & dp.ROSE) != 0), over & (given.luminance > 0))
        np.testing.assert_array_equal((direct >= code) & ((signs & dp.FELL) != 0), over & (given.luminance < 0))


def test_planes_survive_the_file_and_its_limit():
    """Noise does not fit at full detail; what is stored is exact at the detail that does."""
    given, levels = pair((180, 320))
    encoded = dp.encode(given, levels)
    data, step = dp.compressed(encoded, levels, 0)
    assert 0 < step < len(dp.DETAIL) and len(data) <= dp.MAX_BYTES_PER_PIXEL * 320 * 180
    expected = dp.planes_at(encoded, levels, step)
    with Image.open(io.BytesIO(data)) as image:
        found = dp.unpack(np.asarray(image.convert("RGB")), len(expected))
    for plane, stored in zip(expected.values(), found, strict=True):
        np.testing.assert_array_equal(plane, stored)
    smooth = PixelDistances({n: np.full((90, 160), 0.1, np.float32) for n in FEATURES}, *np.zeros((2, 90, 160)))
    assert dp.compressed(dp.encode(smooth, levels), levels, 0)[1] == 0


def test_histogram_leaves_out_pixels_that_are_not_comparable():
    given, levels = pair()
    mask = np.full((36, 64), int(Reason.OUTSIDE))
    encoded = dp.encode(given, levels)
    assert not dp.histogram(encoded, mask == 0).any()
    assert dp.histogram(encoded, mask != 0).sum() == 36 * 64 * len(FEATURES)
