"""Every pixel of every pair decided under path-traced light: ``--light path-traced`` without a number of samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from taubench_gl.conventions import HISTOGRAM_BINS, NOT_COMPARABLE
from taubench_gl.evaluation.decided_pixels import (
    DecidedPixels,
    Decisions,
    PreviewPair,
    other_evaluator,
    read_preview,
)
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.pairs import Pair
from taubench_gl.features import FEATURE_BIT, FEATURES, MASK_WORDS, RADIANCE_FEATURES
from taubench_gl.frame.sources import RasterSource
from taubench_gl.metrics.counts import Counts, bin_of
from taubench_gl.metrics.masks import PixelDistances
from taubench_gl.metrics.path_samples import LIMIT
from taubench_gl.metrics.sampled_light import lobe_distance, sampled_columns
from taubench_gl.run_schema import DECIDED_COLUMNS
from taubench_gl.settings import Settings

Array = np.ndarray

SEED = 21
"""Seed of audits and of the order in which pixels are decided, beside the seed of the settings."""

LISTED = 1024
"""Number of pixels that are decided together."""


class DecidedLight:
    """Replaces mask, counts and distances of a pair by those of path-traced light."""

    columns, distances = DECIDED_COLUMNS, True

    def __init__(
        self, owner: GpuOwner, variant: Callable[..., RasterSource], source: RasterSource, settings: Settings,
        lobes: Sequence[str] = (),
    ):  # fmt: skip
        """``owner``: of what is opened; ``variant``: opens a source of the scene (``Session.variant``); ``source``,
        ``settings``: of the pairs, with one kind of history; ``lobes``: of ``measured_lobes``."""
        self._settings, self._lobes = settings, tuple(lobes)
        self._columns = sampled_columns(source.unmeasured, self._settings.metrics.columns)
        self._other = other_evaluator(owner, source, settings)
        self._pixels = DecidedPixels(variant, self._settings, self._columns, self._lobes)

    def fill_row(self, pair: Pair) -> None:
        """Decide the pixels of ``pair``, whose evaluator writes distances; adds DECIDED_COLUMNS to its row."""
        preview = read_preview(pair.source, pair.evaluator, pair.frame, self._columns)
        seed = (SEED, self._settings.lighting.seed, pair.frame)
        self._pixels.draw(preview)
        lists, found = self._decide(preview, preview.traced, seed)

        def image(before: Array, values: Callable[[Decisions], Array]) -> Array:
            out = before.copy()
            for pixels, decisions in zip(lists, found, strict=True):
                out[pixels[:, 1], pixels[:, 0]] = values(decisions)
            return out

        words, none = image(preview.words, lambda d: d.end.words), np.zeros(preview.words.shape, np.float32)
        measured = {
            name: image(of, lambda d, name=name: d.end.distances[name]) for name, of in preview.distances.items()
        }
        luminance = image(pair.distances.luminance, lambda d: d.luminance)
        distances = PixelDistances({**pair.distances.features, **measured}, pair.distances.depth, luminance)
        radiance = [column for column in self._columns if column in RADIANCE_FEATURES]
        for lobe in self._lobes:
            names = {bounce: lobe_distance(bounce, lobe) for bounce in radiance}
            of_lobe = {b: image(none, lambda d, name=name: d.end.distances[name]) for b, name in names.items()}
            pair.evaluated.lobes[lobe] = _histogram(self._with_bits(words, of_lobe))
        counts = counts_of_images(words, measured, pair.evaluated.counts.histograms)
        if self._other is not None:
            counts = replace(counts, other=self._other_histogram(pair, preview, words, seed))
        pair.replace(words, distances, counts)
        pair.row.update(decided_counts(found))

    def _decide(self, preview: PreviewPair, where: Array, seed: tuple[int, ...]) -> tuple[list[Array], list[Decisions]]:
        """The pixels ``where`` (h, w) bool, in lists (n, 2) of column and row from the top, and their decisions."""
        # A list is a random part of the picture, so that its floor of errors is that of the pair.
        at = np.random.default_rng(seed).permutation(np.argwhere(where)[:, ::-1])
        lists = [at[first : first + LISTED] for first in range(0, len(at), LISTED)]
        audits = [np.random.default_rng([*seed, number]).random(len(pixels)) for number, pixels in enumerate(lists)]
        decide = self._pixels.decide
        return lists, [decide(at, LIMIT, audit, pair=preview) for at, audit in zip(lists, audits, strict=True)]

    def _other_histogram(self, pair: Pair, preview: PreviewPair, words: Array, seed: tuple[int, ...]) -> Array:
        """Pixels per word (MASK_WORDS,) under the other reprojection; ``words`` (h, w): decided ones of this one."""
        self._other.submit(pair.evaluator.submitted)
        other = read_preview(pair.source, self._other, pair.frame, self._columns)
        differs = preview.differs(other)
        words = np.where(differs, other.words, words)
        for at, decisions in zip(*self._decide(other, differs & other.traced, seed), strict=True):
            words[at[:, 1], at[:, 0]] = decisions.end.words
        return _histogram(words)

    def _with_bits(self, words: Array, distances: Mapping[str, Array]) -> Array:
        """``words`` (h, w) with the bits of the columns that have ``distances``."""
        comparable = (words & NOT_COMPARABLE) == 0
        for name, distance in distances.items():
            bit = np.uint32(FEATURE_BIT[name])
            over = comparable & (distance > self._settings.metrics.threshold(name))
            words = (words & ~bit) | np.where(over, bit, np.uint32(0))
        return words


def counts_of_images(words: Array, distances: Mapping[str, Array], histograms: Array | None = None) -> Counts:
    """Counts of mask words and distances by feature, (h, w) each.

    ``histograms``: of the features that have no distances; None: zeros.
    """
    if histograms is None:
        histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS))
    histograms, comparable = histograms.astype(np.int64), (words & NOT_COMPARABLE) == 0
    for name, distance in distances.items():
        histograms[FEATURES.index(name)] = np.bincount(bin_of(distance[comparable]), minlength=HISTOGRAM_BINS)
        histograms[FEATURES.index(name), 0] = 0  # as the mask pass
    return Counts(_histogram(words), histograms)


def _histogram(words: Array) -> Array:
    """Pixels per mask word of ``words`` (h, w).  (MASK_WORDS,) int64."""
    return np.bincount(words.ravel(), minlength=MASK_WORDS)


def decided_counts(found: Sequence[Decisions]) -> dict[str, int]:
    """The values of DECIDED_COLUMNS for a pair whose lists of pixels have the decisions ``found``."""
    audited = [d.audited > 0.0 for d in found]
    wrong = [a & (d.first.words != d.end.words) for a, d in zip(audited, found, strict=True)]
    samples = 2 * sum(int(d.samples.sum()) for d in found)
    counted = ([d.samples >= 0 for d in found], [d.undecided for d in found], audited, wrong)
    return dict(zip(DECIDED_COLUMNS, (*(sum(int(x.sum()) for x in each) for each in counted), samples), strict=True))
