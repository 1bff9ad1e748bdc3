"""The columns of frames.csv, and types of the keys of summary.json that readers of a stored run rely on.

Other keys and missing ones are allowed.
"""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta, Struct, defstruct

from taubench_gl.features import BY_BIT, COLUMNS, FEATURES

COUNT_COLUMNS = (
    "pixels", "reusable_surface", "reusable_shading", "first", "cut", "invalid", "sky", "history_sky", "behind",
    "outside", "frustum", "comparable", *(f.name for f in BY_BIT), "disoccluded", "occluding", "lit", "shadowed",
)  # fmt: skip
"""Pixel counts of a pair, exact integers; ``frustum`` = ``behind`` + ``outside``."""

OTHER_COLUMNS = ("other_reusable_surface", "other_reusable_shading")
"""Reusable pixels under the reprojection that is not the run's, ``motion`` for ``camera``; equal if nothing moves."""

CAMERA_COLUMNS = ("translation_m", "yaw_deg", "pitch_deg", "roll_deg", "angle_deg")
"""Camera activity of a pair (Eqs. 1 and 2), meters and degrees; ``angle_deg`` is the geodesic angle."""

FRAME_COLUMNS = ("frame", "time_s", *COUNT_COLUMNS, *OTHER_COLUMNS, *CAMERA_COLUMNS, "camera_cut", "gimbal")
"""Columns of frames.csv, one row per pair: ``frame`` is the later frame of the pair, ``time_s`` its time.

``camera_cut`` and ``gimbal`` are 0 or 1 (``cut`` counts pixels with the reason CUT).  A value that was not measured is
``None`` here and an empty cell in the file.
"""

EXACT_COLUMNS = (
    "visible", "occluded", "exact_outside", "exact_behind", "exact_new", "exact_invalid",
    *(f"misregistered_{name}" for name in FEATURES), "missed", "brightened", "darkened", "view_dependent",
    "light_noise",
)  # fmt: skip
"""More columns of a run with exact visibility: pixel counts (``evaluation.exact``)."""

DECIDED_COLUMNS = ("traced", "undecided", "audited", "audited_wrong", "light_samples")
"""More columns of a run that decides every pixel: pixels whose masks depend on light; of these the undecided ones,
those traced to the limit although they were decided, and those found wrong by that; samples of light, of both
frames."""

SAMPLED_COLUMNS = ("sampled", *(f"sampled_{f.name}" for f in BY_BIT if f.light))
"""More columns of a run with sampled light: sampled pixels of the pair, and those that path-traced light discards, an
undecided pixel by its weight, so that the sum can be a fraction; the other columns are the preview's."""


def _block(name: str, base: type[Struct] | None = None, /, **kinds: Any) -> Any:
    """A block of summary.json: each key may be missing or null, or has the type that its keyword gives."""
    return defstruct(name, [(key, kind | None, None) for key, kind in kinds.items()], bases=base and (base,))


Count = Annotated[int, Meta(ge=0)]

Statistic = _block("Statistic", mean=float, variance=float, max=float, median=float, p95=float, reason=str)
Quantity = _block("Quantity", Statistic, without_cuts=Statistic)
Share = _block(
    "Share", mean_percent=float, method=str, interval95_percent=list[float], preview_percent=float,
    pixels=float, reason=str,
)  # fmt: skip
Rate = _block(
    "Rate", Share, comparable_mean_percent=float, without_cuts_mean_percent=float, min_percent=float,
    max_percent=float, of_picture_percent=float, at_half_exposure_percent=float, at_twice_exposure_percent=float,
    undecided_percent=float, share_percent=float, of_surface_percent=float,
)  # fmt: skip
"""A share of the pixels: a column of Table 4, a rate of reusable pixels, or a fate of pixels."""
Columns = _block("Columns", **dict.fromkeys(COLUMNS, Rate))
"""A rate per column of Table 4."""
Reprojected = _block("Reprojected", surface=Rate, shading=Rate)
Reusable = _block(
    "Reusable", surface=Rate, shading=Rate, camera=Reprojected, motion=Reprojected, sky_percent=float,
    reprojection=str, reasons_of=str, reasons=dict[str, Share], color_only=Share,
)  # fmt: skip
Exact = _block(
    "Exact", misregistered=dict[str, Rate], reprojection=str,
    **dict.fromkeys(("visible", "occluded", "outside", "behind", "new", "invalid", "missed", "brightened", "darkened",
                     "view_dependent", "light_noise"), Rate),
)  # fmt: skip
SceneFacts = _block(
    "SceneFacts", name=str, path=str, sha256=str, duration_s=float, playing=list[str], stand_in=str,
    selection=dict[str, Any],
)  # fmt: skip
RunSettings = _block(
    "RunSettings", width=float, height=float, fps=float, reprojection=str, sampling=str,
    thresholds=dict[str, float], unit_scale=float, samples_per_pixel=Count, pairs=str, exact=bool, light_unit=str,
    exposure=float | str, environment=str | list[float], light=str, first_frame=Count, last_frame=Count,
)  # fmt: skip
CameraFacts = _block(
    "CameraFacts", position=Quantity, yaw=Quantity, pitch=Quantity, roll=Quantity, angle=Quantity, fps=float,
    samples=float, cuts=list[int], gimbal_pairs=list[int], source=str, reason=str,
)  # fmt: skip
Census = _block(
    "Census", dynamic_rigid_objects=Count, armatures=Count, bones=Count, static_point_lights=Count,
    dynamic_point_lights=Count, reason=str,
)  # fmt: skip
Curve = _block("Curve", edges=list[float], counts=list[int], at_or_above=list[int], comparable=int, reason=str)
MaskHistogram = _block("MaskHistogram", words=list[Count], pixels=list[Count], reason=str)
Effect = _block("Effect", on=bool, reason=str)
Timing = _block(
    "Timing", clock=str, unit=str, passes=dict[str, float | None], samples=dict[str, float | None]
)  # fmt: skip
Provenance = _block("Provenance", **dict.fromkeys(
    ("version", "command", "backend", "renderer", "driver", "clock", "git"), str
), definitions=int)  # fmt: skip
Summary = _block(
    "Summary", pairs=float, scene=SceneFacts, settings=RunSettings, lighting=dict[str, str | None],
    reusable=Reusable, discard=Columns, noise_floor=Columns, exact=Exact, census=Census, camera=CameraFacts,
    curves=dict[str, Curve | None], mask_histogram=MaskHistogram, classes=dict[str, float | None], notes=list[str],
    effects=dict[str, Effect], timing=Timing, path_traced=dict[str, Any], provenance=Provenance,
    brightness=dict[str, Any],
)  # fmt: skip
"""What readers of summary.json rely on."""
