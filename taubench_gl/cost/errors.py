"""Columns of configurations whose pixels or pairs are others than the baseline's: means and their differences."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack
from taubench_gl.cost.analysis import ColumnDifference
from taubench_gl.cost.records import Record
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.features import COLUMNS
from taubench_gl.metrics.counts import percent
from taubench_gl.metrics.pair_sample import PairSample, expected_half_width, sample_pairs
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings, scheme_of


def measure_columns(
    scene: Scene, camera: CameraTrack, settings: Settings, check: Callable[[], None] = lambda: None
) -> dict[str, Any]:
    """One full run: per column the mean and every pair's percentage of w * h.  ``check``: called after each pair."""
    run = evaluate_scene(scene, settings, Observers(on_counts=lambda _: check()), camera=camera)
    sampling = (run.summary.get("sampling") or {}).get("columns", {})
    columns: dict[str, Any] = {}
    for column in COLUMNS:
        entry = run.summary["discard"][column]
        columns[column] = {"percent": entry["mean_percent"]}
        if entry["mean_percent"] is None:
            columns[column]["reason"] = entry.get("reason", "not measured")
            continue
        columns[column]["pairs"] = {str(row["frame"]): round(percent(row, column), 9) for row in run.frames}
        if column in sampling:
            columns[column]["half_width"] = sampling[column]["half_width_points"]
    return {"columns": columns, "settings": run.summary["settings"]}


def column_differences(record: Record, baseline: Record) -> dict[str, ColumnDifference]:
    """Every column of ``record`` less the baseline's; both of kind ``columns``: per column the mean and every pair's
    percentage.

    The half width is that of the sample of pairs, and at least the one expected of such samples from the pairs of the
    baseline: a sample whose pairs happen to be alike is not exact.  Where all pairs are measured, it is that of the
    mean of their differences (Student's t).
    """
    out = {}
    for column in COLUMNS:
        here, there = record["columns"][column], baseline["columns"][column]
        if here["percent"] is None or there["percent"] is None:
            out[column] = ColumnDifference(here["percent"], reason=here.get("reason") or there.get("reason"))
            continue
        half = _half_width(record, here, there)
        out[column] = ColumnDifference(here["percent"], here["percent"] - there["percent"], half)
    return out


def _half_width(record: Record, here: Mapping[str, Any], there: Mapping[str, Any]) -> float | None:
    own = here.get("half_width")
    if own is not None:
        if "half_width" in there:
            return own  # the baseline is a sample too: nothing is known of the other pairs
        values = np.array([there["pairs"][f] for f in sorted(there["pairs"], key=int)], dtype=np.float64)
        return max(own, expected_half_width(sample_of(record["settings"]["pairs"], len(values)), values))
    differences = [percent - there["pairs"][f] for f, percent in here["pairs"].items() if f in there["pairs"]]
    if len(differences) < 3:
        return None
    from taubench_gl.metrics.bootstrap import student_interval  # imported late: SciPy takes 0.3 s

    interval = student_interval(np.array(differences))
    return 0.5 * (interval.high - interval.low)


def sample_of(pairs: str, total: int) -> PairSample:
    """The sample that the setting ``pairs`` takes of ``total`` pairs."""
    return sample_pairs(total, *scheme_of(pairs))
