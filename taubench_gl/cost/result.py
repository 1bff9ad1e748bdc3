"""The study so far: points from records, the Pareto front, the recommendation, and the files written of them."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from taubench_gl.cost.analysis import (
    OVERALL,
    RULE,
    Choice,
    Point,
    against,
    choose,
    mask_errors,
    noise_floor,
    pareto_front,
    time_of,
)
from taubench_gl.cost.configurations import BASELINE, Plan
from taubench_gl.cost.errors import column_differences
from taubench_gl.cost.pixels import discarded, pack_bits, unpack
from taubench_gl.cost.timing import rounds_of
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.preset import save_preset

COST_SCHEMA = "taubench-gl/cost/3"
STUDY_FILE, PRESET_FILE = "study.json", "preset.toml"
ERROR_NUMBERS = ("percent", "false_positive", "false_negative", "points")
BUSY_SHARE, BUSY_DRIFT = 0.1, 0.2
"""A machine is busy if other processes take more than this share of its CPU time while configurations are timed, or if
the times change by more than this share."""

Record = Mapping[str, Any]


@dataclass(slots=True)
class CostStudy:
    """What ``cost`` returns.  ``points`` in the order of the plan, path-traced renders last."""

    about: dict[str, Any]
    points: list[Point]
    plan: Plan
    requested_lighting: dict[str, Any] = field(default_factory=dict)  # light unit, exposure, environment; may be auto
    chosen: Choice | None = None
    out: Path | None = None

    @property
    def columns(self) -> list[str]:
        return list(self.about["columns"])

    def point(self, name: str) -> Point:
        return next(p for p in self.points if p.name == name)

    def front(self, column: str = OVERALL) -> list[Point]:
        """The Pareto front of one column or of the overall error, fastest first."""
        return pareto_front([p for p in self.points if p.role != "effect"], column, self.floor(column))

    def floor(self, column: str = OVERALL) -> float:
        """The noise floor of the reference, percent of the pixels; 0 where it has no random part or is not known."""
        return self.about["reference"]["floor"].get(column) or 0.0

    def choose(self, within: float | None = None, budget_ms: float | None = None, column: str = OVERALL) -> Choice:
        """Recommend, for the overall error or a column; ``chosen`` from now on."""
        self.chosen = choose(self.points, column, self.floor(column), within=within, budget_ms=budget_ms)
        return self.chosen

    def answer(self) -> list[str]:
        """Three lines: what to use, against what it was compared, and how far the numbers can be trusted."""
        from taubench_gl.report.cost_tables import answer

        return answer(self.as_json())

    def as_json(self) -> dict[str, Any]:
        """study.json: all numbers of the tables and figures."""
        measured = (OVERALL, *self.columns)
        return {
            "schema": COST_SCHEMA,
            **self.about,
            "rule": RULE,
            "points": [self._point_json(p) for p in self.points],
            "fronts": {column: [p.name for p in self.front(column)] for column in measured},
            "chosen": None if self.chosen is None else _choice_json(self.chosen),
        }

    def _point_json(self, p: Point) -> dict[str, Any]:
        return {
            **{name: getattr(p, name) for name in ("name", "label", "role", "clock", "usable", "bytes")},
            "values": dict(p.values),
            "masks": {c: {k: getattr(e, k) for k in ERROR_NUMBERS} for c, e in p.masks.items()},
            "columns": {c: asdict(d) for c, d in p.columns.items()},
            "ms": None if p.time is None else asdict(p.time),
            "against_baseline": against(p.time, self.point(BASELINE).time),
            "wrong": pack_bits(p.masks[OVERALL].wrong) if p.masks else None,
        }

    def table(self) -> Any:
        """The answer and all tables: printable, and HTML in a notebook."""
        from taubench_gl.report.cost_tables import CostView

        return CostView(self.as_json())

    def save(self, out: str | Path | None = None) -> list[Path]:
        """Write study.json, tables (text, CSV), the plot (PNG, SVG), study.html and, if something was chosen,
        preset.toml.  Returns the files.  Raises OutputError."""
        from taubench_gl.report.cost_page import cost_html
        from taubench_gl.report.cost_plots import plot_study
        from taubench_gl.report.cost_tables import cost_csv, cost_text

        folder = output_folder(out or self.out)
        values = self.as_json()
        texts = {
            "study.txt": cost_text(values),
            "study.csv": cost_csv(values),
            "study.html": cost_html(values),
            STUDY_FILE: json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False) + "\n",  # last: all is whole
        }
        written = plot_study(values, folder)
        preset = folder / PRESET_FILE
        if self.chosen is not None and self.chosen.point is not None:
            # A preset is for other scenes too: it leaves open what the caller left open.
            settings = self.plan.named(self.chosen.point.name).settings.replace(**self.requested_lighting)
            save_preset(preset, settings, self._measured())
            written.append(preset)
        else:
            preset.unlink(missing_ok=True)  # it would be of another choice
        for name, text in texts.items():
            write_atomically(folder / name, text)
        return [*(folder / name for name in texts), *written]

    def _measured(self) -> dict[str, Any]:
        point = self.chosen.point
        return {
            "scene": self.about["scene"]["name"],
            "configuration": point.label,
            "reference": self.about["reference"]["kind"],
            "wrong_percent": {c: round(float(e.percent), 4) for c, e in point.masks.items()},
            "ms_per_frame": float(point.time.median),
            "clock": point.clock,
            "renderer": self.about["machine"]["renderer"],
        }


def assemble(about: Mapping[str, Any], plan: Plan, records: Sequence[Record], repeats: int) -> CostStudy:
    """The study from what is recorded so far; the first ``repeats`` rounds count."""
    of_kind = {kind: [r for r in records if r["kind"] == kind] for kind in ("reference", "masks", "columns", "time")}
    columns = about["columns"]
    found = of_kind["reference"][-1] if of_kind["reference"] else None
    reference = {} if found is None else _decisions(found["words"], columns)
    masks, measured = ({r["configuration"]: r for r in of_kind[kind]} for kind in ("masks", "columns"))
    points = []

    def errors(name: str) -> dict[str, Any]:
        return mask_errors(_decisions(masks[name]["words"], columns), reference) if name in masks and reference else {}

    for c in plan.configurations:
        timed = rounds_of(of_kind["time"], c.name)[:repeats]
        known = c.name in measured and BASELINE in measured
        points.append(
            Point(
                c.name,
                c.label,
                c.role,
                c.values,
                errors(c.name),
                column_differences(measured[c.name], measured[BASELINE]) if known else {},
                time_of([r["frame_ms"] for r in timed]) if timed else None,
                about["clock"],
                usable=not c.on_cpu and c.comparable and c.role != "effect",
                bytes=timed[0]["bytes"] if timed else None,
            )
        )
    for name, r in masks.items():
        if "frame_ms" in r:  # a render
            time = time_of(r["frame_ms"], interleaved=False) if r["frame_ms"] else None
            points.append(Point(name, name, "render", {}, errors(name), {}, time, r["clock"], False))
    about = dict(about) | {"machine_state": machine_state(records, about["machine"]["cores"])}
    about["reference"] = about["reference"] | _reference_facts(found, reference, columns)
    return CostStudy(about, points, plan)


def _decisions(words: str, columns: Sequence[str]) -> dict[str, Any]:
    unpacked = unpack(words)
    return {c: discarded(unpacked, c) for c in columns}


def _reference_facts(found: Record | None, reference: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    """Samples, discarded percent by column, the noise floor, and that of half the samples."""

    def floor(of: Record | None) -> dict[str, float]:
        halves = of["halves"] if of else None
        return noise_floor(*(_decisions(words, columns) for words in halves)) if halves else {}

    return {
        "samples": found["samples"] if found else None,
        "percent": {c: 100.0 * float(there.mean()) for c, there in reference.items()},
        "floor": floor(found),
        "floor_before": floor(next(iter((found or {}).get("before", ())), None)),
    }


def machine_state(records: Sequence[Record], cores: int | None) -> dict[str, Any]:
    """While configurations were timed: the share of the machine's CPU time that other processes took, the change of
    the median times from the first to the second half of the rounds (median over configurations), and whether the
    machine was busy.  None: not known.
    """
    visits = [r for r in records if r["kind"] == "time"]
    available = (cores or 1) * sum(r["seconds"] for r in visits)
    other = max(0.0, sum(r["other_seconds"] for r in visits)) / available if available else None
    changes = []
    for name in {r["configuration"] for r in visits}:
        ms = [r["frame_ms"] for r in rounds_of(visits, name)]
        if half := len(ms) // 2:
            changes.append(math.log(statistics.median(ms[-half:]) / statistics.median(ms[:half])))
    drift = math.expm1(abs(statistics.median(changes))) if changes else None
    busy = (other or 0.0) > BUSY_SHARE or (drift or 0.0) > BUSY_DRIFT
    return {"other_work": other, "drift": drift, "busy": busy}


def _choice_json(c: Choice) -> dict[str, Any]:
    points = {"configuration": c.point, "faster": c.faster, "finer": c.finer}
    named = {role: p and p.name for role, p in points.items()}
    return {"column": c.column, "within": c.within, "budget_ms": c.budget_ms, "words": c.words} | named
