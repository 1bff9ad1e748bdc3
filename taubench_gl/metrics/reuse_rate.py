"""The reuse rate of frame pairs: the share of surface pixels whose history is valid, and disjoint reasons for others.

A surface pixel shows a surface in the current frame: it has no bit SKY.  Two rates, both exact from the mask histogram:

- ``surface``: surface pixels without FIRST, CUT, INVALID, BEHIND, OUTSIDE, POSITION or NORMAL.
- ``shading``: of these, the pixels without DIRECT or INDIRECT.

Color is not part of a rate, because it depends on the tone map.  Sky is not part of a rate: it has nothing to shade.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.features import BY_BIT, COLUMN_BITS, MASK_WORDS, TABLE
from taubench_gl.glossary import REUSE_REASONS

Array = np.ndarray

RATES = ("surface", "shading")

RATE_BITS = {rate: NOT_COMPARABLE | sum(f.bit for f in TABLE if rate in f.rates) for rate in RATES}
"""Reasons that no pixel of a rate has."""

NO_SURFACE = "no pixel shows a surface"

RATE_COLUMNS = {rate: ("frustum", *(f.name for f in BY_BIT if rate in f.rates)) for rate in RATES}
"""The columns of Table 4 that a rate needs."""

LIGHT_REASONS = frozenset(bit for f in TABLE if f.rates == ("shading",) for bit in (f.bit, *f.details))
"""Reasons that only ``shading`` has."""


def reusable_pixels(mask_histogram: Array) -> dict[str, int]:
    """Reusable surface pixels of each rate.  (MASK_WORDS,) pixels per reason word -> {rate: int}."""
    words, pixels = occupied(mask_histogram)
    return {rate: int(pixels[(words & int(bits | Reason.SKY)) == 0].sum()) for rate, bits in RATE_BITS.items()}


def disjoint_reasons(mask_histogram: Array, rate: str = "shading") -> dict[str, int]:
    """Surface pixels that ``rate`` does not count, by the first of ``REUSE_REASONS`` that applies: {reason: int}.

    ``mask_histogram``: (MASK_WORDS,).  With ``reusable_pixels(...)[rate]`` the values add up to all surface pixels.
    """
    words, pixels = occupied(mask_histogram)
    first, names = first_reasons(rate)
    counts = np.zeros(len(names) + 1, dtype=np.int64)
    np.add.at(counts, first[words], pixels)
    return dict(zip(names, counts.tolist()))


def surface_pixels(mask_histogram: Array) -> int:
    """Pixels that show a surface.  (MASK_WORDS,) pixels per reason word -> int."""
    words, pixels = occupied(mask_histogram)
    return int(pixels[(words & int(Reason.SKY)) == 0].sum())


def unmeasured_rates(reasons: Mapping[str, str]) -> dict[str, str]:
    """Rates that are null, and why.  ``reasons``: column -> why it was not measured."""
    out = {}
    for rate, columns in RATE_COLUMNS.items():
        absent = [f"{column}: {reasons[column]}" for column in columns if column in reasons]
        if absent:
            out[rate] = "; ".join(absent)
    return out


_RATE_KEYS = ("mean_percent", "of_picture_percent", "min_percent", "max_percent", "without_cuts_mean_percent")


def unmeasured_rate(reason: str) -> dict[str, Any]:
    """The entry of a rate that is null for ``reason``."""
    return {**dict.fromkeys(_RATE_KEYS), "pixels": None, "reason": reason}


class ReuseStats:
    """Adds up the reusable and discarded pixels of pairs.  ``unmeasured``: column of Table 4 -> why it was not
    measured.
    """

    def __init__(self, unmeasured: Mapping[str, str]):
        self.missing = unmeasured_rates(unmeasured)
        measured = [rate for rate in RATES if rate not in self.missing]
        self.rate = measured[-1] if measured else None  # the rate that the reasons refer to
        self._with_color = self.rate == "shading" and "color" not in unmeasured
        self._with_sky = "position" not in unmeasured
        self._pixels: list[int] = []  # of each pair, like all that follow
        self._surface: list[int] = []
        self._counts: dict[str, list[int]] = {rate: [] for rate in measured}
        self._reasons: dict[str, list[int]] = {} if self.rate is None else {n: [] for n in first_reasons(self.rate)[1]}
        self._color_only: list[int] = []
        self._discarded: dict[str, list[int]] = {c: [] for c in COLUMN_BITS if c not in unmeasured}
        self._histogram = np.zeros(MASK_WORDS, dtype=np.int64)

    def add(self, mask_histogram: Array) -> None:
        """Add the pixels of one pair by reason word, (MASK_WORDS,)."""
        words, pixels = occupied(mask_histogram)
        self._histogram[words] += pixels
        self._pixels.append(int(pixels.sum()))
        self._surface.append(surface_pixels(mask_histogram))
        reusable_of = reusable_pixels(mask_histogram)
        for rate, values in self._counts.items():
            values.append(reusable_of[rate])
        if self.rate is not None:
            for name, value in disjoint_reasons(mask_histogram, self.rate).items():
                self._reasons[name].append(value)
        for column, values in self._discarded.items():
            values.append(
                int(pixels[((words & int(COLUMN_BITS[column])) != 0) & ((words & int(Reason.SKY)) == 0)].sum())
            )
        if self._with_color:
            reusable = (words & int(RATE_BITS["shading"] | Reason.SKY)) == 0
            self._color_only.append(int(pixels[reusable & ((words & int(Reason.COLOR)) != 0)].sum()))

    def residuals(self, rate: str, weights: Array) -> Array:
        """Linearized deviations of each pair from the rate, percentage points: their mean has the rate's interval.

        (y - R x) / mean(x) with y reusable and x surface pixels of a pair and R the rate: the combined ratio estimate
        (Cochran, *Sampling Techniques*, 3rd ed. 1977, section 6.11).  ``weights``: as in ``block``.  (pairs,) float64.
        Raises ValueError where no pixel shows a surface.
        """
        y, x = np.array(self._counts[rate], np.float64), np.array(self._surface, np.float64)
        mean = float(weights @ x)
        if not mean:
            raise ValueError(NO_SURFACE)
        return 100.0 * (y - (weights @ y) / mean * x) / mean

    def block(self, reprojection: str, cuts: Array, weights: Array | None = None) -> dict[str, Any]:
        """The block ``reusable`` of a summary; every share is a total over a total.

        ``cuts`` (pairs,) bool: pairs left out of ``without_cuts_mean_percent``.  ``weights`` (pairs,) float64: weights
        of the pairs, with the sum 1; None: equal weights.
        """
        weights = np.ones(len(self._pixels)) if weights is None else weights
        out: dict[str, Any] = self.rates(cuts, weights)
        sky = [pixels - surface for pixels, surface in zip(self._pixels, self._surface, strict=True)]
        out["sky_percent"] = _percent(sky, self._pixels, weights) if self._with_sky else None
        measured = self.rate is not None and self.has_surface
        out |= {"reprojection": reprojection, "reasons_of": self.rate if measured else None, "reasons": {}}
        if measured:
            out["reasons"] = {name: self._share(values, weights) for name, values in self._reasons.items()}
        out["color_only"] = self._share(self._color_only, weights) if measured and self._with_color else None
        return out

    def rates(self, cuts: Array, weights: Array | None = None) -> dict[str, Any]:
        """Rate -> its entry in ``block``.  ``cuts``, ``weights``: as of ``block``."""
        weights = np.ones(len(self._pixels)) if weights is None else weights
        return {rate: self._rate(rate, cuts, weights) for rate in RATES}

    def discarded(self, weights: Array | None = None) -> dict[str, float | None]:
        """Column -> surface pixels that it discards, % of surface pixels.  ``weights``: as of ``block``."""
        weights = np.ones(len(self._pixels)) if weights is None else weights
        return {column: _percent(values, self._surface, weights) for column, values in self._discarded.items()}

    @property
    def pixels(self) -> int:
        """Number of pixels of all pairs together."""
        return sum(self._pixels)

    @property
    def has_surface(self) -> bool:
        """Whether any pixel shows a surface."""
        return any(self._surface)

    def histogram(self) -> dict[str, list[int]]:
        """The mask histogram of all pairs: ``words`` that occur, ascending, and their ``pixels``."""
        words, pixels = occupied(self._histogram)
        return {"words": words.tolist(), "pixels": pixels.tolist()}

    def _rate(self, rate: str, cuts: Array, weights: Array) -> dict[str, Any]:
        if rate in self.missing or not self.has_surface:
            return unmeasured_rate(
                self.missing.get(rate, NO_SURFACE if self._pixels else "the scene gives no pair of frames")
            )
        counts, surface = np.array(self._counts[rate], np.float64), np.array(self._surface, np.float64)
        shares = 100.0 * counts[surface > 0] / surface[surface > 0]
        weights_without_cuts = weights * ~np.asarray(cuts, dtype=bool)
        values = (
            _percent(counts, surface, weights), _percent(counts, self._pixels, weights),
            float(shares.min()), float(shares.max()), _percent(counts, surface, weights_without_cuts),
        )  # fmt: skip
        return dict(zip(_RATE_KEYS, values, strict=True)) | {"pixels": sum(self._counts[rate])}

    def _share(self, counts: list[int], weights: Array) -> dict[str, Any]:
        return {"mean_percent": _percent(counts, self._surface, weights), "pixels": sum(counts)}


def occupied(mask_histogram: Array) -> tuple[Array, Array]:
    """Reason words that occur, a few dozen of MASK_WORDS, and their pixels.  (MASK_WORDS,) -> two (n,) int64."""
    pixels = np.asarray(mask_histogram)
    words = np.flatnonzero(pixels != 0)  # of the comparison: five times as fast as of the integers
    return words, pixels[words].astype(np.int64)


@cache
def first_reasons(rate: str) -> tuple[Array, tuple[str, ...]]:
    """Index of each word's first reason among the names of a rate's reasons, (MASK_WORDS,) int64, and these names.

    None and sky have the index after the last.
    """
    reasons = [item for item in REUSE_REASONS.items() if rate == "shading" or item[0] not in LIGHT_REASONS]
    words = np.arange(MASK_WORDS)
    out = np.full(MASK_WORDS, len(reasons))
    for index, (bit, _) in reversed(list(enumerate(reasons))):
        out[(words & int(bit)) != 0] = index
    out[((words & int(RATE_BITS[rate])) == 0) | ((words & int(Reason.SKY)) != 0)] = len(reasons)
    return out, tuple(term.key for _, term in reasons)


def _percent(counts: Sequence[int] | Array, base: Sequence[int] | Array, weights: Array) -> float | None:
    """Weighted total of ``counts`` in percent of that of ``base``; None where that is 0."""
    whole = float(weights @ np.array(base, np.float64))
    return 100.0 * float(weights @ np.array(counts, np.float64)) / whole if whole else None
