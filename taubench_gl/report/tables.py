"""Tables 1 to 4 of the paper as plain data, with one or several runs; ``report.render`` formats them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from typing import Any

from taubench_gl.conventions import Visibility
from taubench_gl.features import COLUMNS
from taubench_gl.glossary import CAMERA, CENSUS, EXACT, EXACT_REASONS, STATISTICS
from taubench_gl.glossary import COLUMNS as COLUMN_TERMS
from taubench_gl.report.labels import lighting_text, run_labels
from taubench_gl.settings import DEFAULT_SIZE, PAPER_SIZE

Summary = Mapping[str, Any]

WITHOUT_CUTS = STATISTICS["without_cuts_mean_percent"].label


@dataclass(frozen=True, slots=True)
class Column:
    """A column of numbers.

    ``digits``: decimals in formatted text, ``None`` for integers; CSV keeps all.  ``definition``: tooltip in HTML.
    """

    name: str
    unit: str = ""
    digits: int | None = None
    definition: str = ""
    percent_of: str = ""  # as in Row, of a column with another base than the others


@dataclass(frozen=True, slots=True)
class Row:
    """``values`` in the order of the columns, ``None`` for a missing one; ``paper``: a row of the paper.

    ``reasons`` maps the index of a column to its footnote: why the value is missing, or a remark.
    """

    label: str
    values: tuple[Any, ...]
    paper: bool = False
    reasons: Mapping[int, str] = field(default_factory=dict)
    percent_of: str = "%"  # unit of the columns in percent: of which pixels


@dataclass(frozen=True, slots=True)
class Table:
    """One table.  ``number`` as in the paper, or the name of a table that is not in the paper.

    ``lead`` comes before the table, ``notes`` after it; both refer to the whole table.
    """

    number: int | str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()
    lead: tuple[str, ...] = ()


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
        values = [census.get(key) for key in _CENSUS]
        rows.append(table_row(label, values, summary, census.get("reason")))
    if paper:
        numbers = paper_numbers()
        bones = f"the paper gives {numbers['bones_per_armature']} animated bones per armature, not their sum"
        for scene in numbers["scenes"]:
            values = [scene["census"].get(key) for key in _CENSUS]
            reasons = {2: bones} if scene["census"]["armatures"] else {}
            rows.append(Row(scene["name"], (*values, None, None), paper=True, reasons=reasons))
    columns = (*(Column(CENSUS[key].label, definition=CENSUS[key].tooltip) for key in _CENSUS), *SAMPLING_COLUMNS)
    return Table(1, "Animation details", columns, tuple(rows), _notes(summaries, labels, paper))


def _position(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    keys = ("mean", "variance", "max", "median", "p95")
    statistics = [("position", key) for key in keys]
    rows = _camera_rows(summaries, labels, statistics)
    if paper:
        rows += [
            Row(scene["name"], (*(scene["position"].get(key) for key in keys), None, None), paper=True)
            for scene in paper_numbers()["scenes"]
        ]
    columns = tuple(_camera_column("position", key, key, "m") for key in keys)
    notes = _notes(summaries, labels, paper, _paper_rate(paper))
    return Table(2, "Change in the camera's position per frame", (*columns, *SAMPLING_COLUMNS), tuple(rows), notes)


def _rotation(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    statistics = [(axis, key) for axis in ("pitch", "yaw", "roll") for key in ("mean", "variance")]
    statistics += [("angle", key) for key in ("mean", "variance", "max")]
    rows = _camera_rows(summaries, labels, statistics)
    if paper:
        rows += [
            Row(scene["name"], (*(scene["rotation"].get(f"{a}_{k}") for a, k in statistics), None, None), paper=True)
            for scene in paper_numbers()["scenes"]
        ]
    short = {"mean": "mean", "variance": "var", "max": "max"}
    columns = tuple(_camera_column(axis, key, f"{axis} {short[key]}", "deg") for axis, key in statistics)
    notes = ("angle: the geodesic angle between the two orientations; not in the paper.",)
    notes += _notes(summaries, labels, paper, _paper_rate(paper))
    return Table(3, "Change in the camera's rotation per frame", (*columns, *SAMPLING_COLUMNS), tuple(rows), notes)


def _camera_column(quantity: str, statistic: str, name: str, unit: str) -> Column:
    definition = f"{STATISTICS[statistic].definition}: {CAMERA[quantity].tooltip}"
    return Column(name, f"{unit}²" if statistic == "variance" else unit, 3, definition)


SEEN = ("visible", "occluded")
"""Columns of exact visibility in Table 4."""


def _discard(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    rows, seen = [], SEEN if any(summary.get("exact") for summary in summaries) else ()
    for label, summary in zip(labels, summaries, strict=True):
        discard = summary.get("discard") or {}
        entries = [discard.get(name) or {} for name in COLUMNS]
        all_pixels = STATISTICS["mean_percent"].label
        bases = {"mean_percent": all_pixels}
        cuts = (summary.get("camera") or {}).get("cuts") or ()
        if cuts:
            bases["without_cuts_mean_percent"] = f"{all_pixels}, {WITHOUT_CUTS}"
        bases["comparable_mean_percent"] = STATISTICS["comparable_mean_percent"].label
        for key, basis in bases.items():
            why = [entry.get("reason") for entry in entries]
            if key == "comparable_mean_percent":
                why[0] = why[0] or "pixels discarded by frustum are not comparable"
            left_out = len(cuts) if key == "without_cuts_mean_percent" else 0
            values = [entry.get(key) for entry in entries]
            values += _seen_values(summary, seen, key)
            why += ["run with --exact" if not summary.get("exact") else "of all pixels only"] * len(seen)
            row = table_row(f"{label}, {basis}", values, summary, *why, left_out=left_out)
            rows.append(replace(row, percent_of=basis.split(",")[0]))
            if key == "mean_percent" and summary.get("noise_floor"):
                rows.append(replace(_noise_floor(label, summary, len(seen)), percent_of=all_pixels))
        if summary.get("exact"):
            rows.append(_misregistered(label, summary))
    if paper:
        fps = float(paper_numbers()["settings"]["render_fps"])
        rows += [
            Row(
                scene["name"],
                (*(scene["discard"].get(name) for name in COLUMNS), *(None for _ in seen), fps, None),
                paper=True,
                percent_of=STATISTICS["mean_percent"].label,
            )
            for scene in paper_numbers()["scenes"]
        ]
    named = [*((name, COLUMN_TERMS[name]) for name in COLUMNS), *((name, EXACT[name]) for name in seen)]
    columns = (*(Column(name, "%", 2, term.tooltip) for name, term in named), *SAMPLING_COLUMNS)
    notes = tuple(
        f"{_prefix(label, labels)}{conditions(summary)}" for label, summary in zip(labels, summaries, strict=True)
    )
    notes += tuple(
        f"{_prefix(label, labels)}{text}"
        for label, text in zip(labels, map(sensitivity, summaries), strict=True)
        if text is not None
    )
    for label, summary in zip(labels, summaries, strict=True):
        if summary.get("path_traced") and not summary.get("noise_floor"):
            notes += (
                f"{_prefix(label, labels)}the noise floor is unknown; it requires a second render with another seed.",
            )
    if paper:
        notes += ("The paper does not state the thresholds of its Table 4.",)
    notes += _notes(summaries, labels, paper)
    return Table(4, "Discarded pixels, mean over the animation", columns, tuple(rows), notes)


def exact_tables(summaries: Sequence[Summary]) -> list[Table]:
    """Exact reasons and misses of the runs that have them; empty where none does."""
    labels, rows = run_labels(summaries), []
    for label, summary in zip(labels, summaries, strict=True):
        exact = summary.get("exact")
        if not exact:
            continue
        parts = [_sum_of(exact, names) for names in _REASON_BLOCKS.values()]
        rates = [*parts, *((exact.get(name) or {}).get("mean_percent") for name in ("light_noise", "missed"))]
        why = [*["no light was measured"] * len(parts), "no path-traced light", "position or normal not measured"]
        rows.append(replace(table_row(label, rates, summary, *why), percent_of=STATISTICS["mean_percent"].label))
    if not rows:
        return []
    named = [(term.label, term.tooltip) for term in EXACT_REASONS.values()]
    named += [(name.replace("_", " "), EXACT[name].tooltip) for name in ("light_noise", "missed")]
    columns = (*(Column(name, "%", 2, text) for name, text in named), *SAMPLING_COLUMNS)
    title = "Exact reasons: by rays and the light of the same points"
    return [Table("exact reasons", title, columns, tuple(rows))]


_REASON_BLOCKS = {
    Visibility.OCCLUDED: ("occluded",), Visibility.OUTSIDE | Visibility.BEHIND: ("outside", "behind"),
    Visibility.NEW: ("new",), Visibility.BRIGHTENED: ("brightened",), Visibility.DARKENED: ("darkened",),
    Visibility.VIEW_DEPENDENT: ("view_dependent",),
}  # fmt: skip
"""Exact reason -> blocks of ``exact`` in summary.json, in the order of EXACT_REASONS."""


def _sum_of(exact: Mapping[str, Any], names: Sequence[str]) -> float | None:
    values = [(exact.get(name) or {}).get("mean_percent") for name in names]
    return None if None in values else sum(values)


def _seen_values(summary: Summary, seen: Sequence[str], key: str) -> list[float | None]:
    exact = summary.get("exact") or {}
    return [(exact.get(name) or {}).get("mean_percent") if key == "mean_percent" else None for name in seen]


def _misregistered(label: str, summary: Summary) -> Row:
    """Of the discards of each column, the share whose surface point was visible and unchanged."""
    wrong = summary["exact"].get("misregistered") or {}
    values = [(wrong.get(name) or {}).get("share_percent") for name in COLUMNS]
    why = [(wrong.get(name) or {}).get("reason") or "nothing discarded" for name in COLUMNS]
    why[0] = "the frustum test is the same"
    row = table_row(
        f"{label}, share misregistered", [*values, *(None for _ in SEEN)], summary, *why, *("no discard" for _ in SEEN)
    )
    return replace(row, percent_of="% of discards")


def _noise_floor(label: str, summary: Summary, more: int) -> Row:
    """Discard rates between two renders of the same frames: one pair per frame, hence N + 1 pairs."""
    floor = summary["noise_floor"]
    entries = [floor.get(name) or {} for name in COLUMNS]
    why = [entry.get("reason") or "geometry is assumed to be free of noise" for entry in entries]
    values = [e.get("mean_percent") for e in entries] + [None] * more
    return table_row(f"{label}, noise floor", values, summary, *why, *("no noise" for _ in range(more)), left_out=-1)


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
    each = why if len(why) == len(values) else why * len(values)
    reasons = {i: each[i] or "not measured" for i, value in enumerate(values) if value is None}
    pairs = summary.get("pairs")
    pairs = None if pairs is None else pairs - left_out
    return Row(label, (*values, (summary.get("settings") or {}).get("fps"), pairs), reasons=reasons)


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
    ways = f"{settings.get('reprojection', '?')} reprojection, {settings.get('sampling', '?')} sampling"
    return f"{size}, {ways}; thresholds: {thresholds or 'not recorded'}."


def sensitivity(summary: Summary) -> str | None:
    """``at half and twice the exposure: direct 20.15 and 31.40 %, ...`` of all pixels; None where it is not known."""
    entries = {name: (summary.get("discard") or {}).get(name) or {} for name in ("direct", "indirect")}
    keys = ("at_half_exposure_percent", "at_twice_exposure_percent")
    pairs = {name: [entry.get(key) for key in keys] for name, entry in entries.items()}
    known = {name: values for name, values in pairs.items() if any(value is not None for value in values)}
    shares = ", ".join(f"{name} {_share(low)} and {_share(high)} %" for name, (low, high) in known.items())
    return f"at half and twice the exposure: {shares}." if shares else None


def _share(value: float | None) -> str:
    return "unknown" if value is None else "<0.01" if 0 < value < 0.005 else f"{value:.2f}"


def thresholds_of(summary: Summary) -> dict[str, float]:
    """a_B per feature; position in meters."""
    return dict((summary.get("settings") or {}).get("thresholds") or {})


def _paper_rate(paper: bool) -> str:
    return "The paper does not state the sampling rate of its camera tables." if paper else ""


def _notes(summaries: Sequence[Summary], labels: Sequence[str], paper: bool, *more: str) -> tuple[str, ...]:
    """Notes of every table: camera and lighting, and the source of the paper's rows."""
    notes = []
    for label, summary in zip(labels, summaries, strict=True):
        source = (summary.get("camera") or {}).get("source")
        notes += [f"{_prefix(label, labels)}camera: {source.removeprefix('camera ')}."] if source else []
        stand_in = (summary.get("scene") or {}).get("stand_in")
        lighting = lighting_text(summary)
        notes += [f"{_prefix(label, labels)}{lighting}."] if lighting else []
        notes += [f"{_prefix(label, labels)}stand-in: {stand_in}."] if stand_in else []
    notes += [note for note in more if note]
    if paper:
        notes.append(f"Paper: {paper_numbers()['citation']}.")
    return tuple(notes)
