"""The page of a cost study: the answer, one figure (templates/cost.html with cost.js), and the tables below it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taubench_gl.report.cost_tables import OVERALL, answer, heading, tables
from taubench_gl.report.page import render_page
from taubench_gl.report.palette import hex_of
from taubench_gl.report.render import to_html

Study = Mapping[str, Any]

OVERALL_COLOR = "#3b6ea8"


def cost_html(study: Study) -> str:
    """The page, for the values of study.json (schema ``taubench-gl/cost/3``)."""
    return render_page(
        "cost.html",
        styles=("cost.css",),
        scripts=("cost.js",),
        data=_figure_data(study),
        title=f"Cost study: {study['scene']['name']}",
        answer=answer(study),
        about=heading(study),
        tables=to_html(tables(study), scroll=True),
    )


def _figure_data(study: Study) -> dict[str, Any]:
    """What the figure needs."""
    fields = ("name", "label", "role", "ms", "clock", "against_baseline", "bytes", "masks")
    measured = (OVERALL, *study["columns"])
    return {
        "columns": measured,
        "floor": study["reference"]["floor"],
        "chosen": (study["chosen"] or {}).get("configuration"),
        "fronts": study["fronts"],
        "colors": {c: hex_of(c) for c in study["columns"]} | {OVERALL: OVERALL_COLOR},
        "points": [{k: p[k] for k in fields} for p in study["points"] if p["role"] != "effect"],
    }
