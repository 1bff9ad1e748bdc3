"""Merges the results of units into benchmark.json: scorecards, rankings, and error against speed.

Sums run in the order of the suite and of the methods, never in that of the results: equal results give equal numbers,
bit for bit.  All times are in the block ``times``; what depends on machine and checkout is in ``provenance``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from taubench_gl.benchmark.scenes import SceneRecipe
from taubench_gl.benchmark.scores import (
    GEOMETRIC,
    HEADLINES,
    CaseValues,
    by_seed,
    ends_over_seeds,
    of_scale,
    over_cases,
    ranked,
    speed_curves,
    to_scale,
)
from taubench_gl.benchmark.suite import Case, Suite
from taubench_gl.benchmark.unit import FAILED, INAPPLICABLE, OF_KIND, Entry, loaded
from taubench_gl.provenance import combined
from taubench_gl.reuse.comparison import FEW_SEEDS, MIN_SEEDS, tied
from taubench_gl.reuse.quality import MEASURES
from taubench_gl.reuse.scores import CLASSES

SCHEMA = "taubench-gl/benchmark/1"

LEVELS = {"easy": 10.0, "medium": 30.0, "hard": 100.0}
"""Difficulty of a case -> largest percentage of pixels whose history the exact masks discard."""

VALID = ("rest", "sky")
"""Classes of pixels whose history is valid."""

BOUND = (("bound", "headroom_db"), ("bound", "clipped_headroom_db"))
GENERATED = tuple(("generated", name) for name in ("gain_db", "latency_frames", "latency_ms"))
"""Blocks and names of values of a case whose means scorecards have: of rendered frames BOUND, of generated ones
GENERATED."""

Result = Mapping[str, Any]


def merge(
    suite: Suite, entries: Sequence[Entry], stored: Mapping[str, Result], scenes: Mapping[SceneRecipe, str]
) -> dict[str, Any]:
    """The values of benchmark.json.  ``stored``: results by ``Case.identity``; ``scenes``: sha256 of their files."""
    of_case = {case.id: stored[case.identity(scenes[case.scene])] for case in suite.cases}
    tracks = tracks_of(suite, scenes)
    measures = [n for n in MEASURES if any(_mean(r, e.label, n) is not None for r in of_case.values() for e in entries)]
    methods = {e.label: _scorecard(e, suite, of_case, tracks, measures) for e in entries}
    headlines = [name for name in HEADLINES if name in measures]
    rankings = {
        track: {name: ranked(name, _values(name, cases, of_case, methods), methods, track)
                for name in headlines if name != "flicker" or not cases[0].generated}
        for track, cases in tracks.items()
    }  # fmt: skip
    provenances = [result["provenance"] for result in of_case.values() if "provenance" in result]
    return {
        "schema": SCHEMA,
        "suite": suite.describe(),
        "measures": {n: {"unit": MEASURES[n].unit, "better": MEASURES[n].better, "doc": MEASURES[n].doc,
                         "mean_over_cases": "geometric" if n in GEOMETRIC else "arithmetic"} for n in measures},
        "classes": {name: doc for name, (_, doc) in CLASSES.items()},
        "levels": LEVELS,
        "cases": {case.id: _case(case, scenes[case.scene], of_case[case.id]) for case in suite.cases},
        "methods": methods,
        "rankings": rankings,
        "speeds": speed_curves(suite, of_case, list(methods), headlines),
        "times": _times(suite, of_case, entries, tracks),
        "provenance": combined(provenances, dict.fromkeys(name for block in provenances for name in block)),
    }  # fmt: skip


def tracks_of(suite: Suite, scenes: Mapping[SceneRecipe, str]) -> dict[str, list[Case]]:
    """Track -> its cases; of several cases with equal identity, such as speed 0 of two series, the first alone."""
    out: dict[str, dict[str, Case]] = {}
    for case in suite.cases:
        out.setdefault(case.track, {}).setdefault(case.identity(scenes[case.scene]), case)
    return {track: list(cases.values()) for track, cases in out.items()}


def _case(case: Case, sha256: str, result: Result) -> dict[str, Any]:
    """One case in benchmark.json: what is evaluated, and how hard it is.  ``sha256``: of the scene's file."""
    discarded = _discarded(result)
    return {
        "sha256": case.identity(sha256), "track": case.track, "series": case.series, "value": case.value,
        "scene": case.id.partition("/")[0], "scene_sha256": sha256, "size": list(case.size),
        "frames": [case.first, case.first + case.frames - 1], "fps": case.settings.sequence.fps,
        "input": case.request.input, "render_every": case.request.render_every if case.generated else None,
        "seeds": case.request.seeds, "cuts": list(case.request.cuts), "reference": result.get("reference"),
        "exposure": result.get("exposure"), "classes_percent": _shares(result), "discarded_percent": discarded,
        "level": _level(discarded),
    }  # fmt: skip


def _shares(result: Result) -> dict[str, float] | None:
    """Class of pixels -> its percentage, the same for all methods of a case.  None if no method has run."""
    classes = next((m["classes"] for m in result["methods"].values() if m["state"] == "done"), None)
    return None if classes is None else {name: entry["percent"] for name, entry in classes.items()}


def _discarded(result: Result) -> float | None:
    """Percentage of pixels without valid history."""
    shares = _shares(result)
    return None if shares is None else sum(share for name, share in shares.items() if name not in VALID)


def _level(discarded: float | None) -> str | None:
    """The difficulty (LEVELS) of a case with this percentage of pixels without valid history."""
    return None if discarded is None else next(name for name, most in LEVELS.items() if discarded <= most + 1e-9)


def _mean(result: Result, label: str, measure: str) -> float | None:
    """The mean of a measure of one method in one case; None where the method has not run."""
    method = result["methods"].get(label, {})
    return method["mean"].get(measure) if method.get("state") == "done" else None


def _scorecard(
    entry: Entry,
    suite: Suite,
    of_case: Mapping[str, Result],
    tracks: Mapping[str, Sequence[Case]],
    measures: Sequence[str],
) -> dict[str, Any]:
    """One method: state, quality, classes, difficulty and bound by track; and all of it by case."""
    results = {case.id: of_case[case.id]["methods"][entry.label] for case in suite.cases}
    facts = next((m for m in results.values() if "title" in m), {})
    out: dict[str, Any] = {"sha256": entry.sha256} | {name: facts.get(name) for name in ("title", "cite", "settings")}
    out["memory_bytes"] = max(m.get("memory_bytes") or 0 for m in results.values()) or None
    out["tracks"] = {track: _track(cases, results, of_case, measures) for track, cases in tracks.items()}
    out["cases"] = {case.id: _cell(results[case.id], measures) for case in suite.cases}
    out["yardstick"] = method.yardstick if (method := loaded(entry)) else None
    return out


def _cell(method: Result, measures: Sequence[str]) -> dict[str, Any]:
    """One method in one case of benchmark.json; all values of the frames are left out."""
    if method["state"] != "done":
        return {"state": method["state"], "reason": method["reason"]}
    classes = {name: entry.get("flip") for name, entry in method["classes"].items()}
    mean = {name: method["mean"].get(name) for name in measures}
    intervals = {name: ends_over_seeds(by_seed(method, name)) for name in HEADLINES if name in measures}
    seeds = {name: ends for name, ends in intervals.items() if ends is not None} or None
    reasons = {name: why for name, why in method["reasons"].items() if name not in MEASURES or name in measures}
    if seeds is None:
        reasons["over_seeds"] = FEW_SEEDS
    of_kind = {name: method[name] for name in OF_KIND if name in method}
    return {"state": "done", "reason": None, "mean": mean, "over_seeds": seeds, "bound": method["bound"],
            "tail_percent": method["tail_percent"], "emitters": method["emitters"], "classes": classes,
            "reuse": method["reuse"], "response": method["response"], "reasons": reasons, **of_kind}  # fmt: skip


def _track(
    cases: Sequence[Case], results: Mapping[str, Result], of_case: Mapping[str, Result], measures: Sequence[str]
) -> dict[str, Any]:
    """One method over the cases of a track.  A failure in one case is a failure of the track."""
    for state in (FAILED, INAPPLICABLE):
        # A mean over fewer cases than those of the other methods could not be compared with theirs.
        if bad := next((case for case in cases if results[case.id]["state"] == state), None):
            return {"state": state, "reason": results[bad.id]["reason"], "case": bad.id}
    levels = {level: [c for c in cases if _level(_discarded(of_case[c.id])) == level] for level in LEVELS}
    blocks = GENERATED if cases[0].generated else BOUND
    return {
        "state": "done",
        "reason": None,
        "mean": _means(cases, results, measures),
        "levels": {level: _means(some, results, measures) for level, some in levels.items() if some},
        "classes": _classes(cases, results),
        **{name: _mean_of(block, name, cases, results) for block, name in blocks},
    }


def _mean_of(block: str, name: str, cases: Sequence[Case], results: Mapping[str, Result]) -> float | None:
    """Mean over the cases of an entry of a block; None where a case does not have it."""
    values = [results[case.id][block] and results[case.id][block][name] for case in cases]
    return None if None in values else float(np.mean(values))


def _means(cases: Sequence[Case], results: Mapping[str, Result], measures: Sequence[str]) -> dict[str, Any]:
    """Measure -> its mean over the cases; None where a case has none."""
    out = {}
    for name in measures:
        values = [results[case.id]["mean"].get(name) for case in cases]
        out[name] = None if None in values else over_cases(name, values)
    return out


def _classes(cases: Sequence[Case], results: Mapping[str, Result]) -> dict[str, float | None]:
    """Mean FLIP of the pixels of each class over all cases; None for a class without pixels."""
    out: dict[str, float | None] = {}
    for name in CLASSES:
        # By pixels, not by cases: a case with a few pixels of the class says little of it.
        entries = [results[case.id]["classes"][name] for case in cases]
        entries = [entry for entry in entries if entry["pixels"] and entry.get("flip") is not None]
        pixels = sum(entry["pixels"] for entry in entries)
        out[name] = sum(entry["flip"] * entry["pixels"] for entry in entries) / pixels if pixels else None
    return out


def _values(
    measure: str, cases: Sequence[Case], of_case: Mapping[str, Result], methods: Mapping[str, Any]
) -> CaseValues:
    """Values of the methods that have one in every case and are ranked, on the scale of means over cases."""
    track = cases[0].track
    values, seeds = {}, {}
    for label, method in methods.items():
        if method["yardstick"] or method["tracks"][track]["state"] != "done":
            continue
        means = [_mean(of_case[case.id], label, measure) for case in cases]
        if None in means:
            continue
        values[label] = to_scale(measure, np.array(means))
        # The k-th seed of a case goes with the k-th of the others: a mean over cases is one draw of the random numbers.
        by_case = [by_seed(of_case[case.id]["methods"][label], measure) for case in cases]
        if all(v is not None for v in by_case) and len(set(map(len, by_case))) == 1 and len(by_case[0]) >= MIN_SEEDS:
            seeds[label] = np.mean(to_scale(measure, np.array(by_case)), axis=0)
    results = [of_case[case.id] for case in cases]
    pairs = [pair for pair in combinations(values, 2) if all(_tied(result, measure, pair) for result in results)]
    by_seeds = seeds if len(seeds) == len(values) else {}
    return CaseValues(values, by_seeds, lambda value: float(of_scale(measure, value)), pairs)


def _tied(result: Result, measure: str, pair: tuple[str, str]) -> bool:
    """Whether two methods differ in a case by less than the noise of its reference."""
    noise = (result["reference"].get("noise_mse") or {}).get(measure)
    values = (_mean(result, label, measure) for label in pair)
    return tied(*(10.0 ** (-v / 10.0) if MEASURES[measure].unit == "dB" else v for v in values), noise)


def _times(
    suite: Suite, of_case: Mapping[str, Result], entries: Sequence[Entry], tracks: Mapping[str, Sequence[Case]]
) -> dict[str, Any]:
    """Seconds per case; per method the median over the cases of a track of ms per frame."""

    def median(label: str, cases: Sequence[Case]) -> float | None:
        values = [of_case[case.id]["times"]["methods"].get(label) for case in cases]
        measured = [value for value in values if value is not None]
        return float(np.median(measured)) if measured else None

    methods = {entry.label: {track: median(entry.label, tracks[track]) for track in tracks} for entry in entries}
    seconds = {case.id: of_case[case.id]["times"]["seconds"] for case in suite.cases}
    return {"unit": "ms per frame, median; seconds per case", "seconds": seconds, "methods": methods}
