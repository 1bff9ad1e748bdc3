"""What a worker does with a unit: load the scene, draw, count, and hand back bytes.  It writes nothing itself."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl import __version__
from taubench_gl.animation import Poser, choose_camera
from taubench_gl.batch.partition import PairRecord, encode, require_pyarrow
from taubench_gl.batch.units import Unit
from taubench_gl.errors import GraphicsError, SceneError, TaubenchError
from taubench_gl.evaluation import (
    Observers,
    evaluate_pairs,
    frame_range,
    frame_schedule,
    pair_schedule,
    require_triangles,
    sampled_pairs,
    scene_facts,
)
from taubench_gl.frame.passes.masks import Counts
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.provenance import provenance
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

HEAD_SCHEMA = "taubench-gl/batch-head/1"


class NoOpenGL(GraphicsError):
    """This worker has no OpenGL at all; another may."""


@dataclass(slots=True)
class _Loaded:
    """A scene and, once it draws, its renderer; kept for the next unit of the same job."""

    key: tuple[Any, ...]
    scene: Scene
    poser: Poser
    camera: Any
    source: RasterSource | None = None
    gpu: Gpu | None = None


class Workbench:
    """One per worker.  Keeps the last job's scene and renderer, so that its next chunk starts at once."""

    def __init__(self) -> None:
        self._loaded: _Loaded | None = None

    def run(self, unit: Unit, on_pair: Callable[[], None] = lambda: None) -> bytes:
        """A head's JSON or a chunk's Parquet file.  Raises TaubenchError; NoOpenGL where no context opens."""
        started = time.perf_counter()
        gpu = None if unit.positions is None else open_context(unit.settings)
        loaded = self._load(unit)
        if gpu is None:
            return head(loaded.scene, loaded.poser, loaded.camera, unit.settings)
        if unit.sha256 != loaded.scene.sha256:
            raise SceneError("changed while the study was running", where=unit.scene, hint="run the study again")
        return self._count(unit, loaded, gpu, on_pair, started)

    def _load(self, unit: Unit) -> _Loaded:
        settings = unit.settings
        key = (unit.scene, settings.sequence.scene, settings.sequence.animation, settings.sequence.camera, unit.job)
        if self._loaded is not None and self._loaded.key == key and unit.positions is not None:
            return self._loaded
        self.release()
        scene = load_scene(unit.scene, scene=settings.sequence.scene, animation=settings.sequence.animation)
        self._loaded = _Loaded(key, scene, Poser(scene), choose_camera(scene, settings.sequence.camera))
        return self._loaded

    def _count(self, unit: Unit, loaded: _Loaded, gpu: Gpu, on_pair: Callable[[], None], started: float) -> bytes:
        settings = unit.settings
        frames = frame_range(loaded.scene, loaded.camera, settings)
        with gpu:
            timer = PassTimer(gpu)
            if loaded.source is None:
                loaded.gpu = gpu
                loaded.source = RasterSource(gpu, loaded.scene, loaded.camera, settings, poser=loaded.poser)
            if unit.positions:
                schedule = pair_schedule(frames, unit.positions)
            else:
                schedule = frame_schedule(frames, sampled_pairs(frames, settings))
            counts: list[Counts] = []
            context = GpuContext(gpu, timer=timer)
            observers = Observers(loaded.scene.name, progress=lambda _: on_pair(), on_counts=counts.append)
            rows = evaluate_pairs(context, loaded.source, settings, schedule, observers).rows
            context.release()
            gpu.check("a chunk of a batch")
            told = {
                "source": loaded.source.describe(),
                "unmeasured": dict(loaded.source.unmeasured),
                "provenance": provenance(gpu, timer.clock) | where_it_ran(time.perf_counter() - started),
                "passes_ms": timer.median_ms(),
            }
        records = [PairRecord(p, row, exact) for p, row, exact in zip(unit.positions, rows, counts, strict=True)]
        return encode(records, told)

    def release(self) -> None:
        """Let go of the scene and its GL objects."""
        loaded, self._loaded = self._loaded, None
        if loaded is not None and loaded.source is not None:
            with loaded.gpu:
                loaded.source.release()
                loaded.gpu.collect()


def warm_up() -> None:
    """Imports that the first unit would wait for, beside this module's own.  No context: studies name their device."""
    with contextlib.suppress(TaubenchError):  # told when a unit needs what is missing, with the unit
        require_pyarrow()


def open_context(settings: Settings) -> Gpu:
    """The worker's GL context.  Raises NoOpenGL, or GraphicsError where the study itself names the backend."""
    try:
        return open_gpu(settings.device.backend, settings.device.device)
    except GraphicsError as error:
        if settings.device.backend != "auto" or settings.device.device is not None:
            raise
        raise NoOpenGL(error.what, where=error.where, hint=error.hint) from None


def head(scene: Scene, poser: Poser, camera: Any, settings: Settings) -> bytes:
    """Everything the summary says without a frame being drawn, as JSON; the cameras of all frames with every digit."""
    require_triangles(scene)
    frames = frame_range(scene, camera, settings)
    views = [camera.view_at(poser.sample(frame / settings.sequence.fps)) for frame in frames]
    values = {
        "schema": HEAD_SCHEMA,
        "version": __version__,
        "one_file": scene.files == 1,  # a .glb may have pictures and buffers beside it
        "frames": [frames.start, frames.stop],
        "facts": scene_facts(scene, camera, frames, settings, poser),
        "positions": [view.position.tolist() for view in views],
        "rotations": [view.world_from_view.tolist() for view in views],
    }
    return (json.dumps(values, default=_plain) + "\n").encode()


def where_it_ran(seconds: float) -> dict[str, Any]:
    return {"host": platform.node(), "pid": os.getpid(), "seconds": seconds}


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no place in a head")
