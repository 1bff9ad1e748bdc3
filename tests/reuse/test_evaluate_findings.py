"""Evaluations end to end: published orderings come out, and what is exact is exact."""

from __future__ import annotations

import numpy as np
import pytest
from reuse_scenes import SIZE, drifting_checks, looking_around, passing_box, still
from reuse_tools import judge


def class_mse(evaluation, label, name):
    return evaluation.summary["methods"][label]["classes"][name]["mse"]


@pytest.mark.parametrize("kind", ["full", "jittered"])
def test_variance_clip_ghosts_less_than_clamp_and_clamp_less_than_none(kind):
    """Karis 2014 and Salvi 2016: what a passing object uncovers, and what is left behind it."""
    none, clamp, variance = "taa_clamp@clamping=false", "taa_clamp", "taa_variance"
    done = judge(passing_box(), [none, clamp, variance], (0, 14), input=kind)
    hidden = [class_mse(done, label, "disoccluded") for label in (none, clamp, variance)]
    assert hidden[0] > 2 * hidden[1] > 2 * hidden[2] > 0
    whole = [done.summary["methods"][label]["mean"]["psnr_db"] for label in (none, clamp, variance)]
    assert whole[0] < whole[1] < whole[2]


def test_naive_accumulation_ghosts_and_the_oracle_does_not():
    done = judge(passing_box(), ["accumulate", "oracle", "none"], (0, 14))
    assert class_mse(done, "accumulate", "disoccluded") > 0.02
    assert class_mse(done, "oracle", "disoccluded") == 0.0
    reuse = done.summary["methods"]["oracle"]["reuse"]
    assert reuse["wrongly_reused_percent"] == reuse["wrongly_rejected_percent"] == 0.0
    assert reuse["reused_percent"] > 90
    assert done.summary["methods"]["accumulate"]["reuse"]["wrongly_reused_percent"] > 1
    assert done.summary["methods"]["none"]["reuse"]["wrongly_rejected_percent"] == pytest.approx(
        reuse["reused_percent"], abs=1e-9
    )


def test_bilinear_history_blurs_more_than_nearest():
    """Yang et al. 2020: repeated bilinear resampling is a low-pass; nearest keeps contrast, Catmull-Rom most of it."""
    labels = [f"accumulate@filtering={f}" for f in ("bilinear", "nearest", "catmull_rom")]
    last = {}

    def keep(judged):
        last.update(judged.pictures, reference=judged.reference)

    judge(drifting_checks(), labels, (0, 12), on_frame=keep)
    energy = {name: np.mean(np.diff(p[..., 0], axis=1) ** 2) for name, p in last.items()}
    assert 1.3 * energy[labels[0]] < energy[labels[1]] < energy["reference"]
    assert energy[labels[1]] < energy[labels[2]] < energy["reference"]


def test_time_warp_is_right_for_rotation_and_wrong_for_translation():
    """Where history exists.  Under rotation only resampling is left; under translation parallax is missing."""
    rest = {}
    for kind in ("turn", "slide"):
        done = judge(looking_around(kind), ["timewarp"], (0, 6), settings={"width": 96, "height": 72})
        rest[kind] = class_mse(done, "timewarp", "rest")
    assert rest["turn"] < 3e-4 and rest["slide"] > 20 * rest["turn"]


def test_accumulation_over_a_still_scene_falls_as_one_over_n():
    """The variance of a mean of n independent estimates; also: the estimate has no bias that would stay."""
    done = judge(still(), ["accumulate@cap=1000000"], (0, 33), input="noisy")
    scaled = np.array([row["relmse"] * (i + 1) for i, row in enumerate(done.rows)])
    assert len(scaled) == 33
    np.testing.assert_allclose(scaled, scaled.mean(), rtol=0.2)


def test_shading_fewer_pixels_leaves_more_error():
    errors = []
    for kind in ("full", "checkerboard", "quarter"):
        done = judge(drifting_checks(), ["none"], (0, 4), input=kind)
        errors.append(done.summary["methods"]["none"]["mean"]["relmse"])
    assert errors[0] == 0.0 < errors[1] < errors[2]


def test_the_reference_itself_is_perfect_and_says_why_values_are_missing():
    done = judge(passing_box(), ["none"], (0, 4), metrics=("ssim", "flip", "tpsnr", "flicker"))
    told = done.summary["methods"]["none"]
    assert told["mean"] == {
        "psnr_db": None, "ssim": 1.0, "flip": 0.0, "relmse": 0.0, "tpsnr_db": None, "flicker": 0.0,
    }  # fmt: skip
    assert "infinite" in told["reasons"]["psnr_db"] and "infinite" in told["reasons"]["tpsnr_db"]
    assert sum(c["pixels"] for c in told["classes"].values()) == 3 * SIZE[0] * SIZE[1]


def test_means_are_over_frames_with_history():
    done = judge(passing_box(), ["accumulate"], (0, 5))
    rows, mean = done.rows, done.summary["methods"]["accumulate"]["mean"]
    assert [row["frame"] for row in rows] == [0, 1, 2, 3, 4] and rows[0]["flicker"] is None
    assert mean["relmse"] == pytest.approx(np.mean([row["relmse"] for row in rows[1:]]))
    assert done.summary["judged_frames"] == 4 and mean["ssim"] is None
    assert done.summary["methods"]["accumulate"]["reasons"]["ssim"] == "not asked for"


def test_order_and_company_change_nothing():
    alone = judge(passing_box(), ["taa_clamp"], (0, 6), input="noisy")
    among = judge(passing_box(), ["accumulate", "taa_clamp", "oracle"], (0, 6), input="noisy")
    untimed = [
        [{k: v for k, v in row.items() if k != "time_ms"} for row in e.rows if row["method"] == "taa_clamp"]
        for e in (alone, among)
    ]
    assert untimed[0] == untimed[1]
