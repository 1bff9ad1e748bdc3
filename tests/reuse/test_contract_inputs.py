"""Inputs of contract v2: lobes, albedos, statistics of paths, masks of upscalers; names of methods written before."""

from __future__ import annotations

import numpy as np
import pytest
from references.lobes import lobe_albedos, transparency
from reuse_scenes import glowing, lit_room, settings, still
from reuse_tools import PLAIN_GLSL, PLAIN_TOML, arrays, open_inputs, play, still_steps, write_method

from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.frame import MAX_REACTIVE, MIN_ALBEDO
from taubench_gl.scene.builder import SceneBuilder, box, turn_x
from taubench_gl.srgb import LUMINANCE

pytestmark = pytest.mark.usefixtures("fixed_light")

SMALL = {"width": 40, "height": 30, "light": "auto", "indirect": "auto", "bounces": 3, "shadow_size": 32}
SMALL |= {"exposure": 2.0}
LIGHT = ("diffuse", "specular", "emitted")
DEMODULATED = ("diffuse_demodulated", "specular_demodulated", "diffuse_albedo", "specular_albedo")
CHANNELS = ("position", "normal", "base_color", "material")


def varied():
    """A lit room with a metal box, a glowing box, a blended box, and sky."""
    b = SceneBuilder()
    lit_room(b)
    metal = b.material(base_color=(0.9, 0.6, 0.2, 1.0), metallic=1.0, roughness=0.3)
    glass = b.material(base_color=(0.2, 0.6, 0.2, 0.7), alpha_mode="BLEND", roughness=0.2)
    for x, material in ((-1.2, metal), (1.2, glowing(b, (0.3, 0.6, 0.9))), (0.2, glass)):
        b.node(mesh=b.mesh(box((0.6, 0.6, 0.6), material=material)), translation=(x, 0.4, 0.9))
    b.camera(translation=(0.0, 2.5, 4.0), rotation=turn_x(-12.0), yfov=np.radians(80.0), znear=0.1)
    return b.build()


def varied_inputs(gpu, kind, reads, scene=None, **changes):
    return open_inputs(gpu, scene or varied(), kind, reads, settings=SMALL | changes)


@pytest.mark.parametrize(
    "kind", ["full", "noisy", "path-traced@2", "noisy+quarter+jittered", "path-traced@1+upscale@2"]
)
def test_radiance_is_the_sum_of_its_parts(gpu, kind):
    with varied_inputs(gpu, kind, (*LIGHT, "position", "sample_count")) as inputs:
        a = float_arrays(inputs.advance(0))
    parts = [a[name][..., :3] for name in LIGHT]
    np.testing.assert_allclose(sum(parts), a["radiance"][..., :3], rtol=1e-5, atol=1e-6)
    assert all(part.max() > 0 for part in parts)
    shaded = a["radiance"][..., 3]
    np.testing.assert_array_equal(a["diffuse"][..., 3], shaded)
    if "quarter" not in kind:  # a pixel that is filled shows its neighbor's surface
        sky = a["position"][..., 3] == 0
        assert sky.any() and (parts[0][sky] == 0).all() and (parts[1][sky] == 0).all()
    np.testing.assert_array_equal(a["sample_count"][..., 0], shaded * (2 if "@2" in kind and "up" not in kind else 1))


def test_albedos_and_demodulated_light(gpu):
    with varied_inputs(gpu, "path-traced@1", (*LIGHT, *DEMODULATED, *CHANNELS, "transparency")) as inputs:
        a = float_arrays(inputs.advance(0))
    diffuse, specular = lobe_albedos(a, MIN_ALBEDO)
    np.testing.assert_allclose(a["diffuse_albedo"][..., :3], diffuse, rtol=1e-3)
    np.testing.assert_allclose(a["specular_albedo"][..., :3], specular, rtol=2e-3, atol=2e-5)
    np.testing.assert_allclose(a["transparency"][..., 0], transparency(a), rtol=2e-3, atol=1e-4)
    assert (specular > 0.3).any() and a["transparency"].max() > 0.1
    for lobe in ("diffuse", "specular"):
        product = a[f"{lobe}_demodulated"][..., :3] * a[f"{lobe}_albedo"][..., :3]
        np.testing.assert_allclose(product, a[lobe][..., :3], rtol=1e-5, atol=1e-7)


def test_statistics_of_paths(gpu):
    with varied_inputs(gpu, "path-traced@4", ("hit_distance", "sample_count", "variance")) as inputs:
        a = float_arrays(inputs.advance(0))
        info = inputs.source.read("path_info").astype(np.float64)
    np.testing.assert_array_equal(a["hit_distance"][..., 0], info[..., 0])
    np.testing.assert_array_equal(a["sample_count"][..., 0], 4)
    np.testing.assert_allclose(a["variance"][..., 0], 4.0 * (info[..., 2] + info[..., 3]), rtol=1e-5)
    assert a["variance"].max() > 0 and a["hit_distance"].max() > 0


def test_variance_is_that_of_many_frames(gpu):
    """The variance of one frame is not below the spread of 48, and above it by what stratified samples gain."""
    scene = still()
    with varied_inputs(gpu, "path-traced@4", ("variance", "radiance"), scene=scene, width=20, height=15) as inputs:
        frames = [float_arrays(inputs.advance(k)) for k in range(48)]
    spread = np.var([a["radiance"][..., :3] @ LUMINANCE for a in frames], axis=0, ddof=1).mean()
    stated = np.mean([a["variance"] for a in frames])
    assert spread < stated < 3 * spread  # exposure 2: without its square, stated would be a quarter


def float_arrays(frame):
    return {name: values.astype(np.float64) for name, values in arrays(frame).items()}


def test_reactive_pixels_are_those_of_blended_surfaces(gpu):
    with varied_inputs(gpu, "full", ("reactive", "ids", "base_color")) as inputs:
        a = float_arrays(inputs.advance(0))
    scene = varied()
    index = (a["ids"][..., 1].astype(np.int64) & 0x7FFFFFFF) - 1
    blended = np.array([m.alpha_mode == "BLEND" for m in scene.materials] + [False])[index]
    assert blended.any() and not blended.all()
    np.testing.assert_allclose(
        a["reactive"][..., 0], np.where(blended, np.minimum(a["base_color"][..., 3], MAX_REACTIVE), 0)
    )


def test_a_missing_input_is_named(tmp_path):
    folder = write_method(tmp_path / "m", PLAIN_TOML.replace('"radiance"', '"radiance", "hit_distance"'), a=PLAIN_GLSL)
    done = evaluate_methods(
        still(), ["none", str(folder)], settings(width=20, height=15, frames=(0, 2)), input="noisy", metrics=("psnr",),
        reference_samples=1,
    )  # fmt: skip
    assert list(done.failed) == ["m"]
    assert "hit_distance" in done.failed["m"] and "path-traced" in done.failed["m"]


# ------------------------------------------------------------------------------------------ methods written before v2
V1_TOML = """\
reads = ["radiance", "normal"]
[history]
variance = "r32f"
[settings]
roughness = 0.5
specular = { default = 2, min = 1, max = 4 }
[[pass]]
shader = "a.glsl"
writes = ["variance", "result"]
"""
V1_GLSL = """\
vec3 fetch_material(ivec2 p) { return fetch_normal(p).xyz; }
ivec2 input_size() { return frame.size.xy; }
float remodulate(float x) { return x * float(specular) * roughness; }
void reuse(ivec2 p) {
    vec3 color = fetch_radiance(p).rgb + 0.0 * fetch_material(p);
    write_variance(p, fetch_prev_variance(p) + 1.0);
    write_result(p, vec4(remodulate(color.r), fetch_prev_variance(p) + 1.0, float(input_size().x), 0.0));
}
"""


def test_names_of_later_inputs_are_free_in_older_methods(gpu, tmp_path):
    folder = write_method(tmp_path / "old", V1_TOML, a=V1_GLSL)
    results = play(gpu, str(folder), still_steps((8, 6), [np.full((6, 8, 3), 0.25)] * 3))
    for index, result in enumerate(results):
        np.testing.assert_array_equal(result[..., 0], 0.25)
        np.testing.assert_array_equal(result[..., 1], index + 1)
        np.testing.assert_array_equal(result[..., 2], 8)


REMODULATE = """\
void reuse(ivec2 p) {
    vec3 color = remodulate(p, fetch_diffuse_demodulated(p).rgb, fetch_specular_demodulated(p).rgb);
    write_result(p, vec4(color, roughness(p) + metallic(p)));
}
"""


def test_remodulated_light_is_radiance(gpu, tmp_path):
    from taubench_gl.reuse.synthetic import synthetic_steps

    reads = [*DEMODULATED, "emitted", "material"]
    toml = f'reads = {reads}\n[[pass]]\nshader = "a.glsl"\nwrites = ["result"]\n'.replace("'", '"')
    folder = write_method(tmp_path / "m", toml, a=REMODULATE)
    steps = list(synthetic_steps((24, 16), 2))
    for result, step in zip(play(gpu, str(folder), steps), steps, strict=True):
        np.testing.assert_allclose(result[..., :3], step.inputs["radiance"][..., :3], rtol=1e-5)
        np.testing.assert_allclose(result[..., 3], step.inputs["material"][..., 1], rtol=1e-3)
