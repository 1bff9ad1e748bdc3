"""Statistics of the masks of all pairs (Table 4).

Sums are constant in memory; every pair adds one float64 per measured column, for estimates over sampled pairs and means
without cuts, which are known only at the end.
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np

from taubench_gl.conventions import COUNTED, EQUAL, HISTOGRAM_BINS, OTHER_REPROJECTION
from taubench_gl.features import COLUMNS, FEATURES, RADIANCE_FEATURES, TABLE
from taubench_gl.metrics.counts import (
    CLASSES,
    Counts,
    comparable_percent,
    counts_of,
    discarded_above,
    discarded_at,
    edges,
    percent,
)
from taubench_gl.metrics.pair_sample import PairSample, estimate, share_ends
from taubench_gl.metrics.reuse_rate import RATES, ReuseStats, reusable_pixels, unmeasured_rate
from taubench_gl.metrics.streaming import Welford

NOT_MEASURED = "not measured"
EXPOSURE_FACTORS = {"at_half_exposure_percent": 0.5, "at_twice_exposure_percent": 2.0}
"""Keys of a light column in ``discard``, and the factors of the exposure that they stand for."""


class SequenceStats:
    """Accumulates the counts of pairs.  ``measured``: the columns that were computed; the others are reported as
    ``null``.

    ``other``: of the other reprojection, as of ``Source``.
    """

    def __init__(self, measured: tuple[str, ...], reasons: dict[str, str], other: str = EQUAL):
        self.measured, self.reasons, self._other = measured, reasons, other
        self.reuse, self._other_reuse = (
            ReuseStats({c: reasons.get(c, NOT_MEASURED) for c in COLUMNS if c not in measured}) for _ in range(2)
        )
        self._all = {c: Welford() for c in COLUMNS}
        self._comparable = {c: Welford() for c in COLUMNS}
        self._classes = {c: Welford() for c in CLASSES}
        self._per_pair = {c: array("d") for c in COLUMNS}
        self._histograms = np.zeros((len(FEATURES), HISTOGRAM_BINS), dtype=np.int64)
        self._comparable_pixels = 0
        self.pairs = 0

    def add(self, counted: Counts) -> dict[str, int | None]:
        """Add the raw counts of one pair, None where a feature was not measured."""
        counts: dict[str, int | None] = counts_of(counted.mask_histogram)
        self.reuse.add(counted.mask_histogram)
        other: dict[str, int | None] = dict.fromkeys(RATES)
        if self._other == EQUAL:
            other = {rate: counts[f"reusable_{rate}"] for rate in RATES}
        elif self._other == COUNTED:
            self._other_reuse.add(counted.other)
            other = reusable_pixels(counted.other)
        counts |= {f"other_reusable_{rate}": other[rate] for rate in RATES}
        self.pairs += 1
        self._comparable_pixels += counts["comparable"]
        for name in CLASSES:
            self._classes[name].add(counts[name])
        for column in self.measured:
            self._all[column].add(percent(counts, column))
            self._per_pair[column].append(percent(counts, column))
            share = comparable_percent(counts, column)
            if share is not None:
                self._comparable[column].add(share)
        self._histograms += counted.histograms
        for feature in TABLE:
            if feature.name not in self.measured:
                counts[feature.name] = None
                counts |= {bit.name.lower(): None for bit in feature.details if feature.light}
        counts |= {f"{of}reusable_{rate}": None for rate in self.reuse.missing for of in ("", "other_")}
        return counts

    def discard(self, cuts: np.ndarray) -> dict[str, Any]:
        """The ``discard`` block.  ``cuts`` (P,) bool: pairs left out of ``without_cuts_mean_percent``."""
        out = {}
        for column in COLUMNS:
            if column not in self.measured or not self.pairs:
                reason = self.reasons.get(column, "the scene gives no pair of frames")
                out[column] = {"mean_percent": None, "comparable_mean_percent": None, "max_percent": None}
                out[column] |= {"without_cuts_mean_percent": None, "reason": reason}
                continue
            shares_without_cuts = np.array(self._per_pair[column])[~cuts]
            shares = self._comparable[column]
            out[column] = {
                "mean_percent": self._all[column].mean,
                "comparable_mean_percent": shares.mean if shares.count else None,
                "max_percent": self._all[column].max,
                "without_cuts_mean_percent": float(shares_without_cuts.mean()) if len(shares_without_cuts) else None,
            }
        return out

    def rates(self, reprojection: str, cuts: np.ndarray, sample: PairSample | None) -> dict[str, Any]:
        """The blocks ``reusable`` and ``discard``, and of sampled pairs their confidence intervals, ``sampling``.

        ``reusable`` has the rates of the other reprojection, unless it is equal: ``with_reprojections`` adds the rest.
        ``cuts`` (P,) bool of the pairs; ``sample``: how they were drawn, None for all pairs.
        """
        discard = self.discard(cuts)
        sampling = {} if sample is None else {"sampling": self._sampling(sample, discard)}
        weights = None if sample is None else sample.weights
        for column, share in self.reuse.discarded(weights).items() if self.pairs else ():
            discard[column]["of_surface_percent"] = share
        reusable = self.reuse.block(reprojection, cuts, weights)
        if self._other != EQUAL:
            counted = self._other == COUNTED
            rates = (
                self._other_reuse.rates(cuts, weights)
                if counted
                else dict.fromkeys(RATES, unmeasured_rate(self._other))
            )
            reusable[OTHER_REPROJECTION[reprojection]] = rates
        return {"reusable": reusable, "discard": discard} | sampling

    def _sampling(self, sample: PairSample, discard: dict[str, Any]) -> dict[str, Any]:
        """The block ``sampling``: confidence intervals of the means.  Writes the weighted means into ``discard``."""
        columns = {}
        for column in self.measured if sample.positions else ():
            interval = estimate(sample, self.per_pair(column))
            discard[column]["mean_percent"] = interval.mean
            columns[column] = {
                "mean_percent": interval.mean,
                "half_width_points": interval.half_width,
                "interval95_percent": share_ends(interval.mean, interval.half_width),
                "level": interval.level,
            }
        reusable = {}
        for rate in RATES if sample.positions else ():
            if rate not in self.reuse.missing and self.reuse.has_surface:
                interval = estimate(sample, self.reuse.residuals(rate, sample.weights))
                reusable[rate] = {"half_width_points": interval.half_width, "level": interval.level}
        return {"drawn": len(sample.positions), "total": sample.total, "reusable": reusable, "columns": columns}

    def per_pair(self, column: str) -> np.ndarray:
        """Percentages of every pair, in order.  (pairs,) float64; empty where not measured."""
        return np.array(self._per_pair[column])

    def classes(self) -> dict[str, float | None]:
        """Mean pixels per class; they add up to w * h."""
        return {name: w.mean if w.count else None for name, w in self._classes.items()}

    def curves(self) -> dict[str, Any]:
        """Discard-versus-threshold: per measured feature, pixels (all pairs) with a distance at or above each edge."""
        out = {}
        for i, feature in enumerate(FEATURES):
            if feature not in self.measured or not self.pairs:
                continue
            counts = self._histograms[i].copy()
            counts[0] = self._comparable_pixels - counts[1:].sum()  # the GPU does not count bin 0: it is the rest
            out[feature] = {
                "edges": edges().tolist(),
                "counts": counts.tolist(),
                "at_or_above": discarded_above(counts).tolist(),
                "comparable": self._comparable_pixels,
            }
        return out


def with_reprojections(reusable: Mapping[str, Any]) -> dict[str, Any]:
    """The block ``reusable``, complete, with the rates of each reprojection by its name."""
    rates = {rate: dict(reusable[rate]) for rate in RATES}
    return dict(reusable) | {mode: reusable.get(mode, rates) for mode in OTHER_REPROJECTION}


def sensitivity(
    curves: Mapping[str, Any], thresholds: Mapping[str, float], pixels: int
) -> dict[str, dict[str, float | None]]:
    """Discards of ``direct`` and ``indirect`` at half and twice the exposure, % of all ``pixels`` of all pairs.

    The exposure multiplies every distance, so the curve at the threshold divided by the factor has them
    (``metrics.counts.discarded_at``).  None where the column was not measured or the threshold is beyond the curve.
    """
    out: dict[str, dict[str, float | None]] = {column: dict.fromkeys(EXPOSURE_FACTORS) for column in RADIANCE_FEATURES}
    for column in (c for c in RADIANCE_FEATURES if c in curves):
        for key, factor in EXPOSURE_FACTORS.items():
            discarded = discarded_at(curves[column]["counts"], thresholds[column] / factor)
            out[column][key] = None if discarded is None else 100.0 * discarded / pixels
    return out
