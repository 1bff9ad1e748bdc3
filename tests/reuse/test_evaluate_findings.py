"""Evaluations end to end: published rankings of methods, and values known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from reuse_scenes import SIZE, drifting_checks, passing_box
from reuse_tools import evaluate

from taubench_gl.reuse.scores import EQUAL, NOT_REQUESTED


def class_mse(evaluation, label, name):
    return evaluation.summary["methods"][label]["classes"][name]["mse"]


@pytest.mark.parametrize("kind", ["full", "jittered"])
def test_ghosting_of_variance_clip_clamp_and_none(kind):
    """Karis 2014 and Salvi 2016: error in the disocclusions of a passing object."""
    none, clamp, variance = "taa_clamp@clamping=false", "taa_clamp", "taa_variance"
    done = evaluate(passing_box(), [none, clamp, variance], (0, 14), input=kind)
    hidden = [class_mse(done, label, "disoccluded") for label in (none, clamp, variance)]
    assert hidden[0] > 2 * hidden[1] > 2 * hidden[2] > 0
    whole = [done.summary["methods"][label]["mean"]["psnr_db"] for label in (none, clamp, variance)]
    assert whole[0] < whole[1] < whole[2]


def test_ghosting_of_accumulation_and_ideal_masks():
    done = evaluate(passing_box(), ["accumulate", "ideal-masks", "none"], (0, 14))
    assert class_mse(done, "accumulate", "disoccluded") > 0.02
    assert class_mse(done, "ideal-masks", "disoccluded") == 0.0
    reuse = done.summary["methods"]["ideal-masks"]["reuse"]
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

    def keep(frame):
        last.update(frame.images, reference=frame.reference)

    evaluate(drifting_checks(), labels, (0, 12), on_frame=keep)
    energy = {name: np.mean(np.diff(p[..., 0], axis=1) ** 2) for name, p in last.items()}
    assert 1.3 * energy[labels[0]] < energy[labels[1]] < energy["reference"]
    assert energy[labels[1]] < energy[labels[2]] < energy["reference"]


def test_scores_of_the_reference_itself():
    done = evaluate(passing_box(), ["none"], (0, 4), metrics=("ssim", "flip", "tpsnr", "flicker"))
    scores = done.summary["methods"]["none"]
    assert scores["mean"] == {
        "psnr_db": None, "ssim": 1.0, "flip": 0.0, "relmse": 0.0, "tpsnr_db": None, "flicker": 0.0, "linear_mse": 0.0,
        "relmse_trimmed": 0.0, "clipped_mse": 0.0, "clipped_relmse": 0.0,
        "flip_p50": 0.0, "flip_p95": 0.0, "flip_p99": 0.0, "warp_error": None, "hdr_flip": None,
        "lpips": None, "cvvdp_jod": None,
    }  # fmt: skip
    assert scores["reasons"]["psnr_db"] == scores["reasons"]["tpsnr_db"] == EQUAL
    assert sum(c["pixels"] for c in scores["classes"].values()) == 3 * SIZE[0] * SIZE[1]


@pytest.mark.parametrize(("more", "first"), [({}, 1), ({"warmup": 3}, 3)])
def test_means_are_over_frames_with_history(more, first):
    done = evaluate(passing_box(), ["accumulate"], (0, 5), **more)
    rows, mean = done.rows, done.summary["methods"]["accumulate"]["mean"]
    assert [row["frame"] for row in rows] == [0, 1, 2, 3, 4] and rows[0]["flicker"] is None
    assert mean["relmse"] == pytest.approx(np.mean([row["relmse"] for row in rows[first:]]))
    assert done.summary["evaluated_frames"] == 5 - first and mean["ssim"] is None
    assert done.summary["methods"]["accumulate"]["reasons"]["ssim"] == NOT_REQUESTED
