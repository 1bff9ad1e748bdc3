"""Karis' clip against its float64 reference; each stage, bypassed, is noticed."""

from __future__ import annotations

import numpy as np
import pytest
from references import reuse_methods as reference
from reuse_tools import bypassed, play, stages

from taubench_gl.reuse.synthetic import synthetic_steps

SIZE = (64, 36)


@pytest.fixture(scope="module")
def steps():
    return list(synthetic_steps(SIZE, 2, speed=3.0, noise=0.4))


JITTER = np.float32([0.375, -0.25])


def check(gpu, method, steps, window=True) -> None:
    """The second frame.  ``window``: with filtered samples."""
    before, now = (step.inputs["radiance"][..., :3].astype(np.float32).astype(np.float64) for step in steps)
    nearest = reference.nearest_surface(steps[1].inputs["position"][..., 3].astype(np.float32))
    motion = steps[1].inputs["motion"].astype(np.float32)[nearest[..., 1], nearest[..., 0]]
    at = reference.previous_px(motion)
    seen = reference.inside(at, SIZE)[..., None]
    low, high = reference.neighborhood_box(now)
    before = reference.windowed(before, JITTER) if window else before
    history = reference.ycocg_from_rgb(reference.sample_history(before, at))
    history = reference.rgb_from_ycocg(
        reference.clip_towards(low, high, reference.neighborhood_mean(now), history))  # fmt: skip
    new = reference.windowed(now, JITTER) if window else now
    blend, kept = reference.karis_blend(new, history, 0.1)
    expected = np.concatenate([np.where(seen, blend, new), np.where(seen, kept, 0.0)], axis=-1)
    got = play(gpu, method, steps, {"window": window}, jitter_px=JITTER)[1]
    wrong = (np.abs(got - expected) > 1e-4).any(axis=-1)
    assert wrong.mean() <= 1e-3, f"{wrong.sum()} of {wrong.size}, largest {np.abs(got - expected).max()}"


@pytest.mark.parametrize("window", [False, True])
def test_taa_clip_agrees_with_its_reference(gpu, steps, window):
    check(gpu, "taa_clip", steps, window)


BYPASSES = {
    "sample_window": ("window ? windowed(p) : fetch_radiance(p).rgb", "fetch_radiance(p).rgb"),
    "nearest_motion": ("dilate ? nearest_surface(p) : p", "p"),
    "rounded_box": ("if (rounded) {", "if (false) {"),
    "clip": ("clip_towards(low, high, clamp(mean, low, high), ycocg_from_rgb(history))", "ycocg_from_rgb(history)"),
    "luminance_weights": ("if (weighting) {", "if (false) {"),
    "accumulation": ("color = mix(now, history, kept);", ""),
}  # fmt: skip


@pytest.mark.parametrize("stage", stages("taa_clip"))
def test_a_bypassed_stage_is_noticed(gpu, tmp_path, steps, stage):
    folder = bypassed(tmp_path / "taa_clip", "taa_clip", ("clip.glsl", *BYPASSES[stage]))
    with pytest.raises(AssertionError, match="largest"):
        check(gpu, folder, steps)


def test_the_clip_enters_the_box_on_the_ray_to_its_target():
    rng = np.random.default_rng(31)
    low, high = np.sort(rng.normal(size=(2, 500, 3)), axis=0)
    target = low + rng.random((500, 3)) * (high - low)
    color = rng.normal(0, 3, (500, 3))
    clipped = reference.clip_towards(low, high, target, color)
    assert (clipped >= low - 1e-12).all() and (clipped <= high + 1e-12).all()
    np.testing.assert_allclose(np.cross(clipped - target, color - target), 0.0, atol=1e-12)
    outside = ((color < low) | (color > high)).any(axis=-1)
    # Nearer to the color by a thousandth of the way it would still be outside.
    nearer = clipped + 1e-3 * (color - clipped)
    assert outside.sum() > 400 and ((nearer < low) | (nearer > high)).any(axis=-1)[outside].all()
    np.testing.assert_array_equal(clipped[~outside], color[~outside])


def test_the_window_weighs_samples_by_their_distance_from_the_center():
    """A bright pixel, and a sample that the jitter moved half a pixel towards its right and upper neighbors."""
    image = np.zeros((5, 5, 1))
    image[2, 2] = 1.0
    edge, corner = np.exp(-2.29), np.exp(-4.58)
    centered = reference.windowed(image, np.zeros(2))[..., 0]
    np.testing.assert_allclose(centered[2, 1:4], np.array([edge, 1, edge]) / (1 + 4 * edge + 4 * corner))
    moved = reference.windowed(image, np.array([0.5, 0.5]))[..., 0]
    np.testing.assert_allclose(moved[2, 2], moved[2, 3]), "its own center and the right one are equally far"
    np.testing.assert_allclose(moved[2, 2], moved[1, 2]), "and the upper one: row 0 is at the top"
    np.testing.assert_allclose(reference.windowed(np.full((4, 4, 3), 0.7), np.array([0.3, -0.4])), 0.7)
