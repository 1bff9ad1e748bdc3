"""Pixels sorted by why their history does or does not hold: every pixel in exactly one class."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taubench_gl.conventions import FRUSTUM, Reason

Array = np.ndarray

CLASSES: dict[str, tuple[int, str]] = {
    "unjudged": (int(Reason.FIRST | Reason.CUT | Reason.INVALID), "no history, by declaration or by a fault"),
    "frustum": (int(FRUSTUM), "was outside the last picture or behind its camera"),
    "disoccluded": (int(Reason.DISOCCLUDED), "was hidden"),
    "occluding": (int(Reason.OCCLUDING), "what was there lay behind it"),
    "geometry": (int(Reason.POSITION | Reason.NORMAL), "another position or normal, for any other reason"),
    "lit": (int(Reason.LIT), "direct light rose"),
    "shadowed": (int(Reason.SHADOWED), "direct light fell"),
    "light": (int(Reason.DIRECT | Reason.INDIRECT | Reason.COLOR), "other change of light or colour"),
    "sky": (int(Reason.SKY), "sky that was sky"),
    "rest": (0, "none of these: history holds"),
}
"""Name -> bits, any of which puts a pixel into it, and what that means.  The first class that fits takes the pixel."""


def classify(mask: Array) -> Array:
    """Index into CLASSES of every pixel.  (h, w) uint32 reason words -> (h, w) int8; ``rest`` takes what is left."""
    out = np.full(mask.shape, len(CLASSES) - 1, dtype=np.int8)
    for index, (bits, _) in reversed(list(enumerate(CLASSES.values()))):
        if bits:
            out[(mask & np.uint32(bits)) != 0] = index
    return out


@dataclass(slots=True)
class ClassErrors:
    """Sums of per-pixel errors by class over frames."""

    pixels: Array = field(default_factory=lambda: np.zeros(len(CLASSES), dtype=np.int64))
    sums: dict[str, Array] = field(default_factory=dict)

    def add(self, classes: Array, errors: dict[str, Array]) -> None:
        """``errors``: name -> (h, w) of one frame; the same names in every frame."""
        flat = classes.ravel()
        self.pixels += np.bincount(flat, minlength=len(CLASSES))
        for name, values in errors.items():
            total = np.bincount(flat, weights=values.ravel().astype(np.float64), minlength=len(CLASSES))
            self.sums[name] = self.sums.get(name, 0.0) + total

    def summary(self) -> dict[str, dict[str, Any]]:
        """Class -> ``percent`` of all pixels and the mean of each error in it, None where the class is empty."""
        whole, out = int(self.pixels.sum()), {}
        for index, name in enumerate(CLASSES):
            count = int(self.pixels[index])
            means = {n: float(s[index] / count) if count else None for n, s in self.sums.items()}
            out[name] = {"pixels": count, "percent": 100.0 * count / whole if whole else None, **means}
        return out
