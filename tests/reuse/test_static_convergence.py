"""Still scenes: the error of a running mean falls as N^-1/2, that of an exponential average to sqrt(a / (2 - a))."""

from __future__ import annotations

import math

import numpy as np
import pytest
from reuse_scenes import settings, still
from reuse_tools import play, still_steps

from taubench_gl.animation import choose_camera
from taubench_gl.frame.targets import read_channel
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import InputRequest, RasterInputs
from taubench_gl.reuse.runner import MethodRunner

SIZE, SHAPE = (48, 27), 10.0  # of the gamma distribution: mean 1, variance 1 / SHAPE
COUNTS = (1, 2, 4, 8, 16, 32, 64)
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


def test_running_means_converge_as_the_square_root_of_frames(gpu):
    results = play(gpu, "accumulate", still_steps(SIZE, noise(64, seed=5)), {"cap": 1000000})
    error = np.array([relative_error(results[n - 1]) for n in COUNTS])
    slope = np.polyfit(np.log(COUNTS), np.log(error), 1)[0]
    # Relative spread of one RMS over K values: sqrt((2 + excess kurtosis / N) / K) / 2.
    spread = math.sqrt((2 + 6 / SHAPE) / results[0][..., :3].size) / 2
    assert abs(slope + 0.5) < 5 * spread / math.log(COUNTS[-1]), slope
    assert (np.abs(error * np.sqrt(COUNTS) - 1) < 5 * spread).all(), error


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
        request = InputRequest(gpu, still(), choose_camera(still()), settings(indirect="auto"),
                               parse_input("path-traced@1", seed=seed))  # fmt: skip
        inputs = RasterInputs(request, ("radiance", "motion", "position"))
        runners = {n: MethodRunner(gpu, "accumulate", inputs.size, v) for n, v in choices.items() if n != "none"}
        try:
            for index in range(count):
                frame = inputs.advance(index)
                found = {name: read_result(runner.step(frame)) for name, runner in runners.items()}
                found["none"] = read_channel(frame.textures["radiance"], "radiance").copy()
            for name, image in found.items():
                images[name].append(image[..., :3].astype(np.float64))
        finally:
            inputs.release()
            for runner in runners.values():
                runner.release()
    error = {name: math.sqrt(np.mean((a - b) ** 2) / 2) for name, (a, b) in images.items()}
    assert error["none"] > 0.01
    assert error["running"] / error["none"] == pytest.approx(1 / math.sqrt(count), rel=0.15), error
    assert error["exponential"] / error["none"] == pytest.approx(math.sqrt(alpha / (2 - alpha)), rel=0.15), error
