"""From pixels per reason word to counts and percentages (Eq. 4).  Exact integers first, float64 last."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taubench_gl.conventions import FEATURE_BIT, FRUSTUM, NOT_COMPARABLE, Reason

Array = np.ndarray
WORDS = np.arange(1 << 16, dtype=np.uint32)
CLASSES = ("first", "cut", "invalid", "frustum", "comparable")
"""Every pixel is in exactly one of these: they add up to w * h."""

_CLASS_OF_WORD = {
    "first": (WORDS & Reason.FIRST) != 0,
    "cut": ((WORDS & Reason.CUT) != 0) & ((WORDS & Reason.FIRST) == 0),
    "invalid": ((WORDS & Reason.INVALID) != 0) & ((WORDS & (Reason.FIRST | Reason.CUT)) == 0),
    "frustum": ((WORDS & FRUSTUM) != 0) & ((WORDS & (Reason.FIRST | Reason.CUT | Reason.INVALID)) == 0),
    "comparable": (WORDS & NOT_COMPARABLE) == 0,
}


def counts_of(combos: Array) -> dict[str, int]:
    """Pixel counts by class and reason from pixels per reason word.  (65536,) -> {name: int}.

    Bits that the masks never set stay 0; the caller knows which features were not measured.
    """
    words = np.flatnonzero(combos)  # a few dozen of the 65536
    combos = np.asarray(combos)[words].astype(np.int64)
    out = {"pixels": int(combos.sum())}
    out |= {name: int(combos[of_class[words]].sum()) for name, of_class in _CLASS_OF_WORD.items()}
    for bit in (Reason.SKY, Reason.HISTORY_SKY, Reason.BEHIND, Reason.OUTSIDE, Reason.DISOCCLUDED, Reason.OCCLUDING,
                Reason.LIT, Reason.SHADOWED):  # fmt: skip
        out[bit.name.lower()] = int(combos[(words & bit) != 0].sum())
    for feature, bit in FEATURE_BIT.items():
        out[feature] = int(combos[(words & bit) != 0].sum())
    return out


def percent(counts: Mapping[str, int], column: str) -> float:
    """Eq. (4) of one column, over all w * h pixels."""
    return 100.0 * counts[column] / counts["pixels"]


def comparable_percent(counts: Mapping[str, int], column: str) -> float | None:
    """The same over the pixels the column could judge: comparable ones, for frustum also those it discards."""
    base = counts["comparable"] + (counts["frustum"] if column == "frustum" else 0)
    return 100.0 * counts[column] / base if base else None
