"""Still scenes: the error of an exponential average falls to sqrt(a / (2 - a))."""

from __future__ import annotations

import math

import numpy as np
import pytest
from reuse_tools import play, still_steps

SIZE, SHAPE = (48, 27), 10.0  # of the gamma distribution: mean 1, variance 1 / SHAPE
ALPHAS = (0.5, 0.2, 0.1)

EXPONENTIAL = {
    "accumulate": lambda a: {"cap": round(1 / a)},
    "taa_clamp": lambda a: {"alpha": a, "clamping": False, "weighting": False},
    "bmfr_temporal": lambda a: {"alpha": a},
}
"""Methods without a spatial filter, with the settings that leave their temporal average alone."""


def noise(frames: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.gamma(SHAPE, 1 / SHAPE, (frames, SIZE[1], SIZE[0], 3))


def relative_error(result: np.ndarray) -> float:
    """RMS error relative to that of one frame."""
    return float(np.sqrt(np.mean((result[..., :3].astype(np.float64) - 1.0) ** 2) * SHAPE))


@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("name", EXPONENTIAL)
def test_exponential_averages_converge_to_their_plateau(gpu, name, alpha):
    """After 8 / a frames the start has a weight below e^-8."""
    frames = round(8 / alpha)
    last = play(gpu, name, still_steps(SIZE, noise(frames, seed=6)), EXPONENTIAL[name](alpha))[-1]
    expected = math.sqrt(alpha / (2 - alpha))
    assert abs(relative_error(last) / expected - 1) < 5 * math.sqrt((2 + 6 / SHAPE) / last[..., :3].size) / 2
    assert abs(relative_error(last) / math.sqrt(1 / frames) - 1) > 0.2, "a running mean would pass"
