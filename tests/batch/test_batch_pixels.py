"""Pairs at random pixels: all of them give the rates of whole images; the interval of some holds the truth."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.batch.pixels import random_pixels
from taubench_gl.batch.spec import BatchSpec, Job
from taubench_gl.batch.study import run_batch
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.features import COLUMNS
from taubench_gl.paths import ASSETS
from taubench_gl.run import load_run
from taubench_gl.settings import Settings

DEMO = str(ASSETS / "demo.glb")
SIZE = (32, 18)
SETTINGS = Settings(width=SIZE[0], height=SIZE[1], frames=(18, 23), light="path-traced", spp=2, bounces=2, exposure=1.0)


def counted(folder, count, **how):
    run_batch(BatchSpec("pixels", (Job("demo", DEMO, SETTINGS, {}, pixels=count),)), folder, **how)
    return load_run(folder / "jobs" / "demo")


@pytest.fixture(scope="module")
def whole():
    return evaluate_scene(DEMO, SETTINGS)


def test_all_pixels_give_the_rates_of_whole_images(whole, tmp_path):
    run = counted(tmp_path, 10_000)
    assert run.summary["sampling"]["pixels"] == SIZE[0] * SIZE[1]
    assert [row["frame"] for row in run.frames] == [row["frame"] for row in whole.frames]
    for name in COLUMNS:
        ours, expected = (s["discard"][name]["mean_percent"] for s in (run.summary, whole.summary))
        assert ours == pytest.approx(expected, abs=0.1), name  # float64 against shaders: pixels at a threshold
        assert run.summary["sampling"]["columns"][name]["half_width_points"] == 0.0
        curve, known = (
            (np.array(s["curves"][name]["at_or_above"]) for s in (run.summary, whole.summary))
            if name != "frustum"
            else (np.zeros(1), np.zeros(1))
        )
        assert np.abs(curve - known).max() <= 0.02 * len(run.frames) * SIZE[0] * SIZE[1]
    assert run.summary["discard"]["direct"]["mean_percent"] > 1.0


def test_some_pixels_give_an_interval_that_holds_the_rate(whole, tmp_path):
    run = counted(tmp_path, 100)
    for name, one in run.summary["sampling"]["columns"].items():
        expected = whole.summary["discard"][name]["mean_percent"]
        assert 0.0 < one["half_width_points"] < 5.0
        assert abs(one["mean_percent"] - expected) < 1.5 * one["half_width_points"] + 0.1, name
        assert run.summary["discard"][name]["mean_percent"] == pytest.approx(one["mean_percent"])


def test_counts_do_not_depend_on_chunks(tmp_path):
    runs = [counted(tmp_path / str(chunk), 20, chunk=chunk) for chunk in (1, 4)]
    assert runs[0].summary == runs[1].summary and runs[0].frames == runs[1].frames


def test_pixels_differ_between_pairs_and_none_is_twice():
    a, b = random_pixels(5, 400, (64, 36)), random_pixels(6, 400, (64, 36))
    assert len(np.unique(a, axis=0)) == len(a) == 400 and not np.array_equal(a, b)
    assert np.array_equal(a, random_pixels(5, 400, (64, 36)))
    assert a.max(axis=0).tolist() <= [63, 35] and np.abs(a.mean(axis=0) - (31.5, 17.5)).max() < 4.0
    assert len(random_pixels(5, 400, (6, 4))) == 24
