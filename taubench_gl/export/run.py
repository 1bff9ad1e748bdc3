"""``export_scene``: a scene, a format and a folder -> files; stopped at any moment, it goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taubench_gl import __version__
from taubench_gl.animation import View, choose_camera
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation import frame_range, frame_total, require_triangles
from taubench_gl.export.channels import PRECISIONS, choose_channels
from taubench_gl.export.formats import ExrWriter, NpzWriter, Spec, Writer, ZarrWriter
from taubench_gl.export.frames import JITTERS, FrameSource
from taubench_gl.export.sintel import NAMES as SINTEL_NAMES
from taubench_gl.export.sintel import SintelWriter
from taubench_gl.gpu.context import open_gpu
from taubench_gl.outputs import is_partial_of, write_atomically
from taubench_gl.pathtraced.cameras import camera_file_text
from taubench_gl.run import Progress
from taubench_gl.scene import load_scene
from taubench_gl.settings import Settings

SCHEMA = "taubench-gl/export/1"
MANIFEST, CAMERA_FILE = "export.json", "camera.json"
FORMATS: dict[str, type[Writer]] = {"exr": ExrWriter, "npz": NpzWriter, "zarr": ZarrWriter, "sintel": SintelWriter}


@dataclass(frozen=True, slots=True)
class Exported:
    """``written`` frames now, ``kept`` from before; ``unmeasured``: channel -> why the scene does not give it."""

    out: Path
    written: int
    kept: int
    names: tuple[str, ...]
    unmeasured: dict[str, str]


def export_scene(
    scene: str | Path,
    out: str | Path,
    settings: Settings | None = None,
    *,
    format: str = "exr",
    channels: tuple[str, ...] = (),
    precision: str = "native",
    jitter: str = "none",
    overwrite: bool = False,
    progress: Callable[[Progress], None] | None = None,
) -> Exported:
    """Write the frames that ``settings.frames`` asks for and that are not in ``out`` yet.

    ``channels``: names and groups (``export.channels``), empty for the default ones.  Raises TaubenchError; an ``out``
    that holds an export of anything else is refused, or replaced with ``overwrite``.
    """
    settings, out = settings or Settings(), Path(out)
    for what, value, allowed in (
        ("format", format, FORMATS), ("precision", precision, PRECISIONS), ("jitter", jitter, JITTERS)
    ):  # fmt: skip
        if value not in allowed:
            raise SettingsError(f"no {what} is named {value!r}", hint=f"choose from {', '.join(allowed)}")
    if settings.metrics.samples_per_pixel != 1 or settings.metrics.pairs != "all":
        raise SettingsError("an export has every frame, with one sample in each pixel", hint="leave both settings out")
    names = choose_channels(channels)
    if format == "sintel":
        names = tuple(dict.fromkeys([*SINTEL_NAMES, *(("color",) if "color" in channels else ())]))
    loaded = load_scene(scene, scene=settings.sequence.scene, animation=settings.sequence.animation)
    require_triangles(loaded)
    camera = choose_camera(loaded, settings.sequence.camera)
    frames = frame_range(loaded, camera, settings)
    count = frame_total(loaded, camera, settings)
    gpu = open_gpu(settings.device.backend, settings.device.device)
    with gpu:
        source = FrameSource(gpu, loaded, camera, settings, names, count, jitter)
        try:
            if not source.names:
                why = "; ".join(f"{name}: {reason}" for name, reason in source.unmeasured.items())
                raise SettingsError(f"the scene gives none of these channels: {why}")
            spec = Spec(loaded.name, source_size(settings), settings.sequence.fps, frames, source.names, precision)
            writer = FORMATS[format](out, spec)
            whole = _claim(out, manifest(spec, settings, format, jitter, loaded.sha256, source.unmeasured), overwrite)
            writer.prepare()
            held = [frame for frame in whole if frame in frames or writer.done(frame)]
            _write_cameras(out, {frame: source.view(frame) for frame in held}, spec)
            missing = [frame for frame in frames if not writer.done(frame)]
            done = _write_all(source, writer, missing, loaded.name, progress)
            gpu.check("an export")
        finally:
            source.release()
    return Exported(out, done, len(frames) - len(missing), source.names, source.unmeasured)


def source_size(settings: Settings) -> tuple[int, int]:
    return settings.sequence.width, settings.sequence.height


def _write_all(
    source: FrameSource,
    writer: Writer,
    missing: list[int],
    name: str,
    progress: Callable[[Progress], None] | None,
) -> int:
    import time

    started = time.perf_counter()
    for done, frame in enumerate(source.frames(missing), start=1):
        writer.write(frame)
        now = time.perf_counter()
        if progress is not None:
            progress(Progress(name, done, len(missing), now - started))
        started = now
    return len(missing)


def manifest(
    spec: Spec, settings: Settings, format: str, jitter: str, sha256: str | None, unmeasured: dict[str, str]
) -> dict[str, Any]:
    """What export.json says: everything the files depend on."""
    plain = settings.to_dict()
    for name in ("frames", "backend", "device"):
        plain.pop(name)
    return json.loads(
        json.dumps(
            {
                "schema": SCHEMA,
                "version": __version__,
                "scene": spec.scene,
                "sha256": sha256,
                "format": format,
                "channels": list(spec.names),
                "unmeasured": unmeasured,
                "precision": spec.precision,
                "jitter": jitter,
                "settings": plain,
                "frames": [spec.frames.start, spec.frames.stop],
            }
        )
    )


def _claim(out: Path, told: dict[str, Any], overwrite: bool) -> range:
    """Write the manifest, or find that the folder's is the same; the frames it speaks of.  Raises OutputError."""
    path = out / MANIFEST
    if out.exists() and not out.is_dir():
        raise OutputError("is not a folder", where=str(out), hint="give --out another name")
    before = _read_manifest(path)
    if before is None and out.is_dir() and not all(is_partial_of(path, p) for p in out.iterdir()):
        raise OutputError("holds other files and no export", where=str(out), hint="give --out a new folder")
    different = [] if before is None else _different(before, told)
    # Another range of frames adds to what is there (``frames``: from the first to the last of both), but where the
    # range shapes the files (Zarr's arrays, Sintel's last frame).
    if different == ["frames"] and told["format"] in ("exr", "npz") and not overwrite:
        (start, stop), (first, end) = before["frames"], told["frames"]
        told, different = told | {"frames": [min(start, first), max(stop, end)]}, []
    if different and not overwrite:
        what = f"holds an export with other {', '.join(different)}"
        raise OutputError(what, where=str(out), hint="give --overwrite to replace it, or another --out")
    if before is not None and (different or overwrite):
        size = (before["settings"]["width"], before["settings"]["height"])
        names = tuple(before["channels"])
        old = Spec(before["scene"], size, before["settings"]["fps"], range(*before["frames"]), names, "native")
        FORMATS[before["format"]](out, old).remove()
    write_atomically(path, json.dumps(told, indent=2, ensure_ascii=False) + "\n", parents=True)
    return range(*told["frames"])


def _read_manifest(path: Path) -> dict[str, Any] | None:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        return values if values["schema"] == SCHEMA else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _different(before: dict[str, Any], told: dict[str, Any]) -> list[str]:
    """Names of what differs, settings by their own names."""
    out = [key for key in told if key != "settings" and before.get(key) != told[key]]
    settings = before.get("settings", {})
    return out + [key for key, value in told["settings"].items() if settings.get(key) != value]


def _write_cameras(out: Path, views: dict[int, View], spec: Spec) -> None:
    """camera.json: the sidecar that ``evaluate exr: --camera-file`` reads, for every format."""
    text = camera_file_text(views, spec.fps, spec.size)
    write_atomically(out / CAMERA_FILE, text, parents=True)
