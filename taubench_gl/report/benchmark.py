"""Tables, plot and HTML page of a benchmark (schema ``taubench-gl/benchmark/1``)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.report.figures import as_title, label_ends, new_figure, save_figure
from taubench_gl.report.method_styles import method_styles
from taubench_gl.report.page import data_uri, render_page
from taubench_gl.report.render import to_html
from taubench_gl.report.tables import Column, Row, Table

Summary = Mapping[str, Any]

SHOWN = {
    "flip": ("FLIP", 4), "psnr_db": ("PSNR", 2), "relmse_trimmed": ("relMSE trimmed", 4), "flicker": ("flicker", 4),
}  # fmt: skip
"""Measures of the rankings: title and digits."""

UNITS = {"rotation": "deg/frame", "translation": "m/frame", "light_speed": "m/frame", "object_speed": "m/frame"}
AXES = {
    "rotation": "rotation of the camera", "translation": "speed of the camera",
    "light_speed": "speed of the lights", "object_speed": "speed of the objects",
}  # fmt: skip
PLOT_NAME = "speeds"
FINE = 16
"""Points of a plotted line between two steps."""


def benchmark_tables(summary: Summary) -> list[Table]:
    """Rankings by track, speeds, FLIP by difficulty and by pixel class, and the cases."""
    return [table for tables in benchmark_sections(summary).values() for table in tables]


def benchmark_sections(summary: Summary) -> dict[str, list[Table]]:
    """``benchmark_tables`` by section of the page: ``ranks speeds classes cases``."""
    tracks = summary["rankings"]
    found = {
        "ranks": [_ranking(summary, track, rankings) for track, rankings in tracks.items() if rankings],
        "speeds": [_speeds(summary)] if summary["speeds"] else [],
        "classes": [_split(summary, track, block) for block in ("levels", "classes") for track in tracks],
        "cases": [_cases(summary)],
    }
    numbers = itertools.count(1)
    return {
        name: [Table(next(numbers), t.title, t.columns, t.rows, t.notes) for t in tables if t.rows]
        for name, tables in found.items()
    }


def ranks(entry: Summary) -> str:
    """``2``, ``2-5`` or ``-``: the ranks that the data allow."""
    first, last = entry["rank"], entry["last_rank"]
    return "-" if first is None else str(first) if first == last else f"{first}-{last}"


def _ranking(summary: Summary, track: str, rankings: Summary) -> Table:
    """The scorecard of a track, in the order of its first measure."""
    names = list(rankings)
    columns: list[Column] = []
    for name in names:
        title, digits = SHOWN[name]
        measure = summary["measures"][name]
        columns.append(Column("rank", "", None, f"ranks by {title} that the intervals allow"))
        columns.append(Column(title, measure["unit"], digits, f"{measure['doc']}; {measure['better']} is better"))
    columns.append(Column("headroom", "dB", 2, "error over that of the best blend of the method's own history"))
    columns += [Column("time", "ms", 2, "median per frame"), Column("memory", "MiB", 2, "textures of the method")]
    by_label = {name: {e["method"]: e for e in rankings[name]["ranking"]} for name in names}
    rows = []
    for label in [entry["method"] for entry in rankings[names[0]]["ranking"]] + list(rankings[names[0]]["not_ranked"]):
        entries = [by_label[name].get(label) for name in names]
        state = summary["methods"][label]["tracks"][track]
        means = state.get("mean", {})
        cells: list[Any] = []
        for name, entry in zip(names, entries, strict=True):
            cells += [None if entry is None else ranks(entry), means.get(name)]
        memory = summary["methods"][label]["memory_bytes"]
        cells += [state.get("headroom_db"), summary["times"]["methods"][label][track],
                  None if memory is None else memory / 2**20]  # fmt: skip
        first = entries[0]
        why = rankings[names[0]]["not_ranked"].get(label) if first is None else first["reason"]
        rows.append(Row(label, tuple(cells), reasons={0: why} if why else {}))
    found = rankings[names[0]]
    over = f"paired by {found['over'][:-1]}, {found['count']} {found['over']}" if found["over"] else found["reason"]
    note = (
        "2-4: the 95 % intervals of the differences between methods allow each of these ranks (Student's t, "
        f"{over}; Holm's correction for all pairs of a measure)." if found["over"] else f"No ranks: {over}."
    )  # fmt: skip
    first = f"Order: by mean {SHOWN[names[0]][0]}, except methods that failed or are not ranked."
    return Table(0, f"{track}: scorecard ({_contents(summary, track)})", tuple(columns), tuple(rows), (first, note))


def _contents(summary: Summary, track: str) -> str:
    """``12 cases, input noisy@64``."""
    own = {name: case for name, case in summary["cases"].items() if case["track"] == track}
    cases = {case["sha256"]: name.rpartition("/")[2] for name, case in own.items()}
    return f"{len(cases)} case{'s' * (len(cases) != 1)}, input {' or '.join(dict.fromkeys(cases.values()))}"


def _split(summary: Summary, track: str, block: str) -> Table:
    """FLIP by difficulty level or by pixel class."""
    done = {
        label: m["tracks"][track] for label, m in summary["methods"].items() if m["tracks"][track]["state"] == "done"
    }
    rows, columns = [], ()
    if block == "levels":
        names = [n for n in summary["levels"] if any(n in state["levels"] for state in done.values())]
        columns = tuple(Column(n, "", 4, f"at most {summary['levels'][n]:g} % of the pixels discarded") for n in names)
        rows = [Row(label, tuple(s["levels"][n].get("flip") for n in names)) for label, s in done.items()]
        own = [case for case in summary["cases"].values() if case["track"] == track]
        count = {n: len({case["sha256"] for case in own if case["level"] == n}) for n in names}
        note = "; ".join(f"{n}: {count[n]} case{'s' * (count[n] != 1)}" for n in names)
        title = f"{track}: FLIP by difficulty of the case, the share of pixels without valid history"
    else:
        names = [n for n in summary["classes"] if any(s["classes"][n] is not None for s in done.values())]
        columns = tuple(Column(n, "", 4, summary["classes"][n]) for n in names)
        rows = [Row(label, tuple(s["classes"][n] for n in names)) for label, s in done.items()]
        note, title = "Masks of the exact frames; all cases of the track.", f"{track}: FLIP by pixel class"
    return Table(0, title, columns, tuple(rows) if names else (), (note,))


def crossing_text(curve: Summary) -> str | None:
    """``3.2 (2.5 to 4.1)``, ``> 16`` or ``never``."""
    found = curve["crossing"]
    if found is None:
        return None
    first, last = (curve["steps"][i]["value"] for i in (0, -1))
    beyond = f"> {last:g}"
    low, high = (beyond if found[end] is None else f"{found[end]:.3g}" for end in ("low", "high"))
    known = curve["steps"][0]["low"] is not None
    if found["speed"] is not None:
        text, alike = f"{found['speed']:.3g}", False
    elif found["verdict"].startswith("better"):
        text, alike = beyond, low == beyond
    else:
        text, alike = "never", found["high"] == first
    return f"{text} ({low} to {high})" if known and not alike else text


def _speeds(summary: Summary) -> Table:
    """The speed up to which a method is better than no reuse, by series and measure."""
    columns, found = [], []
    for name, series in summary["speeds"].items():
        for measure in [m for m in ("flip", "psnr_db") if m in series["measures"]]:
            columns.append(Column(f"{name}, {SHOWN[measure][0]}", UNITS[series["axis"]]))
            found.append(series["measures"][measure])
    labels = [label for label in summary["methods"] if any(label in curves for curves in found) and label != "none"]
    rows = [Row(label, tuple(crossing_text(c[label]) if label in c else None for c in found)) for label in labels]
    note = (
        "Speed at which a method stops being better than no reuse (none), and its 95 % interval over seeds; >: better "
        "within the whole range; never: not better at the first step. Linear between steps."
    )
    return Table(0, "Speed up to which reuse is better than none", tuple(columns), tuple(rows), (note,))


def _cases(summary: Summary) -> Table:
    columns = (
        Column("track"), Column("seeds"), Column("reference"), Column("discarded", "%", 1), Column("difficulty"),
        Column("scene"), Column("case"), Column("time", "s", 1),
    )  # fmt: skip
    rows = []
    for name, case in summary["cases"].items():
        reference = case["reference"] or {}
        text = f"{reference.get('kind')}, {reference.get('samples')}" if reference else None
        hashes = (case["scene_sha256"][:8], case["sha256"][:8])
        facts = (case["track"], case["seeds"], text, case["discarded_percent"], case["level"])
        rows.append(Row(name, (*facts, *hashes, summary["times"]["seconds"][name])))
    note = "scene and case: first digits of their hashes; cases of equal hashes are run once."
    return Table(0, "Cases", columns, tuple(rows), (note,))


def plot_speeds(summary: Summary, folder: Path) -> list[Path]:
    """``speeds``: FLIP over the speed of each series, as PNG and SVG.  Raises OutputError."""
    series = {n: s for n, s in summary["speeds"].items() if s["measures"].get("flip")}
    if not series:
        return []
    figure, grid = new_figure(10.0, 5.2 * len(series), rows=len(series), squeeze=False)
    styles = method_styles(summary["methods"])
    for axes, (name, one) in zip(grid[:, 0], series.items(), strict=True):
        values, lines = one["values"], []
        # Between steps the mean is linear in the speed, which is a curve on a logarithmic axis.
        dense = np.unique(np.concatenate([np.linspace(a, b, FINE + 1) for a, b in itertools.pairwise(values)]))
        for label, curve in one["measures"]["flip"].items():
            means = np.interp(dense, values, [step["mean"] for step in curve["steps"]])
            style = styles[label]
            # Wide lines below narrow ones, solid ones below dashed ones: equal curves are all seen.
            order = {"linewidth": 3.2, "zorder": 1.8} if label == "none" else {"zorder": 2 + 0.1 * (not style.filled)}
            marks = {"markevery": np.searchsorted(dense, values).tolist(), "markersize": 4}
            lines += axes.plot(dense, means, label=label, **{"linewidth": 1.5, **order}, **marks, **style.points)
            if curve["crossing"] and (speed := curve["crossing"]["speed"]) is not None:
                ring = {"markersize": 10, "markerfacecolor": "none", "color": style.color}
                axes.plot([speed], [np.interp(speed, dense, means)], "o", **ring)
        if len(values) > 2 and values[-1] > 8 * values[1]:
            axes.set_xscale("symlog", linthresh=values[1])
            axes.set_xticks(values, [f"{v:g}" for v in values])
            axes.minorticks_off()
        axes.set(xlabel=f"{AXES[one['axis']]}, {UNITS[one['axis']]}", ylabel="mean FLIP (lower is better)")
        scene, _, kind = name.split("/")
        axes.set_title(
            as_title(f"{AXES[one['axis']].capitalize()}: scene {scene}, input {kind}"), loc="left", fontsize=11
        )
        axes.margins(x=0.02)
        label_ends(axes, lines)
    return save_figure(figure, folder / f"{PLOT_NAME}.png")


def benchmark_html(summary: Summary, image: bytes | None = None) -> str:
    """The page: one file.  ``image``: the plot as PNG."""
    suite, made = summary["suite"], summary["provenance"]
    about = [
        f"Suite {suite['name']} ({suite['version']}, {suite['sha256'][:12]}): {suite['cases']} cases, "
        f"{len(summary['methods'])} methods.",
        f"taubench-gl {made.get('version')}, {made.get('renderer')} ({made.get('driver')}).",
    ]
    sections = {name: to_html(tables, scroll=True) for name, tables in benchmark_sections(summary).items() if tables}
    return render_page(
        "benchmark.html",
        title=f"Benchmark, suite {suite['name']}",
        answers=[(track, _best(summary, track)) for track, rankings in summary["rankings"].items() if rankings],
        failed=[(track, e["method"], e["reason"]) for track, e in _failed(summary)],
        about=about,
        image=None if image is None else data_uri(image),
        sections=sections,
    )


def _best(summary: Summary, track: str) -> str:
    """The methods that can be the best of a track, in words."""
    name, found = next(iter(summary["rankings"][track].items()))
    entries = [e for e in found["ranking"] if e["mean"] is not None]
    if not entries:
        return "no method has a value"
    title = SHOWN[name][0]
    if found["over"] is None:
        return f"best mean {title}: {entries[0]['method']}; no ranks: {found['reason']}"
    first = [entry["method"] for entry in entries if entry["rank"] == 1]
    if len(first) == 1:
        return f"best by {title}: {first[0]}"
    return f"best by {title}: {', '.join(first[:-1])} or {first[-1]}; the intervals allow each"


def _failed(summary: Summary) -> list[tuple[str, Summary]]:
    """Track and entry of the methods that failed."""
    found = (
        (track, next(iter(rankings.values()))["ranking"]) for track, rankings in summary["rankings"].items() if rankings
    )
    return [(track, entry) for track, ranking in found for entry in ranking if entry["reason"]]


def comparison_tables(compared: Summary, measures: Summary) -> list[Table]:
    """One table per measure of two benchmarks, rows by track and method."""
    names = [name for name in SHOWN if name in measures]
    tables = []
    for number, name in enumerate(names, start=1):
        title, digits = SHOWN[name]
        unit = measures[name]["unit"]
        columns = tuple(Column(c, unit, digits) for c in ("A", "B", "difference"))
        rows = []
        for row in compared["rows"]:
            values = row["measures"][name]
            why = "; ".join(f"{state}: {reason}" for state, reason in row["states"].items())
            cells = (values["a"], values["b"], values["difference"])
            rows.append(Row(f"{row['track']}: {row['method']}", cells, reasons={0: why} if why else {}))
        notes = tuple(f"{note}." for note in compared["notes"]) if number == 1 else ()
        tables.append(Table(number, f"{title} ({measures[name]['better']} is better)", columns, tuple(rows), notes))
    return tables
