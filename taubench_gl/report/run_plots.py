"""Plots of a run: discard rate by threshold, discard rate and camera motion over time, discard rate by camera speed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.features import COLUMNS, FEATURES
from taubench_gl.report.palette import REASON_COLORS, SERIES_COLORS, hex_of
from taubench_gl.report.paper import thresholds_of
from taubench_gl.report.plot import Plot, column_style

Array = np.ndarray
Summary = Mapping[str, Any]
OF_ALL = "discarded, % of all pixels, mean"


def discard_curve(curve: Mapping[str, Any], pixels: int) -> tuple[Array, Array]:
    """Thresholds, and the percentage of ``pixels`` discarded at each, from a histogram of distances.

    ``curve`` holds ``edges`` (B-1,), the boundaries between bins, and ``counts`` (B,), summed over all pairs.  -> two
    (B-1,) float64 arrays; the percentage never rises.  Raises ValueError if the lengths differ otherwise.
    """
    edges, counts = np.asarray(curve["edges"], np.float64), np.asarray(curve["counts"], np.float64)
    if len(counts) != len(edges) + 1:
        raise ValueError(f"{len(counts)} counts and {len(edges)} edges, expected one count more than edges")
    above = np.cumsum(counts[::-1])[::-1][1:]
    return edges, 100.0 * above / max(pixels, 1)


def plot_thresholds(summary: Summary, path: str | Path) -> list[Path]:
    """The discard-versus-threshold curve of every measured feature, with the thresholds of the run.

    -> the PNG and SVG file; none if the run recorded no curve.  Raises OutputError.
    """
    recorded = summary.get("curves") or {}
    curves = {name: recorded[name] for name in FEATURES if (recorded.get(name) or {}).get("counts")}
    if not curves or not summary.get("pairs"):
        return []
    settings = summary["settings"]
    samples = settings.get("samples_per_pixel") or 1  # the counts are of samples
    pixels = summary["pairs"] * settings["width"] * settings["height"] * samples
    plot = Plot(_title(summary, "Discard rate by threshold"), width=9.0)
    ends, marked = [1e-3, 1.0], set()
    for name, curve in curves.items():
        thresholds, percent = discard_curve(curve, pixels)
        used = thresholds_of(summary).get(name)
        value = (summary.get("discard", {}).get(name) or {}).get("mean_percent")
        label = name if value is None else f"{name}: {value:.2f} % at {used:.3g}{' m' if name == 'position' else ''}"
        plot.axes.plot(thresholds, percent, linewidth=2, label=label, **column_style(name))
        if used and value is not None:
            plot.axes.plot([used], [value], "o", color=hex_of(name), markeredgecolor="black", markersize=7, zorder=5)
            marked.add(used)
        # The axis spans the part of the curve that differs from both ends by half a percent of its height.
        falling = np.flatnonzero(np.abs(percent - percent[[0, -1], None]).min(axis=0) > 0.005 * percent[0])
        ends += thresholds[falling[[0, -1]]].tolist() if len(falling) else []
    for used in sorted(marked):
        plot.axes.axvline(used, color="black", linewidth=0.8, alpha=0.4, zorder=0)
    ends += marked
    plot.axes.set(
        xscale="log", xlim=(min(ends) / 1.5, max(ends) * 1.5), ylim=(0, None), ylabel=OF_ALL,
        xlabel="threshold, in the unit of the feature (position: meters)",
    )  # fmt: skip
    plot.legend(plot.axes, title="dots: thresholds of the run")
    return plot.save(Path(path))


def plot_frames(summary: Summary, frames: Sequence[Mapping[str, Any]], path: str | Path) -> list[Path]:
    """``frames_plot`` as files.

    -> the PNG and SVG file; none if there is no pair.  Raises OutputError.
    """
    return frames_plot(summary, frames).save(Path(path)) if frames else []


def frames_plot(summary: Summary, frames: Sequence[Mapping[str, Any]]) -> Plot:
    """The discard rate per pair, and below it the camera motion; cuts are vertical lines."""
    title = _title(summary, "Discard rate and camera motion per frame")
    plot = Plot(title, 9.0, 5.6, rows=2, shared_x=(3, 2))
    upper, lower = plot.panels
    number = _column(frames, "frame")
    pixels = _column(frames, "pixels")
    marker = "o" if len(frames) == 1 else None
    for name in COLUMNS:
        percent = 100.0 * _column(frames, name) / np.where(pixels > 0, pixels, np.nan)
        if np.isfinite(percent).any():
            upper.plot(number, percent, linewidth=2, label=name, marker=marker, **column_style(name))
    upper.set(ylabel="discarded, % of all pixels", ylim=(0, None))
    style = {"linewidth": 1.4, "marker": marker}
    turned, moves = _column(frames, "angle_deg"), _column(frames, "translation_m")
    lower.plot(number, turned, color="black", label="rotation (left)", **style)
    lower.set(ylabel="rotation, degrees", xlabel="frame", ylim=_limits(turned, 1.1))
    lower.xaxis.get_major_locator().set_params(integer=True)
    right = lower.twinx()
    right.spines["right"].set_visible(True)
    right.grid(False)
    moved = {"color": SERIES_COLORS[0], "linestyle": "--", "label": "translation (right)"}
    right.plot(number, moves, **moved, **style)
    right.set_ylabel("translation, m", color=moved["color"])
    right.set_ylim(_limits(moves, 1.35))
    for axes in plot.panels:
        for i, cut in enumerate((summary.get("camera") or {}).get("cuts") or []):
            axes.axvline(
                cut,
                color=hex_of(REASON_COLORS[Reason.CUT]),
                linewidth=1,
                linestyle=(0, (2, 2)),
                label=None if i else "cut",
            )
    plot.legend(upper, x=1.09)
    plot.legend(lower, right, x=1.09)
    return plot


def plot_sweep(
    rows: Sequence[Mapping[str, Any]],
    axis: str,
    unit: str,
    name: str,
    paper: Sequence[tuple[str, float, float]],
    path: str | Path,
) -> list[Path]:
    """The discard rate by camera speed, one line per column, and the frustum column of the paper's scenes as points.

    ``rows`` hold ``mean_{axis}_{unit}`` and ``{column}_percent``; ``paper`` holds (scene, speed, frustum percent).
    Scenes beyond the speeds of ``rows`` are left out.  -> the PNG and SVG file.  Raises OutputError.
    """
    plot = Plot(f"Discard rate by camera speed: {name}")
    speed = _column(rows, f"mean_{axis}_{unit}")
    for column in COLUMNS:
        percent = _column(rows, f"{column}_percent")
        if np.isfinite(percent).any():
            plot.axes.plot(speed, percent, linewidth=2, marker="o", markersize=4, label=column, **column_style(column))
    sign = "°" if unit == "deg" else " m"
    within = [point for point in paper if point[1] <= 1.05 * np.nanmax(speed)]
    for (scene, at, percent), marker in zip(within, itertools.cycle("Ds^vPX")):
        style = {"color": "none", "markeredgecolor": hex_of("frustum"), "markersize": 7}
        plot.axes.plot([at], [percent], marker, label=f"{scene}, {at:.3g}{sign}", **style)
    plot.axes.set(xlabel=f"{axis} per frame, {sign.strip()}", ylabel=OF_ALL, ylim=(0, None))
    plot.legend(plot.axes, title="outlined: the paper's frustum" if within else None)
    return plot.save(Path(path))


def _limits(values: Array, room: float) -> tuple[float, float]:
    """Ends of an axis from 0 to ``room`` times the largest value, a little lower, so that a line at 0 is seen.

    Constant motion of a camera is a line below the top, and with another ``room`` not where that of the other axis is.
    """
    top = room * (float(np.nanmax(values, initial=0.0)) or 1.0)
    return -0.05 * top, top


def _column(frames: Sequence[Mapping[str, Any]], name: str) -> Array:
    """A column as (P,) float64, NaN where not measured."""
    return np.array([np.nan if row.get(name) is None else row[name] for row in frames], dtype=np.float64)


def _title(summary: Summary, about: str) -> str:
    settings = summary.get("settings") or {}
    name = (summary.get("scene") or {}).get("name", "")
    return f"{about}: {name}, {summary.get('pairs', 0)} pairs at {settings.get('fps', 0):g} fps"
