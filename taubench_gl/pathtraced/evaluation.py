"""Evaluates path-traced files: ``exr:DIR`` -> channels -> the same masks and summary as for a rendered scene."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import asdict

from taubench_gl.animation import View, choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.animation.views import ORBIT
from taubench_gl.effects.lighting import as_rendered
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import LightPlan, Observers
from taubench_gl.evaluation.lobes import LobeColumns
from taubench_gl.evaluation.owner import GpuOwner, opened_gpu
from taubench_gl.evaluation.scene import ScenePlan, plan_scene
from taubench_gl.evaluation.session import ColumnGroup, Readback, Session, run_session
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.lobes import BOUNCES
from taubench_gl.metrics.activity import camera_activity, summarize
from taubench_gl.metrics.sequence_stats import SequenceStats
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.pathtraced.blender.render import RecordedLighting, read_render
from taubench_gl.pathtraced.cameras import CAMERA_FILE, FittedCamera, PathTracedCamera, SceneCamera, SidecarCamera
from taubench_gl.pathtraced.sequence import PathTracedSequence, is_sequence
from taubench_gl.pathtraced.source import PathTracedSource
from taubench_gl.report.labels import GIVEN
from taubench_gl.run import Run
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

CAMERA_COLUMNS = ("translation_m", "yaw_deg", "pitch_deg", "roll_deg", "angle_deg", "gimbal")
NO_SCENE = "path-traced files have no scene statistics"
NOISY_COLUMNS = ("color", "direct", "indirect")


@dataclass(frozen=True, slots=True)
class PathTracedPlan:
    """An opened sequence with its camera."""

    sequence: PathTracedSequence
    camera: PathTracedCamera
    settings: Settings  # with the size of the files, and the frame rate of the sidecar if it has one
    options: PathTracedOptions

    @property
    def name(self) -> str:
        return self.sequence.name

    @property
    def animated(self) -> None:
        """None, because files have no scene."""

    @property
    def light(self) -> LightPlan:
        """The light of the files, of a fixed number of samples."""
        return LightPlan.FIXED

    @property
    def frames(self) -> range:
        """Frame numbers to evaluate.  Raises PathTracedError on gaps."""
        return self.sequence.select(self.settings.sequence.frames)

    def open_source(self, owner: GpuOwner, timer: PassTimer, readback: Readback) -> PathTracedSource:
        return owner.own(PathTracedSource(owner.gpu, self.sequence, self.camera, self.settings, lobes=readback.lobes))

    def missing_lobes(self, source: PathTracedSource, lobes: Collection[str]) -> dict[str, dict[str, str]]:
        named = {lobe: {bounce: f"{lobe}_{bounce}" for bounce in BOUNCES} for lobe in lobes}
        return {
            lobe: {bounce: source.missing[name] for bounce, name in names.items() if name in source.missing}
            for lobe, names in named.items()
        }

    def column_groups(self, session: Session) -> Iterator[ColumnGroup]:
        missing = session.missing_lobes
        if missing:
            yield LobeColumns(session, session.source, self.settings, missing, lambda lobe, bounce: f"{lobe}_{bounce}")

    def static_summary(self, session: Session) -> dict[str, Any]:
        """Blocks of the summary that do not depend on the frames: scene, lighting, camera and notes."""
        return {
            "scene": {
                "name": self.sequence.name,
                "path": str(self.sequence.path),
                "sha256": self.sequence.sha256(),
                "duration_s": (len(self.frames) - 1) / self.settings.sequence.fps,
                "playing": [],
            },
            "census": {"reason": NO_SCENE},
            "lighting": {"light_unit": "as rendered", "exposure": GIVEN, "environment": "as rendered"},
            "camera_source": self.camera.describe(),
            "notes": _notes(session.source, self.camera),
        }

    def views(self, session: Session) -> list[View]:
        return session.drawn

    def add_to_summary(self, summary: dict[str, Any], session: Session) -> None:
        """What the render recorded, and the noise floor of a second seed."""
        if not session.source.geometry:
            summary["scale"] = {"frames": 0, "median_depth_m": None}
            if isinstance(self.camera, FittedCamera):
                self._drop_camera(summary, session)
        record = read_render(self.sequence.folder)
        summary["settings"] |= asdict(RecordedLighting() if record is None else record.lighting)
        summary["path_traced"]["render"] = None if record is None else record.summary(self.frames)
        if self.options.second_seed is not None:
            options = self.options
            chosen = {"mapping": options.mapping, "layer": options.layer, "view": options.view}
            second = PathTracedSequence.open(options.second_seed, **chosen)
            with opened_gpu(session.settings, session) as owner:
                floor = summary["noise_floor"] = noise_floor(owner, self, second)
            summary["notes"].append(_floor_note(floor))

    def _drop_camera(self, summary: dict[str, Any], session: Session) -> None:
        """Null what a stand-in camera gave: files with vectors alone do not say how their camera moved."""
        nothing = camera_activity(np.zeros((1, 3)), np.eye(3)[None])
        summary["camera"] = summarize(nothing, None, self.settings.sequence.fps, self.frames[0])
        summary["camera"]["source"] = "unknown: the files have no positions, and no camera is given"
        for row in session.tally.rows:
            row.update(dict.fromkeys(CAMERA_COLUMNS))


def plan_sequence(spec: str | Path, settings: Settings, options: PathTracedOptions) -> PathTracedPlan:
    """Open ``exr:DIR`` or ``exr:DIR/name*.exr``; no pixel is read.  Raises TaubenchError."""
    sequence = PathTracedSequence.open(spec, mapping=options.mapping, layer=options.layer, view=options.view)
    camera, fps = _choose_camera(options, settings, sequence)
    settings = as_rendered(settings).replace(width=sequence.size[0], height=sequence.size[1], fps=fps)
    return PathTracedPlan(sequence, camera, settings, options)


def choose_plan(
    source: Scene | str | Path, settings: Settings, options: PathTracedOptions
) -> ScenePlan | PathTracedPlan:
    """What a session evaluates of a scene, or of ``exr:DIR`` with ``options``: its camera, frames and lighting.

    Raises TaubenchError.
    """
    if is_sequence(source):
        require_supported(source, settings)
        return plan_sequence(source, settings, options)
    return plan_scene(source, settings)


def _choose_camera(
    options: PathTracedOptions, settings: Settings, files: PathTracedSequence
) -> tuple[PathTracedCamera, float]:
    """The camera and the frame rate.  Files of ``export`` have their camera in their folder."""
    sequence, camera_file, beside = settings.sequence, options.camera_file, files.folder / CAMERA_FILE
    if camera_file is None and options.scene_file is None and files.exported and beside.is_file():
        camera_file = beside
    if camera_file is not None:
        camera = SidecarCamera(camera_file)
        return camera, camera.file.fps or sequence.fps
    if options.scene_file is not None:
        scene = load_scene(options.scene_file, **sequence.reading)
        if not len(scene.camera_nodes) and sequence.camera != ORBIT:
            raise SettingsError("the scene file has no camera", hint="leave it out to have the camera estimated")
        return SceneCamera(scene, choose_camera(scene, sequence.camera, files.size), sequence.fps), sequence.fps
    return FittedCamera(), sequence.fps


def evaluate_path_traced(
    spec: str | Path,
    settings: Settings | None = None,
    options: PathTracedOptions | None = None,
    observers: Observers | None = None,
    *,
    out: str | Path | None = None,
) -> Run:
    """Evaluate the frame pairs of ``exr:DIR`` or ``exr:DIR/name*.exr``.

    The image size is that of the files; the frame rate of a sidecar overrides the settings.  A column without its
    passes is null, and its reason names them.  Raises TaubenchError for every error that a user can cause.
    """
    settings, options = settings or Settings(), options or PathTracedOptions()
    require_supported(spec, settings)
    observers, rendered = observers or Observers(), plan_sequence(spec, settings, options)
    with Session(rendered, Readback.of(observers, options.lobes)) as session:
        return run_session(session, observers, out)


def require_supported(spec: str | Path, settings: Settings) -> None:
    """Raises SettingsError for settings that only rendered scenes can have."""
    for setting, value, only in (
        ("pairs", "all" if settings.metrics.all_pairs else settings.metrics.pairs, "all"),
        ("samples per pixel", settings.metrics.samples_per_pixel, 1),
        ("exact", settings.metrics.exact, False),
        ("history", settings.metrics.history, "frame"),
        ("camera path", settings.sequence.camera_path, None),
    ):
        if value != only:
            hint = "leave it out" if only is None else f"leave it at {only}"
            raise SettingsError(f"{setting} {value} is for rendered scenes", where=str(spec), hint=hint)


def _notes(source: PathTracedSource, camera: PathTracedCamera) -> list[str]:
    estimated = isinstance(camera, FittedCamera) and source.geometry
    notes = [f"the camera is {camera.describe()}"] if estimated else []
    notes += [*source.sequence.index.notes, *source.seen.notes()]
    if source.seen.mismatch_px is None:
        notes.append("the camera was not checked: there is no position pass")
    if isinstance(camera, SceneCamera) and camera.offset:
        notes.append(f"the files count frames from {-camera.offset}: frame {-camera.offset} is the scene's 0 s")
    return notes


def noise_floor(owner: GpuOwner, rendered: PathTracedPlan, second: PathTracedSequence) -> dict[str, Any]:
    """Column of NOISY_COLUMNS -> ``discard`` entry of two renders of one frame that differ only in their seed.

    Camera and surfaces do not move in such a pair, so every discarded pixel is noise; about as many of a real pair's
    discards are noise.  Raises PathTracedError if ``second`` lacks frames or has another size.
    """
    first = rendered.sequence
    second.require(first.size, rendered.frames, of="the first render")
    # Motion reprojection needs two moments; both images show the same one.
    settings = rendered.settings.replace(reprojection="camera", sampling="nearest")
    opened = (PathTracedSource(owner.gpu, sequence, rendered.camera, settings) for sequence in (first, second))
    sources = [owner.own(source) for source in opened]
    unmeasured = {c: why for source in sources for c, why in source.unmeasured.items() if c in NOISY_COLUMNS}
    measured = tuple(c for c in NOISY_COLUMNS if c not in unmeasured)
    stats = SequenceStats(measured, unmeasured)
    evaluator = owner.open_evaluator(sources[0], settings, radiance=measured)
    for frame in rendered.frames:
        view, _ = (source.advance(frame) for source in sources)
        run = evaluator.submit(reprojection(view, view, *first.size), previous=sources[1].current)
        stats.add(evaluator.read(run))
    discard = stats.discard(np.zeros(stats.pairs, dtype=bool))
    return {column: discard[column] for column in NOISY_COLUMNS}


def _floor_note(floor: dict[str, Any]) -> str:
    shares = [f"{c} {e['mean_percent']:.2f} %" for c, e in floor.items() if e["mean_percent"] is not None]
    return f"noise floor, from a render with another seed: {', '.join(shares) or 'nothing to compare'}"
