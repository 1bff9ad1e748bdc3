"""The bound of a method: its own reprojected history and input, blended by the best weight of every pixel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.metrics.blending import blend, effective_weight, nearest_weight, on_segment, used_history

Array = np.ndarray

NO_HISTORY = (
    "the method does not report reprojected_history, the color that it fetched along the motion (or, if its input has "
    "another size, blend_input)"
)
EXACT = "the bound equals the reference"
NO_PIXEL = "no pixel has history"


def decibels(error: float, bound: float) -> float | None:
    """10 log10(error / bound); None where the bound is 0 or nothing is left to gain from 0."""
    return float(10.0 * np.log10(error / bound)) if bound > 0 and error > 0 else None


@dataclass(frozen=True, slots=True)
class Blended:
    """What one method blended in one frame, linear radiance (h, w, 3).

    ``has_history`` (h, w) bool: the method fetched history there; ``fetched`` is the input elsewhere.  ``used``:
    history after rectification, None where the method does not report it.
    """

    now: Array
    fetched: Array
    has_history: Array
    used: Array | None

    @classmethod
    def of(cls, radiance: Array, reported: Mapping[str, Array]) -> Blended | None:
        """``radiance`` (h, w, 4) of the frame; ``reported`` of ``MethodRunner.reported``; None: not reported."""
        history = reported.get("reprojected_history")
        if history is None:
            return None
        now = reported.get("blend_input", radiance)[..., :3].astype(np.float64)
        if now.shape[:2] != history.shape[:2]:  # an upscaler
            return None
        has_history = history[..., 3] > 0.5
        used = reported.get("rectified_history")
        used = None if used is None else np.where(has_history[..., None], used[..., :3], now)
        return cls(now, np.where(has_history[..., None], history[..., :3], now), has_history, used)

    def masked(self, valid: Array) -> tuple[Blended, Array]:
        """Black outside ``valid`` and where input or history is not finite; and the other pixels, (h, w) bool."""
        keep = valid & np.isfinite(self.now).all(axis=-1) & np.isfinite(self.fetched).all(axis=-1)
        now, fetched, used = (
            None if x is None else np.where(keep[..., None], x, 0.0) for x in (self.now, self.fetched, self.used)
        )
        return Blended(now, fetched, self.has_history & keep, used), keep

    def best(self, reference: Array) -> tuple[Array, Array]:
        """The blend nearest to ``reference`` (h, w, 3) in every pixel, and its weight of history, (h, w)."""
        weight = nearest_weight(reference, self.now, self.fetched)
        return blend(self.now, self.fetched, weight), weight


@dataclass(frozen=True, slots=True)
class BoundFrame:
    """The bound of one frame.  Mean squared errors are means over channels and all pixels, linear radiance.

    ``mse`` of the bound, ``method_mse`` of the method over the same pixels; ``weight``: mean of the best weight;
    ``blended_percent``: pixels whose result is a blend of input and history; ``effective_weight``: mean over all
    pixels, None where the method reports no weight.
    """

    mse: float
    method_mse: float
    weight: float
    blended_percent: float
    effective_weight: float | None

    @property
    def row(self) -> dict[str, float | None]:
        """The columns of frames.csv."""
        return {
            "bound_linear_mse": self.mse,
            "headroom_db": decibels(self.method_mse, self.mse),
            "bound_weight": self.weight,
            "blended_percent": self.blended_percent,
            "effective_weight": self.effective_weight,
        }


def bound_of_frame(blended: Blended, result: Array, reference: Array, valid: Array) -> BoundFrame:
    """``result`` (h, w, 4): radiance and weight of history; ``reference`` (h, w, 3); ``valid`` (h, w) bool."""
    blended, keep = blended.masked(valid)
    shown, reference = (np.where(keep[..., None], x, 0.0) for x in (result[..., :3].astype(np.float64), reference))
    now, fetched, (image, best) = blended.now, blended.fetched, blended.best(reference)
    error = np.mean((image - reference) ** 2)
    method_mse = np.mean((shown - reference) ** 2)
    effective = None
    if not (result[..., 3] < 0).any():
        weight = np.where(blended.has_history, result[..., 3], 0.0).astype(np.float64)
        used = used_history(shown, now, fetched, weight) if blended.used is None else blended.used
        effective = float(effective_weight(weight, now, fetched, used).mean())
    share = 100.0 * float(np.mean(on_segment(shown, now, fetched)))
    return BoundFrame(float(error), float(method_mse), float(best.mean()), share, effective)


@dataclass(slots=True)
class BoundRecord:
    """Bounds of the counted frames of one method, all seeds."""

    frames: list[BoundFrame] = field(default_factory=list)

    def summary(self) -> dict[str, Any] | None:
        """The block ``bound`` of a method in reuse.json; None where it reports no history.

        ``blends``: every pixel of every frame is a blend, so the method cannot be better than its bound.
        """
        if not self.frames:
            return None
        bound, method_mse = (float(np.mean([getattr(f, name) for f in self.frames])) for name in ("mse", "method_mse"))
        share = float(np.mean([f.blended_percent for f in self.frames]))
        return {
            "linear_mse": bound,
            "method_linear_mse": method_mse,
            "headroom_linear_mse": method_mse - bound,
            "headroom_db": decibels(method_mse, bound),
            "weight": float(np.mean([f.weight for f in self.frames])),
            "blended_percent": share,
            "blends": all(f.blended_percent == 100.0 for f in self.frames),
        }
