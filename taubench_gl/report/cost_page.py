"""The page of a cost study: the answer, one figure (templates/cost.html with cost.js), and the tables below it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taubench_gl.report.cost_tables import OVERALL, answer, heading, method_axis, tables_html
from taubench_gl.report.page import render_page
from taubench_gl.report.palette import hex_of

Study = Mapping[str, Any]

METHOD_COLOR, OVERALL_COLOR = "#7f7f7f", "#3b6ea8"


def cost_html(study: Study) -> str:
    """The page, for the values of study.json (schema ``taubench-gl/cost/3``)."""
    title, *about = heading(study)
    return render_page(
        "cost.html",
        styles=("cost.css",),
        scripts=("cost.js",),
        data=_figure_data(study),
        title=title,
        answer=answer(study),
        about=about,
        tables=tables_html(study, scroll=True),
    )


def _figure_data(study: Study) -> dict[str, Any]:
    """What the figure needs.  Measures of reuse methods are in the same chooser as the columns."""
    fields = ("name", "label", "role", "ms", "clock", "against_baseline", "bytes")
    measured = (OVERALL, *study["columns"])
    points = [{k: p[k] for k in fields} | {"masks": p["masks"]} for p in study["points"] if p["role"] != "effect"]
    colors = {c: hex_of(c) for c in study["columns"]} | {OVERALL: OVERALL_COLOR}
    measures, fronts, label = [], study["fronts"], ""
    if study["methods"] is not None:
        methods, label = method_axis(study["methods"])
        measures = list(study["methods"]["measures"])
        fronts = fronts | study["methods"]["fronts"]
        colors |= dict.fromkeys(measures, METHOD_COLOR)
        points += [_method(p) for p in methods]
    chosen = (study["chosen"] or {}).get("configuration")
    kept = {"columns": measured, "floor": study["reference"]["floor"], "chosen": chosen, "method_axis": label}
    return kept | {"fronts": fronts, "colors": colors, "measures": measures, "points": points}


def _method(p: Study) -> dict[str, Any]:
    kept = {k: p[k] for k in ("name", "label", "role", "ms", "clock", "against_baseline", "bytes")}
    return kept | {"masks": {m: {"percent": e} for m, e in p["errors"].items() if e is not None}}
