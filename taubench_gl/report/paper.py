"""Tables 1 to 4 of the paper, with one or several runs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib import resources
from typing import Any

from taubench_gl.conventions import Visibility
from taubench_gl.features import COLUMNS
from taubench_gl.glossary import CAMERA, CENSUS, EXACT, EXACT_REASONS, STATISTICS
from taubench_gl.glossary import COLUMNS as COLUMN_TERMS
from taubench_gl.report.labels import comparison_text, lighting_text, run_labels
from taubench_gl.report.table import Column, Row, Table
from taubench_gl.settings import DEFAULT_SIZE, PAPER_SIZE

Summary = Mapping[str, Any]

WITHOUT_CUTS = STATISTICS["without_cuts_mean_percent"].label


@cache
def paper_numbers() -> dict[str, Any]:
    """The paper's Tables 1 to 4 (``paper.json`` in this folder)."""
    return json.loads(resources.files(__package__).joinpath("paper.json").read_text(encoding="utf-8"))


def paper_tables(summaries: Sequence[Summary], paper: bool = True) -> list[Table]:
    """Tables 1 to 4 of ``summaries`` (contents of summary.json): the rows of each run, then those of the paper."""
    labels = run_labels(summaries)
    return [builder(summaries, labels, paper) for builder in (_census, _position, _rotation, _discard)]


# Every row of statistics holds the sampling rate and the number of pairs.
SAMPLING_COLUMNS = (
    Column("fps", "1/s", 0, STATISTICS["fps"].tooltip),
    Column("N", "pairs", definition=STATISTICS["pairs"].tooltip),
)

_CENSUS = ("dynamic_rigid_objects", "armatures", "bones", "static_point_lights", "dynamic_point_lights")


def _census(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    rows = []
    for label, summary in zip(labels, summaries, strict=True):
        census = summary.get("census") or {}
        rows.append(table_row(label, [census.get(key) for key in _CENSUS], summary, census.get("reason")))
    if paper:
        bones = f"the paper gives {paper_numbers()['bones_per_armature']} animated bones per armature, not their sum"
        for row, scene in zip(_paper_rows("census", _CENSUS), paper_numbers()["scenes"], strict=True):
            rows.append(replace(row, reasons={2: bones}) if scene["census"]["armatures"] else row)
    columns = (*(Column(CENSUS[key].label, definition=CENSUS[key].tooltip) for key in _CENSUS), *SAMPLING_COLUMNS)
    return Table(1, "Animation details", columns, tuple(rows))


def _paper_rows(block: str, keys: Sequence[str], fps: float | None = None, percent_of: str = "%") -> list[Row]:
    """The rows of the paper: values ``keys`` of a block of each scene, fps, and no number of pairs."""
    return [
        Row(scene["name"], (*(scene[block].get(key) for key in keys), fps, None), paper=True, percent_of=percent_of)
        for scene in paper_numbers()["scenes"]
    ]


_PAPER_RATE = "The paper does not state the sampling rate of its camera tables."


def _position(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    keys = ("mean", "variance", "max", "median", "p95")
    rows = _camera_rows(summaries, labels, [("position", key) for key in keys])
    rows += _paper_rows("position", keys) if paper else []
    columns = tuple(camera_column("position", key, key, "m") for key in keys)
    title, notes = "Change in the camera's position per frame", (_PAPER_RATE,) * paper
    return Table(2, title, (*columns, *SAMPLING_COLUMNS), tuple(rows), notes)


def _rotation(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    statistics = [(axis, key) for axis in ("pitch", "yaw", "roll") for key in ("mean", "variance")]
    statistics += [("angle", key) for key in ("mean", "variance", "max")]
    rows = _camera_rows(summaries, labels, statistics)
    rows += _paper_rows("rotation", [f"{axis}_{key}" for axis, key in statistics]) if paper else []
    short = {"mean": "mean", "variance": "var", "max": "max"}
    columns = tuple(camera_column(axis, key, f"{axis} {short[key]}", "deg") for axis, key in statistics)
    notes = ("angle: the geodesic angle between the two orientations; not in the paper.", *[_PAPER_RATE] * paper)
    return Table(3, "Change in the camera's rotation per frame", (*columns, *SAMPLING_COLUMNS), tuple(rows), notes)


def camera_column(quantity: str, statistic: str, name: str, unit: str) -> Column:
    """The column of a statistic of the camera's motion.  ``unit``: unit of the quantity, such as m."""
    definition = f"{STATISTICS[statistic].definition}: {CAMERA[quantity].tooltip}"
    return Column(name, f"{unit}²" if statistic == "variance" else unit, 3, definition)


MUCH_SKY = 100.0 / 3.0
"""Share of sky, %, above which Table 4 also has shares of surface pixels."""

SEEN = ("visible", "occluded")
"""Columns of exact visibility in Table 4."""


def _discard(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    exact_columns = SEEN if any(summary.get("exact") for summary in summaries) else ()
    rows, notes, of_runs = [], [], list(zip(labels, summaries, strict=True))
    for label, summary in of_runs:
        rows += _discard_rows(label, summary, exact_columns)
    if paper:
        fps = float(paper_numbers()["settings"]["render_fps"])
        rows += _paper_rows("discard", (*COLUMNS, *exact_columns), fps, percent_of=STATISTICS["mean_percent"].label)
    terms = [*((name, COLUMN_TERMS[name]) for name in COLUMNS), *((name, EXACT[name]) for name in exact_columns)]
    columns = (*(Column(name, "%", 2, term.tooltip) for name, term in terms), *SAMPLING_COLUMNS)
    floor = "the noise floor is unknown; it requires a second render with another seed."
    for texts in (
        [conditions(summary) for summary in summaries],
        [sampled_text(summary) for summary in summaries],
        [sensitivity(summary) for summary in summaries],
        [floor if s.get("path_traced") and not s.get("noise_floor") else None for s in summaries],
    ):
        notes += [f"{_prefix(label, labels)}{text}" for label, text in zip(labels, texts, strict=True) if text]
    notes += ["The paper does not state the thresholds of its Table 4."] * paper
    notes += _notes(summaries, labels, paper)
    return Table(4, "Discarded pixels, mean over the animation", columns, tuple(rows), tuple(notes))


def _discard_rows(label: str, summary: Summary, exact_columns: Sequence[str]) -> list[Row]:
    """Means of all pixels, of pairs without cuts, of comparable pixels; the noise floor and misregistration, if any."""
    entries = [(summary.get("discard") or {}).get(name) or {} for name in COLUMNS]
    cuts = (summary.get("camera") or {}).get("cuts") or ()
    all_pixels, of_comparable = (STATISTICS[key].label for key in ("mean_percent", "comparable_mean_percent"))
    exact = summary.get("exact") or {}
    unseen = ["of all pixels only" if exact else "run with --exact"] * len(exact_columns)
    why = [entry.get("reason") for entry in entries]

    def row(text: str, key: str, seen_values: list[float | None], percent_of: str, left_out: int = 0) -> Row:
        values, reasons = [*(entry.get(key) for entry in entries), *seen_values], why
        if key == "comparable_mean_percent":
            reasons = [why[0] or "pixels discarded by frustum are not comparable", *why[1:]]
        cells = table_row(f"{label}, {text}", values, summary, *reasons, *unseen, left_out=left_out)
        return replace(cells, percent_of=percent_of)

    nothing: list[float | None] = [None] * len(exact_columns)
    rows = [row(all_pixels, "mean_percent", [_mean_of(exact, name) for name in exact_columns], all_pixels)]
    if any(half_width(entry) is not None for entry in entries):
        widths = [*map(half_width, entries), *nothing]
        cells = table_row(
            f"{label}, {INTERVAL}", widths, summary, *["no interval: every pixel is measured"] * len(widths)
        )
        rows.append(replace(cells, percent_of=all_pixels))
    if floor := summary.get("noise_floor"):
        # Two renders of the same frames: one pair per frame, hence N + 1 pairs.
        noise = [floor.get(name) or {} for name in COLUMNS]
        reasons = [entry.get("reason") or "geometry is assumed to be free of noise" for entry in noise]
        values = [*(entry.get("mean_percent") for entry in noise), *nothing]
        cells = table_row(
            f"{label}, noise floor", values, summary, *reasons, *["no noise"] * len(exact_columns), left_out=-1
        )
        rows.append(replace(cells, percent_of=all_pixels))
    if cuts:
        text = f"{all_pixels}, {WITHOUT_CUTS}"
        rows.append(row(text, "without_cuts_mean_percent", nothing, all_pixels, len(cuts)))
    rows.append(row(of_comparable, "comparable_mean_percent", nothing, of_comparable.split(",")[0]))
    if ((summary.get("reusable") or {}).get("sky_percent") or 0.0) > MUCH_SKY:
        of_surface = STATISTICS["of_surface_percent"].label
        rows.append(row(of_surface, "of_surface_percent", nothing, of_surface))
    return [*rows, _misregistered(label, summary)] if exact else rows


def exact_tables(summaries: Sequence[Summary]) -> list[Table]:
    """Exact reasons and misses of the runs that have them; empty where none does."""
    rows = []
    for label, summary in zip(run_labels(summaries), summaries, strict=True):
        if not (exact := summary.get("exact")):
            continue
        parts = [[_mean_of(exact, name) for name in names] for names in _REASON_BLOCKS.values()]
        rates = [None if None in values else sum(values) for values in parts]
        rates += [_mean_of(exact, name) for name in ("light_noise", "missed")]
        why = [*["no light was measured"] * len(parts), "no path-traced light", "position or normal not measured"]
        rows.append(replace(table_row(label, rates, summary, *why), percent_of=STATISTICS["mean_percent"].label))
    if not rows:
        return []
    terms = [(term.label, term.tooltip) for term in EXACT_REASONS.values()]
    terms += [(name.replace("_", " "), EXACT[name].tooltip) for name in ("light_noise", "missed")]
    columns = (*(Column(name, "%", 2, text) for name, text in terms), *SAMPLING_COLUMNS)
    title = "Exact reasons: by rays and the light of the same points"
    return [Table("exact reasons", title, columns, tuple(rows))]


_REASON_BLOCKS = {
    Visibility.OCCLUDED: ("occluded",), Visibility.OUTSIDE | Visibility.BEHIND: ("outside", "behind"),
    Visibility.NEW: ("new",), Visibility.BRIGHTENED: ("brightened",), Visibility.DARKENED: ("darkened",),
    Visibility.VIEW_DEPENDENT: ("view_dependent",),
}  # fmt: skip
"""Exact reason -> blocks of ``exact`` in summary.json, in the order of EXACT_REASONS."""


def _mean_of(exact: Mapping[str, Any], name: str) -> float | None:
    return (exact.get(name) or {}).get("mean_percent")


def _misregistered(label: str, summary: Summary) -> Row:
    """A row with the share of the discards of each column whose surface point was visible and unchanged."""
    wrong = summary["exact"].get("misregistered") or {}
    values = [(wrong.get(name) or {}).get("share_percent") for name in COLUMNS] + [None] * len(SEEN)
    why = [(wrong.get(name) or {}).get("reason") or "nothing discarded" for name in COLUMNS]
    why = ["the frustum test is the same", *why[1:], *["no discard"] * len(SEEN)]
    return replace(table_row(f"{label}, share misregistered", values, summary, *why), percent_of="% of discards")


def _camera_rows(
    summaries: Sequence[Summary], labels: Sequence[str], statistics: Sequence[tuple[str, str]]
) -> list[Row]:
    """One row per run, and a second one without cuts if it has any."""
    rows = []
    for label, summary in zip(labels, summaries, strict=True):
        camera = summary.get("camera") or {}
        reason = camera.get("reason") or ("no frame pair" if not camera.get("samples") else "not measured")
        values = [(camera.get(name) or {}).get(key) for name, key in statistics]
        rows.append(table_row(label, values, summary, reason))
        if cuts := camera.get("cuts"):
            values = [((camera.get(name) or {}).get("without_cuts") or {}).get(key) for name, key in statistics]
            rows.append(
                table_row(f"{label}, {WITHOUT_CUTS}", values, summary, "every pair is a cut", left_out=len(cuts))
            )
    return rows


def table_row(label: str, values: Sequence[Any], summary: Summary, *why: str | None, left_out: int = 0) -> Row:
    """A row that ends with fps and N (less ``left_out``).  ``why``: one reason for all missing values, or one each."""
    row = Row.of(label, values, *why)
    pairs = None if summary.get("pairs") is None else summary["pairs"] - left_out
    return replace(row, values=(*row.values, (summary.get("settings") or {}).get("fps"), pairs))


def _prefix(label: str, labels: Sequence[str]) -> str:
    return f"{label}: " if len(labels) > 1 else ""


def conditions(summary: Summary) -> str:
    """The settings on which discard rates depend."""
    settings = summary.get("settings") or {}
    thresholds = ", ".join(
        f"{name} {value:.4g}{' m' if name == 'position' else ''}" for name, value in thresholds_of(summary).items()
    )
    size = f"{settings.get('width', '?')}x{settings.get('height', '?')}"
    if not summary.get("path_traced") and size == "{}x{}".format(*DEFAULT_SIZE):
        size += " (--size paper: {}x{})".format(*PAPER_SIZE)
    return f"{size}, {comparison_text(summary)}; thresholds: {thresholds or 'not recorded'}."


INTERVAL = "± of 95 % intervals"


def half_width(entry: Mapping[str, Any]) -> float | None:
    """Half width of the 95 % interval of an estimated share, points; None where every pixel was measured."""
    ends = entry.get("interval95_percent")
    return None if ends is None else 0.5 * (ends[1] - ends[0])


def interval_text(entry: Mapping[str, Any]) -> str | None:
    """``95 %: 13.2 to 14.9 %``; None where every pixel was measured."""
    ends = entry.get("interval95_percent")
    return ends and f"95 %: {two_decimals(ends[0])} to {two_decimals(ends[1])} %"


def sampled_text(summary: Summary) -> str | None:
    """At which pixels the columns of light are path-traced, and what the preview gives; None where images are."""
    if decided := summary.get("decided_light"):
        share = two_decimals(decided["undecided_percent"])
        most = decided["most_samples_per_pixel"]
        return (
            f"path-traced light decided at every pixel, {share} % undecided at {most} samples, whose noise makes "
            "shares of few pixels too high and of many too low; images show the preview."
        )
    about = summary.get("sampled_light")
    entries = {n: e for n, e in (summary.get("discard") or {}).items() if (e or {}).get("preview_percent") is not None}
    if not about or not entries:
        return None
    preview = ", ".join(f"{name} {two_decimals(entry['preview_percent'])} %" for name, entry in entries.items())
    undecided = next(iter(entries.values())).get("undecided_percent")
    text = f"path-traced light at {about['pixels']:,} random pixels of {about['pairs']} pairs"
    return f"{text}, {two_decimals(undecided)} % of them undecided; images show the preview, which has {preview}."


def sensitivity(summary: Summary) -> str | None:
    """``at half and twice the exposure: direct 20.15 and 31.40 %, ...`` of all pixels; None where it is not known."""
    entries = {name: (summary.get("discard") or {}).get(name) or {} for name in ("direct", "indirect")}
    keys = ("at_half_exposure_percent", "at_twice_exposure_percent")
    pairs = {name: [entry.get(key) for key in keys] for name, entry in entries.items()}
    measured = {name: values for name, values in pairs.items() if any(value is not None for value in values)}
    shares = ", ".join(
        f"{name} {two_decimals(low)} and {two_decimals(high)} %" for name, (low, high) in measured.items()
    )
    return f"at half and twice the exposure: {shares}." if shares else None


def two_decimals(value: float | None) -> str:
    """Two decimals, ``<0.01`` for a value that is not zero, ``unknown`` for none."""
    return "unknown" if value is None else "<0.01" if 0 < value < 0.005 else f"{value:.2f}"


def thresholds_of(summary: Summary) -> dict[str, float]:
    """Feature -> threshold a_B of a run; that of position in meters."""
    return dict((summary.get("settings") or {}).get("thresholds") or {})


def _notes(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> tuple[str, ...]:
    """Notes of all four tables, below the last: one of camera and light, and the source of the paper's rows."""
    notes = []
    for label, summary in zip(labels, summaries, strict=True):
        parts = [text for text in (_camera_text(summary), lighting_text(summary)) if text]
        notes += [f"{_prefix(label, labels)}{'; '.join(parts)}."] if parts else []
        stand_in = (summary.get("scene") or {}).get("stand_in")
        notes += [f"{_prefix(label, labels)}stand-in: {stand_in}."] if stand_in else []
    if paper:
        notes.append(f"Paper: {paper_numbers()['citation']}.  It does not state the rate of its Tables 2 and 3.")
    return tuple(notes)


def _camera_text(summary: Summary) -> str | None:
    """``camera 'walk' (node 'eye'), 0.113 m and 1.17° per frame``, means of Tables 2 and 3; None without a camera."""
    camera = summary.get("camera") or {}
    # What a framing orbit moves is the mean that follows.
    source = str(camera.get("source") or "").removeprefix("camera ").partition(": moves")[0]
    meters, degrees = ((camera.get(name) or {}).get("mean") for name in ("position", "angle"))
    text = f"camera: {source}" if source else "camera"
    if meters is not None and degrees is not None:
        return f"{text}, {meters:.3g} m and {degrees:.3g}° per frame"
    return text if source else None
