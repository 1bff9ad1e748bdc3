"""The features that masks compare: one record each, from which masks, counts, curves, tables, pages and help are made.

A new feature takes a bit (``conventions.Reason``), a record here, and its distance in GLSL (``distance_<name>`` in
masks.comp.glsl); where no kind of ``Distance`` is its own, also in NumPy (``metrics.masks.compare``).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from taubench_gl.conventions import DEFAULT_THRESHOLD, FRUSTUM, Reason


class Distance(enum.Enum):
    """How the distance between a value and its history is measured."""

    SURFACE = "Euclidean; infinite between surface and sky"
    RADIANCE = "Euclidean, times the exposure"
    CHANNELS = "largest difference of a channel"


@dataclass(frozen=True, slots=True)
class Feature:
    """One feature mask f_B of section 3.2, and the column of Table 4 that counts it."""

    name: str
    channel: str  # the compared channel
    bit: Reason
    distance: Distance
    unit: str  # unit of the threshold
    sentence: str  # when a pixel is discarded
    misregistered: str  # which pixels ``misregistered_<name>`` of exact visibility counts
    color: tuple[int, int, int]  # 8-bit sRGB, in images, plots and pages
    dash: str  # Matplotlib style of its lines in plots
    symbol: str = ""  # symbol of the unit beside numbers
    part: str = "xyz"  # components of the channel
    light: bool = False  # whether light decides it
    rates: tuple[str, ...] = ()  # reuse rates that do not count its pixels
    details: tuple[Reason, ...] = ()  # disjoint bits that divide ``bit``
    cause: tuple[str, str] = ("", "")  # label and sentence of pixels that only ``bit`` keeps from a rate
    most: float | None = None  # largest distance there is
    threshold: float = DEFAULT_THRESHOLD


TABLE: tuple[Feature, ...] = (
    Feature(
        "color", "color", Reason.COLOR, Distance.CHANNELS, "sRGB, 0 to 1",
        "A channel of the tone-mapped sRGB color differs from history by more than the threshold",
        "Pixels that color discards although the previous camera saw their point in the same color",
        (0xCC, 0x79, 0xA7), "--", light=True, most=2.0,
    ),
    Feature(
        "position", "position", Reason.POSITION, Distance.SURFACE, "m",
        "Distance between the surface position and the position in history exceeds the threshold",
        "Misregistered pixels of the column position",
        (0x00, 0x72, 0xB2), "-", symbol="m", part="xyzw", rates=("surface", "shading"),
        details=(Reason.DISOCCLUDED, Reason.OCCLUDING),
        cause=("changed in position",
               "The surface point is not where the history has it, and neither surface hides the other"),
    ),
    Feature(
        "normal", "normal", Reason.NORMAL, Distance.SURFACE, "length of the difference",
        "Distance between the unit shading normal and the normal in history exceeds the threshold",
        "Misregistered pixels of the column normal",
        (0x00, 0x9E, 0x73), "-.", rates=("surface", "shading"), most=2.0,
        cause=("changed in normal", "The normal changed although the position did not"),
    ),
    Feature(
        "direct", "direct", Reason.DIRECT, Distance.RADIANCE, "radiance x exposure",
        "Distance between direct radiance and direct radiance in history exceeds the threshold",
        "Pixels that direct discards although the previous camera saw their point under the same light",
        (0xF0, 0xE4, 0x42), "-", light=True, rates=("shading",), details=(Reason.LIT, Reason.SHADOWED),
        cause=("changed in light color", "Direct radiance changed at equal luminance"),
    ),
    Feature(
        "indirect", "indirect", Reason.INDIRECT, Distance.RADIANCE, "radiance x exposure",
        "Distance between indirect radiance and indirect radiance in history exceeds the threshold",
        "Pixels that indirect discards although the previous camera saw their point under the same indirect light",
        (0xE6, 0x9F, 0x00), ":", light=True, rates=("shading",),
        cause=("changed in indirect light", "Indirect radiance changed although direct radiance did not"),
    ),
)  # fmt: skip
"""All features in the order of Table 4.  Frustum is a class of its own, without distance and threshold."""

BY_BIT = tuple(sorted(TABLE, key=lambda feature: feature.bit))  # the order of files and legends
FEATURE = {f.name: f for f in TABLE}
FEATURES = tuple(FEATURE)
FEATURE_BIT = {f.name: f.bit for f in TABLE}
COLUMNS = ("frustum", *FEATURES)  # Table 4's
COLUMN_BITS = {"frustum": FRUSTUM, **FEATURE_BIT}  # column -> bits of the pixels that it discards
UNITS = {f.name: f.symbol for f in TABLE if f.symbol}

GEOMETRY = tuple(f.name for f in BY_BIT if f.distance is Distance.SURFACE)  # every source has them
VALUES = tuple(f.name for f in BY_BIT if f.distance is not Distance.SURFACE)  # compared where a source has them
LIGHT_FEATURES = tuple(f.name for f in BY_BIT if f.light)
OTHERS = tuple(name for name in VALUES if name not in LIGHT_FEATURES)
RADIANCE_FEATURES = tuple(f.name for f in BY_BIT if f.distance is Distance.RADIANCE)  # the exposure multiplies it

# Every count is a sum over the histogram of whole reason words, so it has all words up to the highest bit.  Each bit
# doubles it.  To clear it, read it back and find the words that occur takes 0.03 ms a pair at 16 bits, 0.09 at 17, 0.23
# at 18, 2 at 20 and 26 at 22 (llvmpipe): two or three more features cost nothing that shows.  Then number the words
# without gaps: FIRST, CUT, INVALID, BEHIND and OUTSIDE exclude the bits of all features.  Pages hold 24 bits, the mask
# of the viewer 21.
COUNTED_BITS = max(Reason).bit_length()
MASK_WORDS = 1 << COUNTED_BITS
WORD_DTYPE = "<u2" if COUNTED_BITS <= 16 else "<u4"
"""NumPy type of mask words in files."""
