"""A cost study in words, tables, a plot and a page.  Takes the values of study.json (schema ``taubench-gl/cost/3``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

from markupsafe import Markup

from taubench_gl.data_files import read_json
from taubench_gl.option_groups import OVERALL
from taubench_gl.outputs import csv_text
from taubench_gl.report.labels import lighting_text
from taubench_gl.report.page import Page, tag, text_lines
from taubench_gl.report.palette import hex_of
from taubench_gl.report.plot import Plot
from taubench_gl.report.table import NONE, Column, Row, Table, TablesView, to_html, to_text

Study = Mapping[str, Any]
Point = Mapping[str, Any]

ERROR_HEADS = ("% wrong", "discarded", "kept")
"""Of three columns: percent of the pixels with a wrong mask, and of these those discarded and kept wrongly."""

NUMERICS = Path(__file__).with_name("numerics.json")
"""By tools/record numerics: ``renderer``, ``driver``, ``date``; ``rows``: rule, case, error with it and without."""

BAR = 24
"""Characters of the longest bar."""

WIDTH = 150
"""Characters of a line of text."""


def answer(study: Study) -> list[str]:
    """Three lines: what to use, against what it was compared, how far the numbers can be trusted."""
    return [_recommendation(study), _compared(study), _trust(study)]


def _recommendation(study: Study) -> str:
    """``Use balanced: 1.2 % of the masks are wrong, 41 ms/frame; the fastest with at most 1.8 %; 2.1x the time
    (accurate) leaves 0.9 %; ...``."""
    recommended, points = study["chosen"] or {}, {p["name"]: p for p in study["points"]}
    best, faster, finer = (points.get(recommended.get(role)) for role in ("configuration", "faster", "finer"))
    column = recommended.get("column", OVERALL)

    def wrong(p: Point, of: str = column) -> str:
        return f"{three(p['masks'][of]['percent'])} %"

    if best is None and faster is None:
        return "nothing has been measured yet"
    if best is None:
        ends = f"the fastest is {faster['label']}, {ms_text(faster)} ms/frame"
        return f"no configuration meets the limits; {ends}; the most exact is {finer['label']}, {wrong(finer)}"
    words = f"Use {best['label']}: {wrong(best)} of the masks are wrong"
    worst = max(study["columns"], key=lambda c: best["masks"][c]["percent"])
    if column == OVERALL and best["masks"][worst]["percent"]:
        changes = f"{best['masks'][worst]['points']:+.2f} points"
        words += f" (most in {worst}: {wrong(best, worst)}, which changes that column by {changes})"
    words += f", {ms_text(best)} ms/frame"
    enough = recommended.get("good_enough")
    if enough and best["masks"][column]["percent"] <= enough:
        words += f"; the fastest with at most {three(enough)} %"
    for p in filter(None, (finer, faster)):
        words += f"; {p['ms']['median'] / best['ms']['median']:.2g}x the time ({p['label']}) leaves {wrong(p)}"
    words += "" if finer else "; nothing measured is more exact beyond noise"
    floor = study["reference"]["floor"].get(column) or 0.0
    if floor and best["masks"][column]["percent"] <= floor:
        words += "; below the noise floor of the reference: --time-limit or --reference path-traced@M would tell more"
    return words


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
        text += f", times changed by {100.0 * state['drift']:.0f} %"
    if state["busy"]:
        text += ": the machine was BUSY"
        text += ", times are too long" if "monotonic" in study["clock"] else f"; clock: {study['clock']}"
    missing = sum(1 for p in study["points"] if not p["ms"] and p["usable"])
    if missing:
        text += f"; {missing} configuration{'s are' if missing > 1 else ' is'} not timed yet: run again to go on"
    return text


def heading(study: Study) -> list[str]:
    """What every number depends on: scene, light, machine, clock."""
    width, height = study["size"]
    lighting = lighting_text({"settings": study.get("lighting") or {}})
    machine = study["machine"]
    return [
        f"Cost study: {study['scene']['name']}, {width}x{height}, {study['fps']:g} fps, {study['pairs']} pairs, "
        f"{study['camera']}",
        *([f"light: {lighting}"] if lighting else []),
        f"machine: {machine['renderer']}, {machine['driver']}, {machine['processor']}",
        f"clock: {study['clock']}",
    ]


def tables(study: Study) -> list[Table]:
    """All tables, in reading order; those without rows are left out."""
    every = [_front(study), _configurations(study), _effects(study), _columns(study), _storage(study), _arithmetic()]
    return [table for table in every if table.rows]


def _table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]], *notes: str) -> Table:
    """``heads``: without that of the labels, which are first in each row."""
    named = tuple(Row(label, tuple(cells)) for label, *cells in rows)
    return Table("cost", title, tuple(map(Column, heads)), named, notes)


def _front(study: Study) -> Table:
    """The Pareto front, fastest first."""
    column = study["chosen"]["column"] if study["chosen"] else OVERALL
    points = {p["name"]: p for p in study["points"]}
    rows = [_row(points[name], _overall(points[name], column)) for name in study["fronts"][column]]
    title = f"Pareto front of the {column} error: nothing measured is as fast and as exact beyond noise"
    return _table(title, (*ERROR_HEADS, "ms/frame", "of baseline", "MB"), rows)


def _row(p: Point, cells: Sequence[str]) -> tuple[str, ...]:
    return (p["label"], *cells, ms_text(p), ratio_text(p), NONE if p["bytes"] is None else f"{p['bytes'] / 1e6:.1f}")


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


def _errors(study: Study, points: Sequence[Point], title: str, *notes: str) -> Table:
    """Mask errors, overall and by column, and times."""
    heads = (*ERROR_HEADS, *study["columns"], "ms/frame", "of baseline", "MB")
    rows = [_row(p, (*_overall(p, OVERALL), *(_error(p, c) for c in study["columns"]))) for p in points]
    return _table(title, heads, rows, *notes)


def _configurations(study: Study) -> Table:
    floor = ", ".join(f"{c} {three(v)}" for c, v in study["reference"]["floor"].items() if v is not None)
    return _errors(
        study,
        [p for p in study["points"] if p["masks"] and p["role"] != "effect"],
        "All configurations: masks that are wrong",
        "percent of the pixels whose mask differs from the reference's; overall: in any column; columns: + discarded "
        "wrongly, - kept wrongly: their sum is the error, their difference is what is left where they cancel",
        f"noise floor of the reference, %: {floor or 'none'}",
        f"times (~ marks those that are indistinguishable from the baseline's): {study['rule']}",
    )


def _effects(study: Study) -> Table:
    """One bar for each effect: what it takes, and what the masks lose without it."""
    baseline = next(p for p in study["points"] if p["role"] == "baseline")
    measured = [p for p in study["points"] if p["role"] == "effect" and p["masks"] and p["ms"]]
    if not measured or not baseline["ms"] or not baseline["masks"]:
        return _table("What each effect costs", (), ())
    whole, wrong = baseline["ms"]["median"], baseline["masks"][OVERALL]["percent"]
    differences = [(abs(p["ms"]["median"] - whole), p) for p in measured]
    longest, rows = max(ms for ms, _ in differences) or 1.0, []
    for ms, p in sorted(differences, key=lambda item: -item[0]):
        noise = "" if p["against_baseline"]["different"] else "~"
        change = p["masks"][OVERALL]["percent"] - wrong
        cells = ("█" * round(BAR * ms / longest), f"{noise}{three(p['ms']['median'] - whole)}")
        megabytes = f"{(p['bytes'] - baseline['bytes']) / 1e6:+.1f}"
        rows.append((p["label"], *cells, f"{100.0 * ms / whole:.0f} %", megabytes, f"{change:+.2f}"))
    off = [name for name, e in study["effects"].items() if not e["on"]]
    return _table(
        "What each effect costs",
        ("change", "ms/frame", "of the frame", "MB", "wrong masks, points"),
        rows,
        "change of time, memory and overall error against the baseline; ~ within the noise of the times",
        f"not called for by this scene and absent from its frames, unless every effect is on: {', '.join(off)}",
    )


def _columns(study: Study) -> Table:
    """Signed column differences: parameters of other pixels, pairs or metrics, which have no mask error."""
    rows = []
    for p in study["points"]:
        if p["role"] == "grid" and p["columns"]:
            cells = [_difference(p["columns"][c]) for c in study["columns"]]
            rows.append((p["label"], *cells, ms_text(p), ratio_text(p)))
    return _table(
        "Other pixels, other pairs: difference of each column",
        (*study["columns"], "ms/frame", "of baseline"),
        rows,
        "points: the column's mean less the baseline's, ± half the 95 % interval; wrong and missing discards cancel",
    )


def _difference(d: Mapping[str, Any]) -> str:
    if d["points"] is None:
        return NONE
    return f"{d['points']:+.2f}" + ("" if d["half_width"] is None else f" ± {d['half_width']:.2f}")


def _storage(study: Study) -> Table:
    """Half floats, 32-bit floats and float64: the same settings but for the numbers."""
    points = [p for p in study["points"] if p["masks"] and (p["role"] == "baseline" or set(p["values"]) == {"storage"})]
    note = "differ from the baseline in the numbers alone; float64 masks are computed on the CPU and not timed"
    return _errors(study, points if len(points) > 1 else (), "Numerics: storage of channels", note)


def _arithmetic() -> Table:
    """What the renderer's arithmetic avoids on the hard cases, as recorded: no variant without it is in the package."""
    numerics = read_json(NUMERICS)
    rows = tuple(
        Row(
            row["rule"],
            (*(three(row[key]) for key in ("error_without", "error", "tolerance")), ""),
            reasons={3: row["description"]},
        )
        for row in numerics["rows"]
    )
    notes = (
        f"recorded {numerics['date']} on {numerics['renderer']}, {numerics['driver']} (tools/record numerics)",
        "errors are in the unit of their case: pixels, relative errors or percentage points",
    )
    heads = ("error without it", "with it", "allowed", "hard case")
    title = "Numerics: the error that each rule avoids on a hard case"
    return Table("numerics", title, tuple(map(Column, heads)), rows, notes)


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


def cost_text(study: Study) -> str:
    """Plain text without color: the answer, then everything else."""
    left_out = [f"not measured, {name}: {why}" for name, why in study["inapplicable"].items()]
    text = [*answer(study), "", *heading(study), "", to_text(tables(study), WIDTH), *left_out]
    return "\n".join(text).rstrip() + "\n"


def cost_csv(study: Study) -> str:
    """One line per configuration and column; all digits."""
    blocks = {
        "wrong": ("percent", "false_positive", "false_negative", "points"),
        "column": ("percent", "points", "half_width"),
        "ms": ("median", "spread", "samples"),
    }
    heads = [f"{block}_{key}" for block, keys in blocks.items() for key in keys]
    out: list[Sequence[Any]] = [("configuration", "label", "role", "column", "on_front", *heads, "clock", "bytes")]
    for p in study["points"]:
        for column in (OVERALL, *study["columns"]):
            values = {"wrong": p["masks"].get(column), "column": p["columns"].get(column), "ms": p["ms"]}
            cells = [(values[block] or {}).get(key) for block, keys in blocks.items() for key in keys]
            on_front = int(p["name"] in study["fronts"][column])
            out.append([p["name"], p["label"], p["role"], column, on_front, *cells, p["clock"], p["bytes"]])
    return csv_text(out)


class CostView(TablesView):
    """A study to print, or to show in a notebook."""

    def __init__(self, study: Study):
        super().__init__(tables(study))
        self.study = study

    def __str__(self) -> str:
        return cost_text(self.study)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return tag("p", Markup("<br>").join([*answer(self.study), *heading(self.study)])) + super()._repr_html_()


# ---------------------------------------------------------------------------------------------------------------- page

OVERALL_COLOR = "#3b6ea8"


def cost_html(study: Study) -> str:
    """The page: the answer, one figure that cost.js draws, and the tables."""
    first, *more = answer(study)
    words = Markup("<br>").join([tag("strong", first), *more])
    page = Page(
        f"Cost study: {study['scene']['name']}", "cost study", intro=(tag("p", words, class_="answer"),),
        styles=("cost.css",), scripts=("cost.js",), data=_figure_data(study),
    )  # fmt: skip
    column = tag("label", "error ", tag("select", id="column"), for_="column")
    page.add(
        "figure", "Mask error against time", tag("div", id="plot"), tag("p", id="status", aria_live="polite"),
        tag("div", column, tag("span", id="roles", class_="controls"), class_="controls"),
        tag("noscript", tag("p", "The figure needs scripts; the file front.svg shows the same.", class_="missing")),
        link="Figure",
    )  # fmt: skip
    page.add("tables", "Tables", to_html(tables(study), scroll=True), text_lines(heading(study)))
    return page.html()


def _figure_data(study: Study) -> dict[str, Any]:
    """Values of cost.js."""
    fields = ("name", "label", "role", "ms", "clock", "against_baseline", "bytes", "masks")
    return {
        "columns": (OVERALL, *study["columns"]),
        "floor": study["reference"]["floor"],
        "chosen": (study["chosen"] or {}).get("configuration"),
        "fronts": study["fronts"],
        "colors": {c: hex_of(c) for c in study["columns"]} | {OVERALL: OVERALL_COLOR},
        "points": [{k: p[k] for k in fields} for p in study["points"] if p["role"] != "effect"],
    }


# ---------------------------------------------------------------------------------------------------------------- plot

ROLES = {
    "baseline": ("s", "baseline"), "highest_quality": ("*", "highest quality"),
    "single": ("o", "one parameter changed"), "combined": ("^", "several changed"),
    "path_traced": ("D", "path-traced"), "render": ("*", "renders"),
}  # fmt: skip
"""Role -> marker and name."""

NAMED = ("baseline", "highest_quality", "path_traced", "render")


def plot_study(study: Study, folder: Path) -> list[Path]:
    """``front``, the overall error against time, PNG and SVG; none where nothing is timed.  Raises OutputError."""
    floor = study["reference"]["floor"].get(OVERALL) or 0.0
    shown = [p for p in study["points"] if p["role"] in ROLES and p["masks"] and p["ms"]]
    if not shown:
        return []
    positive = [e for e in (floor, *(p["masks"][OVERALL]["percent"] for p in shown)) if e > 0.0]
    bottom = 0.5 * min(positive, default=0.01)  # errors of 0 are drawn here
    places = {p["name"]: (p["ms"]["median"], max(p["masks"][OVERALL]["percent"], bottom)) for p in shown}
    plot = Plot(_title(study), 10.5, 5.4)
    axes = plot.axes
    for role, (marker, name) in ROLES.items():
        if group := [p for p in shown if p["role"] == role]:
            x, y = zip(*(places[p["name"]] for p in group))
            axes.errorbar(
                x, y, xerr=[p["ms"]["spread"] or 0.0 for p in group], fmt=marker, ms=11 if marker == "*" else 6,
                mec="black", mew=0.6, color=OVERALL_COLOR, alpha=0.85, ecolor="#888888", elinewidth=0.9,
                label=name, zorder=3 if role in NAMED else 2,
            )  # fmt: skip
    recommended, front = (study["chosen"] or {}).get("configuration"), study["fronts"][OVERALL]
    if steps := [places[name] for name in front if name in places]:  # only measured configurations are available
        axes.step(*zip(*steps), where="post", color="black", linewidth=1.4, label="Pareto front", zorder=0)
    if recommended in places:
        axes.plot(*places[recommended], "o", ms=16, mfc="none", mec="black", label="recommended")
    if floor:
        axes.axhline(floor, color="#555555", linewidth=0.9, linestyle="--", label="noise floor of the reference")
    axes.set(xscale="log", yscale="log", xlabel="ms per frame", ylabel="wrong masks, % of the pixels")
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        digits = "123456789" if high < 3 * low else "235" if high < 30 * low else "3" if high < 300 * low else ""
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(lambda value, _, digits=digits: f"{value:g}" if f"{value:e}"[0] in digits else "")
    plot.legend(axes)
    named = [p for p in shown if p["role"] in NAMED or p["name"] in front]
    named.sort(key=lambda p: (p["name"] != recommended, p["role"] not in NAMED))
    _write_names(axes, {p["name"]: p["label"] for p in named}, places)
    return plot.save(folder / "front")


def _write_names(axes: Any, labels: Mapping[str, str], places: Mapping[str, tuple[float, float]]) -> None:
    """Names beside their marks, without those that would cover an earlier one."""
    style = {"textcoords": "offset points", "xytext": (6, 6), "fontsize": 7}
    texts = [axes.annotate("\n".join(wrap(label, 36)[:2]), places[name], **style) for name, label in labels.items()]
    axes.figure.canvas.draw()  # texts have their places from now on
    shown_boxes: list[Any] = []
    for text in texts:
        box = text.get_window_extent()
        text.set_visible(not any(box.overlaps(other) for other in shown_boxes))
        shown_boxes += [box] * text.get_visible()


def _title(study: Study) -> str:
    width, height = study["size"]
    renderer = str(study["machine"]["renderer"]).split("(")[0].strip()
    return (
        f"Mask error against time: {study['scene']['name']}, {width}x{height}\n"
        f"reference: {study['reference']['kind'].replace('_', ' ')}; {renderer}; clock: {study['clock']}"
    )
