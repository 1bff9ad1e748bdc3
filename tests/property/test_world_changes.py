"""Changes of a scene that must not change a count: position, scale, storage order, names."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import build, relaxed, worlds

from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.metrics.counts import CLASSES

pytestmark = pytest.mark.usefixtures("coarse_light")

TIMES = (0.25, 0.5)
MODES = st.sampled_from(["camera", "motion"])
SAMPLINGS = st.sampled_from(["nearest", "bilinear"])


def counts(bench, scene, mode, **options):
    return dict(bench.pair(scene, TIMES, reprojection=mode, **options).counts)


@relaxed
@given(worlds, MODES, st.tuples(*[st.sampled_from([0.0, 0.5, -1024.0, 2.0**20, -(2.0**30)])] * 3))
def test_translation_changes_no_count(bench, world, mode, offset):
    assert counts(bench, build(world), mode) == counts(bench, build(world, offset=offset), mode)


@relaxed
@given(worlds, MODES, st.integers(-24, 24))
def test_power_of_two_scale_changes_no_count(bench, world, mode, power):
    scale = 2.0**power
    assert counts(bench, build(world), mode) == counts(bench, build(world, scale=scale), mode, unit_scale=scale)


@relaxed
@given(worlds, MODES, st.sampled_from([1e-5, 0.01, 3.7, 1e4]))
def test_other_scales_change_few_pixels(bench, world, mode, scale):
    """Rounding moves edges by 1e-5 pixel: at most 0.5 % of the pixels change their class."""
    plain = counts(bench, build(world), mode)
    scaled = counts(bench, build(world, scale=scale), mode, unit_scale=scale)
    assert max(abs(plain[n] - scaled[n]) for n in plain) <= 0.005 * plain["pixels"]


@relaxed
@given(worlds, MODES, st.randoms(use_true_random=False))
def test_order_and_names_change_no_mask(bench, world, mode, rng: random.Random):
    order = list(range(len(world.things)))
    rng.shuffle(order)
    reordered = bench.pair(build(world, order=order, rename=True), TIMES, reprojection=mode)
    plain = bench.pair(build(world), TIMES, reprojection=mode)
    # Of two coplanar faces the one drawn first is visible.
    tied = _ties(plain, reordered)
    assert int((plain.mask != reordered.mask).sum()) <= tied


def _ties(a, b) -> int:
    """Four times the pixels that show another of two coplanar surfaces, in either frame."""
    other = np.zeros(a.mask.shape, dtype=bool)
    for x, y in ((a.current, b.current), (a.history, b.history)):
        other |= np.any(x["normal"] != y["normal"], axis=-1) | np.any(x["position"] != y["position"], axis=-1)
    return int(other.sum()) * 4


@relaxed
@given(worlds, MODES)
def test_unindexed_meshes_and_identity_nodes_change_no_count(bench, world, mode):
    assert counts(bench, build(world), mode) == counts(bench, build(world, indexed=False, deep=True), mode)


@relaxed
@given(worlds, MODES, SAMPLINGS, st.booleans())
def test_reason_bits_are_consistent(bench, world, mode, sampling, room):
    images = bench.pair(build(world, room=room), TIMES, reprojection=mode, sampling=sampling)
    c = images.counts
    assert sum(c[name] for name in CLASSES) == c["pixels"] == bench.size[0] * bench.size[1]
    hidden = images.has(Reason.DISOCCLUDED | Reason.OCCLUDING)
    assert not (hidden & ~images.has(Reason.POSITION)).any()
    assert not (images.has(Reason.DISOCCLUDED) & images.has(Reason.OCCLUDING)).any()
    features = Reason.POSITION | Reason.NORMAL | Reason.DISOCCLUDED | Reason.OCCLUDING | Reason.HISTORY_SKY
    assert not (images.has(features) & images.has(NOT_COMPARABLE)).any()
    assert not (images.has(Reason.BEHIND) & images.has(Reason.OUTSIDE)).any()
    one_sky = images.has(Reason.SKY) != images.has(Reason.HISTORY_SKY)
    one_sky &= ~images.has(NOT_COMPARABLE)
    assert (images.has(Reason.POSITION)[one_sky]).all() and (images.has(Reason.NORMAL)[one_sky]).all()
    assert c["invalid"] == 0 and np.isfinite(images.motion).all()


@relaxed
@given(worlds, MODES, SAMPLINGS, st.booleans(), st.floats(0.0, 1.0))
def test_still_pair_has_no_motion_and_no_discard(bench, world, mode, sampling, room, time):
    images = bench.pair(build(world, room=room), (time, time), reprojection=mode, sampling=sampling)
    assert not (images.motion != 0).any()
    assert not (images.mask & ~np.uint32(Reason.SKY | Reason.HISTORY_SKY)).any()
    assert (images.has(Reason.SKY) == images.has(Reason.HISTORY_SKY)).all()


@relaxed
@given(worlds, MODES)
def test_higher_thresholds_discard_less(bench, world, mode):
    scene = build(world)
    found = [counts(bench, scene, mode, thresholds={"position": a, "normal": a}) for a in (0.01, 0.1, 1.0)]
    for feature in ("position", "normal"):
        assert found[0][feature] >= found[1][feature] >= found[2][feature]
    assert len({c["frustum"] for c in found}) == 1


@relaxed
@given(worlds)
def test_reprojection_modes_agree_without_moving_surfaces(bench, world):
    """With the camera alone moving, both modes give the same counts up to rounding."""
    still = without_motion(world)
    a, b = (counts(bench, build(still), mode) for mode in ("camera", "motion"))
    bound = 0.005 * a["pixels"]  # previous positions are rounded differently
    assert all(abs(a[n] - b[n]) <= bound for n in ("frustum", "position", "normal"))


def without_motion(world):
    return replace(world, things=[replace(t, end=t.start) for t in world.things])
