"""One evaluation of a cost study, as ``evaluate`` does it, with its seconds."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass, field
from typing import Any

from taubench_gl.animation import CameraTrack, camera_of_run
from taubench_gl.errors import SceneError
from taubench_gl.evaluation import Observers, Session, file_hashes, files_identity, plan_scene
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.session import run_session
from taubench_gl.features import COLUMNS
from taubench_gl.run import Run
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings
from taubench_gl.study.store import content_hash, json_bytes
from taubench_gl.study.unit import Unit, Worker
from taubench_gl.study.worker import open_context

CHEAP = 5.0
"""Seconds up to which an evaluation is repeated: the median counts."""

NO_HURRY = 100.0
"""``light_within`` of the first pair: one round of samples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluationUnit(Unit):
    """All pairs of a scene with ``settings``, whose lighting and pairs are resolved.

    ``frames``: of the scene; ``sha256``: of the files when the study began; ``repeats``: most evaluations.
    ``programs`` names the shaders that the first pair compiles before the seconds begin, unless an earlier unit did;
    none: seconds do not count.
    """

    settings: Settings
    frames: tuple[int, int]
    sha256: str | None
    repeats: int
    programs: str

    def run(self, worker: Worker) -> bytes:
        loaded = worker.kept((self.scene, *self.settings.sequence.reading.values()), lambda: _Loaded.of(self))
        if self.sha256 != files_identity(file_hashes(loaded.scene, self.settings)):
            raise SceneError("changed while the study was running", where=self.scene, hint="give --out a new folder")
        first, seconds, processor_seconds = None, [], []
        if self.programs and self.programs not in loaded.compiled:
            loaded.compiled.add(self.programs)
            pair = (self.frames[0], self.frames[0] + 2)
            first = _timed(loaded, self.settings.replace(frames=pair, pairs="all", light_within=NO_HURRY))[1]
        while True:
            run, wall, processor = _timed(loaded, self.settings)
            seconds.append(wall)
            processor_seconds.append(processor)
            if len(seconds) >= self.repeats or wall > CHEAP:
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


def evaluation_unit(
    job: str,
    name: str,
    scene: str,
    settings: Settings,
    frames: range,
    sha256: str | None,
    *,
    repeats: int = 1,
    programs: str = "",
) -> EvaluationUnit:
    """``name``: of the configuration, for messages.  The key has a hash of all that the columns depend on."""
    ends = (frames.start, frames.stop)
    key = f"{job}/{content_hash([sha256, settings.to_dict(), ends])}"
    return EvaluationUnit(
        job=job, key=key, name=name, scene=scene, weight=1, settings=settings, frames=ends, sha256=sha256,
        repeats=repeats, programs=programs,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Loaded:
    """A scene, its camera, and the compiled programs of all its evaluations; ``compiled``: names of some."""

    scene: Scene
    camera: CameraTrack
    owner: GpuOwner
    compiled: set[str] = field(default_factory=set)

    @classmethod
    def of(cls, unit: EvaluationUnit) -> _Loaded:
        sequence = unit.settings.sequence
        scene = load_scene(unit.scene, **sequence.reading)
        return cls(scene, camera_of_run(scene, sequence), GpuOwner(open_context(unit.settings)))

    def release(self) -> None:
        self.owner.release()


def _timed(loaded: _Loaded, settings: Settings) -> tuple[Run, float, float]:
    """The run, its seconds, and those of all cores of the processor; without reading the file."""
    wall, processor = time.perf_counter(), time.process_time()
    with loaded.owner.gpu:
        plan = plan_scene(loaded.scene, settings, loaded.camera, owner=loaded.owner, sampled=True)
        with Session(plan, shaders=loaded.owner.context.shaders) as session:
            run = run_session(session, Observers())
    return run, time.perf_counter() - wall, time.process_time() - processor
