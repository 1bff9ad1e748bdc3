"""Definitions of every reason, column and statistic: one sentence each, with unit and source.

The help of the command line, the tooltips of the report and of the viewer, and docs/glossary.md show these sentences.
Keys are the names in frames.csv, summary.json and options; labels are the words for people.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from taubench_gl.conventions import FRUSTUM, Reason, Visibility
from taubench_gl.features import BY_BIT, TABLE


@dataclass(frozen=True, slots=True)
class Term:
    """``definition`` is one sentence without a final period; ``source`` is an equation or a page of the docs."""

    key: str
    label: str
    definition: str
    unit: str = ""
    source: str = ""

    @property
    def sentence(self) -> str:
        """The definition with its final period."""
        return f"{self.definition}."

    @property
    def tooltip(self) -> str:
        """The definition with unit and source: ``Reprojected outside the previous image (paper, Eq. 3)``."""
        remarks = ", ".join(part for part in (self.unit, self.source) if part)
        return f"{self.definition} ({remarks})" if remarks else self.definition


_MASKS = "docs/conventions.md, Masks"
_REUSABLE = "docs/conventions.md, Reusable pixels"
_SAMPLED = "docs/light.md, Sampled light"
_EXACT = "docs/conventions.md, Exact visibility"
_REPROJECTION = "docs/conventions.md, Reprojection"
_HISTORY = "docs/conventions.md, The other eye"
_CAMERA = "docs/conventions.md, Camera activity"
_EQ_1, _EQ_2, _EQ_3, _EQ_4 = (f"paper, Eq. {n}" for n in (1, 2, 3, 4))
_SECTION_3_2 = "paper, section 3.2"


def _by_key(*terms: Term) -> dict[str, Term]:
    return {term.key: term for term in terms}


CONCEPTS: Mapping[str, Term] = _by_key(
    Term("pair", "frame pair", "Two consecutive frames, the previous and the current one; N frames give N-1 pairs"),
    Term("history", "history", "What was rendered for the previous frame and is still stored"),
    Term(
        "reprojected_history", "reprojected history",
        "The history sampled where the surface of the current pixel was in the previous frame", "", _EQ_3,
    ),
    Term(
        "surface_pixel", "surface pixel", "A pixel that shows a surface in the current frame; the others show sky", "",
        _REUSABLE,
    ),
    Term(
        "reusable", "reusable pixel", "A pixel whose reprojected history passes the tests of the columns considered",
        "", _SECTION_3_2,
    ),
    Term(
        "surface", "surface",
        "Reuse rate of surfaces: surface pixels whose history shows the same point with the same normal, which no "
        "frustum, position or normal discard rules out", "% of surface pixels", _REUSABLE,
    ),
    Term(
        "shading", "shading",
        "Reuse rate of shaded pixels: those counted by surface whose direct and indirect light did not change either; "
        "color is left out, because it depends on the tone map", "% of surface pixels", _REUSABLE,
    ),
    Term(
        "color_only", "color alone",
        "Reusable pixels that the color column discards: emission or textures changed, or light changed by less than "
        "its thresholds", "% of surface pixels", _REUSABLE,
    ),
    Term("discarded", "discarded pixel", "A pixel that is not reusable; the column is the reason", "", _SECTION_3_2),
    Term("discard_rate", "discard rate", "Share of pixels that a column discards", "%", _EQ_4),
    Term("reuse_rate", "reuse rate", "Share of surface pixels that are reusable", "%", _REUSABLE),
    Term("classify", "classify", "Determine the reason mask of a pixel"),
    Term("evaluate", "evaluate", "Classify all pixels of a pair and count them"),
    Term("object_motion", "object motion", "Motion vector minus that of a static point at the same place", "pixels"),
    Term(
        "comparable", "comparable pixel",
        "A pixel that is classified and whose history lies inside the previous image, so that its features can be "
        "compared", "", _MASKS,
    ),
    Term(
        "not_classified", "not classified",
        "A pixel without usable history, for which no feature is compared: first frame, cut or invalid", "", _MASKS,
    ),
    Term(
        "threshold", "threshold",
        "The largest distance between current value and history at which a pixel is reusable, a_B of the paper; "
        "32/255 by default", "unit of the feature", _SECTION_3_2,
    ),
    Term(
        "threshold_curve", "discard-versus-threshold curve",
        "Discard rate of a feature at every threshold, from the histogram of its distances", "%", _MASKS,
    ),
    Term(
        "mask_histogram", "mask histogram", "Number of pixels per reason mask, one entry per combination of bits",
        "pixels", _MASKS,
    ),
    Term(
        "false_positive", "false positive", "A pixel that a method reuses although the reference masks discard it", "",
        "docs/reuse-evaluation.md",
    ),
    Term(
        "false_negative", "false negative", "A pixel that a method rejects although no reference mask discards it", "",
        "docs/reuse-evaluation.md",
    ),
    Term(
        "bound", "bound",
        "Smallest error of any method that blends the same input and reprojected history with one weight per pixel", "",
        "docs/reuse-evaluation.md",
    ),
    Term(
        "headroom", "headroom", "Error of a method over that of its bound: what better weights could still gain", "dB",
        "docs/reuse-evaluation.md",
    ),
    Term(
        "effective_weight", "effective weight", "Weight of history in a pixel less what rectification replaced", "",
        "docs/reuse-evaluation.md",
    ),
    Term(
        "worst_frame", "worst frame",
        "The current frame of the pair with the lowest reuse rate: shading where light was measured, else surface", "",
        _REUSABLE,
    ),
    Term(
        "noise_floor", "noise floor",
        "Discard rate between two path-traced renders of the same frames with different seeds: noise alone", "%",
        "docs/path-traced.md",
    ),
    Term("reference", "path-traced reference", "Images of a path tracer, read from EXR files"),
    Term("float64_reference", "float64 reference", "A plain CPU version of a shader in float64, used to test it"),
)  # fmt: skip
"""Words that the other definitions use."""

REASONS: Mapping[Reason, Term] = {
    Reason.FIRST: Term("first", "first frame", "The frame has no previous frame", "", _MASKS),
    Reason.CUT: Term(
        "cut", "cut", "The history shows an unrelated image (camera cut) or a surface that was replaced", "", _MASKS
    ),
    Reason.INVALID: Term("invalid", "invalid", "A value to be compared is NaN or infinite", "", _MASKS),
    Reason.SKY: Term("sky", "sky", "No surface is visible at the pixel", "", _REPROJECTION),
    Reason.HISTORY_SKY: Term("history_sky", "sky in history", "The history sample shows no surface", "", _REPROJECTION),
    Reason.BEHIND: Term(
        "behind", "behind camera",
        "The surface was behind the near plane of the previous camera, decided before the perspective division", "",
        _REPROJECTION,
    ),
    Reason.OUTSIDE: Term("outside", "off-screen", "The pixel reprojects outside the previous image", "", _EQ_3),
    FRUSTUM: Term(
        "frustum", "frustum", "The surface was off-screen or behind the camera in the previous frame", "", _EQ_3
    ),
    **{f.bit: Term(f.name, f.name, f.sentence, "", _SECTION_3_2) for f in BY_BIT},
    Reason.DISOCCLUDED: Term(
        "disoccluded", "disoccluded",
        "The surface was hidden: the history surface is nearer to the previous camera by more than the position "
        "threshold", "", _MASKS,
    ),
    Reason.OCCLUDING: Term(
        "occluding", "newly occluding",
        "The surface covers what was visible: the history surface is farther from the previous camera by more than "
        "the position threshold", "", _MASKS,
    ),
    Reason.LIT: Term(
        "lit", "brightened", "The luminance of direct radiance rose in a pixel that the direct column discards", "",
        _MASKS,
    ),
    Reason.SHADOWED: Term(
        "shadowed", "darkened", "The luminance of direct radiance fell in a pixel that the direct column discards",
        "", _MASKS,
    ),
}  # fmt: skip
"""What sets each bit of the reason mask, and the combination ``frustum``."""

REUSE_REASONS: Mapping[Reason, Term] = {
    **{bit: REASONS[bit] for bit in (Reason.FIRST, Reason.CUT, Reason.INVALID, Reason.BEHIND, Reason.OUTSIDE)},
    **{
        bit: Term(f.name, *f.cause, "", _REUSABLE) if bit == f.bit else REASONS[bit]
        for f in BY_BIT if f.rates for bit in (*f.details, f.bit)
    },
}  # fmt: skip
"""Why a pixel is not reusable.  Disjoint: a pixel counts once, under the first reason of this order in its mask."""

COLUMNS: Mapping[str, Term] = _by_key(
    REASONS[FRUSTUM],
    *(Term(f.name, f.name, f.sentence, f.unit, _SECTION_3_2) for f in TABLE),
)
"""The columns of Table 4.  The unit is that of the threshold."""

CAMERA: Mapping[str, Term] = _by_key(
    Term("position", "camera position", "Distance between the camera positions of a pair", "m", _EQ_1),
    Term("yaw", "yaw", "Absolute change of the camera's rotation about world +Y", "degrees", _EQ_2),
    Term("pitch", "pitch", "Absolute change of the camera's rotation about its local X axis", "degrees", _EQ_2),
    Term("roll", "roll", "Absolute change of the camera's rotation about its local Z axis", "degrees", _EQ_2),
    Term(
        "angle", "angle", "Geodesic angle between the two camera orientations of a pair; not in the paper", "degrees",
        _CAMERA,
    ),
)  # fmt: skip
"""Quantities of Tables 2 and 3."""

STATISTICS: Mapping[str, Term] = _by_key(
    Term("mean", "mean", "Arithmetic mean over pairs"),
    Term("variance", "variance", "Population variance over pairs", "square of the unit"),
    Term("max", "max", "Largest value of any pair"),
    Term("median", "median", "Median over pairs"),
    Term("p95", "p95", "95th percentile over pairs, linearly interpolated"),
    Term(
        "mean_percent", "% of all pixels", "Discarded pixels divided by all w x h pixels, mean over pairs", "%", _EQ_4
    ),
    Term(
        "comparable_mean_percent", "% of comparable pixels",
        "Discarded pixels divided by comparable pixels (for frustum: comparable and frustum pixels), mean over pairs",
        "%", _MASKS,
    ),
    Term("max_percent", "max", "Highest rate of any pair", "%"),
    Term("min_percent", "min", "Lowest rate of any pair", "%"),
    Term(
        "without_cuts_mean_percent", "without cuts", "Mean over the pairs that are not camera cuts", "%", _CAMERA,
    ),
    Term(
        "of_picture_percent", "% of all pixels",
        "Reusable surface pixels divided by all pixels, total over total", "%", _REUSABLE,
    ),
    Term(
        "of_surface_percent", "% of surface pixels",
        "Surface pixels that a column discards divided by surface pixels, total over total", "%", _REUSABLE,
    ),
    Term("sky_percent", "sky", "Pixels without a surface", "% of all pixels", _REUSABLE),
    Term(
        "at_half_exposure_percent", "at half the exposure",
        "Discards of a light column at half the exposure: its curve at twice the threshold", "% of all pixels", _MASKS,
    ),
    Term(
        "at_twice_exposure_percent", "at twice the exposure",
        "Discards of a light column at twice the exposure: its curve at half the threshold", "% of all pixels", _MASKS,
    ),
    Term("interval95_percent", "95 % interval", "Ends of the 95 % interval of an estimated share", "%", _SAMPLED),
    Term("preview_percent", "preview", "The share of the preview's masks, of every pixel", "%", _SAMPLED),
    Term(
        "undecided_percent", "undecided",
        "Sampled pixels whose distance was not clear of a threshold at the most samples", "% of them", _SAMPLED,
    ),
    Term("without_cuts", "without cuts", "The same statistics over the pairs that are not camera cuts", "", _CAMERA),
    Term("samples", "samples", "Number of pairs of the camera statistics", "pairs"),
    Term("cuts", "camera cuts", "Current frames of the pairs that are camera cuts", "", _CAMERA),
    Term("gimbal_pairs", "gimbal pairs", "Current frames of the pairs that follow the gimbal rule", "", _CAMERA),
    Term("edges", "edges", "Edges of the distance histogram's bins, eight per octave", "unit of the feature", _MASKS),
    Term("counts", "counts", "Comparable pixels per bin of the distance histogram, over all pairs", "pixels", _MASKS),
    Term("at_or_above", "at or above", "Comparable pixels with a distance at or above each edge", "pixels", _MASKS),
    Term("pairs", "N", "Number of frame pairs; every mean is over pairs", "pairs"),
    Term("fps", "fps", "Frames per second at which the animation is sampled; frame i is at t = i / fps", "1/s"),
    Term("percentage_points", "pp", "Difference of two percentages", "percentage points"),
    Term(
        "half_width_points", "95 % interval",
        "Half width of the 95 % confidence interval of a mean over sampled pairs", "percentage points",
    ),
)  # fmt: skip
"""Statistics of summary.json and the tables."""

EXACT: Mapping[str, Term] = _by_key(
    Term(
        "visible", "visible",
        "The previous camera saw the surface point of the pixel, by a ray to the place the point had",
        "% of all pixels", _EXACT,
    ),
    Term(
        "occluded", "occluded", "The surface point was inside the previous image, but behind another surface",
        "% of all pixels", _EXACT,
    ),
    Term(
        "misregistered", "misregistered",
        "A pixel that a column discards although the previous camera saw its surface point, and neither motion nor "
        "light of the point explains it: the history pixel is another sample of the surface", "% of all pixels", _EXACT,
    ),
    Term(
        "share_percent", "share misregistered",
        "Misregistered pixels divided by the pixels that the column discards, over all pairs", "%", _EXACT,
    ),
    Term(
        "missed", "missed",
        "A pixel whose point was occluded, and that no frustum, position or normal discard rules out",
        "% of all pixels", _EXACT,
    ),
    *(
        Term(f"exact_{key}", f"{key}, exact", definition, "pixels", _EXACT)
        for key, definition in (
            ("outside", "The surface point was outside the previous image"),
            ("behind", "The surface point was behind the previous camera"),
            ("new", "The surface replaced another one, or its object was hidden in the previous frame"),
            ("invalid", "A position is not finite"),
        )
    ),
    *(
        Term(f"misregistered_{f.name}", f"misregistered, {f.name}", f.misregistered, "pixels", _EXACT)
        for f in TABLE
    ),
    Term(
        "brightened", "brightened point",
        "A visible point whose own direct, else indirect, radiance changed by more than the threshold, most of it by "
        "time, and rose in luminance", "pixels", _EXACT,
    ),
    Term(
        "darkened", "darkened point", "As brightened; the luminance fell", "pixels", _EXACT,
    ),
    Term(
        "view_dependent", "view-dependent point",
        "A visible point whose own radiance changed by more than the threshold, most of it because the camera sees it "
        "from another direction: as a highlight or a reflection does", "pixels", _EXACT,
    ),
    Term(
        "light_noise", "noise of exact light",
        "Visible points whose light then differs by more than the threshold between two sets of samples of path-traced "
        "light; measured in the first, middle and last frame", "pixels", _EXACT,
    ),
)  # fmt: skip
"""Exact visibility: columns of Table 4 and of frames.csv, where it was asked for."""

EXACT_REASONS: Mapping[Visibility, Term] = {
    Visibility.OCCLUDED: Term("disoccluded", "disoccluded", EXACT["occluded"].definition, "", _EXACT),
    Visibility.OUTSIDE | Visibility.BEHIND: Term(
        "off_screen", "off-screen", "The surface point was outside the previous image, or behind its camera", "", _EXACT
    ),
    Visibility.NEW: Term("new", "new", EXACT["exact_new"].definition, "", _EXACT),
    Visibility.BRIGHTENED: EXACT["brightened"],
    Visibility.DARKENED: EXACT["darkened"],
    Visibility.VIEW_DEPENDENT: EXACT["view_dependent"],
}
"""Why the history of a point is wrong, by rays and light of the point itself.  Disjoint."""

CENSUS: Mapping[str, Term] = _by_key(
    Term(
        "dynamic_rigid_objects", "dynamic rigid objects",
        "Unskinned mesh nodes whose world transform or visibility changes", "", "Table 1",
    ),
    Term(
        "static_rigid_objects", "static rigid objects",
        "Unskinned mesh nodes whose world transform and visibility do not change",
    ),
    Term("armatures", "armatures", "Skins that deform a drawn mesh", "", "Table 1"),
    Term("bones", "bones", "Joints of the armatures, each counted once", "", "Table 1"),
    Term("static_point_lights", "static point lights", "Point lights that do not change", "", "Table 1"),
    Term(
        "dynamic_point_lights", "dynamic point lights",
        "Point lights whose position, intensity, color, range or visibility changes", "", "Table 1",
    ),
)  # fmt: skip
"""Scene statistics of Table 1, over the evaluated frames."""

FRAMES: Mapping[str, Term] = _by_key(
    Term("frame", "frame", "Number of the pair's current frame"),
    Term("time_s", "time", "Time of the current frame, frame / fps", "s"),
    Term("pixels", "pixels", "All pixels, w x h x samples per pixel", "pixels"),
    *(
        Term(f"reusable_{rate}", f"reusable {rate}", CONCEPTS[rate].definition, "pixels", _REUSABLE)
        for rate in ("surface", "shading")
    ),
    *(
        Term(term.key, term.label, term.definition, "pixels", term.source)
        for reason, term in REASONS.items()
        if reason <= Reason.OUTSIDE or reason == FRUSTUM
    ),
    Term("comparable", "comparable", CONCEPTS["comparable"].definition, "pixels", _MASKS),
    *(
        Term(term.key, term.label, term.definition, "pixels", term.source)
        for reason, term in REASONS.items()
        if reason > Reason.OUTSIDE and reason != FRUSTUM
    ),
    *(
        Term(
            f"other_reusable_{rate}", f"reusable {rate}, other reprojection",
            f"As reusable_{rate}, under motion reprojection in a run of camera reprojection, else under camera",
            "pixels", _REUSABLE,
        )
        for rate in ("surface", "shading")
    ),
    Term("translation_m", "translation", CAMERA["position"].definition, "m", _EQ_1),
    *(
        Term(f"{key}_deg", CAMERA[key].label, CAMERA[key].definition, "degrees", CAMERA[key].source)
        for key in ("yaw", "pitch", "roll", "angle")
    ),
    Term("camera_cut", "camera cut", "1 where the cut detector finds that the camera jumped", "0 or 1", _CAMERA),
    Term(
        "gimbal", "gimbal", "1 where the camera looks within 1 degree of straight up or down, so that yaw and roll "
        "follow the gimbal rule", "0 or 1", _CAMERA,
    ),
)  # fmt: skip
"""Columns of frames.csv, one row per pair.  A count column holds the pixels of the pair that have the reason."""

OPTIONS: Mapping[str, Term] = _by_key(
    Term(
        "camera", "camera reprojection",
        "Projects the current world position with the previous camera, as the paper does; moving surfaces are "
        "treated as static", "", _REPROJECTION,
    ),
    Term(
        "motion", "motion reprojection",
        "Projects the previous world position of the same surface point with the previous camera, so it follows "
        "moving surfaces", "", _REPROJECTION,
    ),
    Term("nearest", "nearest sampling", "Reads the history pixel nearest to the reprojected point", "", _REPROJECTION),
    Term(
        "bilinear", "bilinear sampling",
        "Blends the valid ones of the four history pixels around the reprojected point", "", _REPROJECTION,
    ),
    Term("frame", "history of the last frame", "The history is the image of the frame before", "", _HISTORY),
    Term(
        "eye", "history of the other eye",
        "The history is the image of the other eye at the same time: nothing has moved, and no light has changed", "",
        _HISTORY,
    ),
    Term(
        "both", "either history",
        "Every pixel has the better of both: reusable history first, then reusable but for light, then comparable; the "
        "last frame where they are equal", "", _HISTORY,
    ),
)  # fmt: skip
"""Values of ``--reprojection``, ``--sampling`` and ``--history``."""


def key_of(reason: Reason) -> str:
    """Name of a reason in files and options: ``outside``, ``history_sky``, ``frustum``."""
    return REASONS[reason].key


def label_of(reason: Reason) -> str:
    """Name of a reason for people: ``off-screen``, ``sky in history``, ``frustum``."""
    return REASONS[reason].label


def definitions(terms: Mapping[object, Term]) -> str:
    """``terms`` as aligned lines ``key   definition`` for a help text."""
    width = max(len(term.key) for term in terms.values())
    return "\n".join(f"  {term.key:<{width}}  {term.definition}" for term in terms.values())


_HEAD = """# Glossary

This page is written by `tools/record commands` from `taubench_gl/glossary.py`. The help of the command line
and the tooltips of the report and of the viewer show the same sentences. Equations are the paper's;
[conventions.md](conventions.md) explains what the paper leaves open.
"""


def page() -> str:
    """The Markdown text of docs/glossary.md."""
    bits = {reason: str(int(reason)) for reason in REASONS}
    return "\n".join(
        (
            _HEAD,
            *_section("Concepts", CONCEPTS.values()),
            *_section(
                "Reasons",
                REASONS.values(),
                "Each pixel of a pair has a mask of reason bits. The column *bit* is the value in exported masks.",
                tuple(bits.values()),
            ),
            *_section(
                "Reasons of pixels that are not reusable",
                REUSE_REASONS.values(),
                "Disjoint: a pixel counts once, under the first reason of this list that applies. The reasons and the "
                "reuse rate add up to 100 %.",
            ),
            *_section(
                "Columns of Table 4",
                COLUMNS.values(),
                "A column counts the pixels that it discards. The unit is that of the threshold.",
            ),
            *_section("Camera activity (Tables 2 and 3)", CAMERA.values()),
            *_section("Statistics", STATISTICS.values()),
            *_section("Exact visibility", EXACT.values()),
            *_section("Scene statistics (Table 1)", CENSUS.values()),
            *_section(
                "Columns of frames.csv",
                FRAMES.values(),
                "One row per pair; an empty cell was not measured. A count column holds the number of pixels that have "
                "the reason.",
            ),
            *_section("Reprojection, sampling and history", OPTIONS.values()),
        )
    )


def _section(title: str, terms: Iterable[Term], text: str = "", bits: tuple[str, ...] = ()) -> list[str]:
    """A heading and a Markdown table; ``bits`` adds a column."""
    terms = list(terms)
    heads = ["key", "label", *(["bit"] if bits else []), "definition", "unit", "source"]
    lines = [f"## {title}\n", *([f"{text}\n"] if text else [])]
    lines += ["| " + " | ".join(heads) + " |", "| " + " | ".join("---" for _ in heads) + " |"]
    for number, term in enumerate(terms):
        bit = [bits[number]] if bits else []
        lines.append(
            "| " + " | ".join([f"`{term.key}`", term.label, *bit, term.definition, term.unit, term.source]) + " |"
        )
    return [*lines, ""]
