"""Matplotlib plots in one style, written as PNG and SVG: all plots of the package."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import MethodType
from typing import Any

from taubench_gl.features import TABLE
from taubench_gl.outputs import plain_text, write_atomically
from taubench_gl.report.palette import hex_of

DASHES = {"frustum": "-"} | {feature.name: feature.dash for feature in TABLE}
"""Line style of each column of Table 4, also in the HTML report."""
_STYLE = {"axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.alpha": 0.25, "font.size": 10}


class Plot:
    """A figure of panels with one title, legends beside them, and no state outside it.

    ``axes``: the Matplotlib axes of the first panel, ``panels``: of all, row by row.
    """

    def __init__(
        self,
        title: str,
        width: float = 7.5,
        height: float = 4.6,
        rows: int = 1,
        columns: int = 1,
        *,
        shared_x: Sequence[float] = (),
    ):
        """``width`` x ``height`` inches.  ``shared_x``: relative heights of panels that share their x axis."""
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        # Without pyplot, which keeps global state and looks for a display.
        with matplotlib.rc_context(_STYLE):
            self.figure = Figure(figsize=(width, height), layout="constrained")
            FigureCanvasAgg(self.figure)
            self.figure._repr_png_ = MethodType(_png_of, self.figure)  # notebooks show figures of pyplot only
            shared = {"sharex": True, "height_ratios": shared_x} if shared_x else {}
            self.panels = list(self.figure.subplots(rows, columns, squeeze=False, **shared).flat)
        self.axes = self.panels[0]
        self.title(self.axes, title)

    def title(self, axes: Any, text: str) -> None:
        """Title of a panel."""
        axes.set_title(as_title(text), loc="left", fontsize=11)

    def legend(self, axes: Any, *others: Any, x: float = 1.01, title: str | None = None) -> None:
        """The legend of ``axes`` and ``others`` right of ``axes``, at ``x`` of its width; none without labels."""
        entries = [entry for each in (axes, *others) for entry in zip(*each.get_legend_handles_labels(), strict=True)]
        if entries:
            place = {"loc": "upper left", "bbox_to_anchor": (x, 1.0), "frameon": False, "fontsize": 9}
            axes.legend(*zip(*entries, strict=True), title=title, title_fontsize=9, **place)

    def save(self, path: Path) -> list[Path]:
        """Write ``path`` with the suffixes .png and .svg.  -> both files.  Raises OutputError.

        The SVG holds no date and no random identifiers: the same run gives the same bytes.
        """
        import matplotlib
        from matplotlib.text import Text

        for text in self.figure.findobj(Text):  # file names may hold bytes that are not UTF-8
            if (plain := plain_text(text.get_text())) != text.get_text():
                text.set_text(plain)
        files = [path.with_suffix(".png"), path.with_suffix(".svg")]
        # One layout for both files, which savefig would make by drawing each of them twice.
        self.figure.set_dpi(150)
        if (engine := self.figure.get_layout_engine()) is not None:
            engine.execute(self.figure)
        self.figure.set_layout_engine(None)
        with matplotlib.rc_context({"svg.hashsalt": "taubench-gl"}):
            for file in files:
                data, form = io.BytesIO(), file.suffix.removeprefix(".")
                self.figure.savefig(data, format=form, dpi=150, metadata={"Date": None} if form == "svg" else None)
                write_atomically(file, data.getvalue())
        return files


def _png_of(figure: Any) -> bytes:
    """A figure as the bytes of a PNG file."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=100)
    return data.getvalue()


def column_style(name: str) -> dict[str, Any]:
    """Line properties of a column of Table 4: its color in mask images, and its dashes."""
    from matplotlib import patheffects

    style: dict[str, Any] = {"color": hex_of(name), "linestyle": DASHES[name]}
    if name == "direct":  # yellow on white needs an outline
        style["path_effects"] = [patheffects.withStroke(linewidth=3.4, foreground="#6b6300")]
    return style


def label_ends(axes: Any, lines: Sequence[Any], size: float = 8) -> None:
    """Labels of ``lines`` right of ``axes``, each at the height of the end of its line, or as near as there is room.

    The limits of y are fixed: call it last.
    """
    figure = axes.figure
    low, high = axes.get_ylim()
    axes.set_ylim(low, high)
    height = figure.get_size_inches()[1] * 0.8 / max(len(figure.axes), 1)
    step = 1.35 * size / 72.0 / height
    ends = sorted(((line.get_ydata()[-1] - low) / (high - low), i) for i, line in enumerate(lines))
    for (_, i), at in zip(ends, spread([end for end, _ in ends], step), strict=True):
        line, end = lines[i], (lines[i].get_ydata()[-1] - low) / (high - low)
        color, place = line.get_color(), {"transform": axes.transAxes, "clip_on": False}
        axes.plot([1.005, 1.04], [end, at], color=color, linewidth=0.6, **place)
        dashes = {"color": color, "linestyle": line.get_linestyle(), "linewidth": 1.5}
        mark = {"marker": line.get_marker(), "markerfacecolor": line.get_markerfacecolor(), "markersize": 3.5}
        axes.plot([1.045, 1.07, 1.095], [at] * 3, markevery=[1], **dashes, **mark, **place)
        axes.text(1.105, at, as_title(line.get_label()), fontsize=size, va="center", transform=axes.transAxes)


def spread(places: Sequence[float], step: float) -> list[float]:
    """Ascending ``places`` moved as little as possible (least squares) so that neighbors are ``step`` apart."""
    groups: list[list[float]] = []  # sum of wanted first places, number of members
    for i, place in enumerate(places):
        groups.append([place - i * step, 1])
        while len(groups) > 1 and groups[-2][0] / groups[-2][1] > groups[-1][0] / groups[-1][1]:
            total, count = groups.pop()
            groups[-1] = [groups[-1][0] + total, groups[-1][1] + count]
    out: list[float] = []
    for total, count in groups:
        out += [total / count + (len(out) + k) * step for k in range(int(count))]
    return out


def as_title(text: Any) -> str:
    """``text`` for a title: a lone dollar sign would start a formula."""
    return str(text).replace("$", r"\$")


def pareto_steps(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """The Pareto front: points (time, error) with a smaller error than every faster point, fastest first."""
    out: list[tuple[float, float]] = []
    for time, error in sorted(points):
        if not out or error < out[-1][1]:
            out.append((time, error))
    return out
