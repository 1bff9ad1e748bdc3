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

CAMERA_COLUMNS = ("translation_m", "yaw_deg", "pitch_deg", "roll_deg", "angle_deg")
"""Camera activity of a pair (Eqs. 1 and 2), meters and degrees; ``angle_deg`` is the geodesic angle."""

FRAME_COLUMNS = ("frame", "time_s", *COUNT_COLUMNS, *CAMERA_COLUMNS, "camera_cut", "gimbal")
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

Count = Annotated[int, Meta(ge=0)] | None


class Statistic(Struct):
    mean: float | None = None
    variance: float | None = None
    max: float | None = None
    median: float | None = None
    p95: float | None = None
    reason: str | None = None


class Quantity(Statistic):
    without_cuts: Statistic | None = None


class Rate(Struct):
    """A share of the pixels: a column of Table 4, a rate of reusable pixels, or a reason."""

    mean_percent: float | None = None
    comparable_mean_percent: float | None = None
    without_cuts_mean_percent: float | None = None
    min_percent: float | None = None
    max_percent: float | None = None
    of_picture_percent: float | None = None
    at_half_exposure_percent: float | None = None
    at_twice_exposure_percent: float | None = None
    method: str | None = None
    interval95_percent: list[float] | None = None
    preview_percent: float | None = None
    undecided_percent: float | None = None
    pixels: float | None = None
    reason: str | None = None


class Reason(Struct):
    mean_percent: float
    method: str | None = None
    interval95_percent: list[float] | None = None
    preview_percent: float | None = None
    pixels: float | None = None


Columns = defstruct("Columns", [(name, Rate | None, None) for name in COLUMNS])
"""Per column of Table 4."""


class Reusable(Struct):
    surface: Rate | None = None
    shading: Rate | None = None
    sky_percent: float | None = None
    reprojection: str | None = None
    reasons_of: str | None = None
    reasons: dict[str, Reason] | None = None
    color_only: Rate | None = None


class ExactRate(Rate):
    share_percent: float | None = None


class Exact(Struct):
    visible: Rate | None = None
    occluded: Rate | None = None
    outside: Rate | None = None
    behind: Rate | None = None
    new: Rate | None = None
    invalid: Rate | None = None
    misregistered: dict[str, ExactRate] | None = None
    missed: ExactRate | None = None
    brightened: Rate | None = None
    darkened: Rate | None = None
    view_dependent: Rate | None = None
    light_noise: Rate | None = None
    reprojection: str | None = None


class SceneFacts(Struct):
    name: str | None = None
    path: str | None = None
    sha256: str | None = None
    duration_s: float | None = None
    playing: list[str] | None = None
    stand_in: str | None = None


class RunSettings(Struct):
    width: float | None = None
    height: float | None = None
    fps: float | None = None
    reprojection: str | None = None
    sampling: str | None = None
    thresholds: dict[str, float] | None = None
    unit_scale: float | None = None
    samples_per_pixel: Count = None
    pairs: str | None = None
    exact: bool | None = None
    light_unit: str | None = None
    exposure: float | str | None = None
    environment: str | list[float] | None = None
    light: str | None = None
    first_frame: Count = None
    last_frame: Count = None


class CameraFacts(Struct):
    position: Quantity | None = None
    yaw: Quantity | None = None
    pitch: Quantity | None = None
    roll: Quantity | None = None
    angle: Quantity | None = None
    fps: float | None = None
    samples: float | None = None
    cuts: list[int] | None = None
    gimbal_pairs: list[int] | None = None
    source: str | None = None
    reason: str | None = None


class Census(Struct):
    dynamic_rigid_objects: Count = None
    armatures: Count = None
    bones: Count = None
    static_point_lights: Count = None
    dynamic_point_lights: Count = None
    reason: str | None = None


class Curve(Struct):
    edges: list[float] | None = None
    counts: list[int] | None = None
    at_or_above: list[int] | None = None
    comparable: int | None = None
    reason: str | None = None


class MaskHistogram(Struct):
    words: list[Count] | None = None
    pixels: list[Count] | None = None
    reason: str | None = None


class Effect(Struct):
    on: bool | None = None
    reason: str | None = None


class Timing(Struct):
    clock: str | None = None
    unit: str | None = None
    passes: dict[str, float | None] | None = None
    samples: dict[str, float | None] | None = None


class Provenance(Struct):
    version: str | None = None
    command: str | None = None
    backend: str | None = None
    renderer: str | None = None
    driver: str | None = None
    clock: str | None = None
    git: str | None = None


class Summary(Struct):
    pairs: float | None = None
    scene: SceneFacts | None = None
    settings: RunSettings | None = None
    lighting: dict[str, str | None] | None = None
    reusable: Reusable | None = None
    discard: Columns | None = None
    noise_floor: Columns | None = None
    exact: Exact | None = None
    census: Census | None = None
    camera: CameraFacts | None = None
    curves: dict[str, Curve | None] | None = None
    mask_histogram: MaskHistogram | None = None
    classes: dict[str, float | None] | None = None
    notes: list[str] | None = None
    effects: dict[str, Effect] | None = None
    timing: Timing | None = None
    path_traced: dict[str, Any] | None = None
    provenance: Provenance | None = None
    brightness: dict[str, Any] | None = None
