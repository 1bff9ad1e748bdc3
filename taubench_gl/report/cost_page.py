"""The page of a cost study: templates/cost.html with cost.js; the tables are below the figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taubench_gl.report.cost_tables import heading, tables_html
from taubench_gl.report.page import render_page
from taubench_gl.report.palette import hex_of

Study = Mapping[str, Any]

METHOD_COLOR, WORST_COLOR = "#7f7f7f", "#9e9e9e"


def cost_html(study: Study) -> str:
    """The page, for the values of study.json (schema ``taubench-gl/cost/2``)."""
    title, *about = heading(study)
    methods = (study["methods"] or {}).get("recommendations", ())
    return render_page(
        "cost.html",
        styles=("cost.css",),
        scripts=("cost.js",),
        data=_figure_data(study),
        title=title,
        about=about,
        chosen=study["chosen"] and study["chosen"]["words"],
        recommendations=[
            *(r["words"] for r in study["recommendations"]),
            *(f"reuse methods, {words}" for words in methods),
        ],
        tables=tables_html(study, scroll=True),
    )


def _figure_data(study: Study) -> dict[str, Any]:
    """What the figure needs.  Measures of reuse methods are in the same chooser as the columns."""
    fields = ("name", "label", "role", "ms", "clock", "against_baseline", "features", "passes", "bytes")
    worst = study["fronts"].keys() - set(study["columns"])
    points = []
    for p in study["points"]:
        columns = {c: {k: v for k, v in p["columns"][c].items() if k != "reason"} for c in study["columns"]}
        for name in worst:
            columns[name] = {"error": p["worst"]["error"], "worst": p["worst"]["column"], "half_width": None}
        points.append({k: p[k] for k in fields} | {"columns": columns})
    colors = {c: hex_of(c) for c in study["columns"]} | dict.fromkeys(worst, WORST_COLOR)
    measures, fronts = [], study["fronts"]
    if study["methods"] is not None:
        measures = list(study["methods"]["measures"])
        fronts = fronts | study["methods"]["fronts"]
        colors |= dict.fromkeys(measures, METHOD_COLOR)
        points += [_method(p) for p in study["methods"]["points"]]
    kept = {k: study[k] for k in ("columns", "front_columns", "reference")}
    return kept | {"fronts": fronts, "colors": colors, "measures": measures, "points": points}


def _method(p: Study) -> dict[str, Any]:
    columns = {m: {"error": e, "half_width": None} for m, e in p["errors"].items()}
    passes = {} if p["ms"] is None else {"shading": p["shading_ms"], "method": p["method_ms"]}
    kept = {k: p[k] for k in ("name", "label", "role", "ms", "clock", "against_baseline", "bytes")}
    return kept | {"columns": columns, "features": {}, "passes": passes}
