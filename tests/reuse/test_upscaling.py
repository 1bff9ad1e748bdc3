"""Inputs smaller than the result: sizes, grids, motion, the resampled baseline, and an upscaler over a scene."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from references.resampling import resample_bilinear
from repeated import few
from reuse_scenes import glowing, settings, still
from reuse_tools import write_method

from taubench_gl.animation.jitter import halton_jitter
from taubench_gl.errors import MethodError, SettingsError
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.synthetic import Uploader, synthetic_steps
from taubench_gl.scene.builder import SceneBuilder, quad

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
    uploader.release()


def test_an_upscaling_method_at_one_size(gpu, grids):
    uploader = Uploader(gpu, SMALL)
    with MethodRunner(gpu, grids, SMALL) as runner:
        result = read_result(runner.step(uploader.frame(next(iter(synthetic_steps(SMALL, 1))))))
    uploader.release()
    assert result.shape[:2] == SMALL[::-1] and (result[..., 3] == 1).all()


def test_other_methods_are_resampled_bilinearly(gpu):
    uploader = Uploader(gpu, SMALL)
    step = next(iter(synthetic_steps(SMALL, 1)))
    with MethodRunner(gpu, "none", LARGE, input_size=SMALL) as runner:
        result = read_result(runner.step(uploader.frame(step)))
    with (
        MethodRunner(gpu, "none", LARGE, input_size=(12, 8)) as runner,
        pytest.raises(MethodError, match="24x16"),
    ):
        runner.step(uploader.frame(step))
    uploader.release()
    expected = resample_bilinear(step.inputs["radiance"][..., :3], LARGE)
    np.testing.assert_allclose(result[..., :3], expected, rtol=1e-5, atol=1e-6)


def test_bilinear_resampling_of_a_ramp():
    ramp = np.arange(8.0)[None, :, None] * np.ones((4, 1, 1))
    out = resample_bilinear(ramp, (16, 8))
    np.testing.assert_allclose(out[:, 1:-1, 0], np.broadcast_to((np.arange(16) / 2 - 0.25)[1:-1], (8, 14)))
    np.testing.assert_array_equal(resample_bilinear(ramp, (8, 4)), ramp)


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
    uploader = Uploader(gpu, SMALL)
    with MethodRunner(gpu, Both, LARGE, input_size=SMALL) as runner:
        step = next(iter(synthetic_steps(SMALL, 1)))
        result = read_result(runner.step(uploader.frame(step)))
    uploader.release()
    assert result.shape[:2] == LARGE[::-1]
    np.testing.assert_allclose(result[1, 1, :3], step.inputs["radiance"][1, 1, :3], rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (("upscales = true", "upscales = 1"), "upscales"),
        (("upscales = true\n", ""), "upscales = true"),
        (('size = "input" }', 'size = "half" }'), "half"),
        (('shader = "a.glsl"\nsize = "input"', 'shader = "a.glsl"'), "count"),
        (('format = "r32f", ', ""), "format"),
        (('sum = "rgba32f"', 'input_size = "rgba32f"'), "input_size"),
    ],
)
def test_errors_of_sizes(tmp_path, change, named):
    folder = write_method(tmp_path / "m", GRIDS_TOML.replace(*change), a=COUNT, b=GRIDS)
    with pytest.raises(MethodError, match=named):
        load_method(str(folder))


# --------------------------------------------------------------------------------------------------------- evaluations
def test_input_kinds_with_a_factor():
    kind = parse_input("path-traced@1+jittered+upscale@1.5")
    assert kind.upscale == Fraction(3, 2) and kind.text == "path-traced@1+jittered+upscale@1.5"
    assert kind.input_size((480, 270)) == (320, 180) and kind.jitter_period == 18
    assert not parse_input("upscale@2").exact and parse_input("upscale@2").jitter_period == 32
    with pytest.raises(SettingsError):
        kind.input_size((64, 48))
    for text in (
        "upscale@1",
        "upscale@0",
        "upscale@5",
        "upscale",
        "upscale@2+upscale@3",
        "upscale@x",
        "exr:d+upscale@2",
    ):
        with pytest.raises(SettingsError):
            parse_input(text)


def test_jitter_of_an_upscaler_has_its_own_period():
    offsets = np.array([halton_jitter(k, 32) for k in range(32)])
    assert len(np.unique(offsets, axis=0)) == 32 and np.abs(offsets.mean(axis=0)).max() < 0.05


ACCUMULATE_TOML = """\
upscales = true
reads = ["radiance", "motion", "mask"]
[history]
sum = "rgba32f"
[[pass]]
shader = "a.glsl"
writes = ["sum", "result"]
"""
ACCUMULATE = """\
// Gaussian weight of the nearest sample by its distance from the center of the pixel, running mean.
void reuse(ivec2 p) {
    vec2 at = input_from_output(vec2(p)) - frame.jitter_px;
    ivec2 i = ivec2(floor(at + 0.5));
    float d = length((vec2(i) - at) * output_scale());
    float w = exp(-6.0 * d * d) + 1e-4;
    vec4 sum = vec4(fetch_radiance(i).rgb * w, w);
    if (reusable(p)) sum += sample_prev_sum(previous_px(p));
    write_sum(p, sum);
    write_result(p, vec4(sum.rgb / sum.w, 1.0 - w / sum.w));
}
"""


def fine_checks():
    """A wall with a fine checker pattern, which stands still, as the camera does."""
    b = SceneBuilder()
    dark, bright = glowing(b, (0.1, 0.1, 0.1)), glowing(b, (0.8, 0.8, 0.8))
    b.node(mesh=b.mesh(quad(8.0, 8.0, material=dark)), translation=(0.0, 0.0, -4.01))
    for i in range(-6, 7):
        for j in range(-5, 6):
            if (i + j) % 2:
                b.node(mesh=b.mesh(quad(0.25, 0.25, material=bright)), translation=(0.5 * i, 0.5 * j, -4.0))
    camera = b.camera(yfov=np.radians(50.0), znear=0.1)
    b.animate(camera, "translation", [0.0, 20.0], [(0.03, 0.02, 0.0)] * 2)
    return b.build()


@pytest.mark.parametrize("factor", few([1.5, 2, 3]))
def test_an_accumulating_upscaler_beats_resampling(tmp_path, factor):
    """A still fine checker pattern: samples of many jittered frames contain what one small frame does not."""
    folder = str(write_method(tmp_path / "up", ACCUMULATE_TOML, a=ACCUMULATE))
    # Neighboring samples are farther apart than the default threshold of positions.
    chosen = settings(width=72, height=54, frames=(0, int(8 * factor**2)), unit_scale=8.0)
    done = evaluate_methods(
        fine_checks(), ["none", folder], chosen, input=f"jittered+upscale@{factor}",
        metrics=("psnr",), reference_samples=4,
    )  # fmt: skip
    assert not done.failed
    assert done.summary["settings"]["width"] == 72
    assert done.summary["input"]["size"] == [round(72 / factor), round(54 / factor)]
    last = {row["method"]: row["psnr_db"] for row in done.rows[-2:]}
    assert last["up"] > last["none"] + 1.5


def test_path_traced_input_below_the_size_of_its_reference(tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    chosen = settings(width=32, height=24, frames=(0, 3), light="auto", indirect="auto", bounces=2)
    done = evaluate_methods(
        still(), ["none", "accumulate", "ideal-masks"], chosen, input="path-traced@1+jittered+upscale@2",
        reference="path-traced@8", metrics=("psnr",),
    )  # fmt: skip
    assert list(done.failed) == ["ideal-masks"] and "exact_mask" in done.failed["ideal-masks"]
    assert done.summary["mask_source"] == "exact" and done.summary["input"]["size"] == [16, 12]
