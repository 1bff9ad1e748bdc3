"""The bound in an evaluation: no blending method beats its own, with any seed; without a report there is none."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from reuse_scenes import passing_box, still
from reuse_scenes import settings as small_settings
from reuse_tools import PLAIN_GLSL, PLAIN_TOML, evaluate, frame_methods, play, write_method

from taubench_gl.metrics.blending import blend, nearest_weight
from taubench_gl.reuse.bound import NO_HISTORY
from taubench_gl.reuse.contract import FORMATS, Method, PassInfo
from taubench_gl.reuse.evaluate import evaluate_methods
from taubench_gl.reuse.glsl_method import reporting_passes
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.synthetic import synthetic_steps

pytestmark = pytest.mark.usefixtures("fixed_light")

FLOAT32 = 1e-6
"""Relative error of a mean squared error of float32 images whose colors are not far below 1."""

BLENDING = (
    "none", "accumulate", "ideal-masks", "greedy", "bmfr_temporal", "reverse_reprojection_cache", "timewarp",
    "taa_clamp@clamping=false",
)  # fmt: skip


@pytest.fixture(scope="module")
def done():
    return evaluate(still(), [*BLENDING, "taa_clamp", "svgf"], (0, 4), input="noisy+jittered", seeds=2)


def test_no_blending_method_beats_its_bound(done):
    for name in BLENDING:
        method = done.summary["methods"][name]
        assert method["failed"] is None and method["bound"]["blends"], name
        assert method["bound"]["headroom_linear_mse"] >= -FLOAT32 * method["mean"]["linear_mse"], name
    for row in done.rows:
        if row["method"] in BLENDING:
            assert row["linear_mse"] >= (1.0 - FLOAT32) * row["bound_linear_mse"], row


def test_bound_is_below_where_history_helps_and_equal_without_history(done):
    methods = done.summary["methods"]
    assert methods["none"]["bound"]["headroom_db"] == pytest.approx(0.0, abs=1e-9)
    assert methods["accumulate"]["bound"]["headroom_db"] > 1.0
    assert abs(methods["greedy"]["bound"]["headroom_db"]) < 1e-3
    assert methods["greedy"]["mean"]["linear_mse"] < methods["accumulate"]["mean"]["linear_mse"]


def test_rectified_history_counts_less(done):
    clamped, free = (done.summary["methods"][n] for n in ("taa_clamp", "taa_clamp@clamping=false"))
    assert clamped["reuse"]["effective_weight"] < clamped["reuse"]["mean_weight"] - 0.02
    assert free["reuse"]["effective_weight"] == pytest.approx(free["reuse"]["mean_weight"], rel=1e-3)


def test_rectification_of_several_hues_is_no_blend():
    methods = evaluate(passing_box(), ["taa_clamp", "accumulate"], (8, 12)).summary["methods"]
    assert not methods["taa_clamp"]["bound"]["blends"] and methods["accumulate"]["bound"]["blends"]
    assert 50.0 < methods["taa_clamp"]["bound"]["blended_percent"] < 100.0


def test_seeds_give_other_noise_and_one_reference(done):
    assert done.summary["seeds"] == [0, 1]
    rows = [r for r in done.rows if r["method"] == "none" and r["frame"] == 3]
    assert [r["seed"] for r in rows] == [0, 1] and rows[0]["linear_mse"] != rows[1]["linear_mse"]
    alone = evaluate(still(), ["none"], (0, 4), input="noisy+jittered")
    first = [r["linear_mse"] for r in done.rows if r["method"] == "none" and r["seed"] == 0]
    assert [r["linear_mse"] for r in alone.rows] == first
    means = [r["linear_mse"] for r in done.rows if r["method"] == "none" and r["frame"] > 0]
    assert done.summary["methods"]["none"]["mean"]["linear_mse"] == pytest.approx(np.mean(means))


def test_method_without_report_has_no_bound(tmp_path):
    folder = write_method(tmp_path / "plain", PLAIN_TOML, a=PLAIN_GLSL)
    done = evaluate_methods(
        still(), [str(folder)], small_settings(frames=(0, 3)), input="full", metrics=("relmse",), reference_samples=1
    )
    method = done.summary["methods"]["plain"]
    assert method["bound"] is None and method["reasons"]["bound"] == NO_HISTORY


class Reporting:
    """A Python method that reports what it blends."""

    reads = ("radiance", "reference")
    reports = ("reprojected_history",)

    def __init__(self, size, settings):
        self.mean = None

    def step(self, frame):
        now = frame["radiance"][..., :3]
        history = now if self.mean is None else self.mean
        known = np.full((*now.shape[:2], 1), float(self.mean is not None), np.float32)
        self.mean = 0.5 * now + 0.5 * history
        return {"result": np.concatenate([self.mean, 0.5 * known], axis=-1),
                "reprojected_history": np.concatenate([history, known], axis=-1)}  # fmt: skip


class Silent(Reporting):
    """Declares a report and does not return it."""

    def step(self, frame):
        return super().step(frame)["result"]


def test_python_method_reports(gpu):
    done = evaluate(still(), [__name__ + ":Reporting", __name__ + ":Silent"], (0, 5), input="noisy")
    good = done.summary["methods"][__name__ + ":Reporting"]
    assert good["bound"]["blends"] and good["bound"]["headroom_linear_mse"] > 0
    assert "reprojected_history" in done.failed[__name__ + ":Silent"]


def test_greedy_is_its_float64_reference(gpu):
    size = (32, 18)
    steps = list(synthetic_steps(size, 4, speed=0.0, noise=0.5))
    results = play(gpu, "greedy", steps)
    history = steps[0].inputs["radiance"][..., :3]
    np.testing.assert_allclose(results[0][..., :3], history, rtol=1e-6)
    for step, result in zip(steps[1:], results[1:]):
        now = step.inputs["radiance"][..., :3]
        weight = nearest_weight(step.clean, now, history)
        history = blend(now, history, weight)
        np.testing.assert_allclose(result[..., :3], history, atol=2e-5)
        np.testing.assert_allclose(result[..., 3], weight, atol=2e-3)


@pytest.mark.parametrize(
    ("later", "count"), [(("light", "result"), 1), (("history", "result"), 2), (("result", "blend_input"), 2)]
)
def test_reports_take_the_passes_that_write_them_and_leave_histories_whole(later, count):
    """The first of two passes is enough unless the second completes its history, or reports too."""
    rgba = FORMATS["rgba32f"]
    first = PassInfo("a.glsl", ("radiance",), ("history", "light", "reprojected_history"))
    passes = (first, PassInfo("b.glsl", ("history",), later))
    method = Method("m", "m", (), ("radiance",), {}, {"history": rgba}, {"light": rgba}, passes)
    assert reporting_passes(method) == passes[:count]


def test_every_builtin_method_with_history_reports_it():
    silent = {name for name in frame_methods() if "reprojected_history" not in load_method(name).reports}
    assert silent <= {"oidn", "fsr2-class"}  # filters one frame; blends tone-mapped colors at another size


@pytest.mark.parametrize(
    "scene",
    [
        "khronos/CesiumMilkTruck/CesiumMilkTruck.glb",
        pytest.param("khronos/CesiumMan/CesiumMan.glb", marks=pytest.mark.long),
        pytest.param("khronos/Fox/Fox.gltf", marks=pytest.mark.long),
    ],
)
def test_bound_holds_on_moving_scenes(data, scene):
    light = {"environment": "default", "exposure": "auto"}
    settings = fixed_settings(width=64, height=36, reprojection="motion", frames=(0, 5), **light)
    request = {"input": "noisy+jittered", "seeds": 2, "metrics": ("relmse",), "reference_samples": 1}
    done = evaluate_methods(data / scene, BLENDING, settings, **request)
    assert not done.failed and len(done.rows) == 2 * 5 * len(BLENDING)
    assert all(m["bound"]["blends"] for m in done.summary["methods"].values())
    for row in done.rows:
        assert row["linear_mse"] >= (1.0 - FLOAT32) * row["bound_linear_mse"], row
