"""Table 4 with path-traced light at random pixels of every pair: minutes where whole images take weeks.

A pair is counted as ``evaluate_scene`` counts it, over its random pixels instead of all.  Each pair has other pixels:
the rates have the error of two stages, of the pairs that were drawn and of the pixels in them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from taubench_gl.animation import Poser
from taubench_gl.batch.spec import Job
from taubench_gl.conventions import HISTOGRAM_BINS, NOT_COMPARABLE
from taubench_gl.cost.pixels import PairChannels, PixelSample, Subject, pack, unpack
from taubench_gl.cost.reference import TracedPixels
from taubench_gl.data_files import read_json
from taubench_gl.effects.decide import as_summary, decide, unmeasured
from taubench_gl.errors import OutputError
from taubench_gl.evaluation import (
    assemble_summary,
    file_hashes,
    files_identity,
    mark_cuts,
    open_scene,
    sampled_pairs,
    scene_facts,
)
from taubench_gl.features import COLUMNS, FEATURES, MASK_WORDS
from taubench_gl.gpu.context import open_gpu
from taubench_gl.gpu.timing import WALL_CLOCK
from taubench_gl.metrics.counts import Counts, bin_of
from taubench_gl.metrics.pair_sample import estimate
from taubench_gl.metrics.sequence_stats import SequenceStats
from taubench_gl.outputs import output_folder, write_atomically
from taubench_gl.provenance import provenance
from taubench_gl.run import Run

Array = np.ndarray

SEED = 20

TOGETHER = 4
"""Pairs that are counted at once: they share the source of the frames, and what is killed loses them."""


class _Pair(msgspec.Struct, frozen=True):
    """File of a counted pair.  ``words``: of ``pack``; ``bins``: by feature [bin, pixels]."""

    scene: str | None  # identity of its files
    words: str
    bins: dict[str, list[tuple[int, int]]]
    seconds: float
    provenance: dict[str, Any]

    @property
    def counts(self) -> Counts:
        histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS), np.int64)
        for row, feature in zip(histograms, FEATURES, strict=True):
            for place, pixels in self.bins.get(feature, []):
                row[place] = pixels
        return Counts(np.bincount(unpack(self.words), minlength=MASK_WORDS), histograms)


def random_pixels(frame: int, count: int, size: tuple[int, int]) -> Array:
    """``count`` pixels, or all of a smaller image, of the pair that ends at ``frame``.  (n, 2): column and row."""
    flat = np.random.default_rng([SEED, frame]).choice(size[0] * size[1], min(count, size[0] * size[1]), replace=False)
    return np.stack([np.sort(flat) % size[0], np.sort(flat) // size[0]], axis=-1)


class PixelRun:
    """The pairs of a job at ``count`` random pixels each; what is counted is kept in ``folder``."""

    def __init__(self, job: Job, count: int, folder: Path):
        """Raises TaubenchError."""
        self._given = open_scene(job.scene, job.settings)
        settings = self._given.settings
        self._count, self._folder = count, output_folder(folder / job.id)
        self._size = settings.sequence.width, settings.sequence.height
        self._identity = files_identity(file_hashes(self._given.scene, settings))
        self._sample = sampled_pairs(self._given.frames, settings)
        self._frames = [self._given.frames[position + 1] for position in self._sample.positions]
        self._pairs = {frame: self._load(frame) for frame in self._frames}

    @property
    def total(self) -> int:
        return len(self._frames)

    @property
    def missing(self) -> list[list[int]]:
        """The later frames of the pairs that are not counted, in parts of at most TOGETHER."""
        left = [frame for frame in self._frames if self._pairs[frame] is None]
        return [left[start : start + TOGETHER] for start in range(0, len(left), TOGETHER)]

    @property
    def seconds(self) -> list[float]:
        """Of each counted pair."""
        return [pair.seconds for pair in self._pairs.values() if pair is not None]

    def count(self, frames: Sequence[int]) -> None:
        """Count the pairs that end at ``frames``, a part of ``missing``, and store them.  Raises TaubenchError."""
        started, settings = time.perf_counter(), self._given.settings
        gpu = open_gpu(settings.device.backend, settings.device.device)
        sample = PixelSample(tuple(frames), tuple(random_pixels(f, self._count, self._size) for f in frames))
        subject = Subject(gpu, self._given.scene, self._given.camera, sample)
        channels = PairChannels(subject, settings)
        with TracedPixels(subject, channels, settings, seeds=(None,)) as traced:
            traced.trace(settings.lighting.path_samples)
            found = list(channels.comparisons(traced.light()))
        seconds, made = (time.perf_counter() - started) / len(frames), provenance(gpu, WALL_CLOCK)
        for frame, (words, distances) in zip(frames, found, strict=True):
            pair = _Pair(self._identity, pack(words), _bins(words, distances), seconds, made)
            write_atomically(self._file(frame), msgspec.json.encode(pair))
            self._pairs[frame] = pair

    def result(self) -> Run:
        """The run, once no pair is missing: its ``sampling`` has the intervals of pairs and pixels together."""
        given, settings = self._given, self._given.settings
        effects = decide(given.scene, settings)
        reasons = unmeasured(effects, settings)
        stats = SequenceStats(tuple(c for c in COLUMNS if c not in reasons), reasons)
        fps = settings.sequence.fps
        rows = [{"frame": f, "time_s": f / fps} | stats.add(self._pairs[f].counts) for f in self._frames]
        poser = Poser(given.scene)
        views = [given.camera.view_at(poser.sample(frame / fps)) for frame in given.frames]
        facts = scene_facts(given.scene, given.camera, given.frames, given.lighting, poser)
        summary = assemble_summary(facts, given.frames, settings, views, stats)
        summary["notes"] = [note for note in summary["notes"] if "95 % intervals" not in note]
        summary |= {"effects": as_summary(effects), "sampling": self._sampling(stats)}
        summary["notes"].append(self._note(summary["sampling"]))
        summary["provenance"] = self._pairs[self._frames[0]].provenance
        mark_cuts(rows, summary)
        return Run(summary, rows)

    def _sampling(self, stats: SequenceStats) -> dict[str, Any]:
        """The block ``sampling``, and the count of pixels."""
        columns = {}
        for column in stats.measured:
            percent = stats.per_pair(column)
            found = estimate(self._sample, percent, within=self._variances(percent / 100.0) * 1e4)
            columns[column] = {"mean_percent": found.mean, "half_width_points": found.half_width, "level": found.level}
        pixels = min(self._count, self._size[0] * self._size[1])
        pairs = self._given.settings.metrics.pairs
        return {"pairs": pairs, "drawn": self.total, "total": self._sample.total, "pixels": pixels, "columns": columns}

    def _variances(self, shares: Array) -> Array:
        """Of shares that random pixels have, as estimates of those of their images; Cochran Eq. 3.8."""
        every = self._size[0] * self._size[1]
        count = min(self._count, every)
        return (1.0 - count / every) * shares * (1.0 - shares) / max(count - 1, 1)

    def _note(self, sampling: dict[str, Any]) -> str:
        widths = {name: one["half_width_points"] for name, one in sampling["columns"].items()}
        text = ", ".join(f"{name} ±{width:.2f}" for name, width in widths.items() if width is not None)
        return (
            f"{sampling['pixels']} random pixels of each of {sampling['drawn']} of {sampling['total']} pairs; 95 % "
            f"intervals, percentage points: {text or 'unknown'}"
        )

    def _file(self, frame: int) -> Path:
        return self._folder / f"{frame}.json"

    def _load(self, frame: int) -> _Pair | None:
        """A stored pair; None if it is missing, damaged, or of files that have changed."""
        try:
            pair = msgspec.convert(read_json(self._file(frame), _Pair), _Pair)
        except OutputError:
            return None
        return pair if pair.scene == self._identity else None


def _bins(words: Array, distances: dict[str, Array]) -> dict[str, list[tuple[int, int]]]:
    """Histograms of the distances of comparable pixels; sky on sky has distance 0 (``PairMasks.histogram``)."""
    comparable = (words & NOT_COMPARABLE) == 0
    out = {}
    for feature, of_pixels in distances.items():
        places = bin_of(np.nan_to_num(of_pixels[comparable], nan=0.0, posinf=np.inf))
        out[feature] = [(int(b), int(n)) for b, n in zip(*np.unique(places, return_counts=True), strict=True)]
    return out
