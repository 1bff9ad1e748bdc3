"""``taubench_gl.evaluate``: an evaluation with its images, tables and plots."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.conventions import FEATURE_BIT, Reason
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.evaluation import Pair, evaluate_scene
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.pathtraced.sequence import is_sequence
from taubench_gl.report import save_mask_image, write_report
from taubench_gl.report.frame_store import FrameRecorder
from taubench_gl.report.page import REPORT_FILE
from taubench_gl.report.run_page import ReportRun, write_html_report
from taubench_gl.run import FRAMES_FILE, Progress, Run, total_discards
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

SAVES = ("masks", "channels")
SAVED_CHANNELS = ("position", "normal", "geometric_normal", "base_color", "material", "emission", "ids")
_GEOMETRY_REASONS = (Reason.BEHIND, Reason.OUTSIDE, Reason.DISOCCLUDED, Reason.OCCLUDING)
_LIGHT_REASONS = {"direct": (Reason.LIT, Reason.SHADOWED)}


def evaluate(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    *,
    out: str | Path | None = None,
    save: Collection[str] = (),
    progress: Callable[[Progress], None] | None = None,
    path_traced: PathTracedOptions | None = None,
    report: bool = False,
    **overrides: Any,
) -> Run:
    """Evaluate the frame pairs of ``scene`` (a Scene, the path of a scene file, or ``exr:DIR``) and return the Run.

    ``overrides`` are fields of ``Settings``, such as ``width=640, height=360, reprojection="motion"``.  ``out`` is the
    folder for summary.json, frames.csv, tables, plots and the mask image of the worst frame.  ``save`` adds, per pair,
    ``masks`` (images, and arrays in .npz) and ``channels`` (arrays in .npz).  ``path_traced`` holds the options of
    path-traced files.  ``report`` adds report.html, one self-contained page, and the folder ``images`` with the images
    on it.  Raises TaubenchError.

    >>> run = evaluate("scene.glb", width=640, height=360)  # doctest: +SKIP
    """
    if "truth" in overrides:
        warnings.warn("evaluate(truth=...) is now evaluate(path_traced=...)", DeprecationWarning, stacklevel=2)
        path_traced = overrides.pop("truth")
    settings = (settings or Settings()).replace(**overrides)
    unknown = set(save) - set(SAVES)
    if unknown:
        raise SettingsError(f"cannot save {', '.join(sorted(unknown))}", hint=f"choose from {', '.join(SAVES)}")
    evaluate_source: Callable[..., Run] = (
        partial(evaluate_path_traced, options=path_traced) if is_sequence(scene) else evaluate_scene
    )
    if out is None:
        if save or report:
            raise SettingsError("save and report need an output folder", hint="give out")
        return evaluate_source(scene, settings, progress=progress)
    saver = _Saver(Path(out), frozenset(save), FrameRecorder(Path(out)) if report else None)
    extra = SAVED_CHANNELS if "channels" in save else ()
    run = evaluate_source(scene, settings, out=out, progress=progress, on_pair=saver, channels=extra)
    saver.finish(run)
    write_report(run.summary, run.frames, Path(out))
    if report:
        write_html_report([ReportRun(run.summary, run.frames, run.out)], Path(out) / REPORT_FILE)
    return run


class _Saver:
    """Writes the outputs of ``save`` pair by pair, and keeps the worst frame so far."""

    def __init__(self, out: Path, save: frozenset[str], recorder: FrameRecorder | None = None):
        self._out, self._save, self._recorder = out, save, recorder
        self._worst: tuple[int, int, np.ndarray, np.ndarray] | None = None
        self._measured: set[str] = set()

    def __call__(self, pair: Pair) -> None:
        self._measured = {name for name in FEATURE_BIT if pair.row[name] is not None}
        discarded = total_discards(pair.row)
        if self._worst is None or discarded > self._worst[0]:
            self._worst = (discarded, pair.frame, pair.mask(), shaded(pair))
        if self._recorder is not None:
            images = shaded(pair), shaded(pair, previous=True)
            self._recorder.add(pair.frame, discarded, *images, pair.mask(), pair.motion())
        try:
            if "masks" in self._save:
                self._save_masks(pair)
            if "channels" in self._save:
                self._save_channels(pair)
        except OSError as error:
            raise OutputError(f"cannot be written: {error.strerror}", where=str(self._out)) from None

    def _save_masks(self, pair: Pair) -> None:
        folder = self._out / "masks"
        folder.mkdir(exist_ok=True)
        mask = pair.mask()
        np.savez_compressed(folder / f"mask_{pair.frame:05d}.npz", mask=mask.astype(np.uint16))
        title = f"frame {pair.frame}"
        save_mask_image(folder / f"mask_{pair.frame:05d}.png", mask, shaded(pair), self._reasons(), title)

    def _save_channels(self, pair: Pair) -> None:
        folder = self._out / "channels"
        folder.mkdir(exist_ok=True)
        arrays = {name: pair.source.read(name) for name in pair.source.channels}
        arrays |= {"motion": pair.motion(), "mask": pair.mask(), "camera_position": pair.view.position}
        arrays["world_from_view"] = pair.view.world_from_view
        np.savez_compressed(folder / f"channels_{pair.frame:05d}.npz", **arrays)

    def _reasons(self) -> tuple[Reason, ...]:
        features = tuple(FEATURE_BIT[n] for n in FEATURE_BIT if n in self._measured and n not in ("position",))
        light = tuple(r for name, reasons in _LIGHT_REASONS.items() if name in self._measured for r in reasons)
        return (*_GEOMETRY_REASONS, *(f for f in features if f is not Reason.DIRECT), *light)

    def finish(self, run: Run) -> None:
        """Write the mask image of the worst frame and the index of the report's images."""
        if self._worst is None or run.out is None:
            return
        if self._recorder is not None:
            self._recorder.finish(run.out / FRAMES_FILE)
        _, frame, mask, base = self._worst
        title = f"{run.summary['scene']['name']}: worst frame, pair of frames {frame - 1} and {frame}"
        save_mask_image(run.out / "mask.png", mask, base, self._reasons(), title)


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
