"""Tables, plots and HTML page of a reuse evaluation (schema ``taubench-gl/reuse/3``) and of a parameter fit.

Files of schema 2 lack the bound, the seeds and some measures, and are read as far as they go.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.report.figures import SERIES_COLORS, as_title, legend_beside, new_figure, pareto_steps, save_figure
from taubench_gl.report.labels import lighting_text
from taubench_gl.report.method_styles import BLACK, method_styles
from taubench_gl.report.page import data_uri, render_page
from taubench_gl.report.render import to_html
from taubench_gl.report.reuse_frames import NO_IMAGES, ReuseImages
from taubench_gl.report.tables import Column, Row, Table

Summary = Mapping[str, Any]

_QUALITY = (
    ("psnr_db", Column("PSNR", "dB", 2)), ("ssim", Column("SSIM", "", 4)), ("flip", Column("FLIP", "", 4)),
    ("relmse", Column("relMSE", "", 5)), ("tpsnr_db", Column("tPSNR", "dB", 2)),
    ("flicker", Column("flicker", "", 5)),
)  # fmt: skip
_REUSE = (
    ("reused_percent", Column("reused", "%", 2)), ("mean_weight", Column("mean weight", "", 3)),
    ("effective_weight", Column("effective weight", "", 3)),
    ("wrongly_reused_percent", Column("wrongly reused", "%", 2)),
    ("wrongly_rejected_percent", Column("wrongly rejected", "%", 2)),
)  # fmt: skip
_BOUND = (
    ("method_linear_mse", Column("linear MSE", "", 6)), ("linear_mse", Column("bound", "", 6)),
    ("headroom_db", Column("headroom", "dB", 2)), ("weight", Column("weight of the bound", "", 3)),
    ("blended_percent", Column("blended", "%", 2)),
)  # fmt: skip
_FURTHER = {
    "relmse_trimmed": ("relMSE trimmed", 5), "flip_p50": ("FLIP p50", 4), "flip_p95": ("FLIP p95", 4),
    "flip_p99": ("FLIP p99", 4), "warp_error": ("warping error", 6), "hdr_flip": ("HDR-FLIP", 4), "lpips": ("LPIPS", 4),
    "cvvdp_jod": ("ColorVideoVDP", 3),
}  # fmt: skip
"""Measures of the last table: title and digits."""

_HEADLINES = ("flip", "psnr_db", "relmse")
"""Measures of the table of paired differences: the first that was measured."""

MOST_PAIRS = 15
"""Of more pairs, a table shows those with the best method."""

_BOUND_NOTE = (
    "Bound: the method's own reprojected history and input, blended by the weight of each pixel nearest to the "
    "reference. A method whose every pixel is a blend of the two cannot be better; others can."
)


def reuse_tables(summary: Summary) -> list[Table]:
    """Quality; reuse, time and memory; error by pixel class.  Failed methods are rows of dashes with the reason."""
    methods = summary["methods"]
    notes = reuse_notes(summary)
    quality = [_row(label, m, "mean", [n for n, _ in _QUALITY]) for label, m in methods.items()]
    columns = tuple(replace(c, definition=summary["measures"][n]["doc"]) for n, c in _QUALITY)
    tables = [Table(1, "Quality against the reference", columns, tuple(quality), notes)]
    columns = (*(c for _, c in _REUSE), Column("time", "ms", 3), Column("memory", "MiB", 2))
    rows = [_cost_row(label, m) for label, m in methods.items()]
    clock = f"Time: median over frames of the passes of the method; clock: {summary['clock']}; shading of the input: "
    shading = summary["input"]["shading_ms"]
    clock += "not measured." if shading is None else f"{shading:.2f} ms."
    tables.append(Table(2, "Reuse, time and memory", columns, tuple(rows), (clock, _class_source(summary))))
    tables.append(_class_table(summary))
    if any("bound" in m for m in methods.values()):  # schema 3
        rows = [_bound_row(label, m) for label, m in methods.items()]
        tables.append(Table(4, "Bound and headroom", tuple(c for _, c in _BOUND), tuple(rows), (_BOUND_NOTE,)))
    return tables + comparison_tables(summary) + _further_table(summary)


def _further_table(summary: Summary) -> list[Table]:
    """Measures that Table 1 has no room for, as far as a method has them."""
    methods = summary["methods"]
    found = [n for n in summary["measures"] if n not in dict(_QUALITY) and n in _FURTHER]
    names = [n for n in found if any(m.get("mean", {}).get(n) is not None for m in methods.values())]
    if not names:
        return []
    measures = summary["measures"]
    columns = tuple(Column(_FURTHER[n][0], measures[n]["unit"], _FURTHER[n][1], measures[n]["doc"]) for n in names)
    rows = [_row(label, method, "mean", names) for label, method in methods.items()]
    reference = summary["reference"].get("warp_error")
    notes = () if reference is None else (f"Warping error of the reference: {reference:.6f}.",)
    return [Table(6, "Further measures", columns, tuple(rows), notes)]


def comparison_tables(summary: Summary) -> list[Table]:
    """Paired differences of all methods and the ranking, by ``_HEADLINES``; none for one method or schema 2."""
    statistics = summary.get("statistics")
    name = next((n for n in _HEADLINES if statistics and n in statistics["measures"]), None)
    if name is None or not statistics["measures"][name]["differences"]:
        return []
    found, measure = statistics["measures"][name], summary["measures"][name]
    entries = found["differences"]
    few = len(entries) <= MOST_PAIRS
    best = found["ranking"][0]["method"]
    entries = entries if few else [entry for entry in entries if best in (entry["a"], entry["b"])]
    ends = ["difference", "low", "high"]
    seeds = all(entry["over_seeds"] for entry in entries)  # from five seeds on
    unit, digits = measure["unit"], 3 if measure["unit"] else 5
    names = [*ends, *(f"{end}, seeds" for end in ends[1:] if seeds)]
    columns = (*(Column(n, unit, digits) for n in names), Column("p (Holm)", "", 4))
    rows = []
    for entry in entries:
        values = [entry[end] for end in ends] + [entry["over_seeds"][end] for end in ends[1:] if seeds]
        rows.append(Row(f"{entry['a']} - {entry['b']}", (*values, entry["p_holm"]), reasons={0: entry["verdict"]}))
    notes = [_interval_text(statistics, found, seeds), *ranking_texts(summary)]
    notes += (
        [] if few else [f"Pairs with {best}, whose mean is best; reuse.json contains all {len(found['differences'])}."]
    )
    return [
        Table(5, f"Paired differences of {name} ({measure['better']} is better)", columns, tuple(rows), tuple(notes))
    ]


def _interval_text(statistics: Summary, found: Summary, seeds: bool) -> str:
    """How the intervals of a measure were computed, or why there are none."""
    if found["reason"] is not None:
        return f"No intervals: {found['reason']}."
    lengths = [entry["block_length"] for entry in found["differences"]]
    blocks = "-".join(str(n) for n in sorted({min(lengths), max(lengths)}))
    text = (
        f"{100 * statistics['confidence']:g} % intervals; {statistics['frames']} frames, seeds: {statistics['seeds']}; "
    )
    text += f"blocks of {blocks} frames; {statistics['rule']}."
    return text + (" Columns of seeds: Student's t over the means of the seeds." if seeds else "")


def ranking_texts(summary: Summary) -> list[str]:
    """A line for each measure of Table 1, ``FLIP: 1 svgf; 2-3 taa_clamp; 2-3 none``, in the order of the means.

    Measures disagree, so no single one names a best method.
    """
    measures = summary["statistics"]["measures"]
    titles = {name: column.name for name, column in _QUALITY if name in measures}
    known = any(entry["rank"] is not None for name in titles for entry in measures[name]["ranking"])
    meaning = "Ranks that remain possible after Holm's correction" if known else "Methods"
    lines = [f"{meaning}, from the best mean on; measures differ in what they count:"]
    for name, title in titles.items():
        lines.append(f"{title}: {'; '.join(_ranked(entry) for entry in measures[name]['ranking'])}.")
    return lines


def _ranked(entry: Summary) -> str:
    first, last = entry["rank"], entry["last_rank"]
    if first is None:
        return entry["method"]
    return f"{first if first == last else f'{first}-{last}'} {entry['method']}"


_SAME = ("sha256", "name")
_SAME_SETTINGS = ("width", "height", "fps", "first_frame", "last_frame", "exposure", "tone_map", "thresholds")


def merged_summaries(named: Sequence[tuple[str, Summary]]) -> list[Summary]:
    """Evaluations (name, reuse.json) of the same frames, input and reference as one, in the order of the first of each.

    A label that several of them have gets the name of its evaluation.
    """
    groups: dict[str, list[tuple[str, Summary]]] = {}
    for name, summary in named:
        groups.setdefault(repr(_identity(summary)), []).append((name, summary))
    merged = []
    for group in groups.values():
        labels = [label for _, summary in group for label in summary["methods"]]
        methods: dict[str, Any] = {}
        for name, summary in group:
            for label, method in summary["methods"].items():
                text = f"{name}: {label}" if labels.count(label) > 1 else label
                while text in methods:  # folders of one name
                    text += "'"
                methods[text] = method
        merged.append({**group[0][1], "methods": methods})
    return merged


def _identity(summary: Summary) -> tuple[Any, ...]:
    """What two evaluations must share so that their numbers are comparable."""
    given, reference, settings = summary["input"], summary["reference"], summary["settings"]
    return (
        [summary["scene"].get(key) for key in _SAME],
        [settings.get(key) for key in _SAME_SETTINGS],
        [given.get(key) for key in ("kind", "light_samples", "indirect_samples", "seed")],
        [reference.get(key) for key in ("kind", "samples", "path")],
        [summary.get(key) for key in ("seeds", "warmup", "clock")],
    )


def reuse_notes(summary: Summary) -> tuple[str, ...]:
    """The settings on which every number of the evaluation depends."""
    s, given, reference = summary["settings"], summary["input"], summary["reference"]
    kind = given["kind"]
    if given["light_samples"]:
        kind += f" ({given['light_samples']} lights, {given['indirect_samples']} VPLs, seed {given['seed']})"
    against = reference["path"] if reference["samples"] is None else f"{reference['samples']} samples per pixel"
    first = f"{summary['scene']['name']}: {s['width']}x{s['height']}, {s['fps']:g} fps, "
    first += f"means over frames {s['first_frame'] + summary.get('warmup', 1)} to {s['last_frame']} "
    seeds = len(summary.get("seeds", ()))
    first += f"(N = {summary['evaluated_frames']}{f', {seeds} seeds' if seeds > 1 else ''}); "
    text = lighting_text(summary)
    lighting = (f"{text}.",) if text else ()
    floor = (f"Noise floor, standard error of the reference: {reference['noise']}.",) if reference.get("noise") else ()
    return (f"{first}input: {kind}; reference: {reference['kind']}, {against}.", *floor, *lighting, *given["notes"])


def fit_table(fit: Summary) -> Table:
    """Every point that a fit evaluated."""
    names = list(fit["settings"])
    columns = tuple(Column(n, "", 6) for n in names) + (Column(fit["metric"], "", 6),)
    rows = []
    for i, point in enumerate(fit["points"], start=1):
        best = point["settings"] == fit["best"]["settings"]
        values = (*(_number(point["settings"][n]) for n in names), point["value"])
        reasons = {len(names): point["failed"] or "not measured"} if point["value"] is None else {}
        rows.append(Row(f"{i}{' (best)' if best else ''}", values, reasons=reasons))
    notes = (f"{fit['method']}: {fit['better']} is better.", *fit["notes"])
    return Table(1, f"{fit['metric']} by parameters of {fit['method']}", columns, tuple(rows), notes)


def _row(label: str, method: Summary, block: str, names: list[str]) -> Row:
    if method["failed"]:
        return Row(label, (None,) * len(names), reasons={0: method["failed"]})
    values = method[block]
    why = method["reasons"]
    reasons = {i: why.get(n, "not measured") for i, n in enumerate(names) if values.get(n) is None}
    return Row(label, tuple(values.get(n) for n in names), reasons=reasons)


def _bound_row(label: str, method: Summary) -> Row:
    if method["failed"] or method["bound"] is None:
        reason = method["failed"] or method["reasons"]["bound"]
        return Row(label, (None,) * len(_BOUND), reasons={0: reason})
    bound, why = method["bound"], method["reasons"]
    reasons = {i: why.get(f"bound.{n}", "not measured") for i, (n, _) in enumerate(_BOUND) if bound[n] is None}
    return Row(label, tuple(bound[n] for n, _ in _BOUND), reasons=reasons)


def _cost_row(label: str, method: Summary) -> Row:
    row = _row(label, method, "reuse", [n for n, _ in _REUSE])
    size = method["memory_bytes"]
    memory = None if size is None else size / 2**20
    return Row(label, (*row.values, method.get("time_ms"), memory), reasons=row.reasons)


def _class_table(summary: Summary) -> Table:
    good = {label: m for label, m in summary["methods"].items() if not m["failed"]}
    absent = [c for c in summary["classes"] if good and not any(m["classes"][c]["pixels"] for m in good.values())]
    classes = [c for c in summary["classes"] if c not in absent]
    columns = tuple(Column(name, "", 4, summary["classes"][name]) for name in classes)
    rows = []
    for label, method in good.items():
        measure = _class_measure(method)
        values = tuple(method["classes"][c].get(measure) for c in classes)
        rows.append(Row(label, values, reasons={i: "no such pixel" for i, v in enumerate(values) if v is None}))
    if good:
        first = next(iter(good.values()))["classes"]
        rows.append(Row("share of pixels, %", tuple(first[c]["percent"] for c in classes)))
    measure = _class_measure(next(iter(good.values()))) if good else "flip"
    meaning = "; ".join(f"{name}: {summary['classes'][name]}" for name in classes)
    notes = [f"{meaning}.", *([f"No pixels: {', '.join(absent)}."] if absent else []), _class_source(summary)]
    return Table(3, f"Mean {measure} by pixel class", columns, tuple(rows), tuple(notes))


def _class_measure(method: Summary) -> str:
    return "flip" if any("flip" in entry for entry in method["classes"].values()) else "relmse"


def _class_source(summary: Summary) -> str:
    if summary["mask_source"] == "exact":
        return "Wrongly reused, wrongly rejected and the pixel classes refer to the masks of the exact frames."
    return "The pixel classes refer to geometry alone, because there are no masks of exact frames."


def _number(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else value


# --------------------------------------------------------------------------------------------------------------- plots


def plot_reuse(summary: Summary, rows: Sequence[Mapping[str, Any]], folder: Path) -> list[Path]:
    """``frames classes time convergence`` as PNG and SVG, as far as there are values.  Raises OutputError."""
    valid = {label: m for label, m in summary["methods"].items() if not m["failed"]}
    if not valid:
        return []
    measure = "flip" if any(row["flip"] is not None for row in rows) else "relmse"
    written = _frames(summary, valid, rows, measure, folder / "frames.png")
    written += _classes(summary, valid, measure, folder / "classes.png")
    written += _time(summary, valid, measure, folder / "time.png")
    return written + _convergence(summary, folder / "convergence.png")


def plot_fit(fit: Summary, path: Path) -> list[Path]:
    """The error by one parameter, or as a map over two; no plot for more.  Raises OutputError."""
    names = list(fit["settings"])
    points = [p for p in fit["points"] if p["value"] is not None]
    if not points or len(names) > 2:
        return []
    axes_of = [np.array([float(p["settings"][n]) for p in points]) for n in names]
    values = np.array([p["value"] for p in points])
    figure, axes = new_figure(7.0, 4.4)
    scales = [fit["settings"][n]["scale"] for n in names]
    if len(names) == 1:
        order = np.argsort(axes_of[0])
        axes.plot(axes_of[0][order], values[order], "o-", color=SERIES_COLORS[0], linewidth=2)
        axes.set(xscale=scales[0], xlabel=names[0], ylabel=f"{fit['metric']} ({fit['better']} is better)")
    else:
        drawn = axes.scatter(*axes_of, c=values, s=120, cmap="viridis", edgecolors="black", linewidths=0.5)
        axes.set(xscale=scales[0], yscale=scales[1], xlabel=names[0], ylabel=names[1])
        figure.colorbar(drawn, label=f"{fit['metric']} ({fit['better']} is better)")
    best = [float(fit["best"]["settings"][n]) for n in names]
    if len(names) == 1:
        if fit["best"]["value"] is None:  # equal to the reference: infinite
            axes.axvline(best[0], color=SERIES_COLORS[1], label="best")
        else:
            axes.plot(best, [fit["best"]["value"]], "*", markersize=16, color=SERIES_COLORS[1], label="best", zorder=5)
        now = fit["default"]["settings"][names[0]]
        axes.axvline(float(now), color="black", linewidth=0.9, linestyle=":", label=f"default {now:g}")
        axes.legend(frameon=False)
    else:
        axes.plot(*([v] for v in best), "*", markersize=18, color=SERIES_COLORS[1], zorder=5)
    axes.set_title(as_title(f"{fit['method']}, {fit['scene']}"), loc="left", fontsize=11)
    return save_figure(figure, path)


def _frames(
    summary: Summary, valid: Summary, rows: Sequence[Mapping[str, Any]], measure: str, path: Path
) -> list[Path]:
    figure, (upper, lower) = new_figure(9.0, 6.0, rows=2, sharex=True, height_ratios=(3, 2))
    styles = method_styles(valid)
    for label in valid:
        own = [row for row in rows if row["method"] == label]
        numbers = sorted({row["frame"] for row in own})
        for axes, name in ((upper, measure), (lower, "flicker")):
            means = [_mean_over_seeds(own, frame, name) for frame in numbers]
            values = [np.nan if value is None else value for value in means]
            if np.isfinite(values).any():
                axes.plot(numbers, values, linewidth=1.7, label=label, **styles[label].curve)
    upper.set(ylabel=f"{measure} (lower is better)")
    upper.set_title(_title(summary, "Error per frame"), loc="left", fontsize=11)
    lower.set(ylabel="flicker (lower is better)", xlabel="frame")
    for axes in (upper, lower):
        axes.set_ylim(bottom=0)
    legend_beside(upper)
    return save_figure(figure, path)


def _classes(summary: Summary, valid: Summary, measure: str, path: Path) -> list[Path]:
    first = next(iter(valid.values()))["classes"]
    names = [name for name in summary["classes"] if first[name]["pixels"]]
    if not names or any(measure not in m["classes"][n] for m in valid.values() for n in names):
        return []
    figure, axes = new_figure(max(8.0, 1.1 * len(names) + 0.12 * len(names) * len(valid)), 4.6)
    width, styles = 0.85 / len(valid), method_styles(valid)
    for index, (label, method) in enumerate(valid.items()):
        at = np.arange(len(names)) + (index - 0.5 * (len(valid) - 1)) * width
        values, bar = [method["classes"][n][measure] for n in names], styles[label].bar
        axes.bar(at, values, width, label=label, **bar)
    axes.set_xticks(range(len(names)), [f"{n}\n{first[n]['percent']:.1f} %" for n in names])
    axes.set(ylabel=f"mean {measure} (lower is better)")
    axes.set_title(_title(summary, "Error by pixel class, and share of the class"), loc="left", fontsize=11)
    legend_beside(axes)
    return save_figure(figure, path)


def _time(summary: Summary, valid: Summary, measure: str, path: Path) -> list[Path]:
    timed = {label: m for label, m in valid.items() if m["time_ms"] and m["mean"][measure] is not None}
    if not timed:
        return []
    figure, axes = new_figure(7.5, 4.6)
    styles = method_styles(timed)
    for label, method in timed.items():
        at = method["time_ms"], method["mean"][measure]
        axes.plot(*([v] for v in at), label=label, markersize=8, **{**styles[label].points, "linestyle": ""})
    front = pareto_steps([(m["time_ms"], m["mean"][measure]) for m in timed.values()])
    axes.step(*zip(*front, strict=True), where="post", color="black", linewidth=1.2, zorder=0, label="Pareto front")
    axes.set(xscale="log", xlabel=f"ms per frame, median ({summary['clock']})", ylabel=f"{measure} (lower is better)")
    axes.margins(x=0.1, y=0.1)
    axes.set_ylim(bottom=0)
    legend_beside(axes)
    axes.set_title(_title(summary, "Error against time"), loc="left", fontsize=11)
    return save_figure(figure, path)


def _convergence(summary: Summary, path: Path) -> list[Path]:
    """Error by the number of frames since the first frame or a cut; a line of slope -1/2 is that of a running mean."""
    if not summary.get("statistics"):
        return []
    found = summary["statistics"]["convergence"]
    curves = {label: np.array(curve, dtype=float) for label, curve in found["methods"].items()}
    if not any(len(curve) > 1 and (curve > 0).any() for curve in curves.values()):
        return []
    figure, axes = new_figure(7.5, 4.6)
    styles = method_styles(curves)
    for label, curve in curves.items():
        count = np.arange(1, len(curve) + 1)
        keep = curve > 0  # an exact frame has no place on a logarithmic axis
        axes.plot(count[keep], np.sqrt(curve[keep]), linewidth=1.7, label=label, **styles[label].curve)
    first = max(float(curve[0]) for curve in curves.values() if len(curve))
    if first > 0:
        slope = {"color": "black", "linewidth": 0.9, "linestyle": ":"}
        axes.plot(count, np.sqrt(first / count), label="1 / sqrt(n)", **slope)
    starts = ", ".join(str(frame) for frame in found["starts"])
    axes.set(
        xscale="log",
        yscale="log",
        xlabel=f"frames, the first being frame {starts}",
        ylabel="RMS error, linear radiance",
    )
    legend_beside(axes)
    axes.set_title(_title(summary, "Convergence"), loc="left", fontsize=11)
    return save_figure(figure, path)


def _title(summary: Summary, what: str) -> str:
    s = summary["settings"]
    kind = summary["input"]["kind"].partition(":")[0]  # without the path of files
    name = as_title(summary["scene"]["name"])
    return f"{what}: {name}, {s['width']}x{s['height']}, {kind} input"


# ---------------------------------------------------------------------------------------------------------------- page


def reuse_html(
    summary: Summary,
    rows: Sequence[Mapping[str, Any]],
    image: bytes | None = None,
    images: ReuseImages | None = None,
) -> str:
    """The page of an evaluation, templates/reuse.html.

    ``rows``: frames.csv, one per frame and method; ``image``: a PNG of the methods side by side on the worst frame, for
    a page without ``images``.
    """
    methods = summary["methods"]
    images = images or ReuseImages(None, NO_IMAGES)
    data = _page_data(summary, rows)
    if images.data is not None:
        data |= {"images": images.data, "viewer": _viewer_data(summary, rows, images.text)}
    return render_page(
        "reuse.html",
        styles=("stage.css", "reuse.css"),
        scripts=("stage.js", "reuse_viewer.js", "reuse.js"),
        data=data,
        title=summary["scene"]["name"],
        notes=reuse_notes(summary),
        failed=[(label, method["failed"]) for label, method in methods.items() if method["failed"]],
        image=None if image is None or images.data is not None else data_uri(image),
        images=images.data is not None,
        images_text=images.text,
        tables=to_html(reuse_tables(summary), scroll=True),
    )


def _viewer_data(summary: Summary, rows: Sequence[Mapping[str, Any]], text: str) -> dict[str, Any]:
    """What the viewer needs beside the images; it plays at the frame rate of the evaluation, at most 15 per second."""
    return {
        "classes": [{"name": name, "doc": doc} for name, doc in summary["classes"].items()],
        "error": "FLIP" if any(row["flip"] is not None for row in rows) else "4 |error|",
        "milliseconds": 1e3 / min(summary["settings"]["fps"], 15.0),
        "text": text,
        "warmup": summary.get("warmup", 1),  # evaluations of schema 2 leave out the first frame
    }


def _mean_over_seeds(rows: Sequence[Mapping[str, Any]], frame: int, name: str) -> float | None:
    values = [row[name] for row in rows if row["frame"] == frame and row[name] is not None]
    return float(np.mean(values)) if values else None


def _page_data(summary: Summary, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Values of reuse.js: measures with values, frames, and of each method its rows by measure in order of frames.

    Rows of several seeds are averaged.
    """
    frames = sorted({row["frame"] for row in rows})
    measures = [name for name in summary["measures"] if any(row[name] is not None for row in rows)]
    methods = []
    valid = {label: method for label, method in summary["methods"].items() if not method["failed"]}
    styles = method_styles(valid)
    for label, method in valid.items():
        own = [row for row in rows if row["method"] == label]
        # Black is the color of the text: it shows on a dark page.
        color = "currentColor" if styles[label].color == BLACK else styles[label].color
        style = {"color": color, "dash": styles[label].line}
        values = {name: [_mean_over_seeds(own, frame, name) for frame in frames] for name in measures}
        methods.append(
            style | {"label": label, "rows": values, "mean": method["mean"], "time_ms": method.get("time_ms")}
        )
    return {
        "frames": frames,
        "measures": [{"name": name, **summary["measures"][name]} for name in measures],
        "methods": methods,
        "clock": summary["clock"],
    }
