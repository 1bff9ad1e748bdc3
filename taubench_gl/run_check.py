"""Recomputes what a summary shows from the rows of frames.csv and the mask histogram, with the functions that made it.

Scene facts, census, lobes, the noise floor, and of sampled pairs camera activity and the shares of reasons cannot be
recomputed: the checksums of the file cover them (``checksums``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.features import COLUMNS, MASK_WORDS
from taubench_gl.metrics.activity import QUANTITIES, describe
from taubench_gl.metrics.counts import counts_of, discarded_above, edges
from taubench_gl.metrics.exact_rates import exact_summary
from taubench_gl.metrics.pair_sample import PairSample, sample_pairs
from taubench_gl.metrics.reuse_rate import ReuseStats
from taubench_gl.metrics.sampled_light import SAMPLED, decided_summary
from taubench_gl.metrics.sequence_stats import SequenceStats, sensitivity
from taubench_gl.run_schema import CAMERA_COLUMNS
from taubench_gl.settings import scheme_of

Row = Mapping[str, Any]

TOLERANCE = 1e-9
"""Relative and absolute: JSON and CSV keep every digit, machines add in different orders."""
_CAMERA_TOLERANCE = 1e-6  # of angles between nearly equal directions

_FAULTS = (ArithmeticError, LookupError, TypeError, ValueError, AttributeError)


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A recorded value and what the rest of the run gives for it; ``in_rows``: it is in frames.csv."""

    key: str
    recorded: Any
    derived: Any
    in_rows: bool = False

    def __str__(self) -> str:
        return f"{self.key} is {_short(self.recorded)}, the rest of the run gives {_short(self.derived)}"


def contradiction(summary: Mapping[str, Any], rows: Sequence[Row]) -> Contradiction | None:
    """The first value of a run that contradicts the others; None for a run that fits together.

    ``summary``: checked against ``run_schema.Summary``.  Keys that are missing or null are not compared.
    """
    try:
        return next(_contradictions(summary, rows), None)
    except _FAULTS as error:  # a value of a type or in a place that no run writes
        return Contradiction("the summary", "not of these rows", f"{type(error).__name__}: {error!s:.80}")


def _contradictions(summary: Mapping[str, Any], rows: Sequence[Row]) -> Iterator[Contradiction]:
    sample = _sample(summary)
    yield from _of_rows(summary, rows, sample)
    discards = summary.get("discard") or {}
    if not discards:
        return
    reasons = {c: entry["reason"] or "" for c, entry in discards.items() if entry is not None and "reason" in entry}
    measured = tuple(c for c in COLUMNS if discards.get(c) is not None and c not in reasons)
    stats = SequenceStats(measured, reasons)
    for row in rows:
        stats.add_row(row)
    derived = {"pairs": stats.pairs} | _rates(summary, rows, sample, stats)
    derived |= {"classes": stats.classes(), "camera": _camera(summary, rows)}
    if summary.get("exact"):
        derived["exact"] = exact_summary(rows, reasons, summary["exact"].get("reprojection") or "")
    if "decided_light" in summary:
        derived["decided_light"] = decided_summary(rows)
    yield from _of_histogram(summary, rows, derived)
    yield from _of_curves(summary, rows, derived)
    yield from _differences(summary, derived, "")


def _of_rows(summary: Mapping[str, Any], rows: Sequence[Row], sample: PairSample | None) -> Iterator[Contradiction]:
    """Which pairs the rows are of."""
    settings = summary.get("settings") or {}
    first, fps, spp = settings.get("first_frame"), settings.get("fps"), settings.get("samples_per_pixel")
    size = settings.get("width"), settings.get("height")
    frames = [row["frame"] for row in rows]
    if sample is not None and first is not None:
        expected = [first + position + 1 for position in sample.positions]
        for number, (frame, expected_values) in enumerate(zip(frames, expected), start=2):
            if frame != expected_values:
                yield Contradiction(f"frame in line {number}", frame, expected_values, in_rows=True)
        if len(frames) != len(expected):
            yield Contradiction("the number of rows", len(frames), len(expected), in_rows=True)
    pixels = None if None in size else size[0] * size[1] * (spp or 1)
    cuts = (summary.get("camera") or {}).get("cuts")
    for number, row in enumerate(rows, start=2):
        expected_values = {"pixels": pixels}
        expected_values |= {} if fps is None else {"time_s": row["frame"] / fps}
        expected_values |= {} if cuts is None else {"camera_cut": int(row["frame"] in cuts)}
        expected_values["frustum"] = row["behind"] + row["outside"]
        for name, value in expected_values.items():
            if value is not None and (row[name] is None or not _close(row[name], value)):
                yield Contradiction(f"{name} in line {number}", row[name], value, in_rows=True)


def _sample(summary: Mapping[str, Any]) -> PairSample | None:
    """The pairs that a run evaluates; None where its settings do not say."""
    settings = summary.get("settings") or {}
    first, last = settings.get("first_frame"), settings.get("last_frame")
    return None if first is None or last is None else sample_pairs(max(last - first, 0), *_scheme(summary))


def _scheme(summary: Mapping[str, Any]) -> tuple[str, int]:
    return scheme_of((summary.get("settings") or {}).get("pairs") or "all")


def _rates(
    summary: Mapping[str, Any], rows: Sequence[Row], sample: PairSample | None, stats: SequenceStats
) -> dict[str, Any]:
    """The blocks ``reusable``, ``discard`` and ``sampling`` from rows, without what needs reasons or distances."""
    mode = (summary.get("reusable") or {}).get("reprojection")
    cuts = np.array([bool(row["camera_cut"]) for row in rows], dtype=bool)
    if _scheme(summary) == ("all", 1):
        sample = None
    rates = stats.rates(mode, cuts, sample)
    _without_estimates(summary, rates)
    for key in ("reasons_of", "reasons", "color_only"):
        del rates["reusable"][key]
    return rates


def _without_estimates(summary: Mapping[str, Any], derived: dict[str, Any]) -> None:
    """Of shares that are estimated at sampled pixels, keep what the rows tell: the preview's share."""
    for block in ("discard", "reusable"):
        for name, entry in (summary.get(block) or {}).items():
            if isinstance(entry, Mapping) and entry.get("method") == SAMPLED and derived[block].get(name):
                derived[block][name] = {"preview_percent": derived[block][name]["mean_percent"]}


def _of_histogram(summary: Mapping[str, Any], rows: Sequence[Row], derived: dict[str, Any]) -> Iterator[Contradiction]:
    """The mask histogram against the rows; adds what follows from it to ``derived``."""
    recorded = summary.get("mask_histogram") or {}
    if recorded.get("words") is None or recorded.get("pixels") is None:
        return
    whole = np.zeros(MASK_WORDS, dtype=np.int64)
    for word, pixels in zip(recorded["words"], recorded["pixels"], strict=True):
        whole[word] += pixels
    for name, pixels in counts_of(whole).items():
        values = [row[name] for row in rows]
        if None not in values and sum(values) != pixels:
            yield Contradiction(f"mask_histogram: pixels of {name}", pixels, sum(values))
    unmeasured = [c for c in COLUMNS if derived["discard"][c].get("mean_percent", 0.0) is None]
    reuse = ReuseStats(dict.fromkeys(unmeasured, ""))
    if rows:
        reuse.add(whole)
    block = reuse.block("", np.zeros(min(len(rows), 1), dtype=bool))
    shares = {key: block[key] for key in ("reasons_of", "reasons", "color_only")}
    if "sampled_light" in summary:
        shares["reasons"] = {
            name: {"preview_percent": entry["mean_percent"], "pixels": entry["pixels"]}
            for name, entry in block["reasons"].items()
        }
        color = block["color_only"]
        shares["color_only"] = color and {"preview_percent": color["mean_percent"], "pixels": color["pixels"]}
    if "sampling" in summary:  # pairs have weights, which are not in the sum of their histograms
        shares["reasons"] = {name: {"pixels": entry["pixels"]} for name, entry in block["reasons"].items()}
        shares["color_only"] = block["color_only"] and {"pixels": block["color_only"]["pixels"]}
    derived["reusable"] |= shares


def _of_curves(summary: Mapping[str, Any], rows: Sequence[Row], derived: dict[str, Any]) -> Iterator[Contradiction]:
    """The curves against the rows; adds the shares at other exposures, which follow from them, to ``derived``."""
    settings = summary.get("settings") or {}
    thresholds, scale = settings.get("thresholds") or {}, settings.get("unit_scale") or 1.0
    curves = {
        name: curve
        for name, curve in (summary.get("curves") or {}).items()
        if (curve or {}).get("counts") and curve.get("method") != SAMPLED
    }
    derived_curves: dict[str, Any] = {}
    comparable = sum(row["comparable"] for row in rows)
    for name, curve in curves.items():
        counts, bounds = np.array(curve["counts"]), edges() / (scale if name == "position" else 1.0)
        above = discarded_above(counts)
        counts[0] = comparable - counts[1:].sum()
        derived_curves[name] = {"edges": bounds.tolist(), "counts": counts.tolist(), "comparable": comparable}
        derived_curves[name]["at_or_above"] = above.tolist()
        if (limit := thresholds.get(name)) is None:
            continue
        tails = np.array([comparable, *above, 0])
        least = tails[1 + np.searchsorted(bounds, limit * (1 + 1e-6))]
        most = tails[np.searchsorted(bounds, limit * (1 - 1e-6))]
        column = sum(row[name] for row in rows)
        if not least <= column <= most:
            yield Contradiction(f"curves.{name}.counts: pixels above the threshold", f"{least} to {most}", column)
    yield from _differences(summary, {"curves": derived_curves}, "")
    if all(name in thresholds for name in curves):
        pixels = sum(row["pixels"] for row in rows)
        for column, shares in sensitivity(curves, thresholds, pixels).items():
            if "preview_percent" not in derived["discard"][column]:
                derived["discard"][column] |= shares


def _camera(summary: Mapping[str, Any], rows: Sequence[Row]) -> dict[str, Any]:
    """The block ``camera`` of a run of all pairs; near the gimbal zone angles depend on frames before the pair."""
    recorded = summary.get("camera") or {}
    if _scheme(summary) != ("all", 1) or any(row[name] is None for row in rows for name in CAMERA_COLUMNS):
        return {}
    cut = np.array([bool(row["camera_cut"]) for row in rows], dtype=bool)
    out: dict[str, Any] = {"samples": len(rows), "gimbal_pairs": [row["frame"] for row in rows if row["gimbal"]]}
    angles = ("yaw", "pitch", "roll") if recorded.get("gimbal_pairs") else ()
    for name, column in zip(QUANTITIES, CAMERA_COLUMNS, strict=True):
        values = np.array([row[column] for row in rows], dtype=np.float64)
        if name not in angles:
            out[name] = describe(values) | {"without_cuts": describe(values[~cut])}
    return out


def _differences(recorded: Any, derived: Any, at: str) -> Iterator[Contradiction]:
    """Where ``recorded`` differs from the tree ``derived``; texts that are no keys are not compared."""
    if isinstance(derived, dict):
        if recorded is None:
            return
        for key, value in derived.items():
            if key in recorded and key not in ("reason", "reprojection"):
                yield from _differences(recorded[key], value, f"{at}.{key}".removeprefix("."))
        for key in recorded.keys() - derived.keys() if at in ("reusable", "reusable.reasons") else ():
            yield Contradiction(f"{at}.{key}", recorded[key], "no such key")
    elif isinstance(derived, list):
        if len(recorded) != len(derived):
            yield Contradiction(f"the length of {at}", len(recorded), len(derived))
        for index, (recorded_value, derived_value) in enumerate(zip(recorded, derived)):
            yield from _differences(recorded_value, derived_value, f"{at}[{index}]")
    elif isinstance(derived, str) or derived is None or recorded is None:
        if recorded != derived:
            yield Contradiction(at, recorded, derived)
    elif not _close(recorded, derived, _CAMERA_TOLERANCE if at.startswith("camera.") else TOLERANCE):
        yield Contradiction(at, recorded, derived)


def _close(a: float, b: float, tolerance: float = TOLERANCE) -> bool:
    return math.isclose(a, b, rel_tol=tolerance, abs_tol=tolerance)


def _short(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) else "null" if value is None else f"{value!s:.60}"
