"""Still scenes: the error of an exponential average falls to sqrt(a / (2 - a))."""

from __future__ import annotations

import math
from contextlib import ExitStack

import numpy as np
import pytest
from reuse_scenes import still
from reuse_tools import open_inputs, play, still_steps

from taubench_gl.frame.targets import read_channel
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.runner import MethodRunner

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


@pytest.mark.long
def test_path_traced_still_scene(gpu):
    """One sample per pixel in every frame; the error is half the squared difference of two seeds."""
    count, alpha = 32, 0.125
    choices = {"none": {}, "running": {"cap": 1000000}, "exponential": {"cap": round(1 / alpha)}}
    images = {name: [] for name in choices}
    for seed in (1, 2):
        with ExitStack() as stack:
            reads = ("radiance", "motion", "position")
            changes = {"indirect": "auto"}
            inputs = stack.enter_context(open_inputs(gpu, still(), "path-traced@1", reads, seed=seed, settings=changes))
            runners = {n: stack.enter_context(MethodRunner(gpu, "accumulate", inputs.size, v))
                       for n, v in choices.items() if n != "none"}  # fmt: skip
            for index in range(count):
                frame = inputs.advance(index)
                found = {name: read_result(runner.step(frame)) for name, runner in runners.items()}
                found["none"] = read_channel(frame.textures["radiance"], "radiance").copy()
            for name, image in found.items():
                images[name].append(image[..., :3].astype(np.float64))
    error = {name: math.sqrt(np.mean((a - b) ** 2) / 2) for name, (a, b) in images.items()}
    assert error["none"] > 0.01
    assert error["running"] / error["none"] == pytest.approx(1 / math.sqrt(count), rel=0.15), error
    assert error["exponential"] / error["none"] == pytest.approx(math.sqrt(alpha / (2 - alpha)), rel=0.15), error
