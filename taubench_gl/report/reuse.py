"""Tables and HTML page of a reuse evaluation (schema ``taubench-gl/reuse/3``), and the table of a parameter fit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taubench_gl.report.labels import history_text, lighting_text
from taubench_gl.report.light_samples import MAPS, sample_tables
from taubench_gl.report.method_styles import BLACK, method_styles
from taubench_gl.report.page import Page, bullets, data_uri, picture, tag, text_lines
from taubench_gl.report.reuse_frames import NO_IMAGES, ReuseImages
from taubench_gl.report.table import Column, Row, Table, to_html

Summary = Mapping[str, Any]

_QUALITY = {
    "psnr_db": Column("PSNR", "dB", 2), "ssim": Column("SSIM", "", 4), "flip": Column("FLIP", "", 4),
    "relmse": Column("relMSE", "", 5), "tpsnr_db": Column("tPSNR", "dB", 2), "flicker": Column("flicker", "", 5),
}  # fmt: skip
_REUSE = {
    "reused_percent": Column("reused", "%", 2), "mean_weight": Column("mean weight", "", 3),
    "effective_weight": Column("effective weight", "", 3),
    "wrongly_reused_percent": Column("wrongly reused", "%", 2),
    "wrongly_rejected_percent": Column("wrongly rejected", "%", 2),
}  # fmt: skip
_BOUND = {
    "method_linear_mse": Column("linear MSE", "", 6), "linear_mse": Column("bound", "", 6),
    "headroom_db": Column("headroom", "dB", 2), "method_clipped_mse": Column("clipped MSE", "", 6),
    "clipped_mse": Column("its bound", "", 6), "clipped_headroom_db": Column("its headroom", "dB", 2),
    "weight": Column("weight of the bound", "", 3), "blended_percent": Column("blended", "%", 2),
}  # fmt: skip
_LINEAR = ("linear_mse", "clipped_mse", "relmse", "clipped_relmse")
"""Measures of Table 7, errors of linear radiance."""
_FURTHER = {
    "relmse_trimmed": Column("relMSE trimmed", "", 5), "clipped_relmse": Column("relMSE clipped", "", 5),
    "flip_p50": Column("FLIP p50", "", 4),
    "flip_p95": Column("FLIP p95", "", 4), "flip_p99": Column("FLIP p99", "", 4),
    "warp_error": Column("warping error", "", 6), "hdr_flip": Column("HDR-FLIP", "", 4),
    "lpips": Column("LPIPS", "", 4), "cvvdp_jod": Column("ColorVideoVDP", "", 3),
}  # fmt: skip
"""Measures of Table 6; their units are those that the evaluation states."""

LABELS = {"linear_mse": "linear MSE", "clipped_mse": "clipped MSE"} | {
    name: column.name for name, column in (_QUALITY | _FURTHER).items()
}
"""Measure -> its name for readers."""

_HEADLINES = ("flip", "psnr_db", "relmse")
"""Measures of the table of paired differences: the first that was measured."""

MOST_PAIRS = 15
"""Most pairs of methods in a table of differences; of more, only those with the best method are listed."""

NO_PIXEL = "no such pixel"

FLIP_PIXELS_PER_DEGREE, FLIP_DEGREES = 67.0, 10.0
"""FLIP's viewing distance (Andersson et al. 2020); width of an image below which its filters cover much of it."""

_PIXELS = {
    "not_classified": "not classified", "frustum": "off-screen pixels", "disoccluded": "disoccluded pixels",
    "occluding": "newly occluding pixels", "geometry": "other changed geometry", "lit": "brightened pixels",
    "shadowed": "darkened pixels", "light": "other changed light", "sky": "sky", "rest": "unchanged pixels",
}  # fmt: skip
"""Class of pixels -> its name in sentences."""


def class_label(name: str) -> str:
    """Name of a class of pixels in tables, plots and the page: ``brightened`` for ``lit``."""
    return _PIXELS.get(name, name).removesuffix(" pixels")


_WORTH = 0.01
"""Share of the error without reuse from which on a gain or loss in one class of pixels is named."""

BELOW_NOISE = "below the reference's noise"
"""Reason of a missing value: an unbiased estimate of a squared error is not above 0."""

_RESPONSE = {
    "frames": Column("response", "frames", 2), "low": Column("low", "frames", 2), "high": Column("high", "frames", 2),
    "never_percent": Column("never", "%", 0), "events": Column("events"), "followed": Column("followed"),
}  # fmt: skip
_RESPONSE_NOTE = (
    "Frames after an event until the squared error of linear radiance in its pixels is a tenth of its peak above the "
    "noise floor, the median of the last quarter of the frames that follow these pixels; 0: the peak is within the "
    "noise of the floor, or the error stays as high. Mean over the events that reach it."
)

GENERATED = {
    "gain_db": Column("gain, PSNR", "dB", 2), "latency_frames": Column("latency", "rendered frames"),
    "latency_ms": Column("latency", "ms", 1),
}  # fmt: skip
"""Block ``generated`` of methods that generate frames -> columns."""

GENERATED_NOTE = (
    "One of {} displayed frames is rendered; the others, which methods generate, are scored. Gain: over present-last, "
    "which displays the last rendered frame again. Pixel classes: changes since the last rendered frame. Latency: "
    "rendered frames that the display waits for, and by how much that delays every frame, without the method's time."
)

_BOUND_NOTE = (
    "Bound: the method's own reprojected history and input, blended by the weight of each pixel nearest to the "
    "reference. A method whose every pixel is a blend of the two cannot be better; others can."
)


def reuse_tables(summary: Summary) -> list[Table]:
    """Tables of quality, of reuse, time and memory, and of error by pixel class.  Failed methods are rows of dashes
    with the reason.
    """
    methods, measures = summary["methods"].items(), summary["measures"]
    columns = tuple(replace(column, definition=measures[name]["doc"]) for name, column in _QUALITY.items())
    rows = tuple(_row(label, method, "mean", _QUALITY) for label, method in methods)
    tables = [Table(1, "Quality against the reference", columns, rows, reuse_notes(summary))]
    columns = (*_REUSE.values(), Column("time", "ms", 3), Column("memory", "MiB", 2))
    rows = tuple(_cost_row(label, method) for label, method in methods)
    clock = f"Time: median over frames of the passes of the method; clock: {summary['clock']}; shading of the input: "
    shading = summary["input"]["shading_ms"]
    clock += "not measured." if shading is None else f"{shading:.2f} ms."
    tables.append(Table(2, "Reuse, time and memory", columns, rows, (clock, _class_source(summary))))
    tables.append(_class_table(summary))
    rows = tuple(_row(label, method, "bound", _BOUND, "bound.") for label, method in methods)
    eyes = [(label, method) for label, method in methods if method.get("eye_bound")]
    rows += tuple(_row(f"{label}, other eye", method, "eye_bound", _BOUND) for label, method in eyes)
    tables.append(
        Table(4, "Bound and headroom", tuple(_BOUND.values()), rows, (_BOUND_NOTE, *_headroom_texts(summary)))
    )
    further = (
        _further_table(summary)
        + _linear_table(summary)
        + sample_tables(valid_methods(summary), summary.get("sample_reasons", {}))
        + _response_table(summary)
        + _parts_table(summary)
        + _generated_table(summary)
    )
    return tables + comparison_tables(summary) + further


def _response_table(summary: Summary) -> list[Table]:
    """Response time of every method after every kind of event that the frames have."""
    rows, notes = [], []
    for label, method in valid_methods(summary).items():
        for event, found in method.get("response", {}).items():
            row = Row(f"{label}, {event.replace('_', ' ')}", tuple(found[name] for name in _RESPONSE))
            rows.append(row)
            if found["reason"]:
                notes.append(f"{row.label}: {found['reason']}.")
    meaning = "; ".join(f"{name.replace('_', ' ')}: {doc}" for name, doc in summary.get("events", {}).items())
    never = "Never: share of the followed events that do not reach it in the first half of these frames."
    notes = (f"{_RESPONSE_NOTE} 95 % interval over seeds. {never}", f"{meaning}.", *notes)
    return [Table(11, "Response time", tuple(_RESPONSE.values()), tuple(rows), notes)] if rows else []


def _parts_table(summary: Summary) -> list[Table]:
    """Squared bias and variance of every method; none without seeds."""
    parts = {label: m["error_parts"] for label, m in valid_methods(summary).items() if m.get("error_parts")}
    names = {"bias_squared": "squared bias", "variance": "variance"}
    columns = [Column(f"{title}{end}", "", 6) for title in names.values() for end in ("", ", low", ", high")]
    rows = [
        Row(label, tuple(of[n][end] for n in names for end in ("mean", "low", "high"))) for label, of in parts.items()
    ]
    note = (
        "Squared error of linear radiance, apart: variance over seeds, and the rest, the squared bias. 95 % interval "
        "over frames; a small squared bias can be below 0 by noise."
    )
    return [Table(12, "Bias and variance", tuple(columns), tuple(rows), (note,))] if rows else []


def _generated_table(summary: Summary) -> list[Table]:
    """Latency of methods that generate frames, and what they gain over the last rendered frame."""
    methods = {label: m["generated"] for label, m in valid_methods(summary).items() if m.get("generated")}
    rows = tuple(Row(label, tuple(map(values.get, GENERATED))) for label, values in methods.items())
    note = GENERATED_NOTE.format(summary["input"].get("render_every"))
    return [Table(13, "Generated frames", tuple(GENERATED.values()), rows, (note,))] if rows else []


def mean_response(summary: Summary) -> Table:
    """The table of a benchmark of response times by event, means over the cases in which a method reaches them."""
    events = dict.fromkeys(
        event for m in summary["methods"].values() for cell in m["cases"].values() for event in cell.get("response", ())
    )
    rows = []
    for label, method in summary["methods"].items():
        cells = [cell.get("response", {}) for cell in method["cases"].values()]
        values = [[c[event]["frames"] for c in cells if c.get(event, {"frames": None})["frames"] is not None]
                  for event in events]  # fmt: skip
        if any(values):
            rows.append(Row(label, tuple(float(np.mean(v)) if v else None for v in values)))
    columns = tuple(Column(event.replace("_", " "), "frames", 2) for event in events)
    return Table(0, "Response time: means over the cases", columns, tuple(rows), (_RESPONSE_NOTE,))


def _headroom_texts(summary: Summary) -> list[str]:
    """A line per method with an interval of its headroom: of clipped radiance, and of all radiance."""
    texts = []
    for label, method in valid_methods(summary).items():
        bound = method.get("bound") or {}
        ends = {name: _ends(entry) for name, entry in (bound.get("intervals") or {}).items()}
        if ends.get("clipped_headroom_db"):
            linear = f"; without clipping {ends['headroom_db']}" if ends.get("headroom_db") else ""
            texts.append(f"Headroom of {label}, dB: {ends['clipped_headroom_db']}{linear}.")
    return texts


def _ends(entry: Summary) -> str:
    """``1.2 to 3.4 (frames), 1.8 to 2.5 (seeds)``, as far as there are intervals."""
    parts = [(entry.get("low"), entry.get("high"), "frames")]
    if entry.get("over_seeds"):
        parts.append((entry["over_seeds"]["low"], entry["over_seeds"]["high"], "seeds"))
    return ", ".join(f"{low:.3g} to {high:.3g} ({of})" for low, high, of in parts if low is not None)


def _linear_table(summary: Summary) -> list[Table]:
    """Errors of linear radiance, unbounded and clipped, with intervals and the share of few pixels: a row of each."""
    measures = summary["measures"]
    valid = {label: method for label, method in valid_methods(summary).items() if method.get("tail_percent")}
    if not valid:
        return []
    statistics = (summary.get("statistics") or {"measures": {}})["measures"]
    ends = [f"{end}, {of}" for of in ("frames", "seeds") for end in ("low", "high")]
    columns = (*(Column(name, "", 5) for name in ("mean", *ends)), Column("in 0.1 %", "%", 1))
    rows = []
    for label, method in valid.items():
        for name in (name for name in _LINEAR if name in measures):
            mean, interval = method["mean"].get(name), statistics.get(name, {}).get("means", {}).get(label, {})
            below = mean is not None and mean < 0.0
            values = [None if below else mean, interval.get("low"), interval.get("high")]
            values += [(interval.get("over_seeds") or {}).get(end) for end in ("low", "high")]
            values.append(method["tail_percent"].get(name))
            rows.append(Row(f"{label}, {LABELS[name]}", tuple(values), reasons={0: BELOW_NOISE} if below else {}))
        if (error := method["emitters"]["linear_mse"]) is not None:
            rows.append(Row(f"{label}, emitters", (error, None, None, None, None, None)))
    share = next(iter(valid.values()))["emitters"]["percent"]
    seen = "It is not known which pixels show an emitting surface: all count."
    if share is not None:
        seen = (
            f"Pixels that show an emitting surface, {share:.2g} % of all, are left out; emitters: linear MSE of them."
        )
    notes = (
        f"{seen} Clipped: image and reference at {summary['white']:g} times the display's white. 95 % intervals over "
        "frames, and over seeds from five on; in 0.1 %: share of the squared error in the 0.1 % of the pixels of each "
        "frame that have most.",
        *noise_texts(summary),
    )
    return [Table(7, "Errors of linear radiance", columns, tuple(rows), notes)]


def noise_texts(summary: Summary) -> list[str]:
    """The noise of a path-traced reference beside the scores, in dB of squared error."""
    noise = summary["reference"].get("noise_db") or {}
    values = [f"{LABELS[name]} {value:.1f} dB" for name, value in noise.items() if value is not None]
    if not values:
        return []
    return [
        f"Noise of the reference, as 10 log10(1 / squared error): {', '.join(values)}. Methods whose squared errors "
        "are closer than that are tied. All measures but linear MSE contain it, also PSNR, FLIP and relMSE; linear MSE "
        "is the product of the errors against the two halves of the reference, without it."
    ]


def verdict(summary: Summary) -> str | None:
    """The best method by the measure of Table 5, and in which pixels it beats no reuse or loses to it.

    None where fewer than two methods that a renderer could have were measured.
    """
    methods = {label: m for label, m in valid_methods(summary).items() if not m.get("yardstick")}
    name = next((n for n in _HEADLINES if all(m["mean"].get(n) is not None for m in methods.values())), None)
    if len(methods) < 2 or name is None:
        return None
    sign = 1.0 if summary["measures"][name]["better"] == "lower" else -1.0
    best = min(methods, key=lambda label: sign * methods[label]["mean"][name])
    digits = _QUALITY[name].digits
    text = f"By {LABELS[name]}, {best} is best ({methods[best]['mean'][name]:.{digits}f}"
    if "none" in methods and best != "none":
        text += f"; no reuse {methods['none']['mean'][name]:.{digits}f}"
    text += ")"
    measures = (summary.get("statistics") or {}).get("measures") or {}
    ranking = measures.get(measures.get(name, {}).get("ranked_by", name), {}).get("ranking", ())
    ties = [entry["method"] for entry in ranking if entry["rank"] == 1 and entry["method"] in methods]
    if ties := [label for label in ties if label != best]:
        text += f", indistinguishable from {_listed(ties)}"
    if "none" not in methods or best == "none":
        return f"{text}."
    gains = _gains(methods[best]["classes"], methods["none"]["classes"])
    won, lost = ([_PIXELS[n] for n, g in gains if g > 0][:2], [_PIXELS[n] for n, g in gains[::-1] if g < 0][:2])
    parts = [f"gains most in {_listed(won)}"] * bool(won) + [f"loses in {_listed(lost)}"] * bool(lost)
    return f"{text}." + (f" Against no reuse it {' and '.join(parts)}." if parts else "")


def _gains(method: Mapping[str, Summary], base: Mapping[str, Summary]) -> list[tuple[str, float]]:
    """Class of pixels and what ``method`` gains there, as a share of the error of ``base``; the largest gain first.

    Both hold the block ``classes`` of reuse.json.
    """
    measure = next((m for m in ("flip", "relmse") if any(m in entry for entry in base.values())), None)
    values = {
        name: [entry["percent"] * (block.get(name) or {}).get(measure, 0.0) for block in (base, method)]
        for name, entry in base.items()
        if name != "not_classified" and entry["pixels"]
    }
    whole = sum(before for before, _ in values.values()) or 1.0
    gains = [(name, (before - after) / whole) for name, (before, after) in values.items()]
    return sorted((entry for entry in gains if abs(entry[1]) >= _WORTH), key=lambda entry: -entry[1])


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def _further_table(summary: Summary) -> list[Table]:
    """Measures that Table 1 has no room for, as far as a method has them."""
    methods, measures = summary["methods"], summary["measures"]
    means = [method["mean"] for method in methods.values() if not method["failed"]]
    names = [name for name in measures if name in _FURTHER and any(mean.get(name) is not None for mean in means)]
    if not names:
        return []
    columns = tuple(replace(_FURTHER[n], unit=measures[n]["unit"], definition=measures[n]["doc"]) for n in names)
    rows = tuple(_row(label, method, "mean", names) for label, method in methods.items())
    reference = summary["reference"].get("warp_error")
    notes = () if reference is None else (f"Warping error of the reference: {reference:.6f}.",)
    return [Table(6, "Further measures", columns, rows, notes)]


def comparison_tables(summary: Summary) -> list[Table]:
    """Paired differences of all methods and the ranking, by ``_HEADLINES``; none for one method."""
    statistics = summary.get("statistics") or {"measures": {}}
    name = next((name for name in _HEADLINES if name in statistics["measures"]), None)
    if name is None or not statistics["measures"][name]["differences"]:
        return []
    results, measure = statistics["measures"][name], summary["measures"][name]
    every = results["differences"]
    best = min(
        (label for entry in every for label in (entry["a"], entry["b"])),
        key=lambda label: results["means"][label]["mean"] * (-1.0 if measure["better"] == "higher" else 1.0),
    )
    few = len(every) <= MOST_PAIRS
    entries = every if few else [entry for entry in every if best in (entry["a"], entry["b"])]
    ends = ["difference", "low", "high"]
    seeds = all(entry["over_seeds"] for entry in entries)  # from five seeds on
    unit, digits = measure["unit"], 3 if measure["unit"] else 5
    names = [*ends, *(f"{end}, seeds" for end in ends[1:] if seeds)]
    columns = (*(Column(n, unit, digits) for n in names), Column("p (Holm)", "", 4))
    rows = []
    for entry in entries:
        values = [entry[end] for end in ends] + [entry["over_seeds"][end] for end in ends[1:] if seeds]
        rows.append(Row(f"{entry['a']} - {entry['b']}", (*values, entry["p_holm"]), reasons={0: entry["verdict"]}))
    notes = [_interval_text(statistics, results, seeds), *ranking_texts(summary)]
    notes += [] if few else [f"Pairs with {best}, whose mean is best; reuse.json contains all {len(every)}."]
    title = f"Paired differences of {LABELS[name]} ({measure['better']} is better)"
    return [Table(5, title, columns, tuple(rows), tuple(notes))]


def _interval_text(statistics: Summary, results: Summary, seeds: bool) -> str:
    """How the intervals of a measure were computed, or why there are none."""
    if results["reason"] is not None:
        return f"No intervals: {results['reason']}."
    lengths = [entry["block_length"] for entry in results["differences"] if entry["block_length"] is not None]
    blocks = "-".join(str(n) for n in sorted({min(lengths), max(lengths)}))
    text = (
        f"{100 * statistics['confidence']:g} % intervals; {statistics['frames']} frames, seeds: {statistics['seeds']}; "
        f"blocks of {blocks} frames; {statistics['rule']}."
    )
    return text + (" Columns of seeds: Student's t over the means of the seeds." if seeds else "")


def ranking_texts(summary: Summary) -> list[str]:
    """A line for each measure of Table 1, ``FLIP: 1 svgf; 2-3 taa_clamp; 2-3 none``, in the order of the means.

    Those of unbounded radiance have the ranking by clipped radiance.

    Measures disagree, so no single one names a best method.
    """
    measures = summary["statistics"]["measures"]
    rankings = {
        LABELS[name]: measures[name]["ranking"]
        for name in (*(measures.get(n, {}).get("ranked_by", n) for n in _QUALITY), "clipped_mse") if name in measures
    }  # fmt: skip
    has_ranks = any(entry["rank"] is not None for ranking in rankings.values() for entry in ranking)
    meaning = "Ranks that remain possible after Holm's correction" if has_ranks else "Methods"
    texts = [f"{meaning}, from the best mean on; measures differ in what they count:"]
    for title, ranking in rankings.items():
        entries = (f"{'' if e['rank'] is None else ranks(e) + ' '}{e['method']}" for e in ranking)
        texts.append(f"{title}: {'; '.join(entries)}.")
    return texts


def ranks(entry: Summary) -> str:
    """``2``, ``2-5`` or ``-``: the ranks that the data allow."""
    first, last = entry["rank"], entry["last_rank"]
    return "-" if first is None else str(first) if first == last else f"{first}-{last}"


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
    input_block, reference, settings = summary["input"], summary["reference"], summary["settings"]
    return (
        [summary["scene"].get(key) for key in _SAME],
        [settings.get(key) for key in _SAME_SETTINGS],
        [input_block.get(key) for key in ("kind", "light_samples", "indirect_samples", "seed")],
        [reference.get(key) for key in ("kind", "samples", "path")],
        [summary.get(key) for key in ("seeds", "warmup", "clock")],
        (summary.get("provenance") or {}).get("definitions", 1),
    )


def reuse_notes(summary: Summary) -> tuple[str, ...]:
    """The settings on which every number of the evaluation depends."""
    settings, light, reference = summary["settings"], summary["input"], summary["reference"]
    kind = light["kind"]
    if light["light_samples"]:
        kind += f" ({light['light_samples']} lights, {light['indirect_samples']} VPLs, seed {light['seed']})"
    against = reference["path"] if reference["samples"] is None else f"{reference['samples']} samples per pixel"
    seeds = len(summary.get("seeds", ()))
    first = (
        f"{summary['scene']['name']}: {settings['width']}x{settings['height']}, {settings['fps']:g} fps, means over "
        f"frames {settings['first_frame'] + summary.get('warmup', 1)} to {settings['last_frame']} "
        f"(N = {summary['evaluated_frames']}{f', {seeds} seeds' if seeds > 1 else ''}); "
        f"input: {', '.join([kind, *history_text(settings)])}; reference: {reference['kind']}, {against}."
    )
    text = lighting_text(summary)
    lighting = (f"{text}.",) if text else ()
    floor = (f"Noise floor, standard error of the reference: {reference['noise']}.",) if reference.get("noise") else ()
    if (noise := (reference.get("noise_db") or {}).get("psnr_db")) is not None:
        floor += (f"PSNR of the reference's noise: {noise:.1f} dB; methods whose squared errors are closer are tied.",)
    yardsticks = (
        f"{n}: yardstick, not ranked: {m['yardstick']}."
        for n, m in valid_methods(summary).items()
        if m.get("yardstick")
    )
    return (first, *floor, *yardsticks, *flip_notes(summary), *video_notes(summary), *lighting, *light["notes"])


def flip_notes(summary: Summary) -> tuple[str, ...]:
    """A warning where FLIP sees an image narrower than FLIP_DEGREES degrees of visual angle."""
    width = summary["settings"]["width"]
    degrees = width / FLIP_PIXELS_PER_DEGREE
    means = [method["mean"] for method in summary["methods"].values() if not method["failed"]]
    if degrees >= FLIP_DEGREES or all(mean.get("flip") is None for mean in means):
        return ()
    return (
        f"Warning: FLIP sees {width} pixels at {FLIP_PIXELS_PER_DEGREE:g} pixels per degree as an image {degrees:.1f} "
        f"degrees wide, less than {FLIP_DEGREES:g}: noise of single pixels counts little there.",
    )


def video_notes(summary: Summary) -> tuple[str, ...]:
    """A warning where ColorVideoVDP sees less than a second."""
    frames, fps = summary["evaluated_frames"], summary["settings"]["fps"]
    means = [method["mean"] for method in summary["methods"].values() if not method["failed"]]
    if frames >= fps or all(mean.get("cvvdp_jod") is None for mean in means):
        return ()
    seen = "one frame, which is scored as an image" if frames == 1 else f"{frames} frames, {frames / fps:.2g} s"
    return (f"Warning: ColorVideoVDP sees {seen}: its score depends on the number of frames below a second.",)


def fit_table(fit: Summary) -> Table:
    """A table of every point that a parameter fit evaluated."""
    names = list(fit["settings"])
    columns = (*(Column(name, "", 6) for name in names), Column(fit["metric"], "", 6))
    rows = []
    for i, point in enumerate(fit["points"], start=1):
        best = point["settings"] == fit["best"]["settings"]
        # Switches are 0 or 1, in CSV too.
        settings = (int(value) if isinstance(value := point["settings"][name], bool) else value for name in names)
        rows.append(Row.of(f"{i}{' (best)' if best else ''}", (*settings, point["value"]), point["failed"]))
    notes = (f"{fit['method']}: {fit['better']} is better.", *fit["notes"])
    return Table(1, f"{fit['metric']} by parameters of {fit['method']}", columns, tuple(rows), notes)


def _row(label: str, method: Summary, block: str, names: Iterable[str], prefix: str = "") -> Row:
    """The values ``names`` of a block of a method.  ``prefix``: of their names among the reasons of missing values."""
    names, values = list(names), None if method["failed"] else method.get(block)
    if values is None:
        why = method["failed"] or method["reasons"].get(block, "not measured")
        return Row(label, (None,) * len(names), reasons={0: why})
    reasons = [method["reasons"].get(f"{prefix}{name}") for name in names]
    return Row.of(label, [values.get(name) for name in names], *reasons)


def _cost_row(label: str, method: Summary) -> Row:
    row, size = _row(label, method, "reuse", _REUSE), method["memory_bytes"]
    return replace(row, values=(*row.values, method.get("time_ms"), None if size is None else size / 2**20))


def _class_table(summary: Summary) -> Table:
    valid = valid_methods(summary)
    absent = [c for c in summary["classes"] if valid and not any(m["classes"][c]["pixels"] for m in valid.values())]
    classes = [c for c in summary["classes"] if c not in absent]
    columns = tuple(Column(class_label(name), "", 4, summary["classes"][name]) for name in classes)
    first = next(iter(valid.values()), {"classes": {}})
    measure = "flip" if any("flip" in entry for entry in first["classes"].values()) or not valid else "relmse"
    rows = [Row.of(label, [m["classes"][c].get(measure) for c in classes], NO_PIXEL) for label, m in valid.items()]
    if valid:
        rows.append(Row("share of pixels, %", tuple(first["classes"][c]["percent"] for c in classes)))
    meaning = "; ".join(f"{class_label(name)}: {summary['classes'][name]}" for name in classes)
    notes = [
        f"{meaning}.",
        *([f"No pixels: {', '.join(map(class_label, absent))}."] if absent else []),
        _class_source(summary),
    ]
    return Table(3, f"Mean {LABELS[measure]} by pixel class", columns, tuple(rows), tuple(notes))


def valid_methods(summary: Summary) -> dict[str, Summary]:
    """The methods that did not fail."""
    return {label: method for label, method in summary["methods"].items() if not method["failed"]}


def _class_source(summary: Summary) -> str:
    if summary["mask_source"] == "exact":
        return "Wrongly reused, wrongly rejected and the pixel classes refer to the masks of the exact frames."
    return "The pixel classes refer to geometry alone, because there are no masks of exact frames."


def reuse_html(
    summary: Summary,
    rows: Sequence[Mapping[str, Any]],
    image: bytes | None = None,
    images: ReuseImages | None = None,
) -> str:
    """The page of an evaluation, which reuse.js draws.

    ``rows``: frames.csv, one per frame and method; ``image``: a PNG of the methods side by side on the worst frame, for
    a page without ``images``.
    """
    images = images or ReuseImages(None, NO_IMAGES)
    data = _page_data(summary, rows)
    if images.data is not None:
        text = f"{images.text} {MAPS}" if any("samples" in m for m in summary["methods"].values()) else images.text
        data |= {"images": images.data, "viewer": _viewer_data(summary, rows, text)}
    name = summary["scene"]["name"]
    best = verdict(summary)
    failed = [(label, f" failed: {m['failed']}") for label, m in summary["methods"].items() if m["failed"]]
    page = Page(
        f"{name}: reuse evaluation", "reuse evaluation", heading=name,
        intro=(*([tag("p", best, class_="sentence")] if best else []), *([bullets(failed)] if failed else [])),
        styles=("stage.css", "reuse.css"), data=data,
        scripts=("stage.js", "zoom.js", "frame_viewer.js", "reuse_viewer.js", "reuse.js"),
    )  # fmt: skip
    scripts = "The plots need scripts; the files frames.svg and time.svg show the same."
    noscript = tag("noscript", tag("p", scripts, class_="missing"))
    if images.data is not None:
        page.add("compare", "Images and error maps", noscript, tag("div", id="viewer"), link="Images")
    else:
        missing = tag(
            "p", f"{images.text[:1].upper()}{images.text[1:]}, so this page has no images of the frames. With ",
            tag("code", "reuse evaluate --report"), " it compares them side by side.", class_="missing",
        )  # fmt: skip
        page.intro += (noscript, missing)
    measure = tag("label", "measure ", tag("select", id="measure"))
    page.add(
        "time", "Over time", tag("p", measure, " ", tag("span", id="definition", class_="muted"), class_="controls"),
        tag("div", id="frames"),
    )  # fmt: skip
    status = tag("p", id="status", class_="readout", aria_live="polite")
    page.add("cost", "Error and time", tag("div", id="scatter"), status)
    if image is not None and images.data is None:
        alt = "The methods side by side on the frame with the largest mean error, above their error maps"
        page.add("frame", "Worst frame", picture(data_uri(image), alt))
    page.add("tables", "Tables", to_html(reuse_tables(summary), scroll=True))
    page.add("details", "Details", text_lines(reuse_notes(summary)))
    return page.html()


def _viewer_data(summary: Summary, rows: Sequence[Mapping[str, Any]], text: str) -> dict[str, Any]:
    """What the viewer needs beside the images; it plays at the frame rate of the evaluation, at most 15 per second."""
    return {
        "classes": [{"name": name, "label": class_label(name), "doc": doc} for name, doc in summary["classes"].items()],
        "error": "FLIP" if any(row["flip"] is not None for row in rows) else "4 |error|",
        "milliseconds": 1e3 / min(summary["settings"]["fps"], 15.0),
        "text": text,
        "warmup": summary.get("warmup", 1),
    }


def mean_over_seeds(rows: Sequence[Mapping[str, Any]], frame: int, name: str) -> float | None:
    """Mean of a measure over the seeds of a frame; None where no seed has it.  ``rows``: of one method."""
    values = [row[name] for row in rows if row["frame"] == frame and row[name] is not None]
    return float(np.mean(values)) if values else None


def _page_data(summary: Summary, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Values of reuse.js: measures with values, frames, and of each method its rows by measure in order of frames.

    Rows of several seeds are averaged.
    """
    frames = sorted({row["frame"] for row in rows})
    measures = [name for name in summary["measures"] if any(row[name] is not None for row in rows)]
    valid = valid_methods(summary)
    styles, methods = method_styles(valid), []
    for label, method in valid.items():
        of_method = [row for row in rows if row["method"] == label]
        methods.append({
            # Black is the color of the text: it shows on a dark page.
            "color": "currentColor" if styles[label].color == BLACK else styles[label].color,
            "dash": styles[label].line,
            "label": label,
            "rows": {name: [mean_over_seeds(of_method, frame, name) for frame in frames] for name in measures},
            "mean": method["mean"],
            "time_ms": method.get("time_ms"),
        })  # fmt: skip
    return {
        "frames": frames,
        "measures": [{"name": name, "label": LABELS[name], **summary["measures"][name]} for name in measures],
        "methods": methods,
        "clock": summary["clock"],
    }
