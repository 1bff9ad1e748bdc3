"""One set of thresholds for all scenes, fitted to the paper's Table 4: the paper does not publish its own.

Only datasets enter.  A stand-in's light and camera were fitted to the paper, so its rates say nothing about thresholds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taubench_gl.features import FEATURES
from taubench_gl.report.run_plots import discard_curve

Array = np.ndarray
Summary = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Fitted:
    """A threshold and its residuals, scene -> our rate - the paper's, percentage points."""

    threshold: float  # position: meters
    residuals: dict[str, float]

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, percentage points."""
        return float(np.sqrt(np.mean(np.square(list(self.residuals.values())))))


def curve_of(summary: Summary, feature: str) -> tuple[Array, Array] | None:
    """Thresholds, ascending, and the percentage of all pixels discarded at each; None if no curve was recorded.

    All pairs that were drawn have equal weight.
    """
    curve, settings = (summary.get("curves") or {}).get(feature), summary["settings"]
    if not curve or not curve.get("counts") or not summary.get("pairs"):
        return None
    pixels = summary["pairs"] * settings["width"] * settings["height"] * (settings.get("samples_per_pixel") or 1)
    return discard_curve(curve, pixels)


def fit_threshold(curves: Sequence[tuple[Array, Array]], wanted: Sequence[float]) -> tuple[float, Array]:
    """The threshold with the least sum of squared differences from ``wanted``, and the rates there, percent.

    Exact: between two edges every rate is linear in the logarithm of the threshold, so that the sum is a parabola with
    a closed minimum.  Curves have the same edges up to a factor; they are read at the edges of all.  Of several equal
    minima, the smallest threshold.  Raises ValueError without a curve.
    """
    edges = np.unique(np.concatenate([thresholds[thresholds > 0] for thresholds, _ in curves]))
    logs = np.log(edges)
    rates = np.stack([np.interp(logs, np.log(t[t > 0]), rate[t > 0]) for t, rate in curves])  # (scenes, edges)
    miss, slope = rates[:, :-1] - np.asarray(wanted)[:, None], np.diff(rates, axis=1)
    steep = np.sum(slope**2, axis=0)
    at = np.clip(-np.sum(slope * miss, axis=0) / np.where(steep > 0, steep, 1.0), 0.0, 1.0)
    cost = np.sum((miss + slope * at) ** 2, axis=0)
    best = int(np.argmin(cost))
    threshold = float(np.exp(logs[best] + at[best] * (logs[best + 1] - logs[best])))
    return threshold, rates[:, best] + at[best] * slope[:, best]


def fit_thresholds(runs: Mapping[str, tuple[Summary, Mapping[str, float]]]) -> dict[str, Fitted]:
    """The threshold of each feature for all scenes.  ``runs``: dataset -> summary and the paper's rates by feature.

    A feature that no run measured is left out.
    """
    out = {}
    for feature in FEATURES:
        curves = {scene: curve for scene, (summary, _) in runs.items() if (curve := curve_of(summary, feature))}
        if not curves:
            continue
        wanted = [runs[scene][1][feature] for scene in curves]
        threshold, rates = fit_threshold(list(curves.values()), wanted)
        out[feature] = Fitted(threshold, dict(zip(curves, (rates - np.array(wanted)).tolist(), strict=True)))
    return out
