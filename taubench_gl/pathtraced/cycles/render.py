"""Rendering a sequence with Cycles: prepares the job, runs Blender's Python, follows its progress, resumes."""

from __future__ import annotations

import json
import os
import platform
import shlex
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl import __version__
from taubench_gl.animation import CameraTrack
from taubench_gl.errors import OutputError, PathTracedError
from taubench_gl.outputs import cannot_write, make_folders, remove_folders, write_atomically
from taubench_gl.pathtraced.camera_file import camera_file_text
from taubench_gl.pathtraced.cycles.job import FRAME_NAME, Quality, identity, make_job
from taubench_gl.pathtraced.cycles.resample import write_resampled
from taubench_gl.pathtraced.exr import read_header
from taubench_gl.scene.model import Scene

INTERPRETER = "TAUBENCH_BLENDER_PYTHON"
CAMERA_FILE, PROVENANCE_FILE, LOG_FILE = "camera.json", "provenance.json", "render.log"
HOW_TO_GET_BPY = (
    f"install bpy 4.5 with Python 3.11 (pip install 'bpy==4.5.*', best in an environment of its own) and point "
    f"{INTERPRETER} at that interpreter"
)
_LAST_LINES = 12
CLOCK = "wall clock around each frame's render, within Blender"


@dataclass(frozen=True, slots=True)
class RenderProgress:
    """``done`` of ``total`` frames are rendered; ``share`` of the current one's samples; ``seconds`` of the last."""

    done: int
    total: int
    share: float
    seconds: float | None


def blender_python() -> str:
    """The interpreter that has bpy: ``TAUBENCH_BLENDER_PYTHON``, else this one.  Not checked."""
    return os.environ.get(INTERPRETER) or sys.executable


def blender_version(python: str | None = None) -> str | None:
    """Version of the bpy that ``python`` imports, None if it has none."""
    code = "import bpy; print('@tb', bpy.app.version_string)"
    try:
        done = subprocess.run([python or blender_python(), "-c", code], capture_output=True, text=True, timeout=300)
    except (OSError, subprocess.SubprocessError):
        return None
    lines = [line for line in done.stdout.splitlines() if line.startswith("@tb ")]
    return lines[0][4:].strip() if done.returncode == 0 and lines else None


def render_reference(
    scene: Scene,
    camera: CameraTrack,
    frames: range,
    out: str | Path,
    *,
    fps: float,
    size: tuple[int, int],
    quality: Quality | None = None,
    progress: Callable[[RenderProgress], None] | None = None,
    python: str | None = None,
) -> list[str]:
    """Render ``frames`` into ``out``: frame_NNNN.exr, camera.json, provenance.json, render.log.  -> notes.

    Frames that are there already, whole and of the same job, are kept.  Raises PathTracedError where bpy is missing,
    Blender fails, or ``out`` holds another job's frames.
    """
    out, quality, python = Path(out), quality or Quality(), python or blender_python()
    job, poses, notes = make_job(scene, camera, frames, fps, size, quality)
    key = identity(job, scene.sha256)
    made = _prepare(out, key)
    job["frames"] = [frame for frame in frames if not _is_whole(out / (FRAME_NAME % frame), size)]
    version = _known_version(out)
    if job["frames"]:
        version = blender_version(python)
        if version is None:
            remove_folders(made)
            raise PathTracedError(f"{python} cannot import bpy, Blender's Python module", hint=HOW_TO_GET_BPY)
    _merge_cameras(out, poses, fps, size)
    with tempfile.TemporaryDirectory(prefix="taubench-") as folder:
        keyed = range(frames[0] - 1, frames[-1] + 2)
        path = write_resampled(scene, keyed, fps, Path(folder))
        _write_provenance(out, key, job, scene, camera, version, notes)
        if job["frames"]:
            job |= {"scene": str(path), "out": str(out.resolve())}
            job_file = Path(folder) / "job.json"
            job_file.write_text(json.dumps(job), encoding="utf-8")
            _run(python, job_file, out, len(frames), len(frames) - len(job["frames"]), progress)
    lost = [frame for frame in frames if not _is_whole(out / (FRAME_NAME % frame), size)]
    if lost:
        raise PathTracedError(f"Blender left out frame {lost[0]}", where=str(out / LOG_FILE))
    return notes


def _prepare(out: Path, key: str) -> list[Path]:
    """Make the folder, or see that it is this job's; the folders that were made."""
    try:
        made = make_folders(out)
        for leftover in out.glob(".frame_*.partial.exr"):
            leftover.unlink()
    except FileExistsError:
        raise OutputError("is not a folder", where=str(out), hint="give --out another name") from None
    except OSError as error:
        raise cannot_write(out, error) from None
    known = _read_json(out / PROVENANCE_FILE).get("job")
    if known not in (None, key):
        hint = "give --out another folder, or delete this one"
        raise PathTracedError("holds frames of another scene or with other settings", where=str(out), hint=hint)
    return made


def _is_whole(path: Path, size: tuple[int, int]) -> bool:
    """Frames get their name only when they are whole, so the header is check enough."""
    try:
        return path.is_file() and read_header(path).size == tuple(size)
    except PathTracedError:
        return False


def _run(
    python: str, job_file: Path, out: Path, total: int, done: int, progress: Callable[[RenderProgress], None] | None
) -> None:
    command = [python, str(Path(__file__).with_name("inside.py")), str(job_file)]
    tail: deque[str] = deque(maxlen=_LAST_LINES)
    seconds: float | None = None
    with open(out / LOG_FILE, "a", encoding="utf-8") as log:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", bufsize=1
        )
        try:
            for line in process.stdout:
                if not line.startswith("@tb "):
                    log.write(line)
                    if line.strip():
                        tail.append(line.strip())
                    continue
                said = json.loads(line[4:])
                share = 0.0
                if said["event"] == "frame":
                    done, seconds = done + 1, said["seconds"]
                    _note_seconds(out, said["frame"], seconds)
                elif said["event"] == "samples":
                    share = said["done"] / said["total"]
                if progress is not None and said["event"] in ("frame", "samples", "ready"):
                    progress(RenderProgress(done, total, share, seconds))
            code = process.wait()
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
    if code:
        last = next((line for line in reversed(tail) if "Error" in line), tail[-1] if tail else "it said nothing")
        raise PathTracedError(f"Blender stopped with code {code}: {last}", where=str(out / LOG_FILE))


def _merge_cameras(out: Path, poses: dict[int, Any], fps: float, size: tuple[int, int]) -> None:
    """The sidecar covers frames rendered earlier into the same folder too."""
    from taubench_gl.pathtraced.camera_file import read_camera_file

    path = out / CAMERA_FILE
    earlier = read_camera_file(path).poses if path.is_file() else {}
    write_atomically(path, camera_file_text(earlier | poses, fps, size))


def _known_version(out: Path) -> str | None:
    return _read_json(out / PROVENANCE_FILE).get("blender")


def _write_provenance(
    out: Path,
    key: str,
    job: dict[str, Any],
    scene: Scene,
    camera: CameraTrack,
    version: str | None,
    notes: list[str],
) -> None:
    kept = ("fps", "size", "samples", "bounces", "seed", "seed_per_frame", "crisp", "cull_back_faces", "sky")
    path = out / PROVENANCE_FILE
    values = {
        "job": key,
        "version": __version__,
        "command": shlex.join(sys.argv),
        "blender": version,
        "machine": platform.machine(),
        "scene": {"name": scene.name, "sha256": scene.sha256, "playing": list(scene.playing)},
        "camera": camera.describe(),
        "settings": {name: job[name] for name in kept},
        "cores": os.cpu_count(),
        "notes": notes,
        "clock": CLOCK,
        "frame_seconds": _read_json(path).get("frame_seconds", {}),
    }
    write_atomically(path, json.dumps(values, indent=2) + "\n")


def _note_seconds(out: Path, frame: int, seconds: float) -> None:
    """Once per frame, so that an interrupted render keeps what its finished frames took."""
    values = _read_json(out / PROVENANCE_FILE)
    values.setdefault("frame_seconds", {})[str(frame)] = seconds
    write_atomically(out / PROVENANCE_FILE, json.dumps(values, indent=2) + "\n")


@dataclass(frozen=True, slots=True)
class RenderRecord:
    """What ``render_reference`` records about a folder of frames.  None: not recorded."""

    samples: int | None  # per pixel
    bounces: int | None
    seed: int | None
    seed_per_frame: bool | None
    crisp: bool | None
    fps: float | None
    blender: str | None  # version
    frame_seconds: Mapping[int, float]  # frame -> render time
    clock: str  # how the times were measured

    def summary(self, frames: Iterable[int]) -> dict[str, Any]:
        """The block ``render`` of summary.json; ``seconds_per_frame`` is the mean over the timed ones of ``frames``."""
        seconds = [self.frame_seconds[frame] for frame in frames if frame in self.frame_seconds]
        return {
            **{name: getattr(self, name) for name in ("samples", "bounces", "seed", "seed_per_frame", "crisp")},
            "blender": self.blender,
            "seconds_per_frame": sum(seconds) / len(seconds) if seconds else None,
            "clock": self.clock,
        }


def read_render(folder: Path) -> RenderRecord | None:
    """The record in ``folder``; None if another program wrote the frames."""
    values = _read_json(folder / PROVENANCE_FILE)
    settings = values.get("settings")
    if not isinstance(settings, dict) or "job" not in values:
        return None
    seconds = {int(frame): float(s) for frame, s in (values.get("frame_seconds") or {}).items()}
    return RenderRecord(
        **{name: settings.get(name) for name in ("samples", "bounces", "seed", "seed_per_frame", "crisp", "fps")},
        blender=values.get("blender"),
        frame_seconds=seconds,
        clock=f"{values.get('clock', CLOCK)}, {values.get('cores', '?')} cores",
    )


def _read_json(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return values if isinstance(values, dict) else {}
