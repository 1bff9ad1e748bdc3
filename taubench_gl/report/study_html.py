"""A cost study as one HTML file: the fronts to point at and to walk through with the keyboard, the tables below.

Nothing is loaded from anywhere: data, style and script are in the page.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from importlib import resources
from typing import Any

from taubench_gl.report.palette import hex_of
from taubench_gl.report.study_tables import grids_html, heading

Study = Mapping[str, Any]

METHOD_COLOR, WORST_COLOR = "#7f7f7f", "#9e9e9e"

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"


def study_html(study: Study) -> str:
    """The page, for study.json's values (schema ``taubench-gl/cost/1``)."""
    assets = resources.files(__package__).joinpath("assets")
    style, script = (assets.joinpath(name).read_text(encoding="utf-8") for name in ("study.css", "study.js"))
    data = json.dumps(_for_script(study), allow_nan=False, ensure_ascii=False)
    data = data.replace("<", "\\u003c")  # no name in a file can end the script element
    title, *about = heading(study)
    said = [r["words"] for r in study["recommendations"]]
    said += [f"reuse methods, {words}" for words in (study["quality"] or {}).get("recommendations", ())]
    words = "".join(f"<li>{html.escape(line)}</li>" for line in said)
    chosen = study["chosen"]
    if chosen is not None:
        words = f"<li><strong>{html.escape(chosen['words'])}</strong></li>{words}"
    tables = grids_html(study).replace("<table>", "<div class='wide'><table>").replace("</table>", "</table></div>")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<title>{html.escape(title)}</title>
<style>
{style}</style>
</head>
<body>
<h1>{html.escape(title)}</h1>
<p>{"<br>".join(html.escape(line) for line in about)}</p>
<h2>Error against time</h2>
<div class="controls">
<label for="column">column <select id="column"></select></label>
<span id="roles" class="controls"></span>
</div>
<svg id="plot" viewBox="0 0 1000 520" role="group" aria-label="error against time, one mark per setting"></svg>
<p id="told" aria-live="polite"></p>
<noscript><p>The figure needs scripts; front_*.svg beside this file show the same.</p></noscript>
<h2>Which to use</h2>
<ul>{words}</ul>
<h2>Tables</h2>
{tables}
<script type="application/json" id="study">{data}</script>
<script>
{script}</script>
</body>
</html>
"""


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
