"""Plots of a reuse evaluation: error over frames, error by class, quality against time; and the curve of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.report.plots import _figure, _save

Summary = Mapping[str, Any]

_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#000000", "#999933", "#332288")
"""Okabe and Ito's palette, then Tol's; past its end the line style changes."""

_DASHES = ("-", "--", ":", "-.")
_MARKERS = ("o", "s", "^", "D")


def plot_reuse(summary: Summary, rows: Sequence[Mapping[str, Any]], folder: Path) -> list[Path]:
    """``frames``, ``classes`` and ``time`` as PNG and SVG; those for which there is nothing are left out."""
    good = {label: m for label, m in summary["methods"].items() if not m["failed"]}
    if not good:
        return []
    measure = "flip" if any(row["flip"] is not None for row in rows) else "relmse"
    written = _frames(summary, good, rows, measure, folder / "frames.png")
    written += _classes(summary, good, measure, folder / "classes.png")
    return written + _time(summary, good, measure, folder / "time.png")


def plot_fit(fit: Summary, path: Path) -> list[Path]:
    """Error against the one setting that was searched, or as a map over two; more are not drawn."""
    names = list(fit["settings"])
    points = [p for p in fit["points"] if p["value"] is not None]
    if not points or len(names) > 2:
        return []
    axes_of = [np.array([float(p["settings"][n]) for p in points]) for n in names]
    values = np.array([p["value"] for p in points])
    figure, axes = _figure(7.0, 4.4)
    scales = [fit["settings"][n]["scale"] for n in names]
    if len(names) == 1:
        order = np.argsort(axes_of[0])
        axes.plot(axes_of[0][order], values[order], "o-", color=_COLORS[0], linewidth=2)
        axes.set(xscale=scales[0], xlabel=names[0], ylabel=f"{fit['metric']} ({fit['better']} is better)")
    else:
        drawn = axes.scatter(*axes_of, c=values, s=120, cmap="viridis", edgecolors="black", linewidths=0.5)
        axes.set(xscale=scales[0], yscale=scales[1], xlabel=names[0], ylabel=names[1])
        figure.colorbar(drawn, label=f"{fit['metric']} ({fit['better']} is better)")
    best = [float(fit["best"]["settings"][n]) for n in names]
    if len(names) == 1:
        if fit["best"]["value"] is None:  # equal to the reference: beyond any axis
            axes.axvline(best[0], color=_COLORS[1], label="best")
        else:
            axes.plot(best, [fit["best"]["value"]], "*", markersize=16, color=_COLORS[1], label="best", zorder=5)
        now = fit["default"]["settings"][names[0]]
        axes.axvline(float(now), color="black", linewidth=0.9, linestyle=":", label=f"default {now:g}")
        axes.legend(frameon=False)
    else:
        axes.plot(*([v] for v in best), "*", markersize=18, color=_COLORS[1], zorder=5)
    axes.set_title(f"{fit['method']} on {fit['scene']}", loc="left", fontsize=11)
    return _save(figure, path)


def _look(index: int) -> dict[str, Any]:
    return {"color": _COLORS[index % len(_COLORS)], "linestyle": _DASHES[index // len(_COLORS) % len(_DASHES)]}


def _frames(summary: Summary, good: Summary, rows: Sequence[Mapping[str, Any]], measure: str, path: Path) -> list[Path]:
    figure, (upper, lower) = _figure(9.0, 6.0, rows=2)
    for index, label in enumerate(good):
        own = [row for row in rows if row["method"] == label]
        numbers = [row["frame"] for row in own]
        for axes, name in ((upper, measure), (lower, "flicker")):
            values = [np.nan if row[name] is None else row[name] for row in own]
            if np.isfinite(values).any():
                axes.plot(numbers, values, linewidth=1.7, label=label, **_look(index))
    upper.set(ylabel=f"{measure} (lower is better)")
    upper.set_title(_title(summary, "Error per frame"), loc="left", fontsize=11)
    lower.set(ylabel="flicker (lower is better)", xlabel="frame")
    for axes in (upper, lower):
        axes.set_ylim(bottom=0)
    upper.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    return _save(figure, path)


def _classes(summary: Summary, good: Summary, measure: str, path: Path) -> list[Path]:
    first = next(iter(good.values()))["classes"]
    names = [name for name in summary["classes"] if first[name]["pixels"]]
    if not names or any(measure not in m["classes"][n] for m in good.values() for n in names):
        return []
    figure, axes = _figure(max(8.0, 1.1 * len(names) + 0.12 * len(names) * len(good)), 4.6)
    width = 0.85 / len(good)
    for index, (label, method) in enumerate(good.items()):
        at = np.arange(len(names)) + (index - 0.5 * (len(good) - 1)) * width
        hatch = "//" if index >= len(_COLORS) else None
        color = _COLORS[index % len(_COLORS)]
        axes.bar(at, [method["classes"][n][measure] for n in names], width, label=label, color=color, hatch=hatch)
    axes.set_xticks(range(len(names)), [f"{n}\n{first[n]['percent']:.1f} %" for n in names])
    axes.set(ylabel=f"mean {measure} (lower is better)")
    axes.set_title(_title(summary, "Error by class of pixel, and the class's share"), loc="left", fontsize=11)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    return _save(figure, path)


def _time(summary: Summary, good: Summary, measure: str, path: Path) -> list[Path]:
    timed = {label: m for label, m in good.items() if m["time_ms"] and m["mean"][measure] is not None}
    if not timed:
        return []
    figure, axes = _figure(7.5, 4.6)
    for index, (label, method) in enumerate(good.items()):
        if label in timed:
            at = method["time_ms"], method["mean"][measure]
            look = {"color": _COLORS[index % len(_COLORS)], "marker": _MARKERS[index // len(_COLORS) % len(_MARKERS)]}
            axes.plot(*([v] for v in at), linestyle="", markersize=9, label=label, **look)
    axes.set(xscale="log", xlabel=f"ms per frame, median ({summary['clock']})", ylabel=f"{measure} (lower is better)")
    axes.margins(x=0.1, y=0.1)
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=9)
    axes.set_title(_title(summary, "Quality against time"), loc="left", fontsize=11)
    return _save(figure, path)


def _title(summary: Summary, what: str) -> str:
    s = summary["settings"]
    kind = summary["input"]["kind"].partition(":")[0]  # of files, not where they lie
    name = summary["scene"]["name"].replace("$", r"\$")  # a lone dollar sign would start a formula
    return f"{what}: {name}, {s['width']}x{s['height']}, {kind} input"
