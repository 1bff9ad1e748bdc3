"""Scores of a rejection test as a classifier: confusion, curves over all thresholds, and both by stratum.

Positive: history must be rejected.  Values above the threshold are rejected.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.conventions import HISTOGRAM_BINS, Visibility
from taubench_gl.metrics.counts import bin_of, discarded_above, edges
from taubench_gl.metrics.exact_rates import CHANGES
from taubench_gl.reject.contract import RejectionTest

Array = np.ndarray

TRUTHS = ("visibility", "visibility_or_shading")
"""Definitions of a positive pixel: its point was occluded or new; or that, or its light changed past a threshold."""

STRATA: dict[str, tuple[str, tuple[float, ...]]] = {
    "distance": ("m", (2.0, 5.0, 10.0, 20.0, 50.0)),
    "angle": ("degrees from the surface, 0: grazing", (5.0, 15.0, 45.0)),
    "motion": ("pixels of the point", (0.5, 2.0, 8.0)),
    "camera": ("median pixels of motion of the pair", (0.5, 2.0, 8.0)),
}
"""Unit and inner limits of the strata of surface pixels."""

OBJECTS = ("static", "moving", "deforming", "masked")
"""Classes of pixels: still; moved by more than the position threshold; skinned or morphed; of a material with alpha."""


REASONS = {"occluded": Visibility.OCCLUDED, "new": Visibility.NEW, **CHANGES}
"""Why history is wrong, the first that holds; pixels of none of them are UNCHANGED."""

UNCHANGED = "unchanged"


def stratum_names(name: str) -> tuple[str, ...]:
    """Labels of the strata of ``name``, in order."""
    if name in ("object", "reason"):
        return OBJECTS if name == "object" else (*REASONS, UNCHANGED)
    limits = [f"{x:g}" for x in STRATA[name][1]]
    return (f"below {limits[0]}", *(f"{a} to {b}" for a, b in itertools.pairwise(limits)), f"{limits[-1]} and more")


@dataclass
class Confusion:
    """Pixels by truth and answer."""

    true_positive: int = 0  # rejected, and must be
    false_positive: int = 0  # rejected, and was visible: reuse lost
    false_negative: int = 0  # kept, and must be rejected: a ghost
    true_negative: int = 0

    def add(self, rejected: Array, positive: Array) -> None:
        """Add K pixels: whether history was ``rejected``, and whether it must be (``positive``), (K,) bool."""
        self.true_positive += int(np.count_nonzero(rejected & positive))
        self.false_positive += int(np.count_nonzero(rejected & ~positive))
        self.false_negative += int(np.count_nonzero(~rejected & positive))
        self.true_negative += int(np.count_nonzero(~rejected & ~positive))

    @property
    def pixels(self) -> int:
        return self.true_positive + self.false_positive + self.false_negative + self.true_negative

    def block(self) -> dict[str, Any]:
        """JSON values; precision, recall and false positive rate are null without such pixels."""
        tp, fp, fn, tn = self.true_positive, self.false_positive, self.false_negative, self.true_negative
        return {
            "true_positive": tp, "false_positive": fp, "false_negative": fn, "true_negative": tn,
            "precision": _ratio(tp, tp + fp), "recall": _ratio(tp, tp + fn),
            "false_positive_rate": _ratio(fp, fp + tn), "rejected_percent": _ratio(100 * (tp + fp), self.pixels),
        }  # fmt: skip


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None


@dataclass
class Curve:
    """Values by truth, in the log-linear bins of distances (eight per octave)."""

    positive: Array = field(default_factory=lambda: np.zeros(HISTOGRAM_BINS, np.int64))
    negative: Array = field(default_factory=lambda: np.zeros(HISTOGRAM_BINS, np.int64))

    def add(self, values: Array, positive: Array) -> None:
        """Add K pixels: ``values`` (K,) at least 0, may be infinite; ``positive`` (K,) bool."""
        bins = bin_of(values)
        self.positive += np.bincount(bins[positive], minlength=HISTOGRAM_BINS)
        self.negative += np.bincount(bins[~positive], minlength=HISTOGRAM_BINS)

    def rates(self) -> tuple[Array, Array, Array]:
        """Thresholds (T,) ascending, recall (T,) and false positive rate (T,): at or above each threshold."""
        tp, fp = discarded_above(self.positive), discarded_above(self.negative)
        return edges(), tp / max(self.positive.sum(), 1), fp / max(self.negative.sum(), 1)

    def precision(self) -> Array:
        """Precision at or above each threshold, (T,); NaN where nothing is rejected."""
        tp, fp = discarded_above(self.positive), discarded_above(self.negative)
        with np.errstate(invalid="ignore"):
            return tp / (tp + fp)

    def area(self) -> float | None:
        """Area under the ROC curve; None without both kinds of pixels.  Ties within a bin count half."""
        if not (self.positive.sum() and self.negative.sum()):
            return None
        below = np.concatenate([[0], np.cumsum(self.negative)[:-1]])
        wins = (self.positive * (below + 0.5 * self.negative)).sum()
        return float(wins / (self.positive.sum() * self.negative.sum()))

    def threshold_for(self, recall: float) -> float | None:
        """The largest bin edge at which at least ``recall`` of the positive pixels are rejected; None if none is."""
        thresholds, reached, _ = self.rates()
        reaching = np.flatnonzero(reached >= recall)
        return float(thresholds[reaching[-1]]) if len(reaching) and self.positive.sum() else None

    def block(self, every: int = 4) -> dict[str, Any]:
        """JSON values: ``threshold``, ``recall``, ``false_positive_rate``, ``precision`` at every ``every``-th edge."""
        thresholds, recall, wrong = self.rates()
        precision = [None if np.isnan(p) else float(p) for p in self.precision()]
        rows = slice(None, None, every)
        return {
            "threshold": thresholds[rows].tolist(), "recall": recall[rows].tolist(),
            "false_positive_rate": wrong[rows].tolist(), "precision": precision[rows], "area": self.area(),
        }  # fmt: skip


@dataclass
class Scores:
    """Scores of one test: confusion at its threshold and curve by truth, and the confusion of every stratum."""

    test: RejectionTest
    confusion: dict[str, Confusion]
    curves: dict[str, Curve]
    strata: dict[str, list[Confusion]] = field(default_factory=dict)

    @classmethod
    def of(cls, test: RejectionTest, truths: Sequence[str]) -> Scores:
        """Scores of ``test`` before the first pixel; ``truths``: names of TRUTHS."""
        strata = {name: [Confusion() for _ in stratum_names(name)] for name in (*STRATA, "object", "reason")}
        return cls(test, {t: Confusion() for t in truths}, {t: Curve() for t in truths}, strata)

    def add(self, values: Array, truth: dict[str, Array], strata: dict[str, Array]) -> None:
        """Add K pixels: ``values`` (K,); ``truth``: name -> (K,) bool; ``strata``: name -> (K,) row of the stratum."""
        rejected = values > self.test.threshold
        for name, positive in truth.items():
            self.confusion[name].add(rejected, positive)
            self.curves[name].add(values, positive)
        first = truth[self.truth]
        for name, rows in strata.items():
            for row in np.unique(rows):
                at = rows == row
                self.strata[name][row].add(rejected[at], first[at])

    @property
    def truth(self) -> str:
        """The truth that strata and fits refer to: visibility for geometry, both for color."""
        return TRUTHS[1] if self.test.kind == "color" and TRUTHS[1] in self.confusion else TRUTHS[0]

    def block(self, milliseconds: float | None) -> dict[str, Any]:
        """The block of the test in reject.json, JSON values; ``milliseconds``: of its pass, None: not measured."""
        test = self.test
        return {
            "title": test.title, "kind": test.kind, "unit": test.unit, "threshold": test.threshold, "cite": test.cite,
            "settings": dict(test.settings), "parts": [p.name for p in test.parts], "milliseconds": milliseconds,
            "truth": self.truth,
            "scores": {name: c.block() for name, c in self.confusion.items()},
            "curves": {name: c.block() for name, c in self.curves.items()},
            "strata": {
                name: {label: c.block() | {"pixels": c.pixels} for label, c in zip(stratum_names(name), rows)}
                for name, rows in self.strata.items()
            },
        }  # fmt: skip
