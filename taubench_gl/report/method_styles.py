"""Color, line, and marker of a reuse method: the same in every plot and on every page.

Nine colors by Okabe and Ito (2008) and Paul Tol, solid with filled circles, dashed with open squares, then dash-dotted,
are the built-in methods; ``none`` is black.  Any two differ in color by at least 0.05 in OKLab, for color-blind readers
too, or in line and marker (tests/report/test_method_styles.py).
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

NO_REUSE = "none"
BLACK = "#000000"

COLORS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#5D5D00", "#332288",
)  # fmt: skip
KINDS = (("-", "o", True), ("--", "s", False), ("-.", "D", True), (":", "^", False))
"""Line style, marker and whether the marker is filled, for the first nine methods, the next nine, and so on."""

SOLID = (
    "accumulate", "taa_clamp", "svgf", "taa_variance", "taa_clip", "fsr2-class", "reblur-class", "bmfr", "oidn",
)  # fmt: skip
DASHED = (
    "upsample_2x2", "reverse_reprojection_cache", "bmfr_temporal", "ideal-masks", "checkerboard", "asvgf", "timewarp",
    "greedy", "ris", "restir-di", "extrapolate", "space-warp", "interpolate", "present-last",
)  # fmt: skip
"""Names of built-in methods, in the order of COLORS."""


@dataclass(frozen=True, slots=True)
class MethodStyle:
    """How a method is drawn.  ``color``: ``#rrggbb``; ``line``: a Matplotlib line style; ``filled``: the marker is."""

    color: str
    line: str
    marker: str
    filled: bool

    @property
    def face(self) -> str:
        """Fill of the marker."""
        return self.color if self.filled else "white"

    @property
    def bar(self) -> dict[str, Any]:
        """Keywords that Matplotlib takes for a bar of this method."""
        return {"color": self.color, "hatch": {"-": None, "--": "//", "-.": "xx", ":": ".."}[self.line]}

    @property
    def points(self) -> dict[str, Any]:
        """Properties of a line with marked points."""
        return {**self.curve, "marker": self.marker, "markerfacecolor": self.face}

    @property
    def curve(self) -> dict[str, Any]:
        """Properties of a line without marks."""
        return {"color": self.color, "linestyle": self.line}


ALL = tuple(MethodStyle(color, *kind) for kind in KINDS for color in COLORS)
BUILTIN: Mapping[str, MethodStyle] = {
    NO_REUSE: MethodStyle(BLACK, *KINDS[0]),
    **dict(zip(SOLID, ALL, strict=False)),
    **dict(zip(DASHED, ALL[len(COLORS) :], strict=False)),
}


def method_styles(labels: Iterable[str]) -> dict[str, MethodStyle]:
    """Label -> style.  Other methods have the style that their label selects, or the next that is free."""
    labels = list(labels)
    out = {label: BUILTIN[label] for label in labels if label in BUILTIN}
    free = [style for style in ALL if style not in BUILTIN.values()]
    for label in sorted(set(labels) - set(out)):
        start = zlib.crc32(label.encode("utf-8", "surrogateescape")) % len(free)
        order = free[start:] + free[:start]
        out[label] = next((style for style in order if style not in out.values()), order[0])
    return {label: out[label] for label in labels}
