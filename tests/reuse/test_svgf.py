"""SVGF against its float64 reference, and every stage bypassed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references.reuse_methods import EdgeStopping, Svgf
from reuse_tools import bypassed, play, stages
from stage_tools import differing, noisy_steps

from taubench_gl.reuse.loading import load_method

SIZE = (48, 27)
EXPOSURE, SETTINGS = 0.5, {"levels": 2, "taa": True}
ROUNDING = 2e-3
"""Share of pixels at a threshold, which may fall either way."""

BYPASSES = {
    "demodulation": [("temporal.glsl", "vec3 albedo = albedo_of(fetch_base_color(p))", "vec3 albedo = vec3(1.0)")],
    "temporal_filter": [("temporal.glsl",
                         "float share = temporal_filter && h.total > 0.0 ? new_weight(p, h.direct.a, alpha) : 1.0;",
                         "float share = 1.0;")],
    "temporal_variance": [("temporal.glsl", "vec2 variance = variance_of(moments.xz, moments.yw);",
                           "vec2 variance = vec2(0.0);")],
    "spatial_variance": [("variance.glsl", "if (spatial_variance && fetch_frames(p).x < 3.5) {", "if (false) {")],
    "variance_prefilter": [("atrous.glsl",
                            "variance = variance_prefilter ? smoothed_variance(p) : vec2(direct.a, indirect.a);",
                            "variance = vec2(direct.a, indirect.a);")],
    "atrous": [("atrous.glsl", "if (w == 0.0) continue;", "continue;")],
    "depth_edges": [("edges.glsl", "return (depth_edges ? w_z : 1.0) * (normal_edges ? w_n : 1.0);", "return w_n;")],
    "normal_edges": [("edges.glsl", "return (depth_edges ? w_z : 1.0) * (normal_edges ? w_n : 1.0);", "return w_z;")],
    "luminance_edges": [("edges.glsl", "return exp(-abs(l_p - l_q) / (sigma_l * sqrt(max(variance, 0.0)) + 1.0e-6));",
                         "return 1.0;")],
    "feedback": [("atrous.glsl", "vec3 kept = feedback ? direct.rgb : fetch_direct_filtered(p).rgb;",
                  "vec3 kept = fetch_direct_filtered(p).rgb;"),
                 ("atrous.glsl", "feedback ? indirect.rgb : fetch_indirect_filtered(p).rgb",
                  "fetch_indirect_filtered(p).rgb")],
    "modulation": [("modulate.glsl", "color * albedo_of(fetch_base_color(p))", "color")],
    "tone_map": [("tone.glsl", "return c / (1.0 + c);", "return c;"),
                 ("tone.glsl", "c = clamp(c, 0.0, 0.999999);\n    return c / (1.0 - c);", "return c;")],
    "taa": [("antialias.glsl", "if (taa && frame.has_history == 1u && inside(at)) {", "if (false) {")],
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
        {"levels": 1},
        {"levels": 3, "sigma_l": 1.0, "alpha": 0.5, "check_ids": False, "taa": True, "taa_filtering": "bilinear"},
    ],
)
def test_svgf_is_its_reference(gpu, steps, settings):
    for got, image in zip(play(gpu, "svgf", steps, settings, exposure=EXPOSURE), reference(steps, **settings)):
        assert differing(got, image) <= ROUNDING
        assert (np.abs(got[..., 3] - image[..., 3]) > 1e-4).mean() <= ROUNDING


@pytest.mark.parametrize("stage", [None, *stages("svgf")])
def test_a_bypassed_stage_is_noticed(gpu, steps, expected, stage, tmp_path):
    """The comparison of the whole method passes, and fails when the stage is bypassed, which its switch also does."""
    method = bypassed(tmp_path / "svgf", "svgf", *BYPASSES.get(stage, ()))
    gone = play(gpu, method, steps, SETTINGS, exposure=EXPOSURE)
    worst = max(map(differing, gone, expected))
    assert (worst <= ROUNDING) if stage is None else (worst > 10 * ROUNDING), worst
    if stage in load_method("svgf").settings and stage != "demodulation":
        off = play(gpu, "svgf", steps, SETTINGS | {stage: False}, exposure=EXPOSURE)
        assert max(map(differing, off, gone)) <= ROUNDING


def test_without_demodulation_every_surface_is_white(gpu, steps):
    white = [replace(s, inputs=s.inputs | {"base_color": np.ones_like(s.inputs["base_color"])}) for s in steps]
    off, expected = play(gpu, "svgf", steps, SETTINGS | {"demodulation": False}), play(gpu, "svgf", white, SETTINGS)
    np.testing.assert_array_equal(off, expected)


def test_depth_edges_take_a_plane_for_a_plane():
    """Eq. (3): clip-space depth is linear over the image of a plane, so w_z is exp(-1 / sigma_z) at any distance."""
    rows, columns = np.mgrid[:36, :64]
    depth = 1.0 / (0.05 + 0.004 * rows + 0.001 * columns)  # the image of a plane in perspective
    edges = EdgeStopping(depth, np.broadcast_to([0.0, 0.0, 1.0], (*depth.shape, 3)), sigma_z=2.0)
    for level in range(4):
        weight = edges.geometry_weight(0, 2 << level)[: 36 - (2 << level)]
        assert weight.min() > 0.98 * np.exp(-0.5) and weight.max() < 1.15 * np.exp(-0.5)
