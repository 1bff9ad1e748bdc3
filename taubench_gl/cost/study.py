"""Seconds and errors of ways to get one table, against a truth of other random numbers, and what to use.

DIR receives study.json and records (``study.store``), cost.json, the page cost.html, the picture cost.png and .svg,
tables, and the presets of the recommendations.
"""

from __future__ import annotations

import itertools
import math
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
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
    COMPARED,
    PREVIEW,
    RUNS,
    TRUTH,
    Configuration,
    Plan,
    command_line,
    without_effect,
)
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import Observers, ScenePlan, Session, file_hashes, files_identity, plan_scene, sampled_pairs
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.sampled_light import ROUND_SIZES
from taubench_gl.evaluation.session import run_session
from taubench_gl.features import COLUMNS, LIGHT_FEATURES
from taubench_gl.fields import declared, from_values
from taubench_gl.option_groups import CostOptions
from taubench_gl.outputs import duration_text
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.preset import save_preset
from taubench_gl.report.cost import answer, write_cost
from taubench_gl.run import Run
from taubench_gl.settings import FIELDS, Settings
from taubench_gl.study.driver import run_study
from taubench_gl.study.progress import Listener
from taubench_gl.study.scene import LoadedScene
from taubench_gl.study.store import Store, content_hash, json_bytes
from taubench_gl.study.study import Study
from taubench_gl.study.unit import Unit, Worker
from taubench_gl.study.worker import open_context

SCHEMA, STUDY_SCHEMA = "taubench-gl/cost/4", "taubench-gl/cost-study/2"

SECONDS, POINTS = (10.0, 60.0), 0.5
"""Limits of the three recommendations."""

RESOLVED = ("light_unit", "exposure", "environment", "pairs")
"""Settings that are resolved once for all configurations."""


CHEAP = 5.0
"""Seconds that an evaluation and its repetitions take: the median counts."""

TRUTH_SHARE = 0.5
"""Share of the time of a study that evaluations of the truth take, after the first one."""

NO_HURRY = 100.0
"""Value of ``light_within`` for the first pair, which one round of samples reaches."""


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
    own_options = {name: options.pop(name) for name in declared(CostOptions) if name in options}
    request, asked = from_values(CostOptions, own_options), (settings or Settings()).replace(**options)
    _require_free(asked)
    if is_sequence(scene):
        raise SettingsError("path-traced files cannot be evaluated in other ways", where=str(scene))
    plan = plan_scene(scene, asked, sampled=True)
    study = CostStudy(str(scene), asked, request, plan, Store(out, "cost", STUDY_SCHEMA))
    return run_study(study, study.about, tuple(study.about), listener=listener)


def _require_free(asked: Settings) -> None:
    """Raises SettingsError for settings that belong to the configurations, and where no light column can be decided."""
    for name in COMPARED:
        if asked.get(name) != FIELDS[name].default:
            what = f"{name} is {asked.get(name)}, and a cost study compares its values"
            raise SettingsError(what, hint="leave it out", setting=name)
    if not asked.metrics.decidable:
        light = ", ".join(c for c in COLUMNS if c in LIGHT_FEATURES)
        what = "the table has no column that can be decided at single pixels"
        hint = f"ask for one of {light}, at one sample per pixel, without exact visibility"
        raise SettingsError(what, hint=hint, setting="columns")


class CostStudy(Study):
    """A job per series of configurations; a unit is the evaluation of one configuration."""

    def __init__(self, scene: str, asked: Settings, request: CostOptions, opened: ScenePlan, store: Store):
        """Compare ways to evaluate ``asked``; ``opened``: the scene with these settings, whose light all share."""
        super().__init__(store)
        self._scene, self._asked, self._request, self._frames = scene, asked, request, opened.frames
        if not sampled_pairs(opened.frames, opened.settings).positions:
            raise SettingsError("the scene gives no pair of frames", hint="give more --frames, or an animated scene")
        self._resolved = {name: opened.settings.get(name) for name in RESOLVED}
        self._sha256 = files_identity(file_hashes(opened.animated.scene, opened.settings))
        self._failed_units: dict[str, str] = {}  # key -> message
        off = without_effect(opened.animated.scene, opened.settings)
        self.plan = Plan(asked, off, request.truth_within)
        self.left_out = {f"previews with other {name}": why for name, why in off.items()}
        fixed = {name: value for name, value in asked.to_dict().items() if name not in COMPARED}
        self.about = {"scene": opened.name, "sha256": self._sha256, "settings": fixed | _plain(self._resolved)}
        self.about["frames"] = [opened.frames.start, opened.frames.stop]

    def jobs(self) -> Mapping[str, str]:
        return {name: name for name in self.plan.series}

    def missing(self, job: str, width: int) -> tuple[Sequence[EvaluationUnit], int]:
        """The next unit alone: what it takes, and how exact it is, decides on those that follow.

        The first one of each job is evaluated whatever it takes.
        """
        if job == TRUTH:
            return self._missing_truth()
        configurations = self.plan.series[job]
        units = [(c, self.unit(c)) for c in configurations if self._record(c) is None]
        units = [(c, unit) for c, unit in units if unit.key not in self._failed_units]
        left = self._left()
        for c, unit in units:
            seconds = self._expected(c)
            if seconds <= left:
                self.left_out.pop(c.name, None)
                return [unit], len(configurations)
            of_limit = f"{duration_text(max(left, 0.0))} of {duration_text(self._request.time)} were left (--time)"
            self.left_out[c.name] = f"would take about {duration_text(seconds)}, {of_limit}"
        return [], len(configurations)

    def _left(self) -> float:
        """Seconds that are left for further evaluations."""
        if self._request.time is None:
            return math.inf
        done = (self._record(c) for series in self.plan.series.values() for c in series)
        return self._request.time - sum(self._spent(record) for record in done if record is not None)

    def _spent(self, record: Mapping[str, Any]) -> float:
        """Seconds of an evaluation with its repetitions and its first pair."""
        first = record["first_pair_seconds" if self._request.clock == "wall" else "first_pair_cpu_seconds"]
        return self._seconds(record) * record["repeats"] + (first or 0.0)

    def _missing_truth(self) -> tuple[Sequence[EvaluationUnit], int]:
        """The next evaluation of the truth until its interval is narrow enough, and how many it will take in all."""
        records, goal = self._truth_records, self._request.truth_within
        done, total = len(records), 1
        if records:
            half = max(column["half_width"] for column in combined([r["columns"] for r in records]).values())
            spent = sum(map(self._spent, records))
            over = self._request.time is not None and spent * (1 + 1 / done) > TRUTH_SHARE * self._request.time
            if half <= goal or done == RUNS or over:
                return [], done
            total = min(max(math.ceil(done * (half / goal) ** 2), done + 1), RUNS)
        return [self.unit(self.plan.series[TRUTH][done])], total

    @property
    def _truth_records(self) -> list[dict[str, Any]]:
        """The records of the truth in the order of their seeds, up to the first that is missing."""
        return list(itertools.takewhile(bool, map(self._record, self.plan.series[TRUTH])))

    def unit(self, configuration: Configuration) -> EvaluationUnit:
        """The evaluation of a configuration.  Its key has a hash of all that the columns depend on."""
        settings = configuration.settings(self._asked.replace(**self._resolved))
        ends = (self._frames.start, self._frames.stop)
        job, name = configuration.series, configuration.name
        return EvaluationUnit(
            job=job, key=f"{job}/{content_hash([self._sha256, settings.to_dict(), ends])}", name=name,
            scene=self._scene, weight=1, settings=settings, frames=ends, sha256=self._sha256,
            repeats=1 if job == TRUTH else self._request.repeats, programs=configuration.programs,
        )  # fmt: skip

    def _record(self, configuration: Configuration) -> dict[str, Any] | None:
        return self.store.load(self.unit(configuration).key)

    def _seconds(self, record: Mapping[str, Any]) -> float:
        """Seconds of an evaluation by the clock of the study."""
        return record["seconds" if self._request.clock == "wall" else "cpu_seconds"]

    def _expected(self, configuration: Configuration) -> float:
        """Seconds that a configuration is expected to take, by the last one of its series; 0 without any."""
        before = [(c, r) for c in self.plan.series[configuration.series] if (r := self._record(c)) is not None]
        if not before:
            return 0.0
        (last, record), sequence = before[-1], self._asked.sequence
        if configuration.series == PREVIEW:
            return self._spent(record)
        sampled, samples = ((record["sampled_light"] or {}).get(name) for name in ("pixels", "samples"))
        if configuration.effort:
            # Decided samples end where they have had as many as a run may have, in the round that is then under way.
            most = 1.0 + ROUND_SIZES.samples / samples if samples else math.inf
            compiled = configuration.programs == last.programs
            taken = self._seconds(record) if compiled else self._spent(record)
            return taken * min(configuration.effort / last.effort, most)
        # Now every pixel is decided.
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
        """The values of cost.json.  ``truth``: columns; ``records``: the evaluations that made them."""
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
        """The measured configurations as points, and as cost.json has them, in the order of the plan."""
        points, rows = [], []
        for c in self.plan.compared:
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
        """What to use within each limit; where nothing reaches it, the nearest (``reached`` is false)."""
        usable = [point for point in points if point.error is not None]
        fastest, best = (min(usable, key=lambda p: getattr(p, by), default=None) for by in ("seconds", "error"))
        choices = [(limit, "s", within_seconds(usable, limit), fastest) for limit in SECONDS]
        out = []
        for limit, unit, use, nearest in [*choices, (POINTS, "points", within_error(usable, POINTS), best)]:
            point = use or nearest
            facts = point and {"configuration": point.name, "seconds": point.seconds, "error": point.error}
            preset = f"within-{limit:g}{unit}.toml"
            out.append({"limit": limit, "unit": unit, "preset": preset, "reached": use is not None} | (facts or {}))
        return out

    def _write_preset(self, use: Mapping[str, Any]) -> None:
        of = next(c for c in self.plan.compared if c.name == use["configuration"])
        measured = {"error_points": use["error"], "seconds": use["seconds"], "clock": self._request.clock}
        measured["command"] = self._command(of)
        save_preset(self.store.out / use["preset"], of.settings(self._asked), measured)


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Tuples of ``values`` as lists, as JSON reads them back."""
    return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


# ---------------------------------------------------------------------------------------------------------- evaluations
@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluationUnit(Unit):
    """All pairs of a scene with ``settings``, whose lighting and pairs are resolved.

    ``frames``: first frame of the scene and one past its last; ``sha256``: of the files when the study began;
    ``repeats``: most evaluations.  ``programs`` names the shaders that the first pair compiles before the seconds
    begin, unless an earlier unit did; empty where seconds do not count.
    """

    settings: Settings
    frames: tuple[int, int]
    sha256: str | None
    repeats: int
    programs: str

    def run(self, worker: Worker) -> bytes:
        loaded = _CostScene.kept(worker, self.scene, self.settings)
        loaded.require_unchanged(self.sha256, self.settings, "give --out a new folder")
        first, seconds, processor_seconds = (None, None), [], []
        if self.programs and self.programs not in loaded.compiled:
            loaded.compiled.add(self.programs)
            pair = (self.frames[0], self.frames[0] + 2)
            _, *first = loaded.timed(self.settings.replace(frames=pair, pairs="all", light_within=NO_HURRY))
        while len(seconds) < self.repeats:
            run, wall, processor = loaded.timed(self.settings)
            seconds.append(wall)
            processor_seconds.append(processor)
            if sum(seconds) + wall > CHEAP:
                break
        record = {"seconds": statistics.median(seconds), "cpu_seconds": statistics.median(processor_seconds)}
        record |= {"first_pair_seconds": first[0], "first_pair_cpu_seconds": first[1]}
        record |= {"repeats": len(seconds), "pairs": run.summary["pairs"]}
        record |= {name: run.summary.get(name) for name in ("sampled_light", "decided_light", "provenance")}
        return json_bytes(record | {"columns": columns_of(run.summary)})


def columns_of(summary: dict[str, Any]) -> dict[str, Any]:
    """Columns of Table 4 with ``percent`` (None: not measured, with its ``reason``) and ``interval95``, if any."""
    discard = summary["discard"]
    return {
        name: {
            "percent": discard[name]["mean_percent"],
            "interval95": discard[name].get("interval95_percent"),
            "reason": discard[name].get("reason"),
        }
        for name in COLUMNS
        if name in summary["settings"]["columns"]
    }


class _CostScene(LoadedScene):
    """A scene with the compiled programs of all its evaluations; ``compiled`` names those of earlier units."""

    def __init__(self, path: str, settings: Settings):
        super().__init__(path, settings)
        self._owner = GpuOwner(open_context(settings))
        self.compiled: set[str] = set()

    def timed(self, settings: Settings) -> tuple[Run, float, float]:
        """A run, its seconds, and the seconds of all cores of the processor; without reading the file."""
        wall, processor = time.perf_counter(), time.process_time()
        with self._owner.gpu:
            plan = plan_scene(self.animated.scene, settings, self.animated.camera, owner=self._owner, sampled=True)
            with Session(plan, shaders=self._owner.context.shaders) as session:
                run = run_session(session, Observers())
        return run, time.perf_counter() - wall, time.process_time() - processor

    def release(self) -> None:
        self._owner.release()
