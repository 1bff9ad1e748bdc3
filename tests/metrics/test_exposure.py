"""Metered exposure against closed forms in float64."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.metrics.exposure import metered_exposure, rounded


def gray(*luminance: float) -> np.ndarray:
    """Gray pixels of these luminances, (n, 3)."""
    return np.repeat(np.array(luminance, dtype=np.float64)[:, None], 3, axis=1)


def test_the_mean_is_logarithmic_and_black_pixels_take_no_part():
    assert metered_exposure(gray(1.0, 1.0, 4.0, 4.0, 0.0)) == pytest.approx(0.18 / 2.0, rel=1e-14)


def test_the_darkest_and_the_brightest_tenth_take_no_part():
    """90 pixels of 4, five of each extreme: below the 10th and above the 90th percentile."""
    pixels = gray(*[4.0] * 90, *[1e-9] * 5, *[1e6] * 5)
    assert metered_exposure(pixels) == pytest.approx(0.18 / 4.0, rel=1e-12)
    dark = gray(*[4.0] * 80, *[1.0] * 20)  # a fifth is dark: the 10th percentile is 1, so these take part
    assert metered_exposure(dark) == pytest.approx(0.18 / 4.0**0.8, rel=1e-12)


@pytest.mark.parametrize("bright", [4, 5, 6, 30])
def test_at_most_a_twentieth_of_the_lit_pixels_clips(bright):
    """``bright`` of 100 lit pixels would clip at the exposure of the others, 0.18: a red channel of 30."""
    pixels = gray(*[1.0] * (100 - bright), *[0.0] * 50)
    red = np.repeat(np.array([[30.0, 0.1, 0.1]]), bright, axis=0)
    pixels = np.concatenate([pixels, red])
    exposure = metered_exposure(pixels)
    clipped = np.sum((exposure * pixels > 1.0).any(axis=-1))
    assert clipped <= 5
    assert exposure == pytest.approx(0.18 if bright <= 5 else 1.0 / 30.0, rel=1e-12)


@pytest.mark.parametrize("pixels", [np.zeros((0, 3)), np.zeros((5, 3))])
def test_black_frames_give_no_exposure(pixels):
    assert metered_exposure(pixels) is None


@pytest.mark.parametrize("factor", [683.0, 1.0 / 50.0, 1e20, 1e-20])
def test_the_exposure_is_inverse_to_the_light(factor):
    light = np.random.default_rng(1).lognormal(size=(1000, 3))
    assert metered_exposure(factor * light) == pytest.approx(metered_exposure(light) / factor, rel=1e-12)


@pytest.mark.parametrize(
    ("exposure", "expected"),
    [(0.123456, 0.1234), (123456.0, 123400.0), (1.0, 1.0), (9.99996e-7, 9.999e-7), (0.5, 0.5), (1.0 / 3.0, 0.3333)],
)
def test_four_significant_digits_never_above(exposure, expected):
    assert rounded(exposure) == expected


def test_a_weight_counts_as_so_many_pixels():
    rng = np.random.default_rng(5)
    pixels, weights = rng.lognormal(sigma=2.0, size=(300, 3)), rng.integers(1, 9, 300)
    assert metered_exposure(pixels, weights.astype(float)) == pytest.approx(
        metered_exposure(np.repeat(pixels, weights, axis=0)), rel=1e-12
    )
