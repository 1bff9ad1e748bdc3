"""The block ``exact`` of summary.json: shares of pixels from the counts of exact visibility."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from taubench_gl.conventions import Visibility
from taubench_gl.features import FEATURES
from taubench_gl.run_schema import EXACT_COLUMNS

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
