"""Plots of a run: discard rate by threshold, discard rate and camera motion over time, discard rate by camera speed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.features import COLUMNS, FEATURES
from taubench_gl.report.figures import as_title, column_style, legend_beside, new_figure, save_figure
from taubench_gl.report.palette import hex_of
from taubench_gl.report.tables import thresholds_of

Array = np.ndarray
Summary = Mapping[str, Any]


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
    curves = {name: curve for name in FEATURES if (curve := (summary.get("curves") or {}).get(name))}
    if not curves or not summary.get("pairs"):
        return []
    settings = summary["settings"]
    samples = settings.get("samples_per_pixel") or 1  # the counts are of samples
    pixels = summary["pairs"] * settings["width"] * settings["height"] * samples
    figure, axes = new_figure(7.5, 4.6)
    starts, ends, used_all = [], [], []
    for name, curve in curves.items():
        if not curve.get("counts"):
            continue
        thresholds, percent = discard_curve(curve, pixels)
        used = thresholds_of(summary).get(name)
        value = (summary.get("discard", {}).get(name) or {}).get("mean_percent")
        label = name if value is None else f"{name}: {value:.2f} % at {used:.3g}{' m' if name == 'position' else ''}"
        axes.plot(thresholds, percent, linewidth=2, label=label, **column_style(name))
        if used and value is not None:
            axes.plot([used], [value], "o", color=hex_of(name), markeredgecolor="black", markersize=7, zorder=5)
            used_all.append(used)
        # The axis spans the part of the curve that differs from both ends by half a percent of its height.
        falling = np.flatnonzero(np.abs(percent - percent[[0, -1], None]).min(axis=0) > 0.005 * percent[0])
        if len(falling):
            starts.append(thresholds[falling[0]])
            ends.append(thresholds[falling[-1]])
    for used in sorted(set(used_all)):
        axes.axvline(used, color="black", linewidth=0.8, alpha=0.4, zorder=0)
    low, high = min([1e-3, *starts, *used_all]), max([1.0, *ends, *used_all])
    axes.set(
        xscale="log", xlim=(low / 1.5, high * 1.5), xlabel="threshold, in the unit of the feature (position: meters)"
    )
    axes.set(ylabel="discarded, % of all pixels, mean", title=_title(summary, "Discard rate by threshold"))
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize=9, title="dots: thresholds of the run", title_fontsize=9)
    return save_figure(figure, Path(path))


def plot_frames(summary: Summary, frames: Sequence[Mapping[str, Any]], path: str | Path) -> list[Path]:
    """``frames_figure`` as files.

    -> the PNG and SVG file; none if there is no pair.  Raises OutputError.
    """
    return save_figure(frames_figure(summary, frames), Path(path)) if frames else []


def frames_figure(summary: Summary, frames: Sequence[Mapping[str, Any]]) -> Any:
    """The discard rate per pair, and below it the camera motion; cuts are vertical lines.  -> Matplotlib figure."""
    figure, (upper, lower) = new_figure(9.0, 5.6, rows=2, sharex=True, height_ratios=(3, 2))
    number = _column(frames, "frame")
    pixels = _column(frames, "pixels")
    marker = "o" if len(frames) == 1 else None
    for name in COLUMNS:
        percent = 100.0 * _column(frames, name) / np.where(pixels > 0, pixels, np.nan)
        if np.isfinite(percent).any():
            upper.plot(number, percent, linewidth=2, label=name, marker=marker, **column_style(name))
    upper.set(ylabel="discarded, % of all pixels", title=_title(summary, "Discard rate and camera motion per frame"))
    upper.set_ylim(bottom=0)
    turned, moved = _column(frames, "angle_deg"), _column(frames, "translation_m")
    style = {"linewidth": 1.4, "marker": marker}
    lower.plot(number, turned, color="black", label="rotation (left)", **style)
    lower.set(ylabel="rotation, degrees", xlabel="frame")
    lower.xaxis.get_major_locator().set_params(integer=True)
    lower.set_ylim(bottom=0)
    right = lower.twinx()
    right.spines["right"].set_visible(True)
    right.grid(False)
    right.plot(number, moved, color="#0072B2", linestyle="--", label="translation (right)", **style)
    right.set_ylabel("translation, m", color="#0072B2")
    right.set_ylim(bottom=0)
    cuts = (summary.get("camera") or {}).get("cuts") or []
    for axes in (upper, lower):
        for i, cut in enumerate(cuts):
            axes.axvline(cut, color="#882255", linewidth=1, linestyle=(0, (2, 2)), label=None if i else "cut")
    legend_beside(upper, x=1.09)
    legend_beside(lower, right, x=1.09)
    return figure


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
    figure, axes = new_figure(7.5, 4.6)
    speed = _column(rows, f"mean_{axis}_{unit}")
    for column in COLUMNS:
        percent = _column(rows, f"{column}_percent")
        if np.isfinite(percent).any():
            axes.plot(speed, percent, linewidth=2, marker="o", markersize=4, label=column, **column_style(column))
    sign = "°" if unit == "deg" else " m"
    within = [point for point in paper if point[1] <= 1.05 * np.nanmax(speed)]
    for (scene, at, percent), marker in zip(within, itertools.cycle("Ds^vPX")):
        style = {"color": "none", "markeredgecolor": hex_of("frustum"), "markersize": 7}
        axes.plot([at], [percent], marker, label=f"{scene}, {at:.3g}{sign}", **style)
    axes.set(xlabel=f"{axis} per frame, {sign.strip()}", ylabel="discarded, % of all pixels, mean")
    axes.set_title("Discard rate by camera speed: " + as_title(name))
    axes.set_ylim(bottom=0)
    legend_beside(axes, x=1.02, title="outlined: the paper's frustum" if within else None, title_fontsize=9)
    return save_figure(figure, Path(path))


def _column(frames: Sequence[Mapping[str, Any]], name: str) -> Array:
    """A column as (P,) float64, NaN where not measured."""
    return np.array([np.nan if row.get(name) is None else row[name] for row in frames], dtype=np.float64)


def _title(summary: Summary, what: str) -> str:
    settings = summary.get("settings") or {}
    name = as_title((summary.get("scene") or {}).get("name", ""))
    return f"{what}: {name}, {summary.get('pairs', 0)} pairs at {settings.get('fps', 0):g} fps"
