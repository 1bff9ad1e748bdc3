"""Plots of a reuse evaluation (schema ``taubench-gl/reuse/3``) and of a parameter fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.report.method_styles import method_styles
from taubench_gl.report.palette import SERIES_COLORS
from taubench_gl.report.plot import Plot, pareto_steps
from taubench_gl.report.reuse import LABELS, class_label, mean_over_seeds, valid_methods

Summary = Mapping[str, Any]

PLOTS = ("frames", "classes", "time", "convergence", "response", "equal_rays", "equal_time")
"""Names of the plots of an evaluation, without suffix."""


def plot_reuse(summary: Summary, rows: Sequence[Mapping[str, Any]], folder: Path) -> list[Path]:
    """PLOTS as PNG and SVG, as far as there are values.  Raises OutputError."""
    if not valid_methods(summary):
        return []
    measure = "flip" if any(row["flip"] is not None for row in rows) else "relmse"
    plots = (
        _frames(summary, rows, measure), _classes(summary, measure), _time(summary, measure), _convergence(summary),
        _response(summary), _equal_cost(summary, "shadow rays a pixel"), _equal_cost(summary, "ms a frame"),
    )  # fmt: skip
    return [
        path
        for name, plot in zip(PLOTS, plots, strict=True)
        if plot is not None
        for path in plot.save(folder / f"{name}.png")
    ]


def plot_fit(fit: Summary, path: Path) -> list[Path]:
    """The error by one parameter, or as a map over two; no plot for more.  Raises OutputError."""
    names = list(fit["settings"])
    points = [p for p in fit["points"] if p["value"] is not None]
    if not points or len(names) > 2:
        return []
    places = [np.array([float(p["settings"][name]) for p in points]) for name in names]
    values = np.array([p["value"] for p in points])
    scales = [fit["settings"][name]["scale"] for name in names]
    best = [float(fit["best"]["settings"][name]) for name in names]
    error = f"{fit['metric']} ({fit['better']} is better)"
    plot = Plot(f"{fit['method']}, {fit['scene']}", 8.0, 4.4)
    axes = plot.axes
    star = {"color": SERIES_COLORS[1], "label": "best", "zorder": 5, "linestyle": ""}
    if len(names) == 2:
        drawn = axes.scatter(*places, c=values, s=120, cmap="viridis", edgecolors="black", linewidths=0.5)
        axes.set(xscale=scales[0], yscale=scales[1], xlabel=names[0], ylabel=names[1])
        axes.plot(*([value] for value in best), marker="*", markersize=18, **star)
        plot.figure.colorbar(drawn, label=error)
        return plot.save(path)
    order = np.argsort(places[0])
    axes.plot(places[0][order], values[order], "o-", color=SERIES_COLORS[0], linewidth=2)
    axes.set(xscale=scales[0], xlabel=names[0], ylabel=error)
    if fit["best"]["value"] is None:  # equal to the reference: infinite
        axes.axvline(best[0], color=SERIES_COLORS[1], label="best")
    else:
        axes.plot(best, [fit["best"]["value"]], marker="*", markersize=16, **star)
    default = fit["default"]["settings"][names[0]]
    axes.axvline(float(default), color="black", linewidth=0.9, linestyle=":", label=f"default {default:g}")
    plot.legend(axes)
    return plot.save(path)


def _frames(summary: Summary, rows: Sequence[Mapping[str, Any]], measure: str) -> Plot:
    plot = Plot(_title(summary, "Error per frame"), 9.0, 6.0, rows=2, shared_x=(3, 2))
    methods = valid_methods(summary)
    styles = method_styles(methods)
    for label in methods:
        of_method = [row for row in rows if row["method"] == label]
        frames = sorted({row["frame"] for row in of_method})
        for axes, name in zip(plot.panels, (measure, "flicker"), strict=True):
            values = np.array([mean_over_seeds(of_method, frame, name) for frame in frames], dtype=float)
            if np.isfinite(values).any():
                axes.plot(frames, values, linewidth=1.7, label=label, **styles[label].curve)
    for axes, name in zip(plot.panels, (measure, "flicker"), strict=True):
        axes.set(ylabel=f"{LABELS[name]} (lower is better)", ylim=(0, None))
    plot.panels[1].set_xlabel("frame")
    plot.legend(plot.axes)
    return plot


def _classes(summary: Summary, measure: str) -> Plot | None:
    methods = valid_methods(summary)
    first = next(iter(methods.values()))["classes"]
    names = [name for name in summary["classes"] if first[name]["pixels"]]
    if not names or any(measure not in m["classes"][n] for m in methods.values() for n in names):
        return None
    width, styles = 0.85 / len(methods), method_styles(methods)
    size = max(8.0, 1.1 * len(names) + 0.12 * len(names) * len(methods))
    plot = Plot(_title(summary, "Error by pixel class, and share of the class"), size)
    for index, (label, method) in enumerate(methods.items()):
        places = np.arange(len(names)) + (index - 0.5 * (len(methods) - 1)) * width
        values = [method["classes"][name][measure] for name in names]
        plot.axes.bar(places, values, width, label=label, **styles[label].bar)
    plot.axes.set_xticks(range(len(names)), [f"{class_label(n)}\n{first[n]['percent']:.1f} %" for n in names])
    plot.axes.set(ylabel=f"mean {LABELS[measure]} (lower is better)")
    plot.legend(plot.axes)
    return plot


def _time(summary: Summary, measure: str) -> Plot | None:
    timed = {
        label: (method["time_ms"], method["mean"][measure])
        for label, method in valid_methods(summary).items() if method["time_ms"] and method["mean"][measure] is not None
    }  # fmt: skip
    if not timed:
        return None
    plot, styles = Plot(_title(summary, "Error against time")), method_styles(timed)
    for label, place in timed.items():
        style = {**styles[label].points, "linestyle": ""}
        plot.axes.plot(*([value] for value in place), label=label, markersize=8, **style)
    if usable := [place for label, place in timed.items() if not summary["methods"][label].get("yardstick")]:
        front = zip(*pareto_steps(usable), strict=True)
        plot.axes.step(*front, where="post", color="black", linewidth=1.2, zorder=0, label="Pareto front")
    plot.axes.set(
        xscale="log",
        xlabel=f"ms per frame, median ({summary['clock']})",
        ylabel=f"{LABELS[measure]} (lower is better)",
    )
    plot.axes.margins(x=0.1, y=0.1)
    plot.axes.set_ylim(bottom=0)
    plot.legend(plot.axes)
    return plot


def _convergence(summary: Summary) -> Plot | None:
    """Error by the number of frames since the first frame or a cut; a line of slope -1/2 is that of a running mean."""
    convergence = (summary.get("statistics") or {}).get("convergence") or {"methods": {}}
    curves = {label: np.array(curve, dtype=float) for label, curve in convergence["methods"].items()}
    if not any(len(curve) > 1 and (curve > 0).any() for curve in curves.values()):
        return None
    plot, styles = Plot(_title(summary, "Convergence")), method_styles(curves)
    for label, curve in curves.items():
        count = np.arange(1, len(curve) + 1)
        keep = curve > 0  # an exact frame has no place on a logarithmic axis
        plot.axes.plot(count[keep], np.sqrt(curve[keep]), linewidth=1.7, label=label, **styles[label].curve)
    first = max(float(curve[0]) for curve in curves.values() if len(curve))
    if first > 0:
        slope = {"color": "black", "linewidth": 0.9, "linestyle": ":", "label": "1 / sqrt(n)"}
        plot.axes.plot(count, np.sqrt(first / count), **slope)
    starts = ", ".join(str(frame) for frame in convergence["starts"])
    plot.axes.set(
        xscale="log", yscale="log", ylabel="RMS error, linear radiance",
        xlabel=f"frames, the first being frame {starts}",
    )  # fmt: skip
    plot.legend(plot.axes)
    return plot


def _response(summary: Summary) -> Plot | None:
    """Error over the frames since an event, a panel for each kind of event; no point for an exact frame."""
    methods = {label: m["response"] for label, m in valid_methods(summary).items() if m.get("response")}
    events = [name for name in summary.get("events", ()) if any(name in found for found in methods.values())]
    if not any(value > 0 for found in methods.values() for e in found.values() for value in e["curve"]):
        return None
    plot, styles = Plot("", 8.0, 1.0 + 2.6 * len(events), rows=len(events)), method_styles(methods)
    for axes, event in zip(plot.panels, events, strict=True):
        for label, found in methods.items():
            curve = np.array(found.get(event, {"curve": ()})["curve"], dtype=float)
            ages = np.flatnonzero(curve > 0)
            axes.plot(ages, curve[ages], linewidth=1.7, label=label, **styles[label].curve)
        axes.set(yscale="log", ylabel="squared error, linear radiance", xlabel="frames since the event")
        plot.title(axes, _title(summary, f"Response, {event.replace('_', ' ')}"))
    plot.legend(plot.axes)
    return plot


def _equal_cost(summary: Summary, unit: str) -> Plot | None:
    """Error at equal cost: the mean of n independent runs costs n times as much and has a variance of 1 / n.

    ``unit``: of the cost, shadow rays or time; no curve for a method without it.
    """
    curves = {}
    for label, method in valid_methods(summary).items():
        rays = ((method.get("samples") or {}).get("per_pixel") or {}).get("shadow_rays")
        cost, parts = rays if "rays" in unit else method["time_ms"], method.get("error_parts")
        if cost and parts and parts["variance"]["mean"] > 0:
            curves[label] = cost, max(parts["bias_squared"]["mean"], 0.0), parts["variance"]["mean"]
    if not curves:
        return None
    plot, styles = Plot(_title(summary, "Mean of independent runs at equal cost")), method_styles(curves)
    most = 100.0 * max(cost for cost, *_ in curves.values())
    for label, (cost, bias, variance) in curves.items():
        budget = np.geomspace(cost, most, 64)
        plot.axes.plot(budget, bias + variance * cost / budget, linewidth=1.7, label=label, **styles[label].curve)
    plot.axes.set(xscale="log", yscale="log", xlabel=unit, ylabel="squared error, linear radiance")
    plot.legend(plot.axes)
    return plot


def _title(summary: Summary, about: str) -> str:
    settings = summary["settings"]
    kind = summary["input"]["kind"].partition(":")[0]  # without the path of files
    return f"{about}: {summary['scene']['name']}, {settings['width']}x{settings['height']}, {kind} input"
