"""Why the light of a surface point changed between two frames, in float64 (docs/conventions.md, "Exact visibility")."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taubench_gl.conventions import Visibility
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray


def light_reasons(
    total: Mapping[str, Array], by_direction: Mapping[str, Array], thresholds: Mapping[str, float], visible: Array
) -> Array:
    """BRIGHTENED, DARKENED or VIEW_DEPENDENT of ``conventions.Visibility`` for every point, (h, w) uint32.

    ``total``: column -> (h, w, 3) radiance towards the camera now less then; ``by_direction``: likewise, of the light
    then towards the camera's direction now less then, so that the rest is the change by time; ``visible`` (h, w) bool:
    points that the previous camera saw.  The first column whose change exceeds its threshold decides.
    """
    bits, open_ = np.zeros(visible.shape, dtype=np.uint32), visible.copy()
    for column, change in total.items():
        changed = open_ & (np.linalg.norm(change, axis=-1) > thresholds[column])
        turned = by_direction[column]
        viewed = np.linalg.norm(turned, axis=-1) > np.linalg.norm(change - turned, axis=-1)
        lit = np.where(change @ LUMINANCE > 0, np.uint32(Visibility.BRIGHTENED), np.uint32(Visibility.DARKENED))
        bits[changed] = np.where(viewed, np.uint32(Visibility.VIEW_DEPENDENT), lit)[changed]
        open_ &= ~changed
    return bits
