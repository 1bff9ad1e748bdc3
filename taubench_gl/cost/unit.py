"""One evaluation of a cost study, as ``evaluate`` does it, with its seconds."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from typing import Any

from taubench_gl.evaluation import Observers, Session, plan_scene
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.session import run_session
from taubench_gl.features import COLUMNS
from taubench_gl.run import Run
from taubench_gl.settings import Settings
from taubench_gl.study.scene import LoadedScene
from taubench_gl.study.store import json_bytes
from taubench_gl.study.unit import Unit, Worker
from taubench_gl.study.worker import open_context

CHEAP = 5.0
"""Seconds up to which an evaluation is repeated: the median counts."""

NO_HURRY = 100.0
"""Value of ``light_within`` for the first pair, which one round of samples reaches."""


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
        first, seconds, processor_seconds = None, [], []
        if self.programs and self.programs not in loaded.compiled:
            loaded.compiled.add(self.programs)
            pair = (self.frames[0], self.frames[0] + 2)
            first = loaded.timed(self.settings.replace(frames=pair, pairs="all", light_within=NO_HURRY))[1]
        while len(seconds) < self.repeats:
            run, wall, processor = loaded.timed(self.settings)
            seconds.append(wall)
            processor_seconds.append(processor)
            if wall > CHEAP:
                break
        record = {"seconds": statistics.median(seconds), "cpu_seconds": statistics.median(processor_seconds)}
        record |= {"first_pair_seconds": first, "repeats": len(seconds), "pairs": run.summary["pairs"]}
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
