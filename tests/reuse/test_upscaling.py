"""Inputs smaller than the result: sizes, grids, motion, the resampled baseline, and an upscaler over a scene."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from references.resampling import resample_bilinear
from reuse_scenes import settings, still
from reuse_tools import play, write_method

from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.synthetic import Uploader, synthetic_steps

SMALL, LARGE = (24, 16), (36, 24)
GRIDS_TOML = """\
upscales = true
reads = ["radiance", "motion", "mask", "position"]
[history]
sum = "rgba32f"
count = { format = "r32f", size = "input" }
[[pass]]
shader = "a.glsl"
size = "input"
writes = ["count"]
[[pass]]
shader = "b.glsl"
writes = ["sum", "result"]
"""
COUNT = "void reuse(ivec2 p) { write_count(p, fetch_prev_count(p) + float(pass_size().x) + 0.0 * previous_px(p).x); }\n"
GRIDS = """\
void reuse(ivec2 p) {
    vec2 at = input_from_output(vec2(p));
    bool back = distance(output_from_input(at), vec2(p)) < 1e-3;
    bool sizes = all(equal(output_size(), pass_size())) && all(equal(input_size(), textureSize(radiance_texture, 0)));
    sizes = sizes && all(equal(textureSize(prev_sum_texture, 0), output_size()));
    sizes = sizes && all(equal(textureSize(count_texture, 0), input_size()));
    write_sum(p, vec4(p, 0.0, 0.0));
    vec2 motion = previous_px(p) - vec2(p);
    write_result(p, vec4(fetch_count(input_pixel(p)), motion, float(back && sizes && in_image(p))));
}
"""


@pytest.fixture
def grids(tmp_path):
    return str(write_method(tmp_path / "grids", GRIDS_TOML, a=COUNT, b=GRIDS))


def test_grids_of_an_upscaling_method(gpu, grids):
    uploader = Uploader(gpu, SMALL)
    rows, columns = ((2 * np.arange(n) + 1) * m // (2 * n) for n, m in zip(LARGE[::-1], SMALL[::-1], strict=True))
    rows = SMALL[1] - 1 - rows[::-1]  # rows count from the bottom in GLSL
    with MethodRunner(gpu, grids, LARGE, input_size=SMALL) as runner:
        assert runner.bytes == LARGE[0] * LARGE[1] * (2 * 16 + 16) + SMALL[0] * SMALL[1] * 2 * 4
        for step in synthetic_steps(SMALL, 3):
            result = read_result(runner.step(uploader.frame(step)))
            assert result.shape == (LARGE[1], LARGE[0], 4) and (result[..., 3] == 1).all()
            np.testing.assert_array_equal(result[..., 0], SMALL[0] * (step.index + 1))
            motion = step.inputs["motion"][rows[:, None], columns] * 1.5 * [1, -1]  # +y up in GLSL
            near = np.abs(motion).max(axis=-1) < 1e3
            np.testing.assert_allclose(result[near, 1:3], motion[near], atol=1e-3)
    with MethodRunner(gpu, grids, LARGE, input_size=(12, 8)) as runner, pytest.raises(MethodError, match="24x16"):
        runner.step(uploader.frame(step))
    uploader.release()
    (result,) = play(gpu, grids, synthetic_steps(SMALL, 1))
    assert result.shape[:2] == SMALL[::-1] and (result[..., 3] == 1).all(), "at one size"


def test_other_methods_are_resampled_bilinearly(gpu):
    (step,) = synthetic_steps(SMALL, 1)
    (result,) = play(gpu, "none", [step], size=LARGE)
    expected = resample_bilinear(step.inputs["radiance"][..., :3], LARGE)
    np.testing.assert_allclose(result[..., :3], expected, rtol=1e-5, atol=1e-6)


class Both:
    """A Python upscaler: the nearest input pixel."""

    reads = ("radiance",)
    upscales = True

    def __init__(self, size, settings):
        self.size = size

    def step(self, frame):
        assert frame["output_size"] == self.size and frame["input_size"] == SMALL
        rows, columns = (
            (2 * np.arange(n) + 1) * m // (2 * n) for n, m in zip(self.size[::-1], SMALL[::-1], strict=True)
        )
        return frame["radiance"][rows[:, None], columns, :3]


def test_a_python_class_that_upscales(gpu):
    (step,) = synthetic_steps(SMALL, 1)
    (result,) = play(gpu, Both, [step], size=LARGE)
    assert result.shape[:2] == LARGE[::-1]
    np.testing.assert_allclose(result[1, 1, :3], step.inputs["radiance"][1, 1, :3], rtol=1e-6)


# --------------------------------------------------------------------------------------------------------- evaluations
def test_input_kinds_with_a_factor():
    kind = parse_input("path-traced@1+jittered+upscale@1.5")
    assert kind.upscale == Fraction(3, 2)
    assert kind.input_size((480, 270)) == (320, 180) and kind.jitter_period == 18
    assert not parse_input("upscale@2").exact and parse_input("upscale@2").jitter_period == 32
    with pytest.raises(SettingsError):
        kind.input_size((64, 48))


def test_path_traced_input_below_the_size_of_its_reference(tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    chosen = settings(width=32, height=24, frames=(0, 3), light="auto", indirect="auto", bounces=2)
    done = evaluate_methods(
        still(), ["none", "accumulate", "ideal-masks"], chosen, input="path-traced@1+jittered+upscale@2",
        reference="path-traced@8", metrics=("psnr",),
    )  # fmt: skip
    assert list(done.failed) == ["ideal-masks"] and "exact_mask" in done.failed["ideal-masks"]
    assert done.summary["mask_source"] == "exact" and done.summary["input"]["size"] == [16, 12]
