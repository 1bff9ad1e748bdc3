"""The figure of a cost study as an image: mask error against time, both logarithmic.  Draws without a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

from taubench_gl.report.cost_page import OVERALL_COLOR
from taubench_gl.report.cost_tables import OVERALL
from taubench_gl.report.figures import as_title, new_figure, save_figure

Study = Mapping[str, Any]
Point = Mapping[str, Any]

MARKERS = {"baseline": "s", "level": "s", "highest_quality": "*", "single": "o", "combined": "^", "path_traced": "D",
           "render": "*"}  # fmt: skip
NAMES = {"baseline": "baseline", "level": "named level", "highest_quality": "highest quality",
         "single": "one parameter changed", "combined": "several changed", "path_traced": "path-traced",
         "render": "renders"}  # fmt: skip
NAMED = ("baseline", "level", "highest_quality", "path_traced", "render")


def plot_study(study: Study, folder: Path) -> list[Path]:
    """``front``, the overall error against time, PNG and SVG; none where nothing is timed.  Raises OutputError."""
    errors = {p["name"]: p["masks"][OVERALL]["percent"] for p in study["points"] if p["masks"] and p["ms"]}
    shown = [p for p in study["points"] if p["role"] in MARKERS]
    if not errors:
        return []
    figure, axes = new_figure(9.0, 5.4)
    _draw(axes, shown, errors, study["fronts"][OVERALL], study["reference"]["floor"].get(OVERALL))
    axes.set(xlabel="ms per frame", ylabel="wrong masks, % of the pixels")
    figure.suptitle(_title(study), fontsize=10)
    return save_figure(figure, folder / "front")


def _draw(
    axes: Any,
    points: Sequence[Point],
    errors: Mapping[str, float],
    front: Sequence[str],
    floor: float | None,
) -> None:
    """Points with the spread of their times; the front as steps, as only measured configurations are available.

    Names that would cover another are left out, those of levels last.
    """
    positive = [e for e in (*errors.values(), floor or 0.0) if e > 0.0]
    bottom = 0.5 * min(positive, default=0.01)  # errors of 0 are drawn here

    def height(name: str) -> float:
        return max(errors[name], bottom)

    named: dict[bool, list[Any]] = {True: [], False: []}
    for role, marker in MARKERS.items():
        group = [p for p in points if p["role"] == role and p["name"] in errors]
        if group:
            x, spread = [p["ms"]["median"] for p in group], [p["ms"]["spread"] or 0.0 for p in group]
            axes.errorbar(
                x, [height(p["name"]) for p in group], xerr=spread, fmt=marker, ms=11 if marker == "*" else 6,
                mec="black", mew=0.6, color=OVERALL_COLOR, alpha=0.85, ecolor="#888888", elinewidth=0.9,
                label=NAMES[role], zorder=3 if role in NAMED else 2,
            )  # fmt: skip
        for p in group:
            if role in NAMED or p["name"] in front:
                at = (p["ms"]["median"], height(p["name"]))
                text = "\n".join(wrap(p["label"], 36)[:2])
                named[role in NAMED].append(
                    axes.annotate(text, at, textcoords="offset points", xytext=(6, 6), fontsize=7)
                )
    times = {p["name"]: p["ms"]["median"] for p in points if p["ms"]}
    steps = [(times[name], height(name)) for name in front if name in errors]
    if steps:
        axes.step(*zip(*steps), where="post", color="black", linewidth=1.4, label="Pareto front", zorder=0)
    if floor:
        axes.axhline(floor, color="#555555", linewidth=0.9, linestyle="--", label="noise floor of the reference")
    axes.set(xscale="log", yscale="log")
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        digits = (
            "123456789" if high < 3 * low else "235" if high < 30 * low else "3" if high < 300 * low else ""
        )  # powers of ten are too few
        axis.set_minor_formatter(lambda value, _, digits=digits: f"{value:g}" if f"{value:e}"[0] in digits else "")
    axes.legend(frameon=False, fontsize=8, loc="best")
    axes.figure.canvas.draw()  # texts have their places from now on
    kept: list[Any] = []
    for text in (*named[True], *named[False]):
        box = text.get_window_extent()
        text.set_visible(not any(box.overlaps(other) for other in kept))
        kept += [box] * text.get_visible()


def _title(study: Study) -> str:
    width, height = study["size"]
    renderer = str(study["machine"]["renderer"]).split("(")[0].strip()
    reference = study["reference"]["kind"].replace("_", " ")
    name = as_title(study["scene"]["name"])
    what = f"Mask error against time: {name}, {width}x{height}"
    return f"{what}\nreference: {reference}; {renderer}; clock: {study['clock']}"
