"""A cost study in words and tables: text, CSV and HTML.  Takes the values of study.json."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from taubench_gl.outputs import csv_text
from taubench_gl.report.labels import lighting_text
from taubench_gl.report.numerics import recorded

Study = Mapping[str, Any]
Point = Mapping[str, Any]

NONE = "–"
OVERALL = "overall"
ERROR_HEADS = ("% wrong", "discarded", "kept")
"""Of three columns: percent of the pixels with a wrong mask, and of these those discarded and kept wrongly."""

BAR = 24
"""Characters of the longest bar."""


@dataclass(frozen=True, slots=True)
class Table:
    """Heads (the first is that of the row labels), rows of text, notes below."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def answer(study: Study) -> list[str]:
    """Three lines: what to use, against what it was compared, how far the numbers can be trusted."""
    chosen = study["chosen"]
    first = "nothing has been measured yet" if chosen is None else chosen["words"]
    return [f"Use {first}" if chosen and chosen["configuration"] else first, _compared(study), _trust(study)]


def _compared(study: Study) -> str:
    reference, pixels = study["reference"], study["pixels"]
    names = {"path-traced": "path-traced light", "exr": "renders", "highest-quality": "the raster method at its best"}
    samples = f", {reference['samples']} samples per pixel" if reference["samples"] else ""
    where = f"at {pixels['count']} random pixels of {pixels['pairs']} pairs of frames"
    text = f"Reference: {names[reference['kind']]}{samples}, {where}"
    floor = reference["floor"].get(OVERALL)
    if floor is not None:
        before = reference["floor_before"].get(OVERALL)
        series = "" if before is None else f" ({three(before)} % at half the samples)"
        return f"{text}; its noise floor is {three(floor)} %{series}: errors below it are not ranked"
    return f"{text}; its noise is unknown" if reference["kind"] == "exr" else text


def _trust(study: Study) -> str:
    machine, state = study["machine"], study["machine_state"]
    text = f"Machine: {machine['renderer']}, {machine['cores']} cores"
    rounds = max((p["ms"]["samples"] for p in study["points"] if p["ms"]), default=0)
    text += f"; {rounds} rounds"
    if state["other_work"] is not None:
        text += f", other processes took {100.0 * state['other_work']:.0f} % of the CPU time"
    if state["drift"] is not None:
        text += f", the baseline's time changed by {100.0 * state['drift']:.0f} %"
    if state["busy"]:
        text += ": the machine was BUSY"
        text += ", times are too long" if "monotonic" in study["clock"] else f"; clock: {study['clock']}"
    missing = sum(1 for p in study["points"] if not p["ms"] and p["usable"])
    return text + (f"; {missing} configurations are not timed yet: run again to go on" if missing else "")


def heading(study: Study) -> list[str]:
    """What every number depends on: scene, light, machine, clock."""
    width, height = study["size"]
    lines = [
        f"Cost study: {study['scene']['name']}, {width}x{height}, {study['fps']:g} fps, {study['pairs']} pairs, "
        f"{study['camera']}"
    ]
    lighting = lighting_text({"settings": study.get("lighting") or {}})
    lines += [f"light: {lighting}"] if lighting else []
    machine = study["machine"]
    lines.append(f"machine: {machine['renderer']}, {machine['driver']}, {machine['processor']}")
    lines.append(f"clock: {study['clock']}")
    return lines


def tables(study: Study) -> list[Table]:
    """All tables, in reading order; those without rows are left out."""
    found = [_front(study), _configurations(study), _effects(study), _columns(study), _storage(study)]
    return [t for t in (*found, _arithmetic()) if t.rows]


def _front(study: Study) -> Table:
    """The Pareto front, fastest first."""
    column = study["chosen"]["column"] if study["chosen"] else OVERALL
    points = {p["name"]: p for p in study["points"]}
    rows = [_row(points[name], _overall(points[name], column)) for name in study["fronts"][column]]
    heads = ("configuration", *ERROR_HEADS, "ms/frame", "of baseline", "MB")
    return Table(f"Pareto front of the {column} error: nothing measured is as fast and as exact", heads, tuple(rows))


def _row(p: Point, cells: Sequence[str]) -> tuple[str, ...]:
    return (p["label"], *cells, ms_text(p), ratio_text(p), _megabytes(p, 1))


def _overall(p: Point, column: str) -> list[str]:
    """Percent of wrong pixels, discarded wrongly, kept wrongly."""
    e = p["masks"][column]
    return [three(e[k]) for k in ("percent", "false_positive", "false_negative")]


def _error(p: Point, column: str) -> str:
    """``+0.93 -0.3``: false positives and false negatives; 0 where there are none."""
    e = p["masks"].get(column)
    if e is None:
        return NONE
    return f"+{e['false_positive']:.2g} -{e['false_negative']:.2g}" if e["percent"] else "0"


def _configurations(study: Study) -> Table:
    rows = [
        _row(p, (*_overall(p, OVERALL), *(_error(p, c) for c in study["columns"])))
        for p in study["points"]
        if p["masks"] and p["role"] != "effect"
    ]
    notes = (
        "percent of the pixels whose mask differs from the reference's; overall: in any column; columns: + discarded "
        "wrongly, - kept wrongly: their sum is the error, their difference is what is left where they cancel",
        "noise floor of the reference, %: "
        + (", ".join(f"{c} {three(v)}" for c, v in study["reference"]["floor"].items() if v is not None) or "none"),
        f"times (~ marks those that are indistinguishable from the baseline's): {study['rule']}",
    )
    heads = ("configuration", *ERROR_HEADS, *study["columns"], "ms/frame", "of baseline", "MB")
    return Table("All configurations: masks that are wrong", heads, tuple(rows), notes)


def _effects(study: Study) -> Table:
    """One bar for each effect: what it takes, and what the masks lose without it."""
    baseline = next(p for p in study["points"] if p["role"] == "baseline")
    measured = [p for p in study["points"] if p["role"] == "effect" and p["masks"] and p["ms"]]
    if not measured or not baseline["ms"] or not baseline["masks"]:
        return Table("What each effect costs", (), ())
    whole, wrong = baseline["ms"]["median"], baseline["masks"][OVERALL]["percent"]
    taken = [(abs(p["ms"]["median"] - whole), p) for p in measured]
    longest, rows = max(ms for ms, _ in taken) or 1.0, []
    for ms, p in sorted(taken, key=lambda item: -item[0]):
        noise = "" if p["against_baseline"]["different"] else "~"
        change = p["masks"][OVERALL]["percent"] - wrong
        cells = ("█" * round(BAR * ms / longest), f"{noise}{three(p['ms']['median'] - whole)}")
        megabytes = f"{(p['bytes'] - baseline['bytes']) / 1e6:+.1f}"
        rows.append((p["label"], *cells, f"{100.0 * ms / whole:.0f} %", megabytes, f"{change:+.2f}"))
    off = [name for name, e in study["effects"].items() if not e["on"]]
    notes = (
        "change of time, memory and overall error against the baseline; ~ within the noise of the times",
        f"not called for by this scene and absent from its frames, unless every effect is on: {', '.join(off)}",
    )
    heads = ("baseline", "change", "ms/frame", "of the frame", "MB", "wrong masks, points")
    return Table("What each effect costs", heads, tuple(rows), notes)


def _columns(study: Study) -> Table:
    """Signed column differences: parameters of other pixels, pairs or metrics, which have no mask error."""
    rows = []
    for p in study["points"]:
        if p["role"] == "grid" and p["columns"]:
            cells = [_difference(p["columns"][c]) for c in study["columns"]]
            rows.append((p["label"], *cells, ms_text(p), ratio_text(p)))
    heads = ("configuration", *study["columns"], "ms/frame", "of baseline")
    notes = (
        "points: the column's mean less the baseline's, ± half the 95 % interval; wrong and missing discards cancel",
    )
    return Table("Other pixels, other pairs: difference of each column", heads, tuple(rows), notes)


def _difference(d: Mapping[str, Any]) -> str:
    if d["points"] is None:
        return NONE
    return f"{d['points']:+.2f}" + ("" if d["half_width"] is None else f" ± {d['half_width']:.2f}")


def _storage(study: Study) -> Table:
    """Half floats, 32-bit floats and float64: the same settings but for the numbers."""
    rows = [
        ("32-bit floats" if p["role"] == "baseline" else p["label"], *_row(p, _overall(p, OVERALL))[1:])
        for p in study["points"]
        if p["masks"] and (p["role"] == "baseline" or set(p["values"]) == {"storage"})
    ]
    heads = (
        "channels",
        *(f"{c}, % wrong" for c in (OVERALL, *study["columns"])),
        "ms/frame",
        "of baseline",
        "MB",
    )
    note = "float64 masks are computed on the CPU and not timed"
    return Table("Numerics: storage of channels", heads, tuple(rows) if len(rows) > 1 else (), (note,))


def _arithmetic() -> Table:
    """What the renderer's arithmetic avoids on the hard cases, as recorded: no variant without it is in the package."""
    found = recorded()
    rows = [
        (r["rule"], three(r["error_without"]), three(r["error"]), three(r["tolerance"]), r["what"])
        for r in found["rows"]
    ]
    notes = (
        f"recorded {found['date']} on {found['renderer']}, {found['driver']} (tools/make_numerics.py)",
        "errors are in the unit of their case: pixels, relative errors or percentage points",
    )
    heads = ("rule", "error without it", "with it", "allowed", "hard case")
    return Table("Numerics: the error that each rule avoids on the hard cases", heads, tuple(rows), notes)


def ms_text(point: Point) -> str:
    """``18.2 ± 0.4``."""
    ms = point["ms"]
    if ms is None:
        return NONE
    return three(ms["median"]) + ("" if ms["spread"] is None else f" ± {ms['spread']:.2g}")


def ratio_text(point: Point) -> str:
    """Time over that of the baseline; ``~`` where they are indistinguishable."""
    against = point["against_baseline"]
    if against is None:
        return NONE
    if point["role"] == "baseline" or against["ratio"] == 1.0:
        return "1x"
    return f"{'' if against['different'] else '~'}{against['ratio']:.3g}x"


def three(value: float) -> str:
    """Three significant digits without an exponent."""
    if value == 0:
        return "0"
    if abs(value) < 1e-4:
        return "<0.0001" if value > 0 else ">-0.0001"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _megabytes(point: Point, decimals: int) -> str:
    return NONE if point["bytes"] is None else f"{point['bytes'] / 1e6:.{decimals}f}"


def cost_text(study: Study, width: int = 150) -> str:
    """Plain text without color: the answer, then everything else."""
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    sink = io.StringIO()
    console = Console(file=sink, width=width, color_system=None, force_terminal=False, force_jupyter=False)
    for line in (*answer(study), "", *heading(study)):
        console.print(Text(line), soft_wrap=True)
    for table in tables(study):
        drawn = RichTable(title=Text("\n" + table.title), title_justify="left", box=box.SIMPLE_HEAD)
        for i, head in enumerate(table.heads):
            drawn.add_column(Text(head), justify="right" if i else "left", overflow="fold")
        for row in table.rows:
            drawn.add_row(*map(Text, row))
        console.print(drawn)
        for note in table.notes:
            console.print(Text(f"  {note}"))
    if study["inapplicable"]:
        console.print(Text("\n" + "\n".join(f"not measured, {n}: {why}" for n, why in study["inapplicable"].items())))
    return "\n".join(line.rstrip() for line in sink.getvalue().splitlines()) + "\n"


def cost_csv(study: Study) -> str:
    """One line per configuration and column; all digits."""
    masks, columns, times = (
        ("percent", "false_positive", "false_negative", "points"),
        ("percent", "points", "half_width"),
        ("median", "spread", "samples"),
    )
    head = (
        "configuration",
        "label",
        "role",
        "column",
        *(f"wrong_{m}" for m in masks),
        *(f"column_{c}" for c in columns),
        "on_front",
    )
    out: list[Sequence[Any]] = [(*head, *(f"ms_{t}" for t in times), "clock", "bytes")]
    for p in study["points"]:
        for column in (OVERALL, *study["columns"]):
            found, difference = p["masks"].get(column, {}), p["columns"].get(column, {})
            cells = [*(found.get(m) for m in masks), *(difference.get(c) for c in columns)]
            cells += [int(p["name"] in study["fronts"][column]), *((p["ms"] or {}).get(t) for t in times)]
            out.append([p["name"], p["label"], p["role"], column, *cells, p["clock"], p["bytes"]])
    return csv_text(out)


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
    """The answer and the tables as an HTML fragment without scripts or style sheet.

    ``scroll``: each table in a box that scrolls on a narrow screen, without the answer, for a page.
    """
    from markupsafe import Markup

    from taubench_gl.report.page import render

    values = [
        {"title": t.title, "heads": t.heads, "rows": t.rows, "notes": t.notes, "dim": (), "region": scroll and t.title}
        for t in tables(study)
    ]
    about = "" if scroll else Markup("<p>{}</p>").format(Markup("<br>").join([*answer(study), *heading(study)]))
    return Markup("{}{}").format(about, Markup(render("tables.html", tables=values)))
