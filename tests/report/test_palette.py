"""Mask colors are distinguishable for normal vision and for simulated color vision deficiencies."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from vision_tools import SIGHTS, oklab

from taubench_gl.conventions import FRUSTUM, Reason
from taubench_gl.glossary import key_of
from taubench_gl.report.palette import EXACT_COLORS, REASON_COLORS, SERIES_COLORS

MINIMUM = 0.05
"""Smallest OKLab distance of any two.  The nearest pairs are related: sky and history sky; direct and brightened."""
SHADOWED = 0.09
"""Smallest distance of darkened to any other, to which it is adjacent in every image of a moving light."""


def test_oklab_of_white_and_red():
    np.testing.assert_allclose(oklab((255, 255, 255)), (1.0, 0.0, 0.0), atol=1e-3)
    np.testing.assert_allclose(oklab((255, 0, 0)), (0.62796, 0.22486, 0.12585), atol=1e-3)


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


@pytest.mark.parametrize("sight", SIGHTS)
def test_series_have_no_color_of_a_reason(sight):
    series = [tuple(bytes.fromhex(color[1:])) for color in SERIES_COLORS]
    for color, other in [*itertools.product(series, REASON_COLORS.values()), *itertools.combinations(series, 2)]:
        assert np.linalg.norm(oklab(color, sight) - oklab(other, sight)) >= 0.09, (color, other)
