"""Runs with path-traced light: columns, settings, metering, notes, and equality of still frames and of parts."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import pytest
from fixed import fixed_settings
from lamp_scenes import lamp_over_floor

from taubench_gl.evaluation import evaluate_scene, resolve_lighting
from taubench_gl.evaluation.brightness import noise_of_a_sample
from taubench_gl.scene import load_scene

pytestmark = pytest.mark.usefixtures("coarse_light")

SMALL = {"width": 32, "height": 18, "frames": (0, 3), "bounces": 3}
lamp = partial(lamp_over_floor, emits=5.0)
METHODS = ("raster", "auto", "preview", "path-traced")


def run(scene, **settings):
    return evaluate_scene(scene, fixed_settings(**(SMALL | settings))).summary


def test_emissive_surfaces_have_light_columns_with_auto(data):
    (path,) = data.rglob("EmissiveStrengthTest.glb")
    summary = run(load_scene(path), light="auto", environment="auto", spp=2)
    discard = summary["discard"]
    assert discard["direct"]["mean_percent"] is not None and discard["indirect"]["mean_percent"] is not None
    assert summary["effects"]["emitter_light"]["on"] and not summary["effects"]["path_traced"]["on"]
    assert {"light", "spp", "bounces", "pattern", "seed"} <= summary["settings"].keys()
    assert summary["settings"]["light"] == "auto" and summary["settings"]["spp"] == 2
    json.dumps(summary["settings"])


@pytest.mark.long
def test_all_methods_and_seeds_are_metered_alike():
    scene = lamp()
    found = {
        resolve_lighting(
            scene, fixed_settings(light=light, seed=seed, exposure="auto", **SMALL)
        ).settings.lighting.exposure
        for light in METHODS
        for seed in (0, 1)
    }
    assert len(found) == 1 and found.pop() != 1.0


def test_what_raster_leaves_out_is_noted():
    raster, auto = (run(lamp(), light=light, spp=1)["notes"] for light in ("raster", "auto"))
    assert any("1 emissive surface lights nothing" in note for note in raster)
    assert any("1 emissive surface is path-traced" in note for note in auto)


@pytest.mark.parametrize(
    ("light", "pattern"), [("auto", "fixed"), ("path-traced", "fixed"), ("path-traced", "independent")]
)
def test_still_pairs_change_only_with_independent_numbers(light, pattern):
    scene = lamp(moves=False, lights=1)
    strict = {"direct": 1e-3, "indirect": 1e-3}
    discard = run(scene, light=light, pattern=pattern, spp=1, camera=0, thresholds=strict)["discard"]
    changed = discard["indirect"]["mean_percent"]
    assert (changed == 0.0) == (pattern == "fixed")
    assert discard["position"]["mean_percent"] == 0.0


@pytest.mark.long
def test_effects_forced_on_change_no_count():
    own = SMALL | {"width": 16, "height": 9, "frames": (0, 2), "bounces": 2, "light": "path-traced", "spp": 1}
    needed, every = (evaluate_scene(lamp(lights=1), fixed_settings(effects=e, **own)).frames for e in ("auto", "all"))
    assert needed == every


def test_noise_over_a_threshold_of_zero(gpu):
    """Infinite where samples differ, 0 where they do not: 0 / 0 hides the noise of the other column."""
    info, position = np.zeros((1, 3, 4), np.float32), np.ones((1, 3, 4), np.float32)
    info[0, :, 1] = 2.0  # samples
    info[0, 1:, 2], info[0, 2, 3] = 4.0, 1.0  # variances of the means of direct and indirect
    textures = {n: gpu.ctx.texture((3, 1), 4, v.tobytes(), dtype="f4") for n, v in
                (("path_info", info), ("position", position))}  # fmt: skip
    noise = {(d, i): noise_of_a_sample(textures, fixed_settings(exposure=1.0, thresholds={"direct": d, "indirect": i}))
             for d, i in ((0.0, 1.0), (1.0, 0.0), (2.0, 1.0))}  # fmt: skip
    np.testing.assert_allclose(noise[0.0, 1.0], [[0.0, np.inf, np.inf]])
    np.testing.assert_allclose(noise[1.0, 0.0], [[0.0, 4.0, np.inf]])
    np.testing.assert_allclose(noise[2.0, 1.0], [[0.0, 2.0, 2.0]])
    for texture in textures.values():
        texture.release()


def test_noise_above_the_thresholds_is_noted():
    scene = lamp()
    strict, loose = (
        run(scene, light="auto", spp=2, exposure=4.0, thresholds={"direct": t, "indirect": t}) for t in (1e-4, 1e3)
    )
    assert strict["brightness"]["noisy"] > 0 == loose["brightness"]["noisy"]
    assert sum("higher --spp" in note for note in strict["notes"]) == 1
    assert not any("--spp" in note for note in loose["notes"])
    assert run(lamp(lights=1), light="raster")["brightness"]["noisy"] == 0
