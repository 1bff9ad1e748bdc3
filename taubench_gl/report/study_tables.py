"""A cost study as tables: text, Markdown and CSV.  Takes study.json's values (schema ``taubench-gl/cost/1``)."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from taubench_gl.report.study_grid import NONE, Grid, ms_text, ratio_text, three
from taubench_gl.report.study_methods import method_grids

Study = Mapping[str, Any]

FEATURES = {
    "position_mm": ("position", "mm"),
    "normal_deg": ("normal", "°"),
    "motion_px": ("motion", "px"),
    "direct_percent": ("direct", "%"),
    "indirect_percent": ("indirect", "%"),
    "color_levels": ("color", "levels"),
}


def heading(study: Study) -> list[str]:
    """What every figure is printed with: scene, size, rate, pairs, reference, machine, clock."""
    width, height = study["size"]
    machine, reference = study["machine"], study["reference"]
    told = (
        f"{study['scene']['name']}: {width}x{height}, {study['fps']:g} fps, {study['pairs']} pairs, {study['camera']}"
    )
    lines = [f"What accuracy costs: {told}"]
    if reference["kind"] == "best":
        best = next(p for p in study["points"] if p["name"] == reference["name"])
        dials = ", ".join(f"{name} {value}" for name, value in best["choice"].items())
        lines.append(f"reference: every dial at its best ({dials or 'none was turned'})")
    else:
        lines.append(f"reference: {reference['name']} ({reference['path']})")
    floors = {c: reference["floor"][c] for c in study["columns"]}
    known = [f"{c} {f['points']:.3g}" for c, f in floors.items() if f["points"] is not None]
    unknown = sorted({f["reason"] for f in floors.values() if f["points"] is None})
    lines.append(f"its noise floor, points: {', '.join(known) or 'unknown'}{''.join('; ' + u for u in unknown)}")
    cpu = f"{machine['processor']}, {machine['cores']} cores"
    load = "" if study["load"] is None else f", load {study['load']:.1f} (median; this study alone is about 1)"
    lines.append(f"machine: {machine['renderer']}, {machine['driver']}, {cpu}{load}")
    lines.append(f"clock: frames by {study['clock']}; passes by {study['pass_clock']}")
    return lines


def error_text(entry: Mapping[str, Any]) -> str:
    """Points; of a sampled run with the half width of its interval."""
    if entry["points"] is None:
        return NONE
    return _points(abs(entry["points"]), entry["half_width"])


def _points(value: float, half: float | None) -> str:
    text = "0" if value < 5e-10 else "<0.001" if value < 5e-4 else f"{value:.3f}"
    return text if half is None else f"{text} (±{half:.2f})"


def grids(study: Study) -> list[Grid]:
    """All tables of the study, in reading order."""
    points = {p["name"]: p for p in study["points"]}
    out = [_front(study, points, name) for name in study["front_columns"]]
    asked = [p for p in study["points"] if p["role"] != "question"]
    out.append(_errors(study, asked))
    out.append(_features(asked))
    out += [grid for grid in (_questions(study),) if grid is not None]
    out.append(_passes(asked))
    return out + method_grids(study)


def front_errors(study: Study, name: str, point: Mapping[str, Any]) -> str:
    """What a point on front ``name`` is held to get wrong, a sample never less than its half width; of several columns
    the worst, and which."""
    column = name if name in study["columns"] else point["worst"]["column"]
    entry = point["columns"][column]
    text = _points(entry["error"], entry["half_width"])
    return text if text == "0" or column == name else f"{text}, {column}"


def worst_of(study: Study, name: str) -> str:
    """A front of several columns in words, short enough for a title."""
    columns = study["front_columns"][name]
    return f"worst of {', '.join(columns) if len(columns) < 4 else f'{len(columns)} columns'}"


def _front(study: Study, points: Mapping[str, Any], name: str) -> Grid:
    rows = []
    for p in (points[n] for n in study["fronts"][name]):
        rows.append((p["label"], front_errors(study, name, p), ms_text(p), ratio_text(p)))
    columns = study["front_columns"][name]
    count = sum(
        p["role"] != "question" and all(p["columns"][c]["points"] is not None for c in columns) for p in study["points"]
    )
    if name in study["columns"]:
        percent = study["reference"]["percent"][name]
        title = f"Front of the {name} column: reference {percent:.3f} %, {count} settings measured"
    else:
        title = f"Front of the {worst_of(study, name)}: {count} settings measured"
    notes = ["of a sample (±) the error is at least the half width of its 95 % interval"]
    return Grid(title, ("setting", "error, points", "ms/frame", "against the base"), tuple(rows), tuple(notes))


def _errors(study: Study, points: Sequence[Mapping[str, Any]]) -> Grid:
    rows = []
    for p in points:
        errors = [error_text(p["columns"][c]) for c in study["columns"]]
        size = NONE if p["bytes"] is None else f"{p['bytes'] / 1e6:.1f}"
        rows.append((p["label"], *errors, ms_text(p), ratio_text(p), size))
    notes = (
        "error: |mean - the reference's mean|, percent of w·h; (±): half width of the 95 % interval of a sampled run",
        f"no difference: {study['rule']}",
    )
    return Grid("All settings", ("setting", *study["columns"], "ms/frame", "time", "MB"), tuple(rows), notes)


def _features(points: Sequence[Mapping[str, Any]]) -> Grid:
    there = [f for f in FEATURES if any(f in p["features"] for p in points)]
    rows = []
    for p in points:
        if not p["features"]:
            continue
        cells = [f"{three(e['median'])} / {three(e['p95'])}" if (e := p["features"].get(f)) else NONE for f in there]
        rows.append((p["label"], *cells))
    heads = tuple(f"{FEATURES[f][0]}, {FEATURES[f][1]}" for f in there)
    note = "at pixel centres, of the pixels where both see the same surface; samples and pairs do not change them"
    return Grid("Per-pixel errors, median / 95th percentile", ("setting", *heads), tuple(rows), (note,))


def _questions(study: Study) -> Grid | None:
    asked = [p for p in study["points"] if p["role"] == "question"]
    if not asked:
        return None
    base = next(p for p in study["points"] if p["role"] == "base")
    rows = []
    for p in (base, *asked):
        cells = [NONE if (v := p["columns"][c]["percent"]) is None else f"{v:.3f}" for c in study["columns"]]
        rows.append((p["label"], *cells, ms_text(p), ratio_text(p)))
    note = "these do not approximate the columns above, they define others: percent as measured, not an error"
    heads = ("setting", *(f"{c}, %" for c in study["columns"]), "ms/frame", "time")
    return Grid("Other questions", heads, tuple(rows), (note,))


def _passes(points: Sequence[Mapping[str, Any]]) -> Grid:
    names = list(dict.fromkeys(n for p in points for n in p["passes"]))
    rows = [(p["label"], *(three(p["passes"].get(n, 0.0)) for n in names)) for p in points if p["passes"]]
    return Grid("Milliseconds of a drawn frame by pass, median of the rounds", ("setting", *names), tuple(rows))


def spoken(study: Study) -> list[str]:
    """Recommendations, the check of the chosen one, sanity: what there is to say in words."""
    lines = ["Recommendations:", *(f"  {r['words']}" for r in study["recommendations"])]
    if study["chosen"] is not None:
        lines.append(f"chosen: {study['chosen']['words']}")
    if study["quality"] is not None:
        lines.append("Reuse methods, by their pictures (another quantity than the columns):")
        lines += [f"  {words}" for words in study["quality"]["recommendations"]]
    check = study["check"]
    if check is not None:
        errors = ", ".join(f"{c} {e:.3g}" for c, e in check["errors"].items())
        kept = "kept" if check["errors_kept"] else "NOT KEPT"
        lines.append(f"run again: {errors} points, {check['promised_points']:.3g} promised: {kept}")
        if check["budget_ms"] is not None:
            time = "kept" if check["time_kept"] else "NOT KEPT"
            spread = "" if check["ratio_spread"] is None else f" ± {check['ratio_spread']:.2g}"
            pace = f"{three(check['ms']['median'])} ms/frame, {check['ratio']:.3g}{spread} times the base beside it"
            allowed = f"{check['budget_ms']:g} ms were {check['allowed_ratio']:.3g} times the base of the study"
            lines.append(f"run again: {pace}; {allowed}: {time} (the machine: {check['drift']:.3g}x its time then)")
    faults = [s for s in study["sanity"] if not s["holds"]]
    held = len(study["sanity"]) - len(faults)
    lines.append(f"more exact dials give smaller errors, within noise: {held} of {len(study['sanity'])} series")
    for s in faults:
        lines.append(f"  not {s['knob']} for {s['column']}: {s['words']}")
    if study["skipped"]:
        lines.append("not measured, as it changes nothing here or cannot be had:")
        lines += [f"  {name}: {reason}" for name, reason in study["skipped"].items()]
    return lines


def study_text(study: Study, width: int = 150) -> str:
    """Plain text without colour."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    sink = io.StringIO()
    console = Console(file=sink, width=width, color_system=None, force_terminal=False, force_jupyter=False)
    for line in heading(study):
        console.print(Text(line))
    for grid in grids(study):
        table = Table(title=Text("\n" + grid.title), title_justify="left", box=box.SIMPLE_HEAD)
        for i, head in enumerate(grid.heads):
            table.add_column(Text(head), justify="right" if i else "left", overflow="fold")
        for row in grid.rows:
            table.add_row(*map(Text, row))
        console.print(table)
        for note in grid.notes:
            console.print(Text(f"  {note}"))
    console.print(Text("\n" + "\n".join(spoken(study))))
    return "\n".join(line.rstrip() for line in sink.getvalue().splitlines()) + "\n"


def study_markdown(study: Study) -> str:
    """GitHub-flavoured Markdown."""

    def cell(text: str) -> str:
        return text.replace("\\", "\\\\").replace("|", "\\|").replace("<", "&lt;")

    parts = ["  \n".join(map(cell, heading(study)))]
    for grid in grids(study):
        rows = [grid.heads, ("---", *["---:"] * (len(grid.heads) - 1)), *grid.rows]
        lines = ["| " + " | ".join(row if i == 1 else map(cell, row)) + " |" for i, row in enumerate(rows)]
        parts.append("\n".join([f"**{cell(grid.title)}**", "", *lines, *(f"\n{cell(n)}" for n in grid.notes)]))
    parts.append("\n".join(f"- {cell(line.strip())}" for line in spoken(study)))
    return "\n\n".join(parts) + "\n"


def study_csv(study: Study) -> str:
    """One line per setting and column, all digits: what a spreadsheet or a script wants."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    head = ("setting", "label", "role", "column", "percent", "points", "half_width", "pair_points", "error", "on_front")
    writer.writerow((*head, "ms_median", "ms_spread", "ms_samples", "clock", "bytes", "reason"))
    for p in study["points"]:
        ms = p["ms"] or {"median": "", "spread": "", "samples": ""}
        for column, e in p["columns"].items():
            front = int(p["name"] in study["fronts"].get(column, ()))
            values = [e["percent"], e["points"], e["half_width"], e["pair_points"], e["error"]]
            cells = ["" if v is None else v for v in (*values, front, ms["median"], ms["spread"], ms["samples"])]
            tail = (p["clock"], "" if p["bytes"] is None else p["bytes"], e["reason"] or "")
            writer.writerow((p["name"], p["label"], p["role"], column, *cells, *tail))
        for name in study["fronts"].keys() - set(study["columns"]):  # the worst of several columns
            values = ["", "", "", "", "" if p["worst"]["error"] is None else p["worst"]["error"]]
            cells = (*values, int(p["name"] in study["fronts"][name]), ms["median"], ms["spread"], ms["samples"])
            size = "" if p["bytes"] is None else p["bytes"]
            tail = (p["clock"], size, f"worst column: {p['worst']['column']}" if p["worst"]["column"] else "")
            writer.writerow((p["name"], p["label"], p["role"], name, *("" if c is None else c for c in cells), *tail))
    return out.getvalue()


class StudyView:
    """A study to look at: ``print`` it, or let a notebook show it."""

    def __init__(self, study: Study):
        self.study = study

    def __str__(self) -> str:
        return study_text(self.study)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return grids_html(self.study)


def grids_html(study: Study, scroll: bool = False) -> str:
    """Heading, tables and text as an HTML fragment without scripts or style sheet.

    ``scroll``: each table in a box that scrolls on a narrow screen, without the heading, for a page.
    """
    from markupsafe import Markup

    from taubench_gl.report.page import render

    tables = [
        {"title": g.title, "heads": g.heads, "rows": g.rows, "notes": g.notes, "dim": (), "region": scroll and g.title}
        for g in grids(study)
    ]
    lines = Markup("<p>{}</p>").format
    about = "" if scroll else lines(Markup("<br>").join(heading(study)))
    return Markup("{}{}{}").format(
        about, Markup(render("tables.html", tables=tables)), lines(Markup("<br>").join(spoken(study)))
    )
