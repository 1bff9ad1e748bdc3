"""Discard rates against camera speed: the same scene with an increasing speed of one camera quantity."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl import __version__
from taubench_gl.datasets.camera_path import CameraSpec, add_rig, generate
from taubench_gl.datasets.free_space import VoxelSpace
from taubench_gl.datasets.motion_stats import MotionStats
from taubench_gl.datasets.stress import CAMERA_NAME, stress, with_stats
from taubench_gl.errors import SceneError, SettingsError
from taubench_gl.evaluation import evaluate_scene, plan_scene
from taubench_gl.features import COLUMNS
from taubench_gl.outputs import csv_text, write_atomically
from taubench_gl.report.paper import paper_numbers
from taubench_gl.report.run_plots import plot_sweep
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Channel, Scene
from taubench_gl.settings import SequenceSettings, Settings
from taubench_gl.study.driver import run_study
from taubench_gl.study.progress import Listener
from taubench_gl.study.store import Store, content_hash, json_bytes
from taubench_gl.study.study import Study
from taubench_gl.study.unit import Unit, Worker
from taubench_gl.study.worker import open_context

AXES = ("translation", "yaw", "pitch", "roll")
CSV_NAME, PLOT_NAME = "sweep.csv", "sweep"
SCHEMA = "taubench-gl/sweep/1"


@dataclass(frozen=True, slots=True)
class Sweep:
    """Speeds of one of AXES, meters or degrees per frame: ``count`` of them from ``low`` to ``high``."""

    axis: str
    low: float
    high: float
    count: int

    def __post_init__(self) -> None:
        if self.axis not in AXES:
            raise SettingsError(f"no quantity is named {self.axis!r}", hint=f"choose from {', '.join(AXES)}")
        if not (math.isfinite(self.low) and math.isfinite(self.high) and 0 <= self.low < self.high):
            raise SettingsError(f"sweep from {self.low:g} to {self.high:g}", hint="give 0 <= LO < HI")
        if not 2 <= self.count <= 1000:
            raise SettingsError(f"sweep of {self.count} points", hint="give 2 to 1000")

    @property
    def unit(self) -> str:
        """Unit of a speed, m or deg per frame."""
        return "m" if self.axis == "translation" else "deg"

    @property
    def values(self) -> list[float]:
        """The speeds of the sweep in ``unit``, ascending."""
        return np.linspace(self.low, self.high, self.count).tolist()


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepUnit(Unit):
    """The evaluation of one speed.

    ``base``: the camera of the sweep, whose frames and seed all speeds share; ``spec``: the camera of this speed;
    ``settings``: with the lighting that is resolved once for all speeds.
    """

    base: CameraSpec
    spec: CameraSpec
    settings: Settings

    def run(self, worker: Worker) -> bytes:
        open_context(self.settings)
        scene, space = _still(self.scene, self.base, self.settings.sequence)
        summary = evaluate_scene(_posed(scene, self.spec, space), self.settings).summary
        worker.done()
        return json_bytes({"camera": summary["camera"], "discard": summary["discard"]})


class SweepStudy(Study):
    """A job per speed, in the order of the speeds."""

    def __init__(self, out: str | Path, sweep: Sweep, units: Sequence[SweepUnit]):
        super().__init__(Store(out, "stress", SCHEMA))
        self._sweep, self.units = sweep, {unit.job: unit for unit in units}

    def fail(self, unit: Unit, message: str, details: str) -> bool:
        raise SceneError(message)

    def merge(self) -> list[dict[str, Any]]:
        """Write sweep.csv and the plot.  -> a row per speed."""
        units, sweep, out = tuple(self.units.values()), self._sweep, self.store.out
        rows = [_row(sweep, value, self.store.load(u.key)) for value, u in zip(sweep.values, units, strict=True)]
        write_atomically(out / CSV_NAME, csv_text([list(rows[0]), *(list(row.values()) for row in rows)]))
        base = units[0].base
        name = f"{Path(units[0].scene).stem}, {base.frames - 1} pairs a point at {base.fps:g} fps"
        plot_sweep(rows, sweep.axis, sweep.unit, name, _paper_points(sweep.axis), out / PLOT_NAME)
        return rows


def run_sweep(
    source: str | Path,
    sweep: Sweep,
    base: CameraSpec,
    settings: Settings,
    out: str | Path,
    listener: Listener | None = None,
) -> list[dict[str, Any]]:
    """Evaluate ``source`` once for each speed and write ``sweep.csv``, ``sweep.png`` and ``sweep.svg`` into ``out``.

    Each camera has a constant speed; the other quantities are those of ``base`` at all points.  Speeds that ``out`` has
    are kept.  Returns a row per speed: the measured mean of each quantity, N, fps, and the discard rate per column in
    percent (None: not measured).  Raises TaubenchError.
    """
    settings = settings.replace(fps=base.fps, camera=CAMERA_NAME, pairs="all", frames=(0, base.frames))
    scene, space = _still(str(source), base, settings.sequence)
    specs = [with_stats(base, **{sweep.axis: MotionStats(value)}) for value in sweep.values]
    _posed(scene, specs[-1], space)  # an impossible speed is an error before anything is rendered or written
    # The file records one exposure for all speeds; the number of samples is that of the first.
    settings = plan_scene(_posed(scene, specs[0], space), settings).settings
    identity = [scene.sha256, __version__, settings.to_dict()]
    units = []
    for value, spec in zip(sweep.values, specs, strict=True):
        job = f"{sweep.axis}={value:g}"
        key = f"{job}-{content_hash([*identity, dataclasses.asdict(spec)])}"
        units.append(SweepUnit(job=job, key=key, name=job, scene=str(source), weight=1,
                               base=base, spec=spec, settings=settings))  # fmt: skip
    return run_study(SweepStudy(out, sweep, units), {"scene": str(source)}, listener=listener)


@lru_cache(maxsize=1)
def _still(source: str, base: CameraSpec, sequence: SequenceSettings) -> tuple[Scene, VoxelSpace]:
    """The scene with a stress camera that stands still, and the free space of its source."""
    with tempfile.TemporaryDirectory(prefix="taubench-gl-") as folder:
        file = Path(folder) / "still.glb"
        stress(source, file, CameraSpec(frames=base.frames, fps=base.fps, seed=base.seed), strict=sequence.strict)
        animation = sequence.animation and (*sequence.animation, CAMERA_NAME)
        scene = load_scene(file, sequence.scene, animation)
    return scene, VoxelSpace(load_scene(source, strict=sequence.strict))


def _posed(scene: Scene, spec: CameraSpec, space: VoxelSpace) -> Scene:
    """The scene with the camera path of ``spec``; nothing else changes."""
    index_of = {name: i for i, name in enumerate(scene.nodes.names)}
    rig: set[int] = set()

    def node(name: str, parent: int | None, **properties: Any) -> int:
        rig.add(index_of[name])
        return index_of[name]

    tracks = add_rig(generate(spec, space), node, 0, CAMERA_NAME, keep_still=True)
    kept = [c for c in scene.channels if not (c.target == "node" and c.index in rig)]
    posed = [Channel("node", index, path, kind, np.asarray(times), v) for index, path, times, v, kind in tracks]
    return dataclasses.replace(scene, channels=(*kept, *posed))


def _row(sweep: Sweep, value: float, record: dict[str, Any]) -> dict[str, Any]:
    """One speed in sweep.csv: what was requested, the measured means, N, fps, and the discard rate per column."""
    camera, discard = record["camera"], record["discard"]
    row: dict[str, Any] = {f"requested_{sweep.axis}_{sweep.unit}": value}
    measured = {"translation_m": "position", "yaw_deg": "yaw", "pitch_deg": "pitch", "roll_deg": "roll"}
    row |= {f"mean_{name}": camera[key]["mean"] for name, key in measured.items()}
    row |= {"fps": camera["fps"], "pairs": camera["samples"]}
    return row | {f"{name}_percent": discard[name]["mean_percent"] for name in COLUMNS}


def _paper_points(axis: str) -> list[tuple[str, float, float]]:
    """(scene, mean speed, frustum percent) of the paper's scenes with a camera that moves in this quantity."""
    points = []
    for scene in paper_numbers()["scenes"]:
        mean = scene["position"]["mean"] if axis == "translation" else scene["rotation"][f"{axis}_mean"]
        if mean:
            points.append((scene["name"], float(mean), float(scene["discard"]["frustum"])))
    return points
