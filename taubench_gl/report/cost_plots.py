"""Pareto fronts of a cost study as images: error against time, per column and together.  Draws without a display."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taubench_gl.report.cost_page import METHOD_COLOR, WORST_COLOR
from taubench_gl.report.cost_tables import worst_of
from taubench_gl.report.figures import as_title, legend_beside, new_figure, save_figure
from taubench_gl.report.palette import hex_of

Study = Mapping[str, Any]
Point = Mapping[str, Any]

MARKERS = {"baseline": "s", "highest_quality": "*", "single": "o", "combined": "^", "path_traced": "D", "method": "o"}
NAMES = {"baseline": "baseline", "highest_quality": "highest quality", "single": "one parameter changed",
         "combined": "several parameters changed", "path_traced": "path-traced", "method": "reuse method"}  # fmt: skip


def plot_fronts(study: Study, folder: Path) -> list[Path]:
    """``front_NAME`` for every Pareto front of columns, ``fronts``, all in one, and ``methods_MEASURE``; PNG and SVG.

    Raises OutputError.
    """
    written = []
    for name in study["front_columns"]:
        figure, axes = new_figure(8.6, 5.2)
        front = _draw_front(axes, study, name)
        _name_points(axes, front)
        figure.suptitle(_title(study, f"Accuracy against time, {_front_title(study, name)}"), fontsize=10)
        written += save_figure(figure, folder / f"front_{name}")
    if study["columns"]:
        written += save_figure(_all_fronts(study), folder / "fronts")
    for measure in (study["methods"] or {}).get("measures", ()):
        figure, axes = new_figure(8.6, 5.2)
        points = study["methods"]["points"]
        errors = {p["name"]: p["errors"][measure] for p in points if p["ms"] and p["errors"][measure] is not None}
        front = _draw(axes, points, errors, study["methods"]["fronts"][measure], METHOD_COLOR)
        axes.set(xlabel="ms per frame, shading and method (log)", ylabel=measure)
        axes.set_ylim(0.0, 1.15 * max([1e-9, *errors.values()]))
        _name_points(axes, front)
        figure.suptitle(_title(study, f"Reuse methods, {measure}", points[0]), fontsize=10)
        written += save_figure(figure, folder / f"methods_{measure}")
    return written


def _all_fronts(study: Study) -> Any:
    names = list(study["front_columns"])
    rows = math.ceil(len(names) / 2)
    figure, grid = new_figure(11.0, 3.6 * rows, rows, min(2, len(names)), squeeze=False)
    flat = list(grid.flat)
    for axes, name in zip(flat, names):
        _draw_front(axes, study, name)
        axes.set_title(_front_title(study, name), fontsize=10)
    for axes in flat[len(names) :]:
        axes.set_axis_off()
    handles, labels = flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    figure.suptitle(_title(study, "Accuracy against time"), fontsize=11)
    return figure


def _front_title(study: Study, name: str) -> str:
    return name if name in study["columns"] else worst_of(study, name)


def _draw_front(axes: Any, study: Study, name: str) -> list[tuple[Point, float]]:
    """One front of columns; its points and errors, fastest first.  The error axis is logarithmic down to near 0."""
    is_column = name in study["columns"]
    points = [p for p in study["points"] if p["role"] != "definition" and p["ms"]]
    errors = {p["name"]: p["columns"][name]["error"] if is_column else p["worst"]["error"] for p in points}
    errors = {n: e for n, e in errors.items() if e is not None}
    front = _draw(axes, points, errors, study["fronts"][name], hex_of(name) if is_column else WORST_COLOR)
    linear = max(min((e for e in errors.values() if e > 1e-9), default=1e-3), 1e-3)
    axes.set_yscale("symlog", linthresh=linear)
    axes.set_ylim(-0.12 * linear, 2.0 * max([linear, *errors.values()]))
    axes.set(xlabel="ms per frame (log)", ylabel="error, pp (linear near 0)")
    floor = study["reference"]["floor"].get(name, {}).get("points")
    if floor:
        axes.axhline(floor, color="#555555", linewidth=0.9, linestyle="--", label="noise floor of the reference")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    return front


def _draw(
    axes: Any, points: Sequence[Point], errors: Mapping[str, float], front: Sequence[str], color: str
) -> list[tuple[Point, float]]:
    """Points with the spread of their times; the front as steps, as only measured configurations are available."""
    for role, marker in MARKERS.items():
        shown = [p for p in points if p["role"] == role and p["name"] in errors]
        if shown:
            x, spread = [p["ms"]["median"] for p in shown], [p["ms"]["spread"] or 0.0 for p in shown]
            axes.errorbar(
                x, [errors[p["name"]] for p in shown], xerr=spread, fmt=marker, ms=10 if marker == "*" else 6,
                mec="black", mew=0.6, color=color, alpha=0.85, ecolor="#888888", elinewidth=0.9, label=NAMES[role],
                zorder=3 if role in ("baseline", "highest_quality") else 2,
            )  # fmt: skip
    by_name = {p["name"]: p for p in points}
    found = [(by_name[name], errors[name]) for name in front]
    x, y = [p["ms"]["median"] for p, _ in found], [error for _, error in found]
    axes.step(x, y, where="post", color="black", linewidth=1.4, label="Pareto front", zorder=0)
    axes.set_xscale("log")
    _label_ticks(axes)
    return found


def _name_points(axes: Any, front: Sequence[tuple[Point, float]]) -> None:
    """Numbers at the points of the front, their names beside the plot."""
    for i, (p, error) in enumerate(front, start=1):
        at = (p["ms"]["median"], error)
        axes.annotate(str(i), at, textcoords="offset points", xytext=(5, 5), fontsize=8, fontweight="bold")
    names = "\n".join(f"{i}  {textwrap.fill(p['label'], 46)}" for i, (p, _) in enumerate(front, start=1))
    axes.text(1.02, 0.0, names, transform=axes.transAxes, fontsize=7, va="bottom", linespacing=1.25)
    legend_beside(axes, x=1.0, size=8)


def _label_ticks(axes: Any) -> None:
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    low, high = axes.get_xlim()
    narrow = high / low < 4  # not enough of a decade for 1, 2, 5
    subs = (1.0, 2.0, 5.0) if high / low < 300 else (1.0,)
    axes.xaxis.set_major_locator(MaxNLocator(6) if narrow else LogLocator(base=10, subs=subs))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _title(study: Study, what: str, method: Point | None = None) -> str:
    """``method``: its reference and clock replace those of the study."""
    width, height = study["size"]
    name = as_title(study["scene"]["name"])
    renderer = str(study["machine"]["renderer"]).split("(")[0].strip()
    reference, clock = study["reference"]["name"].replace("_", " "), study["clock"]
    if method is not None:
        reference, clock = method["reference"], method["clock"]
    return (
        f"{what}: {name}, {width}x{height}, {study['pairs']} pairs at {study['fps']:g} fps\n"
        f"reference: {reference}; {renderer}; clock: {clock}"
    )
