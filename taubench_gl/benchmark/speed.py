"""Difficulty against quality: error over the speed of a series, and the speed at which reuse stops being better.

The difference to the method ``none`` is a function of speed, linear between the steps of the series.  A method stops
being better than no reuse where it first becomes zero.  Its interval: where the ends of the 95 % interval of the
difference over seeds do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.benchmark.suite import CUT, Case, Suite
from taubench_gl.benchmark.values import by_seed, ends_over_seeds
from taubench_gl.reuse.quality import MEASURES

BASELINE = "none"
"""The method without reuse.  Every benchmark contains it."""

NEVER, ALWAYS, CROSSES = "not better at the first step", "better within the whole range", "stops being better"


def speed_curves(
    suite: Suite, of_case: Mapping[str, Any], labels: Sequence[str], measures: Sequence[str]
) -> dict[str, Any]:
    """Series -> measure -> method -> ``steps`` and the ``crossing``; methods that have a value at every step."""
    series: dict[tuple[str, str, str], list[Case]] = {}
    for case in suite.cases:
        if case.series not in (None, CUT):
            series.setdefault((case.scene.source, case.series, case.id.rpartition("/")[2]), []).append(case)
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
    """Steps of one method: mean, difference to ``none`` and its interval, positive: better than no reuse."""
    sign = 1.0 if MEASURES[measure].better == "higher" else -1.0
    steps = []
    for case in cases:
        methods = of_case[case.id]["methods"]
        if any(methods[name]["state"] != "done" for name in (label, BASELINE)):
            return None
        own, base = (by_seed(methods[name], measure) for name in (label, BASELINE))
        if own is None or base is None:
            return None
        gain = sign * (own - base)
        ends = ends_over_seeds(gain) or {"low": None, "high": None}
        steps.append({"value": case.value, "mean": float(np.mean(own)), "gain": float(gain.mean()), **ends})
    return {"steps": steps, "crossing": None if label == BASELINE else crossing_of(steps)}


def crossing_of(steps: Sequence[Mapping[str, float | None]]) -> dict[str, Any]:
    """Where the gain over no reuse first becomes zero.

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
