"""SVGF against its float64 reference, and every stage bypassed."""

from __future__ import annotations

import numpy as np
import pytest
from references.reuse_methods import Svgf
from reuse_tools import bypassed, play
from stage_tools import differing, noisy_steps

from taubench_gl.reuse.loading import load_method

SIZE = (64, 36)
EXPOSURE, SETTINGS = 0.5, {"levels": 2}
ROUNDING = 2e-3
"""Share of pixels at a threshold, which may fall either way."""

BYPASSES = {
    "demodulation": [("temporal.glsl", "vec3 albedo = albedo_of(fetch_base_color(p))", "vec3 albedo = vec3(1.0)")],
    "temporal_filter": [("temporal.glsl", "float share = h.total > 0.0 ? new_weight(p, h.direct.a, alpha) : 1.0;",
                         "float share = 1.0;")],
    "temporal_variance": [("temporal.glsl", "vec2 variance = variance_of(moments.xz, moments.yw);",
                           "vec2 variance = vec2(0.0);")],
    "spatial_variance": [("variance.glsl", "if (count > 3.5) {", "if (true) {")],
    "variance_prefilter": [("atrous.glsl", "variance = smoothed_variance(p);",
                            "variance = vec2(direct.a, indirect.a);")],
    "atrous": [("atrous.glsl", "if (w == 0.0) continue;", "continue;")],
    "depth_edges": [("edges.glsl", "return w_z * w_n;", "return w_n;")],
    "normal_edges": [("edges.glsl", "return w_z * w_n;", "return w_z;")],
    "luminance_edges": [("edges.glsl", "return exp(-abs(l_p - l_q) / (sigma_l * sqrt(max(variance, 0.0)) + 1.0e-6));",
                         "return 1.0;")],
    "feedback": [("atrous.glsl", "write_direct_light(p, vec4(direct.rgb,",
                  "write_direct_light(p, vec4(fetch_direct_filtered(p).rgb,")],
    "modulation": [("modulate.glsl", "color * albedo_of(fetch_base_color(p))", "color")],
    "tone_map": [("tone.glsl", "return c / (1.0 + c);", "return c;"),
                 ("tone.glsl", "c = clamp(c, 0.0, 0.999999);\n    return c / (1.0 - c);", "return c;")],
    "taa": [("antialias.glsl", "if (frame.has_history == 1u && inside(at)) {", "if (false) {")],
}  # fmt: skip


@pytest.fixture(scope="module")
def steps():
    return noisy_steps(SIZE)


def reference(steps, **settings) -> list[np.ndarray]:
    svgf = Svgf(**settings)
    return [svgf.frame(step.inputs, step.pair.prev_forward, EXPOSURE) for step in steps]


@pytest.fixture(scope="module")
def expected(steps):
    return reference(steps, **SETTINGS)


@pytest.mark.parametrize(
    "settings",
    [
        {"levels": 1, "taa_alpha": 1.0},
        {"levels": 3, "sigma_l": 1.0, "alpha": 0.5, "check_ids": False, "taa_filtering": "bilinear"},
    ],
)
def test_svgf_is_its_reference(gpu, steps, settings):
    for got, image in zip(play(gpu, "svgf", steps, settings, exposure=EXPOSURE), reference(steps, **settings)):
        assert differing(got, image) <= ROUNDING
        assert (np.abs(got[..., 3] - image[..., 3]) > 1e-4).mean() <= ROUNDING


def test_every_stage_has_a_bypass():
    assert set(BYPASSES) == {stage.name for stage in load_method("svgf").stages if stage.done}


@pytest.mark.parametrize("stage", [None, *BYPASSES])
def test_a_bypassed_stage_is_noticed(gpu, steps, expected, stage, tmp_path):
    """The comparison of the whole method passes, and fails when the stage is bypassed."""
    method = bypassed(tmp_path / "svgf", "svgf", *BYPASSES.get(stage, ()))
    worst = max(map(differing, play(gpu, method, steps, SETTINGS, exposure=EXPOSURE), expected))
    assert (worst <= ROUNDING) if stage is None else (worst > 10 * ROUNDING), worst
