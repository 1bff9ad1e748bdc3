"""Fronts of a cost study as pictures: error against time, one picture per column and one of all.  No screen."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from taubench_gl.report.figures import as_title, legend_beside, new_figure, save_figure
from taubench_gl.report.palette import hex_of
from taubench_gl.report.study_tables import worst_of

Study = Mapping[str, Any]

MARKERS = {"base": "s", "best": "*", "one": "o", "combined": "^", "rung": "D"}
NAMES = {"base": "as asked", "best": "all at their best", "one": "one dial turned", "combined": "several dials",
         "rung": "path-traced"}  # fmt: skip
WORST_COLOR = "#9e9e9e"


def plot_fronts(study: Study, folder: Path) -> list[Path]:
    """``front_NAME`` for every front (columns, and the worst of all) and ``fronts``, all in one, as PNG and SVG.

    Raises OutputError."""
    written = []
    for name in study["front_columns"]:
        figure, axes = new_figure(8.6, 5.2)
        _draw(axes, study, name, full=True)
        what = f"{name} column" if name in study["columns"] else worst_of(study, name)
        axes.set_title(_title(study, f"What accuracy costs, {what}"), fontsize=10)
        written += save_figure(figure, folder / f"front_{name}")
    if study["columns"]:
        written += _all(study, folder / "fronts")
    for measure in (study["quality"] or {}).get("measures", ()):
        written += _methods(study, measure, folder / f"methods_{measure}")
    return written


def _methods(study: Study, measure: str, path: Path) -> list[Path]:
    """Reuse methods: error of their pictures against the time of shading and method; the errors start at 0."""
    quality = study["quality"]
    points = [p for p in quality["points"] if p["ms"] and p["errors"][measure] is not None]
    by_name = {p["name"]: p for p in points}
    front = [by_name[name] for name in quality["fronts"][measure]]
    figure, axes = new_figure(8.6, 5.2)
    for i, kind in enumerate(dict.fromkeys(p["input"] for p in points)):
        shown = [p for p in points if p["input"] == kind]
        x, y = [p["ms"]["median"] for p in shown], [p["errors"][measure] for p in shown]
        spread = [p["ms"]["spread"] or 0.0 for p in shown]
        look = {"fmt": "os^Dv<>"[i % 7], "mec": "black", "mew": 0.6, "ecolor": "#888888", "elinewidth": 0.9}
        axes.errorbar(x, y, xerr=spread, ms=6, alpha=0.85, label=kind, **look)
    axes.step([p["ms"]["median"] for p in front], [p["errors"][measure] for p in front], where="post", color="black",
              linewidth=1.4, label="front", zorder=0)  # fmt: skip
    axes.set(xscale="log", xlabel="ms per frame, shading and method (log)", ylabel=measure)
    axes.set_ylim(0.0, 1.15 * max([1e-9, *(p["errors"][measure] for p in points)]))
    for i, p in enumerate(front):
        at = (p["ms"]["median"], p["errors"][measure])
        axes.annotate(p["label"].partition(" on ")[0], at, textcoords="offset points", fontsize=7,
                      xytext=(6, 6 + 10 * (i % 2)))  # fmt: skip
    legend_beside(axes, x=1.0, size=8)
    axes.set_title(_title(study, f"What reuse costs, {measure}", points[0] if points else None), fontsize=10)
    _readable_ticks(axes)
    return save_figure(figure, path)


def _all(study: Study, path: Path) -> list[Path]:
    import math

    columns = list(study["front_columns"])
    rows = math.ceil(len(columns) / 2)
    figure, grid = new_figure(11.0, 3.6 * rows, rows, min(2, len(columns)), squeeze=False)
    flat = [axes for row in grid for axes in row]
    for axes, column in zip(flat, columns):
        _draw(axes, study, column, full=False)
        axes.set_title(column if column in study["columns"] else worst_of(study, column), fontsize=10)
    handles, labels = flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    for axes in flat[len(columns) :]:
        axes.set_axis_off()
    figure.suptitle(_title(study, "What accuracy costs"), fontsize=11)
    return save_figure(figure, path)


def _draw(axes: Any, study: Study, column: str, full: bool) -> None:
    """Points with their spread, the front as steps: between two points only the cheaper one can be had."""
    points = [
        p for p in study["points"] if p["role"] != "question" and p["ms"] and _error(study, p, column) is not None
    ]
    color = hex_of(column) if column in study["columns"] else WORST_COLOR
    for role, marker in MARKERS.items():
        shown = [p for p in points if p["role"] == role]
        if not shown:
            continue
        x = [p["ms"]["median"] for p in shown]
        y = [_error(study, p, column) for p in shown]
        spread = [p["ms"]["spread"] or 0.0 for p in shown]
        look = {"fmt": marker, "ms": 10 if role == "best" else 6, "mec": "black", "mew": 0.6, "ecolor": "#888888"}
        axes.errorbar(
            x,
            y,
            xerr=spread,
            color=color,
            alpha=0.85,
            elinewidth=0.9,
            label=NAMES[role],
            zorder=3 if role in ("base", "best") else 2,
            **look,
        )
    by_name = {p["name"]: p for p in points}
    front = [by_name[name] for name in study["fronts"][column]]
    x = [p["ms"]["median"] for p in front]
    y = [_error(study, p, column) for p in front]
    axes.step(x, y, where="post", color="black", linewidth=1.4, label="front", zorder=0)
    linear = _linear_below(study, points, column)
    axes.set(xscale="log", yscale="symlog", xlabel="ms per frame (log)", ylabel="error, points (straight near 0)")
    axes.set_yscale("symlog", linthresh=linear)
    axes.set_ylim(-0.12 * linear, 2.0 * max([linear, *(_error(study, p, column) for p in points)]))
    floor = study["reference"]["floor"].get(column, {}).get("points")
    if floor:
        axes.axhline(floor, color="#555555", linewidth=0.9, linestyle="--", label="noise floor of the reference")
    if full:
        _label(axes, list(zip(front, y)))
        legend_beside(axes, x=1.0, size=8)
    _readable_ticks(axes)


def _error(study: Study, point: Study, front: str) -> float | None:
    """Points of one column, or of the worst of several."""
    return point["columns"][front]["error"] if front in study["columns"] else point["worst"]["error"]


def _label(axes: Any, front: list[tuple[Any, float]]) -> None:
    """The front's settings by number along the steps, their names in a list below the figure's corner."""
    for i, (p, error) in enumerate(front, start=1):
        at = (p["ms"]["median"], error)
        axes.annotate(str(i), at, textcoords="offset points", xytext=(5, 5), fontsize=8, fontweight="bold")
    names = "\n".join(f"{i}  {textwrap.fill(p['label'], 46)}" for i, (p, _) in enumerate(front, start=1))
    axes.text(1.02, 0.0, names, transform=axes.transAxes, fontsize=7, va="bottom", linespacing=1.25)


def _linear_below(study: Study, points: list[Any], column: str) -> float:
    """Where the error axis turns linear, so that 0 has a place: the smallest error that is not 0, within reason."""
    errors = [_error(study, p, column) for p in points]
    positive = [e for e in errors if e > 1e-9]
    return max(min(positive, default=1e-3), 1e-3)


def _readable_ticks(axes: Any) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    low, high = axes.get_xlim()
    subs = (1.0, 2.0, 5.0) if high / low < 300 else (1.0,)
    few = high / low < 4  # too little of a decade for 1, 2, 5
    axes.xaxis.set_major_locator(MaxNLocator(6) if few else LogLocator(base=10, subs=subs))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))


def _title(study: Study, what: str, method: Study | None = None) -> str:
    """``method``: a point of ``quality``, whose reference and clock count instead."""
    width, height = study["size"]
    name = as_title(study["scene"]["name"])
    renderer = str(study["machine"]["renderer"]).split("(")[0].strip()
    reference, clock = study["reference"]["name"], study["clock"]
    if method is not None:
        reference, clock = method["reference"], method["clock"]
    return (
        f"{what}: {name}, {width}x{height}, {study['pairs']} pairs at {study['fps']:g} fps\n"
        f"reference: {reference}; {renderer}; clock: {clock}"
    )
