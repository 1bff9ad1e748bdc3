"""Image measures against closed forms; classes and weights against a direct count."""

from __future__ import annotations

import numpy as np
import pytest
from references.reuse_methods import previous_px, sample_history
from reuse_tools import truth_of, with_weight

from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.reuse import quality
from taubench_gl.reuse.scores import CLASSES, ClassErrors, MethodRecord, classify, weights

H, W = 24, 32
RNG = np.random.default_rng(3)


def flat(value: float) -> np.ndarray:
    return np.full((H, W, 3), value)


def test_psnr_of_a_constant_error():
    error = quality.squared_error(flat(0.4), flat(0.5))
    np.testing.assert_allclose(error, 0.01)
    assert quality.psnr(float(error.mean())) == pytest.approx(20.0)
    assert quality.psnr(0.0) is None


def test_relative_error_of_constant_images():
    got = quality.relative_squared_error(flat(3.0), flat(2.0))
    np.testing.assert_allclose(got, 1.0 / 4.01)
    np.testing.assert_allclose(quality.relative_squared_error(flat(0.1), flat(0.0)), 1.0)


def test_ssim_of_flat_images_is_its_luminance_term():
    a, b, c1 = 0.3, 0.6, 0.01**2
    assert quality.ssim(flat(a), flat(b)) == pytest.approx((2 * a * b + c1) / (a * a + b * b + c1), abs=1e-9)
    noise = RNG.random((H, W, 3))
    assert quality.ssim(noise, noise) == pytest.approx(1.0)
    assert quality.ssim(noise[:10], noise[:10]) is None


def test_flip_of_equal_images_and_of_nan():
    image = RNG.random((H, W, 3))
    assert quality.flip_map(image, image).max() == 0.0
    black_on_white = quality.flip_map(flat(0.0), flat(1.0))
    assert black_on_white.shape == (H, W) and 0.9 < black_on_white.min() <= black_on_white.max() <= 1.0
    broken = image.copy()
    broken[3, 4] = np.nan
    for pair in ((broken, image), (image, broken)):
        with pytest.raises(ValueError, match="finite"):
            quality.flip_map(*pair)


def test_display_is_srgb():
    np.testing.assert_allclose(quality.display(flat(0.5))[0, 0], 0.735357, atol=1e-6)
    np.testing.assert_allclose(quality.display(flat(1.0), "reinhard"), quality.display(flat(0.5)))


def test_history_is_sampled_along_motion():
    image = RNG.random((H, W, 3))
    motion = np.zeros((H, W, 2))
    motion[...] = 3.0, -2.0
    got = quality.history_of(image, motion)
    np.testing.assert_array_equal(got[2:, :-3], image[:-2, 3:])
    np.testing.assert_array_equal(got[0, -1], image[0, -1])  # outside: the border
    np.testing.assert_array_equal(quality.history_of(image, motion + 0.49), got)
    assert quality.history_of(image, np.full((H, W, 2), 1e6)).shape == image.shape


def test_history_between_two_pixels_matches_the_masks():
    image = RNG.random((H, W, 3))
    motion = np.zeros((H, W, 2))
    motion[...] = 0.5, 0.5
    expected = sample_history(image, previous_px(motion), "nearest")
    np.testing.assert_array_equal(quality.history_of(image, motion), expected)


def test_flicker_of_pure_motion_and_of_the_reference():
    before, everywhere = RNG.random((H, W, 3)), np.ones((H, W), dtype=bool)
    motion = np.zeros((H, W, 2))
    motion[..., 0] = -2.0
    after = quality.history_of(before, motion)
    still = flat(0.5)
    assert quality.flicker(after, before, still, still, motion, everywhere) == 0.0
    now, then = RNG.random((2, H, W, 3))
    assert quality.flicker(now, then, now, then, motion, everywhere) == 0.0


def test_flicker_of_alternating_brightness_with_a_mask():
    now, then, still, motion = flat(0.6), flat(0.4), flat(0.5), np.zeros((H, W, 2))
    half = np.zeros((H, W), dtype=bool)
    half[:, : W // 2] = True
    assert quality.flicker(now, then, still, still, motion, half) == pytest.approx(0.2)
    then[:, W // 2 :] = 0.6  # the other half is still, but not reusable
    assert quality.flicker(now, then, still, still, motion, half) == pytest.approx(0.2)
    assert quality.flicker(now, then, still, still, motion, half | True) == pytest.approx(0.1)
    assert quality.flicker(now, then, still, still, motion, half & False) is None


def test_temporal_error_of_constant_and_alternating_bias():
    reference = RNG.random((2, H, W, 3))
    constant = reference + 0.1  # the same error in every frame
    np.testing.assert_allclose(quality.temporal_squared_error(*constant, *reference), 0.0, atol=1e-30)
    alternating = reference + np.array([0.1, -0.1])[:, None, None, None]
    np.testing.assert_allclose(quality.temporal_squared_error(*alternating, *reference), 0.04)


@pytest.mark.parametrize(
    ("word", "name"),
    [
        (0, "rest"),
        (Reason.HISTORY_SKY, "rest"),
        (Reason.SKY | Reason.HISTORY_SKY, "sky"),
        (Reason.FIRST | Reason.SKY, "not_classified"),
        (Reason.OUTSIDE | Reason.SKY, "frustum"),
        (Reason.POSITION | Reason.NORMAL | Reason.DISOCCLUDED | Reason.LIT | Reason.DIRECT, "disoccluded"),
        (Reason.NORMAL | Reason.DIRECT | Reason.LIT, "geometry"),
        (Reason.DIRECT | Reason.SHADOWED | Reason.COLOR, "shadowed"),
        (Reason.COLOR, "light"),
    ],
)
def test_class_of_mask_word(word, name):
    assert list(CLASSES)[classify(np.array([[int(word)]], dtype=np.uint32))[0, 0]] == name


def test_reusable_pixels():
    words = [0, Reason.SKY | Reason.HISTORY_SKY, Reason.COLOR, Reason.FIRST, *FRUSTUM, Reason.NORMAL, Reason.INVALID]
    got = quality.reusable(np.array([[int(w) for w in words]], dtype=np.uint32))
    assert got.tolist() == [[True, True] + [False] * (len(words) - 2)]


def test_errors_by_class_add_up():
    classes = RNG.integers(0, len(CLASSES) - 2, (2, H, W)).astype(np.int8)  # two classes stay empty
    errors = RNG.random((2, H, W))
    sums = ClassErrors()
    for c, e in zip(classes, errors):
        sums.add(c, {"mse": e}, np.full((H, W), True))
    found = sums.summary()
    assert sum(entry["pixels"] for entry in found.values()) == 2 * H * W
    assert sum(e["pixels"] * e["mse"] for e in found.values() if e["pixels"]) == pytest.approx(errors.sum())
    for index, name in enumerate(CLASSES):
        inside = errors[classes == index]
        assert found[name]["mse"] == (pytest.approx(inside.mean()) if inside.size else None)


def test_weights_against_the_exact_mask():
    weight = np.array([[0.0, 0.9], [0.5, 0.0]])
    allowed = np.array([[True, True], [False, False]])
    found = weights(weight, allowed)
    assert found == {
        "reused_percent": 50.0, "mean_weight": 0.35, "wrongly_reused_percent": 25.0, "wrongly_rejected_percent": 25.0,
    }  # fmt: skip
    assert weights(weight, None)["wrongly_reused_percent"] is None
    assert set(weights(np.array([[0.5, -1.0]]), allowed[:1]).values()) == {None}


@pytest.mark.parametrize("broken_frame", [0, 1])
def test_invalid_pixel_has_no_temporal_error(broken_frame):
    """An invalid pixel is black; neither its frame nor the next one counts the change to black and back."""
    record, previous = MethodRecord("m", frozenset({"tpsnr", "flicker"}), True), None
    for frame in range(2):
        truth, result = truth_of(flat(0.5), frame, previous), with_weight(flat(0.5), 1.0)
        if frame == broken_frame:
            result[5, 6, :3] = np.nan
        record.add(truth, result, "linear", None)
        previous = truth.image
    assert record.rows[1]["tpsnr_db"] is None and record.rows[1]["flicker"] == 0.0
    assert record.summary()["invalid_pixels"] == 1


def test_weight_that_is_not_finite_counts_as_zero():
    found = weights(np.array([[np.nan, 0.5]]), np.array([[True, True]]))
    assert found["mean_weight"] == 0.25 and found["wrongly_rejected_percent"] == 50.0
