"""Figures of the demos: panels, plots, letters and a legend on one sheet in a common style."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.demos.texts import BY_KEY, ColorBar, FigureText
from taubench_gl.glossary import label_of
from taubench_gl.metrics.color import display_color
from taubench_gl.outputs import write_atomically
from taubench_gl.report.mask_images import as_bytes, mask_overlay
from taubench_gl.report.palette import REASON_COLORS, RGB, SERIES_COLORS, color_of

if TYPE_CHECKING:
    from taubench_gl.demos.stage import LitPair

Array = np.ndarray

PAPER, INK = "#fbfaf7", "#1c1d21"
WIDTH = 1280
_DPI = 125  # layout units are 1/100 inch: a sheet is 1600 pixels wide
_PAD, _TITLE, _LEGEND, _BAR = 24, 34, 44, 58
BLUE, RED, BLACK, VIOLET = SERIES_COLORS
"""Measurement is blue, theory black."""


class Sheet:
    """A figure: ``columns`` x ``rows`` panels of one aspect ratio, above ``below`` units for plots.

    Lengths are in layout units, of which a sheet is WIDTH wide.

    ``bars``: leave room for a color bar below each panel.
    """

    def __init__(
        self, columns: int, rows: int, aspect: float, *, below: float = 0, legend: bool = True, bars: bool = False
    ):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._width = (WIDTH - _PAD * (columns + 1)) / columns
        self._height = self._width / aspect
        self._bar = _BAR if bars else 0
        gaps = _PAD * max(rows - 1, 0) * 0.5 + _PAD * 0.5
        self.grid_bottom = rows * (self._height + _TITLE + self._bar) + gaps if rows else 0
        self.legend_top = self.grid_bottom + below
        self.height = self.legend_top + (_LEGEND if legend else 0) + 0.5 * _PAD
        self._plots: dict[str, dict[str, Any]] = {}
        self._keys: list[tuple[Any, dict[str, Any]]] = []
        self._figure = Figure(figsize=(WIDTH / 100, self.height / 100), facecolor=PAPER)
        FigureCanvasAgg(self._figure)

    @classmethod
    def of(cls, figure: FigureText, size: tuple[int, int]) -> Sheet:
        """The sheet of a lesson with its legend.  ``size``: width and height of an image, in any unit."""
        width, height = figure.ratio or size
        legend, bar = bool(figure.legend), figure.bar
        sheet = cls(*figure.panels, width / height, below=figure.below, legend=legend, bars=bar is not None)
        sheet._plots = figure.plots
        if legend:
            rows = (reason_entries(BY_KEY[e])[0] if isinstance(e, str) else (e[0], rgb(e[1])) for e in figure.legend)
            sheet.legend(list(rows))
        if bar is not None:
            sheet._color_bar(bar)
        return sheet

    def axes(self, left: float, top: float, width: float, height: float) -> Any:
        """Add axes at a place from the top left of the sheet."""
        place = (left / WIDTH, 1 - (top + height) / self.height, width / WIDTH, height / self.height)
        return self._figure.add_axes(place)

    def plot(self, name: str, place: tuple[float, float, float, float] | None = None) -> Any:
        """Add the axes of a plot of the lesson's figure in the common style.  ``place``: instead of its own."""
        labels = dict(self._plots[name])
        left, top, width, height = labels.pop("place", (0.0, 0.0, 0.0, 0.0))
        axes = self.axes(*(place or (left, self.grid_bottom + top, width, height)))
        self._keys.append((axes, {"frameon": False, "fontsize": 12} | labels.pop("key")))
        axes.set_facecolor(PAPER)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
        axes.grid(alpha=0.25)
        axes.set(**labels)
        axes.tick_params(labelsize=11, colors=INK)
        for item in (axes.xaxis.label, axes.yaxis.label):
            item.set(fontsize=12.5, color=INK)
        axes.title.set(fontsize=13.5, color=INK)
        return axes

    def theory(self, axes: Any, x: Sequence[float], y: Sequence[float], label: str = "theory") -> None:
        """Add the line of a closed form to a plot."""
        axes.plot(x, y, color=BLACK, linewidth=2, label=label)

    def dots(self, axes: Any, x: Sequence[float], y: Sequence[float], label: str = "measured", **style: Any) -> None:
        """Add measured numbers to a plot."""
        dots = {"marker": "o", "linestyle": "", "markeredgecolor": "black", "markersize": 8}
        axes.plot(x, y, color=BLUE, label=label, **dots | style)

    def place(self, column: int, row: int) -> tuple[float, float, float, float]:
        """The place of a panel on the sheet: left, top, width and height."""
        left = _PAD + column * (self._width + _PAD)
        top = _TITLE + row * (self._height + _TITLE + self._bar + 0.5 * _PAD)
        return left, top, self._width, self._height

    def _color_bar(self, bar: ColorBar) -> None:
        """Add the color bar of ``heat`` below a panel of the first row."""
        import matplotlib

        left, top, width, height = self.place(bar.panel, 0)
        axes = self.axes(left, top + height + 10, 0.5 * width, 15)
        ramp = np.linspace(0.0, 1.0, 256)[None]
        axes.imshow(matplotlib.colormaps[bar.colors](ramp)[..., :3], extent=(0, 1, 0, 1), aspect="auto")
        axes.set(yticks=[], xticks=[place for place, _ in bar.ticks], xticklabels=[text for _, text in bar.ticks])
        axes.tick_params(labelsize=11, colors=INK, length=3)
        self.text(left + 0.5 * width + 16, top + height + 9, bar.label, size=12.5)

    def panel(self, column: int, row: int, image: Array, title: str = "", text: str = "") -> Any:
        """Add an image (h, w, 3), uint8 or float in [0, 1], below its title, with a note.  -> its axes, in pixels."""
        axes = self.axes(*self.place(column, row))
        image = as_bytes(image)
        # "auto" keeps strongly enlarged pixels sharp and resamples images near their own size smoothly.
        axes.imshow(image, interpolation="auto", aspect="auto")
        axes.set(xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set(color="#b9b6ae", linewidth=0.8)
        size = 13.5 if self._width > 380 else 11.5
        axes.set_title(title, fontsize=size, color=INK, loc="left", pad=6)
        if text:
            note(axes, text)
        return axes

    def legend(self, entries: Sequence[tuple[str, RGB]]) -> None:
        """Add a line of colors with their meaning at the bottom."""
        from matplotlib.patches import Rectangle

        axes = self.axes(0, self.legend_top, WIDTH, _LEGEND)
        axes.set(xlim=(0, WIDTH), ylim=(_LEGEND, 0))
        axes.axis("off")
        widths = [text_width(text, 13) + 34 for text, _ in entries]
        gap = min(44.0, (WIDTH - 2 * _PAD - sum(widths)) / max(len(entries) - 1, 1))
        x = float(_PAD)
        for (text, color), width in zip(entries, widths):
            shade = np.array(color) / 255.0
            axes.add_patch(Rectangle((x, 15), 20, 20, facecolor=shade, edgecolor="#7f8288", linewidth=0.8))
            axes.text(x + 28, 26, text, fontsize=13, color=INK, va="center")
            x += width + gap

    def text(self, left: float, top: float, text: str, *, size: float = 13, color: str = INK) -> None:
        """Add a line of text, ``size`` in points, whose top left corner is at a place of the sheet."""
        self._figure.text(left / WIDTH, 1 - top / self.height, text, fontsize=size, color=color, va="top")

    def save(self, path: Path) -> Path:
        """Write the sheet as PNG, whole or not at all.  Raises OutputError."""
        for axes, options in self._keys:
            axes.legend(**options)
        buffer = io.BytesIO()
        self._figure.savefig(buffer, dpi=_DPI, format="png", facecolor=PAPER)
        write_atomically(path, buffer.getvalue())
        return path


def text_width(text: str, size: float) -> float:
    """The width of ``text`` at ``size`` points, in layout units."""
    from matplotlib.textpath import TextPath

    return TextPath((0, 0), text, size=size).get_extents().width * 100 / 72


def letter(axes: Any, at: tuple[float, float], text: str) -> None:
    """Add a letter in a circle at a pixel (x, row) of a panel."""
    axes.text(
        *at, text, fontsize=14, fontweight="bold", color="white", ha="center", va="center",
        bbox={"boxstyle": "circle,pad=0.25", "facecolor": INK, "edgecolor": "white", "linewidth": 1.4},
    )  # fmt: skip


def arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], color: str = "white") -> None:
    """Add an arrow between two pixels (x, row) of a panel, with a dark outline for any background."""
    from matplotlib.patches import FancyArrow

    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    axes.add_patch(FancyArrow(
        *start, end[0] - start[0], end[1] - start[1], width=0.22 * length, head_width=0.62 * length,
        head_length=0.42 * length, length_includes_head=True, facecolor=color, edgecolor=INK, linewidth=1.6, zorder=6,
    ))  # fmt: skip


def note(axes: Any, text: str, *, at: tuple[float, float] = (0.02, 0.03), va: str = "bottom", ha: str = "left") -> None:
    """Add a line of text to a panel, at fractions of its size from the bottom left."""
    axes.text(
        *at, text, transform=axes.transAxes, fontsize=12, color="white", ha=ha, va=va,
        bbox={"boxstyle": "round,pad=0.35", "facecolor": INK, "edgecolor": "none", "alpha": 0.82},
    )  # fmt: skip


def inset(axes: Any, image: Array, title: str, *, part: float = 0.3) -> None:
    """Add a small image (h, w, 3) at the top left of a panel, ``part`` as wide as the panel, with a title below."""
    inner = axes.inset_axes((0.02, 0.97 - part, part, part))
    inner.imshow(image, interpolation="auto", aspect="auto")
    inner.set(xticks=[], yticks=[])
    for spine in inner.spines.values():
        spine.set(color="white", linewidth=1.6)
    note(axes, title, at=(0.02, 0.955 - part), va="top")


def overlay(mask: Array, base: Array | None, *reasons: Reason) -> Array:
    """Mask colors over a gray image, as in the mask images of ``evaluate``.  (h, w, 3) uint8."""
    return mask_overlay(mask, base, reasons)


def painted(base: Array, *layers: tuple[Array, RGB], strength: float = 0.8) -> Array:
    """Colors over a gray image: ``layers`` of (h, w) bool and color, later ones on top.  (h, w, 3) uint8."""
    gray = mask_overlay(np.zeros(base.shape[:2], np.uint32), base, ()).astype(np.float64)
    for where, color in layers:
        gray[where] = (1 - strength) * gray[where] + strength * np.array(color, dtype=np.float64)
    return np.round(gray).astype(np.uint8)


def checkerboard(image: Array, where: Array, cell: int) -> Array:
    """``image`` with a checkerboard of ``cell`` pixels in the region ``where``, as in the paper's figure 1."""
    rows, columns = np.indices(where.shape)
    light = ((rows // cell + columns // cell) % 2).astype(bool)
    out = np.array(image, dtype=np.float64)
    out[where] = np.where(light[where][:, None], 0.93, 0.62)
    return out


def reason_entries(*reasons: Reason) -> list[tuple[str, RGB]]:
    """The legend entries of mask colors: label and 8-bit sRGB of each reason."""
    return [(label_of(reason), color_of(reason)) for reason in reasons]


def rgb(color: Reason | str) -> RGB:
    """The 8-bit sRGB color of a reason, or of a text ``#rrggbb``."""
    return tuple(bytes.fromhex(color[1:])) if isinstance(color, str) else REASON_COLORS[color]  # type: ignore


def gray_image(pair: LitPair) -> Array:
    """The current image in gray, as below mask colors.  (h, w, 3) uint8."""
    return overlay(np.zeros_like(pair.mask), pair.now["color"])


def displayed(radiance: Array) -> Array:
    """Linear radiance (h, w, 3) as a display color, without exposure.  (h, w, 3) in [0, 1]."""
    return display_color(np.maximum(radiance.astype(np.float64), 0.0))


def heat(values: Array, top: float, colors: str = "viridis") -> Array:
    """(h, w) in [0, top] through a color map, NaN as light gray.  (h, w, 3) float."""
    import matplotlib

    shown = matplotlib.colormaps[colors](np.clip(np.nan_to_num(values) / top, 0, 1))[..., :3]
    return np.where(np.isnan(values)[..., None], 0.86, shown)


def enlarged(image: Array, left: int, top: int, width: int, height: int) -> Array:
    """The part of an image (h, w, ...) with its top left pixel at (``left``, ``top``), for an enlarged panel."""
    return image[top : top + height, left : left + width]


def magnified(image: Array) -> Array:
    """``image`` (h, w, ...) at four times its width and height."""
    return image.repeat(4, axis=0).repeat(4, axis=1)


def scaled_to(image: Array, shape: tuple[int, int]) -> Array:
    """``image`` (h, w, 3) resampled with its nearest pixels to ``shape`` = (height, width)."""
    rows, columns = (np.arange(n) * m // n for n, m in zip(shape, image.shape[:2]))
    return image[rows][:, columns]


def enlarged_frames(pair: LitPair, *part: int) -> tuple[Array, Array]:
    """A part, as of ``enlarged``, of the previous and of the current image of a pair.  (h, w, 3) uint8 each."""
    before, now = (as_bytes(enlarged(frame["color"][..., :3], *part)) for frame in (pair.before, pair.now))
    return before, now


def frame_of(left: int, top: int, width: int, height: int) -> Any:
    """The outline of a part of an image, as of ``enlarged``, for the panel of the whole image."""
    from matplotlib.patches import Rectangle

    return Rectangle((left, top), width, height, fill=False, edgecolor="white", linewidth=1.6)
