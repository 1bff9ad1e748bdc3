"""Errors of columns against a reference, and the half widths of sampled pairs."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.conventions import COLUMNS
from taubench_gl.cost.errors import column_errors, feature_frames, sample_of
from taubench_gl.metrics.pair_sample import estimate, expected_half_width


def record(values, pairs="all"):
    """An ``error`` record with one column, ``direct``, of these percentages; ``pairs``: the sample that was taken."""
    values = np.asarray(values, dtype=np.float64)
    sample = sample_of(pairs, len(values))
    drawn = list(sample.positions)
    entry = {"percent": float(values[drawn].mean()), "pairs": {str(p + 1): float(values[p]) for p in drawn}}
    if pairs != "all":
        found = estimate(sample, values[drawn])
        entry |= {"percent": found.mean, "half_width": found.half_width}
    columns = {c: {"percent": None, "reason": "not requested"} for c in COLUMNS}
    return {"columns": columns | {"direct": entry}, "settings": {"pairs": pairs}}


def test_equal_pairs_in_a_sample_do_not_make_it_exact():
    values = np.tile([1.0, 3.0, 1.0, 1.0], 6)
    sampled = record(values, "every:4")
    assert sampled["columns"]["direct"]["half_width"] == 0.0, "all sampled pairs are equal"
    error = column_errors(sampled, record(values), same_pairs=True)["direct"]
    assert error.half_width == expected_half_width(sample_of("every:4", 24), values) > 0.3
    assert error.error == max(abs(error.points), error.half_width)


def test_half_width_is_the_larger_of_both():
    sampled, reference = record([0.0, 9.0] * 12, "strata:3"), np.linspace(4.0, 5.0, 24)
    error = column_errors(sampled, record(reference), same_pairs=True)["direct"]
    own = sampled["columns"]["direct"]["half_width"]
    assert error.half_width == max(own, expected_half_width(sample_of("strata:3", 24), reference))


def test_full_runs_have_no_half_width():
    error = column_errors(record([1.0, 2.0]), record([1.5, 1.5]), same_pairs=True)["direct"]
    assert error.half_width is None and error.points == 0.0 and error.pair_points == 0.5


def test_sampled_reference_leaves_the_half_width_of_the_sample():
    reference = record(np.arange(24.0), "strata:4")
    error = column_errors(record(np.arange(24.0) + 1.0, "strata:4"), reference, same_pairs=True)["direct"]
    assert error.points == pytest.approx(1.0)
    assert error.half_width == pytest.approx(reference["columns"]["direct"]["half_width"])


def test_unmeasured_columns_have_a_reason():
    error = column_errors(record([1.0]), record([1.0]), same_pairs=True)["normal"]
    assert error.error is None and error.reason


@pytest.mark.parametrize(("frames", "expected"), [(range(10, 31), (18, 22)), (range(5, 7), (5, 7))])
def test_compared_frames_are_from_the_middle(frames, expected):
    assert feature_frames(frames) == expected
