"""One color per reason and per column, the same in all images, plots and pages.

The colors are from the palettes of Okabe and Ito (2008) and Paul Tol.  Any two differ by at least 0.05 in OKLab, for
normal vision and for simulated protanopia, deuteranopia and tritanopia (tests/report/test_palette.py).  Reasons that
are often adjacent (frustum, position, normal, direct, color) also differ in lightness.
"""

from __future__ import annotations

from collections.abc import Mapping

from taubench_gl.conventions import FRUSTUM, Reason, Visibility
from taubench_gl.features import BY_BIT, TABLE

RGB = tuple[int, int, int]

FEATURE_COLORS: Mapping[str, RGB] = {
    "frustum": (0xD5, 0x5E, 0x00),
    **{feature.name: feature.color for feature in TABLE},
}

REASON_COLORS: Mapping[Reason, RGB] = {
    Reason.FIRST: (0xBB, 0xBB, 0xBB),
    Reason.CUT: (0x77, 0x77, 0x77),
    Reason.INVALID: (0xFF, 0xFF, 0xFF),
    FRUSTUM: FEATURE_COLORS["frustum"],
    Reason.BEHIND: (0x88, 0x22, 0x55),
    Reason.OUTSIDE: FEATURE_COLORS["frustum"],
    **{feature.bit: feature.color for feature in BY_BIT},
    Reason.DISOCCLUDED: (0x56, 0xB4, 0xE9),
    Reason.OCCLUDING: (0x33, 0x22, 0x88),
    Reason.LIT: (0xDD, 0xCC, 0x77),
    Reason.SHADOWED: (0x66, 0x11, 0x00),
    Reason.SKY: (0x88, 0xCC, 0xEE),
    Reason.HISTORY_SKY: (0x99, 0xDD, 0xFF),
}

EXACT_COLORS: Mapping[Visibility, RGB] = {
    Visibility.OCCLUDED: REASON_COLORS[Reason.DISOCCLUDED],
    Visibility.OUTSIDE | Visibility.BEHIND: REASON_COLORS[FRUSTUM],
    Visibility.NEW: REASON_COLORS[Reason.CUT],
    Visibility.BRIGHTENED: REASON_COLORS[Reason.LIT],
    Visibility.DARKENED: REASON_COLORS[Reason.SHADOWED],
    Visibility.VIEW_DEPENDENT: REASON_COLORS[Reason.OCCLUDING],
}
"""Exact reason (``glossary.EXACT_REASONS``) -> color, that of the related reason of a mask where there is one."""

SERIES_COLORS = ("#3311dd", "#bb0000", "#000000", "#9977ff")
"""Blue, red, black and violet: series that are no reason, such as measurement and theory, in no reason's color."""

REUSE_COLORS: Mapping[str, RGB] = {"surface": (0xEE, 0x33, 0x77), "shading": (0xAA, 0x33, 0x99)}
"""Pixels that a reuse rate does not count."""

DEFAULT_REASONS: tuple[Reason, ...] = (
    Reason.FIRST,
    Reason.CUT,
    Reason.INVALID,
    FRUSTUM,
    *(feature.bit for feature in BY_BIT),
)
"""The reasons that a mask image shows by default: pixels that are not classified, then the columns of Table 4."""


def color_of(reason: Reason) -> RGB:
    """8-bit sRGB of a reason or combination in REASON_COLORS.  Raises KeyError for others."""
    return REASON_COLORS[reason]


def hex_of(color: str | RGB) -> str:
    """``#rrggbb`` of a column of Table 4 or of an 8-bit sRGB color."""
    return "#{:02x}{:02x}{:02x}".format(*(FEATURE_COLORS[color] if isinstance(color, str) else color))
