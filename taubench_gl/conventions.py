"""Every convention that a number of this package depends on, in one place (docs/conventions.md is the prose).

Space      right-handed, +Y up, metres (glTF 2.0); cameras and lights look along their local -Z.
Matrices   column vectors, named ``dst_from_src``: ``clip_from_view @ view_from_world @ pos_ws``.
Pixels     pixel-index coordinates: the centre of pixel i is i, so Eq. (3)'s valid range is [0, w-1] x [0, h-1].
Rows       row 0 is the top in every array that leaves ``gpu``; GL memory is bottom-up and flipped once, at read-back.
Motion     previous - current, pixels, +x right; +y up in GL memory and down in every array that leaves ``gpu``.
Depth      reversed Z in [0, 1] for the depth test; ``position.w`` is planar view depth in metres, 0 = no surface.
Time       frame i is at t = i / fps; a pair is (i-1, i); N frames give N-1 pairs; every mean is over pairs.
"""

from __future__ import annotations

import enum

SUMMARY_SCHEMA = "taubench-gl/summary/1"

DEFAULT_FPS = 24.0
"""Frames per second of the paper's renders (section 4.2)."""

GUARD_PX = 1.0 / 256.0
"""Guard of the outside test: a still pixel lies exactly on Eq. (3)'s boundary, rounding must not push it out."""

DEFAULT_THRESHOLD = 32.0 / 255.0
"""The paper's threshold (section 3.2), in the unit of each feature; position: times the scene's ``unit_scale``."""

FEATURES = ("color", "position", "normal", "direct", "indirect")
"""The feature masks f_B of section 3.2, in the order of Table 4 (frustum is a class of its own)."""

COLUMNS = ("frustum", *FEATURES)
"""Table 4's columns."""


class Reason(enum.IntFlag):
    """Reason bits of the mask word, one unsigned 32-bit integer per pixel (docs/conventions.md).

    FIRST, CUT, INVALID, BEHIND and OUTSIDE each take a pixel out of comparison; a pixel carries at most one of the
    classes ``FIRST``, ``CUT``, ``INVALID``, ``BEHIND | OUTSIDE`` (frustum), or none of them (comparable).
    """

    FIRST = 1 << 0  # no previous frame
    CUT = 1 << 1  # history has nothing to do with this frame (the caller says so) or surface (the scene does)
    INVALID = 1 << 2  # NaN or Inf in what is compared
    SKY = 1 << 3  # no surface at this pixel now
    HISTORY_SKY = 1 << 4  # no surface at the history sample
    BEHIND = 1 << 5  # previous planar depth <= near: decided before the division
    OUTSIDE = 1 << 6  # Eq. (3): reprojected outside [0, w-1] x [0, h-1], with the guard
    POSITION = 1 << 7  # f_pos
    NORMAL = 1 << 8  # f_norm
    DIRECT = 1 << 9  # f_dir
    INDIRECT = 1 << 10  # f_ind
    COLOR = 1 << 11  # any sRGB channel differs by more than a_color
    DISOCCLUDED = 1 << 12  # the history surface hid this point from the previous camera
    OCCLUDING = 1 << 13  # the history surface lies behind this point
    LIT = 1 << 14  # direct radiance rose past its threshold
    SHADOWED = 1 << 15  # direct radiance fell past its threshold


NO_HISTORY = 1 << 31
"""Bit of the ``ids`` channel's second component: the surface took another's place in this frame, its pixels are CUT."""

FRUSTUM = Reason.BEHIND | Reason.OUTSIDE
NOT_COMPARABLE = Reason.FIRST | Reason.CUT | Reason.INVALID | FRUSTUM

FEATURE_BIT = {
    "color": Reason.COLOR,
    "position": Reason.POSITION,
    "normal": Reason.NORMAL,
    "direct": Reason.DIRECT,
    "indirect": Reason.INDIRECT,
}

# Histogram of feature distances: log-linear bins cut straight from the bits of a float32, so that the GPU and NumPy
# agree on every bin exactly, with no logarithm.  HISTOGRAM_MANTISSA_BITS = 3: eight bins per octave.
HISTOGRAM_MANTISSA_BITS = 3
HISTOGRAM_MIN_EXPONENT = -20  # 2^-20 is about 1e-6
HISTOGRAM_MAX_EXPONENT = 12  # 2^12 = 4096
HISTOGRAM_BINS = ((HISTOGRAM_MAX_EXPONENT - HISTOGRAM_MIN_EXPONENT) << HISTOGRAM_MANTISSA_BITS) + 2
"""Bin 0: below 2^-20 (zero included).  Last bin: 2^12 and above.  Between: eight equal bins per octave."""


def histogram_bins(mantissa_bits: int = HISTOGRAM_MANTISSA_BITS) -> int:
    """Bins of a histogram with 2^``mantissa_bits`` equal bins per octave, the two open ends included."""
    return ((HISTOGRAM_MAX_EXPONENT - HISTOGRAM_MIN_EXPONENT) << mantissa_bits) + 2
