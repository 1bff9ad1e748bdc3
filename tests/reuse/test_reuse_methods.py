"""Properties of the built-in methods: 1 / n convergence, still images, box bounds, warps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from references.shading_rate import nearest_shaded, shaded
from repeated import few
from reuse_tools import display, frame_methods, play, still_steps

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.gpu.shader import find_source
from taubench_gl.reuse.loading import builtin_methods, load_method
from taubench_gl.reuse.synthetic import LENS, synthetic_steps

SIZE = (48, 27)


def test_builtin_methods_are_documented():
    for name in builtin_methods():
        method = load_method(name)
        assert method.name == name and method.title != name and method.cite
        for setting in method.settings.values():
            assert setting.doc, f"{name}: {setting.name}"
            if setting.kind in ("int", "float"):
                assert setting.minimum is not None and setting.maximum is not None, f"{name}: {setting.name}"
        for info in method.passes:
            assert find_source(info.shader, method.shader_folders).read_text().startswith("//")


NO_IDENTITY = {"bmfr", "reblur-class", "oidn", "fsr2-class", *set(builtin_methods()) - set(frame_methods())}
"""Spatial filters; the kernel of fsr2-class is radial, so that it also weighs diagonal neighbors.  Methods that compute
their direct light themselves get no image."""


@pytest.mark.parametrize("name", few(sorted(set(builtin_methods()) - NO_IDENTITY), 6))
def test_converged_still_image_is_unchanged(gpu, name):
    """Details of single pixels: within 1/255 in display colors, in every later frame."""
    rng = np.random.default_rng(3)
    image = rng.random((SIZE[1], SIZE[0], 3)) ** 2
    results = play(gpu, name, still_steps(SIZE, [image] * 100))
    for result in results[-3:]:
        assert np.abs(display(result) - display(image)).max() <= 1 / 255
    assert np.isfinite(results).all()


@pytest.mark.parametrize(("name", "rate"), [("checkerboard", "checkerboard"), ("upsample_2x2", "quarter")])
def test_partly_shaded_still_image_is_completed(gpu, name, rate):
    """After one cycle of the pattern every pixel was shaded once, and history keeps it."""
    rng = np.random.default_rng(4)
    image = rng.random((SIZE[1], SIZE[0], 3))
    radiances = []
    for frame in range(8):
        at = nearest_shaded(rate, SIZE, frame)
        filled = image[at[..., 1], at[..., 0]]
        radiances.append(np.concatenate([filled, shaded(rate, SIZE, frame)[..., None]], axis=-1))
    settings = {"clamping": False} if name == "checkerboard" else {}
    results = play(gpu, name, still_steps(SIZE, radiances), settings)
    assert np.abs(results[0][..., :3] - image).max() > 0.2, "the first frame is incomplete"
    for result in results[4:]:
        np.testing.assert_allclose(result[..., :3], image, atol=1e-5)


def test_accumulation_converges_as_one_over_n(gpu):
    """Independent noise: the mean of n frames has 1/n of the variance."""
    rng = np.random.default_rng(5)
    h, w = SIZE[1], SIZE[0]
    frames = rng.gamma(10.0, 0.1, (64, h, w, 3))  # mean 1, variance 0.1, excess kurtosis 0.6
    results = play(gpu, "accumulate", still_steps(SIZE, frames), {"cap": 1000000})
    for n in (1, 2, 4, 8, 16, 32, 64):
        np.testing.assert_allclose(results[n - 1][..., :3], frames[:n].mean(axis=0), rtol=2e-6)
        error = results[n - 1][..., :3].astype(np.float64) - 1.0
        # Variance of a sample variance of K independent values: (2 + excess kurtosis / n) / K.
        spread = math.sqrt((2 + 0.6 / n) / error.size)
        assert abs(np.mean(error**2) * n / 0.1 - 1) < 5 * spread, n
    np.testing.assert_allclose(results[7][..., 3], 1 - 1 / 8, rtol=1e-6)


def rotation(yaw: float, pitch: float, roll: float) -> np.ndarray:
    out = np.eye(3)
    for (i, j), degrees in zip(((2, 0), (1, 2), (0, 1)), (yaw, pitch, roll)):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        turn = np.eye(3)
        turn[[i, j], [i, j]], turn[i, j], turn[j, i] = c, -s, s
        out = out @ turn
    return out


def warp(gpu, size, views, images, **settings):
    """The time warp over frames with the given views and images."""
    base = list(synthetic_steps(size, 2, speed=0.0, noise=0.0))[1]
    steps = []
    for i, (view, image) in enumerate(zip(views, images)):
        prev = views[max(i - 1, 0)]
        radiance = np.concatenate([image, np.ones((*image.shape[:2], 1))], axis=-1)
        inputs = base.inputs | {"radiance": radiance}
        steps.append(replace(base, index=i, inputs=inputs, pair=reprojection(view, prev, *size), view=view,
                             prev_view=prev, clean=image))  # fmt: skip
    return play(gpu, "timewarp", steps, settings)


def test_time_warp_shades_every_nth_frame(gpu):
    size = (32, 18)
    view = View(np.zeros(3), np.eye(3), LENS)
    images = [np.full((18, 32, 3), float(i)) for i in range(7)]
    shown = [r[9, 16, 0] for r in warp(gpu, size, [view] * 7, images, every=3)]
    np.testing.assert_allclose(shown, [0, 0, 0, 3, 3, 3, 6])


@pytest.mark.parametrize(
    ("setting", "spoil"),
    [
        ("depth_limit", "history_position"), ("normal_limit", "history_normal"), ("check_ids", "history_ids"),
    ],
)  # fmt: skip
def test_svgf_tests_each_feature_separately(gpu, setting, spoil):
    """History of the left half has another depth, normal or object: only the right half is reused."""
    step = still_steps(SIZE, [np.full((SIZE[1], SIZE[0], 3), 0.5)] * 2)
    surface = step[1].inputs["position"][..., 3] > 0
    left = surface & (np.arange(SIZE[0]) < SIZE[0] // 2 - 2)
    right = surface & (np.arange(SIZE[0]) > SIZE[0] // 2 + 2)
    spoiled = step[1].inputs[spoil].copy()
    half = spoiled[:, : SIZE[0] // 2]
    if spoil == "history_position":
        half[..., 3] *= 1.9  # more than any neighbor differs by
    elif spoil == "history_normal":
        half[...] = -half
    else:
        half[...] += 7
    steps = [step[0], replace(step[1], inputs=step[1].inputs | {spoil: spoiled})]
    kept = play(gpu, "svgf", steps)[1][..., 3]
    assert (kept[left] == 0).all() and (kept[right] > 0.4).all()
    lax = {"depth_limit": 1.0, "normal_limit": 0.0, "check_ids": False}[setting]
    kept = play(gpu, "svgf", steps, {setting: lax})[1][..., 3]
    # Opposite normals have cosine -1, which even the laxest limit of 0 refuses.
    assert (kept[left] == 0).all() if spoil == "history_normal" else (kept[left] > 0.4).all()
