"""Whether Optuna's sampler finds better configurations: ``cost_optuna.py STUDIES NAME SCENE [SECONDS]``.

STUDIES/NAME is a study of tools/cost_study: its size, frames and reference are used again.  The declared configurations
are measured in interleaved rounds; then Optuna's multi-objective sampler (TPE) gets the same CPU time for masks and one
visit each.  Both Pareto fronts are timed together afterwards, so that they are compared round by round.
After SECONDS the tool ends; called again, it goes on.  STUDIES/optuna.json receives the result of the scene, beside
those of other scenes.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import optuna
from cost_pages import beats

from taubench_gl.animation import camera_of_run
from taubench_gl.cost.analysis import OVERALL, Point, mask_errors, pareto_front, time_of
from taubench_gl.cost.configurations import Configuration, configuration
from taubench_gl.cost.parameters import CPU_FLOAT64, PARAMETERS
from taubench_gl.cost.pixels import discarded, pack, rendered_masks, unpack
from taubench_gl.cost.records import RECORDS_FILE, Records
from taubench_gl.cost.study import Subject, make_subject
from taubench_gl.cost.timing import Deadline, OpenConfiguration, OutOfTime, Pool, due_visits
from taubench_gl.evaluation import resolve_lighting
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

DECLARED = ("levels", "combinations", "shadow_filter")
"""As in the studies of tools/cost_study."""

ROUNDS, SEED = 3, 0
DECLARED_PHASE, SEARCH, TOGETHER = "declared", "search", "together"
Study = Mapping[str, Any]


class Measured:
    """Errors and times of configurations on one scene, each recorded as soon as it is measured."""

    def __init__(self, subject: Subject, words: str, columns: Sequence[str], records: Records, deadline: Deadline):
        self._subject, self._columns, self._records, self._deadline = subject, columns, records, deadline
        self._reference = self._decisions(words)

    def _decisions(self, words: str) -> dict[str, Any]:
        return {c: discarded(unpack(words), c) for c in self._columns}

    def masks(self, phase: str, c: Configuration) -> Point:
        """``c`` with its mask errors, not timed."""
        known = [r["words"] for r in self._records.of("masks") if r["configuration"] == c.name]
        if not known:
            self._deadline.check()
            started = time.process_time()
            known = [pack(rendered_masks(self._subject, c.settings))]
            self._add("masks", c, started, phase=phase, words=known[0])
        return Point(c.name, c.label, c.role, c.values, mask_errors(self._decisions(known[0]), self._reference))

    def timed(self, phase: str, configurations: Sequence[Configuration], rounds: int = ROUNDS) -> list[Point]:
        """With their times in interleaved rounds."""
        gpu, scene, camera = self._subject.gpu, self._subject.scene, self._subject.camera
        points = [self.masks(phase, c) for c in configurations]

        def open_one(c: Configuration) -> OpenConfiguration:
            return OpenConfiguration(gpu, scene, camera, c, time.process_time)

        with gpu, Pool(open_one, gpu.software) as pool:
            for _, c in due_visits(configurations, rounds, self._visits(phase)):
                self._deadline.check()
                started = time.process_time()
                self._add("time", c, started, phase=phase, **pool.visit(c))
        found = {c.name: [v["frame_ms"] for v in self._visits(phase, c.name)] for c in configurations}
        return [replace(p, time=time_of(found[p.name])) for p in points]

    def _visits(self, phase: str, name: str | None = None) -> list[Mapping[str, Any]]:
        return [r for r in self._records.of("time") if r["phase"] == phase and name in (None, r["configuration"])]

    def _add(self, kind: str, c: Configuration, started: float, **found: Any) -> None:
        spent = time.process_time() - started
        self._records.add(kind, {"configuration": c.name, "values": dict(c.values), "seconds": spent, **found})

    def seconds(self, phase: str) -> float:
        """CPU time of everything measured in ``phase`` so far."""
        return sum(r["seconds"] for r in self._records.lines if r["phase"] == phase)

    def tried(self, phase: str) -> list[Mapping[str, Any]]:
        """Values of the configurations that are timed in ``phase``."""
        return [r["values"] for r in self._visits(phase)]


def subject_of(study: Study, path: str, names: Sequence[str]) -> Subject:
    """The scene of ``study`` at ``path``, with a plan of ``names``."""
    scene = load_scene(path)
    width, height = study["size"]
    settings = Settings(width=width, height=height, frames=tuple(study["frames"]))
    settings = resolve_lighting(scene, settings, camera_of_run(scene, settings.sequence)).settings
    return make_subject(scene, settings, names, "highest-quality")


def space_of(subject: Subject) -> dict[str, tuple[Any, ...]]:
    """Every accuracy parameter that changes something on the scene, with the values that a study can measure.

    Light is that of the raster method, as in the declared configurations.
    """
    out = {}
    for name in subject.plan.parameters:
        parameter = PARAMETERS[name]
        values = {*parameter.values, parameter.value_in(subject.baseline)} - {CPU_FLOAT64}
        values = sorted((v for v in values if f"{name}={v}" not in subject.plan.inapplicable), key=str)
        if parameter.kind == "accuracy" and name != "light" and len(values) > 1:
            out[name] = tuple(values)
    return out


def searched(
    measured: Measured, space: Mapping[str, Sequence[Any]], baseline: Settings, seconds: float
) -> tuple[list[Configuration], int]:
    """What TPE has on its Pareto front after ``seconds`` of CPU time, and the number of configurations it measured."""
    done = [configuration("single", values, baseline) for values in measured.tried(SEARCH)]
    points = {c.name: measured.timed(SEARCH, [c], 1)[0] for c in done}
    tried = {c.name: c for c in done}
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    search = optuna.create_study(directions=["minimize"] * 2, sampler=optuna.samplers.TPESampler(seed=SEED + len(done)))
    kinds = {name: optuna.distributions.CategoricalDistribution(of) for name, of in space.items()}
    for c in done:
        result = [points[c.name].error(), points[c.name].time.median]
        search.add_trial(optuna.trial.create_trial(params=dict(c.values), distributions=kinds, values=result))
    end = time.process_time() + seconds - measured.seconds(SEARCH)
    while time.process_time() < end:
        trial = search.ask(kinds)
        c = configuration("single", trial.params, baseline)
        if c.name not in points:
            (points[c.name],), tried[c.name] = measured.timed(SEARCH, [c], 1), c
        search.tell(trial, [points[c.name].error(), points[c.name].time.median])
    best = dict.fromkeys(configuration("single", t.params, baseline).name for t in search.best_trials)
    return [tried[name] for name in best], len(tried)


def compare(name: str, path: str, studies: Path, deadline: Deadline) -> dict[str, Any]:
    """One row of the record.  Raises OutOfTime."""
    study = json.loads((studies / name / "study.json").read_text(encoding="utf-8"))
    lines = (studies / name / RECORDS_FILE).read_text(encoding="utf-8").splitlines()
    words = [r for r in map(json.loads, lines) if r["kind"] == "reference"][-1]["words"]
    subject = subject_of(study, path, DECLARED)
    assert len(subject.sample) == study["pixels"]["count"], "the pixels of the study"
    floor = study["reference"]["floor"].get(OVERALL) or 0.0
    identity = {"reference": hashlib.sha256(words.encode()).hexdigest()[:16]}
    with closing(Records(studies / name / "optuna", {"identity": identity, "machine": study["machine"]})) as records:
        measured = Measured(subject, words, study["columns"], records, deadline)
        declared = subject.plan.configurations
        front = {p.name for p in pareto_front(measured.timed(DECLARED_PHASE, declared), OVERALL, floor)}
        seconds = measured.seconds(DECLARED_PHASE)
        space = space_of(subject_of(study, path, tuple(PARAMETERS)))
        found, tried = searched(measured, space, subject.baseline, seconds)
        kept = [c for c in declared if c.name in front]
        new = [c for c in found if all(c.settings != other.settings for other in declared)]
        points = {p.name: p for p in measured.timed(TOGETHER, [*kept, *new])}

    def beaten(mine: Sequence[Configuration], by: Sequence[Configuration]) -> dict[str, str]:
        pairs = [(points[c.name], points[o.name]) for c in mine for o in by]
        return {a.label: b.label for a, b in pairs if beats(b, a, floor)}

    return {
        "scene": name, "size": study["size"], "seconds": round(seconds), "measured": len(declared), "tried": tried,
        "samples": study["reference"]["samples"], "floor": floor, "front": len(kept), "found": len(new),
        "beaten": beaten(kept, new), "found_beaten": len(beaten(new, kept)), "date": date.today().isoformat(),
    }  # fmt: skip


def main() -> int:
    studies, name, path = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    record = studies / "optuna.json"
    rows = json.loads(record.read_text(encoding="utf-8"))["scenes"] if record.exists() else []
    try:
        row = compare(name, path, studies, Deadline(float(sys.argv[4]) if len(sys.argv) > 4 else None))
    except OutOfTime:
        print(f"{name}: run again to go on")
        return 0
    rows = [r for r in rows if r["scene"] != name] + [row]
    rows.sort(key=lambda r: r["scene"])
    text = json.dumps({"optuna": optuna.__version__, "scenes": rows}, indent=1, ensure_ascii=False)
    record.write_text(text + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
