"""Light columns by path tracing, estimated at random pixels of random pairs: rounds, until the intervals are narrow.

Which pixels a round has is fixed by the settings and the pairs; the rounds end by their intervals or by their samples,
not by a clock.  So results do not depend on speed, on workers or on kills.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.conventions import OTHER_REPROJECTION
from taubench_gl.evaluation.decided_pixels import (
    DecidedPixels,
    Decisions,
    PreviewPair,
    other_evaluator,
    read_preview,
)
from taubench_gl.evaluation.histories import chosen_words, merge_histories, of_all, other_decisions
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.evaluation.schedule import sampled_pairs
from taubench_gl.frame.sources import RasterSource
from taubench_gl.metrics.counts import Counts
from taubench_gl.metrics.pair_sample import PairSample
from taubench_gl.metrics.path_samples import LIMIT
from taubench_gl.metrics.pixel_sample import PixelStrata
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.metrics.reuse_rate import unmeasured_rates
from taubench_gl.metrics.sampled_light import (
    STRATA,
    LightEstimate,
    SampledPixels,
    Visit,
    draw_pixels,
    sampled_columns,
    strata_of,
)
from taubench_gl.run_schema import SAMPLED_COLUMNS
from taubench_gl.settings import Settings

SEED = 20
"""Seed of the choice of pairs, pixels and audits, beside the seed of the settings."""


@dataclass(frozen=True, slots=True)
class RoundSizes:
    """How much light a round and a run trace.  Drawing a pair costs as much as deciding a hundred of its pixels."""

    pairs: int = 8  # that a round visits
    pixels: int = 128  # of a visit
    kept_pairs: int = 32  # that a round visits where previews of all pairs are kept; it has half as many pixels
    limit: int = LIMIT  # most samples of a pixel, in each frame
    samples: int = 1 << 21  # of a run without ``light_time``, after which no round begins: some 20 s of two CPU cores


ROUND_SIZES = RoundSizes()

KEPT_BYTES, PIXEL_BYTES = 576 << 20, 100
"""Memory for previews of pairs that the run has drawn, which visits then need not draw again, and of one pixel."""


def preview_channels(columns: Collection[str]) -> tuple[str, ...]:
    """Channels of the preview that decisions of the light ``columns`` read besides those of its masks."""
    return ("emission",) if "color" in columns else ()


def visit_sizes(settings: Settings, pairs: int) -> tuple[int, int]:
    """Pairs that a round visits of ``pairs`` whose preview is known, and pixels of a visit."""
    sizes, area = ROUND_SIZES, settings.sequence.width * settings.sequence.height
    if pairs <= sizes.pairs or pairs * area * PIXEL_BYTES > KEPT_BYTES:
        return min(sizes.pairs, pairs), sizes.pixels
    visited = min(max(sizes.pairs, sizes.kept_pairs), pairs)
    return visited, max(sizes.pairs * sizes.pixels // (2 * visited), 1)


def round_of(number: int, pairs: int, seed: int, size: int | None = None) -> list[tuple[int, int]]:
    """Pairs that round ``number`` visits, as (row among ``pairs`` pairs, number of the visit of this pair).

    ``size``: how many; None: as of previews that are not kept.
    """
    order = np.random.default_rng([SEED, seed, pairs]).permutation(pairs).tolist()
    size = min(ROUND_SIZES.pairs, pairs) if size is None else size
    every = range(number * size, (number + 1) * size)
    return [(order[k % pairs], k // pairs) for k in every]


class Previews:
    """Previews of pairs that ``source`` draws, and by the other reprojection where that is counted too."""

    def __init__(self, owner: GpuOwner, source: RasterSource, settings: Settings, columns: Sequence[str]):
        """``owner``: frees the evaluators; ``source``: has ``preview_channels``; ``columns``: of light."""
        self._source, self._columns = source, columns
        self._evaluator = owner.open_evaluator(source, settings, timed=False, images=True, distances=True)
        self._other = other_evaluator(owner, source, settings)
        self._kept: dict[int, tuple[PreviewPair, PreviewPair | None]] = {}
        self._room = KEPT_BYTES

    def draw(self, frame: int) -> tuple[PreviewPair, PreviewPair | None]:
        """The pair of ``frame``, drawn where it is not kept."""
        if frame in self._kept:
            return self._kept[frame]
        self._evaluator.restart()
        if self._source.eye is None:
            self._evaluator.step(frame - 1, False)
        self._evaluator.step(frame)
        return self._read(frame)

    def keep(self, frame: int, cameras: Reprojection) -> None:
        """Keep the pair of ``frame`` that the source has drawn last, where there is room for it."""
        if frame in self._kept or self._room <= 0:
            return
        self._evaluator.submit(cameras)
        pair, other = self._read(frame)
        if frame - 1 in self._kept:
            before = self._kept[frame - 1][0]
            pair, other = pair.shared(before), other and other.shared(before)
        self._kept[frame] = pair, other
        self._room -= PIXEL_BYTES * pair.words.size

    def _read(self, frame: int) -> tuple[PreviewPair, PreviewPair | None]:
        pair = read_preview(self._source, self._evaluator, frame, self._columns)
        if self._other is None:
            return pair, None
        self._other.submit(self._evaluator.submitted)
        return pair, read_preview(self._source, self._other, frame, self._columns, pair)


class _Histories:
    """Pairs of one kind of history, and the decisions of their pixels."""

    def __init__(
        self, variant: Callable[..., RasterSource], settings: Settings, columns: Sequence[str], lobes: Sequence[str],
        previews: Previews,
    ):  # fmt: skip
        self._previews, self._decided = previews, DecidedPixels(variant, settings, columns, lobes)
        self._known: dict[tuple[int, ...], np.ndarray] = {}  # light of the drawn frame

    def draw(self, frame: int) -> tuple[PreviewPair, PreviewPair | None]:
        """The pair of ``frame``, whose pixels ``decide`` decides from now on; and by the other reprojection."""
        pair, other = self._previews.draw(frame)
        self._decided.draw(pair)
        self._known = {}
        return pair, other

    def decide(self, at: np.ndarray, audit: np.ndarray, pair: PreviewPair | None = None) -> Decisions:
        """Decide the pixels ``at`` (n, 2) of the drawn pair, or of its other ``pair``.

        ``audit`` (n,): random numbers of ``DecidedPixels``.
        """
        return self._decided.decide(at, ROUND_SIZES.limit, audit, halves=True, pair=pair, known=self._known)


class LightVisits:
    """Draws pairs of a session's scene once more and decides random pixels of them."""

    def __init__(
        self,
        owner: GpuOwner,
        variant: Callable[..., RasterSource],
        settings: Settings,
        frames: range,
        estimate: LightEstimate,
        previews: Previews | None = None,
    ):
        """``owner``: of all that is opened; ``variant``: opens a source of the scene; ``frames``: of the run;
        ``estimate``: whose statistics the visits add up to; ``previews``: of pairs that are drawn already."""
        self._gpu, self._settings, self._frames, self._estimate = owner.gpu, settings, frames, estimate
        self._pixels = visit_sizes(settings, len(sampled_pairs(frames, settings).positions))[1]
        kinds = ("frame", "eye") if settings.metrics.history == "both" else (settings.metrics.history,)
        self._histories = []
        for of_kind in (settings.replace(history=kind) for kind in kinds):
            if previews is None or len(kinds) > 1:
                source = variant(of_kind, extra=preview_channels(estimate.columns))
                previews = Previews(owner, source, of_kind, estimate.columns)
            self._histories.append(_Histories(variant, of_kind, estimate.columns, estimate.lobes, previews))

    def visit(self, position: int, number: int) -> Visit:
        """The pixels of visit ``number`` of the pair at ``position``."""
        with self._gpu:
            return self._visit(position, number)

    def _visit(self, position: int, number: int) -> Visit:
        frame = self._frames[position + 1]
        pairs, others = zip(*(history.draw(frame) for history in self._histories), strict=True)
        words, distances, traced = chosen_words(pairs)
        other, differs = others[0], False
        if other is not None:
            differs, traced = pairs[0].differs(other), traced | other.traced
        seed = (SEED, self._settings.lighting.seed, frame)
        image = strata_of(words, distances, self._estimate.thresholds, traced, differs)
        strata = PixelStrata.of(image, STRATA, seed)
        flat, stratum = draw_pixels(strata, number, self._pixels)
        audit = np.random.default_rng([*seed, number]).random(len(flat))
        decisions = self._decide(pairs, flat, audit)
        pixels, samples, of_other = _sampled(words, distances, flat, stratum, decisions), decisions.samples, None
        if other is not None:
            found = self._decide_other(other, decisions, flat, differs.ravel()[flat], audit)
            samples = samples + found.samples
            of_other = _sampled(other.words, other.distances, flat, stratum, found)
        return self._estimate.visit(position, strata.sizes, pixels, decisions.undecided, samples, of_other)

    def _decide(self, pairs: Sequence[PreviewPair], flat: np.ndarray, audit: np.ndarray) -> Decisions:
        """The pixels with the flat indices ``flat`` (n,) of a pair with each kind of history."""
        at = _places(pairs[0], flat)
        traced = [np.flatnonzero(pair.traced.ravel()[flat]) for pair in pairs]
        found = [history.decide(at[k], audit[k]) for history, k in zip(self._histories, traced, strict=True)]
        if len(pairs) == 1:
            return of_all(pairs[0], found[0], traced[0], (at[:, 1], at[:, 0]))[0]
        return merge_histories(pairs, found, traced, (at[:, 1], at[:, 0]))

    def _decide_other(
        self, pair: PreviewPair, chosen: Decisions, flat: np.ndarray, differs: np.ndarray, audit: np.ndarray
    ) -> Decisions:
        """Pixels under the other reprojection, decided again where their history ``differs`` (n,) bool."""
        at = _places(pair, flat)
        again = np.flatnonzero(differs & pair.traced.ravel()[flat])
        found = self._histories[0].decide(at[again], audit[again], pair)
        return other_decisions(chosen, of_all(pair, found, again, (at[:, 1], at[:, 0]))[0], differs)


def _places(pair: PreviewPair, flat: np.ndarray) -> np.ndarray:
    """Columns and rows from the top, (n, 2), of the pixels with the flat indices ``flat`` (n,)."""
    return np.stack(np.divmod(flat, pair.words.shape[1])[::-1], axis=-1)


def _sampled(
    words: np.ndarray, distances: Mapping[str, np.ndarray], flat: np.ndarray, stratum: np.ndarray, of: Decisions
) -> SampledPixels:
    """The pixels ``flat`` (n,) of a preview's ``words`` and ``distances`` (h, w), and what was decided of them."""
    known = {name: image.ravel()[flat].astype(np.float64) for name, image in distances.items()}
    return SampledPixels(stratum, words.ravel()[flat], known, of.first, of.end, of.audited)


class SampledLight:
    """The sampled light of one run: the preview's counts of every pair first, then rounds of visits."""

    def __init__(
        self,
        settings: Settings,
        frames: range,
        unmeasured: Mapping[str, str],
        lobes: Sequence[str] = (),
        both: bool = False,
    ):
        """``unmeasured``: column -> why the preview has none; ``lobes`` (of ``measured_lobes``): measured apart;
        ``both``: pairs are counted under both reprojections."""
        columns = sampled_columns(unmeasured, settings.metrics.columns)
        shading = "shading" not in unmeasured_rates(unmeasured)
        self.sample: PairSample = sampled_pairs(frames, settings)
        thresholds = {name: settings.metrics.threshold(name) for name in columns}
        self.estimate = LightEstimate(
            columns,
            thresholds,
            shading,
            settings.lighting.light_within,
            lobes,
            OTHER_REPROJECTION[settings.metrics.reprojection] if both else None,
        )
        self._settings, self.rounds, self._empty = settings, 0, 0  # visits without a pixel since the last one with any

    def add(self, position: int, counts: Counts) -> None:
        """Add the preview's counts of the pair at ``position``."""
        self.estimate.add_preview(position, counts)

    def run(self, visit: Callable[[int, int], Visit], watch: Callable[[str], None] = lambda text: None) -> None:
        """Rounds of ``visit(position, number)``, until ``done``; ``watch`` gets a line about each."""
        limit, started = self._settings.lighting.light_time, time.monotonic()
        if not self.done:
            watch("path-traced light at random pixels")
        while not self.done:
            wanted = self.next_round()
            found = {v: visit(*v) for v in sorted(wanted)}  # pairs that follow one another share a frame
            self.add_round([found[v] for v in wanted])
            spent = time.monotonic() - started
            watch(self.state + ("" if self.done else f"; about {spent * self.share_left:.0f} s left"))
            if limit is not None and spent >= limit:
                break

    def next_round(self) -> list[tuple[int, int]]:
        """The visits of the next round, as (position of the pair, number of its visit)."""
        positions = self.estimate.positions
        seed = self._settings.lighting.seed
        size = visit_sizes(self._settings, len(positions))[0]
        return [(positions[row], number) for row, number in round_of(self.rounds, len(positions), seed, size)]

    def add_round(self, visits: Sequence[Visit]) -> None:
        """Add the ``visits`` that ``next_round`` asked for."""
        for visit in visits:
            self.estimate.add(visit)
            self._empty = 0 if len(visit.stratum) else self._empty + 1
        self.rounds += 1
        self._intervals = self.estimate.intervals(self.sample)

    @property
    def done(self) -> bool:
        """Whether no further round is needed, possible or allowed."""
        if not self.rounds:
            return not self.estimate.positions
        if self._empty >= len(self.estimate.positions):  # no pair has a pixel that no visit has had
            return True
        return bool(self.estimate.samples) and (self.narrow or self.estimate.samples >= self._most_samples)

    @property
    def _most_samples(self) -> float:
        """Samples after which no further round begins, unless the settings have a time instead."""
        return ROUND_SIZES.samples if self._settings.lighting.light_time is None else math.inf

    @property
    def narrow(self) -> bool:
        """Whether the intervals are as narrow as the settings ask for."""
        return self.estimate.narrow(self._intervals)

    @property
    def share_left(self) -> float:
        """What is left to do in units of what was done, if intervals narrow with the square root of the samples."""
        by_width = (self.estimate.widest(self._intervals) / self._settings.lighting.light_within) ** 2
        return max(min(by_width, self._most_samples / max(self.estimate.samples, 1)) - 1.0, 0.0)

    @property
    def state(self) -> str:
        """The estimates of the columns after the last round, in words."""
        named = {at[1]: i for at, i in self._intervals.items() if at[0] == "discard" and at[2] == "mean_percent"}
        text = ", ".join(f"{name} {i.mean:.1f} ±{i.half_width:.1f} %" for name, i in named.items())
        return f"round {self.rounds} of path-traced light: {text}"

    def finish(self, summary: dict[str, Any], rows: Sequence[dict[str, Any]], frames: range) -> None:
        """Write the estimates into ``summary``, and the counts of the visited pairs into ``rows``."""
        for row in rows:
            row |= dict.fromkeys(SAMPLED_COLUMNS)
        if not self.rounds:
            return
        self.estimate.write_estimates(summary, self._intervals)
        visits = [visit for of_pair in self.estimate.visits.values() for visit in of_pair]
        summary["sampled_light"] = {
            "rounds": self.rounds, "pairs": len(self.estimate.visits), "pixels": sum(len(v.stratum) for v in visits),
            "samples": self.estimate.samples, "most_samples_per_pixel": ROUND_SIZES.limit,
            "audited": sum(v.audited for v in visits), "audited_wrong": sum(v.audited_wrong for v in visits),
            "within_points": self._settings.lighting.light_within, "narrow": self.narrow,
        }  # fmt: skip
        by_frame = {row["frame"]: row for row in rows}
        for position, of_pair in self.estimate.visits.items():
            row = by_frame[frames[position + 1]]
            row["sampled"] = sum(len(v.stratum) for v in of_pair)
            row |= {f"sampled_{c}": sum(v.discarded[c] for v in of_pair) for c in self.estimate.columns}
