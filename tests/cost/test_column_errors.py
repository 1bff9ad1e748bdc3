"""Errors of columns: what a sample of the pairs is off by, and that a full run tells it without being run again."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.conventions import COLUMNS
from taubench_gl.cost.column_errors import column_errors, sample_of, sampled
from taubench_gl.cost.errors import from_run
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.metrics.pair_sample import expected_half_width
from taubench_gl.settings import Settings

SMALL = {"width": 48, "height": 28, "frames": (10, 31), "columns": ("frustum", "position", "normal")}


def record(values, **more):
    """An ``error`` record with one column, ``direct``, of these percentages."""
    columns = {c: {"percent": None, "reason": "not asked for"} for c in COLUMNS}
    pairs = {str(frame): float(v) for frame, v in enumerate(values, start=1)}
    columns["direct"] = {"percent": float(np.mean(values)), "pairs": pairs}
    return {"columns": columns, "settings": {"pairs": "all"}} | more


@pytest.fixture(scope="module")
def full(demo):
    return from_run(evaluate_scene(demo, Settings.of(**SMALL)))


@pytest.mark.parametrize("pairs", ["strata:2", "strata:4", "every:3", "every:5"])
def test_a_full_run_tells_what_a_sampled_run_measures(demo, full, pairs):
    run = from_run(evaluate_scene(demo, Settings.of(**SMALL, pairs=pairs)))
    told = sampled(full, pairs)
    for column in SMALL["columns"]:
        measured, expected = run["columns"][column], told["columns"][column]
        assert expected["pairs"] == measured["pairs"]
        assert expected["percent"] == pytest.approx(measured["percent"], abs=1e-8)
        assert expected["half_width"] == pytest.approx(measured["half_width"], abs=1e-8)
    assert told["columns"]["color"] == full["columns"]["color"], "not measured, with its reason"
    assert full["settings"]["pairs"] == "all", "the full run is left as it is"


def test_frames_are_taken_by_number():
    # Keys are text: "10" comes before "9" in it.
    told = sampled(record(range(1, 13)), "every:3")
    assert list(told["columns"]["direct"]["pairs"]) == ["2", "5", "8", "11"]


def test_a_calm_draw_is_as_wrong_as_any():
    values = np.tile([1.0, 3.0, 1.0, 1.0], 6)
    reference = record(values)
    calm = sampled(reference, "every:4")
    drawn = [values[p] for p in sample_of("every:4", 24).positions]
    assert np.ptp(drawn) == 0.0 == calm["columns"]["direct"]["half_width"], "all that it drew is alike"
    error = column_errors(calm, reference, same_pairs=True)["direct"]
    assert error.half_width == expected_half_width(sample_of("every:4", 24), values) > 0.3
    assert error.error == max(abs(error.points), error.half_width)


def test_a_wide_interval_of_its_own_counts():
    rough = sampled(record([0.0, 9.0] * 12), "strata:3")
    error = column_errors(rough, record(np.linspace(4.0, 5.0, 24)), same_pairs=True)["direct"]
    own = rough["columns"]["direct"]["half_width"]
    known = expected_half_width(sample_of("strata:3", 24), np.linspace(4.0, 5.0, 24))
    assert error.half_width == max(own, known)


def test_full_runs_have_no_half_width():
    error = column_errors(record([1.0, 2.0]), record([1.5, 1.5]), same_pairs=True)["direct"]
    assert error.half_width is None and error.points == 0.0 and error.pair_points == 0.5


def test_of_a_sampled_reference_only_the_draw_is_known():
    reference = sampled(record(np.arange(24.0)), "strata:4")
    error = column_errors(sampled(record(np.arange(24.0) + 1.0), "strata:4"), reference, same_pairs=True)["direct"]
    assert error.points == pytest.approx(1.0)
    assert error.half_width == pytest.approx(reference["columns"]["direct"]["half_width"])
