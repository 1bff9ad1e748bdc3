"""The FSR2-class upscaler against its float64 reference; each stage, bypassed, is noticed; what it gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references import reuse_methods as reference
from references.reuse_methods.fsr2 import Grids, Prepared, pixels
from reuse_scenes import drifting_checks, settings
from reuse_tools import bypassed, stages, still_steps
from reuse_tools import play as play_frames
from stage_tools import stored

from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.synthetic import synthetic_steps

SMALL, LARGE = (40, 24), (60, 36)
GRIDS = Grids(SMALL, LARGE)
JITTERS = np.float32(
    [[0.25, -0.125], [-0.3125, 0.375], [0.1875, 0.4375], [-0.4375, -0.25], [0.3125, 0.0625], [0, -0.375]]
)
SETTINGS = {"max_weight": 8.0, "shading_change": 0.1, "sharpen": True}
Array = np.ndarray


def fireflies(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Factors of colored noise with a long tail, as of paths with few samples."""
    return rng.gamma(0.1, 10.0, (*shape, 3)) * np.where(rng.random((*shape, 1)) < 0.1, 100.0, 1.0)


@pytest.fixture(scope="module")
def steps():
    """Moving frames, then still ones, with lines, masks, fireflies, and a light switched on in the fourth frame."""
    rng = np.random.default_rng(51)
    moving = list(synthetic_steps(SMALL, 3, speed=3.0, noise=0.2))
    out = []
    for index in range(6):
        step = moving[min(index, 2)]
        inputs = stored(step.inputs)
        if index > 2:
            inputs |= {"motion": np.zeros_like(inputs["motion"]), "prev_position": inputs["position"]}
        if index == 2:  # faster than before
            inputs["motion"] = inputs["motion"] + np.float32([14, 0]) * (np.arange(SMALL[0]) < 20)[:, None]
            inputs["motion"] = inputs["motion"].astype(np.float32)
        radiance = inputs["radiance"].copy()
        radiance[::5, :, :3] *= 3.0
        radiance[:, :16, :3] *= 1.6 if index >= 3 else 1.0
        radiance[..., :3] *= rng.gamma(30.0, 1 / 30.0, radiance.shape[:2])[..., None]
        radiance[10:14, 20:30, :3] *= (1.0, 1.5)[index % 2]
        radiance[:4, :, :3] *= fireflies(rng, (4, SMALL[0]))
        inputs["radiance"] = radiance
        inputs["reactive"] = np.zeros((*SMALL[::-1], 1), dtype=np.float32)
        inputs["reactive"][4:8, 8:12] = 0.6
        inputs["transparency"] = np.zeros((*SMALL[::-1], 1), dtype=np.float32)
        inputs["transparency"][14:20, 26:34] = 0.95
        out.append(replace(step, index=index, inputs=inputs))
    return out


def play(gpu, method, steps, **changed) -> list[Array]:
    """Results of LARGE from inputs of SMALL with JITTERS and SETTINGS but for ``changed``, row 0 at the bottom."""
    jitter = {"jitter_px": lambda index: JITTERS[index], "prev_jitter_px": lambda index: JITTERS[max(index - 1, 0)]}
    return [result[::-1] for result in play_frames(gpu, method, steps, SETTINGS | changed, size=LARGE, **jitter)]


def reference_frames(steps) -> list[Array]:
    """The whole method in float64, (h, w, 4): color and weight of history."""
    before, before_depth, before_motion, out = None, None, None, []
    for step in steps:
        i = {n: v[::-1].astype(np.float64) for n, v in step.inputs.items() if "mask" not in n}
        jitter = JITTERS[step.index].astype(np.float64)
        motion = i["motion"] * [1, -1]
        expected = i["prev_position"][..., :3] @ step.pair.prev_forward
        depth = i["position"][..., 3]
        dilated = reference.fsr2_dilate(depth, {"motion": motion, "expected": np.where(depth > 0, expected, 0.0)})
        clear = np.zeros(depth.shape)
        if before_depth is not None:
            at = pixels(SMALL) + dilated["motion"] + jitter - JITTERS[step.index - 1]
            clear = reference.fsr2_depth_clip(at, dilated["expected"], before_depth, 0.05)
        color = reference.fsr2_tone_mapped(i["radiance"][..., :3])
        most = {
            n: np.max(list(reference.neighbors(i[n]).values()), axis=0)[..., 0] for n in ("reactive", "transparency")
        }
        divergence = reference.fsr2_motion_divergence(motion, dilated, before_motion, GRIDS)
        most["transparency"] = np.maximum(most["transparency"], divergence)
        blocks = reference.fsr2_block_luminance(i["radiance"][..., :3])
        thin = reference.fsr2_thin_features(reference.ycocg_from_rgb(color)[..., 0], 1.05)
        frame = Prepared(color, thin, dilated["motion"], clear, dilated["depth"], blocks=blocks, **most)
        before = reference.fsr2_accumulate(
            frame, before, GRIDS, jitter, SETTINGS["max_weight"], SETTINGS["shading_change"]
        )
        before_depth, before_motion = dilated["depth"], dilated["motion"]
        out.append(np.dstack([reference.fsr2_shown(before.color, 0.8), before.kept]))
    return out


@pytest.fixture(scope="module")
def expected(steps):
    return reference_frames(steps)


def check_frames(gpu, method, steps, expected) -> None:
    for number, (got, want) in enumerate(zip(play(gpu, method, steps), expected, strict=True)):
        wrong = (np.abs(got - want) > 1e-3 + 1e-3 * np.abs(want)).any(axis=-1)
        assert wrong.mean() <= 6e-3, (
            f"frame {number}: {wrong.sum()} of {wrong.size}, largest {np.abs(got - want).max()}"
        )


def test_agrees_with_its_reference(gpu, steps, expected):
    check_frames(gpu, "fsr2-class", steps, expected)


ACCUMULATE = "accumulate.glsl"
BYPASSES = {
    "luminance_pyramid": ("luminance.glsl", "sums[0].x / sums[0].y", "sums[thread].x / 256.0"),
    "dilated_depth_and_motion": ("prepare.glsl", "ivec2 nearest = nearest_surface(p);", "ivec2 nearest = p;"),
    "previous_depth": ("prepare.glsl", " + motion + frame.jitter_px - frame.prev_jitter_px", " + 0.0 * motion"),
    "depth_clip": ("prepare.glsl", "frame.has_history == 1u ? depth_clip(at, expected) : 0.0", "1.0"),
    "dilated_masks": ("prepare.glsl", "vec2(reactive_most, max(transparency_most,",
                      "vec2(fetch_reactive(p), max(fetch_transparency(p),"),
    "tone_map": ("tone.glsl", "c / (1.0 + max(c.r, max(c.g, c.b)))", "min(c, 0.99)"),
    "lock_creation": (ACCUMULATE, "fresh = new_lock(p, at);", "fresh = false;"),
    "reprojection": (ACCUMULATE, "vec2(p) + motion;", "vec2(p);"),
    "shading_change": (ACCUMULATE, "float change = 1.0 -", "float change = 0.0 * "),
    "lock_lifetime": (ACCUMULATE, "if (change > shading_change || (!fresh && clear < 0.99)) lock.x = 0.0;", ""),
    "luminance_instability": (ACCUMULATE, "unstable(luma, now.deviation.x, earlier)", "false"),
    "upsampling": ("upsample.glsl", "lanczos2(sharp * length(vec2(q) - pixel))", "float(q == nearest)"),
    "rectification": (ACCUMULATE, "history.rgb = clamp(kept, min(near, history.rgb), max(near, history.rgb));", ""),
    "reactive_mask": (ACCUMULATE, "float reactivity = 1.0 -", "float reactivity = 0.0 *"),
    "motion_divergence": ("prepare.glsl", "max(transparency_most, motion_divergence(p, motion))", "transparency_most"),
    "composition_mask": (ACCUMULATE, "float composed = ", "float composed = 0.0 * "),
    "accumulation": (ACCUMULATE, "mix(history.rgb, now.color.rgb, share)", "now.color.rgb"),
    "rcas": ("rcas.glsl", "if (sharpen) {", "if (false) {"),
}  # fmt: skip


@pytest.mark.parametrize("stage", stages("fsr2-class"))
def test_a_bypassed_stage_is_noticed(gpu, tmp_path, steps, expected, stage):
    folder = bypassed(tmp_path / "fsr2-class", "fsr2-class", BYPASSES[stage])
    with pytest.raises(AssertionError, match="largest"):
        check_frames(gpu, folder, steps, expected)


@pytest.mark.parametrize("sharpen", [False, True])
def test_no_frame_is_brighter_than_every_sample(gpu, steps, sharpen):
    """Colored fireflies everywhere: no radiance above the largest r of all samples so far; sharpened, above 2 r + 1."""
    rng, most, noisy = np.random.default_rng(56), 0.0, []
    for step in steps:
        radiance = step.inputs["radiance"].copy()
        radiance[..., :3] = fireflies(rng, radiance.shape[:2])
        noisy.append(replace(step, inputs=step.inputs | {"radiance": radiance}))
    for step, result in zip(noisy, play(gpu, "fsr2-class", noisy, sharpen=sharpen), strict=True):
        most = max(most, step.inputs["radiance"][..., :3].max())
        assert np.isfinite(result).all() and result.min() >= 0
        assert result[..., :3].max() <= (2 * most + 1 if sharpen else most) * 1.001
        assert sharpen or result[..., :3].mean() < 1.5 * step.inputs["radiance"][..., :3].mean()


def test_the_border_is_upsampled_like_the_inside():
    """An image of equal columns has equal columns, also beyond the last samples, where part of the kernel has none."""
    image = np.repeat(np.random.default_rng(52).random((SMALL[1], 1, 3)), SMALL[0], axis=1)
    grids = Grids(SMALL, (3 * SMALL[0], 3 * SMALL[1]))
    at = grids.input_from_output(pixels(grids.output))
    for jitter in (np.array([-0.4375, -0.25]), np.array([0.46875, 0.25])):
        for sharp in (1.0, 1.99):
            color, weight, _ = reference.fsr2_upsample(image, at, jitter, np.full(at.shape[:2], sharp))
            for edge in (slice(0, 3), slice(-3, None)):  # three columns of the result for each of the inputs
                np.testing.assert_allclose(color[:, edge], color[:, 60:63], atol=1e-9)
            assert (weight >= 0).all() and weight[10, [0, -1]].min() < 0.5 * weight[10, 60:63].max()


def test_motion_divergence_of_closed_forms():
    """One motion: 0.  Two opposite ones: 1 beside the edge.  Half as fast before: 1/2, from 20 pixels on."""
    grids = Grids((40, 24), (80, 48))
    depth, flat = np.full((24, 40), 2.0), np.tile([10.0, 0.0], (24, 40, 1))
    opposite = np.where((np.arange(40) < 20)[None, :, None], flat, -flat)

    def divergence(motion, before):
        return reference.fsr2_motion_divergence(motion, {"motion": motion, "depth": depth}, before, grids)

    np.testing.assert_array_equal(divergence(flat, None), np.zeros((24, 40)))
    met = divergence(opposite, None)
    assert (met[:, 19:21] == 1).all() and not met[:, :19].any() and not met[:, 21:].any()
    np.testing.assert_allclose(divergence(flat, 0.5 * flat), 0.5)
    np.testing.assert_allclose(divergence(0.5 * flat, 0.25 * flat), 0.5 * 0.5**3)
    np.testing.assert_array_equal(divergence(flat, 2 * flat), np.zeros((24, 40)))


def test_depth_clip_of_closed_forms():
    """Nothing in front: 1.  A surface at half the depth in half the footprint: 1/2 and what its tolerance leaves."""
    before = np.full((8, 8), 4.0)
    before[:, 4:] = 2.0
    at, expected = np.array([[[3.5, 3.0], [1.0, 1.0], [5.0, 5.0]]]), np.array([[4.0, 4.0, 4.0]])
    clear = reference.fsr2_depth_clip(at, expected, before, 0.1)
    np.testing.assert_allclose(clear, [[0.5 + 0.5 * 0.1, 1.0, 0.1]])
    np.testing.assert_array_equal(reference.fsr2_depth_clip(at, 0 * expected, before, 0.1), [[0, 0, 0]])
    np.testing.assert_array_equal(reference.fsr2_depth_clip(at - 50, expected, before, 0.1), [[0, 0, 0]])


def test_noise_darkens_to_the_mean_of_its_tone_map(gpu):
    """Exponential noise x of mean 1: m / (1 - m) with m the mean of x / (1 + x): FSR2 averages tone-mapped colors."""
    rng = np.random.default_rng(55)
    noise = [rng.exponential(1.0, (*SMALL[::-1], 1)) * np.ones(3) for _ in range(24)]
    empty = dict.fromkeys(("reactive", "transparency"), np.zeros((*SMALL[::-1], 1), dtype=np.float32))
    frames = [replace(step, inputs=step.inputs | empty) for step in still_steps(SMALL, noise)]
    x = np.concatenate([image.ravel() for image in noise])
    tone_mapped = np.mean(x / (1 + x))
    last = play_frames(gpu, "fsr2-class", frames)[-1][..., :3].mean()
    assert last == pytest.approx(tone_mapped / (1 - tone_mapped), rel=0.05)
    assert last < 0.75 < 0.95 < x.mean()


def test_more_detail_than_resampled_frames():
    """A drifting fine pattern from half the size along each side, against the supersampled reference."""
    done = evaluate_methods(
        drifting_checks(), ("none", "fsr2-class"), settings(width=96, height=72, frames=(0, 12)),
        input="jittered+upscale@2", metrics=("psnr",), reference_samples=9,
    )  # fmt: skip
    last = {row["method"]: row["psnr_db"] for row in done.rows[-2:]}
    assert last["fsr2-class"] > last["none"] + 2, last
