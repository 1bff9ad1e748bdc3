"""Scores of methods that sample lights: which history they keep, what their reservoirs share, bias.

docs/reuse-evaluation.md defines every number; ``sample_rays`` traces what they are counted from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.reuse.comparison import interval_over_seeds
from taubench_gl.reuse.quality import history_of, reusable
from taubench_gl.reuse.sample_rays import REASONS, Fact, SampleFrame
from taubench_gl.reuse.scores import FrameTruth
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

COUNTS = ("shadow_rays", "light_samples", "evaluations")
"""Names of the columns of ``SampleFrame.counts``."""

REACH = 2
"""Pixels to each side within which equal samples are duplicates."""

BORN_SHARE = 0.25
"""Share of the light of a pixel from which a born light counts as one that it should find."""


def history_counts(frame: SampleFrame, mask: Array) -> Array:
    """Pixels by REASONS, (R, 4) int64: history kept, kept with a light that no longer reaches the pixel, history
    rejected, rejected with a light that still does.  ``mask`` (h, w): exact reason words."""
    reason, held = frame.reasons(mask), frame.history[..., 0] >= 0
    keep, reaches = frame.history[..., 3] > 0.5, frame.has(Fact.HISTORY_REACHES)
    which = (keep, keep & ~reaches, ~keep, ~keep & reaches)
    return np.stack([np.bincount(reason[held & (reason >= 0) & w], minlength=len(REASONS)) for w in which], axis=1)


def equal_samples(a: Array, b: Array) -> Array:
    """Whether two samples (..., 4) are of one light and of one point or direction; none is equal to no sample."""
    return (a[..., 0] >= 0) & (a[..., :3] == b[..., :3]).all(axis=-1)


def duplicates(kept: Array) -> tuple[int, int]:
    """Pairs of pixels at most REACH apart with equal samples, and all that hold some.  ``kept`` (h, w, 4)."""
    equal = pairs = 0
    for dy in range(REACH + 1):
        for dx in range(-REACH if dy else 1, REACH + 1):
            one, other = shifted(kept, dy, dx)
            equal += int(np.count_nonzero(equal_samples(one, other)))
            pairs += int(np.count_nonzero((one[..., 0] >= 0) & (other[..., 0] >= 0)))
    return equal, pairs


def shifted(image: Array, dy: int, dx: int) -> tuple[Array, Array]:
    """Views of ``image`` (h, w, ...) whose pixels are (dy, dx) apart; dy is not negative."""
    h, w = image.shape[:2]
    left, right = max(-dx, 0), w - max(dx, 0)
    return image[: h - dy, left:right], image[dy:, left + dx : right + dx]


def sign_test(positive: int, negative: int) -> float:
    """Two-sided p-value of as uneven a split of fair signs."""
    n, k = positive + negative, min(positive, negative)
    return min(1.0, 2.0 * sum(math.comb(n, i) for i in range(k + 1)) / 2.0**n)


@dataclass(slots=True)
class _Correlation:
    """Correlation of errors, whose mean is taken to be 0: sums of products."""

    products: float = 0.0
    squares: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def add(self, one: Array, other: Array, where: Array) -> None:
        one, other = one[where], other[where]
        self.products += float(one @ other)
        self.squares = [s + float(e @ e) for s, e in zip(self.squares, (one, other), strict=True)]

    @property
    def value(self) -> float | None:
        size = math.sqrt(self.squares[0] * self.squares[1])
        return self.products / size if size > 0 else None


@dataclass(slots=True)
class _Search:
    """Which pixels still look for a born light that gives most of their light.  (h, w); light -1: none."""

    light: Array
    frames: Array

    def moved(self, motion_px: Array, allowed: Array) -> _Search:
        """The search of the next frame, along ``motion_px`` (h, w, 2) and one frame later; ``allowed`` (h, w): pixels
        that have a history.
        """
        light, frames = history_of(self.light, motion_px), history_of(self.frames, motion_px)
        return _Search(np.where(allowed, light, -1), frames + 1)


@dataclass(slots=True)
class SampleRecord:
    """Scores of one method, frame by frame, seed by seed.  ``warmup``: as of ``MethodRecord``."""

    warmup: int
    exposure: float
    history: Array = field(default_factory=lambda: np.zeros((len(REASONS), 4), dtype=np.int64))
    _duplicates: Array = field(default_factory=lambda: np.zeros(2, dtype=np.int64))
    _repeated: Array = field(default_factory=lambda: np.zeros(2, dtype=np.int64))
    _counts: list[Array] = field(default_factory=list)
    _pixels: _Correlation = field(default_factory=_Correlation)
    _frames: _Correlation = field(default_factory=_Correlation)
    _found: list[int] = field(default_factory=list)  # frames after the birth, of the pixels that found it
    _born: int = 0
    _bias: list[list[float]] = field(default_factory=list)  # by seed and frame, mean error of luminance
    _reference: list[float] = field(default_factory=list)  # mean luminance of the reference, by frame
    _before: tuple[Array, Array] | None = None  # error of the frame before, and where it counts
    _search: _Search | None = None
    _index: int = 0

    def begin(self) -> None:
        """The next frame is the first of the sequence of another seed."""
        self._index, self._before, self._search = 0, None, None
        self._bias.append([])

    def add(self, frame: SampleFrame, result: Array, reference: FrameTruth) -> None:
        """Score one frame.  ``result`` (h, w, 3 or more): radiance, exposure applied."""
        counted, allowed = self._index >= self.warmup, reusable(reference.mask)
        valid = reference.image.valid & np.isfinite(result[..., :3]).all(axis=-1) & reference.scored
        shown, expected = (
            np.where(valid, image[..., :3].astype(np.float64) @ LUMINANCE, 0.0)
            for image in (np.nan_to_num(result), reference.image.radiance)
        )
        error = shown - expected
        self._look(frame, expected, reference.motion_px, allowed)
        if counted:
            self._reservoirs(frame, reference.mask)
            self._errors(error, valid, reference.motion_px, allowed)
            self._bias[-1].append(float(error[valid].mean()) if valid.any() else 0.0)
            if len(self._bias) == 1:
                self._reference.append(float(expected[valid].mean()) if valid.any() else 0.0)
        self._before, self._index = (error, valid), self._index + 1

    def _look(self, frame: SampleFrame, expected: Array, motion_px: Array, allowed: Array) -> None:
        """Count the frames after which the reservoir of a pixel holds the light that was born for it."""
        looking = None if self._search is None else self._search.moved(motion_px, allowed)
        born = (frame.born >= 0) & (frame.born_light * self.exposure > BORN_SHARE * expected)
        if looking is None:
            looking = _Search(np.full(born.shape, -1), np.zeros(born.shape, dtype=np.int64))
        looking = _Search(np.where(born, frame.born, looking.light), np.where(born, 0, looking.frames))
        self._born += int(np.count_nonzero(born))
        found = (looking.light >= 0) & (frame.kept[..., 0] == looking.light)
        self._found += looking.frames[found].tolist()
        self._search = _Search(np.where(found, -1, looking.light), looking.frames)

    def _reservoirs(self, frame: SampleFrame, mask: Array) -> None:
        self.history += history_counts(frame, mask)
        self._duplicates += duplicates(frame.kept)
        kept = (frame.history[..., 0] >= 0) & (frame.kept[..., 0] >= 0)
        self._repeated += np.count_nonzero(kept & equal_samples(frame.history, frame.kept)), np.count_nonzero(kept)
        self._counts.append(frame.counts.reshape(-1, len(COUNTS)).mean(axis=0))

    def _errors(self, error: Array, valid: Array, motion_px: Array, allowed: Array) -> None:
        for dy, dx in ((0, 1), (1, 0)):
            self._pixels.add(*shifted(error, dy, dx), np.logical_and(*shifted(valid, dy, dx)))
        if self._before is not None:
            before, was_valid = (history_of(image, motion_px) for image in self._before)
            self._frames.add(error, before, valid & was_valid & allowed)

    def summary(self) -> dict[str, Any]:
        """The block ``samples`` of a method in reuse.json; None: not measured."""
        rows = dict(zip(REASONS, self.history, strict=True)) | {"all": self.history.sum(axis=0)}
        return {
            "per_pixel": dict(zip(COUNTS, np.mean(self._counts, axis=0).tolist(), strict=True))
            if self._counts
            else None,
            "history": {name: _shares(row) for name, row in rows.items()} if self.history.any() else None,
            "duplicates_percent": _percent(*self._duplicates),
            "repeated_percent": _percent(*self._repeated),
            "pixel_correlation": self._pixels.value,
            "frame_correlation": self._frames.value,
            "born": {
                "pixels": self._born,
                "found_percent": _percent(len(self._found), self._born),
                "frames": float(np.mean(self._found)) if self._found else None,
            },
            "bias": self._bias_block(),
        }

    def _bias_block(self) -> dict[str, Any] | None:
        """Mean error of luminance over the counted frames of each seed, and whether it is 0."""
        seeds = np.array([np.mean(values) for values in self._bias if values])
        if not len(seeds):
            return None
        mean, bounds = float(np.mean(self._reference)), interval_over_seeds(seeds)
        positive, negative = int(np.count_nonzero(seeds > 0)), int(np.count_nonzero(seeds < 0))
        return {
            "mean": float(seeds.mean()),
            "percent": 100.0 * float(seeds.mean()) / mean if mean > 0 else None,
            "low": None if bounds is None else bounds.low,
            "high": None if bounds is None else bounds.high,
            "seeds": len(seeds),
            "brighter_seeds": positive,
            "sign_test_p": sign_test(positive, negative),
        }


def _shares(row: Sequence[int]) -> dict[str, Any]:
    kept, wrong_kept, rejected, wrong_rejected = (int(n) for n in row)
    return {
        "kept": kept, "wrong_kept": wrong_kept, "wrong_kept_percent": _percent(wrong_kept, kept),
        "rejected": rejected, "wrong_rejected": wrong_rejected,
        "wrong_rejected_percent": _percent(wrong_rejected, rejected),
    }  # fmt: skip


def _percent(part: int, whole: int) -> float | None:
    return 100.0 * float(part) / float(whole) if whole else None


# --- images
_OUTCOMES = {
    "right": (0.12, 0.45, 0.2),
    "wrong": (1.0, 0.2, 0.1),
    "rejected": (0.25, 0.25, 0.25),
    "lost": (0.2, 0.5, 1.0),
}


def light_colors(frame: SampleFrame) -> Array:
    """The light that each pixel holds, a color for each number, black: none; dark where it does not reach the pixel.

    (h, w, 3) in [0, 1].
    """
    light = frame.kept[..., 0]
    hue = np.modf(0.618034 * np.maximum(light, 0))[0]  # golden ratio: neighboring numbers differ most
    color = np.clip(np.abs(6.0 * hue[..., None] - np.array([3.0, 2.0, 4.0])) * [1, -1, -1] + [-1, 2, 2], 0.0, 1.0)
    level = np.where(light >= 0, np.where(frame.has(Fact.KEPT_REACHES), 1.0, 0.35), 0.0)
    return level[..., None] * (0.25 + 0.75 * color)


def outcome_colors(frame: SampleFrame) -> Array:
    """History: green: rightly kept, red: wrongly kept, gray: rightly rejected, blue: wrongly rejected, black: none."""
    held, keep = frame.history[..., 0] >= 0, frame.history[..., 3] > 0.5
    reaches, out = frame.has(Fact.HISTORY_REACHES), np.zeros((*held.shape, 3))
    for name, which in (("right", keep & reaches), ("wrong", keep & ~reaches), ("rejected", ~keep & ~reaches),
                        ("lost", ~keep & reaches)):  # fmt: skip
        out[held & which] = _OUTCOMES[name]
    return out
