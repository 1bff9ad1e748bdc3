"""Rankings of a track that respect intervals.

What would change the order?  With ``MIN_CASES`` cases or more: other cases; differences of two methods are paired by
case, their interval is Student's t over the cases.  With fewer cases but enough seeds: other random numbers; paired by
seed.  Otherwise there is no interval, and the order is that of the means alone.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from taubench_gl.benchmark.unit import FAILED, INAPPLICABLE
from taubench_gl.metrics.bootstrap import student_interval
from taubench_gl.reuse.comparison import MIN_SEEDS, ranking, with_holm
from taubench_gl.reuse.quality import MEASURES

Array = np.ndarray

MIN_CASES = 5


@dataclass(frozen=True, slots=True)
class CaseValues:
    """Values of one measure: ``cases``: label -> (cases,); ``seeds``: label -> (seeds,), means over the cases, empty
    where some case has too few seeds.  ``shown``: the measure from a mean of values; ``tied``: pairs of methods that
    differ in no case by more than the noise of its reference."""

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
    means = {label: {"mean": float(np.mean(own))} for label, own in values.cases.items()}
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


def _failed(methods: Mapping[str, Any], track: str, better: int) -> list[dict[str, Any]]:
    """Entries of the methods that failed: they share the ranks after the ``better`` ones."""
    states = {label: method["tracks"][track] for label, method in methods.items()}
    failed = {label: f"{s['case']}: {s['reason']}" for label, s in states.items() if s["state"] == FAILED}
    return [
        {"method": label, "mean": None, "rank": better + 1, "last_rank": better + len(failed), "low": None,
         "high": None, "indistinguishable": [other for other in failed if other != label], "reason": reason}
        for label, reason in failed.items()
    ]  # fmt: skip


def _not_ranked(label: str, method: Mapping[str, Any], track: str, values: CaseValues) -> str | None:
    state = method["tracks"][track]
    if state["state"] == FAILED:
        return None
    if state["state"] == INAPPLICABLE:
        return f"{state['case']}: {state['reason']}"
    return method["yardstick"] or (None if label in values.cases else "not measured in every case")


def _differences(values: Mapping[str, Array], has_intervals: bool) -> list[dict[str, Any]]:
    """a - b of every pair: interval and p-value, with and without Holm's correction."""
    out = []
    for a, b in combinations(values, 2):
        difference = values[a] - values[b]
        interval = student_interval(difference) if has_intervals else None
        ends = (None, None, None) if interval is None else (interval.low, interval.high, interval.p_value)
        out.append({"a": a, "b": b, **dict(zip(("low", "high", "p_value"), ends)), "p_holm": None,
                    "difference": float(np.mean(difference))})  # fmt: skip
    return with_holm(out)
