"""Feature errors between the saved channels of two runs, accumulated frame by frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

Array = np.ndarray

PER_FRAME = 1 << 16
"""Errors stored per frame and feature, of every n-th pixel, for the quantiles.  Sums use all pixels."""

DARK = 0.01
"""Relative radiance errors divide by the larger of the pixel's radiance and this share of the frame's mean."""

UNITS = {
    "position_mm": "mm", "normal_deg": "degrees", "direct_percent": "% of the second's",
    "indirect_percent": "% of the second's", "color_levels": "8-bit levels",
}  # fmt: skip
QUANTILES = {"median": 50.0, "p75": 75.0, "p95": 95.0, "p99": 99.0}


class FeatureErrors:
    """Error distributions of every feature that both runs have.

    Motion is none of them: a run computes it from its positions and cameras.  ``pathtraced.check``
    compares the motion of files.

    Position errors cover pixels where both runs have a surface.  All other errors cover only pixels whose surfaces lie
    within ``same_place_m`` meters of each other (the position threshold): elsewhere the runs show different surfaces,
    which the position error and the masks already count.  ``unit_scale``: scene units per meter.
    """

    def __init__(self, same_place_m: float, unit_scale: float = 1.0):
        self._same_place, self._unit_scale = same_place_m, unit_scale
        self._values: dict[str, list[Array]] = {}
        self._largest: dict[str, float] = {}
        self._sums: dict[str, Array] = {}  # of |a - b|, of |b|, of pixels

    def add(self, first: Mapping[str, Array], second: Mapping[str, Array]) -> None:
        """Add one frame: channels as ``--save channels`` stores them, (h, w, components), positions camera-relative."""
        p, q = first["position"], second["position"]
        both = (p[..., 3] > 0) & (q[..., 3] > 0)
        distance = p[..., :3].astype(np.float64) - q[..., :3] + (first["camera_position"] - second["camera_position"])
        distance = np.linalg.norm(np.where(both[..., None], distance, 0.0), axis=-1) / self._unit_scale
        self._keep("position_mm", 1e3 * distance[both])
        same = both & (distance < self._same_place)
        if "normal" in first and "normal" in second:
            chord = np.linalg.norm(first["normal"][same, :3].astype(np.float64) - second["normal"][same, :3], axis=-1)
            self._keep("normal_deg", np.degrees(2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))))
        for name in ("direct", "indirect"):
            if name in first and name in second:
                self._radiance(f"{name}_percent", first[name][same, :3], second[name][same, :3])
        if "color" in first and "color" in second:
            shown = np.abs(first["color"][same, :3].astype(np.float64) - second["color"][same, :3])
            self._keep("color_levels", 255.0 * shown.max(axis=-1, initial=0.0))

    def summary(self) -> dict[str, Any]:
        """feature -> median, p75, p95, p99, max, mean, pixels, unit; for radiance also ``total_percent``."""
        out = {}
        for name, parts in self._values.items():
            values = np.concatenate(parts)
            if not len(values):
                continue
            total, reference, pixels = self._sums[name]
            entry: dict[str, Any] = {n: float(np.percentile(values, at)) for n, at in QUANTILES.items()}
            entry |= {"max": self._largest[name], "pixels": int(pixels), "unit": UNITS[name]}
            if name.endswith("_percent"):
                entry["total_percent"] = float(100.0 * total / reference) if reference > 0 else None
            else:
                entry["mean"] = float(total / pixels)
            out[name] = entry
        return out

    def _radiance(self, name: str, a: Array, b: Array) -> None:
        error = np.linalg.norm(a.astype(np.float64) - b, axis=-1)
        level = np.linalg.norm(b.astype(np.float64), axis=-1)
        finite = np.isfinite(error) & np.isfinite(level)
        error, level = error[finite], level[finite]
        floor = DARK * float(level.mean()) if len(level) else 0.0
        scale = np.maximum(level, floor)
        relative = np.where(scale > 0, error / np.where(scale > 0, scale, 1.0), np.where(error > 0, np.inf, 0.0))
        self._keep(name, 100.0 * relative, float(error.sum()), float(level.sum()))

    def _keep(self, name: str, values: Array, total: float | None = None, reference: float = 0.0) -> None:
        values = values[np.isfinite(values)]
        total = float(values.sum()) if total is None else total
        self._sums[name] = self._sums.get(name, np.zeros(3)) + (total, reference, len(values))
        self._largest[name] = max(self._largest.get(name, 0.0), float(values.max(initial=0.0)))
        step = max(1, -(-len(values) // PER_FRAME))
        self._values.setdefault(name, []).append(values[::step])
