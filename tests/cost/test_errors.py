"""Differences of columns, and the half widths of their intervals."""

from __future__ import annotations

import numpy as np
import pytest

from taubench_gl.cost.errors import column_differences, sample_of
from taubench_gl.features import COLUMNS
from taubench_gl.metrics.pair_sample import estimate, expected_half_width


def record(values, pairs="all"):
    """A ``columns`` record with one column, ``direct``, of these percentages; ``pairs``: the sample that was taken."""
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
    found = column_differences(sampled, record(values))["direct"]
    assert found.half_width == expected_half_width(sample_of("every:4", 24), values) > 0.3


def test_half_width_of_all_pairs_is_that_of_their_mean_difference():
    found = column_differences(record([1.0, 2.0, 3.0]), record([1.0, 1.0, 1.0]))["direct"]
    assert found.points == 1.0 and found.half_width == pytest.approx(4.30265 * 1.0 / np.sqrt(3.0), rel=1e-4)


def test_sampled_baseline_leaves_the_half_width_of_the_sample():
    baseline = record(np.arange(24.0), "strata:4")
    found = column_differences(record(np.arange(24.0) + 1.0, "strata:4"), baseline)["direct"]
    assert found.points == pytest.approx(1.0)
    assert found.half_width == pytest.approx(baseline["columns"]["direct"]["half_width"])


def test_unmeasured_columns_have_a_reason():
    found = column_differences(record([1.0]), record([1.0]))["normal"]
    assert found.points is None and found.reason
