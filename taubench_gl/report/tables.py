"""Tables 1 to 4 of the paper as plain data, from one summary or several side by side.

A Table says nothing about looks: ``report.render`` turns it into text, Markdown, CSV, LaTeX or HTML.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from taubench_gl.conventions import COLUMNS
from taubench_gl.report.labels import differing, flat_settings, labelled, phrase

Summary = Mapping[str, Any]

WITHOUT_CUTS = "without cuts"
_CAMERA_REMARK = re.compile(r" \(|: ")
"""What a camera's source says beyond which camera it is begins here."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of numbers.  ``digits`` after the point in rendered text, ``None`` for integers; CSV keeps them all."""

    name: str
    unit: str = ""
    digits: int | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """``values`` in the order of the table's columns, ``None`` where there is none.

    ``reasons`` maps a column's index to why its value is ``None`` (or what to know about it): its footnote.
    """

    label: str
    values: tuple[Any, ...]
    paper: bool = False
    reasons: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Table:
    """One table: ``number`` as in the paper, ``notes`` hold for the whole table."""

    number: int
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()


@cache
def paper_numbers() -> dict[str, Any]:
    """The paper's Tables 1 to 4 (``paper.json`` beside this file)."""
    return json.loads(resources.files(__package__).joinpath("paper.json").read_text(encoding="utf-8"))


def paper_tables(summaries: Sequence[Summary], paper: bool = True) -> list[Table]:
    """Tables 1 to 4 of ``summaries`` (summary.json as dicts), a row or two each, the paper's rows beneath."""
    labels = run_labels(summaries)
    return [builder(summaries, labels, paper) for builder in (_census, _position, _rotation, _discard)]


# How often sampled, and how many pairs: no statistic is printed without them.
_SAMPLING = (Column("fps", "1/s", 0), Column("N", "pairs"))

_CENSUS = (
    ("dynamic_rigid_objects", "dynamic rigid objects"),
    ("armatures", "armatures"),
    ("bones", "bones"),
    ("static_point_lights", "static point lights"),
    ("dynamic_point_lights", "dynamic point lights"),
)


def _census(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    rows = []
    for label, summary in zip(labels, summaries, strict=True):
        census = summary.get("census") or {}
        values = [census.get(key) for key, _ in _CENSUS]
        rows.append(_row(label, values, summary, census.get("reason")))
    if paper:
        numbers = paper_numbers()
        bones = f"the paper gives {numbers['bones_per_armature']} animated bones per armature, no sum"
        for scene in numbers["scenes"]:
            values = [scene["census"].get(key) for key, _ in _CENSUS]
            reasons = {2: bones} if scene["census"]["armatures"] else {}
            rows.append(Row(scene["name"], (*values, None, None), paper=True, reasons=reasons))
    columns = (*(Column(name) for _, name in _CENSUS), *_SAMPLING)
    return Table(1, "Animation details", columns, tuple(rows), _notes(summaries, labels, paper))


def _position(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    keys = ("mean", "variance", "max", "median", "p95")
    wanted = [("position", key) for key in keys]
    rows = _camera_rows(summaries, labels, wanted)
    if paper:
        rows += [
            Row(scene["name"], (*(scene["position"].get(key) for key in keys), None, None), paper=True)
            for scene in paper_numbers()["scenes"]
        ]
    columns = tuple(Column(key, "m²" if key == "variance" else "m", 3) for key in keys)
    notes = _notes(summaries, labels, paper, _paper_rate(paper))
    return Table(2, "Change in the camera's position per frame", (*columns, *_SAMPLING), tuple(rows), notes)


def _rotation(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    wanted = [(axis, key) for axis in ("pitch", "yaw", "roll") for key in ("mean", "variance")]
    wanted += [("angle", key) for key in ("mean", "variance", "max")]
    rows = _camera_rows(summaries, labels, wanted)
    if paper:
        rows += [
            Row(scene["name"], (*(scene["rotation"].get(f"{a}_{k}") for a, k in wanted), None, None), paper=True)
            for scene in paper_numbers()["scenes"]
        ]
    short = {"mean": "mean", "variance": "var", "max": "max"}
    columns = tuple(Column(f"{axis} {short[key]}", "deg²" if key == "variance" else "deg", 3) for axis, key in wanted)
    notes = ("angle: the geodesic angle between the two orientations, not in the paper.",)
    notes += _notes(summaries, labels, paper, _paper_rate(paper))
    return Table(3, "Change in the camera's rotation per frame", (*columns, *_SAMPLING), tuple(rows), notes)


def _discard(summaries: Sequence[Summary], labels: Sequence[str], paper: bool) -> Table:
    rows = []
    for label, summary in zip(labels, summaries, strict=True):
        discard = summary.get("discard") or {}
        entries = [discard.get(name) or {} for name in COLUMNS]
        bases = [("of w·h", "mean_percent"), ("of comparable", "comparable_mean_percent")]
        cuts = (summary.get("camera") or {}).get("cuts") or ()
        if cuts:
            bases.insert(1, (f"of w·h {WITHOUT_CUTS}", "without_cuts_mean_percent"))
        for basis, key in bases:
            why = [entry.get("reason") for entry in entries]
            if key == "comparable_mean_percent":
                why[0] = why[0] or "frustum discards are what is not comparable"
            left_out = len(cuts) if key == "without_cuts_mean_percent" else 0
            values = [entry.get(key) for entry in entries]
            rows.append(_row(f"{label} {basis}", values, summary, *why, left_out=left_out))
            if key == "mean_percent" and summary.get("noise_floor"):
                rows.append(_noise_floor(label, summary))
    if paper:
        fps = float(paper_numbers()["settings"]["render_fps"])
        rows += [
            Row(scene["name"], (*(scene["discard"][name] for name in COLUMNS), fps, None), paper=True)
            for scene in paper_numbers()["scenes"]
        ]
    columns = (*(Column(name, "%", 2) for name in COLUMNS), *_SAMPLING)
    notes = tuple(f"{_who(label, labels)}{_how(summary)}" for label, summary in zip(labels, summaries, strict=True))
    for label, summary in zip(labels, summaries, strict=True):
        if summary.get("path_traced") and not summary.get("noise_floor"):
            notes += (f"{_who(label, labels)}the noise floor is not known; a render with another seed would tell.",)
    if paper:
        notes += ("The paper does not publish the thresholds behind its Table 4.",)
    notes += _notes(summaries, labels, paper)
    return Table(4, "Discarded pixels, mean over the animation", columns, tuple(rows), notes)


def _noise_floor(label: str, summary: Summary) -> Row:
    """Discards that noise alone makes: the same frames of two renders, one pair per frame instead of per step."""
    floor = summary["noise_floor"]
    entries = [floor.get(name) or {} for name in COLUMNS]
    why = [entry.get("reason") or "geometry is taken as free of noise" for entry in entries]
    return _row(f"{label} noise floor", [e.get("mean_percent") for e in entries], summary, *why, left_out=-1)


def _camera_rows(summaries: Sequence[Summary], labels: Sequence[str], wanted: Sequence[tuple[str, str]]) -> list[Row]:
    """One row per summary, and one more without its cuts where it has any."""
    rows = []
    for label, summary in zip(labels, summaries, strict=True):
        camera = summary.get("camera") or {}
        reason = camera.get("reason") or ("no frame pair" if not camera.get("samples") else "not measured")
        values = [(camera.get(name) or {}).get(key) for name, key in wanted]
        rows.append(_row(label, values, summary, reason))
        if cuts := camera.get("cuts"):
            kept = [((camera.get(name) or {}).get("without_cuts") or {}).get(key) for name, key in wanted]
            rows.append(_row(f"{label} {WITHOUT_CUTS}", kept, summary, "every pair is a cut", left_out=len(cuts)))
    return rows


def _row(label: str, values: Sequence[Any], summary: Summary, *why: str | None, left_out: int = 0) -> Row:
    """A row with fps and N (less ``left_out``) at its end.  ``why`` a value is None: one for all, or for each."""
    each = why if len(why) == len(values) else why * len(values)
    reasons = {i: each[i] or "not measured" for i, value in enumerate(values) if value is None}
    pairs = summary.get("pairs")
    pairs = None if pairs is None else pairs - left_out
    return Row(label, (*values, (summary.get("settings") or {}).get("fps"), pairs), reasons=reasons)


def run_labels(summaries: Sequence[Summary]) -> list[str]:
    """Scene names; runs of one scene with the settings that differ, numbered only where nothing differs."""
    names = [str((summary.get("scene") or {}).get("name") or "scene") for summary in summaries]
    labels = list(names)
    for name in dict.fromkeys(names):
        at = [i for i, other in enumerate(names) if other == name]
        for i, apart in zip(at, differing([_told_settings(summaries[i]) for i in at]), strict=True):
            labels[i] = labelled(name, (phrase(*item) for item in apart.items()))
    count = labels.count
    return [f"{one} #{labels[: i + 1].count(one)}" if count(one) > 1 else one for i, one in enumerate(labels)]


def _told_settings(summary: Summary) -> dict[str, str]:
    """Flat settings of a run, thresholds as they are shown, and the camera it was seen by, in short."""
    settings = summary.get("settings") or {}
    source = str((summary.get("camera") or {}).get("source") or "")
    camera = {"camera": _CAMERA_REMARK.split(source)[0].removeprefix("camera ")} if source else {}
    return flat_settings(settings) | camera


def _who(label: str, labels: Sequence[str]) -> str:
    return f"{label}: " if len(labels) > 1 else ""


def _how(summary: Summary) -> str:
    """Settings on which a discard percentage depends."""
    settings = summary.get("settings") or {}
    thresholds = ", ".join(
        f"{name} {value:.4g}{' m' if name == 'position' else ''}" for name, value in thresholds_of(summary).items()
    )
    size = f"{settings.get('width', '?')}x{settings.get('height', '?')}"
    ways = f"{settings.get('reprojection', '?')} reprojection, {settings.get('sampling', '?')} sampling"
    return f"{size}, {ways}; thresholds: {thresholds or 'not recorded'}."


def thresholds_of(summary: Summary) -> dict[str, float]:
    """a_B per feature; position in metres."""
    return dict((summary.get("settings") or {}).get("thresholds") or {})


def _paper_rate(paper: bool) -> str:
    return "The paper does not say at which rate its camera tables were sampled." if paper else ""


def _notes(summaries: Sequence[Summary], labels: Sequence[str], paper: bool, *more: str) -> tuple[str, ...]:
    """What holds for every table: whose camera it was, and where the paper's rows come from."""
    notes = []
    for label, summary in zip(labels, summaries, strict=True):
        source = (summary.get("camera") or {}).get("source")
        notes += [f"{_who(label, labels)}camera: {source}."] if source else []
        stand_in = (summary.get("scene") or {}).get("stand_in")
        notes += [f"{_who(label, labels)}stand-in: {stand_in}."] if stand_in else []
    notes += [note for note in more if note]
    if paper:
        notes.append(f"Paper: {paper_numbers()['citation']}.")
    return tuple(notes)
