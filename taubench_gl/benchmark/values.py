"""Values of a measure: means over frames by seed, and means over cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.metrics.bootstrap import student_interval
from taubench_gl.reuse.comparison import MIN_SEEDS
from taubench_gl.reuse.quality import MEASURES

Result = Mapping[str, Any]

HEADLINES = ("flip", "psnr_db", "relmse_trimmed", "flicker")
"""Measures that rankings and speeds are given for."""

GEOMETRIC = ("relmse", "relmse_trimmed", "linear_mse", "warp_error")
"""Measures whose mean over cases is geometric: their scale differs from scene to scene."""

SMALLEST = 1e-12
"""Values below it count as it where a logarithm is taken."""


def over_cases(measure: str, values: Sequence[float]) -> float | None:
    """The mean of a measure over cases; None for no case."""
    if not values:
        return None
    return float(of_scale(measure, np.mean(to_scale(measure, np.array(values)))))


def to_scale(measure: str, values: np.ndarray) -> np.ndarray:
    """Values on the scale on which means over cases are taken: logarithms for GEOMETRIC."""
    return np.log(np.maximum(values, SMALLEST)) if measure in GEOMETRIC else values


def of_scale(measure: str, value: Any) -> Any:
    """The inverse of ``to_scale``."""
    return np.exp(value) if measure in GEOMETRIC else value


def by_seed(method: Result, measure: str) -> list[float] | None:
    """The mean of a measure over the counted frames of each seed; None where a frame has no value."""
    seeds: dict[int, list[float | None]] = {}
    for row in method["rows"]:
        seeds.setdefault(row["seed"], []).append(row[measure])
    out = []
    for values in seeds.values():
        counted = values[method["warmup"] :]
        if any(value is None for value in counted):
            return None
        array = np.array(counted, dtype=np.float64)
        decibels = MEASURES[measure].unit == "dB"
        out.append(float(-10.0 * np.log10(np.mean(10.0 ** (-array / 10.0))) if decibels else array.mean()))
    return out


def interval_over_seeds(values: Sequence[float] | None) -> dict[str, float] | None:
    """``low`` and ``high``: 95 % interval over the seeds, Student's t; None for fewer than five"""
    if values is None or len(values) < MIN_SEEDS:
        return None
    found = student_interval(np.array(values))
    return {"low": found.low, "high": found.high}
