"""UpSet plot (Lex et al. 2014) of the reasons of a run: which of them occur together, and in how many pixels.

Drawn by marsilea, which is an extra, as an SVG element for an HTML page.
"""

from __future__ import annotations

import importlib.util
import io
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.metrics.reuse_rate import combinations
from taubench_gl.report.reusable import TERMS, joined

Summary = Mapping[str, Any]

MOST = 15
"""Combinations in a plot, the largest ones."""
MISSING = "The UpSet plot of the reasons needs marsilea: pip install 'taubench-gl[upset]'"
_INK = "#1a1a1a"


@dataclass(frozen=True, slots=True)
class UpsetPlot:
    """``svg``: the element, None where there is no plot; ``text``: what it shows, or why there is none."""

    svg: str | None
    text: str


def upset_plot(summary: Summary, name: str = "upset") -> UpsetPlot:
    """The plot of the pixels that are not reusable, % of all pixels of all pairs.

    ``name`` begins the identifiers in the SVG, which must be unique in a page.
    """
    histogram, block = summary.get("mask_histogram") or {}, summary.get("reusable") or {}
    rate = block.get("reasons_of")
    if rate is None or not histogram.get("words"):
        why = (block.get("surface") or {}).get("reason") or "not recorded"
        return UpsetPlot(None, f"No plot of the reasons: {why}.")
    total = sum(histogram["pixels"])
    found = [(names, 100.0 * pixels / total) for names, pixels in combinations(histogram, rate)]
    if not found:
        return UpsetPlot(None, "Every pixel is reusable.")
    if len({name for names, _ in found for name in names}) == 1:
        return UpsetPlot(None, f"The only reason is {joined(found[0][0])}, {found[0][1]:.2f} % of all pixels.")
    text = _text(found)
    if importlib.util.find_spec("marsilea") is None:
        return UpsetPlot(None, f"{MISSING}. {text}")
    return UpsetPlot(_element(_draw(found), name, text), text)


def _text(found: Sequence[tuple[tuple[str, ...], float]]) -> str:
    """The largest combinations in words, and the sum of those that are not in the plot."""
    listed = ", ".join(f"{joined(names)} {share:.2f} %" for names, share in found[:5])
    text = f"Reasons that occur together, % of all pixels: {listed}"
    rest = found[MOST:]
    if rest:
        text += f"; {len(rest)} more combinations, {sum(share for _, share in rest):.2f} % in all, are not in the plot"
    return text + "."


def _draw(found: Sequence[tuple[tuple[str, ...], float]]) -> str:
    """SVG file of the MOST largest combinations, from all of them and their shares in %, the largest first."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pandas announces changes that concern marsilea
        from marsilea.plotter import Numbers
        from marsilea.upset import Upset, UpsetData

        shown = found[:MOST]
        used = [name for name in TERMS if any(name in names for names, _ in shown)]
        labels = [TERMS[name].label for name in used]
        member = [tuple(name in names for name in used) for names, _ in shown]
        # marsilea counts items.  These give the order only: the k-th largest combination has n - k items.
        items = [row for k, row in enumerate(member) for _ in range(len(shown) - k)]
        data = UpsetData(np.array(items), sets_names=labels, items=list(range(len(items))))
        plot = Upset(
            data, sets_order=labels, sort_subsets="-cardinality", color=_INK, radius=42, fontsize=10,
            add_intersections=False, add_sets_size=False, add_labels="left",  # the side that narrow screens show first
        )  # fmt: skip
        shares = dict(zip(member, (share for _, share in shown), strict=True))
        order = [tuple(map(bool, key)) for key in plot.subset_order]
        style = {"color": _INK, "fmt": lambda value: f"{value:.2f}", "props": {"fontsize": 8}}
        heights = np.array([shares[key] for key in order])
        plot.add_top(Numbers(heights, label="% of all pixels", **style), size=1.6, pad=0.1)
        sums = [sum(share for names, share in found if name in names) for name in used]
        plot.add_left(Numbers(np.array(sums), label="in all, %", **style), size=1.0, pad=0.1)
        figure, out = Figure(), io.BytesIO()
        FigureCanvasAgg(figure)  # marsilea measures its texts
        with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "taubench-gl"}):
            plot.render(figure=figure)
            figure.savefig(out, format="svg", bbox_inches="tight", transparent=True, metadata={"Date": None})
    return out.getvalue().decode("utf-8")


def _element(file: str, name: str, text: str) -> str:
    """The SVG file as an element of a page, in the color of its text, with a text alternative and no style sheet."""
    from markupsafe import escape

    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', file)
    body = file[file.index(">", box.end()) + 1 :]
    body = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{name}-', body)
    body = re.sub(r"((?:xlink:)?href=\"#|url\(#)", rf"\g<1>{name}-", body)
    body = body.replace(_INK, "currentColor").replace("#000000", "currentColor")
    head = (
        f'<svg class="upset" role="img" aria-label="{escape(text)}" viewBox="0 0 {box[1]} {box[2]}" '
        f'style="max-width:{float(box[1]):.0f}pt;stroke-linejoin:round;stroke-linecap:butt" fill="currentColor">'
    )
    return head + body.strip()
