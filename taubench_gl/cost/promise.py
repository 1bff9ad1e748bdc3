"""Whether a chosen setting, run again, does what the study said of it.  Plain data, no OpenGL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from taubench_gl.cost.analysis import DIGITS, Choice
from taubench_gl.cost.clock import Time, time_of


def hold_against(
    choice: Choice, base: Time, reference: Mapping[str, float], again: Mapping[str, Any]
) -> dict[str, Any]:
    """The block ``check`` of study.json.

    ``base``: the base's time in the study; ``reference``: percent by column; ``again``: ``percent`` by column,
    ``frame_ms`` and ``base_ms``, milliseconds of the setting and of the base by round, taken in turn.

    Errors are computed anew and must be within the promise: ``within``, or what the study measured.  Milliseconds of
    another hour do not compare, so the budget is taken as a multiple of the base's time then, and held against the
    rounds' ratios to the base now, less their spread.
    """
    point, columns = choice.point, choice.columns
    errors = {c: abs(again["percent"][c] - reference[c]) for c in columns}
    promised = choice.within
    if promised is None:
        promised = max(point.error(c) for c in columns)
    told = {
        "setting": point.name,
        "errors": errors,
        "promised_points": promised,
        "errors_kept": all(round(e - promised, DIGITS) <= 0 for e in errors.values()),
        "ms": asdict(time_of(again["frame_ms"])),
        "drift": time_of(again["base_ms"]).median / base.median,
        "budget_ms": choice.budget_ms,
        "ratio": None,
        "ratio_spread": None,
        "allowed_ratio": None,
        "time_kept": None,
    }
    if choice.budget_ms is not None:
        ratio = against_base(again["frame_ms"], again["base_ms"])
        allowed = choice.budget_ms / base.median
        kept = ratio.median - (ratio.spread or 0.0) <= allowed
        told |= {"ratio": ratio.median, "ratio_spread": ratio.spread, "allowed_ratio": allowed, "time_kept": kept}
    return told


def against_base(times: Sequence[float], base: Sequence[float]) -> Time:
    """Ratios round by round, as a ``Time``: whatever slowed the machine in a round is in both."""
    return time_of([t / b for t, b in zip(times, base, strict=True)])
