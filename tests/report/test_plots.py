"""Plots: values of the curves, and readable files."""

from __future__ import annotations

import itertools
import sys

import imageio.v3 as iio
import numpy as np
import pytest

from taubench_gl.conventions import HISTOGRAM_BINS
from taubench_gl.errors import OutputError
from taubench_gl.metrics.counts import bin_of, edges
from taubench_gl.report import plot_frames, plot_thresholds, run_plots, write_report
from taubench_gl.report.plot import spread
from taubench_gl.report.run_plots import discard_curve, frames_plot

pytestmark = pytest.mark.usefixtures("coarse_light", "plots")


def test_curve_is_the_share_of_distances_at_or_above_each_edge():
    distances = np.random.default_rng(1).lognormal(-2, 2, 5000)
    counts = np.bincount(bin_of(distances), minlength=HISTOGRAM_BINS)
    thresholds, percent = discard_curve({"edges": edges().tolist(), "counts": counts.tolist()}, 10_000)
    for i in (0, 50, 130, 200, len(thresholds) - 1):
        expected = 100.0 * np.count_nonzero(distances.astype(np.float32) >= np.float32(thresholds[i])) / 10_000
        assert percent[i] == pytest.approx(expected, abs=1e-9)
    assert np.all(np.diff(percent) <= 0)


def test_curve_raises_for_lengths_that_do_not_fit():
    with pytest.raises(ValueError):
        discard_curve({"edges": [1, 2, 3], "counts": [1, 2, 3]}, 1)


def test_plots_are_written_as_png_and_svg_without_pyplot(summary, frames, tmp_path):
    sys.modules.pop("matplotlib.pyplot", None)
    summary["camera"]["cuts"] = [3]
    files = plot_thresholds(summary, tmp_path / "thresholds") + plot_frames(summary, frames, tmp_path / "frames")
    assert [file.name for file in files] == ["thresholds.png", "thresholds.svg", "frames.png", "frames.svg"]
    for file in files:
        if file.suffix == ".png":
            image = iio.imread(file)[..., :3]
            assert image.shape[0] > 500 and np.std(image) > 5
        else:
            assert "<svg" in file.read_text(encoding="utf-8")
    assert "matplotlib.pyplot" not in sys.modules


def test_curve_is_relative_to_the_number_of_samples(summary, tmp_path):
    """Twice the counts of twice the samples give the same plot, to the byte."""
    first = plot_thresholds(summary, tmp_path / "a")[1].read_bytes()
    summary["settings"]["samples_per_pixel"] = 2
    for curve in filter(None, summary["curves"].values()):
        curve["counts"] = [2 * count for count in curve["counts"]]
    assert plot_thresholds(summary, tmp_path / "b")[1].read_bytes() == first


def test_no_file_without_values(summary, tmp_path):
    summary["curves"] = {}
    assert plot_thresholds(summary, tmp_path / "x") == []
    assert plot_frames(summary, [], tmp_path / "x") == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("moved", [0.0, 0.05])
def test_a_camera_of_constant_motion_is_two_lines_apart_from_the_axes(summary, frames, moved):
    """Rotation and translation are neither on the frame of the plot nor on each other."""
    rows = [dict(row, angle_deg=20 * moved, translation_m=moved) for row in frames]
    plot = frames_plot(summary, rows)
    places = []
    for axes in plot.figure.axes[1:]:
        line = axes.lines[0]
        low, high = axes.get_ylim()
        places.append((line.get_ydata()[0] - low) / (high - low))
    assert all(0.03 < place < 0.95 for place in places)
    assert moved == 0.0 or abs(places[0] - places[1]) > 0.05


def test_frames_plot_with_unmeasured_columns_and_one_pair(summary, frames, tmp_path):
    """The name of the scene is no formula."""
    summary["scene"]["name"] = r"$\frac{ 100 % $x_1$ <b>"
    row = frames[0] | dict.fromkeys(("color", "direct", "position", "translation_m", "angle_deg"))
    assert len(plot_frames(summary, [row], tmp_path / "frames")) == 2


def test_legend_of_a_sweep_is_outside_the_axes(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(run_plots.Plot, "save", lambda plot, path: drawn.append(plot.figure) or [])
    rows = [{"mean_yaw_deg": x, "frustum_percent": 2.0 * x, "color_percent": 3.0 * x} for x in (0.0, 4.0, 9.0)]
    paper = [("Slow", 0.3, 0.1), ("Fast", 8.2, 15.3), ("Beyond", 99.0, 50.0)]
    run_plots.plot_sweep(rows, "yaw", "deg", "walk", paper, tmp_path / "sweep")
    figure = drawn[0]
    figure.draw_without_rendering()
    axes = figure.axes[0]
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names[-2:] == ["Slow, 0.3°", "Fast, 8.2°"] and not axes.texts
    assert axes.get_legend().get_window_extent().x0 >= axes.get_window_extent().x1


def test_write_report_writes_tables_and_plots(summary, frames, tmp_path):
    files = {file.name for file in write_report(summary, frames, tmp_path / "out")}
    assert files == {file.name for file in (tmp_path / "out").iterdir()}
    assert {"tables.txt", "tables.md", "tables.csv", "tables.tex", "thresholds.svg", "frames.png"} <= files
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError) as caught:
        write_report(summary, frames, tmp_path / "file")
    assert caught.value.where == str(tmp_path / "file")


def test_labels_are_spread_as_little_as_possible():
    assert spread([0.0, 0.5, 1.0], 0.1) == pytest.approx([0.0, 0.5, 1.0])
    assert spread([0.5, 0.5, 0.5], 0.1) == pytest.approx([0.4, 0.5, 0.6])
    assert spread([0.1, 0.6, 0.62], 0.1) == pytest.approx([0.1, 0.56, 0.66])
    places = sorted(0.01 * (37 * i % 100) for i in range(20))
    found = spread(places, 0.04)
    assert min(b - a for a, b in itertools.pairwise(found)) >= 0.04 - 1e-12
    assert sum(found) == pytest.approx(sum(places))
    assert spread([], 0.1) == []
