"""Exports a scene to a folder.  An interrupted export continues where it stopped."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from taubench_gl import __version__
from taubench_gl.animation import CameraTrack, View
from taubench_gl.animation.eyes import both_eyes
from taubench_gl.data_files import read_json
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation import plan_scene
from taubench_gl.evaluation.owner import opened_gpu
from taubench_gl.export.channels import RADIANCE, choose_channels
from taubench_gl.export.formats import ExportSpec, ExrWriter, NpzWriter, Writer, ZarrWriter
from taubench_gl.export.frames import FrameSource
from taubench_gl.export.sequences import NoisebaseWriter, NssWriter
from taubench_gl.export.sintel import SintelWriter
from taubench_gl.features import COLUMNS
from taubench_gl.folder_lock import LOCK_FILE, FolderLock
from taubench_gl.metrics.activity import camera_activity, detect_cuts
from taubench_gl.option_groups import LEARNING, ExportOptions
from taubench_gl.outputs import is_partial_of, write_atomically
from taubench_gl.pathtraced.cameras import CAMERA_FILE, camera_file_text
from taubench_gl.run import Progress
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

SCHEMA = "taubench-gl/export/1"
MANIFEST = "export.json"
FORMATS: dict[str, type[Writer]] = {
    "exr": ExrWriter, "npz": NpzWriter, "zarr": ZarrWriter, "sintel": SintelWriter, "nss": NssWriter,
    "noisebase": NoisebaseWriter,
}  # fmt: skip


def exported_names(options: ExportOptions, *, stereo: bool = False) -> tuple[str, ...]:
    """The channels to export, without those of training.  Raises SettingsError for a channel that does not exist.

    ``stereo``: of both eyes.
    """
    names = choose_channels(options.channels, stereo=stereo)
    fixed = FORMATS[options.format].names
    return names if fixed is None else (*fixed, *(("color",) * (options.format == "sintel" and "color" in names)))


_EXPOSED = frozenset({*RADIANCE, "mask", "mask_forward"})
"""Channels that depend on light, and masks, which depend on the exposure."""


class _Size(msgspec.Struct):
    width: int
    height: int
    fps: float
    exposure: float | str


class Manifest(msgspec.Struct):
    """What a later export into the same folder relies on."""

    schema: str
    scene: str
    sha256: str | None
    format: Literal["exr", "npz", "zarr", "sintel", "nss", "noisebase"]
    channels: list[str]
    settings: _Size
    frames: tuple[int, int]


@dataclass(frozen=True, slots=True)
class ExportResult:
    """Frames ``written`` now and ``kept`` from an earlier run; ``unmeasured``: reason per missing channel."""

    out: Path
    written: int
    kept: int
    names: tuple[str, ...]
    unmeasured: dict[str, str]


def export_scene(
    scene: str | Path,
    out: str | Path,
    settings: Settings | None = None,
    options: ExportOptions | None = None,
    *,
    overwrite: bool = False,
    progress: Callable[[Progress], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> ExportResult:
    """Write the frames of ``settings.sequence.frames`` that ``out`` does not hold yet.

    With history ``eye`` the folders ``left`` and ``right`` hold an export of each eye, of which the other is the
    history.  A folder that holds another export is refused, or replaced if ``overwrite``; one into which another
    process exports is always refused.  ``announce``: gets the time that references take, and their noise.  Raises
    TaubenchError.
    """
    settings, options, out = settings or Settings(), options or ExportOptions(), Path(out)
    if settings.metrics.samples_per_pixel != 1 or not settings.metrics.all_pairs:
        message = "an export contains every frame, with one sample per pixel"
        raise SettingsError(message, hint="leave samples_per_pixel and pairs out")
    if settings.metrics.history != "frame" and (options.format in LEARNING or not settings.metrics.stereo):
        raise SettingsError("this format has one history", hint="give --history frame, or eye", setting="history")
    if options.format in LEARNING and None in (options.training.input, options.training.reference):
        hint = "give --input and --reference, see docs/export.md"
        raise SettingsError(f"format {options.format} needs noisy and clean light", hint=hint)
    control = (overwrite, progress, announce or (lambda line: None))
    if settings.metrics.stereo:
        return _export_eyes(scene, out, settings, options, control)
    with FolderLock(out):
        return _export(scene, out, settings, options, control)


Control = tuple[bool, Callable[[Progress], None] | None, Callable[[str], None]]
"""How an export is run: whether to overwrite, what gets the progress, and what gets lines of text."""


def _export_eyes(
    scene: str | Path, out: Path, settings: Settings, options: ExportOptions, control: Control
) -> ExportResult:
    """Export the left and the right eye into folders of their own, with the exposure of the camera between them."""
    plan = plan_scene(scene, _lit(settings, options))
    lighting = {name: plan.settings.get(name) for name in ("light_unit", "exposure", "environment")}
    eyes = both_eyes(plan.animated.scene, plan.animated.camera, settings.replace(**lighting))
    done = []
    for name, (camera, of_eye) in eyes.items():
        with FolderLock(out / name):
            done.append(_export(plan.animated.scene, out / name, of_eye, options, control, camera))
    written, kept = (sum(getattr(result, count) for result in done) for count in ("written", "kept"))
    return dataclasses.replace(done[0], out=out, written=written, kept=kept)


def _export(
    scene: Scene | str | Path,
    out: Path,
    settings: Settings,
    options: ExportOptions,
    control: Control,
    camera: CameraTrack | None = None,
) -> ExportResult:
    """Export the frames of one camera into ``out``, which the caller has locked.  Raises TaubenchError."""
    overwrite, progress, announce = control
    names = exported_names(options, stereo=settings.metrics.stereo)
    plan = plan_scene(scene, _lit(settings, options), camera)
    settings = plan.settings.replace(columns=settings.metrics.columns, pairs=settings.metrics.pairs)
    frames, loaded = plan.frames, plan.animated.scene
    keywords = {"jitter": options.jitter, "training": options.training, "two_sizes": options.format == "nss"}
    with opened_gpu(settings) as owner, FrameSource(owner.gpu, plan.animated, settings, names, **keywords) as source:
        exported = (*source.names, *(() if source.training is None else source.training.names))
        if not exported:
            why = "; ".join(f"{name}: {reason}" for name, reason in source.unmeasured.items())
            raise SettingsError(f"the scene has none of these channels: {why}")
        sequence = settings.sequence
        size = (sequence.width, sequence.height)
        views = [source.view(frame) for frame in frames]
        activity = camera_activity(np.array([v.position for v in views]), np.array([v.world_from_view for v in views]))
        cuts = tuple(frames[i + 1] for i in np.flatnonzero(detect_cuts(activity, settings.metrics.unit_scale)))
        spec = ExportSpec(loaded.name, size, sequence.fps, frames, exported, options.precision, cuts, source.view)
        writer = FORMATS[options.format](out, spec)
        description = manifest(spec, settings, options, loaded.sha256, source.unmeasured)
        whole = _write_manifest(out, description, overwrite)
        writer.prepare()
        held = [frame for frame in whole if frame in frames or writer.done(frame)]
        _write_cameras(out, {frame: source.view(frame) for frame in held}, spec)
        missing = [frame for frame in frames if not writer.done(frame)]
        if source.training is not None and missing:
            source.training.announce(missing, announce)
        done = _write_all(source, writer, missing, loaded.name, progress)
        owner.gpu.check("an export")
        if source.training is not None and (note := source.training.noise_note()):
            announce(note)
    return ExportResult(out, done, len(frames) - len(missing), exported, source.unmeasured)


def _lit(settings: Settings, options: ExportOptions) -> Settings:
    """``settings`` with the columns that say whether an exposure is needed: geometry does not depend on it."""
    if options.training.wanted:
        return settings.replace(columns=COLUMNS)
    names = exported_names(options, stereo=settings.metrics.stereo)
    return settings if _EXPOSED & set(names) else settings.replace(columns=("frustum",))


def _write_all(
    source: FrameSource,
    writer: Writer,
    missing: list[int],
    name: str,
    progress: Callable[[Progress], None] | None,
) -> int:
    started = time.perf_counter()
    for done, frame in enumerate(source.frames(missing), start=1):
        writer.write(frame)
        now = time.perf_counter()
        if progress is not None:
            progress(Progress(name, done, len(missing), now - started))
        started = now
    return len(missing)


def manifest(
    spec: ExportSpec, settings: Settings, options: ExportOptions, sha256: str | None, unmeasured: dict[str, str]
) -> dict[str, Any]:
    """The contents of export.json: everything that the files depend on."""
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
                "format": options.format,
                "channels": list(spec.names),
                "unmeasured": unmeasured,
                "precision": spec.precision,
                "jitter": options.jitter,
                **({"training": dataclasses.asdict(options.training)} if options.training.wanted else {}),
                "settings": plain,
                "frames": [spec.frames.start, spec.frames.stop],
            }
        )
    )


def _write_manifest(out: Path, new: dict[str, Any], overwrite: bool) -> range:
    """Write export.json and return the frames of the whole export, earlier ones included.

    Raises OutputError if the folder holds other files or, without ``overwrite``, another export.
    """
    path = out / MANIFEST
    before = _read_manifest(path)
    if before is None and any(_foreign(p, path) for p in out.iterdir()):
        raise OutputError("holds other files and no export", where=str(out), hint="give --out a new folder")
    different = [] if before is None else _different(before, new)
    # Another range of frames extends the export, except where the range determines the files (the arrays of Zarr, the
    # last frame of Sintel).
    if different == ["frames"] and new["format"] in ("exr", "npz") and not overwrite:
        (start, stop), (first, end) = before["frames"], new["frames"]
        new, different = new | {"frames": [min(start, first), max(stop, end)]}, []
    if different and not overwrite:
        message = f"holds an export with other {', '.join(different)}"
        raise OutputError(message, where=str(out), hint="give --overwrite to replace it, or another --out")
    if before is not None and (different or overwrite):
        size = (before["settings"]["width"], before["settings"]["height"])
        names = tuple(before["channels"])
        old = ExportSpec(before["scene"], size, before["settings"]["fps"], range(*before["frames"]), names, "native")
        FORMATS[before["format"]](out, old).remove()
    write_atomically(path, json.dumps(new, indent=2, ensure_ascii=False) + "\n", parents=True)
    return range(*new["frames"])


def _foreign(file: Path, manifest: Path) -> bool:
    """Whether ``file`` is none that an export writes before its manifest."""
    return file.name != LOCK_FILE and not is_partial_of(manifest, file)


def _read_manifest(path: Path) -> dict[str, Any] | None:
    try:
        values = read_json(path, Manifest)
    except OutputError:
        return None
    return values if values["schema"] == SCHEMA else None


def _different(before: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Names of the entries and settings that differ."""
    out = [key for key in new if key != "settings" and before.get(key) != new[key]]
    settings = before.get("settings", {})
    return out + [key for key, value in new["settings"].items() if settings.get(key) != value]


def _write_cameras(out: Path, views: dict[int, View], spec: ExportSpec) -> None:
    """Write camera.json, which ``evaluate exr: --camera-file`` reads, for every format."""
    text = camera_file_text(views, spec.fps, spec.size)
    write_atomically(out / CAMERA_FILE, text, parents=True)
