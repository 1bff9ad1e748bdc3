"""Mask colors are distinguishable for normal vision and for simulated color vision deficiencies.

Source: OKLab, B. Ottosson 2020; simulated deficiencies: G. M. Machado, M. M. Oliveira, L. A. F. Fernandes, "A
Physiologically-based Model for Simulation of Color Vision Deficiency", IEEE TVCG 15(6), 2009, matrices of severity 1.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.glossary import key_of
from taubench_gl.report.palette import EXACT_COLORS, REASON_COLORS

SIGHTS = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900],
    ],
}  # fmt: skip
LMS = np.array([
    [0.4122214708, 0.5363325363, 0.0514459929],
    [0.2119034982, 0.6806995451, 0.1073969566],
    [0.0883024619, 0.2817188376, 0.6299787005],
])  # fmt: skip
LAB = np.array([
    [0.2104542553, 0.7936177850, -0.0040720468],
    [1.9779984951, -2.4285922050, 0.4505937099],
    [0.0259040371, 0.7827717662, -0.8086757660],
])  # fmt: skip

MINIMUM = 0.05
"""Smallest OKLab distance of any two.  The nearest pairs are related: sky and history sky; direct and brightened."""
SHADOWED = 0.09
"""Smallest distance of darkened to any other, to which it is adjacent in every image of a moving light."""


def oklab(rgb, sight="normal"):
    """8-bit sRGB as seen with ``sight`` -> (3,) L, a, b."""
    encoded = np.asarray(rgb) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return LAB @ np.cbrt(LMS @ np.clip(np.asarray(SIGHTS[sight]) @ linear, 0.0, 1.0))


def test_oklab_of_white_and_red():
    np.testing.assert_allclose(oklab((255, 255, 255)), (1.0, 0.0, 0.0), atol=1e-3)
    np.testing.assert_allclose(oklab((255, 0, 0)), (0.62796, 0.22486, 0.12585), atol=1e-3)


def test_deficiencies_reduce_red_green_contrast_only():
    """Red and green converge without red or green cones but not without blue ones; grays do not change."""
    red, green = (0xC0, 0x50, 0x40), (0x70, 0x80, 0x38)
    distance = {sight: np.linalg.norm(oklab(red, sight) - oklab(green, sight)) for sight in SIGHTS}
    assert max(distance["protanopia"], distance["deuteranopia"]) < 0.75 * min(
        distance["normal"], distance["tritanopia"]
    )
    for sight in SIGHTS:
        np.testing.assert_allclose(oklab((128, 128, 128), sight), oklab((128, 128, 128)), atol=2e-3)


@pytest.mark.parametrize("sight", SIGHTS)
def test_any_two_colors_differ(sight):
    shown = [reason for reason in REASON_COLORS if reason != Reason.OUTSIDE]  # OUTSIDE has the color of frustum
    assert REASON_COLORS[Reason.OUTSIDE] == REASON_COLORS[FRUSTUM]
    for a, b in itertools.combinations(shown, 2):
        distance = np.linalg.norm(oklab(REASON_COLORS[a], sight) - oklab(REASON_COLORS[b], sight))
        least = SHADOWED if Reason.SHADOWED in (a, b) else MINIMUM
        assert distance >= least, f"{key_of(a)} and {key_of(b)}: {distance:.3f}"


@pytest.mark.parametrize("sight", SIGHTS)
def test_any_two_exact_reasons_differ(sight):
    for a, b in itertools.combinations(EXACT_COLORS, 2):
        assert np.linalg.norm(oklab(EXACT_COLORS[a], sight) - oklab(EXACT_COLORS[b], sight)) >= 2 * MINIMUM, f"{a}, {b}"
