"""Light columns, the rate ``shading`` and its reasons at sampled pixels: what is estimated, and its place in a summary.

The preview's masks of every pixel are the control (``metrics.pixel_sample``): every statistic here is a share of pixels
that a mask word and its distances tell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.conventions import HISTOGRAM_BINS, NOT_COMPARABLE, Reason
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

STRATA = 2 ** (1 + len(LIGHT_FEATURES))


def lobe_distance(bounce: str, lobe: str) -> str:
    """Name of the distance of one lobe of direct or indirect."""
    return f"{bounce}_{lobe}"


def strata_of(words: Array, distances: Mapping[str, Array], thresholds: Mapping[str, float], traced: Array) -> Array:
    """Stratum of every pixel by its preview: near a threshold or not, and its light columns.  (h, w) int64.

    -1 where the mask does not depend on light: outside ``traced`` (h, w) bool.
    """
    near = np.zeros(words.shape, bool)
    out = np.zeros(words.shape, np.int64)
    for k, name in enumerate(LIGHT_FEATURES):
        out += ((words & np.uint32(FEATURE_BIT[name])) != 0).astype(np.int64) << (1 + k)
        if name in distances:
            limit = thresholds[name]
            near |= (distances[name] > limit / NEAR) & (distances[name] < limit * NEAR)
    return np.where(traced, out + near, -1)


def draw_pixels(strata: PixelStrata, visit: int, count: int) -> tuple[Array, Array]:
    """About ``count`` pixels of a visit: flat indices (n,) and their strata (n,)."""
    density = np.where(np.arange(STRATA) % 2, DENSITY[1], DENSITY[0])
    return strata.take(visit, strata.counts(density, count))


Indicator = Callable[[Array, Mapping[str, Array]], Array]
"""(mask words (n,), distances (n,) by name) -> (n,) bool: which pixels a statistic counts."""


@dataclass(frozen=True, slots=True)
class Visit:
    """Sampled pixels of a pair, ``n`` of them: what ``DecidedPixels`` said of pixels that one visit drew."""

    position: int  # of the pair, 0 .. N - 1
    sizes: Array  # (strata,) int64, pixels of the image in each stratum
    stratum: Array  # (n,) int64
    preview: Array  # (n,) uint32 reason words
    first: Array  # (n,) uint32, when the pixel was decided
    words: Array  # (n,) uint32, at the end
    audited: Array  # (n,) float64, probability of the audit, 0 where there was none
    undecided: Array  # (n,) bool
    samples: Array  # (n,) int64, of each of the two frames
    preview_distances: Mapping[str, Array]  # column -> (n,) float64
    distances: Mapping[str, Array]

    def record(self) -> dict[str, Any]:
        """JSON values, without loss."""
        out = {name: getattr(self, name) for name in self.__slots__}
        return {
            name: {k: v.tolist() for k, v in value.items()} if isinstance(value, Mapping)
            else value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in out.items()
        }  # fmt: skip

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> Visit:
        """The inverse of ``record``.  Raises LookupError, TypeError or ValueError for another one."""
        values: dict[str, Any] = {"position": int(record["position"])}
        for name, kind in _KINDS.items():
            values[name] = np.array(record[name], kind)
        for name in ("preview_distances", "distances"):
            values[name] = {column: np.array(v, np.float64) for column, v in record[name].items()}
        return cls(**values)

    def effective(self, indicator: Indicator) -> Array:
        """Unbiased y - x of each pixel: an audited pixel stands for all that were decided and not audited.  (n,)."""
        end = indicator(self.words, self.distances).astype(np.float64)
        first = indicator(self.first, self.distances).astype(np.float64)
        known = (self.audited == 0.0) | self.undecided
        correction = np.where(known, 0.0, (end - first) / np.where(known, 1.0, self.audited))
        return np.where(self.undecided, end, first) - indicator(self.preview, self.preview_distances) + correction


_KINDS = {
    "sizes": np.int64, "stratum": np.int64, "preview": np.uint32, "first": np.uint32, "words": np.uint32,
    "audited": np.float64, "undecided": np.bool_, "samples": np.int64,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Statistic:
    """A share of pixels.  ``at``: where a summary has it; ``distance``: a column and the limit of its distance where
    that, not the mask word, tells which pixels count."""

    at: tuple[str, ...]
    indicator: Indicator
    base: str = "pixels"  # | surface | comparable: what it is a share of
    distance: tuple[str, float] | None = None

    def known(self, counted: Counts) -> float:
        """Pixels of one pair that the preview counts."""
        if self.distance is not None:
            column, limit = self.distance
            return discarded_at(counted.histograms[FEATURES.index(column)], limit) or 0.0
        words, pixels = occupied(counted.mask_histogram)
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
    columns: Sequence[str], thresholds: Mapping[str, float], shading: bool, lobes: Sequence[str]
) -> list[_Statistic]:
    """Those of the light ``columns``; ``shading``: whether that rate is measured; ``lobes``: measured apart, without
    the preview as control, which is not known at single pixels."""
    out: list[_Statistic] = []
    shares = (("mean_percent", "pixels"), ("comparable_mean_percent", "comparable"))
    radiance = [column for column in columns if column in RADIANCE_FEATURES]
    for column in columns:
        for key, base in shares:
            out.append(_Statistic(("discard", column, key), _has(FEATURE_BIT[column]), base))
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
    other = int(RATE_BITS["shading"] | Reason.SKY)
    for key, base in (("mean_percent", "surface"), ("of_picture_percent", "pixels")):
        out.append(_Statistic(("reusable", "shading", key), _has(0, other), base))
    table, names = first_reasons("shading")
    for index, name in enumerate(names):
        at = ("reusable", "reasons", name, "mean_percent")
        out.append(_Statistic(at, lambda words, _, index=index: table[words] == index, "surface"))
    if "color" in columns:
        out.append(_Statistic(("reusable", "color_only", "mean_percent"), _has(FEATURE_BIT["color"], other), "surface"))
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
    ):
        """``most``: half width of the intervals of columns and rate that is narrow enough, percentage points."""
        self.columns, self._most = tuple(columns), most
        self._statistics = statistics_of(columns, thresholds, shading, lobes)
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

    def add(self, visit: Visit) -> None:
        """The pixels of one visit.  Visits of a pair are added in order."""
        self.visits.setdefault(visit.position, []).append(visit)

    @property
    def positions(self) -> list[int]:
        """Of the pairs whose preview is known, ascending."""
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
        """Whether the intervals of all columns, and of the rate, are as narrow as asked for, but for the choice of
        pairs whose preview is known."""
        named = [i for at, i in intervals.items() if at[0] == "discard" and at[2] == "mean_percent"]
        named += [i for at, i in intervals.items() if at == ("reusable", "shading", "mean_percent")]
        return all(interval.of_pixels <= self._most for interval in named)

    @property
    def samples(self) -> int:
        """Of all pixels, of both frames."""
        return 2 * sum(int(visit.samples.sum()) for visits in self.visits.values() for visit in visits)

    def amend(self, summary: dict[str, Any], intervals: Mapping[tuple[str, ...], Interval]) -> None:
        """Replace the preview's shares in ``summary`` by estimates, with intervals and the preview beside them."""
        every = [visit for visits in self.visits.values() for visit in visits]
        undecided = np.concatenate([visit.undecided for visit in every])
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
        reasons = {at[2]: i for at, i in intervals.items() if at[:2] == ("reusable", "reasons") and i.half_width > 0.0}
        _balance([summary["reusable"]["reasons"][name] for name in reasons], [i.mean for i in reasons.values()])
        entries = [summary["discard"][column] for column in self.columns]
        entries += [of[c] for of in (summary.get("lobes") or {}).values() for c in of if of[c].get("method") == SAMPLED]
        if summary["reusable"]["shading"].get("method") == SAMPLED:
            entries.append(summary["reusable"]["shading"])
        for entry in entries:
            entry |= {"pixels": len(undecided), "undecided_percent": 100.0 * float(undecided.mean())}
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
        difference = [np.stack([v.effective(s.indicator) for s in self._statistics], axis=-1) for v in visits]
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
            weight = scale * np.divide(visits[0].sizes, drawn, out=np.zeros(len(drawn)), where=drawn > 0)[stratum]
            for sign, name in ((1.0, "distances"), (-1.0, "preview_distances")):
                distances = np.concatenate([getattr(v, name)[column] for v in visits])
                counts += sign * np.bincount(bin_of(distances), weights=weight, minlength=HISTOGRAM_BINS)
        above = np.clip(discarded_above(counts), 0.0, self._comparable)
        above = np.rint(np.maximum.accumulate(above[::-1])[::-1]).astype(np.int64)
        whole = np.concatenate([[self._comparable], above, [0]])
        return {"counts": (whole[:-1] - whole[1:]).tolist(), "at_or_above": above.tolist(), "method": SAMPLED}


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
