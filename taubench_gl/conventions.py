"""Conventions that every number of this package depends on (explained in docs/conventions.md).

Space      right-handed, +Y up, meters (glTF 2.0); cameras and lights look along their local -Z.
Matrices   column vectors, named ``dst_from_src``: ``clip_from_view @ view_from_world @ pos_ws``.
Pixels     pixel-index coordinates: the center of pixel i is i, so Eq. (3)'s valid range is [0, w-1] x [0, h-1].
Rows       row 0 is the top in every array that leaves ``gpu``; GL memory is bottom-up and flipped once, at read-back.
Motion     previous - current, pixels, +x right; +y up in GL memory and down in every array that leaves ``gpu``.
Depth      reversed Z in [0, 1] for the depth test; ``position.w`` is planar view depth in scene units, 0 = no surface.
Time       frame i is at t = i / fps; a pair is (i-1, i); N frames give N-1 pairs; every mean is over pairs.
Keys       a curve asked for a time within KEY_TOLERANCE of a key is sampled at the key; of two keys at one time the
           earlier ends what is before and the later begins what follows; before its first key it has that value.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from typing import Any

SUMMARY_SCHEMA = "taubench-gl/summary/2"

DEFINITIONS = 5
"""Raised whenever a number can change for the same input and settings (docs/changes-of-numbers.md).

Stored results without it are of definition 1.  Results of two values are never compared, merged, resumed or read from a
cache without a word.
"""

MIXED = "evaluate again what an older version measured; see docs/changes-of-numbers.md"
"""What to do where results of two ``DEFINITIONS`` meet."""


def mixed_definitions(summaries: Iterable[Mapping[str, Any]]) -> str | None:
    """What is wrong where results with these ``provenance`` blocks are of several ``DEFINITIONS``; None if of one."""
    values = sorted({str((s.get("provenance") or {}).get("definitions", 1)) for s in summaries})
    return f"numbers of definitions {' and '.join(values)} are not comparable" if len(values) > 1 else None


FILE_NUMBER = r"(?:(?<![A-Za-z0-9])-)?\d+"
"""Regular expression of a frame number in a file name: below zero where its minus follows no letter or digit."""

DEFAULT_FPS = 24.0
"""Frames per second of the paper's renders (section 4.2)."""

KEY_TOLERANCE = 0.01
"""Distance to a key, in frame intervals of the run, within which a curve is sampled at the key; one float32 step where
that is more, and never beyond the middle between two keys (``animation.curves.time_on_key``)."""

GUARD_PX = 1.0 / 256.0
"""Guard band of the off-screen test: a still pixel lies exactly on Eq. (3)'s boundary, and rounding must not move it
off screen."""

DEFAULT_THRESHOLD = 32.0 / 255.0
"""The paper's threshold (section 3.2), in the unit of each feature; position: meters."""


class Reason(enum.IntFlag):
    """Reason bits of the mask word, one unsigned 32-bit integer per pixel (docs/conventions.md).

    Pixels with FIRST, CUT, INVALID, BEHIND or OUTSIDE are not compared.  A pixel is in exactly one class: ``FIRST``,
    ``CUT``, ``INVALID``, frustum (``BEHIND`` or ``OUTSIDE``), or comparable (none of these bits).
    """

    FIRST = 1 << 0  # no previous frame
    CUT = 1 << 1  # no history: the caller declares the frame a cut, or the scene replaced the surface
    INVALID = 1 << 2  # NaN or Inf in a compared value
    SKY = 1 << 3  # no surface at this pixel
    HISTORY_SKY = 1 << 4  # no surface at the history sample
    BEHIND = 1 << 5  # behind camera: previous planar depth <= near; tested before the perspective division
    OUTSIDE = 1 << 6  # off-screen: reprojected outside [0, w-1] x [0, h-1] (Eq. 3), plus the guard band
    POSITION = 1 << 7  # f_pos
    NORMAL = 1 << 8  # f_norm
    DIRECT = 1 << 9  # f_dir
    INDIRECT = 1 << 10  # f_ind
    COLOR = 1 << 11  # any sRGB channel differs by more than a_color
    DISOCCLUDED = 1 << 12  # the history surface occluded this point in the previous frame
    OCCLUDING = 1 << 13  # newly occluding: the history surface lies behind this point
    LIT = 1 << 14  # brightened: direct radiance increased by more than its threshold
    SHADOWED = 1 << 15  # darkened: direct radiance decreased by more than its threshold


class Visibility(enum.IntFlag):
    """Bits of the channel ``prev_visibility``: what a ray from the previous camera to a pixel's surface point found.

    A pixel has exactly one of VISIBLE, OCCLUDED, OUTSIDE, BEHIND, NEW and INVALID.  The pixels of the previous image
    decide nothing: the point itself is traced, at the place it had.  ``exact_reasons`` adds CHANGED_LIGHT.
    """

    VISIBLE = 1 << 0  # inside the previous image, and nothing drawn before it
    OCCLUDED = 1 << 1  # inside the previous image, behind another surface: disoccluded since
    OUTSIDE = 1 << 2  # off-screen: Eq. (3) of the point's own previous position
    BEHIND = 1 << 3  # behind the previous camera
    NEW = 1 << 4  # the surface was not there: it replaced another one, or its object was hidden
    INVALID = 1 << 5  # NaN or Inf in a position
    SKY = 1 << 6  # no surface at this pixel: the view direction is traced
    MOVED = 1 << 7  # the point itself moved by more than the position threshold
    BRIGHTENED = 1 << 8  # a visible point's own radiance changed, most of it by time, and its luminance rose
    DARKENED = 1 << 9  # the same, and its luminance fell
    VIEW_DEPENDENT = 1 << 10  # a visible point's own radiance changed, most of it by the direction to the camera


CHANGED_LIGHT = Visibility.BRIGHTENED | Visibility.DARKENED | Visibility.VIEW_DEPENDENT
"""Bits of changed light; a pixel has at most one of them."""


NO_HISTORY = 1 << 31
"""Bit of the second component of ``ids``: the surface replaced another one in this frame, so its pixels are CUT."""

ABSENT = 1 << 30
"""Bit of the second component of ``ids`` in exports: the surface is hidden or scaled to zero in the other frame."""

OTHER_REPROJECTION = {"camera": "motion", "motion": "camera"}

COUNTED, EQUAL = "counted", "equal"
"""``Source.other`` of a source whose pairs are counted under both reprojections, and of one where nothing moves."""

FRUSTUM = Reason.BEHIND | Reason.OUTSIDE
NOT_COMPARABLE = Reason.FIRST | Reason.CUT | Reason.INVALID | FRUSTUM

# Histogram of feature distances: log-linear bins taken from the bits of a float32, so that the GPU and NumPy agree on
# every bin exactly, without a logarithm.  HISTOGRAM_MANTISSA_BITS = 3: eight bins per octave.
HISTOGRAM_MANTISSA_BITS = 3
HISTOGRAM_MIN_EXPONENT = -20  # 2^-20 is about 1e-6
HISTOGRAM_MAX_EXPONENT = 12  # 2^12 = 4096
HISTOGRAM_BINS = ((HISTOGRAM_MAX_EXPONENT - HISTOGRAM_MIN_EXPONENT) << HISTOGRAM_MANTISSA_BITS) + 2
"""Bin 0: below 2^-20 (zero included).  Last bin: 2^12 and above.  Between: eight equal bins per octave."""


def histogram_bins(mantissa_bits: int = HISTOGRAM_MANTISSA_BITS) -> int:
    """Bins of a histogram with 2^``mantissa_bits`` equal bins per octave, the two open ends included."""
    return ((HISTOGRAM_MAX_EXPONENT - HISTOGRAM_MIN_EXPONENT) << mantissa_bits) + 2
