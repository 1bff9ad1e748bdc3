"""Tables of the reuse methods of a cost study (block ``quality`` of study.json): another quantity, so apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taubench_gl.report.study_grid import NONE, Grid, ms_text, ratio_text, three

Study = Mapping[str, Any]


def method_grids(study: Study) -> list[Grid]:
    """One front per measure, then all methods.  Empty where the study has none."""
    quality = study["quality"]
    if quality is None:
        return []
    points = {p["name"]: p for p in quality["points"]}
    grids = []
    for measure, doc in quality["measures"].items():
        rows = [
            (p["label"], three(p["errors"][measure]), ms_text(p), ratio_text(p, "no reuse"))
            for p in (points[name] for name in quality["fronts"][measure])
        ]
        heads = ("method", measure, "shading + method, ms/frame", "against no reuse")
        grids.append(Grid(f"Front of the methods' {measure}", heads, tuple(rows), (doc,)))
    return [*grids, _all(quality)]


def _all(quality: Study) -> Grid:
    rows = []
    for p in quality["points"]:
        errors = [NONE if (e := p["errors"][m]) is None else three(e) for m in quality["measures"]]
        parts = [NONE if p[part] is None else three(p[part]) for part in ("shading_ms", "method_ms")]
        size = NONE if p["bytes"] is None else f"{p['bytes'] / 1e6:.2f}"
        rows.append((p["label"], *errors, ms_text(p), ratio_text(p, "no reuse"), *parts, size))
    first = next((p for p in quality["points"] if not p["failed"]), None)
    notes = [] if first is None else [f"errors of pictures against {first['reference']}; clock: {first['clock']}"]
    notes += [f"{p['label']} failed: {p['failed']}" for p in quality["points"] if p["failed"]]
    heads = ("method", *quality["measures"], "ms/frame", "time", "of it shading", "of it method", "MB")
    return Grid("Reuse methods, judged by their pictures", heads, tuple(rows), tuple(notes))
