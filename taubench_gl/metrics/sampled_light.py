"""Light columns, the rate ``shading`` and its reasons at sampled pixels: what is estimated, and its place in a summary.

The preview's masks of every pixel are the control (``metrics.pixel_sample``): every statistic here is a share of pixels
that a mask word and its distances tell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.conventions import HISTOGRAM_BINS, NOT_COMPARABLE, OTHER_REPROJECTION, Reason
from taubench_gl.features import COLUMNS, FEATURE_BIT, FEATURES, LIGHT_FEATURES, RADIANCE_FEATURES
from taubench_gl.metrics.counts import Counts, bin_of, counts_of, discarded_above, discarded_at
from taubench_gl.metrics.pair_sample import PairSample
from taubench_gl.metrics.path_samples import LIMIT
from taubench_gl.metrics.pixel_sample import (
    Interval,
    PixelStrata,
    SampledPair,
    estimate_share,
    pair_differences,
)
from taubench_gl.metrics.reuse_rate import RATE_BITS, first_reasons, occupied, surface_pixels
from taubench_gl.metrics.sequence_stats import EXPOSURE_FACTORS
from taubench_gl.run_schema import DECIDED_COLUMNS

Array = np.ndarray

SAMPLED = "sampled"
"""``method`` of a column that is estimated at sampled pixels."""

NEAR = 4.0
"""A preview distance within this factor of its threshold is near it: there the preview is most often wrong."""

DENSITY = (0.15, 0.5)
"""Anticipated standard deviation of the difference far from every threshold and near one; pixels are drawn by it."""

STRATA = 2 ** (1 + len(LIGHT_FEATURES)) + 2


def lobe_distance(bounce: str, lobe: str) -> str:
    """Name of the distance of one lobe of direct or indirect."""
    return f"{bounce}_{lobe}"


def strata_of(
    words: Array,
    distances: Mapping[str, Array],
    thresholds: Mapping[str, float],
    traced: Array,
    differs: Array | bool = False,
) -> Array:
    """Stratum of every pixel by its preview: near a threshold or not, and its light columns.  (h, w) int64.

    -1 where the mask does not depend on light: outside ``traced`` (h, w) bool.  ``differs`` (h, w) bool: pixels whose
    history depends on the reprojection: few, and each decided twice, they have two strata of their own.
    """
    near = np.zeros(words.shape, bool)
    out = np.zeros(words.shape, np.int64)
    for k, name in enumerate(LIGHT_FEATURES):
        out += ((words & np.uint32(FEATURE_BIT[name])) != 0).astype(np.int64) << (1 + k)
        if name in distances:
            limit = thresholds[name]
            near |= (distances[name] > limit / NEAR) & (distances[name] < limit * NEAR)
    return np.where(traced, np.where(differs, STRATA - 2, out) + near, -1)


def draw_pixels(strata: PixelStrata, visit: int, count: int) -> tuple[Array, Array]:
    """About ``count`` pixels of a visit: flat indices (n,) and their strata (n,)."""
    density = np.where(np.arange(STRATA) % 2, DENSITY[1], DENSITY[0])
    return strata.take(visit, strata.counts(density, count))


Indicator = Callable[[Array, Mapping[str, Array]], Array]
"""(mask words (n,), distances (n,) by name) -> (n,) bool: which pixels a statistic counts."""


@dataclass(frozen=True, slots=True)
class PixelMasks:
    """Mask words and distances of ``n`` pixels by a number of samples, and by halves of these samples.

    The share of pixels whose noisy distances are above a limit is biased: to first order by c / N with N samples, and
    by 2 c / N with half of them.  So twice the indicator at N less its mean over halves of the samples has no bias of
    the first order (Richardson's extrapolation).  Words are extrapolated where the pixel is undecided; distances
    everywhere, because a pixel that is clear of its threshold may be near another limit.
    """

    words: Array  # (n,) uint32 reason words
    distances: Mapping[str, Array]  # column or ``lobe_distance`` -> (n,) float64
    half_words: Array  # (n, halves) uint32; of a decided pixel all are its word
    half_distances: Mapping[str, Array]  # as ``distances``, (n, halves)

    @classmethod
    def blank(cls, words: Array, names: Sequence[str], halves: int) -> PixelMasks:
        """Masks of pixels with reason ``words`` (n,) and distances of 0."""
        count = len(words)
        distances = ({name: np.zeros(shape) for name in names} for shape in (count, (count, halves)))
        return cls(words.copy(), next(distances), np.repeat(words[:, None], halves, axis=1), next(distances))

    def put(self, rows: Array, values: PixelMasks) -> None:
        """Replace the masks of the pixels ``rows`` (k,), indices, by ``values``."""
        self.words[rows], self.half_words[rows] = values.words, values.half_words
        for name, distances in values.distances.items():
            self.distances[name][rows] = distances
        for name, distances in values.half_distances.items():
            self.half_distances[name][rows] = distances

    def take(self, rows: Array) -> PixelMasks:
        """The masks of the pixels ``rows`` (k,), indices."""
        distances = ({n: of[rows] for n, of in each.items()} for each in (self.distances, self.half_distances))
        return PixelMasks(self.words[rows], next(distances), self.half_words[rows], next(distances))

    def value(self, indicator: Indicator) -> Array:
        """What each pixel counts in a share, from -1 to 2.  (n,) float64."""
        by_half = {name: distance.ravel() for name, distance in self.half_distances.items()}
        halves = indicator(self.half_words.ravel(), by_half).reshape(self.half_words.shape)
        return 2.0 * indicator(self.words, self.distances) - halves.mean(axis=1)


@dataclass(frozen=True, slots=True)
class SampledPixels:
    """``n`` sampled pixels of one visit of a pair: what ``DecidedPixels`` said of them."""

    stratum: Array  # (n,) int64
    preview: Array  # (n,) uint32 reason words
    preview_distances: Mapping[str, Array]  # column -> (n,) float64
    first: PixelMasks  # when a pixel was decided, or at the limit
    end: PixelMasks  # at the limit, of audited pixels
    audited: Array  # (n,) float64, probability of the audit, 0 where there was none

    @property
    def audits(self) -> Array:
        """Weight of ``end``: an audited pixel stands for all that were decided and not audited.  (n,) float64."""
        return np.divide(1.0, self.audited, out=np.zeros(len(self.audited)), where=self.audited > 0.0)

    def value(self, indicator: Indicator) -> Array:
        """y of each pixel without bias of the first order.  (n,) float64."""
        first = self.first.value(indicator)
        return first + self.audits * (self.end.value(indicator) - first)

    def difference(self, indicator: Indicator) -> Array:
        """y - x of each pixel, x of the preview.  (n,) float64."""
        return self.value(indicator) - indicator(self.preview, self.preview_distances)

    def curve(self, column: str) -> Array:
        """What the distances of ``column`` add to its curve: strata, bins and weights.  (3, m) float64."""
        parts = [(self.preview_distances[column][:, None], -np.ones(len(self.stratum)))]
        for masks, weight in ((self.first, 1.0 - self.audits), (self.end, self.audits)):
            halves = masks.half_distances[column]
            parts += [(masks.distances[column][:, None], 2.0 * weight), (halves, -weight / halves.shape[1])]
        place = [self.stratum[:, None] * HISTOGRAM_BINS + bin_of(distances) for distances, _ in parts]
        weights = [np.broadcast_to(weight[:, None], distances.shape) for distances, weight in parts]
        places, inverse = np.unique(np.concatenate([x.ravel() for x in place]), return_inverse=True)
        summed = np.bincount(inverse, np.concatenate([x.ravel() for x in weights]), len(places))
        kept = np.abs(summed) > 1e-12  # else they cancel
        return np.stack([*(x.astype(np.float64) for x in np.divmod(places, HISTOGRAM_BINS)), summed])[:, kept]


@dataclass(frozen=True, slots=True)
class Visit:
    """What ``n`` sampled pixels of a pair, drawn by one visit, add to an estimate (``LightEstimate.visit``)."""

    position: int  # of the pair, 0 .. N - 1
    sizes: Array  # (strata,) int64, pixels of the image in each stratum
    stratum: Array  # (n,) int64, of each sampled pixel
    difference: Array  # (n, k) float64, y - x of k statistics
    curves: Mapping[str, Array]  # column -> (3, m) float64, strata, bins and weights
    discarded: Mapping[str, float]  # column -> sampled pixels that it discards, an undecided one by its weight
    undecided: int  # pixels
    audited: int  # pixels
    audited_wrong: int  # audited pixels that were decided otherwise than at the limit
    samples: int  # of all pixels, of each of the two frames

    def record(self) -> dict[str, Any]:
        """The visit as JSON values, from which ``of_record`` reads it back without loss."""
        out = {name: getattr(self, name) for name in self.__slots__}
        arrays = {name: out[name].tolist() for name in _KINDS}
        return out | arrays | {"curves": {column: curve.tolist() for column, curve in self.curves.items()}}

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Visit:
        """The inverse of ``record``.  Raises LookupError, TypeError or ValueError for another one."""
        values = {name: record[name] for name in cls.__slots__}
        arrays = {name: np.array(record[name], kind) for name, kind in _KINDS.items()}
        curves = {column: np.array(curve, np.float64) for column, curve in record["curves"].items()}
        return cls(**values | arrays | {"curves": curves})


_KINDS = {"sizes": np.int64, "stratum": np.int64, "difference": np.float64}


@dataclass(frozen=True, slots=True)
class _Statistic:
    """A share of pixels.  ``at``: where a summary has it; ``distance``: a column and the limit of its distance where
    that, not the mask word, tells which pixels count."""

    at: tuple[str, ...]
    indicator: Indicator
    base: str = "pixels"  # | surface | comparable: what it is a share of
    distance: tuple[str, float] | None = None
    other: bool = False  # of the masks of the other reprojection

    def known(self, counted: Counts) -> float:
        """Pixels of one pair that the preview counts."""
        if self.distance is not None:
            column, limit = self.distance
            return discarded_at(counted.histograms[FEATURES.index(column)], limit) or 0.0
        words, pixels = occupied(counted.other if self.other else counted.mask_histogram)
        return float(pixels[self.indicator(words, {})].sum())


def _has(bits: int, none_of: int = 0) -> Indicator:
    """Words with one of ``bits`` (0: any word) and none of ``none_of``."""
    return lambda words, _: (((words & int(bits)) != 0) | (not bits)) & ((words & int(none_of)) == 0)


def _above(name: str, limit: float) -> Indicator:
    """Comparable pixels with a distance above ``limit``; none where it is not known."""

    def over(words: Array, distances: Mapping[str, Array]) -> Array:
        known = distances.get(name)
        return np.zeros(len(words), bool) if known is None else (known > limit) & ((words & NOT_COMPARABLE) == 0)

    return over


def statistics_of(
    columns: Sequence[str],
    thresholds: Mapping[str, float],
    shading: bool,
    lobes: Sequence[str],
    other: str | None = None,
) -> list[_Statistic]:
    """Statistics of the light ``columns``.

    ``shading``: whether that rate is measured; ``lobes``: measured apart, without the preview as control, which is not
    known at single pixels; ``other``: reprojection that is counted too.
    """
    out: list[_Statistic] = []
    shares = (("mean_percent", "pixels"), ("comparable_mean_percent", "comparable"))
    radiance = [column for column in columns if column in RADIANCE_FEATURES]
    for column in columns:
        for key, base in shares:
            out.append(_Statistic(("discard", column, key), _has(FEATURE_BIT[column]), base))
        of_surface = _has(FEATURE_BIT[column], int(Reason.SKY))
        out.append(_Statistic(("discard", column, "of_surface_percent"), of_surface, "surface"))
    for column in radiance:
        for key, factor in EXPOSURE_FACTORS.items():
            limit = thresholds[column] / factor
            out.append(_Statistic(("discard", column, key), _above(column, limit), distance=(column, limit)))
    for lobe in lobes:
        for bounce in radiance:
            above = _above(lobe_distance(bounce, lobe), thresholds[bounce])
            out += [_Statistic(("lobes", lobe, bounce, key), above, base) for key, base in shares]
    if not shading:
        return out
    unusable = int(RATE_BITS["shading"] | Reason.SKY)
    for key, base in (("mean_percent", "surface"), ("of_picture_percent", "pixels")):
        out.append(_Statistic(("reusable", "shading", key), _has(0, unusable), base))
        if other is not None:
            out.append(_Statistic(("reusable", other, "shading", key), _has(0, unusable), base, other=True))
    table, names = first_reasons("shading")
    for index, name in enumerate(names):
        at = ("reusable", "reasons", name, "mean_percent")
        out.append(_Statistic(at, lambda words, _, index=index: table[words] == index, "surface"))
    if "color" in columns:
        out.append(
            _Statistic(("reusable", "color_only", "mean_percent"), _has(FEATURE_BIT["color"], unusable), "surface")
        )
    return out


class LightEstimate:
    """Adds up the preview's counts of every pair and the sampled pixels of the visited ones."""

    def __init__(
        self,
        columns: Sequence[str],
        thresholds: Mapping[str, float],
        shading: bool,
        most: float,
        lobes: Sequence[str] = (),
        other: str | None = None,
    ):
        """``most``: half width of the intervals of columns and rate that is narrow enough, percentage points.

        ``other``: as of ``statistics_of``.
        """
        self.columns, self.thresholds, self.lobes, self._most = tuple(columns), thresholds, tuple(lobes), most
        self._statistics = statistics_of(columns, thresholds, shading, lobes, other)
        self._known: dict[int, Array] = {}  # position -> pixels of each statistic
        self._bases: dict[int, dict[str, float]] = {}
        self._histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS), np.int64)
        self._comparable = 0
        self.visits: dict[int, list[Visit]] = {}

    def add_preview(self, position: int, counted: Counts) -> None:
        """The preview's counts of one pair."""
        counts = counts_of(counted.mask_histogram)
        self._known[position] = np.array([s.known(counted) for s in self._statistics], np.float64)
        surface = surface_pixels(counted.mask_histogram)
        self._bases[position] = {"pixels": counts["pixels"], "surface": surface, "comparable": counts["comparable"]}
        self._histograms += counted.histograms
        self._comparable += counts["comparable"]

    def visit(
        self,
        position: int,
        sizes: Array,
        pixels: SampledPixels,
        undecided: Array,
        samples: Array,
        other: SampledPixels | None = None,
    ) -> Visit:
        """What ``pixels``, n of the pair at ``position``, add.

        ``sizes`` (strata,): pixels of the image; ``undecided`` (n,) bool; ``samples`` (n,): of each of the two frames;
        ``other``: the same pixels under the other reprojection.
        """
        values = [(other if s.other else pixels).difference(s.indicator) for s in self._statistics]
        discarded = {c: float(pixels.value(_has(FEATURE_BIT[c])).sum()) for c in self.columns}
        audited = pixels.audited > 0.0
        wrong = audited & (pixels.first.words != pixels.end.words)
        counts = (int(np.sum(each)) for each in (undecided, audited, wrong, samples))
        curves = {column: pixels.curve(column) for column in self.columns}
        return Visit(position, sizes, pixels.stratum, np.stack(values, axis=-1), curves, discarded, *counts)

    def add(self, visit: Visit) -> None:
        """What one visit adds.  Visits of a pair are added in order."""
        self.visits.setdefault(visit.position, []).append(visit)

    @property
    def positions(self) -> list[int]:
        """Positions of the pairs whose preview is known, ascending."""
        return sorted(self._known)

    def intervals(self, sample: PairSample) -> dict[tuple[str, ...], Interval]:
        """Every statistic in percent, by its place in a summary.  ``sample``: the pairs of ``add_preview``."""
        positions, visited = self.positions, sorted(self.visits)
        rows = [positions.index(position) for position in visited]
        pairs = [self._merged(position) for position in visited]
        differences, within = pair_differences(pairs)
        known = np.stack([self._known[p] for p in positions])
        bases = {
            name: np.array([self._bases[p][name] for p in positions]) for name in ("pixels", "surface", "comparable")
        }
        out = {}
        for k, statistic in enumerate(self._statistics):
            pixels = bases["pixels"]
            control, base, scale = known[:, k] / pixels, None, np.ones(len(pixels))
            if statistic.base == "comparable":  # a mean over pairs of shares of each
                scale = np.divide(pixels, bases["comparable"], out=np.zeros(len(pixels)), where=bases["comparable"] > 0)
            if statistic.base == "surface":  # a total over a total
                base = bases["surface"] / pixels
                if not base.any():
                    continue
            found = estimate_share(
                sample, control * scale, rows, differences[:, k] * scale[rows], within[:, k] * scale[rows] ** 2, base
            )
            out[statistic.at] = Interval(
                100.0 * found.mean, 100.0 * found.half_width, 100.0 * found.of_pixels, 0.0, 100.0
            )
        return out

    def narrow(self, intervals: Mapping[tuple[str, ...], Interval]) -> bool:
        """Whether no interval is wider than asked for."""
        return self.widest(intervals) <= self._most

    def widest(self, intervals: Mapping[tuple[str, ...], Interval]) -> float:
        """Half width of the widest interval of all columns and of the rate, percentage points; but for the choice of
        pairs whose preview is known."""
        named = [i for at, i in intervals.items() if at[0] == "discard" and at[2] == "mean_percent"]
        named += [i for at, i in intervals.items() if at == ("reusable", "shading", "mean_percent")]
        return float(np.max([0.0, *(interval.of_pixels for interval in named)]))

    @property
    def samples(self) -> int:
        """Number of light samples of all pixels in both frames."""
        return 2 * sum(visit.samples for visits in self.visits.values() for visit in visits)

    def write_estimates(self, summary: dict[str, Any], intervals: Mapping[tuple[str, ...], Interval]) -> None:
        """Replace the preview's shares in ``summary`` by estimates, with intervals and the preview beside them."""
        every = [visit for visits in self.visits.values() for visit in visits]
        pixels = sum(len(visit.stratum) for visit in every)
        undecided = 100.0 * sum(visit.undecided for visit in every) / pixels if pixels else 0.0
        for at, interval in intervals.items():
            block = summary
            for key in at[:-1]:
                block = block[key]
            key, stem = at[-1], at[-1].removesuffix("_percent")
            if key == "mean_percent":
                block |= {"preview_percent": block[key], "interval95_percent": list(interval.ends), "method": SAMPLED}
            elif key in EXPOSURE_FACTORS:
                block[f"{stem}_interval95_percent"] = list(interval.ends)
            block[key] = min(max(interval.mean, interval.least), interval.most)
        for column in self.columns:
            _keep_order(summary["discard"][column])
        reasons = {at[2]: i for at, i in intervals.items() if at[:2] == ("reusable", "reasons") and i.half_width > 0.0}
        _balance([summary["reusable"]["reasons"][name] for name in reasons], [i.mean for i in reasons.values()])
        entries = [summary["discard"][column] for column in self.columns]
        entries += [of[c] for of in (summary.get("lobes") or {}).values() for c in of if of[c].get("method") == SAMPLED]
        rates = [of["shading"] for of in (summary["reusable"], *map(summary["reusable"].get, OTHER_REPROJECTION)) if of]
        entries += [rate for rate in rates if rate.get("method") == SAMPLED]
        for entry in entries:
            entry |= {"pixels": pixels, "undecided_percent": undecided}
            entry |= {key: None for key in ("max_percent", "min_percent", "without_cuts_mean_percent") if key in entry}
        of_pairs = summary.get("sampling") or {"columns": {}, "reusable": {}}
        for column in self.columns:
            of_pairs["columns"].pop(column, None)
        if summary["reusable"]["shading"] in entries:
            of_pairs["reusable"].pop("shading", None)
        for column in self.columns:
            if column in summary["curves"]:
                summary["curves"][column] |= self._curve(column)

    def _merged(self, position: int) -> SampledPair:
        visits = self.visits[position]
        difference = [v.difference.reshape(-1, len(self._statistics)) for v in visits]
        stratum = np.concatenate([v.stratum for v in visits])
        pixels = int(self._bases[position]["pixels"])
        return SampledPair(pixels, visits[0].sizes, stratum, np.concatenate(difference))

    def _curve(self, column: str) -> dict[str, Any]:
        """Counts of the curve of ``column``: the preview's, with the distances of the sampled pixels."""
        counts = self._histograms[FEATURES.index(column)].astype(np.float64)
        counts[0] = self._comparable - counts[1:].sum()
        scale = len(self._known) / len(self.visits)
        for visits in self.visits.values():
            stratum = np.concatenate([v.stratum for v in visits])
            drawn = np.bincount(stratum, minlength=len(visits[0].sizes))
            weight = scale * np.divide(visits[0].sizes, drawn, out=np.zeros(len(drawn)), where=drawn > 0)
            for strata, bins, weights in (v.curves[column] for v in visits):
                weights = weights * weight[strata.astype(int)]
                counts += np.bincount(bins.astype(int), weights=weights, minlength=HISTOGRAM_BINS)
        above = np.clip(discarded_above(counts), 0.0, self._comparable)
        above = np.rint(np.maximum.accumulate(above[::-1])[::-1]).astype(np.int64)
        whole = np.concatenate([[self._comparable], above, [0]])
        return {"counts": (whole[:-1] - whole[1:]).tolist(), "at_or_above": above.tolist(), "method": SAMPLED}


def _keep_order(entry: dict[str, Any]) -> None:
    """Bound the shares at other exposures, and their intervals, by the share at the exposure itself: the brighter, the
    more pixels are discarded.  Estimates of shares can differ otherwise."""
    for key, factor in EXPOSURE_FACTORS.items():
        ends = f"{key.removesuffix('_percent')}_interval95_percent"
        if ends in entry:
            bound = min if factor < 1.0 else max
            entry[key] = bound(entry[key], entry["mean_percent"])
            entry[ends] = [bound(pair) for pair in zip(entry[ends], entry["interval95_percent"], strict=True)]


def _balance(entries: Sequence[dict[str, Any]], means: Sequence[float]) -> None:
    """Lower shares of a total, of which some are estimated below 0 and count as 0, to the sum of their ``means``."""
    kept = sum(max(mean, 0.0) for mean in means)
    for entry, mean in zip(entries, means, strict=True):
        entry["mean_percent"] = max(mean, 0.0) * max(sum(means), 0.0) / kept if kept else 0.0


def decided_summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The block ``decided_light`` of a run that decides every pixel, from its rows."""
    total = {name: sum(row[name] for row in rows) for name in DECIDED_COLUMNS}
    undecided = 100.0 * total["undecided"] / total["traced"] if total["traced"] else 0.0
    return total | {"undecided_percent": undecided, "most_samples_per_pixel": LIMIT}


def sampled_columns(unmeasured: Mapping[str, str], columns: Sequence[str]) -> tuple[str, ...]:
    """Light columns of a run that has ``columns``, in the order of Table 4."""
    return tuple(c for c in COLUMNS if c in LIGHT_FEATURES and c in columns and c not in unmeasured)
