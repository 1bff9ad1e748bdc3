"""The ReBLUR-class method against its float64 reference, every stage bypassed, and its laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references.reuse_methods import Reblur
from reuse_tools import bypassed, play, stages
from stage_tools import differing, noisy_steps

SIZE = (48, 27)
SETTINGS = {"preblur_radius": 90.0, "max_radius": 90.0, "min_radius": 10.0, "fix_stride": 60.0, "clamp_sigma": 0.5,
            "fast_frames": 1, "fast_sigma": 0.5, "firefly_sigma": 1.0, "disocclusion": 0.02}  # fmt: skip
ROUNDING = 0.01
"""Share of pixels with a tap at the border of two pixels, which may fall either way, and of those blurred with them."""

STILL = "if (frame.has_history == 0u || !inside(at)) return found;"
BYPASSES = {
    "demodulation": [("preblur.glsl", "fetch_diffuse_demodulated(q).rgb :",
                      "fetch_diffuse_demodulated(q).rgb * (0.5 + 0.5 * fetch_material(q).y) :")],
    "pre_blur": [("preblur.glsl", "float radius = preblur_radius", "float radius = 0.0 * preblur_radius")],
    "temporal_accumulation": [("accumulate.glsl", STILL, "return found;")],
    "disocclusion": [("accumulate.glsl", "<= disocclusion * frustum_size(depth);", "<= 1.0e9;")],
    "virtual_motion": [("accumulate.glsl", "normalize(now) * hit * dominant_factor(rough)", "normalize(now) * 0.0")],
    "virtual_confidence": [("accumulate.glsl", "if (!virtual_history || !(confidence > 0.0)) confidence = 0.0;",
                            "confidence = float(seen.total > 0.0);")],
    "surface_frames": [("accumulate.glsl", "/ (1.0 + dominant * min(distance(at, virtual_at), 1.0e3));", ";")],
    "catmull_rom": [("accumulate.glsl", "if (catmull_rom && total > 0.0", "if (false")],
    "history_fix": [("history_fix.glsl", "if (!(position.w > 0.0) ||", "if (true ||")],
    "blur": [("blur.glsl", "if (iteration == 1) radius *= post_scale;",
              "radius *= iteration == 1 ? post_scale : 0.0;")],
    "post_blur": [("blur.glsl", "if (iteration == 1) radius *= post_scale;", "if (iteration == 1) radius *= 0.0;")],
    "recurrence": [("blur.glsl", "    if (iteration == 1) {\n        write_diffuse_light(p, diffuse);",
                    "    if (iteration == 1) write_specular_light(p, specular);\n"
                    "    if (iteration == 0) {\n        write_diffuse_light(p, fetch_diffuse_now(p));")],
    "fast_history": [("limit.glsl", "if (fast_frames < max_frames)", "if (false)")],
    "anti_firefly": [("limit.glsl", "if (anti_firefly)", "if (false)")],
    "stabilization": [("stabilize.glsl", "stable[lobe] = mix(l, inner, trust * frames / (1.0 + frames));",
                       "stable[lobe] = l;")],
    "anti_lag": [("stabilize.glsl", "float trust = 1.0 / (1.0 + anti_lag * lag)", "float trust = 1.0")],
    "modulation": [("stabilize.glsl", "light[0] * fetch_diffuse_albedo(p).rgb", "light[0]")],
}  # fmt: skip


@pytest.fixture(scope="module")
def steps():
    return lobe_steps(noisy_steps(SIZE))


def lobe_steps(steps, roughness=(0.15, 0.5)):
    """``steps`` with both lobes apart: a glossy ball on a rougher floor, hit distances of 0 to 3 m."""
    rng = np.random.default_rng(5)
    out = []
    for step in steps:
        i = step.inputs
        surface, ball = i["position"][..., 3:] > 0, i["ids"][..., :1] == 2
        rough = np.where(ball, roughness[0], roughness[1]) * surface
        albedo = np.maximum(i["base_color"][..., :3], 0.01)
        specular = np.broadcast_to(0.04 + 0.2 * (1 - rough), albedo.shape)
        light = np.where(surface, i["direct"][..., :3] / albedo, 0.0)
        shine = np.where(surface, 0.3 + (i["position"][..., :1] % 1.0) * rng.gamma(8.0, 1 / 8.0, rough.shape), 0.0)
        shine = np.broadcast_to(shine, light.shape)
        hit = np.where(rng.random(rough.shape) < 0.1, 0.0, 3.0 * rng.random(rough.shape)) * surface
        inputs = {
            "diffuse_demodulated": light, "specular_demodulated": shine, "hit_distance": hit,
            "diffuse_albedo": albedo, "specular_albedo": specular,
            "emitted": np.where(surface, i["emission"], i["radiance"][..., :3]),
            "material": np.concatenate([0 * rough, rough, 0 * rough, 0 * rough], axis=-1),
        }  # fmt: skip
        inputs = {n: v.astype(np.float16 if n == "material" else np.float32).astype(np.float32)
                  for n, v in inputs.items()}  # fmt: skip
        out.append(replace(step, inputs=i | inputs))
    return out


def reference(steps, **settings) -> list[np.ndarray]:
    method = Reblur(**settings)
    return [method.frame(step.inputs, step.pair, step.index) for step in steps]


@pytest.fixture(scope="module")
def expected(steps):
    return reference(steps, **SETTINGS)


def test_it_is_its_reference(gpu, steps):
    settings = {"max_frames": 2, "fix_frames": 1, "stable_frames": 0, "post_scale": 0.5, "normal_limit": 1.0}
    settings |= {"roughness_limit": 2.0, "hit_limit": 0.2, "max_radius": 100.0, "catmull_rom": False}
    for got, image in zip(play(gpu, "reblur-class", steps, settings), reference(steps, **settings)):
        assert differing(got, image) <= ROUNDING
        assert (np.abs(got[..., 3] - image[..., 3]) > 1e-3).mean() <= ROUNDING


@pytest.mark.parametrize("stage", [None, *stages("reblur-class")])
def test_a_bypassed_stage_is_noticed(gpu, steps, expected, stage, tmp_path):
    method = bypassed(tmp_path / "reblur-class", "reblur-class", *BYPASSES.get(stage, ()))
    worst = max(map(differing, play(gpu, method, steps, SETTINGS), expected))
    assert (worst <= ROUNDING) if stage is None else (worst > 5 * ROUNDING), worst


def test_constant_light_is_unchanged(gpu, steps):
    """Every stage is a weighted mean: constant light of both lobes is exactly modulated."""
    flat = []
    for step in steps:
        surface = step.inputs["position"][..., 3:] > 0
        light = np.where(surface, 0.75, 0.0) * np.ones(3, dtype=np.float32)
        flat.append(replace(step, inputs=step.inputs | {"diffuse_demodulated": light, "specular_demodulated": light}))
    for step, got in zip(flat, play(gpu, "reblur-class", flat, SETTINGS)):
        i = step.inputs
        surface = i["position"][..., 3:] > 0
        exact = 0.75 * (i["diffuse_albedo"] + i["specular_albedo"]) + i["emitted"]
        np.testing.assert_allclose(got[..., :3], np.where(surface, exact, i["emitted"]), rtol=2e-5)


def lit(steps, light):
    """``steps`` repeated still, without specular light, with the diffuse light ``light(index)`` (h, w)."""
    out, still = [], steps[-1]
    for index in range(8):
        surface = still.inputs["position"][..., 3:] > 0
        diffuse = np.where(surface, light(index)[..., None], 0.0) * np.ones(3)
        lobes = {"diffuse_demodulated": diffuse, "specular_demodulated": np.zeros_like(diffuse)}
        lobes |= {"diffuse_albedo": np.ones_like(diffuse), "emitted": np.zeros_like(diffuse)}
        lobes = {name: values.astype(np.float32) for name, values in lobes.items()}
        out.append(replace(still, index=index, inputs=still.inputs | lobes))
    return out


NO_BLUR = {"preblur_radius": 0.0, "max_radius": 0.0, "min_radius": 0.0, "fix_frames": 0, "stable_frames": 0}


def test_a_firefly_is_limited_to_the_pixels_around_it(gpu, steps):
    """In constant light the range has no width, so a pixel of 1000 times the light is as all others."""

    def light(index):
        image = np.ones(SIZE[::-1])
        image[20, 30] = 1000.0 if index == 5 else 1.0
        return image

    frames = lit(steps, light)
    assert frames[0].inputs["position"][20, 30, 3] > 0
    limited, free = (
        play(gpu, "reblur-class", frames, NO_BLUR | {"anti_firefly": on, "fast_frames": 30})[5][20, 30, 0]
        for on in (True, False)
    )
    assert limited == pytest.approx(1.0, rel=1e-4) and free > 100.0


def test_the_fast_history_ends_the_lag_of_the_long_one(gpu, steps):
    """The light doubles in frame 6; of a mean of all frames a new one has a share of 1 / 7, then 1 / 8."""
    frames = lit(steps, lambda index: np.full(SIZE[::-1], 2.0 if index >= 6 else 1.0))
    surface = frames[0].inputs["position"][..., 3] > 0
    lag = NO_BLUR | {"anti_firefly": False, "anti_lag": 0.0}
    long = play(gpu, "reblur-class", frames, lag | {"fast_frames": 30})[7][surface][:, 0]
    np.testing.assert_allclose(long, 1.0 + 1 - (6 / 7) * (7 / 8), rtol=1e-4)
    # A fast mean of two frames is 1.5, then 1.75; it has a share of 1 - 1 / (1 + 2 m) after m frames.
    expected, count = 1.0, 6
    for fast in (1.5, 1.75):
        mean = expected + (2.0 - expected) / (count + 1)
        expected = fast + (mean - fast) / (1 + 2 * count)
        count += 1
    short = play(gpu, "reblur-class", frames, lag | {"fast_frames": 1})[7][surface][:, 0]
    np.testing.assert_allclose(short, expected, rtol=1e-4)
