"""What a benchmark derives from values of a measure: means, rankings that respect intervals, and error against speed.

**Rankings.**  What would change the order?  With ``MIN_CASES`` cases or more: other cases; differences of two methods
are paired by case, their interval is Student's t over the cases.  With fewer cases but enough seeds: other random
numbers; paired by seed.  Otherwise there is no interval, and the order is that of the means alone.

**Speeds.**  The difference to the method ``none`` is a function of speed, linear between the steps of a series.  A
method stops being better than no reuse where the difference first becomes zero.  The interval of that speed: where the
ends of the 95 % interval of the difference over seeds become zero.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from taubench_gl.benchmark.suite import CUT, Case, Suite
from taubench_gl.benchmark.unit import FAILED, INAPPLICABLE
from taubench_gl.metrics.bootstrap import student_interval
from taubench_gl.reuse.comparison import MIN_SEEDS, interval_over_seeds, ranking, series_of, with_holm
from taubench_gl.reuse.quality import MEASURES

Array = np.ndarray
Result = Mapping[str, Any]

HEADLINES = ("flip", "psnr_db", "relmse_trimmed", "clipped_mse", "flicker")
"""Measures that rankings and speeds are given for: none of unbounded radiance, which a few pixels decide."""

GEOMETRIC = ("relmse", "relmse_trimmed", "clipped_relmse", "linear_mse", "clipped_mse", "warp_error")
"""Measures whose mean over cases is geometric: their scale differs from scene to scene."""

SMALLEST = 1e-12
"""Smallest value of which a logarithm is taken: smaller ones count as this one."""

MIN_CASES = 5
"""Cases from which on intervals are over cases."""

BASELINE = "none"
"""The method without reuse.  Every benchmark contains it."""

NEVER, ALWAYS, CROSSES = "not better at the first step", "better within the whole range", "stops being better"


# ---------------------------------------------------------------------------------------------------------------- means
def over_cases(measure: str, values: Sequence[float]) -> float | None:
    """The mean of a measure over cases; None for no case, and for an unbiased error below the noise of a reference."""
    if not values or (measure in GEOMETRIC and min(values) < 0.0):
        return None
    return float(of_scale(measure, np.mean(to_scale(measure, np.array(values)))))


def to_scale(measure: str, values: Array) -> Array:
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
    """The 95 % interval over the seeds, Student's t, as ``low`` and ``high``; None for fewer than five."""
    interval = None if values is None else interval_over_seeds(values)
    return None if interval is None else {"low": interval.low, "high": interval.high}


# ------------------------------------------------------------------------------------------------------------- rankings
@dataclass(frozen=True, slots=True)
class CaseValues:
    """Values of one measure by method, on the scale of means over cases.

    ``cases``: (cases,) each; ``seeds``: (seeds,) each, means over the cases, empty where some case has too few seeds.
    ``shown``: the measure from a mean of values; ``tied``: pairs of methods that differ in no case by more than the
    noise of its reference.
    """

    cases: Mapping[str, Array]
    seeds: Mapping[str, Array]
    shown: Callable[[float], float]
    tied: Collection[tuple[str, str]] = ()


def ranked(measure: str, values: CaseValues, methods: Mapping[str, Any], track: str) -> dict[str, Any]:
    """The ranking of a track: ranked methods, then those that failed, with the reason; others are ``not_ranked``.

    ``over``: cases, seeds, or None where there is no interval, with the ``reason``.
    """
    count = len(next(iter(values.cases.values()), ()))
    over, samples, reason = "cases", values.cases, None
    if count < MIN_CASES:
        over, samples = "seeds", values.seeds
        if not values.seeds:
            over, samples = None, values.cases
            reason = f"fewer than {MIN_CASES} cases, and fewer than {MIN_SEEDS} seeds"
    means = {label: {"mean": float(np.mean(of_method))} for label, of_method in values.cases.items()}
    differences = [d | {"tied": (d["a"], d["b"]) in values.tied} for d in _differences(samples, over is not None)]
    entries = ranking(means, differences, higher=MEASURES[measure].better == "higher")
    for entry in entries:
        seeds = values.seeds.get(entry["method"])
        interval = None if seeds is None else student_interval(seeds)
        ends = (None, None) if interval is None else (values.shown(interval.low), values.shown(interval.high))
        entry |= {"mean": values.shown(entry["mean"]), "low": ends[0], "high": ends[1], "reason": None}
    entries += _failed(methods, track, len(entries))
    not_ranked = {label: why for label, method in methods.items() if (why := _not_ranked(label, method, track, values))}
    return {"over": over, "count": len(next(iter(samples.values()), ())), "reason": reason,
            "differences": differences, "ranking": entries, "not_ranked": not_ranked}  # fmt: skip


def _failed(methods: Mapping[str, Any], track: str, ranked_before: int) -> list[dict[str, Any]]:
    """Entries of the methods that failed: they share the ranks after the ``ranked_before`` others."""
    states = {label: method["tracks"][track] for label, method in methods.items()}
    failed = {label: f"{s['case']}: {s['reason']}" for label, s in states.items() if s["state"] == FAILED}
    ranks = {"rank": ranked_before + 1, "last_rank": ranked_before + len(failed)}
    return [
        {"method": label, "mean": None, **ranks, "low": None, "high": None,
         "indistinguishable": [other for other in failed if other != label], "reason": reason}
        for label, reason in failed.items()
    ]  # fmt: skip


def _not_ranked(label: str, method: Mapping[str, Any], track: str, values: CaseValues) -> str | None:
    """Why a method that did not fail has no rank; None for one that failed or has a rank."""
    state = method["tracks"][track]
    if state["state"] == FAILED:
        return None
    if state["state"] == INAPPLICABLE:
        return f"{state['case']}: {state['reason']}"
    return method["yardstick"] or (None if label in values.cases else "not measured in every case")


def _differences(values: Mapping[str, Array], has_intervals: bool) -> list[dict[str, Any]]:
    """a - b of every pair of methods: interval and p-value, with and without Holm's correction."""
    out = []
    for a, b in combinations(values, 2):
        difference = values[a] - values[b]
        interval = student_interval(difference) if has_intervals else None
        ends = (None, None, None) if interval is None else (interval.low, interval.high, interval.p_value)
        out.append({"a": a, "b": b, **dict(zip(("low", "high", "p_value"), ends)), "p_holm": None,
                    "difference": float(np.mean(difference))})  # fmt: skip
    return with_holm(out)


# --------------------------------------------------------------------------------------------------------------- speeds
def speed_curves(
    suite: Suite, of_case: Mapping[str, Any], labels: Sequence[str], measures: Sequence[str]
) -> dict[str, Any]:
    """Series -> measure -> method -> ``steps`` and the ``crossing``; methods that have a value at every step."""
    series: dict[tuple[str, str, str], list[Case]] = {}
    for case in suite.cases:
        if case.series not in (None, CUT) and not case.generated:
            series.setdefault((case.id.partition("/")[0], case.series, case.id.rpartition("/")[2]), []).append(case)
    out: dict[str, Any] = {}
    for (_, axis, kind), cases in series.items():
        if len(cases) < 2:
            continue
        name = f"{cases[0].id.partition('/')[0]}/{axis}/{kind}"
        curves = {
            m: {label: curve for label in labels if (curve := _curve(m, label, cases, of_case))} for m in measures
        }
        out[name] = {"axis": axis, "values": [case.value for case in cases], "measures": curves}
    return out


def _curve(measure: str, label: str, cases: Sequence[Case], of_case: Mapping[str, Any]) -> dict[str, Any] | None:
    """Steps of one method: mean, difference to ``none`` and its interval, positive where it is better than no reuse.

    None where the method or ``none`` has no value in some case.
    """
    sign = 1.0 if MEASURES[measure].better == "higher" else -1.0
    steps = []
    for case in cases:
        methods = of_case[case.id]["methods"]
        if any(methods[name]["state"] != "done" for name in (label, BASELINE)):
            return None
        values, without_reuse = (by_seed(methods[name], measure) for name in (label, BASELINE))
        if values is None or without_reuse is None:
            return None
        gain = sign * (values - without_reuse)
        ends = ends_over_seeds(gain) or {"low": None, "high": None}
        steps.append({"value": case.value, "mean": float(np.mean(values)), "gain": float(gain.mean()), **ends})
    return {"steps": steps, "crossing": None if label == BASELINE else crossing_of(steps)}


def crossing_of(steps: Sequence[Mapping[str, float | None]]) -> dict[str, Any]:
    """Find where the gain over no reuse first becomes zero.

    ``speed``: None unless it does within the range.  ``low`` and ``high``: where the ends of the interval do; ``low``
    is the first step if that end is never above zero, ``high`` None if the other end is above zero in the whole range;
    both None without intervals.
    """
    values = [step["value"] for step in steps]
    where = first_zero(values, [step["gain"] for step in steps])
    verdict = ALWAYS if where is None else NEVER if steps[0]["gain"] <= 0 else CROSSES
    low = high = None
    if all(step["low"] is not None for step in steps):
        low, high = (first_zero(values, [step[end] for step in steps]) for end in ("low", "high"))
    return {"verdict": verdict, "speed": where if verdict == CROSSES else None, "low": low, "high": high}


def first_zero(values: Sequence[float], gains: Sequence[float]) -> float | None:
    """The first zero of the line through (values, gains) that comes from above; None: all gains are above zero."""
    if gains[0] <= 0:
        return float(values[0])
    for i in range(1, len(values)):
        if gains[i] <= 0:
            share = gains[i - 1] / (gains[i - 1] - gains[i])
            return float(values[i - 1] + share * (values[i] - values[i - 1]))
    return None
