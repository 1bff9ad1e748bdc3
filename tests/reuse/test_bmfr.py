"""BMFR against its float64 reference; each stage, bypassed, is noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references import reuse_methods as reference
from references.reuse_methods.bmfr import BLOCK
from reuse_tools import bypassed, play, stages, still_steps
from stage_tools import emitting_steps

SIZE = (80, 45)
LIMITS = {"position_limit": 0.3, "normal_limit": 0.3}
Array = np.ndarray


@pytest.fixture(scope="module")
def steps():
    return emitting_steps(SIZE, 4, seed=21)


def bmfr_frames(steps, exposure: float = 1.0) -> list[Array]:
    """The whole method in float64: color and weight of history of every frame, (h, w, 4)."""
    h, w = SIZE[1], SIZE[0]
    accumulated, filtered, antialiased = np.zeros((h, w, 4)), np.zeros((h, w, 3)), np.zeros((h, w, 3))
    out = []
    for step in steps:
        i = {n: v.astype(np.float64) for n, v in step.inputs.items() if "mask" not in n}
        surface = i["position"][..., 3:] > 0
        albedo = np.maximum(i["base_color"][..., :3], 0.01)
        emission = exposure * i["emission"][..., :3]
        now = np.where(surface, (i["radiance"][..., :3] - emission) / albedo, i["radiance"][..., :3])
        at = reference.previous_px(i["motion"])
        seen = reference.inside(at, SIZE) & (step.index > 0)
        both = np.concatenate([accumulated, filtered], axis=-1)
        kept, total = reference.consistent_blend(both, at, reference.accept_taps(i, *LIMITS.values()))
        alive = (seen & (total > 0))[..., None]
        kept = np.where(alive, kept, 0.0)
        count = kept[..., 3:4] + 1
        share = np.where(alive, np.maximum(1 / count, 0.2), 1.0)
        accumulated = np.concatenate([reference.exponential_average(now, kept[..., :3], share), count], axis=-1)
        color = reference.block_regression(accumulated[..., :3], i["position"], i["normal"][..., :3], step.index)
        share_filtered = np.where(alive, np.maximum(1 / count, 0.1), 1.0)
        filtered = reference.exponential_average(color, kept[..., 4:], share_filtered)
        shaded = reference.display_encoded(np.where(surface, filtered * albedo + emission, filtered))
        low, high = reference.neighborhood_box(shaded)
        before = reference.ycocg_from_rgb(reference.sample_history(antialiased, at))
        before = reference.rgb_from_ycocg(np.clip(before, low, high))
        blended = reference.exponential_average(shaded, before, 0.2)
        antialiased = np.where(seen[..., None], blended, shaded)
        share_taa = np.where(seen[..., None], 0.2, 1.0)
        out.append(np.concatenate([reference.display_decoded(antialiased), 1 - share * share_filtered * share_taa], -1))
    return out


def check_frames(gpu, method, steps, expected) -> None:
    """Every frame agrees up to rounding, except for a few pixels at a threshold."""
    for got, want in zip(play(gpu, method, steps, LIMITS, exposure=0.5), expected, strict=True):
        wrong = (np.abs(got - want) > 3e-4 + 3e-4 * np.abs(want)).any(axis=-1)
        assert wrong.mean() <= 4e-3, f"{wrong.sum()} of {wrong.size}, largest {np.abs(got - want).max()}"


@pytest.fixture(scope="module")
def expected(steps):
    return bmfr_frames(steps, exposure=0.5)


def test_bmfr_agrees_with_its_reference(gpu, steps, expected):
    check_frames(gpu, "bmfr", steps, expected)


BYPASSES = {
    "accumulation": ("accumulate.glsl", "mix(mean.rgb, now, share)", "now"),
    "tap_rejection": ("taps.glsl", "return !surface || (", "return true || ("),
    "demodulation": ("albedo.glsl", "return max(base_color.rgb, vec3(0.01));", "return vec3(1.0);"),
    "regression": ("regression.glsl", "write_fitted(p, vec4(color, 1.0))", "write_fitted(p, fetch_accumulated(p))"),
    "feature_scaling": ("regression.glsl", "vec3 range = max(", "vec3 range = vec3(1.0); vec3 unused = max("),
    "second_order_features": ("regression.glsl", "f[7 + i] = scaled[i] * scaled[i];", "f[7 + i] = 0.0;"),
    "feature_noise": ("regression.glsl", "vec4 more = noise *", "vec4 more = 0.0 *"),
    "mirrored_border": ("regression.glsl", "i = i < 0 ? -i - 1 : i;", "i = max(i, 0);"),
    "block_offsets": ("noise.glsl", "if (!shift_blocks) return", "return"),
    "filtered_accumulation": ("accumulate_filtered.glsl", "if (total > 0.0) color =", "if (false) color ="),
    "modulation": ("accumulate_filtered.glsl", "color * albedo_of(fetch_base_color(p)) + ", "color + "),
    "taa": ("taa.glsl", "share = alpha_taa;", "share = 1.0;"),
}  # fmt: skip


@pytest.mark.parametrize("stage", stages("bmfr"))
def test_a_bypassed_stage_is_noticed(gpu, tmp_path, steps, expected, stage):
    folder = bypassed(tmp_path / "bmfr", "bmfr", BYPASSES[stage])
    with pytest.raises(AssertionError, match="largest"):
        check_frames(gpu, folder, steps, expected)


def test_noise_left_after_the_fit(gpu):
    """Independent noise of variance s^2 in n pixels leaves s^2 k / n after a fit of k independent features.

    On the floor that is 1, both horizontal positions and their squares: the height and the normal are constant."""
    size = (BLOCK, BLOCK)
    step = still_steps(size, [np.ones((BLOCK, BLOCK, 3))])[0]
    x, z = np.meshgrid(np.linspace(-2, 2, BLOCK), np.linspace(-5, -1, BLOCK))
    inputs = dict(step.inputs)
    inputs["position"] = np.stack([x, np.full_like(x, -1.0), z, -z], axis=-1)
    inputs["normal"] = np.broadcast_to([0.0, 1.0, 0.0], (BLOCK, BLOCK, 3))
    inputs["base_color"], inputs["emission"] = np.ones((BLOCK, BLOCK, 4)), np.zeros((BLOCK, BLOCK, 3))
    rng = np.random.default_rng(23)
    errors = []
    for _ in range(12):
        radiance = np.concatenate([1 + 0.1 * rng.normal(size=(BLOCK, BLOCK, 3)), np.ones((BLOCK, BLOCK, 1))], axis=-1)
        now = replace(step, inputs=inputs | {"radiance": radiance})
        errors.append(play(gpu, "bmfr", [now], {"shift_blocks": False})[0][..., :3] - 1.0)
    # Each color has 5 degrees of freedom: 180 in all, so that the standard deviation of the mean is sqrt(2 / 180).
    left = np.mean(np.square(errors)) / (0.1**2 * 5 / BLOCK**2)
    assert abs(left - 1) < 4 * np.sqrt(2 / 180), left
