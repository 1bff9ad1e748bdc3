"""Exact visibility: why the light of a point changed, and the block ``exact`` of summary.json (docs/conventions.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.conventions import Visibility
from taubench_gl.features import FEATURES
from taubench_gl.run_schema import EXACT_COLUMNS
from taubench_gl.srgb import LUMINANCE

Array = np.ndarray

CLASSES = {
    "visible": Visibility.VISIBLE, "occluded": Visibility.OCCLUDED, "outside": Visibility.OUTSIDE,
    "behind": Visibility.BEHIND, "new": Visibility.NEW, "invalid": Visibility.INVALID,
}  # fmt: skip
"""Disjoint classes that cover all pixels; the last four are ``exact_<name>`` in a row of frames.csv."""

CHANGES = {
    "brightened": Visibility.BRIGHTENED, "darkened": Visibility.DARKENED, "view_dependent": Visibility.VIEW_DEPENDENT,
}  # fmt: skip
"""Disjoint reasons of visible points whose light changed."""


def exact_summary(
    rows: Sequence[Mapping[str, Any]], unmeasured: Mapping[str, str], reprojection: str
) -> dict[str, Any]:
    """The block ``exact`` of summary.json from the rows of frames.csv of all pairs.

    ``unmeasured``: column -> why it is null; ``reprojection``: of the source.
    """

    def rate(column: str) -> dict[str, float | None]:
        shares = [100.0 * row[column] / row["pixels"] for row in rows if row[column] is not None]
        if not shares:
            return {"mean_percent": None, "max_percent": None}
        return {"mean_percent": float(np.mean(shares)), "max_percent": float(np.max(shares))}

    def share(part: str, of: str) -> dict[str, float | None]:
        measured_rows = [row for row in rows if row[part] is not None]
        whole = sum(row[of] for row in measured_rows)
        return {"share_percent": 100.0 * sum(row[part] for row in measured_rows) / whole if whole else None}

    wrong = {}
    for column in FEATURES:
        name = f"misregistered_{column}"
        wrong[column] = rate(name) | share(name, column)
        wrong[column] |= {"reason": unmeasured[column]} if column in unmeasured else {}
    return {
        **{name: rate(class_column(name)) for name in CLASSES},
        "misregistered": wrong,
        **{name: rate(name) for name in CHANGES},
        "light_noise": rate("light_noise"),
        "missed": rate("missed") | share("missed", "occluded"),
        "reprojection": reprojection,
    }


def class_column(name: str) -> str:
    """Column of frames.csv of one of CLASSES."""
    return name if name in EXACT_COLUMNS else f"exact_{name}"


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
