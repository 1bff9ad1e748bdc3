"""Pairs counted at random pixels: path-traced light in minutes where whole images take weeks.

A pair is counted as ``evaluate_scene`` counts it, over its random pixels instead of all.  Each pair has other pixels:
the rates have the error of two stages, of the pairs that were drawn and of the pixels in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from taubench_gl.conventions import HISTOGRAM_BINS, NOT_COMPARABLE
from taubench_gl.cost.pixels import PairChannels, PixelSample, Subject
from taubench_gl.cost.reference import TracedPixels
from taubench_gl.effects.decide import as_summary, decide, unmeasured
from taubench_gl.evaluation import sampled_pairs
from taubench_gl.features import FEATURES, MASK_WORDS
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK
from taubench_gl.metrics.counts import Counts, bin_of
from taubench_gl.metrics.pair_sample import estimate
from taubench_gl.metrics.sequence_stats import SequenceStats
from taubench_gl.provenance import provenance
from taubench_gl.settings import Settings

Array = np.ndarray

SEED = 20

MOST_PAIRS = 4
"""Pairs that are counted at once: they share the source of the frames."""


def random_pixels(frame: int, count: int, size: tuple[int, int]) -> Array:
    """``count`` pixels, or all of a smaller image, of the pair that ends at ``frame``.  (n, 2): column and row."""
    flat = np.random.default_rng([SEED, frame]).choice(size[0] * size[1], min(count, size[0] * size[1]), replace=False)
    return np.stack([np.sort(flat) % size[0], np.sort(flat) // size[0]], axis=-1)


def count_at_pixels(
    animated: AnimatedScene, settings: Settings, count: int, frames: Sequence[int]
) -> tuple[list[Counts], dict[str, Any]]:
    """Counts of the pairs that end at ``frames``, at ``count`` random pixels each, and the report of their record.

    ``settings``: path-traced, with resolved lighting.
    """
    gpu = open_gpu(settings.device.backend, settings.device.device)
    size = settings.sequence.width, settings.sequence.height
    sample = PixelSample(tuple(frames), tuple(random_pixels(frame, count, size) for frame in frames))
    subject = Subject(gpu, animated.scene, animated.camera, sample)
    channels = PairChannels(subject, settings)
    with TracedPixels(subject, channels, settings, seeds=(None,)) as traced:
        traced.trace(settings.lighting.path_samples)
        compared = list(channels.comparisons(traced.light()))
    effects = decide(animated.scene, settings)
    report = {
        "source": {"effects": as_summary(effects), "notes": [], "memory": {"gpu_bytes": None}},
        "unmeasured": unmeasured(effects, settings),
        "provenance": provenance(gpu, WALL_CLOCK),
        "passes_ms": {},
    }
    return [_counts(words, distances) for words, distances in compared], report


def _counts(words: Array, distances: dict[str, Array]) -> Counts:
    """Of mask words, and of the distances of comparable pixels; sky on sky has distance 0 (``PairMasks.histogram``)."""
    comparable = (words & NOT_COMPARABLE) == 0
    histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS), np.int64)
    for row, feature in zip(histograms, FEATURES, strict=True):
        if feature in distances:
            bins = bin_of(np.nan_to_num(distances[feature][comparable], nan=0.0, posinf=np.inf))
            row += np.bincount(bins, minlength=HISTOGRAM_BINS)
    return Counts(np.bincount(words, minlength=MASK_WORDS), histograms)


def describe_pixels(
    summary: dict[str, Any], stats: SequenceStats, settings: Settings, frames: range, count: int
) -> None:
    """Replace the block ``sampling`` and its note by those of pairs and pixels together."""
    sample = sampled_pairs(frames, settings)
    every = settings.sequence.width * settings.sequence.height
    pixels = min(count, every)
    columns = {}
    for column in stats.measured:
        percent = stats.per_pair(column)
        shares = percent / 100.0
        # Variances of shares that random pixels have, as estimates of those of their images; Cochran Eq. 3.8.
        within = (1.0 - pixels / every) * shares * (1.0 - shares) / max(pixels - 1, 1)
        mean = estimate(sample, percent, within=within * 1e4)
        columns[column] = {"mean_percent": mean.mean, "half_width_points": mean.half_width, "level": mean.level}
    drawn = len(sample.positions)
    summary["sampling"] = {
        "pairs": settings.metrics.pairs, "drawn": drawn, "total": sample.total, "pixels": pixels, "columns": columns,
    }  # fmt: skip
    widths = {name: column["half_width_points"] for name, column in columns.items()}
    text = ", ".join(f"{name} ±{width:.2f}" for name, width in widths.items() if width is not None)
    summary["notes"] = [note for note in summary["notes"] if "95 % intervals" not in note]
    summary["notes"].append(
        f"{pixels} random pixels of each of {drawn} of {sample.total} pairs; 95 % intervals, percentage points: "
        f"{text or 'unknown'}"
    )
