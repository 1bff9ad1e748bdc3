"""The reuse rate of frame pairs: the share of pixels whose history is valid, and disjoint reasons for the others.

Two rates, both exact from the mask histogram:

- ``surface``: pixels without FIRST, CUT, INVALID, BEHIND, OUTSIDE, POSITION or NORMAL.
- ``shading``: of these, the pixels without DIRECT or INDIRECT.

Color is not part of a rate, because it depends on the tone map.  Sky that reprojects onto sky is reusable.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.glossary import REUSE_REASONS

Array = np.ndarray

RATES = ("surface", "shading")

RATE_BITS = {"surface": NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL}
RATE_BITS["shading"] = RATE_BITS["surface"] | Reason.DIRECT | Reason.INDIRECT
"""Reasons of which a rate counts no pixel."""

RATE_COLUMNS = {"surface": ("frustum", "position", "normal")}
"""The columns of Table 4 that a rate needs."""
RATE_COLUMNS["shading"] = (*RATE_COLUMNS["surface"], "direct", "indirect")

LIGHT_REASONS = frozenset({Reason.LIT, Reason.SHADOWED, Reason.DIRECT, Reason.INDIRECT})
"""Reasons that only ``shading`` has."""


def reusable_pixels(mask_histogram: Array) -> dict[str, int]:
    """Reusable pixels of each rate from the mask histogram.  (65536,) pixels per reason word -> {rate: int}."""
    words, pixels = occupied(mask_histogram)
    return {rate: int(pixels[(words & int(bits)) == 0].sum()) for rate, bits in RATE_BITS.items()}


def disjoint_reasons(mask_histogram: Array, rate: str = "shading") -> dict[str, int]:
    """Pixels that ``rate`` does not count, by the first of ``REUSE_REASONS`` that applies.  (65536,) -> {reason: int}.

    With ``reusable_pixels(...)[rate]`` the values add up to all pixels.
    """
    words, pixels = occupied(mask_histogram)
    counts = np.zeros(len(_reasons_of(rate)) + 1, dtype=np.int64)
    np.add.at(counts, _first_reason(rate)[words], pixels)
    return {name: count for (_, name), count in zip(_reasons_of(rate), counts.tolist())}


def unmeasured_rates(reasons: Mapping[str, str]) -> dict[str, str]:
    """Rates that are null, and why.  ``reasons``: column -> why it was not measured."""
    out = {}
    for rate, columns in RATE_COLUMNS.items():
        absent = [f"{column}: {reasons[column]}" for column in columns if column in reasons]
        if absent:
            out[rate] = "; ".join(absent)
    return out


class ReuseStats:
    """Adds pairs up.  ``unmeasured``: column of Table 4 -> why it was not measured."""

    def __init__(self, unmeasured: Mapping[str, str]):
        self.missing = unmeasured_rates(unmeasured)
        measured = [rate for rate in RATES if rate not in self.missing]
        self.rate = measured[-1] if measured else None  # the rate that the reasons refer to
        self._with_color = self.rate == "shading" and "color" not in unmeasured
        self._pixels: list[int] = []  # of each pair, like all that follow
        self._comparable: list[int] = []
        self._counts: dict[str, list[int]] = {rate: [] for rate in measured}
        self._reasons: dict[str, list[int]] = {} if self.rate is None else {n: [] for _, n in _reasons_of(self.rate)}
        self._color_only: list[int] = []
        self._histogram = np.zeros(1 << 16, dtype=np.int64)

    def add(self, mask_histogram: Array) -> None:
        """Add one pair.  (65536,) pixels per reason word."""
        words, pixels = occupied(mask_histogram)
        self._histogram[words] += pixels
        self._pixels.append(int(pixels.sum()))
        self._comparable.append(int(pixels[(words & int(NOT_COMPARABLE)) == 0].sum()))
        counted = reusable_pixels(mask_histogram)
        for rate, values in self._counts.items():
            values.append(counted[rate])
        if self.rate is not None:
            for name, value in disjoint_reasons(mask_histogram, self.rate).items():
                self._reasons[name].append(value)
        if self._with_color:
            kept = (words & int(RATE_BITS["shading"])) == 0
            self._color_only.append(int(pixels[kept & ((words & int(Reason.COLOR)) != 0)].sum()))

    def per_pair(self, rate: str) -> Array:
        """Percentages of all pixels of every pair, in order.  (pairs,) float64; empty where not measured."""
        return self._percent(self._counts.get(rate, []))

    def block(self, reprojection: str, cuts: Array, weights: Array | None = None) -> dict[str, Any]:
        """The block ``reusable`` of a summary.

        ``cuts`` (pairs,) bool: pairs left out of ``without_cuts_mean_percent``.  ``weights`` (pairs,) float64: weights
        of the pairs in a mean, with the sum 1; None: equal weights.
        """
        out: dict[str, Any] = {rate: self._rate(rate, cuts, weights) for rate in RATES}
        found = self.rate is not None and bool(self._pixels)
        out |= {"reprojection": reprojection, "reasons_of": self.rate if found else None, "reasons": {}}
        if found:
            out["reasons"] = {name: self._share(values, weights) for name, values in self._reasons.items()}
        out["color_only"] = self._share(self._color_only, weights) if self._color_only else None
        return out

    def histogram(self) -> dict[str, list[int]]:
        """The mask histogram of all pairs: ``words`` that occur, ascending, and their ``pixels``."""
        words, pixels = occupied(self._histogram)
        return {"words": words.tolist(), "pixels": pixels.tolist()}

    def _rate(self, rate: str, cuts: Array, weights: Array | None) -> dict[str, Any]:
        keys = ("mean_percent", "comparable_mean_percent", "min_percent", "max_percent", "without_cuts_mean_percent")
        if rate in self.missing or not self._pixels:
            reason = self.missing.get(rate, "the scene gives no pair of frames")
            return {**dict.fromkeys(keys), "pixels": None, "reason": reason}
        shares, kept = self.per_pair(rate), self.per_pair(rate)[~np.asarray(cuts, dtype=bool)]
        counts, comparable = np.array(self._counts[rate], np.float64), np.array(self._comparable, np.float64)
        of_comparable = 100.0 * counts[comparable > 0] / comparable[comparable > 0]
        means = (_mean(shares, weights), of_comparable.mean() if len(of_comparable) else None)
        values = (*means, shares.min(), shares.max(), kept.mean() if len(kept) else None)
        numbers = {key: None if value is None else float(value) for key, value in zip(keys, values, strict=True)}
        return numbers | {"pixels": sum(self._counts[rate])}

    def _share(self, counts: list[int], weights: Array | None) -> dict[str, Any]:
        return {"mean_percent": _mean(self._percent(counts), weights), "pixels": sum(counts)}

    def _percent(self, counts: list[int]) -> Array:
        return 100.0 * np.array(counts, np.float64) / np.array(self._pixels[: len(counts)], np.float64)


def occupied(mask_histogram: Array) -> tuple[Array, Array]:
    """Reason words that occur, a few dozen of the 65536, and their pixels.  (65536,) -> two (n,) int64."""
    pixels = np.asarray(mask_histogram)
    words = np.flatnonzero(pixels != 0)  # of the comparison: five times as fast as of the integers
    return words, pixels[words].astype(np.int64)


@cache
def _first_reason(rate: str) -> Array:
    """Index of the reason of each word in ``_reasons_of(rate)``, one past the end without any.  (65536,) int64."""
    words, reasons = np.arange(1 << 16), _reasons_of(rate)
    out = np.full(1 << 16, len(reasons))
    for index, (bit, _) in reversed(list(enumerate(reasons))):
        out[(words & int(bit)) != 0] = index
    out[(words & int(RATE_BITS[rate])) == 0] = len(reasons)
    return out


@cache
def _reasons_of(rate: str) -> list[tuple[Reason, str]]:
    """Bits and names of the reasons of a rate, in order."""
    shown = REUSE_REASONS.items()
    return [(bit, term.key) for bit, term in shown if rate == "shading" or bit not in LIGHT_REASONS]


def _mean(values: Array, weights: Array | None) -> float:
    return float(values.mean() if weights is None else weights @ values)
