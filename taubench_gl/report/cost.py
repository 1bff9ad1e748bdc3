"""A cost study in words, one picture, tables and a page.  Takes the values of cost.json (``taubench-gl/cost/4``)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taubench_gl.data_files import read_bytes
from taubench_gl.outputs import write_atomically
from taubench_gl.report.labels import lighting_text
from taubench_gl.report.page import Page, data_uri, picture, text_lines
from taubench_gl.report.palette import SERIES_COLORS
from taubench_gl.report.plot import Plot
from taubench_gl.report.table import Column, Row, Table, to_html, to_text, write_tables

Study = Mapping[str, Any]
Point = Mapping[str, Any]

SERIES = {
    "preview": ("preview: its bias does not fall with time", "o", SERIES_COLORS[1]),
    "decided": ("decided samples: half width of the 95 % interval", "s", SERIES_COLORS[0]),
    "every": ("every pixel decided: as exact as the truth is known", "D", SERIES_COLORS[0]),
    "fixed": ("fixed samples per pixel", "^", SERIES_COLORS[2]),
}
"""Series -> its name in the legend, marker and color."""

FLOOR = 1e-3
"""Percentage points at which smaller errors are drawn."""

WIDTH = 150
"""Width of a line of cost.txt in characters."""


def answer(study: Study) -> list[str]:
    """Lines that answer the study: three recommendations; where the preview is enough, and from when on deciding wins;
    what the truth is.
    """
    return [*map(_recommendation, study["recommendations"]), *_words(study), _truth(study)]


def _recommendation(use: Mapping[str, Any]) -> str:
    """One line: what to use within so many seconds, or for so many points."""
    limit = f"{use['limit']:g} {use['unit']}"
    if "configuration" not in use:
        return f"Within {limit}: nothing has been measured"
    facts = f"{_named(use['configuration'])} ({_seconds(use['seconds'])}, at most {use['error']:.2g} points off)"
    if use["reached"]:
        return f"Within {limit} use {facts}" if use["unit"] == "s" else f"For the truth to {limit} use {facts}"
    kind = "nothing takes so little time" if use["unit"] == "s" else "nothing is known to be so exact"
    return f"Within {limit}: {kind}; the nearest is {facts}"


def _words(study: Study) -> list[str]:
    enough, wins = (_point(study, study[name]) for name in ("preview_enough", "deciding_wins"))
    lines = []
    if enough is not None:
        limit, seconds = f"{enough['error']:.2g} points", _seconds(enough["seconds"])
        lines.append(f"The preview is enough where {limit} are: {_named(enough['name'])} ({seconds})")
    if wins is not None:
        seconds, least = _seconds(wins["seconds"]), f"{wins['error']:.2g} points"
        lines.append(f"From {seconds} on deciding wins: {_named(wins['name'])}, at most {least} off")
    elif any(p["series"] == "decided" for p in _comparable(study)):
        lines.append("Deciding does not win here: no measured interval is narrower than the error of the best preview")
    return lines


def _truth(study: Study) -> str:
    truth = study["truth"]
    several = "s of decided samples with other seeds, together" if truth["evaluations"] > 1 else " with another seed,"
    text = f"Truth: {truth['evaluations']} evaluation{several} within {truth['half_width']:.2g} points (95 %)"
    short = truth["half_width"] > truth["wanted_half_width"]
    return text + (f", not {truth['wanted_half_width']:g} as asked for" if short else "")


def _point(study: Study, name: str | None) -> Point | None:
    return next((p for p in study["points"] if p["name"] == name), None)


def _comparable(study: Study) -> list[Point]:
    return [p for p in study["points"] if p["error"] is not None]


def _named(name: str) -> str:
    return "the defaults" if name == "default" else name


def _seconds(value: float) -> str:
    return f"{value:.0f} s" if value >= 100 else f"{value:.2g} s"


def cost_tables(study: Study) -> list[Table]:
    """Tables of all configurations, with the Pareto front marked, and of their columns."""
    return [_configurations(study), _columns(study)]


def _configurations(study: Study) -> Table:
    heads = (
        Column("s", "", 2, "seconds of the whole table by the clock of the study, without start and first pair"),
        Column("CPU s", "", 2, "of all cores"),
        Column("first pair", "s", 2, "before, with the compilation of its shaders"),
        Column("error", "points", 2, "at most, 95 %: the largest of the columns"),
        Column("seen", "points", 2, "largest difference from the truth"),
        Column("front", "", None, "no configuration is as fast and more exact"),
    )
    rows = []
    for p in study["points"]:
        front = "yes" if p["name"] in study["front"] else ""
        values = (p["seconds"], p["cpu_seconds"], p["first_pair_seconds"], p["error"], p["observed"], front)
        why = f"lacks {', '.join(p['lacking'])}: not in the choice"
        rows.append(Row(f"{p['series']}: {_named(p['name'])}", values, reasons={3: why} if p["lacking"] else {}))
    notes = [f"left out, {_named(name)}: {why}" for name, why in study["left_out"].items()]
    return Table("cost", "Seconds and error of every configuration", heads, tuple(rows), tuple(notes))


def _columns(study: Study) -> Table:
    """The table of what each configuration says of each column, percent; of the truth with its half width."""
    names = list(study["truth"]["columns"])
    heads = tuple(Column(name, "%", 2) for name in names)
    truth = study["truth"]["columns"]
    rows = [Row.of("truth", [truth[n]["percent"] for n in names], *(truth[n]["reason"] for n in names))]
    halves = [truth[n]["half_width"] if truth[n]["percent"] is not None else None for n in names]
    rows.append(Row.of("truth, ± (95 %)", halves, "not measured"))
    for p in study["points"]:
        values = [p["columns"][n]["percent"] for n in names]
        label = f"{p['series']}: {_named(p['name'])}"
        rows.append(Row.of(label, values, *(p["columns"][n]["reason"] for n in names)))
    return Table("columns", "Columns of every configuration", heads, tuple(rows))


def heading(study: Study) -> list[str]:
    """What every number depends on: scene, light, machine, clock."""
    (width, height), made = study["size"], study["provenance"]
    first, stop = study["frames"]
    clock = "wall clock" if study["clock"] == "wall" else "CPU time of all cores"
    return [
        f"{study['scene']}, {width}x{height}, frames {first}:{stop}, {study['pairs']} pairs",
        lighting_text({"settings": {k: v for k, v in study["settings"].items() if k != "light"}}) or "",
        f"{made['renderer']}, {made['driver']}; {clock}; taubench-gl {made['version']}",
    ]


def cost_text(study: Study) -> str:
    """Plain text: the answer, the tables, and the commands to evaluate each configuration again."""
    commands = [p["command"] for p in study["points"]]
    text = [*study["lines"], "", *heading(study), "", to_text(cost_tables(study), WIDTH), "Commands:", *commands]
    return "\n".join(text) + "\n"


def _drawn_as(p: Point) -> str:
    """The key of SERIES that a configuration is drawn as."""
    return "every" if p["series"] == "decided" and p["sampled_light"] is None else p["series"]


def plot_cost(study: Study) -> Plot:
    """Seconds for the whole table against the error of its columns, both logarithmic."""
    width, height = study["size"]
    plot = Plot(f"What accuracy costs: {study['scene']}, {width}x{height}, {study['pairs']} pairs", 9.5, 5.2)
    axes, points = plot.axes, _comparable(study)
    places = {p["name"]: (p["seconds"], max(p["error"], FLOOR)) for p in points}
    bottom = 0.3 * min([y for _, y in places.values()], default=FLOOR)
    for series, (label, marker, color) in SERIES.items():
        group = sorted((p for p in points if _drawn_as(p) == series), key=lambda p: p["seconds"])
        if not group:
            continue
        x, y = [p["seconds"] for p in group], [max(p["error"], FLOOR) for p in group]
        line = "none" if series in ("preview", "every") else "-"
        axes.plot(x, y, marker=marker, linestyle=line, color=color, ms=6, mec="black", mew=0.5, label=label, zorder=4)
        if series == "decided":
            axes.fill_between(x, [FLOOR] * len(x), y, color=color, alpha=0.12, linewidth=0, zorder=0)
            seen = [max(p["observed"], bottom) for p in group]
            axes.plot(x, seen, "x", color=color, ms=5, label="decided samples: difference from the truth", zorder=4)
        else:
            lower = [error - max(p["least"], FLOOR) for error, p in zip(y, group, strict=True)]
            axes.errorbar(x, y, yerr=[lower, [0.0] * len(x)], fmt="none", ecolor=color, elinewidth=0.8, alpha=0.5)
    front = [places[name] for name in study["front"]]
    if front:
        axes.step(*zip(*front, strict=True), where="post", color="black", linewidth=1.3, label="Pareto front", zorder=2)
    axes.axhline(max(study["truth"]["half_width"], FLOOR), color="#555555", linewidth=0.9, linestyle="--",
                 label="half width of the truth")  # fmt: skip
    axes.set(
        xscale="log", yscale="log", xlabel="seconds for the whole table", ylabel="error at most, percentage points"
    )
    axes.set_ylim(bottom=bottom)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
    plot.legend(axes)
    _write_names(axes, study, places)
    return plot


def _write_names(axes: Any, study: Study, places: Mapping[str, tuple[float, float]]) -> None:
    """Names beside the marks of the lines and of the front, without those that would cover an earlier one."""
    shown = [p["name"] for p in _comparable(study) if p["name"] in study["front"] or p["series"] != "preview"]
    boxes: list[Any] = []
    texts = [
        axes.annotate(_named(name), places[name], textcoords="offset points", xytext=(6, 5), fontsize=7)
        for name in sorted(shown, key=lambda name: name not in study["front"])
    ]
    axes.figure.canvas.draw()  # texts have their places from now on
    for text in texts:
        box = text.get_window_extent()
        text.set_visible(not any(box.overlaps(other) for other in boxes))
        boxes += [box] * text.get_visible()


def write_cost(study: Study, folder: Path) -> list[Path]:
    """Write cost.png, cost.svg, cost.html, cost.txt and the tables.  -> the files.  Raises OutputError."""
    images = plot_cost(study).save(folder / "cost")
    page = Page(f"What accuracy costs: {study['scene']}", "cost study", intro=(text_lines(study["lines"], "answer"),))
    alt = "Seconds for the whole table against the error of its columns"
    page.add("figure", "Seconds against error", picture(data_uri(read_bytes(images[0])), alt))
    page.add("tables", "Tables", to_html(cost_tables(study), scroll=True), text_lines(heading(study)))
    page.add("commands", "Commands", text_lines([p["command"] for p in study["points"]]))
    write_atomically(folder / "cost.html", page.html())
    write_atomically(folder / "cost.txt", cost_text(study))
    return [*images, folder / "cost.html", folder / "cost.txt", *write_tables(folder, cost_tables(study))]
