"""What one setting gets wrong: columns, per-pixel features and curves, measured once beside the reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import COLUMNS, FEATURES
from taubench_gl.cost.plan import Setting
from taubench_gl.evaluation import Pair, evaluate_scene
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.frame.passes.masks import Counts
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.counts import percent
from taubench_gl.metrics.feature_errors import FeatureErrors
from taubench_gl.metrics.masks import PairMasks, pair_masks
from taubench_gl.run import Run
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray
Channels = dict[str, Array]

FEATURE_PAIRS = 3
"""Pairs, from the middle of the sequence, whose pixels are compared one by one."""

KEPT = ("position", "normal", "direct", "indirect", "color")


def measure_errors(gpu: Gpu, scene: Scene, camera: CameraTrack, setting: Setting) -> dict[str, Any]:
    """One full run of ``setting``: per column the mean and every pair's percentage; curves; bytes allocated."""
    if setting.twin:
        return _twin_run(gpu, scene, camera, setting.settings)
    run = evaluate_scene(scene, setting.settings, camera=camera)
    return from_run(run)


def from_run(run: Run) -> dict[str, Any]:
    """The same block out of a finished run."""
    sampling = (run.summary.get("sampling") or {}).get("columns", {})
    columns: dict[str, Any] = {}
    for column in COLUMNS:
        entry = run.summary["discard"][column]
        columns[column] = {"percent": entry["mean_percent"]}
        if entry["mean_percent"] is None:
            columns[column]["reason"] = entry.get("reason", "not measured")
            continue
        columns[column]["pairs"] = {str(row["frame"]): round(percent(row, column), 9) for row in run.frames}
        if column in sampling:
            columns[column]["half_width"] = sampling[column]["half_width_points"]
    return {
        "columns": columns,
        "curves": _short_curves(run.summary.get("curves") or {}),
        "bytes": (run.summary.get("memory") or {}).get("gpu_bytes"),
        "settings": run.summary["settings"],
    }


def _twin_run(gpu: Gpu, scene: Scene, camera: CameraTrack, settings: Settings) -> dict[str, Any]:
    """Channels as the GPU drew them (float32), masks and counts by the float64 twin on the CPU."""
    from taubench_gl.evaluation import frame_range

    columns: dict[str, Any] = {}
    with gpu:
        twin = Twin(gpu, scene, camera, settings)
        try:
            rows = []
            for frame in frame_range(scene, camera, settings):
                counts = twin.step(frame)
                if counts is not None:
                    rows.append((frame, counts))
            bytes_ = twin.source.describe()["memory"]["gpu_bytes"]
            discard = twin.stats.discard(np.zeros(twin.stats.pairs, dtype=bool))
        finally:
            twin.release()
    for column in COLUMNS:
        columns[column] = {"percent": discard[column]["mean_percent"]}
        if column in twin.source.unmeasured:
            columns[column]["reason"] = twin.source.unmeasured[column]
        else:
            columns[column]["pairs"] = {str(f): round(percent(c, column), 9) for f, c in rows}
    return {"columns": columns, "curves": _short_curves(twin.stats.curves()), "bytes": bytes_, "settings": None}


class Twin:
    """Draws frames and judges each against the last one in NumPy float64."""

    def __init__(self, gpu: Gpu, scene: Scene, camera: CameraTrack, settings: Settings, **more: Any):
        self.settings = settings
        self.source = RasterSource(gpu, scene, camera, settings, poser=Poser(scene), **more)
        measured = tuple(c for c in COLUMNS if c not in self.source.unmeasured)
        self.stats = SequenceStats(measured, dict(self.source.unmeasured))
        self._thresholds = {f: settings.metrics.threshold(f) for f in FEATURES}
        self._last: tuple[Any, Channels] | None = None

    def step(self, frame: int) -> dict[str, Any] | None:
        """Draw ``frame``; the counts of its pair, None for the first."""
        view = self.source.advance(frame)
        names = ["position", "normal", *self.source.radiance]
        names += ["prev_position"] if self.source.reprojection == "motion" else []
        names += ["ids"] if self.source.cuts else []
        now = {name: self.source.read(name) for name in names}
        before, self._last = self._last, (view, now)
        if before is None:
            return None
        found = pair_masks(
            now,
            before[1],
            reprojection(view, before[0], *self.source.size),
            self._thresholds,
            sampling=self.settings.metrics.sampling,
            reprojection=self.source.reprojection,
            exposure=self.settings.lighting.exposure,
        )
        return self.stats.add(Counts(found.mask_histogram(), self._histograms(found)))

    def _histograms(self, found: PairMasks) -> Array:
        none = np.zeros_like(found.histogram("position"))
        histograms = [found.histogram(f) if f in found.distances else none for f in FEATURES]
        return np.array([[0, *h[1:]] for h in histograms])  # the sums keep bin 0 as what remains

    def forget(self) -> None:
        """The next frame has no history."""
        self._last = None

    def release(self) -> None:
        self.source.release()


def _short_curves(curves: Mapping[str, Any]) -> dict[str, Any]:
    return {f: {"counts": c["counts"], "comparable": c["comparable"]} for f, c in curves.items()}


def feature_frames(frames: range, pairs: int = FEATURE_PAIRS) -> tuple[int, int]:
    """Frames A .. B-1 whose pixels are compared: ``pairs`` pairs from the middle, or all there are."""
    count = min(pairs + 1, len(frames))
    start = frames.start + (len(frames) - count) // 2
    return start, start + count


def channels_of(scene: Scene, camera: CameraTrack, settings: Settings, frames: tuple[int, int]) -> dict[int, Channels]:
    """Pixel-centre channels of the later frame of every pair of ``frames``: frame -> arrays as ``Source.read`` gives.

    Sub-pixel samples and left-out pairs do not change what a pixel centre shows, so they are set aside.
    """
    plain = settings.replace(frames=frames, pairs="all", samples_per_pixel=1)
    kept: dict[int, Channels] = {}

    def keep(pair: Pair) -> None:
        arrays = {name: pair.source.read(name) for name in KEPT if name in pair.source.channels}
        arrays |= {"motion": pair.motion(), "camera_position": pair.view.position}
        kept[pair.frame] = arrays

    evaluate_scene(scene, plain, camera=camera, on_pair=keep)
    return kept


def compare_features(found: Mapping[int, Channels], reference: Mapping[int, Channels], settings: Settings) -> Any:
    """Distribution of every feature's error over the common frames (``metrics.feature_errors``).

    Of ``settings`` the position threshold says which places are one, and the unit scale what a metre is.

    A picture of another size is read at the pixel that each pixel centre of the reference falls into; its motion is
    brought to the reference's pixels.
    """
    scale = settings.metrics.unit_scale
    errors = FeatureErrors(settings.metrics.thresholds["position"], scale)
    for frame in sorted(found.keys() & reference.keys()):
        errors.add(_resized(found[frame], reference[frame]["position"].shape[:2]), reference[frame])
    return errors.summary()


def _resized(arrays: Channels, shape: Sequence[int]) -> Channels:
    h, w = arrays["position"].shape[:2]
    if (h, w) == tuple(shape):
        return arrays
    rows, columns = nearest_pixels((h, w), shape)
    out = {n: a if a.ndim == 1 else a[rows[:, None], columns] for n, a in arrays.items()}
    out["motion"] = out["motion"] * np.float32([shape[1] / w, shape[0] / h])
    return out


def nearest_pixels(shape: Sequence[int], wanted: Sequence[int]) -> tuple[Array, Array]:
    """Row and column of a picture of ``shape`` that each pixel centre of one of shape ``wanted`` falls into."""
    found = (np.minimum(((np.arange(n) + 0.5) * m / n).astype(int), m - 1) for m, n in zip(shape, wanted))
    rows, columns = found
    return rows, columns
