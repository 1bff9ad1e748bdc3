"""Statistics of an evaluation: intervals, paired differences between methods, rankings, and convergence after a cut.

Takes the rows of frames.csv, no images.  Of every measure, the values of a frame are averaged over the seeds, and
blocks of frames are drawn (``metrics.bootstrap``): all seeds of a block, and both methods of a difference, stay
together.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from taubench_gl.metrics.bootstrap import (
    CONFIDENCE,
    MIN_FRAMES,
    RESAMPLES,
    Interval,
    block_length,
    holm_adjusted,
    interval,
    student_interval,
)
from taubench_gl.reuse.quality import MEASURES, ROBUST

Array = np.ndarray
Row = Mapping[str, Any]

MIN_SEEDS = 5
"""Fewer seeds give no interval over seeds."""

RULE = (
    "moving-block bootstrap over frames, all seeds and both methods of a block together; Student's t "
    "with one degree of freedom less than there are blocks; p-values of all pairs of a measure corrected by Holm's "
    "method"
)
FEW_FRAMES = f"fewer than {MIN_FRAMES} frames"
FEW_SEEDS = f"fewer than {MIN_SEEDS} seeds"
NO_VALUE = "not measured in every frame"
NOT_FINITE = "not finite in frames drawn from these"


@dataclass(frozen=True, slots=True)
class Series:
    """Values of one measure that average over frames and seeds.  ``values``: label -> (seeds, frames).

    ``decibels``: the values are mean squared errors, and the measure is 10 log10(1 / mean).  ``left_out``: methods
    without a value in some frame.
    """

    measure: str
    values: Mapping[str, Array]
    decibels: bool
    left_out: tuple[str, ...] = ()

    def of_mean(self, mean: Array) -> Array:
        """The measure from a mean of values."""
        return -10.0 * np.log10(mean) if self.decibels else mean

    def by_seed(self, label: str) -> Array:
        """The measure of each seed, (seeds,)."""
        return self.of_mean(self.values[label].mean(axis=1))


def compare_methods(
    rows: Sequence[Row],
    frames: Collection[int],
    cuts: Collection[int] = (),
    *,
    yardsticks: Collection[str] = (),
    noise: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """The block ``statistics`` of reuse.json.

    ``rows``: of all methods that have not failed; ``frames``: those that means are over; ``cuts``: frames declared to
    have no history; ``yardsticks``: methods that have means and intervals, and are in no difference and no ranking;
    ``noise``: of the reference, as of ``quality.half_noise``.
    """
    counted = [row for row in rows if row["frame"] in set(frames)]
    seeds = sorted({row["seed"] for row in rows})
    measures = {}
    for name in MEASURES:
        series = series_of(counted, name)
        if series.values:
            measures[name] = _measure(series, yardsticks, (noise or {}).get(name))
    return {
        "rule": RULE,
        "confidence": CONFIDENCE,
        "resamples": RESAMPLES,
        "frames": len(set(frames)),
        "seeds": len(seeds),
        "measures": measures,
        "convergence": convergence(rows, cuts),
    }


def series_of(rows: Sequence[Row], measure: str) -> Series:
    """The values of ``measure``, without methods that lack one in some frame."""
    decibels = MEASURES[measure].unit == "dB"
    grouped: dict[str, dict[int, list[float | None]]] = {}
    for row in rows:
        grouped.setdefault(row["method"], {}).setdefault(row["seed"], []).append(row[measure])
    values, left_out = {}, []
    for label, by_seed in grouped.items():
        table = list(by_seed.values())
        if any(v is None for values in table for v in values) or len(set(map(len, table))) > 1:
            left_out.append(label)
            continue
        array = np.array(table, dtype=np.float64)
        values[label] = 10.0 ** (-array / 10.0) if decibels else array
    return Series(measure, values, decibels, tuple(left_out))


def _measure(series: Series, yardsticks: Collection[str], noise: float | None) -> dict[str, Any]:
    """Intervals, differences and ranking of one measure; unbounded radiance has the ranking of clipped radiance."""
    means = {
        label: {"mean": float(series.of_mean(values.mean()))} | _over_frames(series, label) | _over_seeds(series, label)
        for label, values in series.values.items()
    }
    ranked = replace(series, values={n: v for n, v in series.values.items() if n not in yardsticks})
    differences = _differences(ranked, noise)
    frames = next(iter(series.values.values())).shape[1]
    return {
        "reason": None if frames >= MIN_FRAMES else FEW_FRAMES,
        "left_out": dict.fromkeys(series.left_out, NO_VALUE),
        "means": means,
        "differences": differences,
        "ranked_by": ROBUST.get(series.measure, series.measure),
        "ranking": [] if series.measure in ROBUST else ranking(
            {label: means[label] for label in ranked.values}, differences,
            higher=MEASURES[series.measure].better == "higher"),
    }  # fmt: skip


def _over_frames(series: Series, *labels: str) -> dict[str, Any]:
    """The interval over frames of the measure of one method, or of the difference of two, as ``over_frames``."""
    columns = np.stack([series.values[label].mean(axis=0) for label in labels], axis=-1)

    def statistic(means: Array) -> Array:
        values = series.of_mean(means)
        return values[..., 0] if len(labels) == 1 else values[..., 0] - values[..., 1]

    return over_frames(columns, statistic, columns[:, 0] if len(labels) == 1 else columns[:, 0] - columns[:, 1])


def over_frames(columns: Array, statistic: Callable[[Array], Array], series: Array) -> dict[str, Any]:
    """Interval over frames of ``statistic`` of the means of ``columns`` (frames, k), its p-value of 0 and block length;
    or None, and why.

    ``series`` (frames,): the values whose correlation gives the length.
    """
    none = {"low": None, "high": None, "p_value": None, "block_length": None}
    if len(columns) < MIN_FRAMES:
        return none | {"interval_reason": FEW_FRAMES}
    length = block_length(series)
    bounds = interval(columns, statistic, length)
    if bounds is None:
        return none | {"interval_reason": NOT_FINITE}
    ends = {"low": bounds.low, "high": bounds.high, "p_value": bounds.p_value}
    return ends | {"block_length": length, "interval_reason": None}


def _over_seeds(series: Series, *labels: str) -> dict[str, Any]:
    """The interval over seeds of the measure of one method, or of the difference of two, as ``over_seeds``."""
    by_seed = [series.by_seed(label) for label in labels]
    return over_seeds(by_seed[0] if len(labels) == 1 else by_seed[0] - by_seed[1])


def over_seeds(values: Array) -> dict[str, Any]:
    """Mean and interval of values (seeds,), each averaged over frames: what other random numbers would change."""
    bounds = interval_over_seeds(values)
    if bounds is None:
        return {"over_seeds": None, "over_seeds_reason": FEW_SEEDS}
    return {"over_seeds": {"mean": bounds.estimate, "low": bounds.low, "high": bounds.high}, "over_seeds_reason": None}


def interval_over_seeds(values: Array) -> Interval | None:
    """Student's interval for the mean of values (seeds,); None for fewer than ``MIN_SEEDS``."""
    return student_interval(values) if len(values) >= MIN_SEEDS else None


def _differences(series: Series, noise: float | None) -> list[dict[str, Any]]:
    """Every pair of methods: a - b, its interval, p-value with and without Holm's correction, and the verdict.

    ``tied``: the mean values differ by less than ``noise``, that of the reference.
    """
    plain = {label: float(values.mean()) for label, values in series.values.items()}
    mean = {label: float(series.of_mean(values.mean())) for label, values in series.values.items()}
    out = [
        {"a": a, "b": b, "difference": mean[a] - mean[b], "tied": tied(plain[a], plain[b], noise)}
        | _over_frames(series, a, b)
        | _over_seeds(series, a, b)
        for a, b in combinations(series.values, 2)
    ]
    return [entry | {"verdict": verdict(series.measure, entry)} for entry in with_holm(out)]


def tied(a: float, b: float, noise: float | None) -> bool:
    """Whether two squared errors differ by less than the noise of the reference adds to them."""
    return noise is not None and abs(a - b) < noise


def with_holm(differences: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """``differences`` with ``p_holm``, the p-value after Holm's correction for all of them; None without p-values."""
    p_values = [entry["p_value"] for entry in differences]
    has_p_values = bool(p_values) and None not in p_values
    adjusted = holm_adjusted(np.array(p_values)).tolist() if has_p_values else [None] * len(p_values)
    return [entry | {"p_holm": p_holm} for entry, p_holm in zip(differences, adjusted, strict=True)]


def verdict(measure: str, entry: Mapping[str, Any]) -> str:
    """Which method of a pair is better, or that they are indistinguishable, in words."""
    unit = f" {MEASURES[measure].unit}".rstrip()
    if entry["low"] is None:
        return f"no interval: {entry['interval_reason']}"
    ends = f"interval {entry['low']:.3g} to {entry['high']:.3g}{unit}"
    if entry.get("tied"):
        return f"tied: closer than the noise of the reference ({ends})"
    if entry["low"] <= 0.0 <= entry["high"]:
        return f"statistically indistinguishable ({ends})"
    if entry["p_holm"] >= 1.0 - CONFIDENCE:
        return f"statistically indistinguishable after Holm's correction ({ends})"
    higher = MEASURES[measure].better == "higher"
    winner = entry["a"] if (entry["difference"] > 0) == higher else entry["b"]
    return f"{winner} is better ({ends})"


def ranking(
    means: Mapping[str, Mapping[str, Any]], differences: Sequence[Mapping[str, Any]], *, higher: bool
) -> list[dict[str, Any]]:
    """Methods from the best mean on.  ``higher``: higher is better.

    ``rank``: 1 + the methods that are better beyond Holm's correction and the noise of the reference; ``last_rank``:
    all less those that are worse; ``indistinguishable``: the others.  None: there are no intervals.
    """
    sign = -1.0 if higher else 1.0
    losses: dict[str, int] = dict.fromkeys(means, 0)
    wins: dict[str, int] = dict.fromkeys(means, 0)
    alike: dict[str, list[str]] = {label: [] for label in means}
    has_p_values = all(entry["p_holm"] is not None for entry in differences)
    for entry in differences if has_p_values else ():
        a, b = entry["a"], entry["b"]
        if entry["p_holm"] < 1.0 - CONFIDENCE and not entry.get("tied"):
            loser, winner = (a, b) if sign * entry["difference"] > 0 else (b, a)
            losses[loser] += 1
            wins[winner] += 1
        else:
            alike[a].append(b)
            alike[b].append(a)
    return [
        {
            "method": label,
            "mean": means[label]["mean"],
            "rank": 1 + losses[label] if has_p_values else None,
            "last_rank": len(means) - wins[label] if has_p_values else None,
            "indistinguishable": alike[label] if has_p_values else None,
        }
        for label in sorted(means, key=lambda m: sign * means[m]["mean"])
    ]


def convergence(rows: Sequence[Row], cuts: Collection[int] = ()) -> dict[str, Any]:
    """Linear MSE by the number of frames since history began: at the first frame and after every cut.

    -> ``starts``: these frames; ``methods``: label -> means over starts and seeds, one per age from 0 on; only ages
    that every start reaches.
    """
    frames = sorted({row["frame"] for row in rows})
    in_turn = not frames or frames[-1] - frames[0] < len(frames)  # else history is not that of the frame before
    starts = sorted({*frames[:1], *(cut for cut in cuts if cut in frames)}) if in_turn else []
    ends = [*starts[1:], frames[-1] + 1] if starts else []
    reach = min((end - start for start, end in zip(starts, ends, strict=True)), default=0)
    curves: dict[str, list[float | None]] = {}
    for label in dict.fromkeys(row["method"] for row in rows):
        by_frame: dict[int, list[float | None]] = {}
        for row in rows:
            if row["method"] == label:
                by_frame.setdefault(row["frame"], []).append(row["linear_mse"])
        curves[label] = [_mean([v for start in starts for v in by_frame[start + age]]) for age in range(reach)]
    return {"measure": "linear_mse", "starts": starts, "methods": curves}


def _mean(values: Sequence[float | None]) -> float | None:
    measured = [v for v in values if v is not None]
    return float(np.mean(measured)) if measured else None
