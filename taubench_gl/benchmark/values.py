"""Values of a measure: means over frames by seed, and means over cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.reuse.comparison import interval_over_seeds, series_of

Array = np.ndarray
Result = Mapping[str, Any]

HEADLINES = ("flip", "psnr_db", "relmse_trimmed", "clipped_mse", "flicker")
"""Measures that rankings and speeds are given for: none of unbounded radiance, which a few pixels decide."""

GEOMETRIC = ("relmse", "relmse_trimmed", "clipped_relmse", "linear_mse", "clipped_mse", "warp_error")
"""Measures whose mean over cases is geometric: their scale differs from scene to scene."""

SMALLEST = 1e-12
"""Values below it count as it where a logarithm is taken."""


def over_cases(measure: str, values: Sequence[float]) -> float | None:
    """The mean of a measure over cases; None for no case, and for an unbiased error below the noise of a reference."""
    if not values or (measure in GEOMETRIC and min(values) < 0.0):
        return None
    return float(of_scale(measure, np.mean(to_scale(measure, np.array(values)))))


def to_scale(measure: str, values: np.ndarray) -> np.ndarray:
    """Values on the scale on which means over cases are taken: logarithms for GEOMETRIC."""
    return np.log(np.maximum(values, SMALLEST)) if measure in GEOMETRIC else values


def of_scale(measure: str, value: Any) -> Any:
    """The inverse of ``to_scale``."""
    return np.exp(value) if measure in GEOMETRIC else value


def by_seed(method: Result, measure: str) -> Array | None:
    """The mean of a measure over the counted frames of each seed, (seeds,); None where a frame has no value."""
    frames = sorted({row["frame"] for row in method["rows"]})[method["warmup"] :]
    rows = [row | {"method": ""} for row in method["rows"] if row["frame"] in frames]
    series = series_of(rows, measure)
    return series.by_seed("") if series.values else None


def ends_over_seeds(values: Array | None) -> dict[str, float] | None:
    """``low`` and ``high``: 95 % interval over the seeds, Student's t; None for fewer than five."""
    interval = None if values is None else interval_over_seeds(values)
    return None if interval is None else {"low": interval.low, "high": interval.high}
