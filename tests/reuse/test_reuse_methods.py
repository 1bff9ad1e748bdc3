"""Properties of the built-in methods: 1 / n convergence, still images, box bounds, warps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from references.reuse_methods import neighborhood_box, variance_box, ycocg_from_rgb
from references.shading_rate import nearest_shaded, shaded
from repeated import few
from reuse_tools import display, frame_methods, play, still_steps

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.gpu.shader import find_source
from taubench_gl.reuse.loading import builtin_methods, load_method
from taubench_gl.reuse.synthetic import LENS, render_view, synthetic_steps

SIZE = (48, 27)


def test_builtin_methods_are_documented():
    assert set(builtin_methods()) == {
        "none", "accumulate", "reverse_reprojection_cache", "taa_clamp", "taa_clip", "taa_variance", "svgf", "asvgf",
        "bmfr", "bmfr_temporal", "reblur-class",
        "timewarp", "checkerboard", "upsample_2x2", "ideal-masks", "greedy", "oidn",
        "fsr2-class", "ris", "restir-di", "extrapolate", "space-warp", "interpolate", "present-last",
    }  # fmt: skip
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


@pytest.mark.parametrize("name", ["taa_clamp", "taa_clip", "taa_variance"])
def test_history_is_limited_to_the_neighborhood_box(gpu, name):
    """History of a different color is limited to the box of the current frame; without the box it is not."""
    rng = np.random.default_rng(7)
    first, second = rng.random((2, SIZE[1], SIZE[0], 3)) * [[[[1.0]]], [[[0.2]]]]
    steps = still_steps(SIZE, [5.0 + first, second])
    result = play(gpu, name, steps)[1][..., :3]
    low, high = variance_box(second) if name == "taa_variance" else neighborhood_box(second)
    color = ycocg_from_rgb(result)
    assert (color >= low - 1e-5).all() and (color <= high + 1e-5).all()
    if name == "taa_clip":
        return  # it has no setting without the box
    free = {"clamping": False} if name == "taa_clamp" else {"gamma": 8.0}
    loose = ycocg_from_rgb(play(gpu, name, steps, free)[1][..., :3])
    assert (loose > high + 1e-3).any()


def rotation(yaw: float, pitch: float, roll: float) -> np.ndarray:
    out = np.eye(3)
    for (i, j), degrees in zip(((2, 0), (1, 2), (0, 1)), (yaw, pitch, roll)):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        turn = np.eye(3)
        turn[[i, j], [i, j]], turn[i, j], turn[j, i] = c, -s, s
        out = out @ turn
    return out


def sphere_image(ray: np.ndarray) -> np.ndarray:
    """A smooth image on the sphere of directions (h, w, 3) -> (h, w, 3) in [0, 1]."""
    d = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    return 0.5 + 0.5 * np.stack([np.sin(9 * d[..., 0]), np.cos(7 * d[..., 1]), np.sin(6 * d[..., 2] + d[..., 0])], -1)


def rays_of(view: View, size: tuple[int, int]) -> np.ndarray:
    pair = reprojection(view, view, *size)
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1] - 1, -1, -1))
    return (pair.sky_origin + x[..., None] * pair.sky_dx + y[..., None] * pair.sky_dy)[..., :3]


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


def inner(view: View, key: View, size) -> np.ndarray:
    """Pixels whose ray is well inside the key frame."""
    clip = rays_of(view, size) @ key.clip_from_relative(*size)[:, :3].T
    ndc = clip[..., :2] / clip[..., 3:]
    return (np.abs(ndc) < 1 - 6 / size[1]).all(axis=-1)


@pytest.mark.parametrize("filtering", ["bilinear", "catmull_rom"])
def test_time_warp_is_exact_under_rotation(gpu, filtering):
    """Against the analytic image, up to the interpolation error, also five frames after the shaded one."""
    size = (160, 90)
    views = [View(np.array([4.0, 1.0, 2.0]), rotation(1.1 * i, -0.7 * i, 0.9 * i), LENS) for i in range(6)]
    images = [sphere_image(rays_of(view, size)) for view in views]
    # Bilinear error: 1/8 of the second difference each way, taken from the image; Catmull-Rom is of third order.
    second = max(np.abs(np.diff(images[0], n=2, axis=axis)).max() for axis in (0, 1))
    bound = 2 * second / 8 if filtering == "bilinear" else 0.25 * 2 * second / 8
    results = warp(gpu, size, views, images, every=6, filtering=filtering)
    for i in range(1, 6):
        seen = inner(views[i], views[0], size)
        assert seen.mean() > 0.7
        error = np.abs(results[i][..., :3] - images[i])[seen]
        assert error.max() <= bound + 1e-4, (i, error.max(), bound)
        assert np.abs(images[i] - images[0])[seen].max() > 20 * bound, "an unwarped frame would pass"
        assert (results[i][..., 3] == 1).all()


def test_error_of_time_warp_under_translation(gpu):
    """The warp ignores parallax: the error is that of the unwarped frame."""
    size = (160, 90)
    still = rotation(0, -8, 0)
    for sideways in (0.0, 0.3):
        views = [View(np.array([sideways * i, 0.6, 0.0]), still, LENS) for i in range(2)]
        images = [render_view(view, 0.0, size)["radiance"] for view in views]
        error = np.abs(warp(gpu, size, views, images, every=2)[1][..., :3] - images[1])
        if sideways:
            assert (error.max(axis=-1) > 0.1).mean() > 0.05
        else:
            assert error.max() < 1e-4


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
