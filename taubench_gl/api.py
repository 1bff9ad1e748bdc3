"""``taubench_gl.evaluate``, an evaluation with its images, tables and plots, and ``taubench_gl.pairs``."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.channels import CHANNELS
from taubench_gl.conventions import Reason
from taubench_gl.errors import SettingsError, choice_hint
from taubench_gl.evaluation import Observers, Pair, Readback, Session, evaluate_scene, plan_scene
from taubench_gl.features import COLUMNS, FEATURE_BIT, FEATURES, TABLE, WORD_DTYPE
from taubench_gl.fields import declared
from taubench_gl.option_groups import PathTracedOptions, TrainingOptions
from taubench_gl.outputs import cannot_write, folder_in, write_arrays
from taubench_gl.pathtraced.blender.cache import converted, is_convertible
from taubench_gl.pathtraced.evaluation import choose_plan, evaluate_path_traced
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.report import save_mask_image, write_report
from taubench_gl.report.page import REPORT_FILE
from taubench_gl.report.run_frames import FrameRecorder, PlaneRecorder
from taubench_gl.report.run_page import ReportRun, write_html_report
from taubench_gl.run import FRAMES_FILE, Progress, Run, not_reusable
from taubench_gl.scene.model import Scene
from taubench_gl.settings import KEYS, Settings, unknown_setting

SAVES = ("masks", "channels")
FULL = "full"
"""Kind of report with the distances of every pixel."""
SAVED_CHANNELS = ("position", "normal", "geometric_normal", "base_color", "material", "emission", "ids")
_GEOMETRY_REASONS = (Reason.BEHIND, Reason.OUTSIDE, Reason.DISOCCLUDED, Reason.OCCLUDING)
_PATH_TRACED = declared(PathTracedOptions)
_OWN_SIZE = ("size", "width", "height", "camera")
"""Options without effect on path-traced files, which have their own."""


def evaluate(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path | None = None,
    save: str | Collection[str] = (),
    report: bool | str = False,
    progress: Callable[[Progress], None] | None = None,
    on_pair: Callable[[Pair], None] | None = None,
    **options: Any,
) -> Run:
    """Evaluate the frame pairs of ``scene`` (a Scene, the path of a scene file, or ``exr:DIR``) and return the Run.

    A file that only Blender reads (.blend, .fbx, .usd, .abc ...) is converted once and kept in the cache.

    ``options``: fields of ``Settings`` as ``Settings(...)`` takes them, and for path-traced files the fields of
    ``PathTracedOptions`` (``camera_file``, ``scene_file``, ``mapping``, ``layer``, ``view``, ``second_seed``,
    ``lobes``).  ``lobes`` (of ``taubench_gl.lobes.LOBES``) measures direct and indirect of these lobes apart.
    ``out``: the folder for summary.json, frames.csv, tables, plots and the mask image of the worst frame.  ``save``
    adds, per pair, ``masks`` (images, and arrays in .npz) and ``channels`` (arrays in .npz).  ``report`` adds
    report.html, one self-contained page, and the folder ``images`` with the images on it; ``report="full"`` stores the
    distances of every pixel too, so that the page redraws the masks at other thresholds.  ``progress`` and
    ``on_pair`` are called once per pair; the images of a ``Pair`` are on the GPU until ``on_pair`` returns.

    Raises TaubenchError; for a name that does not exist with the nearest one.

    >>> run = evaluate("scene.glb", size="640x360", frames=range(0, 24))  # doctest: +SKIP
    """
    _require_callable(progress=progress, on_pair=on_pair)
    if not isinstance(report, bool) and report != FULL:
        raise SettingsError(f"report is {report!r:.60}", hint=f"give True, False or {FULL!r}")
    arguments = ("settings", "out", "save", "report", "progress", "on_pair")
    settings, path_traced = _settings_of(scene, settings, options, arguments)
    saved = _saves(save)
    folder = _folder(out)
    if folder is None and (saved or report):
        raise SettingsError("save and report need an output folder", hint="give out")
    recorder = _recorder(folder, report, settings) if folder is not None and report else None
    saver = None if folder is None else _Saver(folder, saved, recorder, on_pair)
    observers = Observers(
        progress,
        saver or on_pair,
        SAVED_CHANNELS if "channels" in saved else (),
        distances=report == FULL,
        on_finish=None if saver is None else lambda run: _write_views(run, saver, bool(report)),
    )
    if is_sequence(scene):
        return evaluate_path_traced(scene, settings, path_traced, observers, out=folder)
    return evaluate_scene(
        _readable(scene, settings), settings, observers, out=folder, lobes=path_traced.lobes, sampled=True
    )


def _recorder(folder: Path, report: bool | str, settings: Settings) -> FrameRecorder:
    """The recorder of the report's images; with ``report`` FULL also of distances.  Raises SettingsError."""
    if report != FULL:
        return FrameRecorder(folder)
    if settings.metrics.samples_per_pixel > 1:
        what = "a full report holds one distance per pixel"
        raise SettingsError(
            what, hint="leave samples_per_pixel out, or make a plain report", setting="samples_per_pixel"
        )
    thresholds = {feature: settings.metrics.threshold(feature) for feature in FEATURES}
    return FrameRecorder(folder, PlaneRecorder(thresholds, {"position": settings.metrics.unit_scale}))


def _write_views(run: Run, saver: _Saver, report: bool) -> list[Path]:
    """Write images, tables, plots and the page of a run, before its summary.json; returns all files but the rows."""
    saver.finish(run)
    written = [*saver.written, *write_report(run.summary, run.frames, run.out)]
    if report:
        written.append(write_html_report([ReportRun(run.summary, run.frames, run.out)], run.out / REPORT_FILE))
    return written


def pairs(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    channels: Collection[str] = (),
    input: str | None = None,
    reference: str | None = None,
    **options: Any,
) -> Iterator[Pair]:
    """The frame pairs of ``scene``, one after another, with their masks, motion and color as arrays.

    ``options``: as for ``evaluate``.  ``channels``: to draw for ``Pair.read`` besides those the columns need, such as
    ``base_color``.  ``input``, ``reference``: words of ``reuse evaluate``, such as ``path-traced@1`` and
    ``path-traced@64``: every pair also has ``noisy`` and ``reference``, what reuse methods get and what they are
    compared with, bit for bit.  The GPU is released when the loop ends or is left.  Raises TaubenchError.

    >>> for pair in pairs("scene.glb", size="640x360", columns="position,normal"):  # doctest: +SKIP
    ...     print(pair.frame, pair.mask.shape, pair.explain(320, 180))
    """
    arguments = ("settings", "channels", "input", "reference")
    settings, path_traced = _settings_of(scene, settings, options, arguments)
    light, drawn = TrainingOptions(input=input, reference=reference), _channels(channels)
    if light.wanted:
        if is_sequence(scene):
            raise SettingsError("input and reference are for scenes", where=str(scene), hint="leave them out")
        from taubench_gl.reuse.light_pairs import input_kind  # imported late, as below: 0.6 s

        input_kind(light, settings.lighting.seed)  # refuses what there is not before anything is drawn
        drawn = tuple(dict.fromkeys((*drawn, "emission")))
    if not is_sequence(scene):
        scene = _readable(scene, settings)
        settings = settings.replace(pairs="all") if settings.metrics.all_pairs else settings
    plan = choose_plan(scene, settings, path_traced)
    return _pairs(partial(Session, plan, Readback(images=True, channels=drawn)), light)


def _readable(scene: Scene | str | Path, settings: Settings) -> Scene | str | Path:
    """A scene that can be read: ``scene`` itself, or the cached conversion of a file that only Blender reads."""
    readable = isinstance(scene, Scene) or not is_convertible(scene)
    return scene if readable else converted(scene, settings.sequence.animation)


def _pairs(open_session: Callable[[], Session], light: TrainingOptions) -> Iterator[Pair]:
    with open_session() as session:
        complete = _light_of(session, light) if light.wanted else Pair.load
        for pair in session.pairs():
            yield complete(pair)


def _light_of(session: Session, light: TrainingOptions) -> Callable[[Pair], Pair]:
    """A function that reads the images and the light of a pair of ``session``, and returns the pair."""
    from taubench_gl.reuse.derived import ComposePass
    from taubench_gl.reuse.frame import read_result
    from taubench_gl.reuse.light_pairs import LightPairs

    animated = session.plan.animated
    # Images need their exposure whatever the columns.
    lit_settings = plan_scene(animated.scene, session.settings.replace(columns=COLUMNS), animated.camera).settings
    with session.gpu:
        lit = session.own(LightPairs(session.gpu, animated, lit_settings, light))
        whole = {"direct", "indirect"} <= set(session.source.radiance)
        compose = ComposePass(session, session.source, lit_settings) if whole else None

    def complete(pair: Pair) -> Pair:
        pair.load()
        with session.gpu:
            if compose is not None:
                compose.run(pair.frame)
                pair.radiance = read_result(compose.textures["radiance"])[..., :3]
            pair.noisy = next((image.radiance for image in lit.images(pair.frame)), None)
            clean = lit.clean(pair.frame)
            pair.reference = None if clean is None else clean[..., :3]
        return pair

    return complete


def _settings_of(
    scene: Any, settings: Settings | None, options: Mapping[str, Any], arguments: tuple[str, ...]
) -> tuple[Settings, PathTracedOptions]:
    """Settings and path-traced options from ``options``, keywords of a function with the arguments ``arguments``."""
    if not isinstance(scene, Scene | str | os.PathLike):
        raise SettingsError(f"scene is {scene!r:.60}", hint="give a Scene, the path of a file, or exr:DIR")
    if not isinstance(settings, Settings | None):
        raise SettingsError(f"settings is {settings!r:.60}", hint="give Settings(...), or its fields by name")
    options = dict(options)
    for name in options:
        if name not in (*KEYS, *_PATH_TRACED, "path_traced", "sequence", "metrics", "lighting"):
            raise unknown_setting(name, (*arguments, *_PATH_TRACED))
    path_traced = options.pop("path_traced", None)
    if not isinstance(path_traced, PathTracedOptions | None):
        raise SettingsError(f"path_traced is {path_traced!r:.60}", hint="give its fields by name")
    of_files = {name: field.value_of(options.pop(name)) for name, field in _PATH_TRACED.items() if name in options}
    _require_used(scene, of_files | ({} if path_traced is None else {"path_traced": path_traced}), options)
    settings = (settings or Settings()).replace(**options)
    return settings, dataclasses.replace(path_traced or PathTracedOptions(), **of_files)


def _require_used(scene: Any, path_traced: Mapping[str, Any], options: Mapping[str, Any]) -> None:
    """Raises SettingsError for an option that this kind of scene ignores."""
    where = scene.name if isinstance(scene, Scene) else str(scene)
    if not is_sequence(scene):
        for name, value in path_traced.items():
            if value not in (None, (), "") and name != "lobes":
                raise SettingsError(f"{name} is for path-traced files", where=where, hint="give them as exr:DIR")
        return
    for name in _OWN_SIZE:
        if name in options and not (name == "camera" and path_traced.get("scene_file")):
            hint = "leave it out" + ("" if name != "camera" else ", or give scene_file to choose among its cameras")
            raise SettingsError(f"{name} has no effect on path-traced files", where=where, hint=hint, setting=name)


def _require_callable(**values: Any) -> None:
    for name, value in values.items():
        if value is not None and not callable(value):
            raise SettingsError(f"{name} is {value!r:.60}", hint="give a function of one argument")


def _saves(save: Any) -> frozenset[str]:
    """``save`` as a set of SAVES, from text or a collection.  Raises SettingsError."""
    names = [name.strip() for name in save.split(",") if name.strip()] if isinstance(save, str) else save
    if not isinstance(names, list | tuple | set | frozenset):
        raise SettingsError(f"save is {save!r:.60}", hint=f"choose from {', '.join(SAVES)}")
    unknown = sorted(str(name) for name in names if name not in SAVES)
    if unknown:
        raise SettingsError(f"cannot save {', '.join(unknown):.60}", hint=choice_hint(unknown[0], SAVES))
    return frozenset(names)


def _channels(names: Any) -> tuple[str, ...]:
    """Names of channels without duplicates, from text or a collection.  Raises SettingsError."""
    if isinstance(names, str):
        names = [name.strip() for name in names.split(",") if name.strip()]
    if not isinstance(names, list | tuple | set | frozenset):
        raise SettingsError(f"channels is {names!r:.60}", hint="give names of channels")
    for name in names:
        if name not in CHANNELS:
            raise SettingsError(f"no channel is named {name!r:.60}", hint=choice_hint(name, CHANNELS))
    return tuple(dict.fromkeys(names))


def _folder(out: Any) -> Path | None:
    if out is None:
        return None
    if not isinstance(out, str | os.PathLike) or out == "":
        raise SettingsError(f"out is {out!r:.60}", hint="give the path of a folder; '.' is the current one")
    return Path(out)


class _Saver:
    """Writes the outputs of ``save`` pair by pair, and keeps the worst frame so far."""

    def __init__(
        self,
        out: Path,
        save: frozenset[str],
        recorder: FrameRecorder | None = None,
        on_pair: Callable[[Pair], None] | None = None,
    ):
        """``on_pair``: called with each pair once it is saved."""
        self._out, self._save, self._recorder, self._on_pair = out, save, recorder, on_pair
        self._worst: tuple[float, int, np.ndarray, np.ndarray] | None = None
        self._measured: set[str] = set()
        self.written: list[Path] = []

    def __call__(self, pair: Pair) -> None:
        self._measured = {name for name in FEATURE_BIT if pair.row[name] is not None}
        share = not_reusable(pair.row)
        if self._worst is None or share > self._worst[0]:
            self._worst = (share, pair.frame, pair.mask, shaded(pair))
        if self._recorder is not None:
            images = shaded(pair), shaded(pair, previous=True)
            distances = pair.distances if self._recorder.distances else None
            self._recorder.add(pair.frame, share, *images, pair.mask, pair.motion, distances)
        try:
            if "masks" in self._save:
                self._save_masks(pair)
            if "channels" in self._save:
                self._save_channels(pair)
        except OSError as error:
            raise cannot_write(self._out, error) from None
        if self._on_pair is not None:
            self._on_pair(pair)

    def _save_masks(self, pair: Pair) -> None:
        file, mask = folder_in(self._out, "masks") / f"mask_{pair.frame:05d}.npz", pair.mask
        write_arrays(file, {"mask": mask.astype(WORD_DTYPE)})
        title = f"frame {pair.frame}"
        save_mask_image(file.with_suffix(".png"), mask, shaded(pair), self._reasons(), title)
        self.written += [file, file.with_suffix(".png")]

    def _save_channels(self, pair: Pair) -> None:
        file = folder_in(self._out, "channels") / f"channels_{pair.frame:05d}.npz"
        arrays = {name: pair.source.read(name) for name in pair.source.channels}
        arrays |= {"motion": pair.motion, "mask": pair.mask, "camera_position": pair.view.position}
        arrays["world_from_view"] = pair.view.world_from_view
        write_arrays(file, arrays)
        self.written.append(file)

    def _reasons(self) -> tuple[Reason, ...]:
        measured = [f for f in TABLE if f.name in self._measured]
        plain = (f.bit for f in measured if not f.details)
        return (*_GEOMETRY_REASONS, *plain, *(bit for f in measured if f.light for bit in f.details))

    def finish(self, run: Run) -> None:
        """Write the mask image of the worst frame and the index of the report's images.  Raises OutputError."""
        if self._worst is None or run.out is None:
            return
        if self._recorder is not None:
            self.written += self._recorder.finish(run.out / FRAMES_FILE)
        _, frame, mask, base = self._worst
        eye = run.summary["settings"]["history"] == "eye"
        which = f"frame {frame} and the other eye" if eye else f"pair of frames {frame - 1} and {frame}"
        title = f"{run.summary['scene']['name']}: worst frame, {which}"
        save_mask_image(run.out / "mask.png", mask, base, self._reasons(), title)
        self.written.append(run.out / "mask.png")


def shaded(pair: Pair, *, previous: bool = False) -> np.ndarray:
    """Image to draw masks over, (h, w, 3) in [0, 1]: the color channel if there is one, else headlight shading.

    ``previous``: of the previous frame of the pair.
    """
    if "color" in pair.source.channels:
        return pair.source.read("color", previous=previous)[..., :3]
    position = pair.source.read("position", previous=previous)
    normal = pair.source.read("normal", previous=previous)[..., :3]
    ray = position[..., :3]
    length = np.linalg.norm(ray, axis=-1)
    facing = np.abs(np.sum(normal * ray, axis=-1)) / np.where(length > 0, length, 1.0)
    gray = np.where(position[..., 3] > 0, 0.25 + 0.75 * facing, 0.0)
    return np.repeat(gray[..., None], 3, axis=-1)
