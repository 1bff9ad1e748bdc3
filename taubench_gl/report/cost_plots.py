"""The figure of a cost study as an image: mask error against time, both logarithmic.  Draws without a display."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import wrap
from typing import Any

from taubench_gl.report.cost_page import OVERALL_COLOR
from taubench_gl.report.cost_tables import OVERALL
from taubench_gl.report.figures import as_title, new_figure, save_figure

Study = Mapping[str, Any]

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
    figure, axes = new_figure(9.0, 5.4)
    for role, (marker, name) in ROLES.items():
        if group := [p for p in shown if p["role"] == role]:
            x, y = zip(*(places[p["name"]] for p in group))
            axes.errorbar(
                x, y, xerr=[p["ms"]["spread"] or 0.0 for p in group], fmt=marker, ms=11 if marker == "*" else 6,
                mec="black", mew=0.6, color=OVERALL_COLOR, alpha=0.85, ecolor="#888888", elinewidth=0.9,
                label=name, zorder=3 if role in NAMED else 2,
            )  # fmt: skip
    chosen, front = (study["chosen"] or {}).get("configuration"), study["fronts"][OVERALL]
    if steps := [places[name] for name in front if name in places]:  # only measured configurations are available
        axes.step(*zip(*steps), where="post", color="black", linewidth=1.4, label="Pareto front", zorder=0)
    if chosen in places:
        axes.plot(*places[chosen], "o", ms=16, mfc="none", mec="black", label="recommended")
    if floor:
        axes.axhline(floor, color="#555555", linewidth=0.9, linestyle="--", label="noise floor of the reference")
    axes.set(xscale="log", yscale="log", xlabel="ms per frame", ylabel="wrong masks, % of the pixels")
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        digits = "123456789" if high < 3 * low else "235" if high < 30 * low else "3" if high < 300 * low else ""
        axis.set_major_formatter(lambda value, _: f"{value:g}")
        axis.set_minor_formatter(lambda value, _, digits=digits: f"{value:g}" if f"{value:e}"[0] in digits else "")
    axes.legend(frameon=False, fontsize=8, loc="best")
    figure.suptitle(_title(study), fontsize=10)
    named = [p for p in shown if p["role"] in NAMED or p["name"] in front]
    named.sort(key=lambda p: (p["name"] != chosen, p["role"] not in NAMED))
    _write_names(axes, {p["name"]: p["label"] for p in named}, places)
    return save_figure(figure, folder / "front")


def _write_names(axes: Any, labels: Mapping[str, str], places: Mapping[str, tuple[float, float]]) -> None:
    """Names beside their marks, without those that would cover an earlier one."""
    style = {"textcoords": "offset points", "xytext": (6, 6), "fontsize": 7}
    texts = [axes.annotate("\n".join(wrap(label, 36)[:2]), places[name], **style) for name, label in labels.items()]
    axes.figure.canvas.draw()  # texts have their places from now on
    kept: list[Any] = []
    for text in texts:
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
