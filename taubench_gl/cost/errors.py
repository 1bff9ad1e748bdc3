"""Errors of one configuration against the reference: columns of Table 4, and per-pixel errors of features."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.animation.pairs import reprojection
from taubench_gl.conventions import COLUMNS, FEATURES
from taubench_gl.cost.analysis import ColumnError
from taubench_gl.cost.configurations import Configuration
from taubench_gl.evaluation import Observers, Pair, evaluate_scene
from taubench_gl.frame.counting import SequenceStats
from taubench_gl.frame.passes.masks import Counts
from taubench_gl.metrics.counts import percent
from taubench_gl.metrics.feature_errors import FeatureErrors
from taubench_gl.metrics.masks import pair_masks
from taubench_gl.metrics.pair_sample import PairSample, expected_half_width, sample_pairs
from taubench_gl.run import Run
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings, scheme_of

Array = np.ndarray
Channels = dict[str, Array]
Record = Mapping[str, Any]
"""A record of kind ``error``: per column the mean and every pair's percentage."""

FEATURE_PAIRS = 3
"""Pairs, from the middle of the sequence, whose pixels are compared."""

COMPARED_CHANNELS = ("position", "normal", "direct", "indirect", "color")


def measure_errors(scene: Scene, camera: CameraTrack, configuration: Configuration) -> dict[str, Any]:
    """One full run: per column the mean and every pair's percentage of w * h, and bytes allocated on the GPU."""
    if configuration.on_cpu:
        return _measure_on_cpu(scene, camera, configuration.settings)
    return from_run(evaluate_scene(scene, configuration.settings, camera=camera))


def from_run(run: Run) -> dict[str, Any]:
    """The same block from a finished run."""
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
        "bytes": (run.summary.get("memory") or {}).get("gpu_bytes"),
        "settings": run.summary["settings"],
    }


def _measure_on_cpu(scene: Scene, camera: CameraTrack, settings: Settings) -> dict[str, Any]:
    """Channels in float32 from the GPU, masks and counts by the float64 reference on the CPU."""
    settings = settings.replace(samples_per_pixel=1)
    metrics, poser = settings.metrics, Poser(scene)
    thresholds = {f: metrics.threshold(f) for f in FEATURES}
    counted: dict[str, dict[str, Any]] = {}
    stats: SequenceStats | None = None

    def count(pair: Pair) -> None:
        nonlocal stats
        source = pair.source
        if stats is None:
            measured = tuple(c for c in COLUMNS if c not in source.unmeasured)
            stats = SequenceStats(measured, dict(source.unmeasured))
        names = ["position", "normal", *source.radiance]
        names += ["prev_position"] if source.reprojection == "motion" else []
        names += ["ids"] if source.cuts else []
        now, before = ({n: source.read(n, previous=previous) for n in names} for previous in (False, True))
        before_view = camera.view_at(poser.sample((pair.frame - 1) / settings.sequence.fps))
        masks = pair_masks(
            now,
            before,
            reprojection(pair.view, before_view, *source.size),
            thresholds,
            sampling=metrics.sampling,
            reprojection=source.reprojection,
            exposure=settings.lighting.exposure_factor,
        )
        none = np.zeros_like(masks.histogram("position"))
        histograms = [masks.histogram(f) if f in masks.distances else none for f in FEATURES]
        rest = np.array([[0, *h[1:]] for h in histograms])  # SequenceStats derives bin 0
        counted[str(pair.frame)] = stats.add(Counts(masks.mask_histogram(), rest))

    run = from_run(evaluate_scene(scene, settings, Observers(on_pair=count), camera=camera))
    discard = stats.discard(np.zeros(stats.pairs, dtype=bool))
    for column, entry in run["columns"].items():
        if entry["percent"] is not None:
            entry["percent"] = discard[column]["mean_percent"]
            entry["pairs"] = {f: round(percent(row, column), 9) for f, row in counted.items()}
    return run | {"settings": None}


def column_errors(record: Record, reference: Record, same_pairs: bool) -> dict[str, ColumnError]:
    """The error of every column of ``record``.  ``same_pairs``: both have the same pairs, so compare pair by pair too.

    The half width of a sample is the larger of two: the one from its own pairs, and the one expected of such samples
    from the pairs of the reference.  Otherwise a sample whose pairs happen to be alike would appear exact.
    """
    out = {}
    for column in COLUMNS:
        here, there = record["columns"][column], reference["columns"][column]
        if here["percent"] is None or there["percent"] is None:
            why = here.get("reason") or f"not measured in the reference: {there.get('reason')}"
            out[column] = ColumnError(here["percent"], reason=why)
            continue
        common = here["pairs"].keys() & there["pairs"].keys() if same_pairs else ()
        differences = [abs(here["pairs"][f] - there["pairs"][f]) for f in sorted(common)]
        out[column] = ColumnError(
            here["percent"],
            here["percent"] - there["percent"],
            _half_width(record, here, there, same_pairs),
            math.fsum(differences) / len(differences) if differences else None,
        )
    return out


def _half_width(record: Record, here: Mapping[str, Any], there: Mapping[str, Any], same_pairs: bool) -> float | None:
    own = here.get("half_width")
    if own is None or not same_pairs or "half_width" in there:
        return own  # if the reference is a sample too, nothing is known of the other pairs
    values = np.array([there["pairs"][f] for f in sorted(there["pairs"], key=int)], dtype=np.float64)
    return max(own, expected_half_width(sample_of(record["settings"]["pairs"], len(values)), values))


def sample_of(pairs: str, total: int) -> PairSample:
    """The sample that the setting ``pairs`` takes of ``total`` pairs."""
    return sample_pairs(total, *scheme_of(pairs))


def feature_frames(frames: range, pairs: int = FEATURE_PAIRS) -> tuple[int, int]:
    """Frames A .. B-1 whose pixels are compared: ``pairs`` pairs from the middle, or all there are."""
    count = min(pairs + 1, len(frames))
    start = frames.start + (len(frames) - count) // 2
    return start, start + count


def center_settings(settings: Settings) -> Settings:
    """``settings`` without what does not change a pixel center: sampled pairs, sub-pixel samples."""
    return settings.replace(pairs="all", samples_per_pixel=1)


def render_channels(
    scene: Scene, camera: CameraTrack, settings: Settings, frames: tuple[int, int]
) -> dict[int, Channels]:
    """Channels at pixel centers of the later frame of every pair of ``frames``: frame -> ``pair_channels``."""
    kept: dict[int, Channels] = {}
    evaluate_scene(
        scene,
        center_settings(settings).replace(frames=frames),
        Observers(on_pair=lambda pair: kept.update({pair.frame: pair_channels(pair)})),
        camera=camera,
    )
    return kept


def pair_channels(pair: Pair) -> Channels:
    """Channels that are compared, (h, w, n), ``motion`` (h, w, 2) in pixels and ``camera_position`` (3,)."""
    arrays = {name: pair.source.read(name) for name in COMPARED_CHANNELS if name in pair.source.channels}
    return arrays | {"motion": pair.motion, "camera_position": np.asarray(pair.view.position)}


def compare_features(found: Mapping[int, Channels], reference: Mapping[int, Channels], settings: Settings) -> Any:
    """Distribution of every feature's error over the common frames (``metrics.feature_errors``).

    ``settings`` give the position threshold within which two pixels show the same place, and the unit scale.  Images of
    another size are read at the pixel that contains each pixel center of the reference.
    """
    scale = settings.metrics.unit_scale
    errors = FeatureErrors(settings.metrics.thresholds["position"], scale)
    for frame in sorted(found.keys() & reference.keys()):
        errors.add(_resized(found[frame], reference[frame]["position"].shape[:2]), reference[frame])
    return errors.summary()


def _resized(arrays: Channels, shape: Sequence[int]) -> Channels:
    """``arrays`` at ``shape`` (h, w) by nearest pixels; motion in pixels of that size."""
    h, w = arrays["position"].shape[:2]
    if (h, w) == tuple(shape):
        return arrays
    rows, columns = (
        np.minimum(((np.arange(n) + 0.5) * m / n).astype(int), m - 1) for m, n in zip((h, w), shape, strict=True)
    )
    out = {n: a if a.ndim == 1 else a[rows[:, None], columns] for n, a in arrays.items()}
    out["motion"] = out["motion"] * np.float32([shape[1] / w, shape[0] / h])
    return out
