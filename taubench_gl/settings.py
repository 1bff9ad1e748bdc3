"""Settings of one evaluation: four immutable groups.  A field states its type, default, meaning, unit, range and place
in the help once (``fields.setting``); options, keys of files, Python keywords and their documentation follow from it.

``settings.sequence``  which frames of which scene are rendered, and at which size
``settings.metrics``   what is compared between the two frames of a pair, and how
``settings.lighting``  radiance: light, shadows, indirect light, exposure
``settings.device``    the machine that renders, and the precision of its channels

People, files and command lines name fields without their group: ``Settings(width=640, exposure=2.0)``,
``settings.replace(fps=30)``, ``settings.to_dict()`` and ``Settings.from_dict(values)``.  No two groups share a name.
Values are also accepted as the command line spells them: ``Settings(size="640x360", frames="0:24")``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from taubench_gl.camera_path_settings import CameraPathSettings
from taubench_gl.conventions import DEFAULT_FPS
from taubench_gl.errors import SettingsError
from taubench_gl.features import COLUMNS, FEATURE, FEATURES, LIGHT_FEATURES
from taubench_gl.fields import (
    NO_OPTION,
    Check,
    Checked,
    Setting,
    above_zero,
    at_least,
    declared,
    one_of,
    setting,
    unknown_field,
)
from taubench_gl.glossary import OPTIONS
from taubench_gl.setting_values import (
    AUTO,
    FLOAT32_MAX,
    MAX_EXPOSURE,
    MAX_SIZE,
    PAIR_SAMPLES,
    PAPER_SIZE,
    columns_fault,
    environment_fault,
    exposure_fault,
    pairs_fault,
    parse_animation,
    parse_columns,
    parse_environment,
    parse_frames,
    parse_number,
    parse_size,
    parse_thresholds,
    size_fault,
    thresholds_fault,
)

SCENE, PICTURE, MASKS, LIGHT, OUTPUT, FILES, MACHINE = (
    "Scene", "Picture", "Masks", "Light", "Output", "Path-traced files", "Machine",
)  # fmt: skip
"""Groups of options in the complete help of a command."""

REPROJECTIONS = ("camera", "motion")
SAMPLINGS = ("nearest", "bilinear")
HISTORIES = ("frame", "eye", "both")
EYES = ("left", "right")
CULLINGS = ("gltf", "none")
BLENDS = ("cutoff", "opaque", "stochastic")
TEXTURES = ("mipmapped", "finest")
BACKENDS = ("auto", "egl", "osmesa")
EFFECTS = ("auto", "all")
TONE_MAPS = ("linear", "reinhard", "aces")
LIGHTS = ("auto", "preview", "raster", "path-traced")
PATTERNS = ("fixed", "independent")
PREVIEWED = ("auto", "preview")
"""Methods of light whose images show the preview."""

DEFAULT_SPP = {"auto": 4, "preview": 4, "path-traced": 256}
"""Samples per pixel of path-traced light where ``spp`` is None, by ``light``."""

MAX_BOUNCES = 12
INDIRECT = ("auto", "none", "rsm", "probes")
SHADOW_FILTERS = ("hard", "bilinear")
LIGHT_UNITS = ("auto", "watt", "candela")
FIXED_LIGHTING: dict[str, Any] = {"light_unit": "candela", "exposure": 1.0, "environment": "none"}
"""Radiance as the file gives it: intensities as written, exposure 1, no environment."""

STORAGES = ("float", "half")
STEREO = ("history", "eyes", "eye", "convergence", "other_eye")
"""Settings that say which image is the history."""

DEFAULT_SIZE = (640, 360)
MAX_FRAMES = 1_000_000
"""Frames of one evaluation: more than eleven hours at 24 fps.  Per-frame data of this many frames fits in memory."""
LEAST_LENGTH = 2.0**-63
"""Least distance whose square float32 holds with all its digits."""


_SIDE = at_least(1, f"a size from 1x1 to {MAX_SIZE}x{MAX_SIZE} pixels", MAX_SIZE)


def _values(*names: str) -> str:
    """A help text that defines each of the values ``names`` as the glossary does: ``camera: ...  motion: ...``."""
    return "  ".join(f"{name}: {OPTIONS[name].sentence}" for name in names).removesuffix(".")


SIZE = Setting(
    name="size",
    kind=tuple[int, int],
    default=DEFAULT_SIZE,
    meaning="Width and height of the image in pixels; paper: {}x{}".format(*PAPER_SIZE),
    check=Check(f"a size from 1x1 to {MAX_SIZE}x{MAX_SIZE} pixels", size_fault),
    read=parse_size,
    group=PICTURE,
    short=True,
    metavar="WxH",
    shown="{}x{}".format(*DEFAULT_SIZE),
)
"""``width`` and ``height`` in one."""


@dataclass(frozen=True, slots=True)
class SequenceSettings(CameraPathSettings):
    """Which frames of which scene are rendered, by which camera, and at which size."""

    group: ClassVar[str] = SCENE

    width: int = setting(DEFAULT_SIZE[0], "Width of the image", _SIDE, unit="px", flag=NO_OPTION)
    height: int = setting(DEFAULT_SIZE[1], "Height of the image", _SIDE, unit="px", flag=NO_OPTION)
    fps: float = setting(DEFAULT_FPS, "Frames per second", above_zero("a rate above 0"), unit="1/s", short=True)
    frames: tuple[int | None, int | None] = setting(
        (None, None),
        "Frames A to B-1, a Python slice of frame numbers",
        selects=True,
        read=parse_frames,
        short=True,
        metavar="A:B",
        shown="all",
    )
    camera: str | int | None = setting(
        None,
        "Camera of the scene by node name, camera name or index, or a framing orbit",
        selects=True,
        short=True,
        metavar="NAME|INDEX|orbit",
        shown="the file's; orbit if there is none or the camera and the scene are still",
    )
    scene: str | int | None = setting(
        None, "Scene of the file", selects=True, metavar="NAME|INDEX", shown="the file's default"
    )
    animation: tuple[str | int, ...] | None = setting(
        None,
        "Animation to play; may be repeated",
        selects=True,
        read=parse_animation,
        metavar="NAME|INDEX",
        shown="all that do not collide",
        repeats=True,
    )
    strict: bool = setting(
        False,
        "Refuse scene files that depart from their format",
        selects=True,
        shown="repair them, with a note for each kind",
    )
    culling: str = setting("gltf", "Back-face culling: as the materials say, or none", one_of(CULLINGS), group=PICTURE)
    blend: str = setting(
        "cutoff",
        "Blended surfaces (alpha mode BLEND).  cutoff: drawn where alpha is at least 0.5.  opaque: drawn everywhere.  "
        "stochastic: drawn with a probability of alpha, the same in every frame",
        one_of(BLENDS),
        group=PICTURE,
    )
    textures: str = setting(
        "mipmapped",
        "finest: no mipmaps, as a path tracer samples textures at pixel centers",
        one_of(TEXTURES),
        group=PICTURE,
    )

    @property
    def reading(self) -> dict[str, Any]:
        """Arguments of ``scene.load_scene`` besides the path."""
        return {"scene": self.scene, "animation": self.animation, "strict": self.strict}

    def frame_count(self, duration: float) -> int:
        """Frames of an animation of ``duration`` seconds: i = 0 .. floor(duration fps (1 + 2^-23) + 1e-6).

        Key times are float32: n / fps rounded down would lose frame n from n = 50 on at 24 fps without the factor.
        Raises SettingsError where a float64 cannot count the frames.
        """
        if not duration * self.fps < 2.0**53:
            what = f"{duration:g} s at {self.fps:g} fps have no countable frames"
            raise SettingsError(what, hint="give a lower --fps", setting="fps")
        return math.floor(duration * self.fps * (1.0 + 2.0**-23) + 1e-6) + 1

    def frame_range(self, duration: float) -> range:
        """Frame numbers to evaluate, as ``frames`` slices them.  Raises SettingsError for more than MAX_FRAMES."""
        first, stop = self.frames
        count = self.frame_count(duration)
        frames = range(count)[slice(first, stop)]
        if frames.stop - frames.start > MAX_FRAMES:
            what = f"{frames.stop - frames.start} frames are more than {MAX_FRAMES}"
            hint = f"the scene has {count} at {self.fps:g} fps"
            raise SettingsError(f"{what}: give --frames A:B", hint=hint, setting="frames")
        return frames


@dataclass(frozen=True, slots=True)
class MetricsSettings(Checked):
    """What is compared between the two frames of a pair, and how."""

    group: ClassVar[str] = MASKS

    reprojection: str = setting("camera", _values(*REPROJECTIONS), one_of(REPROJECTIONS), short=True)
    sampling: str = setting("nearest", _values(*SAMPLINGS), one_of(SAMPLINGS))
    thresholds: Mapping[str, float] = setting(
        {},
        "Threshold of color, position (meters), normal, direct or indirect, a_B of the paper; may be repeated",
        Check("finite numbers of at least 0 for " + ", ".join(FEATURES), thresholds_fault, FEATURES),
        read=parse_thresholds,
        flag="--threshold",
        metavar="NAME=V",
        shown="32/255",
        repeats=True,
    )
    unit_scale: float = setting(1.0, "Scene units per meter", above_zero("a factor above 0"), unit="1/m", group=SCENE)
    columns: tuple[str, ...] = setting(
        COLUMNS,
        f"Columns of Table 4 to measure, comma-separated: {', '.join(COLUMNS)}; what no column needs is not simulated",
        Check("names from " + ", ".join(COLUMNS), columns_fault, COLUMNS),
        read=parse_columns,
        short=True,
        metavar="LIST",
        shown="all",
    )
    samples_per_pixel: int = setting(
        1,
        "Sub-pixel positions at which both frames of a pair are rendered and classified",
        at_least(1, "1 to 64", 64),
        group=PICTURE,
    )
    pairs: str = setting(
        AUTO,
        "Pairs to evaluate: every K-th, or two from each of H strata; with confidence intervals.  auto: all of an "
        "animation as long as the paper's, else strata:H; with path-traced light as many as take about a minute",
        Check(f"one of {', '.join(PAIR_SAMPLES)}", pairs_fault),
        metavar="|".join(PAIR_SAMPLES),
    )
    exact: bool = setting(
        False,
        "Compare the masks with exact visibility, a ray to every surface point, and with the light of the same points: "
        "Table 4 gains the columns visible and occluded, and the share of each column that is misregistration "
        "(docs/reject.md)",
    )

    history: str = setting("frame", _values(*HISTORIES), one_of(HISTORIES), short=True)
    eyes: float = setting(
        0.064, "Distance of the other eye from the camera", above_zero("a distance above 0"), unit="m", metavar="METERS"
    )
    eye: str = setting("left", "Which eye the camera is: the other one is to its right, or to its left", one_of(EYES))
    convergence: float | None = setting(
        None,
        "Distance in front of the eyes at which both show a point at the same pixel, by off-axis projection of the "
        "other one",
        above_zero("a distance in front of the camera, above 0"),
        unit="m",
        metavar="METERS",
        shown="infinitely far: parallel eyes",
    )
    other_eye: str | int | None = setting(
        None,
        "Camera of the scene that is the other eye, by node name, camera name or index",
        metavar="NAME|INDEX",
        shown="one at the distance --eyes",
    )

    @property
    def stereo(self) -> bool:
        """Whether the history of a frame is the other eye."""
        return self.history == "eye"

    def __post_init__(self) -> None:
        # super() without arguments does not work in a dataclass with slots: the decorator makes another class.
        Checked.__post_init__(self)
        if self.history == "both" and (self.exact or self.samples_per_pixel > 1):
            what = "history both chooses between two images in every pixel"
            hint = "leave exact visibility and samples per pixel out, or give --history frame or eye"
            raise SettingsError(what, hint=hint, setting="history")
        filled = {name: float(self.thresholds.get(name, FEATURE[name].threshold)) for name in FEATURES}
        object.__setattr__(self, "thresholds", filled)
        for name in FEATURES:
            if self.threshold(name) > FLOAT32_MAX or 0.0 < self.threshold(name) < LEAST_LENGTH:
                what = f"threshold of {name} is {self.threshold(name):g} with unit scale {self.unit_scale:g}"
                hint = f"masks square distances as float32, give 0, or {LEAST_LENGTH:.2g} to {FLOAT32_MAX:g}"
                raise SettingsError(what, hint=hint, setting="thresholds")

    def threshold(self, feature: str) -> float:
        """a_B of ``feature`` as the masks use it; position in scene units: meters times ``unit_scale``."""
        value = self.thresholds[feature]
        return value * self.unit_scale if feature == "position" else value

    @property
    def pair_scheme(self) -> tuple[str, int]:
        """``pairs`` as (all | every | strata, number)."""
        return scheme_of(self.pairs)

    @property
    def lit(self) -> bool:
        """Whether a column depends on light."""
        return not set(LIGHT_FEATURES).isdisjoint(self.columns)

    @property
    def decidable(self) -> bool:
        """Whether light columns can be asked of single pixels: one sample per pixel, no exact visibility, which compare
        whole images."""
        return self.lit and not self.exact and self.samples_per_pixel == 1

    @property
    def all_pairs(self) -> bool:
        """Whether every pair is evaluated, as ``pairs`` says or by default."""
        return self.pair_scheme == ("all", 1)


@dataclass(frozen=True, slots=True)
class LightingSettings(Checked):
    """Radiance: light, shadows, indirect light, exposure."""

    group: ClassVar[str] = LIGHT

    effects: str = setting(
        "auto", "auto: simulate the effects that scene and columns need.  all: simulate every effect", one_of(EFFECTS)
    )
    light_unit: str = setting(
        AUTO,
        "Unit of punctual lights.  watt: intensities divided by 683, as Blender exports them.  candela: as written.  "
        "auto: watt for files of Blender's exporter 3.4 or newer",
        one_of(LIGHT_UNITS),
    )
    exposure: float | str = setting(
        AUTO,
        "Factor on radiance before thresholds and tone mapping, or auto: 1 for watt, else metered",
        Check(f"auto, or a factor from {1 / MAX_EXPOSURE:g} to {MAX_EXPOSURE:g}", exposure_fault),
        read=parse_number,
        group=PICTURE,
        metavar="VALUE",
    )
    environment: str | tuple[float, float, float] = setting(
        AUTO,
        "Light from all around: none, default (a uniform sky and a sun), R,G,B (uniform radiance), an equirectangular "
        "FILE.hdr or FILE.exr, or auto: default where the file has no light",
        Check("auto, none, default, three radiances of at least 0 or a .hdr or .exr file", environment_fault),
        read=parse_environment,
        metavar="ENVIRONMENT",
    )
    light: str = setting(
        AUTO,
        "Method of light.  auto: path-traced at random pixels, with intervals; images show the preview.  preview: "
        "raster, with few path-traced samples for emissive surfaces of strength above 1, and for an environment "
        "without punctual lights.  raster: shadow maps, unoccluded environment; emissive surfaces light nothing.  "
        "path-traced: all light of every pixel by path tracing, as many samples as each pixel needs; with --spp N "
        "images of N samples",
        one_of(LIGHTS),
        short=True,
    )
    light_within: float = setting(
        1.0,
        "Half width of the 95 % interval at which sampling of light columns ends, percentage points",
        above_zero("a number of points above 0"),
        unit="points",
        short=True,
        metavar="POINTS",
    )
    light_time: float | None = setting(
        None,
        "Seconds after which no further round of sampled light begins, in place of a number of samples: results then "
        "depend on the machine",
        above_zero("seconds above 0"),
        unit="s",
        metavar="SECONDS",
        shown="2 million samples",
    )
    spp: int | None = setting(
        None,
        "Samples per pixel of path-traced light, in images",
        at_least(1, "1 to 1048576 samples", 2**20),
        shown=f"as many as each pixel needs; in images {DEFAULT_SPP['path-traced']}, of the preview "
        f"{DEFAULT_SPP['preview']}",
    )
    bounces: int = setting(
        MAX_BOUNCES, "Most bounces of a path; 1: direct light alone", at_least(1, f"1 to {MAX_BOUNCES}", MAX_BOUNCES)
    )
    pattern: str = setting(
        "fixed",
        "Sample pattern of path-traced light.  fixed: the same numbers in every pixel and frame, so that noise is not "
        "counted as change.  independent: other numbers in every pixel and frame, as a renderer",
        one_of(PATTERNS),
    )
    bidirectional: bool = setting(
        False,
        "Path-traced indirect light also by paths from point and spot lights: less noise where one is close to a "
        "surface, more time per sample",
    )
    seed: int = setting(
        0, "Seed of the sample pattern of path-traced light", at_least(0, "an integer from 0 to 2^31 - 1", 2**31 - 1)
    )
    tone_map: str = setting("linear", "Curve from radiance x exposure to color", one_of(TONE_MAPS), group=PICTURE)
    shadow_size: int = setting(
        1024,
        "Texels along a shadow-map face; directional lights get four times as many",
        at_least(16, "16 to 4096 texels", 4096),
        unit="texels",
        metavar="TEXELS",
    )
    shadow_lights: int = setting(24, "Lights with shadows, the most significant first", at_least(0))
    shadow_filter: str = setting(
        "bilinear",
        "Filter of the shadow-map lookup.  hard: nearest texel.  bilinear: weighted mean of four texels",
        one_of(SHADOW_FILTERS),
    )
    indirect: str = setting(
        "auto",
        "Indirect light of the raster method; not with path-traced light.  none: the column is null.  rsm: one bounce "
        "by reflective shadow maps, without occlusion between surfaces.  probes: up to four bounces, without detail "
        "below the probe spacing.  auto: probes",
        one_of(INDIRECT),
    )
    indirect_samples: int = setting(
        1024, "Virtual point lights (VPLs) of indirect light, of all lights together", at_least(1), flag="--vpls"
    )
    probes: int = setting(768, "Approximate number of irradiance probes", at_least(8))
    light_error: float = setting(
        1e-3,
        "Radiance times exposure that light culling may leave out of a tile",
        at_least(0, "a radiance from 0 to 1e+30", 1e30),
        metavar="RADIANCE",
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.light == "path-traced" and self.indirect != AUTO:
            what = f"indirect is {self.indirect} and light is path-traced, whose indirect light is path-traced"
            raise SettingsError(what, hint="leave indirect out, or give light raster", setting="indirect")

    @property
    def decides(self) -> bool:
        """Whether light is path-traced and no number of samples is given, so that each pixel can have its own."""
        return self.light == "path-traced" and self.spp is None

    @property
    def path_samples(self) -> int:
        """Samples per pixel of path-traced light."""
        return DEFAULT_SPP.get(self.light, DEFAULT_SPP[AUTO]) if self.spp is None else self.spp

    @property
    def resolved(self) -> bool:
        """Whether light unit, exposure and environment have concrete values."""
        return AUTO not in (self.light_unit, self.exposure, self.environment)

    @property
    def exposure_factor(self) -> float:
        """``exposure`` as a number.  Raises ValueError if it is ``auto``."""
        if isinstance(self.exposure, str):
            raise ValueError("exposure is auto: call evaluation.resolve_lighting first")
        return self.exposure


@dataclass(frozen=True, slots=True)
class DeviceSettings(Checked):
    """The machine that renders, and the precision of its channels."""

    group: ClassVar[str] = MACHINE

    backend: str = setting(
        "auto", "Library that opens the OpenGL context", one_of(BACKENDS), selects=True, variable="TAUBENCH_BACKEND"
    )
    device: int | None = setting(
        None,
        "Index of the EGL device; see 'taubench-gl doctor'",
        at_least(0),
        selects=True,
        shown="the first that works",
    )
    storage: str = setting(
        "float", "Component type of channels between passes: 32-bit (float) or 16-bit (half)", one_of(STORAGES)
    )


@dataclass(frozen=True, slots=True, init=False)
class Settings:
    """Settings of one evaluation, by field name: ``Settings(width=640, exposure=2.0)``.

    Also accepted: whole groups (``sequence=``, ``metrics=``, ``lighting=``, ``device=``), ``size`` instead of width and
    height (``"640x360"`` or (640, 360)), ``frames`` as (A, B), ``"A:B"``, a range or a slice, ``columns`` and
    ``thresholds`` as text (``"position,normal"``, ``"normal=0.1"``), and numbers as text.  Raises SettingsError.
    """

    sequence: SequenceSettings
    metrics: MetricsSettings
    lighting: LightingSettings
    device: DeviceSettings

    def __init__(self, **values: Any) -> None:
        for name, kind in GROUPS.items():
            # ``device`` names a group and a field of it.
            is_group = isinstance(values.get(name), kind)
            object.__setattr__(self, name, values.pop(name) if is_group else kind())
        for name, group in self._changed(values).items():
            object.__setattr__(self, name, group)

    def replace(self, **values: Any) -> Settings:
        """These settings with other values, named as in ``Settings(...)``.  Raises SettingsError."""
        return Settings(**{name: getattr(self, name) for name in GROUPS} | self._changed(values))

    def _changed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The groups of settings that ``values`` changes, by the name of the group."""
        groups: dict[str, Any] = {}
        changed: dict[str, dict[str, Any]] = {}
        for name, value in _with_sides(values).items():
            if name in GROUPS and isinstance(value, GROUPS[name]):
                groups[name] = value
            else:
                group = _group_of(name)
                changed.setdefault(group, {})[name] = FIELDS[name].value_of(value)
        for group, of_group in changed.items():
            groups[group] = dataclasses.replace(groups.get(group, getattr(self, group)), **of_group)
        return groups

    def require_exact(self) -> None:
        """Raises SettingsError where exact visibility is impossible: positions are not those of one ray per pixel."""
        if self.metrics.samples_per_pixel > 1:
            raise SettingsError("exact visibility is at one sample per pixel", hint="leave samples per pixel at 1")
        if self.device.storage != "float":
            raise SettingsError("exact visibility needs positions of 32 bits", hint="leave --storage at float")

    def get(self, name: str) -> Any:
        """The value of one field, by its name without the group.  Raises SettingsError for a name that is none."""
        return getattr(getattr(self, _group_of(name)), name)

    def to_dict(self) -> dict[str, Any]:
        """All fields by name without their group, as plain JSON values.  Lengths in meters."""
        return {name: _plain(self.get(name)) for name in FIELDS}

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Settings:
        """The inverse of ``to_dict``; fields left out get their defaults.

        Raises SettingsError for a name that is no setting, and a value of the wrong type or out of range.
        """
        for name in values:
            _group_of(name)
        return Settings(**values)

    def as_summary(self, frames: range) -> dict[str, Any]:
        """The ``settings`` block of summary.json: ``to_dict`` and the frames evaluated, without ``SELECTING``.

        Lengths in meters.
        """
        plain = {name: value for name, value in self.to_dict().items() if name not in SELECTING}
        ends = {"first_frame": frames[0] if frames else None, "last_frame": frames[-1] if frames else None}
        return plain | ends


GROUPS: dict[str, type] = {
    "sequence": SequenceSettings,
    "metrics": MetricsSettings,
    "lighting": LightingSettings,
    "device": DeviceSettings,
}
_GROUP_OF = {field: name for name, group in GROUPS.items() for field in declared(group)}
FIELDS: dict[str, Setting] = {name: field for group in GROUPS.values() for name, field in declared(group).items()}
"""Every field by name."""

KEYS: dict[str, Setting] = {"size": SIZE, **FIELDS}
"""What people may give: in files, as keywords and, but for NO_OPTION, as options.  ``size`` sets width and height."""

SELECTING = tuple(name for name, field in FIELDS.items() if field.selects)
"""Fields that name the scene, frames or machine of a run: no part of a preset, and recorded elsewhere in a summary."""


def read_key(key: str, value: Any) -> dict[str, Any]:
    """The fields, by name, that a key of a file sets, as ``Settings(...)`` takes them.

    ``-`` and ``_`` in ``key`` are the same.  Raises SettingsError for a key that is no setting, and for a value of the
    wrong type or out of range.
    """
    name = key.replace("-", "_")
    if name not in KEYS:
        raise unknown_setting(name)
    value = KEYS[name].value_of(value)
    fields = {"width": value[0], "height": value[1]} if name == "size" else {name: value}
    Settings(**fields)  # checks the ranges
    return fields


def scheme_of(pairs: str) -> tuple[str, int]:
    """``MetricsSettings.pairs`` as (all | every | strata, number); ``auto`` is all until it is resolved."""
    pairs = "all" if pairs == AUTO else pairs
    scheme, _, number = pairs.partition(":")
    return scheme, int(number or 1)


def unknown_setting(name: str, others: tuple[str, ...] = ()) -> SettingsError:
    """The error for a name that is no setting; ``others``: further names allowed where it was given."""
    return unknown_field(name, (*others, *KEYS))


def _group_of(name: str) -> str:
    if name in GROUPS and name not in _GROUP_OF:
        raise SettingsError(f"{name} is no {GROUPS[name].__name__}", hint="give its fields by name", setting=name)
    if name not in _GROUP_OF:
        raise unknown_setting(name)
    return _GROUP_OF[name]


def _with_sides(values: Mapping[str, Any]) -> dict[str, Any]:
    """``values`` with ``width`` and ``height`` in place of ``size``."""
    values = dict(values)
    if "size" in values:
        values["width"], values["height"] = parse_size(values.pop("size"))
    return values


def _plain(value: Any) -> Any:
    """``value`` as a JSON value: tuples become lists, mappings dicts."""
    if isinstance(value, Mapping):
        return dict(value)
    return [_plain(element) for element in value] if isinstance(value, tuple) else value
