"""The finished study: points from records, Pareto fronts, recommendations, and the files that are written of them."""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.conventions import COLUMNS
from taubench_gl.cost.analysis import (
    RULE,
    Choice,
    Point,
    choose,
    measured_columns,
    pareto_front,
    time_of,
    worst_error,
)
from taubench_gl.cost.configurations import BASELINE, HIGHEST, Plan
from taubench_gl.cost.errors import Record, column_errors
from taubench_gl.cost.methods import MethodPoint, against, methods_json
from taubench_gl.cost.preset import save_preset
from taubench_gl.cost.timing import median_passes, round_medians
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.pathtraced.series import SampleCountSeries

COST_SCHEMA = "taubench-gl/cost/2"
ALL = "all"
"""Name of the Pareto front of the worst error over several columns."""

STUDY_FILE, PRESET_FILE = "study.json", "preset.toml"
DEFAULT_WITHIN = 0.5
"""Percentage points of the recommendation per column, where neither ``within`` nor ``budget_ms`` is given."""


@dataclass(slots=True)
class CostStudy:
    """What ``cost`` returns.  ``points`` in the order of the plan, path-traced renders last."""

    about: dict[str, Any]
    points: list[Point]
    plan: Plan
    methods: list[MethodPoint] = field(default_factory=list)
    requested_lighting: dict[str, Any] = field(default_factory=dict)  # light unit, exposure, environment; may be auto
    chosen_columns: tuple[str, ...] = ()  # columns of the recommendation, () for all
    recommendations: list[Choice] = field(default_factory=list)  # one per column
    chosen: Choice | None = None  # for ``within`` and ``budget_ms``
    validation: dict[str, Any] | None = None  # of ``chosen``, see ``analysis.validate``
    out: Path | None = None

    @property
    def columns(self) -> list[str]:
        """Columns for which the baseline has an error."""
        return measured_columns(self.points)

    def point(self, name: str) -> Point:
        return next(p for p in self.points if p.name == name)

    @property
    def fronts(self) -> dict[str, tuple[str, ...]]:
        """Columns of every Pareto front: one each, and ``ALL``, the worst error of the chosen ones if several."""
        chosen = tuple(c for c in (self.chosen_columns or self.columns) if c in self.columns)
        return {c: (c,) for c in self.columns} | ({ALL: chosen} if len(chosen) > 1 else {})

    def front(self, name: str) -> list[Point]:
        """The Pareto front of a column or of ``ALL``, fastest first."""
        return pareto_front(self.points, self.fronts.get(name, name))

    def choose(self, within: float | None, budget_ms: float | None, columns: Sequence[str] | None) -> None:
        """Set ``recommendations`` and, if there is a limit, ``chosen``."""
        self.chosen_columns = tuple(columns or ())
        limited = within is not None or budget_ms is not None
        each = within if limited else DEFAULT_WITHIN
        self.recommendations = [choose(self.points, (c,), within=each, budget_ms=budget_ms) for c in self.columns]
        if limited:
            wanted = self.chosen_columns or tuple(self.columns)
            self.chosen = choose(self.points, wanted, within=within, budget_ms=budget_ms)

    def as_json(self) -> dict[str, Any]:
        """study.json: all numbers of the tables and figures."""
        return {
            "schema": COST_SCHEMA,
            **self.about,
            "rule": RULE,
            "columns": self.columns,
            "points": [self._point_json(p) for p in self.points],
            "fronts": {name: [p.name for p in self.front(name)] for name in self.fronts},
            "front_columns": {name: list(columns) for name, columns in self.fronts.items()},
            "recommendations": [_choice_json(c) for c in self.recommendations],
            "chosen": None if self.chosen is None else _choice_json(self.chosen),
            "validation": self.validation,
            "methods": methods_json(self.methods),
        }

    def _point_json(self, p: Point) -> dict[str, Any]:
        columns = self.fronts.get(ALL, ())
        worst = None if p.role == "definition" else worst_error(p, columns)
        return {
            "name": p.name,
            "label": p.label,
            "role": p.role,
            "values": dict(p.values),
            "columns": {c: asdict(e) | {"error": e.error} for c, e in p.columns.items()},
            "worst": {"error": worst, "column": None if worst is None else max(columns, key=p.error)},
            "ms": None if p.time is None else asdict(p.time),
            "clock": p.clock,
            "against_baseline": against(p.time, self.point(BASELINE).time),
            "usable": p.usable,
            "features": dict(p.features),
            "passes": dict(p.passes),
            "bytes": p.bytes,
        }

    def table(self) -> Any:
        """Pareto fronts and all configurations: printable, and HTML in a notebook."""
        from taubench_gl.report.cost_tables import CostView

        return CostView(self.as_json())

    def save(self, out: str | Path | None = None) -> list[Path]:
        """Write study.json, tables (text, Markdown, CSV), plots (PNG, SVG), study.html and, if something was chosen,
        preset.toml.  Returns the files.  Raises OutputError."""
        from taubench_gl.report.cost_page import cost_html
        from taubench_gl.report.cost_plots import plot_fronts
        from taubench_gl.report.cost_tables import cost_csv, cost_markdown, cost_text

        folder = output_folder(out or self.out)
        values = self.as_json()
        texts = {
            STUDY_FILE: json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False) + "\n",
            "study.txt": cost_text(values),
            "study.md": cost_markdown(values),
            "study.csv": cost_csv(values),
            "study.html": cost_html(values),
        }
        for name, text in texts.items():
            write_atomically(folder / name, text)
        written = [*(folder / name for name in texts), *plot_fronts(values, folder)]
        preset = folder / PRESET_FILE
        if self.chosen is not None and self.chosen.point is not None:
            # A preset is for other scenes too: it leaves open what the caller left open.
            settings = self.plan.named(self.chosen.point.name).settings.replace(**self.requested_lighting)
            save_preset(preset, settings, self._measured())
            written.append(preset)
        else:
            preset.unlink(missing_ok=True)  # it would be of another choice
        return written

    def _measured(self) -> dict[str, Any]:
        chosen, point = self.chosen, self.chosen.point
        return {
            "scene": self.about["scene"]["name"],
            "configuration": point.label,
            "reference": self.about["reference"]["name"],
            "columns": list(chosen.columns),
            "error_points": {c: float(point.error(c)) for c in chosen.columns},
            "within_points": "" if chosen.within is None else float(chosen.within),
            "ms_per_frame": float(point.time.median),
            "budget_ms": "" if chosen.budget_ms is None else float(chosen.budget_ms),
            "clock": point.clock,
            "renderer": self.about["machine"]["renderer"],
        }


def assemble(
    about: Mapping[str, Any], plan: Plan, series: SampleCountSeries | None, records: Sequence[Record], repeats: int
) -> CostStudy:
    """The study from records of the kinds ``error`` and ``time``, of which the first ``repeats`` rounds count."""
    errors = {r["configuration"]: r for r in records if r["kind"] == "error"}
    reference = errors[HIGHEST if series is None else series.reference.name]
    rounds = round_medians(r for r in records if r["kind"] == "time")
    points = []
    for c in plan.configurations:
        timed = rounds.get(c.name, [])[:repeats]
        points.append(
            Point(
                c.name,
                c.label,
                c.role,
                c.values,
                column_errors(errors[c.name], reference, same_pairs=c.role != "definition"),
                time_of([r["frame_ms"] for r in timed]) if timed else None,
                about["clock"],
                usable=not c.on_cpu,
                features=errors[c.name].get("features") or {},
                passes=median_passes(timed),
                bytes=errors[c.name].get("bytes"),
            )
        )
    for render in () if series is None else series.renders:
        record = errors[render.name]
        time = time_of(render.frame_ms, interleaved=False) if render.frame_ms else None
        columns = column_errors(record, reference, same_pairs=True)
        label, features = f"path-traced, {render.samples} spp", record.get("features") or {}
        values = {"spp": render.samples}
        points.append(Point(render.name, label, "path_traced", values, columns, time, render.clock, False, features))
    loads = [r["load"] for r in records if r.get("load") is not None]
    floor = reference.get("floor") or {}
    about = dict(about) | {"load": statistics.median(loads) if loads else None}
    about["reference"] = about["reference"] | {
        "percent": {c: reference["columns"][c]["percent"] for c in COLUMNS},
        "floor": {c: _noise_floor(c, series, floor) for c in COLUMNS},
    }
    return CostStudy(about, points, plan)


def _noise_floor(column: str, series: SampleCountSeries | None, floor: Mapping[str, float | None]) -> dict[str, Any]:
    """Percentage points by which the reference would change if it were rendered again."""
    if series is None:
        return {"points": 0.0, "reason": "the reference has no random part"}
    if floor.get(column) is not None:
        return {"points": floor[column], "reason": "discards between two renders with different seeds"}
    if series.second is None:
        return {"points": None, "reason": "unknown: there is no second render with as many samples"}
    return {"points": None, "reason": "not measured: geometry has no noise"}


def _choice_json(c: Choice) -> dict[str, Any]:
    return {
        "columns": list(c.columns),
        "within": c.within,
        "budget_ms": c.budget_ms,
        "words": c.words,
        "configuration": None if c.point is None else c.point.name,
        "next": None if c.next is None else c.next.name,
    }
