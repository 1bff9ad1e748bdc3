"""The finished study: points out of records, and what is said, drawn and written of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import COLUMNS
from taubench_gl.cost.analysis import (
    Choice,
    Point,
    Sanity,
    choose,
    measured_columns,
    pareto_front,
    rises,
    worst_error,
)
from taubench_gl.cost.clock import RULE, Time, slower_by
from taubench_gl.cost.methods import MethodPoint, quality_json
from taubench_gl.cost.parameters import KNOBS
from taubench_gl.cost.plan import BASE, BEST, Plan
from taubench_gl.cost.points import errors_of, points_of
from taubench_gl.cost.preset import save_preset
from taubench_gl.cost.promise import hold_against
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.pathtraced.series import SampleCountSeries

COST_SCHEMA = "taubench-gl/cost/1"
ALL = "all"
"""Name of the front of the worst error over the columns asked for."""

STUDY_FILE, PRESET_FILE = "study.json", "preset.toml"


@dataclass(slots=True)
class CostStudy:
    """What ``cost`` returns.  ``points`` in plan order, path-traced renders last."""

    about: dict[str, Any]
    points: list[Point]
    sanity: list[Sanity]
    plan: Plan
    choices: list[Choice] = field(default_factory=list)
    chosen: Choice | None = None  # what ``within`` and ``budget_ms`` asked for
    checked: dict[str, Any] | None = None
    methods: list[MethodPoint] = field(default_factory=list)
    asked: tuple[str, ...] = ()  # columns that the choice is for, () for all
    out: Path | None = None

    @property
    def columns(self) -> list[str]:
        """Columns that the base has an error for."""
        return measured_columns(self.points)

    def point(self, name: str) -> Point:
        return next(p for p in self.points if p.name == name)

    @property
    def fronts(self) -> dict[str, tuple[str, ...]]:
        """Every front's columns: one each, and ``ALL``, the worst of those asked for, where these are several."""
        return fronts_of(self.columns, self.asked)

    def front(self, name: str) -> list[Point]:
        """The Pareto front of a column (or of ``ALL``), fastest first."""
        return pareto_front(self.points, self.fronts.get(name, name))

    def with_choices(self, within: float | None, budget_ms: float | None, columns: Sequence[str] | None) -> CostStudy:
        """Recommendations of every column on its own, and of the wish, if there is one."""
        self.asked = tuple(columns or ())
        wished = self.asked or tuple(self.columns)
        one_each = 0.5 if within is None and budget_ms is None else within
        self.choices = [choose(self.points, (c,), within=one_each, budget_ms=budget_ms) for c in self.columns]
        if within is not None or budget_ms is not None:
            self.chosen = choose(self.points, wished, within=within, budget_ms=budget_ms)
        return self

    def with_check(self, again: Callable[[str], Mapping[str, Any]]) -> CostStudy:
        """Run the chosen setting again and hold what comes out against what was promised."""
        if self.chosen is None or self.chosen.point is None:
            return self
        told = again(self.chosen.point.name)
        reference = self.about["reference"]["percent"]
        self.checked = hold_against(self.chosen, self.point(BASE).time, reference, told)
        return self

    def as_json(self) -> dict[str, Any]:
        """study.json: everything the tables and figures are made of (schema ``taubench-gl/cost/1``)."""
        return {
            "schema": COST_SCHEMA,
            **self.about,
            "rule": RULE,
            "columns": self.columns,
            "points": [self._point_json(p) for p in self.points],
            "fronts": {name: [p.name for p in self.front(name)] for name in self.fronts},
            "front_columns": {name: list(columns) for name, columns in self.fronts.items()},
            "recommendations": [_choice_json(c) for c in self.choices],
            "chosen": None if self.chosen is None else _choice_json(self.chosen),
            "check": self.checked,
            "sanity": [asdict(s) for s in self.sanity],
            "quality": quality_json(self.methods),
        }

    def _point_json(self, p: Point) -> dict[str, Any]:
        columns = self.fronts.get(ALL, ())
        worst = None if p.role == "question" else worst_error(p, columns)
        column = None if worst is None else max(columns, key=p.error)
        return _point_json(p) | {
            "worst": {"error": worst, "column": column},
            "against_base": self._against_base(p),
        }

    def _against_base(self, point: Point) -> dict[str, Any] | None:
        """Time over the base's, and whether the two are different by the rule; None for what has no time."""
        base = self.point(BASE)
        if point.time is None or base.time is None:
            return None
        return {"ratio": point.time.median / base.time.median, "different": slower_by(point.time, base.time) != 0}

    def table(self) -> Any:
        """Fronts and all settings to look at: printable, and HTML in a notebook."""
        from taubench_gl.report.study_tables import StudyView

        return StudyView(self.as_json())

    def save(self, out: str | Path | None = None) -> list[Path]:
        """Write study.json, tables (text, Markdown, CSV), plots (PNG, SVG), study.html and, where something was chosen,
        preset.toml.  Returns the files.  Raises OutputError."""
        from taubench_gl.report.study_html import study_html
        from taubench_gl.report.study_plots import plot_fronts
        from taubench_gl.report.study_tables import study_csv, study_markdown, study_text

        folder = output_folder(out or self.out)
        values = self.as_json()
        texts = {
            STUDY_FILE: json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False) + "\n",
            "study.txt": study_text(values),
            "study.md": study_markdown(values),
            "study.csv": study_csv(values),
            "study.html": study_html(values),
        }
        written = []
        for name, text in texts.items():
            write_atomically(folder / name, text)
            written.append(folder / name)
        written += plot_fronts(values, folder)
        preset = folder / PRESET_FILE
        if self.chosen is not None and self.chosen.point is not None:
            save_preset(preset, self.plan.named(self.chosen.point.name).settings, self._promise())
            written.append(preset)
        else:
            preset.unlink(missing_ok=True)  # one of an earlier wish would be taken for this one's
        return written

    def _promise(self) -> dict[str, Any]:
        point = self.chosen.point
        return {
            "scene": self.about["scene"]["name"],
            "setting": point.label,
            "reference": self.about["reference"]["name"],
            "columns": list(self.chosen.columns),
            "error_points": {c: float(point.error(c)) for c in self.chosen.columns},
            "within_points": "" if self.chosen.within is None else float(self.chosen.within),
            "ms_per_frame": float(point.time.median),
            "budget_ms": "" if self.chosen.budget_ms is None else float(self.chosen.budget_ms),
            "clock": point.clock,
            "renderer": self.about["machine"]["renderer"],
        }


def fronts_of(columns: Sequence[str], asked: Sequence[str] = ()) -> dict[str, tuple[str, ...]]:
    """Fronts of a study that measures ``columns``, of which ``asked`` (all) count for its choice: name -> columns."""
    every = tuple(c for c in (asked or columns) if c in columns)
    return {c: (c,) for c in columns} | ({ALL: every} if len(every) > 1 else {})


def assemble(
    about: Mapping[str, Any],
    plan: Plan,
    series: SampleCountSeries | None,
    records: Sequence[Mapping[str, Any]],
    repeats: int,
) -> CostStudy:
    """Points out of records, lines of kind ``error`` and ``time``; the first ``repeats`` rounds count."""
    errors = errors_of(records)
    reference = errors[BEST if series is None else series.reference.name]
    points = points_of(plan.settings, series, records, reference["setting"], repeats, about["clock"])
    floor = reference.get("floor") or {}
    told = dict(about)
    loads = [r["load"] for r in records if r.get("load") is not None]
    told["load"] = float(np.median(loads)) if loads else None
    told["reference"] = {
        **about["reference"],
        "percent": {c: reference["columns"][c]["percent"] for c in COLUMNS},
        "floor": {c: _floor(c, series, floor) for c in COLUMNS},
    }
    return CostStudy(told, points, _sanities(plan, series, errors, reference), plan)


def _floor(column: str, series: SampleCountSeries | None, floor: Mapping[str, float | None]) -> dict[str, Any]:
    """Points by which the reference itself would change if it were made again."""
    if series is None:
        return {"points": 0.0, "reason": "nothing in it is random: the same settings give the same counts"}
    if floor.get(column) is not None:
        return {"points": floor[column], "reason": "discards between two renders of a frame that differ in their seed"}
    if series.second is None:
        return {"points": None, "reason": "not known: no second render with as many samples and another seed"}
    return {"points": None, "reason": "not measured: geometry has no noise"}


def _sanities(plan: Plan, series: SampleCountSeries | None, errors: Mapping[str, Any], reference: Any) -> list[Sanity]:
    """Per dial and column that it may change: does the error fall from coarse to exact?"""
    out = []
    for name in plan.knobs:
        knob = KNOBS[name]
        if knob.kind == "question" or name == "pairs":  # a sample's error is chance: its interval is tested, not it
            continue
        base = knob.current(plan.named(BASE).settings)
        single = {v: f"{name}={v}" for v in knob.values if f"{name}={v}" in errors}
        values = {v: BASE if v == base else single.get(v) for v in knob.values}
        chain = [(v, errors[n]) for v, n in values.items() if n is not None]
        if name == "storage":
            chain = chain[:2]  # double asks what float's arithmetic does, not for a better picture
        if len(chain) > 1:
            out += [_sanity(name, c, chain, reference) for c in knob.columns if _there(chain, reference, c)]
    if series is not None and len(series.renders) > 1:
        chain = [(r.samples, errors[r.name]) for r in series.renders]
        out += [_sanity("spp", c, chain, reference) for c in COLUMNS if _there(chain, reference, c)]
    return out


def _there(chain: Sequence[tuple[Any, Any]], reference: Any, column: str) -> bool:
    return all(r["columns"][column]["percent"] is not None for r in (*(r for _, r in chain), reference))


def _sanity(knob: str, column: str, chain: Sequence[tuple[Any, Any]], reference: Any) -> Sanity:
    truth = reference["columns"][column]
    errors = tuple((v, abs(r["columns"][column]["percent"] - truth["percent"])) for v, r in chain)
    said, faults = [], []
    for (coarse, a), (fine, b) in pairwise(chain):
        rise, error = rises(a["columns"][column]["pairs"], b["columns"][column]["pairs"], truth["pairs"])
        if rise > max(2.0 * error, 1e-9):
            said.append(f"{fine} is {rise:.2g} ± {error:.2g} points per pair further off than {coarse}")
            faults.append((coarse, fine))
    return Sanity(knob, column, errors, not faults, "; ".join(said), tuple(faults))


def _point_json(p: Point) -> dict[str, Any]:
    columns = {c: asdict(e) | {"error": e.error} for c, e in p.columns.items()}
    ms = None if p.time is None else asdict(p.time)
    return {
        "name": p.name, "label": p.label, "role": p.role, "choice": dict(p.choice), "columns": columns, "ms": ms,
        "clock": p.clock, "usable": p.usable, "features": dict(p.features),
        "passes": dict(p.passes), "bytes": p.bytes,
    }  # fmt: skip


def _choice_json(c: Choice) -> dict[str, Any]:
    return {
        "columns": list(c.columns), "within": c.within, "budget_ms": c.budget_ms, "words": c.words,
        "setting": None if c.point is None else c.point.name, "next": None if c.next is None else c.next.name,
    }  # fmt: skip


__all__ = ["COST_SCHEMA", "CostStudy", "Time", "assemble"]
