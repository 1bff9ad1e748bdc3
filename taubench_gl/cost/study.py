"""``cost``: seconds and error of ways to get one table, against a truth with numbers of its own, and what to use.

DIR receives study.json and records (``study.store``), cost.json, the page cost.html, the picture cost.png and .svg,
tables, and the presets of the recommendations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from taubench_gl.cost.choice import (
    SAME,
    Point,
    combined,
    deciding_wins,
    errors_of,
    pareto_front,
    preview_enough,
    within_error,
    within_seconds,
)
from taubench_gl.cost.configurations import (
    OWN,
    PREVIEW,
    TRUTH,
    Configuration,
    Plan,
    command_line,
    own_settings,
    without_effect,
)
from taubench_gl.cost.unit import EvaluationUnit, evaluation_unit
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import SceneInput, file_hashes, files_identity, open_scene, sampled_pairs
from taubench_gl.features import COLUMNS, LIGHT_FEATURES
from taubench_gl.fields import declared, from_values
from taubench_gl.option_groups import CostOptions
from taubench_gl.outputs import duration_text
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.preset import save_preset
from taubench_gl.report.cost import answer, write_cost
from taubench_gl.settings import FIELDS, Settings
from taubench_gl.study.progress import Listener
from taubench_gl.study.run import run_study
from taubench_gl.study.store import Store
from taubench_gl.study.study import Study

SCHEMA, STUDY_SCHEMA = "taubench-gl/cost/4", "taubench-gl/cost-study/1"

RUNS = 16
"""Most evaluations that make the truth."""

SECONDS, POINTS = (10.0, 60.0), 0.5
"""Limits of the three recommendations."""

RESOLVED = ("light_unit", "exposure", "environment", "pairs")
"""Settings that are resolved once for all configurations."""


def cost(
    scene: str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path,
    listener: Listener | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Measure seconds and error of every configuration, and recommend three.  -> the values of cost.json.

    ``options``: fields of ``CostOptions``, and those of Settings, which change ``settings``: scene, picture, columns.
    ``out``: called again after an interruption, what it holds is not evaluated again.  Raises TaubenchError.
    """
    given = {name: options.pop(name) for name in declared(CostOptions) if name in options}
    request, asked = from_values(CostOptions, given), (settings or Settings()).replace(**options)
    _require_free(asked)
    if is_sequence(scene):
        raise SettingsError("path-traced files cannot be evaluated in other ways", where=str(scene))
    study = CostStudy(
        str(scene), asked, request, open_scene(scene, asked, sampled=True), Store(out, "cost", STUDY_SCHEMA)
    )
    return run_study(study, study.about, tuple(study.about), listener=listener)


def _require_free(asked: Settings) -> None:
    """Raises SettingsError for settings that belong to the configurations, and where no light column can be decided."""
    for name in OWN:
        if asked.get(name) != FIELDS[name].default:
            what = f"{name} is {asked.get(name)}, and a cost study compares its values"
            raise SettingsError(what, hint="leave it out", setting=name)
    if not asked.metrics.decidable:
        light = ", ".join(c for c in COLUMNS if c in LIGHT_FEATURES)
        what = "the table has no column that can be decided at single pixels"
        hint = f"ask for one of {light}, at one sample per pixel, without exact visibility"
        raise SettingsError(what, hint=hint, setting="columns")


class CostStudy(Study):
    """A job per series of configurations, and one for the truth.  A unit is the evaluation of one of them."""

    def __init__(self, scene: str, asked: Settings, request: CostOptions, opened: SceneInput, store: Store):
        """``opened``: the scene with ``asked``, whose lighting and pairs are those of all configurations."""
        super().__init__(store)
        self._scene, self._asked, self._request, self._frames = scene, asked, request, opened.frames
        if not sampled_pairs(opened.frames, opened.settings).positions:
            raise SettingsError("the scene gives no pair of frames", hint="give more --frames, or an animated scene")
        self._resolved = {name: opened.settings.get(name) for name in RESOLVED}
        self._sha256 = files_identity(file_hashes(opened.animated.scene, opened.settings))
        self._failed_units: dict[str, str] = {}
        self.plan = Plan(asked, without_effect(opened.animated.scene, opened.settings))
        self.left_out = {f"previews with other {name}": why for name, why in self.plan.off.items()}
        fixed = {name: value for name, value in asked.to_dict().items() if name not in OWN}
        self.about = {"scene": opened.name, "sha256": self._sha256, "settings": fixed | _plain(self._resolved)}
        self.about["frames"] = [opened.frames.start, opened.frames.stop]

    def jobs(self) -> Mapping[str, str]:
        return {name: name for name in (*self.plan.series, TRUTH)}

    def missing(self, job: str, width: int) -> tuple[Sequence[EvaluationUnit], int]:
        if job == TRUTH:
            return self._missing_truth()
        configurations = self.plan.series[job]
        left = [c for c in configurations if self._record(c) is None and self.unit(c).key not in self._failed_units]
        if job == PREVIEW:
            return [self.unit(c) for c in left], len(configurations)
        for c in left:
            seconds = self._expected(c)
            if self._request.longest is None or seconds <= self._request.longest:
                return [self.unit(c)], len(configurations)
            self.left_out[c.name] = f"would take about {duration_text(seconds)} (--longest)"
        return [], len(configurations)

    def _missing_truth(self) -> tuple[Sequence[EvaluationUnit], int]:
        records, goal = self._truth_records, self._request.truth_within
        if not records:
            return [self._truth_unit(0)], 1
        half = max(column["half_width"] for column in combined([r["columns"] for r in records]).values())
        done = len(records)
        if half <= goal or done == RUNS:
            return [], done
        return [self._truth_unit(done)], min(max(math.ceil(done * (half / goal) ** 2), done + 1), RUNS)

    @property
    def _truth_records(self) -> list[dict[str, Any]]:
        """In the order of their seeds, up to the first that is missing."""
        records = []
        for number in range(RUNS):
            record = self.store.load(self._truth_unit(number).key)
            if record is None:
                break
            records.append(record)
        return records

    def unit(self, configuration: Configuration) -> EvaluationUnit:
        settings = configuration.settings(self._asked.replace(**self._resolved))
        how = {"repeats": self._request.repeats, "programs": configuration.programs}
        of = configuration.series, configuration.name, self._scene, settings, self._frames, self._sha256
        return evaluation_unit(*of, **how)

    def _truth_unit(self, number: int) -> EvaluationUnit:
        """Decided samples with the seed after those of the configurations, and further ones."""
        settings = own_settings(self._asked).replace(**self._resolved, light_within=self._request.truth_within)
        settings = settings.replace(seed=(settings.lighting.seed + 1 + number) % 2**31)
        return evaluation_unit(TRUTH, f"truth {number + 1}", self._scene, settings, self._frames, self._sha256)

    def _record(self, configuration: Configuration) -> dict[str, Any] | None:
        return self.store.load(self.unit(configuration).key)

    def _seconds(self, record: Mapping[str, Any]) -> float:
        """Of an evaluation by the clock of the study."""
        return record["seconds" if self._request.clock == "wall" else "cpu_seconds"]

    def _expected(self, configuration: Configuration) -> float:
        """Seconds that a configuration is expected to take, at most, by those of its series that are measured."""
        before = [(c, r) for c in self.plan.series[configuration.series] if (r := self._record(c)) is not None]
        if not before:
            return 0.0
        (last, record), sequence = before[-1], self._asked.sequence
        if configuration.effort:
            return self._seconds(record) * configuration.effort / last.effort
        sampled = (record["sampled_light"] or {}).get("pixels")  # and now every pixel is decided
        every = sequence.width * sequence.height * record["pairs"]
        return self._seconds(record) * (every / sampled if sampled else 1.0)

    def fail(self, unit: EvaluationUnit, message: str, details: str) -> bool:
        super().fail(unit, message, details)
        self._failed_units[unit.key] = self.left_out[unit.name] = message
        if unit.job == TRUTH:
            raise SettingsError(f"the truth cannot be evaluated: {message}", where=self._scene)
        return True

    def merge(self) -> dict[str, Any]:
        records = self._truth_records
        truth = combined([record["columns"] for record in records])
        if all(column["percent"] is None for name, column in truth.items() if name in LIGHT_FEATURES):
            reason = next(column["reason"] for name, column in truth.items() if name in LIGHT_FEATURES)
            raise SettingsError(f"the table has no light: {reason}", where=self._scene)
        values = self._values(truth, records)
        values["lines"] = answer(values)
        self.store.write_json(self.store.out / "cost.json", values)
        write_cost(values, self.store.out)
        for use in values["recommendations"]:
            if use["reached"]:
                self._write_preset(use)
        return values

    def _values(self, truth: Mapping[str, Any], records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        points, rows = self._points(truth)
        enough, wins, sequence = preview_enough(points), deciding_wins(points), self._asked.sequence
        return {
            "schema": SCHEMA,
            **self.about,
            "size": [sequence.width, sequence.height],
            "pairs": records[0]["pairs"],
            "clock": self._request.clock,
            "same_factor": SAME,
            "truth": {
                "columns": truth, "evaluations": len(records),
                "half_width": max(column["half_width"] for column in truth.values()),
                "wanted_half_width": self._request.truth_within,
                "samples": sum((r["sampled_light"] or {}).get("samples", 0) for r in records),
                "cpu_seconds": sum(r["cpu_seconds"] for r in records),
            },
            "points": rows,
            "left_out": self.left_out,
            "front": [point.name for point in pareto_front(points)],
            "preview_enough": enough and enough.name,
            "deciding_wins": wins and wins.name,
            "recommendations": self._recommendations(points),
            "provenance": records[0]["provenance"],
        }  # fmt: skip

    def _points(self, truth: Mapping[str, Any]) -> tuple[list[Point], list[dict[str, Any]]]:
        """The points, and for each what cost.json has of it, in the order of the plan."""
        points, rows = [], []
        for c in self.plan.every:
            record = self._record(c)
            if record is None:
                continue
            errors = errors_of(record["columns"], truth)
            point = Point(c.series, c.name, len(c.changes), self._seconds(record), **errors)
            points.append(point)
            kept = ("cpu_seconds", "first_pair_seconds", "repeats", "columns", "sampled_light", "decided_light")
            wall = {"wall_seconds": record["seconds"]}
            rows.append(asdict(point) | wall | {name: record[name] for name in kept} | {"command": self._command(c)})
        return points, rows

    def _command(self, configuration: Configuration) -> str:
        """The command that evaluates the scene with ``configuration``, camera, frames and pairs of the study."""
        return command_line(self._scene, configuration.settings(self._asked.replace(pairs=self._resolved["pairs"])))

    def _recommendations(self, points: Sequence[Point]) -> list[dict[str, Any]]:
        """``configuration``: what to use; where nothing reaches the limit, the nearest."""
        usable = [point for point in points if point.error is not None]
        out = []
        for limit in SECONDS:
            use = within_seconds(usable, limit)
            near = min(usable, key=lambda p: p.seconds, default=None)
            out.append({"limit": limit, "unit": "s", "preset": f"within-{limit:g}s.toml"} | _use(use, near))
        use, near = within_error(usable, POINTS), min(usable, key=lambda p: p.error, default=None)
        return [*out, {"limit": POINTS, "unit": "points", "preset": f"within-{POINTS:g}points.toml"} | _use(use, near)]

    def _write_preset(self, use: Mapping[str, Any]) -> None:
        of = next(c for c in self.plan.every if c.name == use["configuration"])
        measured = {"error_points": use["error"], "seconds": use["seconds"], "clock": self._request.clock}
        measured["command"] = self._command(of)
        save_preset(self.store.out / use["preset"], of.settings(self._asked), measured)


def _use(point: Point | None, nearest: Point | None) -> dict[str, Any]:
    of = point or nearest
    facts = {} if of is None else {"configuration": of.name, "seconds": of.seconds, "error": of.error}
    return {"reached": point is not None, **facts}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
