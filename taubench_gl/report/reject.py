"""Tables, plots and HTML page of rejection tests (schema ``taubench-gl/reject/1``)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.report.labels import lighting_text
from taubench_gl.report.method_styles import COLORS
from taubench_gl.report.page import Page, data_uri, picture, text_lines
from taubench_gl.report.plot import Plot
from taubench_gl.report.table import Column, Row, Table, to_html

Summary = Mapping[str, Any]

TRUTHS = {
    "visibility": "positive: the previous camera did not see the surface point (occluded or new)",
    "visibility_or_shading": "positive: the point was not seen, or its direct or indirect light changed past a "
    "threshold",
}
_COLUMNS = (
    Column("threshold", "", 4, "History is rejected above it; its unit is that of the test"),
    Column("precision", "", 3, "Of the rejected pixels, those that must be rejected"),
    Column("recall", "", 3, "Of the pixels that must be rejected, those that are; the rest are ghosts"),
    Column("false positives", "%", 2, "Of the pixels whose history is right, those that are rejected: reuse lost"),
    Column("rejected", "%", 2, "Of the scored pixels"),
    Column("area", "", 4, "Area under the ROC curve over all thresholds; 1 is perfect, 0.5 is chance"),
    Column("time", "ms", 3, "Median time of the pass"),
)
NO_PIXEL = "no such pixel"
NOT_TIMED = "not computed here, or not timed"
_LINES = ("-", "--", ":", "-.")


def reject_tables(summary: Summary) -> list[Table]:
    """Tables of scores by each truth, of confusion counts, then of precision and recall by stratum."""
    names = list(next(iter(summary["tests"].values()))["scores"])
    tables = [_scores(summary, i + 1, name) for i, name in enumerate(names)]
    tables.append(_confusion(summary))
    tables.append(_reasons(summary))
    strata = next(iter(summary["tests"].values()))["strata"]
    return tables + [_strata(summary, name) for name in strata if name != "reason"]


def _scores(summary: Summary, number: int, truth: str) -> Table:
    rows = []
    for name, test in summary["tests"].items():
        score, wrong = test["scores"][truth], test["scores"][truth]["false_positive_rate"]
        values = (
            test["threshold"], score["precision"], score["recall"], None if wrong is None else 100.0 * wrong,
            score["rejected_percent"], test["curves"][truth]["area"], test["milliseconds"],
        )  # fmt: skip
        why = [NO_PIXEL] * (len(values) - 1) + [NOT_TIMED]
        rows.append(Row(name, values, reasons={i: why[i] for i, value in enumerate(values) if value is None}))
    notes = reject_notes(summary) if number == 1 else ()
    title = f"Rejection tests against {truth.replace('_', ' ')}"
    return Table(number, title, _COLUMNS, tuple(rows), notes, lead=(f"{TRUTHS[truth]}.",))


def _confusion(summary: Summary) -> Table:
    keys = ("true_positive", "false_positive", "false_negative", "true_negative")
    columns = tuple(Column(key.replace("_", " "), "pixels") for key in keys)
    rows = tuple(Row(name, tuple(t["scores"][t["truth"]][key] for key in keys)) for name, t in summary["tests"].items())
    return Table("confusion", "Pixels of all pairs at the threshold", columns, rows)


def _reasons(summary: Summary) -> Table:
    """What each test rejects of the pixels of a reason, and by how much its share is off the truth there."""
    tests = summary["tests"]
    first = next(iter(tests.values()))["strata"]["reason"]
    names = [name for name, entry in first.items() if entry["pixels"]]
    total = max(sum(entry["pixels"] for entry in first.values()), 1)
    columns = [c for name in names for c in (
        Column(f"{name.replace('_', ' ')}: rejected", "%", 2, f"of {first[name]['pixels']} pixels"),
        Column("net", "pp", 3, "Rejected less those that must be, in percent of all scored pixels"),
    )]  # fmt: skip
    rows = []
    for name, test in tests.items():
        blocks = [test["strata"]["reason"][reason] for reason in names]
        net = [100.0 * (b["false_positive"] - b["false_negative"]) / total for b in blocks]
        cells = [value for b, off in zip(blocks, net, strict=True) for value in (b["rejected_percent"], off)]
        rows.append(Row(name, (*cells, sum(net))))
    title = "What is rejected, by why history is wrong, and the net error"
    return Table("reasons", title, (*columns, Column("net error", "pp", 3, "Sum over the reasons")), tuple(rows))


def _strata(summary: Summary, stratum: str) -> Table:
    tests = summary["tests"]
    first = next(iter(tests.values()))["strata"][stratum]
    cells = [(label, key) for label, entry in first.items() if entry["pixels"] for key in ("precision", "recall")]
    columns = tuple(
        Column(f"{label}: {key[0].upper()}", "", 3, f"{key}, {first[label]['pixels']} pixels") for label, key in cells
    )
    rows = tuple(
        Row.of(name, [test["strata"][stratum][label][key] for label, key in cells], NO_PIXEL)
        for name, test in tests.items()
    )
    unit = (summary["strata"].get(stratum) or {}).get("unit")
    title = f"Precision (P) and recall (R) by {stratum}" + (f", {unit}" if unit else "")
    return Table(stratum, title, columns, rows)


def reject_notes(summary: Summary) -> tuple[str, ...]:
    """What was scored, and what stands apart."""
    settings, share = summary["settings"], summary["percent"]
    size = f"{settings['width']}x{settings['height']}"
    lines = [
        f"{size}, {summary['pairs']} pairs at {settings['fps']:g} fps, motion reprojection, nearest sampling.",
        f"Scored: {share['surface']:.2f} % of all pixels, surfaces inside the previous image. Apart: frustum "
        f"{share['frustum']:.2f} %, sky {share['sky']:.2f} %, not classified {share['not_classified']:.2f} %.",
        f"Times: {summary['clock']}.",
    ]
    changed, scored = summary.get("changed_shading"), max(summary["pixels"]["surface"], 1)
    if changed:
        parts = ", ".join(f"{name.replace('_', '-')} {100.0 * n / scored:.2f} %" for name, n in changed.items())
        lines.append(f"Visible points whose light changed, of the scored: {parts}.")
    lines += [f"{lighting_text(summary)}."] if lighting_text(summary) else []
    return tuple(lines)


def plot_reject(summary: Summary, folder: Path) -> list[Path]:
    """``roc`` and ``precision_recall`` as PNG and SVG; the marks are the thresholds.  Raises OutputError."""
    figures = {
        "roc": ("false_positive_rate", "recall", "ROC: recall against false positive rate"),
        "precision_recall": ("recall", "precision", "Precision against recall"),
    }
    files = []
    for file, (x, y, title) in figures.items():
        plot = Plot(f"{summary['scene']['name']}. {title}", 8.0, 5.0)
        for i, (name, test) in enumerate(summary["tests"].items()):
            curve, score = test["curves"][test["truth"]], test["scores"][test["truth"]]
            points = [(a, b) for a, b in zip(curve[x], curve[y], strict=True) if a is not None and b is not None]
            repeat, color = divmod(i, len(COLORS))
            style = {"color": COLORS[color], "linestyle": _LINES[repeat % len(_LINES)]}
            plot.axes.plot(*np.array(points).reshape(-1, 2).T, linewidth=1.6, label=name, **style)
            if None not in (score[x], score[y]):
                plot.axes.plot([score[x]], [score[y]], "o", color=COLORS[color], markersize=5)
        plot.axes.set(xlabel=x.replace("_", " "), ylabel=y.replace("_", " "), ylim=(-0.02, 1.02))
        if x == "false_positive_rate":
            plot.axes.set_xscale("symlog", linthresh=1e-3)
            plot.axes.set_xlim(0, 1)
        plot.legend(plot.axes)
        files += plot.save(folder / f"{file}.png")
    return files


def reject_html(summary: Summary, images: Mapping[str, bytes]) -> str:
    """The page of an evaluation of rejection tests, one file of HTML.  ``images``: title -> PNG."""
    name = summary["scene"]["name"]
    page = Page(f"{name}: rejection tests", heading=name, intro=(text_lines(reject_notes(summary)),))
    for title, data in images.items():
        page.add(title.replace(" ", "-"), "", picture(data_uri(data), title), label=title)
    page.add("tables", "Tables", to_html(reject_tables(summary), scroll=True))
    return page.html()
