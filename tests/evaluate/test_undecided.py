"""Undecided pixels in sampled light: many shadowed lights with direct light in closed form, against samples of them."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from lamp_scenes import lamp_over_floor
from many_lights import LIMIT, PAIRS, SIZE, ManyLights, decided_pixels, estimate, preview_of

from taubench_gl.evaluation import evaluate_scene
from taubench_gl.evaluation.sampled_light import RoundSizes
from taubench_gl.metrics.counts import discarded_at
from taubench_gl.metrics.path_samples import HALVES, PARTS
from taubench_gl.metrics.sampled_light import SampledPixels, statistics_of
from taubench_gl.scene.builder import SceneBuilder, box

DIRECT = ("discard", "direct")
LIMITS = {"at_half_exposure_percent": 2.0 * LIMIT, "mean_percent": LIMIT, "at_twice_exposure_percent": 0.5 * LIMIT}


def test_halves_are_balanced():
    """Complementary halves; two parts are together in as many halves as chance has them, over all 15 splits or 8."""
    assert HALVES.shape == (16, PARTS // 2)
    for first, second in zip(HALVES[::2], HALVES[1::2], strict=True):
        assert sorted([*first, *second]) == list(range(PARTS))
    signs = np.zeros((8, PARTS))
    np.put_along_axis(signs, HALVES[::2], 1.0, axis=1)
    assert np.array_equal((2 * signs - 1) @ (2 * signs - 1).T, PARTS * np.eye(8)), "orthogonal splits"
    assert (signs.sum(axis=1) == PARTS / 2).all()


def test_a_frame_and_light_that_are_there_already_decide_as_new_ones():
    scene, at = ManyLights(), np.argwhere(np.full(SIZE[::-1], True))[:200, ::-1]
    walked, fresh = decided_pixels(scene, seed=1), decided_pixels(scene, seed=1)
    walked.draw(preview_of(scene, 1, 0))  # whose second frame is the first one of the next pair
    for pixels in (walked, fresh):
        pixels.draw(preview_of(scene, 2, 0))
    known, expected = {}, fresh.decide(at, 256, np.zeros(len(at)))
    for part in (at[:120], at):
        found = walked.decide(part, 256, np.zeros(len(part)), known=known)
        assert np.array_equal(found.samples, expected.samples[: len(part)])
        assert np.array_equal(found.end.distances["direct"], expected.end.distances["direct"][: len(part)])
    assert {first for first, *_ in known} == {0, 64, 128}


def test_shares_of_all_pixels_have_less_bias_than_noisy_distances():
    """Every pixel of two pairs at the limit: what the estimator expects, without the choice of pixels."""
    scene, pixels = ManyLights(), decided_pixels(ManyLights(), seed=1)
    at = np.argwhere(np.full(SIZE[::-1], True))[:, ::-1]
    statistics = {s.at[2]: s for s in statistics_of(("direct",), {"direct": LIMIT}, False, ())}
    noisy, corrected, truth = [], [], []
    for frame in (1, 2):
        pixels.draw(preview_of(scene, frame, 0))
        found = pixels.decide(at, 1024, np.ones(len(at)), halves=True)
        assert 0.2 < found.undecided.mean() < 0.6
        assert (found.first.half_words[~found.undecided] == found.first.words[~found.undecided, None]).all()
        blank = np.zeros(len(at), np.uint32), {"direct": np.zeros(len(at))}
        sampled = SampledPixels(np.zeros(len(at), int), *blank, found.first, found.end, found.audited)
        assert sampled.value(statistics["mean_percent"].indicator).min() >= -1.0
        noisy.append([np.mean(s.indicator(found.first.words, found.first.distances)) for s in statistics.values()])
        corrected.append([np.mean(sampled.value(s.indicator)) for s in statistics.values()])
        truth.append([np.mean(scene.distances(frame) > LIMITS[key if key in LIMITS else "mean_percent"])
                      for key in statistics])  # fmt: skip
    wrong, left = (np.abs(np.mean(x, axis=0) - np.mean(truth, axis=0)) for x in (noisy, corrected))
    place = list(statistics).index("mean_percent")
    assert wrong[place] > 0.005 and left[place] < 0.4 * wrong[place]
    assert (left < wrong).all()


@pytest.mark.long
def test_twenty_seeds_of_many_shadowed_lights():
    """Mean within two standard errors, and 18 of 20 intervals hold; shares at other exposures are in order."""
    scene = ManyLights()
    every = np.concatenate([scene.distances(frame) for frame in range(1, PAIRS + 1)])
    truth = {key: 100.0 * np.mean(every > limit) for key, limit in LIMITS.items()}
    runs = [estimate(scene, seed, 1.2, 1024)[1] for seed in range(20)]
    for key, share in truth.items():
        means = np.array([run[*DIRECT, key].mean for run in runs])
        widths = np.array([run[*DIRECT, key].half_width for run in runs])
        assert np.count_nonzero(np.abs(means - share) <= widths) >= 18, key
        if key == "mean_percent":
            assert abs(means.mean() - share) <= 2.0 * means.std(ddof=1) / np.sqrt(20)


def test_curves_have_the_weights_of_shares():
    """Above the threshold, which is an edge of no bin, the curve is between its neighbors."""
    light, intervals = estimate(ManyLights(), 3, 4.0, 256)
    curve = light._curve("direct")
    for key, limit in LIMITS.items():
        share = 100.0 * discarded_at(np.array(curve["counts"]), limit) / (PAIRS * SIZE[0] * SIZE[1])
        assert share == pytest.approx(intervals[*DIRECT, key].mean, abs=1.0), key
    above = np.array(curve["at_or_above"])
    assert (np.diff(above) <= 0).all() and (np.array(curve["counts"]) >= 0).all()


def test_shares_at_other_exposures_are_in_order(monkeypatch):
    monkeypatch.setattr("taubench_gl.evaluation.sampled_light.ROUND_SIZES", RoundSizes(pixels=8, limit=64))
    settings = fixed_settings(width=32, height=18, frames=(0, 3), spp=1, light="auto", light_within=20.0)
    entry = evaluate_scene(lamp_over_floor(emits=40.0), settings, sampled=True).summary["discard"]["indirect"]
    shares = [entry[key] for key in LIMITS]
    ends = [entry[name] for name in ("at_half_exposure_interval95_percent", "interval95_percent",
                                     "at_twice_exposure_interval95_percent")]  # fmt: skip
    assert shares == sorted(shares) and all(list(side) == sorted(side) for side in zip(*ends, strict=True))


def box_that_leaves():
    """A lit box; the camera turns away from it between frames 1 and 2, and sees nothing but sky from then on."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((1.0, 1.0, 1.0), material=b.material(metallic=0.0, roughness=1.0))))
    lamp = b.light(translation=(1.0, 1.0, 3.0), kind="point", intensity=40.0)
    b.animate(lamp, "translation", [0.0, 0.25], [(1.0, 1.0, 3.0), (-4.0, 1.0, 3.0)])
    camera = b.camera(translation=(0.0, 0.0, 4.0))
    away = (0.0, 1.0, 0.0, 0.0)  # half a turn
    b.animate(camera, "rotation", [0.0, 1.5 / 24.0], [(0.0, 0.0, 0.0, 1.0), away], interpolation="STEP")
    return b.build()


@pytest.mark.parametrize("changes", [{}, {"columns": ("frustum", "direct")}, {"history": "eye"}, {"history": "both"}])
def test_a_pair_with_nothing_to_sample_has_no_light_and_the_others_do(changes):
    settings = fixed_settings(width=16, height=9, frames=(0, 5), spp=1, light="auto", **changes)
    summary = evaluate_scene(box_that_leaves(), settings, sampled=True)
    rows = [row for row in summary.frames if row["sampled"] is not None]
    assert len(rows) == len(summary.frames) == 4 and rows[0]["sampled"] > 0
    assert all(row["sampled"] == 0 == row["sampled_direct"] for row in rows[2:])
    entry = summary.summary["discard"]["direct"]
    assert entry["method"] == "sampled" and entry["pixels"] == sum(row["sampled"] for row in rows)


def test_a_run_with_nothing_to_sample_is_the_preview():
    settings = fixed_settings(width=16, height=9, frames=(2, 5), spp=1, light="auto")
    entry = evaluate_scene(box_that_leaves(), settings, sampled=True).summary["discard"]["direct"]
    assert entry["mean_percent"] == entry["preview_percent"] == 0.0 == entry["pixels"]
    assert entry["interval95_percent"] == [0.0, 0.0]
