"""Masks at sampled pixels: which are drawn, and that every way to find a mask gives the same."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from taubench_gl.animation import choose_camera
from taubench_gl.cost.pixels import PairChannels, Subject, discarded, draw_pixels, pack, rendered_masks, unpack
from taubench_gl.cost.reference import HALVES, TracedPixels, reference_light, traced_masks
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.metrics.path_samples import sample_table
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

SETTINGS = Settings(width=24, height=14, indirect="none", shadow_size=64, bounces=2)


@pytest.fixture(scope="module")
def subject(demo):
    scene = load_scene(demo)
    return Subject(open_gpu("auto", None), scene, choose_camera(scene), draw_pixels(range(20, 23), (24, 14)))


@pytest.fixture(scope="module")
def pairs(subject):
    return PairChannels(subject, SETTINGS)


def test_pixels_are_drawn_from_whole_frames_without_repeats():
    sample = draw_pixels(range(0, 49), (480, 270))
    assert len(sample) == 4096 and len(sample.frames) == 4 and min(sample.frames) >= 1
    for at in sample.at:
        assert len(np.unique(at, axis=0)) == len(at) == 1024
        assert np.abs(at.mean(axis=0) - (239.5, 134.5)).max() < 40.0
    assert all(np.array_equal(a, b) for a, b in zip(sample.at, draw_pixels(range(0, 49), (480, 270)).at))


def test_a_small_image_is_taken_whole():
    assert len(draw_pixels(range(5, 8), (10, 6))) == 2 * 60


def test_mask_words_survive_their_text():
    words = np.arange(1 << 16, dtype=np.uint32)
    assert np.array_equal(unpack(pack(words)), words)


def test_rendered_masks_are_those_of_an_evaluation(subject):
    kept = []
    evaluate_scene(
        subject.scene, SETTINGS.replace(frames=(20, 23)), Observers(on_pair=lambda pair: kept.append(pair.mask.copy()))
    )
    every = np.concatenate([m[at[:, 1], at[:, 0]] for m, at in zip(kept, subject.sample.at, strict=True)])
    assert np.array_equal(rendered_masks(subject, SETTINGS), every)


def test_float64_masks_agree_with_the_renderer(subject):
    exact = PairChannels(subject, SETTINGS, light=True).masks()
    assert np.mean(exact != rendered_masks(subject, SETTINGS)) < 0.01


def test_traced_pixels_give_the_masks_of_whole_traced_frames(subject, pairs):
    settings = SETTINGS.replace(light="path-traced", spp=2, indirect="auto")
    whole, listed = rendered_masks(subject, settings), traced_masks(subject, pairs, settings)
    for column in ("position", "direct", "indirect", "color"):
        assert np.mean(discarded(whole, column) != discarded(listed, column)) < 0.01
    assert discarded(listed, "indirect").any()


def test_halves_of_the_reference_and_configurations_have_independent_numbers():
    """A part of a Sobol sequence that starts later is the first part shifted: equal in the first dimension.

    Sequences with seeds of their own are not: in no dimension are differences of their numbers all alike.
    """
    table = {seed: sample_table(0, 64, seed).reshape(64, -1) for seed in (Settings().lighting.seed, *HALVES)}
    later = sample_table(1 << 16, 64).reshape(64, -1)
    assert np.abs(later[:, 0].astype(float) - table[0][:, 0]).max() / 2.0**32 < 1e-4
    assert (np.ptp(table[0] ^ later, axis=0) < 2**16).sum() > 100, "a digital shift, the same for all samples"
    for a, b in itertools.combinations(table.values(), 2):
        assert np.ptp(a ^ b, axis=0).min() > 2**24


def test_each_half_has_the_samples_of_its_seed(subject, pairs):
    """A half alone is what a configuration with that seed gives."""
    settings = reference_light(SETTINGS)
    pixels = TracedPixels(subject, pairs, settings)
    pixels.trace(2)
    halves = [pairs.masks(pixels.light(seed)) for seed in HALVES]
    pixels.release()
    for half, seed in zip(halves, HALVES, strict=True):
        alone = TracedPixels(subject, pairs, settings, seeds=(seed,))
        alone.trace(2)
        assert np.array_equal(pairs.masks(alone.light()), half)
        alone.release()
    assert not np.array_equal(*halves)


def test_a_reference_goes_on_where_it_was_saved(subject, pairs, tmp_path):
    def traced(*parts):
        pixels = TracedPixels(subject, pairs, reference_light(SETTINGS))
        pixels.load(tmp_path)
        for part in parts:
            pixels.trace(part)
        pixels.save(tmp_path)
        samples, words = pixels.samples, pairs.masks(pixels.light())
        pixels.release()
        return samples, words

    samples, whole = traced(2, 2)
    (tmp_path / "reference.npz").unlink()
    traced(2)
    resumed, words = traced(2)
    assert samples == resumed == 8 and np.array_equal(whole, words)
