"""Open Image Denoise per frame: what it is given, what it is good for, and one line where it is missing."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from reuse_tools import play

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


def test_a_missing_library_is_one_line(gpu, step, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    assert load_method("oidn").reads == ("radiance", "base_color", "normal"), "it can be shown all the same"
    with pytest.raises(MethodError) as caught:
        play(gpu, "oidn", [step])
    assert "\n" not in str(caught.value) and "taubench-gl[oidn]" in str(caught.value)
