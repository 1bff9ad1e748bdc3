"""Workers: load the scene of a unit, render, count, and return bytes.  They write no files.

``python -m taubench_gl.batch.worker CONNECTION LIFELINE`` (two inherited file descriptors) is a worker process.  It
receives units and sends events over the connection.  The lifeline is a pipe whose other end only the driver holds: when
the driver ends, in whatever way, the worker ends too.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from taubench_gl import __version__
from taubench_gl.animation import Poser, camera_of_run
from taubench_gl.batch.partition import PairRecord, encode, require_pyarrow
from taubench_gl.batch.units import Event, Failed, Finished, NoGraphics, PairDone, Task, Unit
from taubench_gl.errors import GraphicsError, SceneError, TaubenchError
from taubench_gl.evaluation import (
    ResolvedLighting,
    SceneInput,
    Session,
    Wants,
    checked_frames,
    environment_image,
    file_hashes,
    files_identity,
    frame_range,
    frame_schedule,
    pair_schedule,
    require_exact,
    require_triangles,
    resolve_lighting,
    scene_facts,
    with_pairs,
)
from taubench_gl.gpu.context import Gpu, open_gpu
from taubench_gl.provenance import provenance
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import AUTO, Settings

HEAD_SCHEMA = "taubench-gl/batch-head/1"


LIGHTING = ("light_unit", "exposure", "environment", "spp", "pairs")
"""Settings that are resolved once for all units of a job."""


class NoOpenGL(GraphicsError):
    """This worker has no OpenGL; another worker may have it."""


@dataclass(slots=True)
class _Loaded:
    """A scene and, once it renders, its session; reused by the next unit of the same job."""

    key: tuple[Any, ...]
    scene: Scene
    poser: Poser
    camera: Any
    session: Session | None = None


class Worker:
    """Runs units one after another.  Keeps the scene and the session of the last job for its next chunk."""

    def __init__(self) -> None:
        self._loaded: _Loaded | None = None

    def run(self, unit: Unit, on_pair: Callable[[], None] = lambda: None) -> bytes:
        """The JSON of a head or the Parquet file of a chunk.  Raises TaubenchError; NoOpenGL if no context opens."""
        started = time.perf_counter()
        gpu = None if unit.positions is None else open_context(unit.settings)
        loaded = self._load(unit)
        if gpu is None:
            if unit.settings.lighting.exposure == AUTO:
                open_context(unit.settings)  # its exposure may have to be metered
            return head(loaded.scene, loaded.poser, loaded.camera, unit.settings)
        if unit.sha256 != files_identity(file_hashes(loaded.scene, unit.settings)):
            raise SceneError("changed while the batch was running", where=unit.scene, hint="run the batch again")
        return self._count(unit, loaded, on_pair, started)

    def _load(self, unit: Unit) -> _Loaded:
        settings = unit.settings
        key = (unit.scene, *settings.sequence.reading.values(), settings.sequence.camera, unit.job)
        if self._loaded is not None and self._loaded.key == key and unit.positions is not None:
            return self._loaded
        self.release()
        scene = load_scene(unit.scene, **settings.sequence.reading)
        self._loaded = _Loaded(key, scene, Poser(scene), camera_of_run(scene, settings.sequence))
        return self._loaded

    def _count(self, unit: Unit, loaded: _Loaded, on_pair: Callable[[], None], started: float) -> bytes:
        settings = unit.settings
        frames = frame_range(loaded.scene, loaded.camera, settings)
        if loaded.session is None:
            given = SceneInput(loaded.scene, loaded.camera, frames, ResolvedLighting(settings), loaded.poser)
            loaded.session = Session(given, Wants(lobes=unit.lobes))
        session = loaded.session
        session.timer.reset()
        schedule = pair_schedule(frames, unit.positions) if unit.positions else frame_schedule(frames, settings)
        counts, lobes = [], []
        for pair in session.pairs(schedule, checked_frames(frame_schedule(frames, settings))):
            counts.append(pair.evaluated.counts)
            lobes.append(pair.evaluated.lobes)
            on_pair()
        with session.gpu:
            session.gpu.check("a chunk of a batch")
            report = {
                "source": session.source.describe(),
                "brightness": session.brightness.as_dict(),
                "depths": session.depths,
                "unmeasured": dict(session.source.unmeasured),
                "reprojection": session.source.reprojection,
                "provenance": provenance(session.gpu, session.timer.clock)
                | _process_info(time.perf_counter() - started),
                "passes_ms": session.timer.median_ms(),
            }
        of_pairs = zip(unit.positions, session.rows, counts, lobes, strict=True)
        return encode([PairRecord(*of_pair) for of_pair in of_pairs], report)

    def release(self) -> None:
        """Close the session of the scene."""
        loaded, self._loaded = self._loaded, None
        if loaded is not None and loaded.session is not None:
            loaded.session.release()


def warm_up() -> None:
    """Import what the first unit needs beside this module's imports.  Opens no context: jobs choose their device."""
    with contextlib.suppress(TaubenchError):  # reported by the first unit that needs it
        require_pyarrow()


def open_context(settings: Settings) -> Gpu:
    """The worker's GL context.  Raises NoOpenGL, or GraphicsError if the settings name a backend or device."""
    try:
        return open_gpu(settings.device.backend, settings.device.device)
    except GraphicsError as error:
        if settings.device.backend != "auto" or settings.device.device is not None:
            raise
        raise NoOpenGL(error.what, where=error.where, hint=error.hint) from None


def head(scene: Scene, poser: Poser, camera: Any, settings: Settings) -> bytes:
    """All of the summary that needs no pair, and the camera poses of all frames in full precision, as JSON.

    ``lighting``: the settings of ``LIGHTING``, resolved for all units of the job.
    """
    require_triangles(scene)
    if settings.metrics.exact:
        require_exact(settings)
    frames = frame_range(scene, camera, settings)
    resolved = resolve_lighting(scene, settings, camera, frames=frames, poser=poser)
    resolved = replace(resolved, settings=with_pairs(scene, resolved.settings, frames))
    views = [camera.view_at(poser.sample(frame / settings.sequence.fps)) for frame in frames]
    values = {
        "schema": HEAD_SCHEMA,
        "version": __version__,
        # A .glb may refer to images and buffers in other files.
        "one_file": scene.files == 1 and environment_image(resolved.settings) is None,
        "frames": [frames.start, frames.stop],
        "facts": scene_facts(scene, camera, frames, resolved, poser),
        "lighting": {name: resolved.settings.to_dict()[name] for name in LIGHTING},
        "positions": [view.position.tolist() for view in views],
        "rotations": [view.world_from_view.tolist() for view in views],
    }
    return (json.dumps(values, default=_plain) + "\n").encode()


def resolved_settings(settings: Settings, head: Mapping[str, Any]) -> Settings:
    """``settings`` of a job with the lighting that its head resolved."""
    lighting = {name: tuple(v) if isinstance(v, list) else v for name, v in head.get("lighting", {}).items()}
    return settings.replace(**lighting)


def _process_info(seconds: float) -> dict[str, Any]:
    return {"host": platform.node(), "pid": os.getpid(), "seconds": seconds}


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be stored in a head")


def attempt(worker: Worker, unit: Unit | Task, on_pair: Callable[[], None] = lambda: None) -> Event:
    """Run a unit and return an event, whatever it raises except NoOpenGL: the caller knows the worker's name.

    A ``Task`` runs itself.
    """
    try:
        return Finished(unit, worker.run(unit, on_pair) if isinstance(unit, Unit) else unit.run())
    except NoOpenGL:
        raise
    except TaubenchError as error:
        return _failed(worker, unit, str(error))
    except Exception as error:
        # A bug in this program or a library fails one scene: its log has the traceback, the other scenes still run.
        return _failed(worker, unit, f"{unit.scene}: internal error, {type(error).__name__}: {error}")


def _failed(worker: Worker, unit: Unit | Task, message: str) -> Failed:
    details = traceback.format_exc()
    worker.release()
    return Failed(unit, " ".join(message.split()), f"in {unit.name} of {unit.scene}\n\n{details}")


def main(arguments: list[str]) -> None:
    connection, lifeline = Connection(int(arguments[0])), int(arguments[1])
    threading.Thread(target=_exit_with_the_driver, args=(lifeline,), daemon=True).start()
    warm_up()  # while one worker computes the head of the first job and the others wait for it
    worker = Worker()
    while True:
        try:
            unit = connection.recv()
        except EOFError:
            return
        try:
            event = attempt(worker, unit, lambda u=unit: connection.send(PairDone(u)))
        except NoOpenGL as error:
            connection.send(NoGraphics(f"worker process {os.getpid()}", str(error), unit))
            return
        connection.send(event)


def _exit_with_the_driver(lifeline: int) -> None:
    os.read(lifeline, 1)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1:])
