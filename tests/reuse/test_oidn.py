"""Open Image Denoise per frame: what it is given, what it is good for, and one line where it is missing."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from reuse_tools import play, still_steps

from taubench_gl.errors import MethodError
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.synthetic import synthetic_steps

SIZE = (64, 36)


@pytest.fixture
def pyoidn():
    return pytest.importorskip("pyoidn", reason="the extra oidn is not installed", exc_type=ImportError)


@pytest.fixture(scope="module")
def step():
    return list(synthetic_steps(SIZE, 2, noise=0.5))[1]


def rms(image, step) -> float:
    return float(np.sqrt(np.mean((image[..., :3] - step.clean) ** 2)))


@pytest.mark.parametrize(
    ("choice", "given"),
    [("none", ()), ("base_color", ("albedo",)), ("base_color_normal", ("albedo", "normal"))],
)
def test_the_result_is_that_of_the_library(gpu, pyoidn, step, choice, given):
    """The images arrive upright and in linear radiance: equal to a call of the library."""
    got = play(gpu, "oidn", [step], {"auxiliary": choice, "quality": "fast"})[0]
    inputs = {n: step.inputs[n][..., :3].astype(np.float32) for n in ("radiance", "normal")}
    albedo = step.inputs["base_color"][..., :3].astype(np.float16).astype(np.float32)
    auxiliary = {"albedo": albedo, "normal": np.ascontiguousarray(inputs["normal"])}
    expected = pyoidn.denoise(np.ascontiguousarray(inputs["radiance"]), hdr=True, clean_aux=bool(given), quality="fast",
                              **{name: auxiliary[name] for name in given})  # fmt: skip
    np.testing.assert_allclose(got[..., :3], np.maximum(expected, 0), atol=1e-5)
    assert (got[..., 3] == 0).all(), "no history"


def test_less_noise_and_edges_of_the_base_color_are_kept(gpu, pyoidn, step):
    """Without the base color the checkers are guessed from noise."""
    with_all = rms(play(gpu, "oidn", [step])[0], step)
    without = rms(play(gpu, "oidn", [step], {"auxiliary": "none"})[0], step)
    noisy = rms(step.inputs["radiance"], step)
    assert with_all < 0.5 * without and without < 0.6 * noisy, (with_all, without, noisy)


def test_frames_do_not_depend_on_each_other(gpu, pyoidn, step):
    rng = np.random.default_rng(41)
    images = [rng.random((SIZE[1], SIZE[0], 3)) for _ in range(3)]
    steps = still_steps(SIZE, images)
    together = play(gpu, "oidn", steps, {"quality": "fast"})
    np.testing.assert_array_equal(together[2], play(gpu, "oidn", steps[2:], {"quality": "fast"})[0])


def test_radiance_above_one_is_kept(gpu, pyoidn, step):
    """HDR: a frame a hundred times brighter gives a result a hundred times brighter."""
    bright = still_steps(SIZE, [100 * step.inputs["radiance"][..., :3]])
    assert abs(play(gpu, "oidn", bright)[0][..., :3].mean() / (100 * step.clean.mean()) - 1) < 0.05


def test_a_missing_library_is_one_line(gpu, step, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    assert load_method("oidn").reads == ("radiance", "base_color", "normal"), "it can be shown all the same"
    with pytest.raises(MethodError) as caught:
        play(gpu, "oidn", [step])
    assert "\n" not in str(caught.value) and "taubench-gl[oidn]" in str(caught.value)
