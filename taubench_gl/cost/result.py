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
    RULE,
    Choice,
    MaskError,
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
from taubench_gl.cost.records import Record, Records
from taubench_gl.cost.timing import rounds_of
from taubench_gl.option_groups import OVERALL
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.preset import save_preset

COST_SCHEMA = "taubench-gl/cost/3"
STUDY_FILE, PRESET_FILE = "study.json", "preset.toml"
ERROR_NUMBERS = ("percent", "false_positive", "false_negative", "points")
BUSY_SHARE, BUSY_DRIFT = 0.1, 0.2
"""A machine is busy if other processes take more than this share of its CPU time while configurations are timed, or if
the times change by more than this share."""


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
        """The Pareto front of one column or of the overall error, fastest first; with the recommendation, which a
        limit of the time may have moved off it."""
        front = pareto_front([p for p in self.points if p.role != "effect"], column, self.floor(column))
        recommended = self.chosen.point if self.chosen is not None and self.chosen.column == column else None
        if recommended is not None and recommended not in front:
            front = sorted([*front, recommended], key=lambda p: p.time.median)
        return front

    def floor(self, column: str = OVERALL) -> float:
        """The noise floor of the reference, percent of the pixels; 0 where it has no random part or is not known."""
        return self.about["reference"]["floor"].get(column) or 0.0

    def choose(self, within: float | None = None, budget_ms: float | None = None, column: str = OVERALL) -> Choice:
        """Recommend, for the overall error or a column; ``chosen`` from now on."""
        self.chosen = choose(self.points, column, self.floor(column), within=within, budget_ms=budget_ms)
        return self.chosen

    def answer(self) -> list[str]:
        """Three lines: what to use, against what it was compared, and how far the numbers can be trusted."""
        from taubench_gl.report.cost import answer

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
        from taubench_gl.report.cost import CostView

        return CostView(self.as_json())

    def save(self, out: str | Path | None = None) -> list[Path]:
        """Write study.json, tables (text, CSV), the plot (PNG, SVG), study.html and, if something was chosen,
        preset.toml.  Returns the files.  Raises OutputError."""
        from taubench_gl.report.cost import cost_csv, cost_html, cost_text, plot_study

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


def assemble(about: Mapping[str, Any], plan: Plan, records: Records, repeats: int) -> CostStudy:
    """The study from what is recorded so far; the first ``repeats`` rounds count."""
    columns, masks, visits = about["columns"], records.by_configuration("masks"), records.of("time")
    reference, differences = records.reference, records.by_configuration("columns")
    right = {} if reference is None else _decisions(reference["words"], columns)

    def errors(name: str) -> dict[str, MaskError]:
        return mask_errors(_decisions(masks[name]["words"], columns), right) if name in masks and right else {}

    points = []
    for c in plan.configurations:
        timed = rounds_of(visits, c.name)[:repeats]
        known = c.name in differences and BASELINE in differences
        points.append(
            Point(
                c.name, c.label, c.role, c.values, errors(c.name),
                column_differences(differences[c.name], differences[BASELINE]) if known else {},
                time_of([v["frame_ms"] for v in timed]) if timed else None, about["clock"],
                usable=not c.on_cpu and c.comparable and c.role != "effect",
                bytes=timed[0]["bytes"] if timed else None,
            )
        )  # fmt: skip
    for name, r in masks.items():
        if "frame_ms" in r:  # a render
            time = time_of(r["frame_ms"], interleaved=False) if r["frame_ms"] else None
            points.append(Point(name, name, "render", {}, errors(name), {}, time, r["clock"], False))
    facts = {
        "samples": reference["samples"] if reference else None,
        "percent": {c: 100.0 * float(there.mean()) for c, there in right.items()},
        "floor": _floor(reference, columns),
        "floor_before": _floor(next(iter((reference or {}).get("before", ())), None), columns),
    }
    state = machine_state(visits, about["machine"]["cores"])
    return CostStudy({**about, "machine_state": state, "reference": about["reference"] | facts}, points, plan)


def _decisions(words: str, columns: Sequence[str]) -> dict[str, Any]:
    unpacked = unpack(words)
    return {c: discarded(unpacked, c) for c in columns}


def _floor(reference: Record | None, columns: Sequence[str]) -> dict[str, float]:
    """The noise floor of a reference of two halves; {} of any other."""
    halves = reference["halves"] if reference else None
    return noise_floor(*(_decisions(words, columns) for words in halves)) if halves else {}


def machine_state(visits: Sequence[Record], cores: int | None) -> dict[str, Any]:
    """What ``visits``, records of times, say of the machine meanwhile.  None: not known.

    The share of its CPU time that other processes took; the change of the median times from the first to the second
    half of the rounds, median over configurations; and whether it was busy.
    """
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
    named = {"configuration": c.point, "faster": c.faster, "finer": c.finer}
    limits = {name: getattr(c, name) for name in ("column", "within", "budget_ms", "good_enough")}
    return limits | {name: p and p.name for name, p in named.items()}
