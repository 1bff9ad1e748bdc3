"""The built-in methods against their float64 references: two or three frames of the moving synthetic scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references import reuse_methods as reference
from references.shading_rate import shaded
from reuse_tools import PLAIN_TOML, play, with_weight, write_method
from stage_tools import emitting_steps
from test_reuse_methods import rotation, warp

from taubench_gl.animation import View
from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.reuse.synthetic import LENS
from taubench_gl.srgb import LUMINANCE

SIZE = (80, 45)
Array = np.ndarray


@pytest.fixture(scope="module")
def steps():
    return emitting_steps(SIZE, 3, seed=11)


def agree(got: Array, expected: Array, atol: float = 2e-5, flips: float = 1e-3) -> None:
    """Equal up to rounding, except for a few pixels at a threshold."""
    assert got.shape == expected.shape and np.isfinite(got).all() and np.isfinite(expected).all()
    wrong = (np.abs(got - expected) > atol + 1e-4 * np.abs(expected)).any(axis=-1)
    assert wrong.mean() <= flips, f"{wrong.sum()} of {wrong.size}, largest {np.abs(got - expected).max()}"


def rgb(step) -> Array:
    return step.inputs["radiance"][..., :3].astype(np.float64)


def previous_positions(step) -> tuple[Array, Array]:
    at = reference.previous_px(step.inputs["motion"])
    return at, reference.inside(at, SIZE)


@pytest.mark.parametrize("filtering", ["bilinear", "catmull_rom"])
def test_running_mean(gpu, steps, filtering):
    got = play(gpu, "accumulate", steps, {"filtering": filtering, "cap": 2})
    mean, count = rgb(steps[0]), np.ones(SIZE[::-1])
    for step, result in zip(steps[1:], got[1:]):
        at, seen = previous_positions(step)
        before = np.where(seen[..., None], np.maximum(reference.sample_history(mean, at, filtering), 0), 0)
        n = np.where(seen, reference.sample_history(count[..., None], at, "nearest")[..., 0], 0.0)
        mean, count = reference.running_mean(rgb(step), before, n, cap=2)
        agree(result, np.concatenate([mean, 1 - 1 / count[..., None]], axis=-1))


@pytest.mark.parametrize("dilate", [False, True])
@pytest.mark.parametrize(("rounded", "weighting"), [(False, False), (True, True)])
def test_karis(gpu, steps, rounded, weighting, dilate):
    settings = {"rounded": rounded, "weighting": weighting, "dilate": dilate}
    got = play(gpu, "taa_clamp", steps[:2], settings)[1]
    at, seen = dilated(steps[1], dilate)
    before = reference.sample_history(rgb(steps[0]), at)
    low, high = reference.neighborhood_box(rgb(steps[1]), rounded)
    before = reference.rgb_from_ycocg(np.clip(reference.ycocg_from_rgb(before), low, high))
    blend, kept = reference.karis_blend(rgb(steps[1]), before, 0.1, weighting)
    expected = np.where(seen[..., None], np.concatenate([blend, kept], -1), with_weight(rgb(steps[1]), 0.0))
    agree(got, expected)


@pytest.mark.parametrize(("gamma", "keep_own"), [(1.0, True), (0.5, False)])
def test_salvi(gpu, steps, gamma, keep_own):
    got = play(gpu, "taa_variance", steps[:2], {"gamma": gamma, "keep_own": keep_own})[1]
    at, seen = dilated(steps[1], True)
    low, high = reference.variance_box(rgb(steps[1]), gamma, keep_own)
    before = reference.clip_to_box(low, high, reference.ycocg_from_rgb(reference.sample_history(rgb(steps[0]), at)))
    blend = reference.exponential_average(rgb(steps[1]), reference.rgb_from_ycocg(before), 0.1)
    agree(got, np.where(seen[..., None], with_weight(blend, 0.9), with_weight(rgb(steps[1]), 0.0)))


def dilated(step, dilate: bool) -> tuple[Array, Array]:
    motion = step.inputs["motion"]
    if dilate:
        nearest = reference.nearest_surface(step.inputs["position"][..., 3])
        assert (nearest != reference.previous_px(np.zeros_like(motion))).any()
        motion = motion[nearest[..., 1], nearest[..., 0]]
    at = reference.previous_px(motion)
    return at, reference.inside(at, SIZE)


@pytest.mark.parametrize("filtering", ["nearest", "bilinear"])
def test_reverse_reprojection_cache(gpu, steps, filtering):
    settings = {"filtering": filtering, "depth_threshold": 0.02, "refresh": 3, "block": 5}
    got = play(gpu, "reverse_reprojection_cache", steps, settings)
    cached = rgb(steps[0])
    for step, result in zip(steps[1:], got[1:]):
        at, seen = previous_positions(step)
        depth = step.inputs["prev_position"].astype(np.float64) @ step.pair.prev_forward
        expected = np.where(step.inputs["position"][..., 3] > 0, depth, 0.0)
        found = reference.sample_history(step.inputs["history_position"][..., 3:], at, filtering)[..., 0]
        due = reference.refresh_due(step.index, SIZE, 5, 3)
        hit = seen & ~due & reference.cache_hit(expected, found, 0.02)
        assert 0.2 < hit.mean() < 0.9 and (seen & ~due & ~hit).any()
        cached = np.where(hit[..., None], reference.sample_history(cached, at, filtering), rgb(step))
        # Nearest at half a pixel may fall either way.
        agree(result, with_weight(cached, hit), flips=1e-3 if filtering == "bilinear" else 1e-2)


def test_refresh_reaches_every_pixel_once_per_period():
    times = sum(reference.refresh_due(i, SIZE, 4, 7).astype(int) for i in range(7))
    assert (times == 1).all()


def test_bmfr(gpu, steps):
    got = play(gpu, "bmfr_temporal", steps, {"position_limit": 0.15, "normal_limit": 0.3})
    mean, count = rgb(steps[0]), np.ones(SIZE[::-1])
    for step, result in zip(steps[1:], got[1:]):
        at, seen = previous_positions(step)
        accept = reference.accept_taps(step.inputs, 0.15, 0.3)
        kept, total = reference.consistent_blend(np.concatenate([mean, count[..., None]], -1), at, accept)
        alive = seen & (total > 0)
        assert 0.02 < (seen & ~alive).mean() < 0.4, "the limits must have something to do"
        kept = np.where(alive[..., None], kept, 0.0)
        count = kept[..., 3] + 1
        share = np.where(alive, np.maximum(1 / count, 0.2), 1.0)
        mean = reference.exponential_average(rgb(step), kept[..., :3], share[..., None])
        agree(result, with_weight(mean, 1 - share), flips=3e-3)


def test_time_warp_samples_at_the_homography(gpu):
    """The warp of an image of pixel indices shows the sample positions, also two frames after the shaded one."""
    views = [View(np.zeros(3), rotation(2.0 * i, 1.5 * i, -2.5 * i), LENS) for i in range(3)]
    x, row = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    index = np.stack([x, row, np.zeros_like(x)], axis=-1).astype(np.float64)
    clip = views[0].clip_from_view(*SIZE)
    for filtering in ("bilinear", "catmull_rom"):  # both are exact for an image that is linear
        results = warp(gpu, SIZE, views, [index, 0 * index, 0 * index], every=3, border="black", filtering=filtering)
        for view, result in list(zip(views, results, strict=True))[1:]:
            at = reference.timewarp_px(clip, views[0].world_from_view.T @ view.world_from_view, SIZE)
            seen = np.all((at > 1) & (at < np.array(SIZE) - 2), axis=-1)
            assert 0.6 < seen.mean() < 0.95 and (result[seen][:, 3] == 1).all()
            np.testing.assert_allclose(result[seen][:, :2], at[seen], atol=2e-3)


def test_checkerboard(gpu, steps):
    steps = [with_alpha(s, shaded("checkerboard", SIZE, s.index)) for s in steps[:2]]
    got = play(gpu, "checkerboard", steps, {"slack": 0.1})
    mean, low, high, count = reference.shaded_neighbors(steps[1].inputs["radiance"])
    lit = steps[1].inputs["radiance"][..., 3:] > 0.5
    at, _ = previous_positions(steps[1])
    first = np.where(steps[0].inputs["radiance"][..., 3:] > 0.5, rgb(steps[0]),
                     reference.shaded_neighbors(steps[0].inputs["radiance"])[0])  # fmt: skip
    before = reference.sample_history(first, at)
    dark = ~lit[..., 0]
    slack = 0.1 * (high[dark] - low[dark])
    before[dark] = np.clip(before[dark], low[dark] - slack, high[dark] + slack)
    good = reusable(steps[1]) & dark
    expected = np.where(good[..., None], before, np.where(lit, rgb(steps[1]), mean))
    assert (count[dark] >= 2).all() and 0.2 < good.mean() < 0.5
    agree(got[1], with_weight(expected, good))


@pytest.mark.parametrize("jitter", [(0.0, 0.0), (0.3, -0.2)])
def test_upsampling(gpu, steps, jitter):
    steps = [with_alpha(s, shaded("quarter", SIZE, s.index)) for s in steps]
    jitter_down = np.array(jitter) * [1, -1]
    got = play(gpu, "upsample_2x2", steps, jitter_px=np.array(jitter))
    image, gathered = np.zeros((*SIZE[::-1], 3)), np.zeros(SIZE[::-1])
    for step, result in zip(steps, got):
        near, total, best = reference.new_samples(step.inputs["radiance"], jitter_down, 1.0)
        wide, wide_total, _ = reference.new_samples(step.inputs["radiance"], jitter_down, 3.0)
        assert (wide_total > 0).all()
        now, confidence = np.where((total > 0)[..., None], near, wide), best**4
        at, _ = previous_positions(step)
        before = reference.sample_history(image, at)
        had = reference.sample_history(gathered[..., None], at, "nearest")[..., 0]
        blend, more, kept = reference.upsample_blend(now, confidence, before, had, 0.1)
        good = reusable(step) & (step.index > 0)
        image = np.where(good[..., None], blend, now)
        gathered = np.where(good, more, confidence)
        agree(result, with_weight(image, np.where(good, kept, 0.0)), atol=1e-4, flips=5e-3)


def with_alpha(step, lit: Array):
    radiance = np.concatenate([step.inputs["radiance"][..., :3], lit[..., None]], axis=-1).astype(np.float32)
    return replace(step, inputs=step.inputs | {"radiance": radiance})


def reusable(step) -> Array:
    _, seen = previous_positions(step)
    return seen & ((step.inputs["mask"] & np.uint32(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL)) == 0)


def test_color_transforms(gpu, steps, tmp_path):
    """The functions of the include, one method per function."""
    rng = np.random.default_rng(12)
    image = rng.normal(0.0, 3.0, (SIZE[1], SIZE[0], 3)).astype(np.float32).astype(np.float64)
    steps = [replace(steps[0], inputs=steps[0].inputs | {"radiance": with_weight(image, 1.0)})]
    low, high = np.array([-1.0, 0.0, -0.5]), np.array([0.5, 2.0, -0.25])
    expected_values = {
        "ycocg_from_rgb(c)": reference.ycocg_from_rgb(image),
        "rgb_from_ycocg(c)": reference.rgb_from_ycocg(image),
        "clip_to_box(vec3(-1.0, 0.0, -0.5), vec3(0.5, 2.0, -0.25), c)": reference.clip_to_box(low, high, image),
        "vec3(luminance(c))": np.repeat((image @ LUMINANCE)[..., None], 3, axis=-1),
        "catmull_rom_weights(fract(c.x)).xyz": reference.catmull_rom_weights(image[..., 0] % 1.0)[..., :3],
    }
    for i, (text, expected) in enumerate(expected_values.items()):
        glsl = f"void reuse(ivec2 p) {{ vec3 c = fetch_radiance(p).rgb; write_result(p, {text}); }}"
        folder = write_method(tmp_path / str(i), PLAIN_TOML, a=glsl)
        np.testing.assert_allclose(play(gpu, folder, steps)[0][..., :3], expected, atol=3e-5, err_msg=text)


def test_catmull_rom_reproduces_parabolas():
    """Keys 1981: third order, exact for quadratics."""
    x = np.arange(12, dtype=np.float64)
    values = np.repeat((0.3 * x**2 - x)[None, :, None], 12, axis=0)
    at = np.stack(np.meshgrid(np.linspace(2, 8, 12), np.linspace(2, 8, 12)), axis=-1)
    expected = 0.3 * at[..., :1] ** 2 - at[..., :1]
    np.testing.assert_allclose(reference.sample_history(values, at, "catmull_rom"), expected, atol=1e-12)
    assert np.abs(reference.sample_history(values, at, "bilinear") - expected).max() > 0.01
