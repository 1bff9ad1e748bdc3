"""Plots of a run: discard against threshold, and discard and camera motion over time.  Matplotlib without a screen."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import COLUMNS, FEATURES
from taubench_gl.outputs import cannot_write, plain_text
from taubench_gl.report.palette import hex_of
from taubench_gl.report.tables import length_unit, thresholds_shown

Array = np.ndarray
Summary = Mapping[str, Any]

DASHES = {"frustum": "-", "color": "--", "position": "-", "normal": "-.", "direct": "-", "indirect": ":"}
_STYLE = {"axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.alpha": 0.25, "font.size": 10}


def discard_curve(curve: Mapping[str, Any], pixels: int) -> tuple[Array, Array]:
    """Thresholds and percentage of ``pixels`` discarded at each, from a histogram of distances.

    ``curve`` holds ``edges`` (B-1,), the boundaries between bins, and ``counts`` (B,), summed over all pairs.  Returns
    two (B-1,) float64 arrays; the percentage never rises.  Raises ValueError if the lengths do not fit.
    """
    edges, counts = np.asarray(curve["edges"], np.float64), np.asarray(curve["counts"], np.float64)
    if len(counts) != len(edges) + 1:
        raise ValueError(f"{len(counts)} counts and {len(edges)} edges, expected one count more than edges")
    above = np.cumsum(counts[::-1])[::-1][1:]
    return edges, 100.0 * above / max(pixels, 1)


def plot_thresholds(summary: Summary, path: str | Path) -> list[Path]:
    """Discard-versus-threshold curve of every measured feature, the thresholds used marked.  Writes PNG and SVG.

    Returns the files written, none where the run recorded no curve.  Raises OutputError.
    """
    curves = {name: curve for name in FEATURES if (curve := (summary.get("curves") or {}).get(name))}
    if not curves or not summary.get("pairs"):
        return []
    settings = summary["settings"]
    samples = settings.get("samples_per_pixel") or 1  # every sample of a pixel was counted
    pixels = summary["pairs"] * settings["width"] * settings["height"] * samples
    figure, axes = _figure(7.5, 4.6)
    starts, ends, used_all = [], [], []
    for name, curve in curves.items():
        if not curve.get("counts"):
            continue
        thresholds, percent = discard_curve(curve, pixels)
        if name == "position":
            thresholds = thresholds / length_unit(summary)
        used = thresholds_shown(summary).get(name)
        value = (summary.get("discard", {}).get(name) or {}).get("mean_percent")
        label = name if value is None else f"{name}: {value:.2f} % at {used:.3g}{' m' if name == 'position' else ''}"
        axes.plot(thresholds, percent, linewidth=2, label=label, **_line(name))
        if used and value is not None:
            axes.plot([used], [value], "o", color=hex_of(name), markeredgecolor="black", markersize=7, zorder=5)
            used_all.append(used)
        # Where the curve has left its plateau, to half a percent of it: the flat ends say nothing.
        falling = np.flatnonzero(np.abs(percent - percent[[0, -1], None]).min(axis=0) > 0.005 * percent[0])
        if len(falling):
            starts.append(thresholds[falling[0]])
            ends.append(thresholds[falling[-1]])
    for used in sorted(set(used_all)):
        axes.axvline(used, color="black", linewidth=0.8, alpha=0.4, zorder=0)
    low, high = min([1e-3, *starts, *used_all]), max([1.0, *ends, *used_all])
    axes.set(xscale="log", xlim=(low / 1.5, high * 1.5), xlabel="threshold, in the feature's unit (position: metres)")
    axes.set(ylabel="discarded, % of w·h, mean", title=_title(summary, "Discard against threshold"))
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize=9, title="marked: the threshold used", title_fontsize=9)
    return _save(figure, Path(path))


def plot_frames(summary: Summary, frames: Sequence[Mapping[str, Any]], path: str | Path) -> list[Path]:
    """Percentage discarded per pair above, camera motion below, cuts marked.  Writes PNG and SVG.

    Returns the files written, none where there is no pair.  Raises OutputError.
    """
    if not frames:
        return []
    figure, (upper, lower) = _figure(9.0, 5.6, rows=2)
    number = _column(frames, "frame")
    pixels = _column(frames, "pixels")
    marker = "o" if len(frames) == 1 else None
    for name in COLUMNS:
        percent = 100.0 * _column(frames, name) / np.where(pixels > 0, pixels, np.nan)
        if np.isfinite(percent).any():
            upper.plot(number, percent, linewidth=2, label=name, marker=marker, **_line(name))
    upper.set(ylabel="discarded, % of w·h", title=_title(summary, "Discard and camera motion per frame"))
    upper.set_ylim(bottom=0)
    turned, moved = _column(frames, "angle_deg"), _column(frames, "translation_m")
    look = {"linewidth": 1.4, "marker": marker}
    lower.plot(number, turned, color="black", label="rotation (left)", **look)
    lower.set(ylabel="rotation, degrees", xlabel="frame")
    lower.set_ylim(bottom=0)
    metres = lower.twinx()
    metres.spines["right"].set_visible(True)
    metres.grid(False)
    metres.plot(number, moved, color="#0072B2", linestyle="--", label="translation (right)", **look)
    metres.set_ylabel("translation, m", color="#0072B2")
    metres.set_ylim(bottom=0)
    cuts = (summary.get("camera") or {}).get("cuts") or []
    for axes in (upper, lower):
        for i, cut in enumerate(cuts):
            axes.axvline(cut, color="#882255", linewidth=1, linestyle=(0, (2, 2)), label=None if i else "cut")
    for axes, more in ((upper, ()), (lower, (metres,))):
        lines = [handles for each in (axes, *more) for handles in zip(*each.get_legend_handles_labels(), strict=True)]
        if lines:
            place = {"loc": "upper left", "bbox_to_anchor": (1.09, 1.0), "frameon": False, "fontsize": 9}
            axes.legend(*zip(*lines, strict=True), **place)
    return _save(figure, Path(path))


def plot_sweep(
    rows: Sequence[Mapping[str, Any]],
    axis: str,
    unit: str,
    name: str,
    paper: Sequence[tuple[str, float, float]],
    path: str | Path,
) -> list[Path]:
    """Percentage discarded against camera speed, a line per column; the paper's scenes are points of their frustum.

    ``rows`` hold ``mean_{axis}_{unit}`` and ``{column}_percent``; ``paper`` holds (scene, speed, frustum percent), of
    which those within reach of the rows are drawn.  Writes PNG and SVG and returns both.  Raises OutputError.
    """
    figure, axes = _figure(7.5, 4.6)
    speed = _column(rows, f"mean_{axis}_{unit}")
    for column in COLUMNS:
        percent = _column(rows, f"{column}_percent")
        if np.isfinite(percent).any():
            axes.plot(speed, percent, linewidth=2, marker="o", markersize=4, label=column, **_line(column))
    sign = "°" if unit == "deg" else " m"
    within = [point for point in paper if point[1] <= 1.05 * np.nanmax(speed)]
    for (scene, at, percent), marker in zip(within, itertools.cycle("Ds^vPX")):
        look = {"color": "none", "markeredgecolor": hex_of("frustum"), "markersize": 7}
        axes.plot([at], [percent], marker, label=f"{scene}, {at:.3g}{sign}", **look)
    axes.set(xlabel=f"{axis} per frame, {sign.strip()}", ylabel="discarded, % of w·h, mean")
    axes.set_title("Discard against camera speed: " + name.replace("$", r"\$"))
    axes.set_ylim(bottom=0)
    if axes.get_legend_handles_labels()[0]:
        # Beside the plot: in it names would lie on the curves.
        place = {"loc": "upper left", "bbox_to_anchor": (1.02, 1.0), "frameon": False, "fontsize": 9}
        axes.legend(title="outlined: the paper's frustum" if within else None, title_fontsize=9, **place)
    return _save(figure, Path(path))


def _figure(width: float, height: float, rows: int = 1) -> tuple[Any, Any]:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # Without pyplot: nothing global is left behind, and no display is looked for.
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        heights = {"height_ratios": (3, 2)} if rows == 2 else None
        return figure, figure.subplots(rows, 1, sharex=True, gridspec_kw=heights)


def _line(name: str) -> dict[str, Any]:
    """Look of a column's line, the colour that its pixels have in mask pictures."""
    from matplotlib import patheffects

    look: dict[str, Any] = {"color": hex_of(name), "linestyle": DASHES[name]}
    if name == "direct":  # yellow on white needs an edge to be seen
        look["path_effects"] = [patheffects.withStroke(linewidth=3.4, foreground="#6b6300")]
    return look


def _save(figure: Any, path: Path) -> list[Path]:
    files = [path.with_suffix(".png"), path.with_suffix(".svg")]
    import matplotlib
    from matplotlib.text import Text

    for text in figure.findobj(Text):  # names of files may hold what no font renderer takes
        if (plain := plain_text(text.get_text())) != text.get_text():
            text.set_text(plain)
    # No date and no random names in the SVG: the same run gives the same bytes.
    try:
        with matplotlib.rc_context({"svg.hashsalt": "taubench-gl"}):
            for file in files:
                figure.savefig(file, dpi=150, metadata={"Date": None} if file.suffix == ".svg" else None)
    except OSError as error:
        raise cannot_write(path, error) from None
    return files


def _column(frames: Sequence[Mapping[str, Any]], name: str) -> Array:
    """A column as (P,) float64, NaN where not measured."""
    return np.array([np.nan if row.get(name) is None else row[name] for row in frames], dtype=np.float64)


def _title(summary: Summary, what: str) -> str:
    settings = summary.get("settings") or {}
    # A lone dollar sign in a scene's name would start a formula.
    name = str((summary.get("scene") or {}).get("name", "")).replace("$", r"\$")
    return f"{what}: {name}, {summary.get('pairs', 0)} pairs at {settings.get('fps', 0):g} fps"
