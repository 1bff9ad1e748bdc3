"""The page of a cost study: templates/cost.html with cost.js; the tables are below the figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taubench_gl.report.page import render_page
from taubench_gl.report.palette import hex_of
from taubench_gl.report.study_tables import grids_html, heading

Study = Mapping[str, Any]

METHOD_COLOR, WORST_COLOR = "#7f7f7f", "#9e9e9e"


def study_html(study: Study) -> str:
    """The page, for study.json's values (schema ``taubench-gl/cost/1``)."""
    title, *about = heading(study)
    methods = (study["quality"] or {}).get("recommendations", ())
    return render_page(
        "cost.html",
        styles=("cost.css",),
        scripts=("cost.js",),
        data=_for_script(study),
        title=title,
        about=about,
        chosen=study["chosen"] and study["chosen"]["words"],
        recommendations=[
            *(r["words"] for r in study["recommendations"]),
            *(f"reuse methods, {words}" for words in methods),
        ],
        tables=grids_html(study, scroll=True),
    )


def _for_script(study: Study) -> dict[str, Any]:
    """What the figure needs."""
    kept = ("columns", "fronts", "front_columns", "reference")
    fields = ("name", "label", "role", "ms", "clock", "against_base", "features", "passes", "bytes")
    points = []
    for p in study["points"]:
        columns = {c: {k: v for k, v in p["columns"][c].items() if k != "reason"} for c in study["columns"]}
        for name in study["fronts"].keys() - set(study["columns"]):  # a front of several columns: their worst error
            columns[name] = {"error": p["worst"]["error"], "worst": p["worst"]["column"], "half_width": None}
        points.append({k: p[k] for k in fields} | {"columns": columns})
    told = {k: study[k] for k in kept} | {"colors": {c: hex_of(c) for c in study["columns"]}, "measures": []}
    told["colors"] |= dict.fromkeys(study["fronts"].keys() - set(study["columns"]), WORST_COLOR)
    quality = study["quality"]
    if quality is not None:  # measures stand beside the columns in the chooser, with marks of their own
        told["measures"] = list(quality["measures"])
        told["fronts"] = {**study["fronts"], **quality["fronts"]}
        told["colors"] |= dict.fromkeys(quality["measures"], METHOD_COLOR)
        points += [_method(p) for p in quality["points"]]
    return told | {"points": points}


def _method(p: Study) -> dict[str, Any]:
    columns = {m: {"error": e, "half_width": None} for m, e in p["errors"].items()}
    passes = {} if p["ms"] is None else {"shading": p["shading_ms"], "method": p["method_ms"]}
    kept = {k: p[k] for k in ("name", "label", "role", "ms", "clock", "against_base", "bytes")}
    return kept | {"columns": columns, "features": {}, "passes": passes}
