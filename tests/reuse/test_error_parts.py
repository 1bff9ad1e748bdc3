"""Squared error apart: variance over seeds and squared bias, of images with known noise, and at equal cost."""

from __future__ import annotations

import numpy as np
import pytest
from reuse_scenes import still
from reuse_tools import evaluate, truth_of

from taubench_gl.report.reuse import reuse_tables
from taubench_gl.report.reuse_plots import plot_reuse
from taubench_gl.reuse.scores import ErrorParts, MethodRecord

SHAPE, FRAMES, SEEDS = (30, 40), 9, 6
BIAS, NOISE, REFERENCE_NOISE = 0.05, 0.2, 0.3


def record(seeds: int, most_bytes: int = 1 << 30, reference_noise: float = 0.0) -> MethodRecord:
    """Scores of gray images of mean 0.5 + BIAS and standard deviation NOISE against 0.5."""
    rng, out = np.random.default_rng(3), MethodRecord("a", frozenset(), True, parts=ErrorParts(most_bytes))
    halves = [0.5 + reference_noise * rng.standard_normal((FRAMES, *SHAPE, 3)) for _ in range(2)]
    for seed in range(seeds):
        out.begin(seed)
        before = None
        for number in range(FRAMES):
            pair = tuple(half[number] for half in halves)
            truth = truth_of(np.mean(pair, axis=0), number, before, halves=pair if reference_noise else None)
            out.add(truth, 0.5 + BIAS + NOISE * rng.standard_normal((*SHAPE, 4)), "linear", None)
            before = truth.image
        out.end()
    return out


def test_known_noise_and_bias():
    found = record(SEEDS).summary()
    parts, frames = found["error_parts"], FRAMES - 1
    values = frames * SHAPE[0] * SHAPE[1] * 3
    assert parts["variance"]["mean"] == pytest.approx(NOISE**2, rel=5 * np.sqrt(2 / values / (SEEDS - 1)))
    assert parts["bias_squared"]["mean"] == pytest.approx(BIAS**2, abs=5 * 2 * BIAS * NOISE / np.sqrt(values * SEEDS))
    total = parts["variance"]["mean"] + parts["bias_squared"]["mean"]
    assert total == pytest.approx(found["mean"]["linear_mse"], rel=1e-6) and parts["frames"] == frames
    for part in (parts["variance"], parts["bias_squared"]):
        assert part["low"] < part["mean"] < part["high"]


def test_noise_of_the_reference_is_in_neither():
    parts = record(SEEDS, reference_noise=REFERENCE_NOISE).summary()["error_parts"]
    assert parts["variance"]["mean"] == pytest.approx(NOISE**2, rel=0.02)
    assert parts["bias_squared"]["mean"] == pytest.approx(BIAS**2, abs=0.2 * BIAS**2)
    assert record(1).summary()["error_parts"] is None


def test_frames_beyond_the_memory_are_left_out():
    image = SHAPE[0] * SHAPE[1] * 3 * 8
    assert record(2, 3 * image + 1).summary()["error_parts"]["frames"] == 3
    assert record(2, image - 1).summary()["error_parts"] is None


def test_accumulation_trades_variance_for_no_bias_on_a_still_scene(tmp_path):
    """A running mean of a still scene has less variance, and neither method a bias; curves at equal cost follow."""
    done = evaluate(still(), ["none", "accumulate"], (0, 12), input="noisy", seeds=5)
    none, mean = (done.summary["methods"][name]["error_parts"] for name in ("none", "accumulate"))
    assert mean["variance"]["mean"] < 0.5 * none["variance"]["mean"]
    for parts in (none, mean):
        assert abs(parts["bias_squared"]["mean"]) < 0.2 * none["variance"]["mean"]
    (table,) = (table for table in reuse_tables(done.summary) if table.title == "Bias and variance")
    assert [row.values[3] for row in table.rows] == [p["variance"]["mean"] for p in (none, mean)]
    files = plot_reuse(done.summary, done.rows, tmp_path)
    assert tmp_path / "equal_time.png" in files and tmp_path / "equal_rays.png" not in files
