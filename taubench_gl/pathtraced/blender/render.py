"""Renders reference images with Cycles: starts Blender, follows its progress, resumes, records what it did."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import shlex
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta, Struct, convert, field
from msgspec.structs import asdict

from taubench_gl import __version__
from taubench_gl.animation import CameraTrack, View
from taubench_gl.data_files import read_json
from taubench_gl.errors import OutputError, PathTracedError
from taubench_gl.folder_lock import FolderLock
from taubench_gl.outputs import cannot_write, log_file, write_atomically
from taubench_gl.pathtraced.blender.job import FRAME_NAME, Quality, identity, make_job, write_resampled
from taubench_gl.pathtraced.blender.process import blender_python, require_blender, run_script
from taubench_gl.pathtraced.cameras import CAMERA_FILE, camera_file_text, read_camera_file
from taubench_gl.pathtraced.exr import read_header
from taubench_gl.scene.model import Scene

PROVENANCE_FILE, LOG_FILE, JOB_FOLDER = "provenance.json", "render.log", ".job"
CLOCK = "wall clock around each frame's render, within Blender"
_RECORDED = (
    "fps", "size", "samples", "bounces", "seed", "seed_per_frame", "crisp", "cull_back_faces", "single_scatter",
    "sky", "sun", "image", "image_sha256", "light_unit",
)  # fmt: skip


class RecordedQuality(Struct):
    """Cycles settings of a render, None: not recorded."""

    samples: int | None = None  # per pixel
    bounces: int | None = None
    seed: int | None = None
    seed_per_frame: bool | None = None
    crisp: bool | None = None


class RecordedLighting(Struct):
    """Fields of Settings, resolved, that a render has; None: not recorded."""

    light_unit: str | None = None
    environment: str | list[float] | None = None


class RenderRecord(Struct):
    """What ``evaluate`` reads of provenance.json, which ``render_reference`` writes.  None: not recorded."""

    job: str | None = None  # ``identity`` of the frames
    blender: str | None = None  # version
    settings: RecordedQuality | None = None
    lighting: RecordedLighting = field(default_factory=RecordedLighting)
    clock: str = CLOCK  # how the times were measured
    cores: int | None = None
    frame_seconds: dict[Annotated[str, Meta(pattern=r"^-?[0-9]{1,9}$")], float] = {}  # number of a frame -> render time

    def summary(self, frames: Iterable[int]) -> dict[str, Any]:
        """The block ``render`` of summary.json; ``seconds_per_frame`` is the mean over the timed ones of ``frames``."""
        seconds = [self.frame_seconds[str(frame)] for frame in frames if str(frame) in self.frame_seconds]
        return asdict(self.settings) | {
            "blender": self.blender,
            "seconds_per_frame": sum(seconds) / len(seconds) if seconds else None,
            "clock": f"{self.clock}, {'?' if self.cores is None else self.cores} cores",
        }


@dataclass(frozen=True, slots=True)
class RenderProgress:
    """Progress of one ``render_reference``."""

    done: int  # finished frames
    total: int  # frames
    share: float  # finished share of the current frame's samples, in [0, 1]
    seconds: float | None  # render time of the last finished frame


def render_reference(
    scene: Scene,
    camera: CameraTrack,
    frames: range,
    out: str | Path,
    *,
    fps: float,
    size: tuple[int, int],
    quality: Quality | None = None,
    lighting: Mapping[str, Any] | None = None,
    progress: Callable[[RenderProgress], None] | None = None,
    python: str | None = None,
) -> list[str]:
    """Render ``frames`` into ``out``: frame_NNNN.exr, camera.json, provenance.json, render.log.  Returns notes.

    Complete frames of the same job are kept.  ``size``: width, height in pixels.  ``lighting``: the
    resolved fields light_unit, exposure and environment of Settings, for the record.  Raises PathTracedError if bpy is
    missing, Blender fails, or ``out`` holds frames of another job; OutputError if another process renders into ``out``.
    """
    out, quality, python = Path(out), quality or Quality(), python or blender_python()
    job, views, notes = make_job(scene, camera, frames, fps, size, quality)
    key = identity(job, scene.sha256)
    with FolderLock(out):
        _prepare(out, key)
        job["frames"] = [frame for frame in frames if not _is_complete(out / (FRAME_NAME % frame), size)]
        version = require_blender(python) if job["frames"] else _read_json(out / PROVENANCE_FILE).get("blender")
        _merge_cameras(out, views, fps, size)
        with _job_folder(out) as folder:
            keyed = range(frames[0] - 1, frames[-1] + 2)
            path = write_resampled(scene, keyed, fps, folder)
            _write_provenance(out, key, job, scene, camera, version, notes, lighting or {})
            if job["frames"]:
                job |= {"scene": str(path), "folders": [str(out.resolve())], "seeds": [quality.seed]}
                _run(python, job, folder, out, len(frames), progress)
        lost = [frame for frame in frames if not _is_complete(out / (FRAME_NAME % frame), size)]
    if lost:
        raise PathTracedError(f"Blender did not write frame {lost[0]}", where=str(out / LOG_FILE))
    return notes


def _prepare(out: Path, key: str) -> None:
    """Remove what a killed driver left in ``out``, and check that its frames are of this job."""
    try:
        for leftover in out.glob(".frame_*.partial.exr"):
            leftover.unlink()
    except OSError as error:
        raise cannot_write(out, error) from None
    recorded_key = _read_json(out / PROVENANCE_FILE).get("job")
    if recorded_key not in (None, key):
        hint = "give --out another folder, or delete this one"
        raise PathTracedError("holds frames of another scene or with other settings", where=str(out), hint=hint)


@contextlib.contextmanager
def _job_folder(out: Path) -> Iterator[Path]:
    """A folder for the files that Blender reads, in ``out``: the next driver removes that of a killed one."""
    folder = out / JOB_FOLDER
    try:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
    except OSError as error:
        raise cannot_write(folder, error) from None
    try:
        yield folder.resolve()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _is_complete(path: Path, size: tuple[int, int]) -> bool:
    """Whether ``path`` is a frame of ``size``: the script renames frames when they are complete, so a valid header is
    enough.
    """
    try:
        return path.is_file() and read_header(path).size == tuple(size)
    except PathTracedError:
        return False


def _run(
    python: str,
    job: dict[str, Any],
    folder: Path,
    out: Path,
    total: int,
    progress: Callable[[RenderProgress], None] | None,
) -> None:
    frames_done = total - len(job["frames"])
    seconds: float | None = None

    def on_event(event: dict[str, Any]) -> None:
        nonlocal frames_done, seconds
        share = 0.0
        if event["event"] == "frame":
            frames_done, seconds = frames_done + 1, event["seconds"]
            _record_seconds(out, event["frame"], seconds)
        elif event["event"] == "samples":
            share = event["done"] / event["total"]
        if progress is not None and event["event"] in ("frame", "samples", "ready"):
            progress(RenderProgress(frames_done, total, share, seconds))

    with log_file(out / LOG_FILE) as log:
        failure = run_script(python, "render_script.py", job, folder, on_event, log.write)
    if failure is not None:
        raise PathTracedError(failure, where=str(out / LOG_FILE))


def _merge_cameras(out: Path, views: dict[int, View], fps: float, size: tuple[int, int]) -> None:
    """Write the sidecar; it keeps the frames of earlier renders into the same folder."""
    path = out / CAMERA_FILE
    earlier = read_camera_file(path).views if path.is_file() else {}
    write_atomically(path, camera_file_text(earlier | views, fps, size))


def _write_provenance(
    out: Path,
    key: str,
    job: dict[str, Any],
    scene: Scene,
    camera: CameraTrack,
    version: str | None,
    notes: list[str],
    lighting: Mapping[str, Any],
) -> None:
    path = out / PROVENANCE_FILE
    values = {
        "job": key,
        "version": __version__,
        "command": shlex.join(sys.argv),
        "blender": version,
        "machine": platform.machine(),
        "scene": {"name": scene.name, "sha256": scene.sha256, "playing": list(scene.playing)},
        "camera": camera.describe(),
        "settings": {name: job[name] for name in _RECORDED},
        "lighting": dict(lighting),
        "cores": os.cpu_count(),
        "notes": notes,
        "clock": CLOCK,
        "frame_seconds": _read_json(path).get("frame_seconds", {}),
    }
    write_atomically(path, json.dumps(values, indent=2) + "\n")


def _record_seconds(out: Path, frame: int, seconds: float) -> None:
    """Record the seconds of a frame as soon as it is finished, so that an interrupted render keeps them."""
    values = _read_json(out / PROVENANCE_FILE)
    values.setdefault("frame_seconds", {})[str(frame)] = seconds
    write_atomically(out / PROVENANCE_FILE, json.dumps(values, indent=2) + "\n")


def read_render(folder: Path) -> RenderRecord | None:
    """The record in ``folder``; None if another program wrote the frames."""
    record = convert(_read_json(folder / PROVENANCE_FILE), RenderRecord)
    return None if record.job is None or record.settings is None else record


def _read_json(path: Path) -> dict[str, Any]:
    """The values of provenance.json; empty if it is missing or damaged."""
    try:
        return read_json(path, RenderRecord)
    except OutputError:
        return {}
