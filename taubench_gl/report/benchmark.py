"""Tables, plot and HTML page of a benchmark (schema ``taubench-gl/benchmark/1``)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.report.light_samples import mean_samples
from taubench_gl.report.method_styles import method_styles
from taubench_gl.report.page import Page, bullets, data_uri, picture, tag, text_lines
from taubench_gl.report.plot import Plot, label_ends
from taubench_gl.report.reuse import GENERATED, GENERATED_NOTE, class_label, mean_response, ranks
from taubench_gl.report.table import Column, Row, Table, to_html

Summary = Mapping[str, Any]

SHOWN = {
    "flip": ("FLIP", 4), "psnr_db": ("PSNR", 2), "relmse_trimmed": ("relMSE trimmed", 4),
    "clipped_mse": ("clipped MSE", 5), "flicker": ("flicker", 4),
}  # fmt: skip
"""Measure of the rankings -> its title and number of decimals."""

_ABOUT = "error over that of the best blend of the method's own history"
_OF_TRACK = {
    "headroom_db": Column("headroom", "dB", 2, _ABOUT),
    "clipped_headroom_db": Column("headroom clipped", "dB", 2, _ABOUT),
    **GENERATED,
}  # fmt: skip
"""Means that some tracks have -> their columns."""

AXES = {
    "rotation": ("rotation of the camera", "deg/frame"), "translation": ("speed of the camera", "m/frame"),
    "light_speed": ("speed of the lights", "m/frame"), "object_speed": ("speed of the objects", "m/frame"),
    "camera_path_speed": ("speed of the recorded camera", "times"),
}  # fmt: skip
"""Axis of a series -> what changes, and its unit."""

PLOT_NAME = "speeds"
FINE = 16
"""Number of points of a plotted line between two steps."""


def benchmark_tables(summary: Summary) -> list[Table]:
    """Tables of rankings by track, of speeds, of FLIP by difficulty and by pixel class, and of the cases."""
    return [table for tables in benchmark_sections(summary).values() for table in tables]


def benchmark_sections(summary: Summary) -> dict[str, list[Table]]:
    """``benchmark_tables`` by section of the page: ``ranks speeds classes samples response cases``."""
    tracks = summary["rankings"]
    sections = {
        "ranks": [_ranking(summary, track, rankings) for track, rankings in tracks.items() if rankings],
        "speeds": [_speeds(summary)] if summary["speeds"] else [],
        "classes": [*(_levels(summary, track) for track in tracks), *(_classes(summary, track) for track in tracks)],
        "samples": [mean_samples(summary)],
        "response": [mean_response(summary)],
        "cases": [_cases(summary)],
    }
    numbers = itertools.count(1)
    return {
        name: [replace(table, number=next(numbers)) for table in tables if table.rows]
        for name, tables in sections.items()
    }


def _ranking(summary: Summary, track: str, rankings: Summary) -> Table:
    """The scorecard of a track, in the order of its first measure."""
    columns: list[Column] = []
    for name in rankings:
        title, digits = SHOWN[name]
        measure = summary["measures"][name]
        columns.append(Column("rank", "", None, f"ranks by {title} that the intervals allow"))
        columns.append(Column(title, measure["unit"], digits, f"{measure['doc']}; {measure['better']} is better"))
    of_track = [n for n in _OF_TRACK if any(n in m["tracks"][track] for m in summary["methods"].values())]
    columns += [_OF_TRACK[name] for name in of_track]
    columns += [Column("time", "ms", 2, "median per frame"), Column("memory", "MiB", 2, "textures of the method")]
    by_label = [{entry["method"]: entry for entry in ranking["ranking"]} for ranking in rankings.values()]
    leading_measure, leading = next(iter(rankings.items()))
    rows, absent = [], {}
    for label in [*by_label[0], *leading["not_ranked"]]:
        method, entries = summary["methods"][label], [entries.get(label) for entries in by_label]
        state, memory = method["tracks"][track], method["memory_bytes"]
        if state["state"] == "not applicable":
            absent.setdefault(state["reason"], []).append(label)
            continue
        cells: list[Any] = []
        for name, entry in zip(rankings, entries, strict=True):
            cells += [None if entry is None else ranks(entry), state.get("mean", {}).get(name)]
        cells += [*map(state.get, of_track), summary["times"]["methods"][label][track],
                  None if memory is None else memory / 2**20]  # fmt: skip
        why = leading["not_ranked"].get(label) if entries[0] is None else entries[0]["reason"]
        rows.append(Row(label, tuple(cells), reasons={0: why} if why else {}))
    note = f"No ranks: {leading['reason']}."
    if over := leading["over"]:
        note = (
            "2-4: the 95 % intervals of the differences between methods allow each of these ranks (Student's t, paired "
            f"by {over[:-1]}, {leading['count']} {over}; Holm's correction for all pairs of a measure)."
        )
    order = f"Order: by mean {SHOWN[leading_measure][0]}, except methods that failed or are not ranked."
    every = {case.get("render_every") for case in summary["cases"].values() if case["track"] == track} - {None}
    notes = (order, note, *[GENERATED_NOTE.format(" or ".join(map(str, sorted(every))))] * bool(every))
    notes += tuple(f"Not in this track: {', '.join(labels)} ({why})." for why, labels in absent.items())
    return Table(0, f"{track}: scorecard ({_contents(summary, track)})", tuple(columns), tuple(rows), notes)


def _contents(summary: Summary, track: str) -> str:
    """What a track contains, in words: ``12 cases, input noisy@64``."""
    track_cases = {name: case for name, case in summary["cases"].items() if case["track"] == track}
    cases = {case["sha256"]: name.rpartition("/")[2] for name, case in track_cases.items()}
    return f"{len(cases)} case{'s' * (len(cases) != 1)}, input {' or '.join(dict.fromkeys(cases.values()))}"


def _levels(summary: Summary, track: str) -> Table:
    """The table of a track with the mean FLIP of each difficulty level, a row for each method that ran."""
    states = _finished_methods(summary, track)
    names = [n for n in summary["levels"] if any(n in state["levels"] for state in states.values())]
    columns = tuple(Column(n, "", 4, f"at most {summary['levels'][n]:g} % of the pixels discarded") for n in names)
    rows = (
        [Row(label, tuple(s["levels"][n].get("flip") for n in names)) for label, s in states.items()]
        if len(names) > 1
        else []  # the mean over all cases is in the scorecard
    )
    cases = [case for case in summary["cases"].values() if case["track"] == track]
    count = {n: len({case["sha256"] for case in cases if case["level"] == n}) for n in names}
    note = "; ".join(f"{n}: {count[n]} case{'s' * (count[n] != 1)}" for n in names)
    title = f"{track}: FLIP by difficulty of the case, the share of pixels without valid history"
    return Table(0, title, columns, tuple(rows), (note,))


def _classes(summary: Summary, track: str) -> Table:
    """The table of a track with the mean FLIP of each class of pixels, a row for each method that ran."""
    states = _finished_methods(summary, track)
    names = [n for n in summary["classes"] if any(s["classes"][n] is not None for s in states.values())]
    columns = tuple(Column(class_label(n), "", 4, summary["classes"][n]) for n in names)
    rows = [Row(label, tuple(s["classes"][n] for n in names)) for label, s in states.items()] if names else []
    note = "Masks of the exact frames; all cases of the track."
    return Table(0, f"{track}: FLIP by pixel class", columns, tuple(rows), (note,))


def _finished_methods(summary: Summary, track: str) -> dict[str, Summary]:
    """The results on a track of the methods that did not fail."""
    states = {label: method["tracks"][track] for label, method in summary["methods"].items()}
    return {label: state for label, state in states.items() if state["state"] == "done"}


def crossing_text(curve: Summary) -> str | None:
    """The speed at which reuse stops being better, with its interval: ``3.2 (2.5 to 4.1)``, ``> 16`` or ``never``."""
    crossing, steps = curve["crossing"], curve["steps"]
    if crossing is None:
        return None
    beyond = f"> {steps[-1]['value']:g}"
    low, high = (beyond if crossing[end] is None else f"{crossing[end]:.3g}" for end in ("low", "high"))
    if crossing["speed"] is not None:
        text, alike = f"{crossing['speed']:.3g}", False
    elif crossing["verdict"].startswith("better"):
        text, alike = beyond, low == beyond
    else:
        text, alike = "never", crossing["high"] == steps[0]["value"]
    return f"{text} ({low} to {high})" if steps[0]["low"] is not None and not alike else text


def _speeds(summary: Summary) -> Table:
    """The speed up to which a method is better than no reuse, by series and measure."""
    curves = {
        Column(f"{name}, {SHOWN[measure][0]}", AXES[series["axis"]][1]): series["measures"][measure]
        for name, series in summary["speeds"].items()
        for measure in ("flip", "psnr_db") if measure in series["measures"]
    }  # fmt: skip
    labels = [label for label in summary["methods"] if label != "none" and any(label in c for c in curves.values())]
    rows = [
        Row(label, tuple(crossing_text(c[label]) if label in c else None for c in curves.values())) for label in labels
    ]
    note = (
        "Speed at which a method stops being better than no reuse (none), and its 95 % interval over seeds; >: better "
        "within the whole range; never: not better at the first step. Linear between steps."
    )
    return Table(0, "Speed up to which reuse is better than none", tuple(curves), tuple(rows), (note,))


def _cases(summary: Summary) -> Table:
    columns = (
        Column("track"), Column("seeds"), Column("reference"), Column("discarded", "%", 1), Column("difficulty"),
        Column("scene"), Column("case"), Column("time", "s", 1),
    )  # fmt: skip
    rows = []
    for name, case in summary["cases"].items():
        reference = case["reference"] or {}
        text = f"{reference.get('kind')}, {reference.get('samples')}" if reference else None
        if noise := (reference.get("noise_db") or {}).get("psnr_db"):
            text += f", noise {noise:.1f} dB"
        hashes = (case["scene_sha256"][:8], case["sha256"][:8])
        facts = (case["track"], case["seeds"], text, case["discarded_percent"], case["level"])
        rows.append(Row(name, (*facts, *hashes, summary["times"]["seconds"][name])))
    notes = ["scene and case: first digits of their hashes; cases of equal hashes are run once."]
    for track in summary["rankings"]:
        states = {label: method["tracks"][track] for label, method in summary["methods"].items()}
        if all(state["state"] == "not applicable" for state in states.values()):
            why = "; ".join(f"{label} ({state['reason']})" for label, state in states.items())
            notes.append(f"No method runs in track {track}: {why}.")
    return Table(0, "Cases", columns, tuple(rows), tuple(notes))


def plot_speeds(summary: Summary, folder: Path) -> list[Path]:
    """``speeds``: FLIP over the speed of each series, as PNG and SVG.  Raises OutputError."""
    series = {n: s for n, s in summary["speeds"].items() if s["measures"].get("flip")}
    if not series:
        return []
    plot = Plot("", 10.0, 5.2 * len(series), rows=len(series))
    styles = method_styles(summary["methods"])
    for axes, (name, entry) in zip(plot.panels, series.items(), strict=True):
        values, lines_drawn = entry["values"], []
        # Between steps the mean is linear in the speed, which is a curve on a logarithmic axis.
        dense = np.unique(np.concatenate([np.linspace(a, b, FINE + 1) for a, b in itertools.pairwise(values)]))
        for label, curve in entry["measures"]["flip"].items():
            means = np.interp(dense, values, [step["mean"] for step in curve["steps"]])
            style = styles[label]
            # Wide lines below narrow ones, solid ones below dashed ones: equal curves are all seen.
            order = {"linewidth": 3.2, "zorder": 1.8} if label == "none" else {"zorder": 2 + 0.1 * (not style.filled)}
            marks = {"markevery": np.searchsorted(dense, values).tolist(), "markersize": 4}
            lines_drawn += axes.plot(dense, means, label=label, **{"linewidth": 1.5, **order}, **marks, **style.points)
            if curve["crossing"] and (speed := curve["crossing"]["speed"]) is not None:
                ring = {"markersize": 10, "markerfacecolor": "none", "color": style.color}
                axes.plot([speed], [np.interp(speed, dense, means)], "o", **ring)
        if len(values) > 2 and values[-1] > 8 * values[1]:
            axes.set_xscale("symlog", linthresh=values[1])
            axes.set_xticks(values, [f"{v:g}" for v in values])
            axes.minorticks_off()
        axes.set(xlabel=", ".join(AXES[entry["axis"]]), ylabel="mean FLIP (lower is better)")
        scene, _, kind = name.split("/")
        plot.title(axes, f"{AXES[entry['axis']][0].capitalize()}: scene {scene}, input {kind}")
        axes.margins(x=0.02)
        label_ends(axes, lines_drawn)
    return plot.save(folder / f"{PLOT_NAME}.png")


def benchmark_html(summary: Summary, image: bytes | None = None) -> str:
    """The page of a benchmark, one file of HTML.  ``image``: the plot of speeds as PNG."""
    suite, provenance, rankings = summary["suite"], summary["provenance"], summary["rankings"]
    intro = [
        tag("p", "Every method renders the same frames, which are compared with a reference. A track is a group of "
            "cases, each a scene with one input. Methods are ranked within a track, by the mean error over its cases; ",
            tag("em", "none"), " is the method without reuse.", class_="lead"),
        bullets((track, f": {_best(summary, track)}.") for track in rankings if rankings[track]),
    ]  # fmt: skip
    if failed := _failed(summary):
        intro += [tag("p", "Failed, and therefore last:"), bullets(failed)]
    page = Page(f"Benchmark, suite {suite['name']}", intro=tuple(intro))
    tables = {name: to_html(each, scroll=True) for name, each in benchmark_sections(summary).items() if each}
    if "ranks" in tables:
        page.add("ranks", "Scorecards", tables["ranks"])
    if image or "speeds" in tables:
        text = tag(
            "p", "The faster the motion, the less of the history is right. The ", tag("em", "speed"), " of a method is "
            "where its error reaches that of ", tag("em", "none"), " (ring): faster than that, reuse makes the images "
            "worse.",
        )  # fmt: skip
        plot = [picture(data_uri(image), "FLIP over the speed of each series", "plot-image")] if image else []
        page.add("speeds", "Error against speed", text, *plot, *[tables[n] for n in ("speeds",) if n in tables])
    if "classes" in tables:
        page.add("classes", "Difficulty and pixel classes", tables["classes"])
    about = (
        f"Suite {suite['name']} ({suite['version']}, {suite['sha256'][:12]}): {suite['cases']} cases, "
        f"{len(summary['methods'])} methods.",
        f"taubench-gl {provenance.get('version')}, {provenance.get('renderer')} ({provenance.get('driver')}).",
    )
    if "samples" in tables:
        page.add("samples", "Light samples", tables["samples"])
    if "response" in tables:
        page.add("response", "Response time", tables["response"])
    page.add("cases", "Cases", *[tables[n] for n in ("cases",) if n in tables], text_lines(about))
    return page.html()


def _best(summary: Summary, track: str) -> str:
    """The methods that can be the best of a track, in words."""
    name, ranking = next(iter(summary["rankings"][track].items()))
    entries = [entry for entry in ranking["ranking"] if entry["mean"] is not None]
    if not entries:
        return "no method has a value"
    title = SHOWN[name][0]
    if ranking["over"] is None:
        return f"best mean {title}: {entries[0]['method']}; no ranks: {ranking['reason']}"
    best = [entry["method"] for entry in entries if entry["rank"] == 1]
    if len(best) == 1:
        return f"best by {title}: {best[0]}"
    return f"best by {title}: {', '.join(best[:-1])} or {best[-1]}; the intervals allow each"


def _failed(summary: Summary) -> list[tuple[str, str]]:
    """Methods that failed: the name of the track, and the name of the method with the reason."""
    leading = {
        track: next(iter(rankings.values()))["ranking"] for track, rankings in summary["rankings"].items() if rankings
    }
    return [
        (track, f": {entry['method']}: {entry['reason']}")
        for track, ranking in leading.items() for entry in ranking if entry["reason"]
    ]  # fmt: skip


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
