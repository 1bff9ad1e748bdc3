"""What one method did: numbers per frame, and their summary."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.reuse import quality
from taubench_gl.reuse.classes import ClassErrors

Array = np.ndarray

ROW_COLUMNS = (
    "frame", "method", "psnr_db", "ssim", "flip", "relmse", "tpsnr_db", "flicker", "reused_percent", "mean_weight",
    "wrongly_reused_percent", "wrongly_rejected_percent", "time_ms", "invalid_pixels",
)  # fmt: skip
"""frames.csv, one row per frame and method.  An empty cell was not measured."""

NO_WEIGHT = "the method does not say how much history a pixel holds (its result's alpha is -1)"
NO_TRUTH = "no noise-free mask of these frames to judge by"
NOT_ASKED = "not asked for"
EQUAL = "equal to the reference: infinite"


@dataclass(frozen=True, slots=True)
class Shown:
    """One frame as it is judged: linear radiance and shown colours, (h, w, 3), finite throughout."""

    radiance: Array
    colors: Array
    usable: Array  # (h, w) bool: finite in the picture and in its reference; black elsewhere


@dataclass(slots=True)
class MethodRecord:
    """Collects one method's frames.  ``judged``: whether a noise-free mask exists; ``metrics`` of quality.CHOICES."""

    label: str
    metrics: frozenset[str]
    judged: bool
    rows: list[dict[str, Any]] = field(default_factory=list)
    classes: ClassErrors = field(default_factory=ClassErrors)
    failed: str | None = None
    _mse: list[float] = field(default_factory=list)
    _temporal_mse: list[float] = field(default_factory=list)
    _before: Shown | None = None

    def add(
        self,
        frame: int,
        shown: Shown,
        weight: Array,
        reference: Shown,
        reference_before: Shown | None,
        mask: Array,
        classes: Array,
        motion_px: Array,
        time_ms: float | None,
        invalid: int,
    ) -> Array:
        """Judge one frame.  Returns its error map, (h, w) in [0, 1]: FLIP, or where that is off four times |error|."""
        square = quality.squared_error(shown.colors, reference.colors)
        relative = quality.relative_squared_error(shown.radiance, reference.radiance)
        errors = {"mse": square, "relmse": relative}
        row: dict[str, Any] = dict.fromkeys(ROW_COLUMNS)
        row |= {"frame": frame, "method": self.label, "time_ms": time_ms, "invalid_pixels": invalid}
        row |= {"psnr_db": quality.psnr(float(square.mean())), "relmse": float(relative.mean())}
        if "ssim" in self.metrics:
            row["ssim"] = quality.ssim(shown.colors, reference.colors)
        if "flip" in self.metrics:
            errors["flip"] = quality.flip_map(shown.colors, reference.colors)
            row["flip"] = float(errors["flip"].mean())
        allowed = quality.reusable(mask)
        if self._before is not None:  # from the second frame on: there is a history to hold or not
            self._mse.append(float(square.mean()))
            self.classes.add(classes, errors)
            row |= self._temporal(shown, reference, reference_before, motion_px, allowed)
            row |= weights(weight, allowed if self.judged else None)
        self._before = shown
        self.rows.append(row)
        return errors.get("flip", np.clip(4.0 * np.sqrt(square), 0.0, 1.0))

    def _temporal(
        self, shown: Shown, reference: Shown, before: Shown, motion_px: Array, allowed: Array
    ) -> dict[str, float | None]:
        out: dict[str, float | None] = {}
        pictures = shown.colors, self._before.colors, reference.colors, before.colors
        if "tpsnr" in self.metrics:
            error = quality.temporal_squared_error(*pictures)
            self._temporal_mse.append(float(np.where(shown.usable & self._before.usable, error, 0.0).mean()))
            out["tpsnr_db"] = quality.psnr(self._temporal_mse[-1])
        if "flicker" in self.metrics:
            seen = shown.usable & quality.history_of(self._before.usable, motion_px)
            out["flicker"] = quality.flicker(*pictures, motion_px, allowed & seen)
        return out

    def summary(self) -> dict[str, Any]:
        """Means over all frames but the first; ``reasons`` says why a value is None."""
        kept = self.rows[1:]
        if self.failed is not None or not kept:
            return {"failed": self.failed or "fewer than two frames", "frames": len(self.rows)}
        mean = {n: _mean(kept, n) for n in ("ssim", "flip", "relmse", "flicker")}
        mean |= {"psnr_db": quality.psnr(float(np.mean(self._mse)))}
        mean["tpsnr_db"] = quality.psnr(float(np.mean(self._temporal_mse))) if self._temporal_mse else None
        mean = {name: mean[name] for name in quality.MEASURES}
        reuse = {n: _mean(kept, n) for n in ("reused_percent", "mean_weight")}
        reuse |= {n: _mean(kept, n) for n in ("wrongly_reused_percent", "wrongly_rejected_percent")}
        times = [row["time_ms"] for row in kept if row["time_ms"] is not None]
        return {
            "failed": None,
            "frames": len(self.rows),
            "mean": mean,
            "reuse": reuse,
            "classes": self.classes.summary(),
            "time_ms": statistics.median(times) if times else None,
            "invalid_pixels": sum(row["invalid_pixels"] for row in self.rows),
            "reasons": self._reasons(mean, reuse),
        }

    def _reasons(self, mean: dict[str, Any], reuse: dict[str, Any]) -> dict[str, str]:
        out = {}
        for name, value in mean.items():
            if value is None:
                asked = name.removesuffix("_db") in self.metrics or name in ("psnr_db", "relmse")
                small = "the picture is smaller than SSIM's window of 11 pixels"
                known = {"ssim": small, "flicker": "the truth lets no pixel be reused"}
                out[name] = NOT_ASKED if not asked else known.get(name, EQUAL)
        for name, value in reuse.items():
            if value is None:
                out[name] = NO_WEIGHT if reuse["mean_weight"] is None else NO_TRUTH
        return out


def weights(weight: Array, allowed: Array | None) -> dict[str, float | None]:
    """Reuse of one frame from the history weights (h, w) a method reports, percent of w·h; None where it says nothing.

    A pixel is *reused* where its weight is above 0; wrongly so where the truth does not allow it, and *wrongly
    rejected* where the truth would have.  ``allowed`` None: there is no truth.
    """
    names = ("reused_percent", "mean_weight", "wrongly_reused_percent", "wrongly_rejected_percent")
    if (weight < 0).any():
        return dict.fromkeys(names)
    weight = np.where(np.isfinite(weight), weight, 0.0)  # NaN where the radiance is: nothing of it is history
    reused = weight > 0
    wrong = (None, None) if allowed is None else (_percent(reused & ~allowed), _percent(~reused & allowed))
    return dict(zip(names, (_percent(reused), float(weight.mean()), *wrong), strict=True))


def _percent(which: Array) -> float:
    return 100.0 * float(np.count_nonzero(which)) / which.size


def _mean(rows: list[dict[str, Any]], name: str) -> float | None:
    """Mean of a column, over the frames that have it."""
    values = [row[name] for row in rows if row[name] is not None]
    return float(np.mean(values)) if values else None
