"""Chains of methods: the image of the first is the input of the second, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reuse_tools import play, still_steps, write_method
from sample_tools import lamps, opened

from taubench_gl.benchmark.unit import Entry
from taubench_gl.errors import MethodError
from taubench_gl.reuse.fit import expand_methods
from taubench_gl.reuse.frame import input_texture, read_result
from taubench_gl.reuse.loading import MethodSpec, load_method
from taubench_gl.reuse.runner import MethodRunner

SHOW = """
void reuse(ivec2 p) { write_result(p, vec4(fetch_radiance(p).rgb - 2.0 * fetch_direct(p).rgb, 0.25)); }
"""
SHOW_TOML = 'reads = ["radiance", "direct"]\n[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\n'


def test_the_second_gets_the_image_of_the_first(gpu, tmp_path):
    """radiance is the image, direct its part without indirect light and emission, which stay those of the input."""
    show = write_method(tmp_path / "show", SHOW_TOML, a=SHOW)
    chain = load_method(f"ris>{show}")
    with opened(gpu, lamps(), (*chain.reads, "direct"), bounces=3, indirect="auto", exposure=2.0) as inputs:
        frame = inputs.advance(0)
        settings = {"ris.candidates": 8}
        with MethodRunner(gpu, chain, inputs.size, settings, count=True) as runner:
            result, counts = read_result(runner.step(frame)), runner.light_counts()
            assert runner.bytes == sum(m.bytes(inputs.size) for m in chain.chain)
        with MethodRunner(gpu, "ris", inputs.size, {"candidates": 8}, count=True) as runner:
            image = read_result(runner.step(frame))[..., :3]
            np.testing.assert_array_equal(counts, runner.light_counts())
        before = [read_result(frame.textures[name])[..., :3] for name in ("radiance", "direct")]
    rest = before[0] - before[1]
    assert rest.mean() > 1e-3
    np.testing.assert_allclose(result[..., :3], image - 2.0 * (image - rest), rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(result[..., 3], 0.25)


def test_svgf_of_restir_is_svgf_of_its_image(gpu):
    """Bit for bit over three frames, with the history of both; and what svgf blended is the image of restir-di."""
    chain, svgf = load_method("restir-di>svgf"), load_method("svgf")
    settings = {"restir-di.candidates": 4, "svgf.alpha": 0.3}
    with (
        opened(gpu, lamps(camera_speed=6.0), (*chain.reads, "direct")) as inputs,
        MethodRunner(gpu, chain, inputs.size, settings) as whole,
        MethodRunner(gpu, "restir-di", inputs.size, {"candidates": 4}) as first,
        MethodRunner(gpu, svgf, inputs.size, {"alpha": 0.3}) as second,
    ):
        textures = {name: input_texture(gpu, name, inputs.size) for name in ("radiance", "direct")}
        for number in range(3):
            frame = inputs.advance(number)
            result = read_result(whole.step(frame))
            image = read_result(first.step(frame))
            position = read_result(frame.textures["position"])
            rest = np.where(position[..., 3:] > 0, read_result(frame.light.rest)[..., :3], 0.0)
            for name, values in (("radiance", image[..., :3]), ("direct", image[..., :3] - rest)):
                full = np.concatenate([values, np.ones_like(values[..., :1])], axis=-1)
                textures[name].write(np.ascontiguousarray(full[::-1], dtype=np.float32))
            expected = read_result(second.step(replace(frame, textures={**frame.textures, **textures})))
            np.testing.assert_array_equal(result, expected)
        reported = whole.reported(frame)
        np.testing.assert_array_equal(reported["blend_input"][..., :3], image[..., :3])
        assert {"history_sample", "kept_sample"} <= set(reported)
        for texture in textures.values():
            texture.release()


def test_methods_of_shaded_frames_and_three_links(gpu):
    """``none`` changes nothing before or after another method, whose history goes on."""
    rng = np.random.default_rng(0)
    steps = still_steps((12, 8), rng.random((3, 8, 12, 3)))
    alone, chain = (np.stack(play(gpu, name, steps))[..., :3] for name in ("accumulate", "none>accumulate>none"))
    np.testing.assert_array_equal(chain, alone)
    assert np.abs(alone[2] - steps[2].inputs["radiance"][..., :3]).max() > 0.1


def test_labels_and_settings():
    spec = MethodSpec.parse("restir-di@candidates=8>svgf@alpha=0.2")
    assert (spec.label, spec.method) == ("restir-di@candidates=8>svgf@alpha=0.2", "restir-di>svgf")
    assert spec.settings == {"restir-di.candidates": "8", "svgf.alpha": "0.2"}
    several = expand_methods(["ris>svgf@alpha=0.1/0.2"])
    assert [s.settings["svgf.alpha"] for s in several] == ["0.1", "0.2"] and len({s.label for s in several}) == 2
    assert [MethodSpec.parse(s.label).settings for s in several] == [s.settings for s in several]


def test_the_benchmark_knows_the_files_of_every_link():
    chain, first, second = (Entry.of(text) for text in ("ris>svgf", "ris", "svgf"))
    assert chain.sha256 not in (None, first.sha256, second.sha256) and chain.sha256 != Entry.of("ris>accumulate").sha256


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("restir-di>asvgf", "reads reshaded"),
        ("svgf>restir-di", "restir-di makes its light itself"),
        ("taa_clamp>svgf", "svgf reads direct"),
        ("none>fsr2-class", "upscales"),
        ("accumulate>accumulate", "twice"),
        ("none>nothing", "'nothing'"),
        (">svgf", "there is no method"),
    ],
)
def test_faults(text, part):
    with pytest.raises(MethodError) as caught:
        load_method(text)
    assert part in str(caught.value) and "\n" not in str(caught.value)
