"""How far the columns of one run are from the reference's, and what a sample of a full run's pairs would have said."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from taubench_gl.conventions import COLUMNS
from taubench_gl.cost.analysis import ColumnError
from taubench_gl.metrics.pair_sample import PairSample, estimate, expected_half_width, sample_pairs
from taubench_gl.settings import scheme_of

Record = Mapping[str, Any]
"""A line of kind ``error``: per column its mean and every pair's percentage."""


def column_errors(record: Record, reference: Record, same_pairs: bool) -> dict[str, ColumnError]:
    """What every column of ``record`` is off by.  ``same_pairs``: pair by pair, too.

    A sample's half width is the larger of what its own pairs say and of what all pairs of the reference say of such
    samples: of many samples one would seem exact because the pairs it drew happen to be alike.
    """
    out = {}
    for column in COLUMNS:
        here, there = record["columns"][column], reference["columns"][column]
        if here["percent"] is None or there["percent"] is None:
            why = here.get("reason") or f"the reference lacks it: {there.get('reason')}"
            out[column] = ColumnError(here["percent"], reason=why)
            continue
        common = here["pairs"].keys() & there["pairs"].keys() if same_pairs else ()
        apart = [abs(here["pairs"][f] - there["pairs"][f]) for f in sorted(common)]
        out[column] = ColumnError(
            here["percent"],
            here["percent"] - there["percent"],
            _half_width(record, here, there, same_pairs),
            math.fsum(apart) / len(apart) if apart else None,
        )
    return out


def _half_width(record: Record, here: Mapping[str, Any], there: Mapping[str, Any], same_pairs: bool) -> float | None:
    own = here.get("half_width")
    if own is None or not same_pairs or "half_width" in there:
        return own  # the reference is a sample too: of the pairs left out nothing is known
    values = _in_order(there["pairs"])
    return max(own, expected_half_width(sample_of(record["settings"]["pairs"], len(values)), values))


def sampled(record: Record, pairs: str) -> dict[str, Any]:
    """The record that a run with ``pairs`` (``Settings.pairs``) would have left: a full run's pairs tell it exactly."""
    columns = {}
    for column, entry in record["columns"].items():
        if entry["percent"] is None:
            columns[column] = entry
            continue
        frames, values = sorted(entry["pairs"], key=int), _in_order(entry["pairs"])
        sample = sample_of(pairs, len(values))
        drawn = list(sample.positions)
        found = estimate(sample, values[drawn])
        kept = {frames[p]: entry["pairs"][frames[p]] for p in drawn}
        columns[column] = {"percent": found.mean, "pairs": kept, "half_width": found.half_width}
    return {**record, "columns": columns, "settings": {**record["settings"], "pairs": pairs}}


def sample_of(pairs: str, total: int) -> PairSample:
    """The sample that ``Settings.pairs`` draws of ``total`` pairs."""
    return sample_pairs(total, *scheme_of(pairs))


def _in_order(pairs: Mapping[str, float]) -> np.ndarray:
    """Percentages by frame as (N,) float64, earliest pair first."""
    return np.array([pairs[f] for f in sorted(pairs, key=int)], dtype=np.float64)
