"""Metered exposure against closed forms in float64."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.metrics.exposure import metered_exposure, rounded, surface_luminance


def test_uniform_luminance_becomes_middle_gray():
    assert metered_exposure([np.full(10, 4.0)]) == pytest.approx(0.18 / 4.0, rel=1e-15)


def test_the_mean_is_logarithmic_over_all_frames():
    frames = [np.array([1.0, 2.0]), np.array([]), np.array([4.0, 8.0, 16.0])]
    assert metered_exposure(frames) == pytest.approx(0.18 / 4.0, rel=1e-14)


def test_pixels_below_a_thousandth_of_the_largest_take_no_part():
    assert metered_exposure([np.array([1000.0, 1.0, 0.5, 0.0])]) == pytest.approx(0.18 / 1000.0)
    assert metered_exposure([np.array([1000.0, 1.001])]) == pytest.approx(0.18 / np.sqrt(1001.0))
    # The largest is that of all frames.
    assert metered_exposure([np.array([1000.0]), np.array([0.9, 0.8])]) == pytest.approx(0.18 / 1000.0)


def test_highlights_of_few_pixels_take_no_part():
    """The sun in a mirror is 100000 times as bright as everything else."""
    frame = np.concatenate([np.full(5, 1e6), np.full(3, 1e-9), np.full(92, 4.0)])
    assert metered_exposure([frame]) == pytest.approx(0.18 / 4.0, rel=1e-12)
    mostly = np.concatenate([np.full(10, 1e6), np.full(90, 4.0)])
    assert metered_exposure([mostly]) == pytest.approx(0.18 / 1e6, rel=1e-12)


@pytest.mark.parametrize("frames", [[], [np.zeros(0)], [np.zeros(5), np.zeros(3)]])
def test_black_frames_give_no_exposure(frames):
    assert metered_exposure(frames) is None


@pytest.mark.parametrize("factor", [683.0, 1.0 / 50.0, 1e20, 1e-20])
def test_the_exposure_is_inverse_to_the_light(factor):
    light = np.random.default_rng(1).lognormal(size=1000)
    assert metered_exposure([factor * light]) == pytest.approx(metered_exposure([light]) / factor, rel=1e-12)


@pytest.mark.parametrize(
    ("exposure", "expected"), [(0.123456, 0.1235), (123456.0, 123500.0), (1.0, 1.0), (9.99996e-7, 1e-6), (0.5, 0.5)]
)
def test_four_significant_digits(exposure, expected):
    assert rounded(exposure) == expected


def test_luminance_of_finite_surface_pixels():
    radiance = np.zeros((2, 3, 4), dtype=np.float32)
    radiance[0, 0] = (1.0, 2.0, 4.0, 1.0)
    radiance[0, 1] = (np.nan, 1.0, 1.0, 1.0)
    radiance[0, 2] = (np.inf, 1.0, 1.0, 1.0)
    radiance[1, 0] = (7.0, 7.0, 7.0, 1.0)  # sky
    position = np.ones((2, 3, 4), dtype=np.float32)
    position[1, 0, 3] = 0.0
    found = np.sort(surface_luminance(radiance, position))
    assert found.dtype == np.float64
    assert found == pytest.approx([0.0, 0.0, 0.2126 + 2 * 0.7152 + 4 * 0.0722])
