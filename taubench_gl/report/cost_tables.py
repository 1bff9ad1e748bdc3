"""A cost study as tables: text, Markdown, CSV and HTML.  Takes the values of study.json."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from taubench_gl.report.labels import lighting_text

Study = Mapping[str, Any]
Point = Mapping[str, Any]

NONE = "–"
FEATURES = {
    "position_mm": ("position", "mm"),
    "normal_deg": ("normal", "°"),
    "motion_px": ("motion", "px"),
    "direct_percent": ("direct", "%"),
    "indirect_percent": ("indirect", "%"),
    "color_levels": ("color", "levels"),
}


@dataclass(frozen=True, slots=True)
class Table:
    """Heads (the first is that of the row labels), rows of text, notes below."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def heading(study: Study) -> list[str]:
    """Title, and what every number depends on: reference, machine, clock."""
    width, height = study["size"]
    machine, reference = study["machine"], study["reference"]
    subject = f"{study['scene']['name']}: {width}x{height}, {study['fps']:g} fps, {study['pairs']} pairs"
    lines = [f"Cost study: {subject}, {study['camera']}"]
    lighting = lighting_text({"settings": study.get("lighting") or {}})
    lines += [f"light: {lighting}"] if lighting else []
    if "path" in reference:
        lines.append(f"reference: {reference['name']} ({reference['path']})")
    else:
        highest = next(p for p in study["points"] if p["name"] == reference["name"])
        values = ", ".join(f"{name} {value}" for name, value in highest["values"].items())
        lines.append(f"reference: highest quality ({values or 'the baseline'})")
    floors = {c: reference["floor"][c] for c in study["columns"]}
    known = [f"{c} {f['points']:.3g}" for c, f in floors.items() if f["points"] is not None]
    unknown = sorted({f["reason"] for f in floors.values() if f["points"] is None})
    lines.append(f"noise floor of the reference, pp: {'; '.join([', '.join(known) or 'unknown', *unknown])}")
    load = "" if study["load"] is None else f", load {study['load']:.1f} (median; the study alone is about 1)"
    processor = f"{machine['processor']}, {machine['cores']} cores"
    lines.append(f"machine: {machine['renderer']}, {machine['driver']}, {processor}{load}")
    lines.append(f"clock: frames by {study['clock']}; passes by {study['pass_clock']}")
    return lines


def tables(study: Study) -> list[Table]:
    """All tables, in reading order."""
    comparable = [p for p in study["points"] if p["role"] != "definition"]
    found = [front_table(study, name) for name in study["front_columns"]]
    found += [_configurations(study, comparable), _features(comparable)]
    found += _definitions(study)
    found.append(_passes(comparable))
    return found if study["methods"] is None else found + _methods(study["methods"])


def front_table(study: Study, name: str) -> Table:
    """The Pareto front ``name``, fastest first."""
    points = {p["name"]: p for p in study["points"]}
    front = [points[n] for n in study["fronts"][name]]
    rows = [(p["label"], _front_error(study, name, p), ms_text(p), ratio_text(p)) for p in front]
    if name in study["columns"]:
        title = f"Pareto front of the {name} column (reference: {study['reference']['percent'][name]:.3f} %)"
    else:
        title = f"Pareto front of the {worst_of(study, name)}"
    notes = ("(±): the error of sampled pairs is at least the half width of its 95 % interval",)
    heads = ("configuration", "error, pp", "ms/frame", "against the baseline")
    return Table(title, heads, tuple(rows), notes)


def worst_of(study: Study, name: str) -> str:
    """A front of several columns in words."""
    columns = study["front_columns"][name]
    return f"worst of {', '.join(columns) if len(columns) < 4 else f'{len(columns)} columns'}"


def _front_error(study: Study, name: str, point: Point) -> str:
    """The error that places a point on front ``name``; for several columns the worst and its column."""
    column = name if name in study["columns"] else point["worst"]["column"]
    entry = point["columns"][column]
    text = _error_text(entry["error"], entry["half_width"])
    return text if text == "0" or column == name else f"{text}, {column}"


def _configurations(study: Study, points: Sequence[Point]) -> Table:
    rows = []
    for p in points:
        entries = [p["columns"][c] for c in study["columns"]]
        errors = [NONE if e["points"] is None else _error_text(abs(e["points"]), e["half_width"]) for e in entries]
        rows.append((p["label"], *errors, ms_text(p), ratio_text(p), _megabytes(p, 1)))
    notes = (
        "error: |mean - mean of the reference|, percentage points of w·h; (±): half width of the 95 % interval",
        f"indistinguishable: {study['rule']}",
    )
    heads = ("configuration", *study["columns"], "ms/frame", "against the baseline", "MB")
    return Table("All configurations: error of each column, pp", heads, tuple(rows), notes)


def _features(points: Sequence[Point]) -> Table:
    names = [f for f in FEATURES if any(f in p["features"] for p in points)]
    rows = []
    for p in points:
        if p["features"]:
            found = [p["features"].get(f) for f in names]
            rows.append(
                (p["label"], *(NONE if e is None else f"{three(e['median'])} / {three(e['p95'])}" for e in found))
            )
    heads = ("configuration", *(", ".join(FEATURES[f]) for f in names))
    note = "at pixel centers where both show the same surface; sampled pairs and sub-pixel samples do not change them"
    return Table("Per-pixel errors, median / 95th percentile", heads, tuple(rows), (note,))


def _definitions(study: Study) -> list[Table]:
    points = [p for p in study["points"] if p["role"] == "definition"]
    if not points:
        return []
    baseline = next(p for p in study["points"] if p["role"] == "baseline")
    rows = []
    for p in (baseline, *points):
        percents = [p["columns"][c]["percent"] for c in study["columns"]]
        rows.append((p["label"], *(NONE if v is None else f"{v:.3f}" for v in percents), ms_text(p), ratio_text(p)))
    heads = ("configuration", *(f"{c}, %" for c in study["columns"]), "ms/frame", "against the baseline")
    note = "these change the definition of the metric (not comparable): percent as measured, not an error"
    return [Table("Other definitions of the metric", heads, tuple(rows), (note,))]


def _passes(points: Sequence[Point]) -> Table:
    names = list(dict.fromkeys(n for p in points for n in p["passes"]))
    rows = [(p["label"], *(three(p["passes"].get(n, 0.0)) for n in names)) for p in points if p["passes"]]
    title = "Milliseconds of a drawn frame by pass, median over rounds"
    note = "passes are timed separately, which removes their overlap: they may add up to more than a frame"
    return Table(title, ("configuration", *names), tuple(rows), (note,))


def _methods(block: Study) -> list[Table]:
    """Reuse methods: one front per measure, then all of them."""
    points = {p["name"]: p for p in block["points"]}
    found = []
    for measure, doc in block["measures"].items():
        front = [points[name] for name in block["fronts"][measure]]
        rows = [(p["label"], three(p["errors"][measure]), ms_text(p), ratio_text(p)) for p in front]
        heads = ("method", measure, "shading + method, ms/frame", "against no reuse")
        found.append(Table(f"Pareto front of the methods' {measure}", heads, tuple(rows), (doc,)))
    rows = []
    for p in points.values():
        parts = [NONE if v is None else three(v) for v in (*p["errors"].values(), p["shading_ms"], p["method_ms"])]
        count = len(p["errors"])
        rows.append((p["label"], *parts[:count], ms_text(p), ratio_text(p), *parts[count:], _megabytes(p, 2)))
    first = next((p for p in points.values() if not p["failed"]), None)
    notes = [] if first is None else [f"image errors against {first['reference']}; clock: {first['clock']}"]
    notes += [f"{p['label']} failed: {p['failed']}" for p in points.values() if p["failed"]]
    heads = ("method", *block["measures"], "ms/frame", "against no reuse", "shading, ms", "method, ms", "MB")
    return [*found, Table("Reuse methods, evaluated by their images", heads, tuple(rows), tuple(notes))]


def ms_text(point: Point) -> str:
    """``18.2 ± 0.4``."""
    ms = point["ms"]
    if ms is None:
        return NONE
    return three(ms["median"]) + ("" if ms["spread"] is None else f" ± {ms['spread']:.2g}")


def ratio_text(point: Point) -> str:
    """Time over that of the baseline (of methods: no reuse), in words where they do not differ."""
    against = point["against_baseline"]
    if against is None:
        return NONE
    if point["role"] == "baseline" or against["ratio"] == 1.0:
        return "1x"
    return f"{against['ratio']:.3g}x" if against["different"] else "indistinguishable"


def three(value: float) -> str:
    """Three significant digits without an exponent."""
    if value == 0:
        return "0"
    if abs(value) < 1e-4:
        return "<0.0001" if value > 0 else ">-0.0001"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _error_text(points: float, half_width: float | None) -> str:
    text = "0" if points < 5e-10 else "<0.001" if points < 5e-4 else f"{points:.3f}"
    return text if half_width is None else f"{text} (±{half_width:.2f})"


def _megabytes(point: Point, decimals: int) -> str:
    return NONE if point["bytes"] is None else f"{point['bytes'] / 1e6:.{decimals}f}"


def summary_lines(study: Study) -> list[str]:
    """Recommendations, validation, and parameters that are inapplicable."""
    lines = ["Recommendations:", *(f"  {r['words']}" for r in study["recommendations"])]
    if study["chosen"] is not None:
        lines.append(f"chosen: {study['chosen']['words']}")
    if study["methods"] is not None:
        lines.append("Reuse methods (errors of images, not of columns):")
        lines += [f"  {words}" for words in study["methods"]["recommendations"]]
    if study["validation"] is not None:
        lines += _validation_lines(study["validation"])
    if study["inapplicable"]:
        lines.append("Inapplicable because:")
        lines += [f"  {name}: {reason}" for name, reason in study["inapplicable"].items()]
    return lines


def _validation_lines(found: Study) -> list[str]:
    errors = ", ".join(f"{c} {e:.3g}" for c, e in found["errors"].items())
    verdict = "PASS" if found["errors_pass"] else "FAIL"
    lines = [f"validation, errors: {verdict} ({errors} pp; limit {found['limit_points']:.3g} pp)"]
    if found["budget_ms"] is not None:
        verdict = "PASS" if found["time_pass"] else "FAIL"
        spread = "" if found["ratio_spread"] is None else f" ± {found['ratio_spread']:.2g}"
        limit = f"limit {found['allowed_ratio']:.3g}x: {found['budget_ms']:g} ms"
        drift = f"the baseline takes {found['baseline_drift']:.3g}x its earlier time"
        lines.append(f"validation, time: {verdict} ({found['ratio']:.3g}{spread} times the baseline; {limit}; {drift})")
    return lines


def cost_text(study: Study, width: int = 150) -> str:
    """Plain text without color."""
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    sink = io.StringIO()
    console = Console(file=sink, width=width, color_system=None, force_terminal=False, force_jupyter=False)
    for line in heading(study):
        console.print(Text(line))
    for table in tables(study):
        drawn = RichTable(title=Text("\n" + table.title), title_justify="left", box=box.SIMPLE_HEAD)
        for i, head in enumerate(table.heads):
            drawn.add_column(Text(head), justify="right" if i else "left", overflow="fold")
        for row in table.rows:
            drawn.add_row(*map(Text, row))
        console.print(drawn)
        for note in table.notes:
            console.print(Text(f"  {note}"))
    console.print(Text("\n" + "\n".join(summary_lines(study))))
    return "\n".join(line.rstrip() for line in sink.getvalue().splitlines()) + "\n"


def cost_markdown(study: Study) -> str:
    """GitHub-flavored Markdown."""
    parts = ["  \n".join(map(_cell, heading(study)))]
    parts += [f"**{_cell(table.title)}**\n\n{markdown_table(table)}" for table in tables(study)]
    parts.append("\n".join(f"- {_cell(line.strip())}" for line in summary_lines(study)))
    return "\n\n".join(parts) + "\n"


def markdown_table(table: Table) -> str:
    """Rows and notes, without the title."""
    rows = [tuple(map(_cell, row)) for row in (table.heads, *table.rows)]
    rows.insert(1, ("---", *["---:"] * (len(table.heads) - 1)))
    return "\n".join(["| " + " | ".join(row) + " |" for row in rows] + [f"\n{_cell(note)}" for note in table.notes])


def _cell(text: str) -> str:
    return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")


def cost_csv(study: Study) -> str:
    """One line per configuration and column, and for the worst of several columns; all digits."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    errors = ("percent", "points", "half_width", "pair_points", "error")
    times = ("median", "spread", "samples")
    writer.writerow(("configuration", "label", "role", "column", *errors, "on_front", *(f"ms_{t}" for t in times),
                     "clock", "bytes", "reason"))  # fmt: skip
    worst = study["fronts"].keys() - set(study["columns"])
    for p in study["points"]:
        entries = dict(p["columns"])
        for name in worst:
            column = p["worst"]["column"]
            entries[name] = {"error": p["worst"]["error"], "reason": column and f"worst column: {column}"}
        for column, entry in entries.items():
            on_front = int(p["name"] in study["fronts"].get(column, ()))
            cells = [*(entry.get(e) for e in errors), on_front, *((p["ms"] or {}).get(t) for t in times)]
            row = [p["name"], p["label"], p["role"], column, *cells, p["clock"], p["bytes"], entry.get("reason")]
            writer.writerow("" if cell is None else cell for cell in row)
    return out.getvalue()


class CostView:
    """A study to print, or to show in a notebook."""

    def __init__(self, study: Study):
        self.study = study

    def __str__(self) -> str:
        return cost_text(self.study)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return tables_html(self.study)


def tables_html(study: Study, scroll: bool = False) -> str:
    """Heading, tables and text as an HTML fragment without scripts or style sheet.

    ``scroll``: each table in a box that scrolls on a narrow screen, without the heading, for a page.
    """
    from markupsafe import Markup

    from taubench_gl.report.page import render

    values = [
        {"title": t.title, "heads": t.heads, "rows": t.rows, "notes": t.notes, "dim": (), "region": scroll and t.title}
        for t in tables(study)
    ]
    lines = Markup("<p>{}</p>").format
    about = "" if scroll else lines(Markup("<br>").join(heading(study)))
    text = lines(Markup("<br>").join(summary_lines(study)))
    return Markup("{}{}{}").format(about, Markup(render("tables.html", tables=values)), text)
