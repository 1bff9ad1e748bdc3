"""Tables of methods that sample lights: what their reservoirs keep, and what it costs (docs/reuse-evaluation.md)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from taubench_gl.report.table import Column, Row, Table

Summary = Mapping[str, Any]

MAPS = (
    "Light kept: a color for each light, dark where it does not reach the pixel. History kept: green rightly kept, red "
    "wrongly kept, gray rightly rejected, blue wrongly rejected."
)
"""Explanation of the images of reservoirs for readers of the page."""

_SAMPLES = {
    "shadow_rays": Column("rays", "", 2), "light_samples": Column("light samples", "", 2),
    "evaluations": Column("evaluations", "", 2), "duplicates_percent": Column("duplicates", "%", 2),
    "repeated_percent": Column("repeated", "%", 2), "pixel_correlation": Column("correlation, pixels", "", 3),
    "frame_correlation": Column("correlation, frames", "", 3),
}  # fmt: skip
_BIAS = {
    "mean": Column("bias", "", 6), "low": Column("low", "", 6), "high": Column("high", "", 6),
    "percent": Column("of the light", "%", 2), "brighter_seeds": Column("brighter seeds"),
    "sign_test_p": Column("p (signs)", "", 4),
}  # fmt: skip
_BORN = {"found_percent": Column("new light found", "%", 1), "frames": Column("after", "frames", 2)}
_HISTORY = {
    "kept": Column("kept"), "wrong_kept_percent": Column("of it, light gone", "%", 2),
    "rejected": Column("rejected"), "wrong_rejected_percent": Column("of it, light there", "%", 2),
}  # fmt: skip

_MEANS = {
    "shadow_rays": Column("rays", "", 2), "evaluations": Column("evaluations", "", 2),
    "bias": Column("bias", "%", 2), "wrong_kept_percent": Column("kept, light gone", "%", 2),
    "wrong_rejected_percent": Column("rejected, light there", "%", 1),
    "duplicates_percent": Column("duplicates", "%", 1),
    "repeated_percent": Column("repeated", "%", 1), "frame_correlation": Column("correlation, frames", "", 3),
}  # fmt: skip


def sample_tables(evaluated: Mapping[str, Summary], reasons: Mapping[str, str]) -> list[Table]:
    """Tables 8 to 10 of a reuse evaluation: cost and errors of light samples, and history reservoirs by reason.

    None where none of the ``evaluated`` methods (label -> block of reuse.json) samples lights.  ``reasons``: what each
    reason means.
    """
    methods = {label: m["samples"] for label, m in evaluated.items() if m.get("samples")}
    if not methods:
        return []
    merged = {label: (samples["per_pixel"] or {}) | samples["born"] | samples for label, samples in methods.items()}
    named = _SAMPLES | _BORN
    rows = tuple(Row(label, tuple(values.get(name) for name in named)) for label, values in merged.items())
    note = (
        "Rays, light samples and evaluations of reflected light: per pixel, all passes of a frame. Duplicates: pairs "
        "of pixels at most two apart that hold equal samples; repeated: pixels that hold the sample of their history. "
        "Correlation: of errors of luminance, next pixels and along the motion. New light: pixels that get a quarter "
        "of their light or more from a lamp that was switched on, whose reservoir came to hold it, and after how many "
        "frames (0: in the first)."
    )
    tables = [Table(8, "Light samples", tuple(named.values()), rows, (note,))]
    merged = {label: samples | (samples["bias"] or {}) for label, samples in methods.items()}
    rows = tuple(Row(label, tuple(values.get(name) for name in _BIAS)) for label, values in merged.items())
    note = (
        "Mean error of luminance against the reference, whose noise is part of it; interval over seeds from five on; "
        "seeds whose mean is above that of the reference, and the p-value of their number."
    )
    tables.append(Table(9, "Bias of luminance", tuple(_BIAS.values()), rows, (note,)))
    histories = {label: samples["history"] for label, samples in methods.items() if samples["history"]}
    rows = [
        Row(f"{label}, {name.replace('_', ' ')}", tuple(entry[column] for column in _HISTORY))
        for label, history in histories.items()
        for name, entry in history.items()
        if entry["kept"] or entry["rejected"]
    ]
    meaning = "; ".join(f"{name.replace('_', ' ')}: {doc}" for name, doc in reasons.items())
    note = (
        "Reservoirs of the previous frame that hold a light, by why their history may be wrong: kept or rejected by "
        f"the method, and whether that light reaches the pixel in this frame, by a shadow ray. {meaning}."
    )
    return tables + ([Table(10, "History reservoirs", tuple(_HISTORY.values()), tuple(rows), (note,))] if rows else [])


def mean_samples(summary: Summary) -> Table:
    """The table of a benchmark of what methods that sample lights keep and cost, means over their cases."""
    values: dict[str, dict[str, list[float]]] = {}
    for label, method in summary["methods"].items():
        for cell in method["cases"].values():
            if samples := cell.get("samples"):
                history = (samples["history"] or {"all": {}})["all"]
                bias = (samples["bias"] or {}).get("percent")
                size = {"bias": None if bias is None else abs(bias)}
                merged = {**history, **samples, **samples["per_pixel"], **size}
                for name in _MEANS:
                    if (value := merged.get(name)) is not None:
                        values.setdefault(label, {}).setdefault(name, []).append(value)
    rows = [Row(n, tuple(float(np.mean(v[c])) if c in v else None for c in _MEANS)) for n, v in values.items()]
    note = "Definitions: docs/reuse-evaluation.md, Light samples. Bias: mean of the absolute values of the cases."
    return Table(0, "Light samples: means over the cases", tuple(_MEANS.values()), tuple(rows), (note,))
