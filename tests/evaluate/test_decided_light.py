"""Path-traced light without a number of samples: every pixel of every pair is decided."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from lamp_scenes import lamp_over_floor

from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.evaluation import LightPlan, Observers, evaluate_scene, light_plan, plan_scene
from taubench_gl.features import FEATURE_BIT, FEATURES, MASK_WORDS, RADIANCE_FEATURES
from taubench_gl.metrics.counts import counts_of
from taubench_gl.metrics.path_samples import LEAST, LIMIT
from taubench_gl.run import load_run
from taubench_gl.run_schema import DECIDED_COLUMNS

TRACED = {"width": 24, "height": 14, "fps": 24.0, "frames": (0, 3), "light": "path-traced"}


def test_masks_counts_distances_and_rows_are_those_of_path_traced_light(tmp_path):
    scene, settings = lamp_over_floor(emits=40.0), fixed_settings(**TRACED | {"width": 16, "height": 9})
    seen = []

    def on_pair(pair):
        limits = {name: settings.metrics.threshold(name) for name in RADIANCE_FEATURES}
        comparable = (pair.mask & NOT_COMPARABLE) == 0
        for name, limit in limits.items():
            over = comparable & (pair.distances.features[name] > limit)
            assert np.array_equal(over, (pair.mask & np.uint32(FEATURE_BIT[name])) != 0), name
        brighter = (pair.mask & np.uint32(Reason.LIT)) != 0
        assert (pair.distances.luminance[brighter] > 0).all()
        words = np.bincount(pair.mask.ravel(), minlength=MASK_WORDS)
        assert np.array_equal(words, pair.evaluated.counts.mask_histogram)
        x, y = np.argwhere(pair.mask & np.uint32(FEATURE_BIT["indirect"]))[0][::-1]
        assert pair.explain(int(x), int(y)).features["indirect"].discarded
        seen.append({"row": dict(pair.row), "counts": counts_of(words)})

    observers = Observers(on_pair=on_pair, distances=True)
    evaluate_scene(scene, settings, observers, out=tmp_path / "run", sampled=True)
    run = load_run(tmp_path / "run")  # which checks it
    for row, pair in zip(run.frames, seen, strict=True):
        assert {name: row[name] for name in FEATURES} == {name: pair["counts"][name] for name in FEATURES}
        assert 0 < row["traced"] <= row["pixels"] and row["undecided"] < row["traced"]
        assert 2 * LEAST * row["traced"] <= row["light_samples"] <= 2 * LIMIT * row["traced"]
        assert row["audited_wrong"] <= row["audited"]
    decided = run.summary["decided_light"]
    assert decided["traced"] == sum(row["traced"] for row in run.frames)
    assert run.summary["settings"]["spp"] is None and "sampled_light" not in run.summary


@pytest.mark.long
def test_columns_are_those_of_images_of_many_samples():
    """Emitters, which the raster method leaves out: the columns are not those of the preview's images."""
    scene, settings = lamp_over_floor(emits=40.0), fixed_settings(**TRACED | {"frames": (0, 2)})
    ours = evaluate_scene(scene, settings, sampled=True).summary["discard"]
    images = evaluate_scene(scene, settings.replace(spp=1024, bidirectional=True)).summary["discard"]
    raster = evaluate_scene(scene, settings.replace(light="raster")).summary["discard"]
    for name in RADIANCE_FEATURES:
        assert ours[name]["mean_percent"] == pytest.approx(images[name]["mean_percent"], abs=1.5), name
        assert abs(ours[name]["mean_percent"] - (raster[name]["mean_percent"] or 0.0)) > 3.0
    for name in ("frustum", "position", "normal"):
        assert ours[name] == images[name]


def test_light_of_images_is_neither_decided_nor_sampled():
    plans = {"path-traced": LightPlan.DECIDED, "auto": LightPlan.SAMPLED, "preview": LightPlan.PREVIEW}
    plans["raster"] = LightPlan.FIXED
    for light, plan in plans.items():
        settings = fixed_settings(**TRACED | {"light": light})
        assert light_plan(settings, True) is plan
        images = light_plan(settings, False)
        assert images is (LightPlan.PREVIEW if light in ("auto", "preview") else LightPlan.FIXED)
        for changes in ({"exact": True}, {"samples_per_pixel": 2}, {"columns": ("position",)}):
            assert light_plan(settings.replace(**changes), True) is images, (light, changes)
    assert light_plan(fixed_settings(**TRACED, spp=2), True) is LightPlan.FIXED


def test_images_of_a_session_that_samples_nothing_have_a_number_of_samples():
    settings = fixed_settings(**TRACED)
    assert plan_scene(lamp_over_floor(), settings).settings.lighting.spp == 256
    assert plan_scene(lamp_over_floor(), settings, sampled=True).settings.lighting.spp is None


def test_a_pair_whose_light_is_not_compared_has_columns_of_zero():
    settings = fixed_settings(**TRACED | {"width": 12, "height": 7, "frames": (0, 1)})
    summary = evaluate_scene(lamp_over_floor(), settings, sampled=True).summary
    assert summary["decided_light"] == dict.fromkeys(DECIDED_COLUMNS, 0) | {
        "undecided_percent": 0.0, "most_samples_per_pixel": LIMIT,
    }  # fmt: skip
