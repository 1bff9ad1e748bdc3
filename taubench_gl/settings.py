"""Settings of one evaluation: four immutable groups, each field declared once with its unit, range and meaning.

``settings.sequence``  which frames of which scene are rendered, and at which size
``settings.metrics``   what is compared between the two frames of a pair, and how
``settings.lighting``  radiance: light, shadows, indirect light, exposure
``settings.device``    the machine that renders, and the precision of its channels

People, files and command lines name fields without their group: ``Settings(width=640, exposure=2.0)``,
``settings.replace(fps=30)``, ``settings.to_dict()`` and ``Settings.from_dict(values)``.  No two groups share a name.
Values are also accepted as the command line spells them: ``Settings(size="640x360", frames="0:24")``.
"""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import math
import operator
import os
import re
import typing
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from taubench_gl.conventions import DEFAULT_FPS
from taubench_gl.errors import SettingsError
from taubench_gl.features import COLUMNS, FEATURE, FEATURES, LIGHT_FEATURES

REPROJECTIONS = ("camera", "motion")
SAMPLINGS = ("nearest", "bilinear")
CULLINGS = ("gltf", "none")
BLENDS = ("cutoff", "opaque", "stochastic")
TEXTURES = ("mipmapped", "finest")
BACKENDS = ("auto", "egl", "osmesa")
EFFECTS = ("auto", "all")
TONE_MAPS = ("linear", "reinhard", "aces")
LIGHTS = ("auto", "raster", "path-traced")
PATTERNS = ("fixed", "independent")
DEFAULT_SPP = {"auto": 16, "path-traced": 256}
"""Samples per pixel of path-traced light where ``spp`` is None, by ``light``; with ``auto`` until it is resolved."""

MAX_BOUNCES = 12
INDIRECT = ("auto", "none", "rsm", "probes")
SHADOW_FILTERS = ("hard", "bilinear")
LIGHT_UNITS = ("auto", "watt", "candela")
FIXED_LIGHTING: dict[str, Any] = {"light_unit": "candela", "exposure": 1.0, "environment": "none"}
"""Radiance as the file gives it: intensities as written, exposure 1, no environment."""

AUTO = "auto"
"""Value of ``light_unit``, ``exposure`` and ``environment`` until ``evaluation.resolve_lighting`` has chosen one."""

ENVIRONMENTS = ("auto", "none", "default")
"""Values of ``environment`` besides a radiance (r, g, b) and the path of an image."""

ENVIRONMENT_FILES = (".hdr", ".exr")
MAX_EXPOSURE = 1e30
"""Radiance times exposure stays within float32; 1 / ``MAX_EXPOSURE`` is the least exposure."""

STORAGES = ("float", "half")
PAIR_SAMPLES = ("auto", "all", "every:K", "strata:H")
_PAIR_SAMPLE = re.compile(r"auto|all|(every|strata):([1-9][0-9]{0,6})")

DEFAULT_SIZE = (640, 360)
PAPER_SIZE = (1920, 1080)
"""Pixels; ``size`` names the second one ``paper``: the images of Table 4."""

MAX_SIZE = 16384
MAX_FRAMES = 1_000_000
"""Frames of one evaluation: more than eleven hours at 24 fps.  Per-frame data of this many frames fits in memory."""
_FLOAT32_MAX = 3.4e38
LEAST_LENGTH = 2.0**-63
"""Least distance whose square float32 holds with all its digits."""


@dataclass(frozen=True, slots=True)
class Check:
    """Allowed values of a setting."""

    text: str  # completes "give ..."
    fault: Callable[[str, Any], str | None]  # (name in words, value) -> what is wrong, None if nothing is
    words: tuple[str, ...] = ()  # that the value, or each name in it, is one of

    def hint(self, value: Any) -> str:
        """How to correct ``value``: the word that is nearest to the first unknown one, else what is allowed."""
        names = [value] if isinstance(value, str) else value if isinstance(value, Collection) else ()
        unknown = next((name for name in names if isinstance(name, str) and name not in self.words), "")
        near = difflib.get_close_matches(unknown, self.words, 1)
        return f"did you mean {near[0]}?" if near else f"give {self.text}"


def _is(name: str, value: Any) -> str:
    return f"{name} is {value!r:.60}"


def _at_least(least: float, text: str, most: float = math.inf) -> Check:
    """A finite number in [least, most]."""
    return Check(text, lambda name, x: None if math.isfinite(x) and least <= x <= most else _is(name, x))


def _above_zero(text: str) -> Check:
    """A finite number above 0."""
    return Check(text, lambda name, x: None if math.isfinite(x) and x > 0 else _is(name, x))


def _one_of(allowed: tuple[str, ...]) -> Check:
    return Check(f"one of {', '.join(allowed)}", lambda name, x: None if x in allowed else _is(name, x), allowed)


def _columns_fault(_name: str, value: Any) -> str | None:
    return next((f"no column is named {column!r:.60}" for column in value if column not in COLUMNS), None)


def _environment_fault(name: str, value: Any) -> str | None:
    if isinstance(value, str):
        return None if value in ENVIRONMENTS or value.lower().endswith(ENVIRONMENT_FILES) else _is(name, value)
    return None if len(value) == 3 and all(0 <= c <= _FLOAT32_MAX for c in value) else _is(name, value)


def _exposure_fault(name: str, value: Any) -> str | None:
    if isinstance(value, str):
        return None if value == AUTO else _is(name, value)
    return None if 1.0 / MAX_EXPOSURE <= value <= MAX_EXPOSURE else _is(name, value)


def _pairs_fault(name: str, value: Any) -> str | None:
    return None if _PAIR_SAMPLE.fullmatch(value) else _is(name, value)


def _thresholds_fault(_name: str, value: Any) -> str | None:
    for feature, threshold in value.items():
        if feature not in FEATURES:
            return f"no feature is named {feature!r:.60}"
        if not (math.isfinite(threshold) and threshold >= 0):
            return f"threshold of {feature} is {threshold!r}"
    return None


def _setting(default: Any, meaning: str, check: Check | None = None, *, unit: str = "", selects: bool = False) -> Any:
    """A field.  ``selects``: it names the scene, frames or machine of a run, so presets and summaries leave it out."""
    metadata = {"meaning": meaning, "unit": unit, "check": check, "selects": selects}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=default.copy, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


class _Group:
    """Checks every field when the group is made.  Raises SettingsError."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for field in dataclasses.fields(typing.cast(Any, self)):
            check, value = field.metadata["check"], getattr(self, field.name)
            if check is None:
                continue
            try:
                fault = check.fault(field.name.replace("_", " "), value)
            except (TypeError, AttributeError, OverflowError):
                fault = _is(field.name.replace("_", " "), value)
            if fault is not None:
                raise SettingsError(fault, hint=check.hint(value), setting=field.name)


_SIZE = _at_least(1, f"a size from 1x1 to {MAX_SIZE}x{MAX_SIZE} pixels", MAX_SIZE)


@dataclass(frozen=True, slots=True)
class SequenceSettings(_Group):
    """Which frames of which scene are rendered, and at which size."""

    width: int = _setting(DEFAULT_SIZE[0], "width of the image", _SIZE, unit="px")
    height: int = _setting(DEFAULT_SIZE[1], "height of the image", _SIZE, unit="px")
    fps: float = _setting(DEFAULT_FPS, "frames per second", _above_zero("a rate above 0"), unit="1/s")
    frames: tuple[int | None, int | None] = _setting(
        (None, None), "Python slice (A, B) of frame numbers; None: the default end", selects=True
    )
    camera: str | int | None = _setting(
        None,
        "node name, camera name, index or orbit; None: the file's, a framing orbit if there is none or all is still",
        selects=True,
    )
    scene: str | int | None = _setting(None, "name or index of the file's scene; None: its default", selects=True)
    animation: tuple[str | int, ...] | None = _setting(
        None, "animations to play; None: all that do not collide", selects=True
    )
    strict: bool = _setting(
        False, "refuse files that depart from their format, instead of a repair with a note", selects=True
    )
    culling: str = _setting("gltf", "back-face culling: as the materials say, or none", _one_of(CULLINGS))
    blend: str = _setting(
        "cutoff",
        "blended surfaces: drawn where alpha is at least 0.5, everywhere, or with a probability of alpha",
        _one_of(BLENDS),
    )
    textures: str = _setting(
        "mipmapped", "finest: no mipmaps, as a path tracer samples textures at pixel centers", _one_of(TEXTURES)
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
class MetricsSettings(_Group):
    """What is compared between the two frames of a pair, and how."""

    reprojection: str = _setting(
        "camera", "history position: camera motion alone, or all motion", _one_of(REPROJECTIONS)
    )
    sampling: str = _setting("nearest", "reconstruction filter of the history lookup", _one_of(SAMPLINGS))
    thresholds: Mapping[str, float] = _setting(
        {},
        "a_B per feature, in its unit (position: meters); features left out get the default",
        Check("finite numbers of at least 0 for " + ", ".join(FEATURES), _thresholds_fault, FEATURES),
    )
    unit_scale: float = _setting(1.0, "scene units per meter", _above_zero("a factor above 0"), unit="1/m")
    columns: tuple[str, ...] = _setting(
        COLUMNS,
        "columns to measure; what no column needs is not simulated",
        Check("names from " + ", ".join(COLUMNS), _columns_fault, COLUMNS),
    )
    samples_per_pixel: int = _setting(
        1,
        "sub-pixel positions at which both frames of a pair are rendered and compared",
        _at_least(1, "1 to 64", 64),
    )
    pairs: str = _setting(
        AUTO,
        "pairs to evaluate: all | every:K | strata:H (two from each of H strata); auto: all of an animation as long as "
        "the paper's, else strata:H; with path-traced light as many as take about a minute",
        Check(f"one of {', '.join(PAIR_SAMPLES)}", _pairs_fault),
    )
    exact: bool = _setting(
        False,
        "compare the masks with exact visibility and with the light of the same points",
    )

    def __post_init__(self) -> None:
        # super() without arguments does not work in a dataclass with slots: the decorator makes another class.
        _Group.__post_init__(self)
        filled = {name: float(self.thresholds.get(name, FEATURE[name].threshold)) for name in FEATURES}
        object.__setattr__(self, "thresholds", filled)
        for name in FEATURES:
            if self.threshold(name) > _FLOAT32_MAX or 0.0 < self.threshold(name) < LEAST_LENGTH:
                what = f"threshold of {name} is {self.threshold(name):g} with unit scale {self.unit_scale:g}"
                hint = f"masks square distances as float32, give 0, or {LEAST_LENGTH:.2g} to {_FLOAT32_MAX:g}"
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
    def all_pairs(self) -> bool:
        """Whether every pair is evaluated, as ``pairs`` says or by default."""
        return self.pair_scheme == ("all", 1)


@dataclass(frozen=True, slots=True)
class LightingSettings(_Group):
    """Radiance: light, shadows, indirect light, exposure."""

    effects: str = _setting("auto", "effects to simulate: those that scene and columns need, or all", _one_of(EFFECTS))
    light_unit: str = _setting(
        AUTO,
        "unit of punctual light intensities; watt: 683 lm are 1 W, as Blender exports them",
        _one_of(LIGHT_UNITS),
    )
    exposure: float | str = _setting(
        AUTO,
        "factor on radiance before thresholds and tone mapping; auto: 1 for watt, else metered",
        Check(f"auto, or a factor from {1 / MAX_EXPOSURE:g} to {MAX_EXPOSURE:g}", _exposure_fault),
    )
    environment: str | tuple[float, float, float] = _setting(
        AUTO,
        "light from all around: auto, none, default (a uniform sky and a sun), a uniform radiance R,G,B or an "
        "equirectangular image (.hdr, .exr); auto: default where the file has no light",
        Check("auto, none, default, three radiances of at least 0 or a .hdr or .exr file", _environment_fault),
    )
    light: str = _setting(
        AUTO,
        "method of light: raster, path-traced, or auto: raster, and path tracing for emissive surfaces and the "
        "environment",
        _one_of(LIGHTS),
    )
    spp: int | None = _setting(
        None,
        f"samples per pixel of path-traced light; None: {DEFAULT_SPP['path-traced']}, with light auto as few as the "
        "measured noise allows",
        Check("1 to 1048576 samples", lambda name, x: None if x is None or 1 <= x <= 2**20 else _is(name, x)),
    )
    bounces: int = _setting(
        MAX_BOUNCES, "most bounces of a path; 1: direct light alone", _at_least(1, f"1 to {MAX_BOUNCES}", MAX_BOUNCES)
    )
    pattern: str = _setting(
        "fixed",
        "sample pattern of path-traced light; fixed: the same numbers in every pixel and frame, independent: others in "
        "each",
        _one_of(PATTERNS),
    )
    bidirectional: bool = _setting(
        False,
        "path-traced indirect light also by paths from point and spot lights; less noise where one is close to a "
        "surface, more time per sample",
    )
    seed: int = _setting(
        0, "seed of the sample pattern of path-traced light", _at_least(0, "an integer from 0 to 2^31 - 1", 2**31 - 1)
    )
    tone_map: str = _setting("linear", "curve from radiance x exposure to color", _one_of(TONE_MAPS))
    shadow_size: int = _setting(
        1024,
        "texels along a shadow-map face; directional lights get four times as many",
        _at_least(16, "16 to 4096 texels", 4096),
        unit="texels",
    )
    shadow_lights: int = _setting(24, "lights with shadows, the most significant first", _at_least(0, "0 or more"))
    shadow_filter: str = _setting("bilinear", "filter of the shadow-map lookup", _one_of(SHADOW_FILTERS))
    indirect: str = _setting("auto", "method of the raster method's indirect light", _one_of(INDIRECT))
    indirect_samples: int = _setting(1024, "virtual point lights of all lights together", _at_least(1, "at least 1"))
    probes: int = _setting(768, "approximate number of irradiance probes", _at_least(8, "at least 8"))
    light_error: float = _setting(
        1e-3,
        "radiance times exposure that light culling may leave out of a tile",
        _at_least(0, "a radiance from 0 to 1e+30", 1e30),
    )

    def __post_init__(self) -> None:
        _Group.__post_init__(self)
        if self.light == "path-traced" and self.indirect != AUTO:
            what = f"indirect is {self.indirect} and light is path-traced, whose indirect light is path-traced"
            raise SettingsError(what, hint="leave indirect out, or give light raster", setting="indirect")

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
class DeviceSettings(_Group):
    """The machine that renders, and the precision of its channels."""

    backend: str = _setting("auto", "library that opens the OpenGL context", _one_of(BACKENDS), selects=True)
    device: int | None = _setting(None, "index of the EGL device; None: the first that works", selects=True)
    storage: str = _setting(
        "float", "component type of channels between passes: 32-bit (float) or 16-bit (half)", _one_of(STORAGES)
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
            given = isinstance(values.get(name), kind)
            object.__setattr__(self, name, values.pop(name) if given else kind())
        for name, group in self._changed(values).items():
            object.__setattr__(self, name, group)

    def replace(self, **values: Any) -> Settings:
        """These settings with other values, named as in ``Settings(...)``.  Raises SettingsError."""
        return Settings(**{name: getattr(self, name) for name in GROUPS} | self._changed(values))

    def _changed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The groups that ``values`` changes, by name."""
        groups: dict[str, Any] = {}
        changed: dict[str, dict[str, Any]] = {}
        for name, value in _with_sides(values).items():
            if name in GROUPS and isinstance(value, GROUPS[name]):
                groups[name] = value
            else:
                group = _group_of(name)
                changed.setdefault(group, {})[name] = read_value(name, value)
        for group, some in changed.items():
            groups[group] = dataclasses.replace(groups.get(group, getattr(self, group)), **some)
        return groups

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
        converted = {}
        for name, value in values.items():
            _group_of(name)
            converted[name] = _converted(name, value)
        return Settings(**converted)

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
_GROUP_OF = {field.name: name for name, group in GROUPS.items() for field in dataclasses.fields(group)}
FIELDS: dict[str, dataclasses.Field[Any]] = {f.name: f for group in GROUPS.values() for f in dataclasses.fields(group)}
"""Every field by name; ``metadata`` holds ``meaning``, ``unit``, ``check`` and ``selects``."""

FIELD_TYPES = {name: kind for group in GROUPS.values() for name, kind in typing.get_type_hints(group).items()}

SELECTING = tuple(name for name, field in FIELDS.items() if field.metadata["selects"])
"""Fields that name the scene, frames or machine of a run: no part of a preset, and recorded elsewhere in a summary."""


# Values as people write them


def parse_size(value: Any) -> tuple[int, int]:
    """(width, height) of ``"1280x720"``, ``"paper"`` or two numbers.  Raises SettingsError; checks no range."""
    if isinstance(value, str) and value == "paper":
        return PAPER_SIZE
    sides = value.lower().split("x") if isinstance(value, str) else value
    with contextlib.suppress(TypeError, ValueError):
        width, height = (int(side) if isinstance(side, str) else operator.index(side) for side in sides)
        return width, height
    raise SettingsError(f"{value!r:.60} is not a size", hint="give a size such as 1280x720, or paper", setting="size")


def parse_frames(value: Any) -> tuple[int | None, int | None]:
    """(A, B) of ``"A:B"``, a range, a slice or two numbers; a missing end is None.  Raises SettingsError."""
    hint = "give a range of frames such as 0:24, 100: or :-1"
    if isinstance(value, range | slice):
        if value.step not in (None, 1):
            hint = 'every K-th pair: pairs="every:K"'
            raise SettingsError(f"frames have the step {value.step}", hint=hint, setting="frames")
        value = (value.start, value.stop)
    ends = [end.strip() or None for end in value.split(":")] if isinstance(value, str) else value
    with contextlib.suppress(TypeError, ValueError):
        first, stop = (int(e) if isinstance(e, str) else e if e is None else operator.index(e) for e in ends)
        return first, stop
    raise SettingsError(f"{value!r:.60} is not a range of frames", hint=hint, setting="frames")


def parse_threshold(text: str) -> tuple[str, float]:
    """(feature, threshold) of ``"normal=0.1"``.  Raises SettingsError; the name is checked later."""
    name, equals, number = text.partition("=")
    with contextlib.suppress(ValueError):
        if equals:
            return name.strip(), float(number)
    raise SettingsError(f"{text!r:.60} is not a threshold", hint="give one such as normal=0.1", setting="thresholds")


def _parse_thresholds(value: Any) -> Any:
    """A mapping, or thresholds as text: ``"normal=0.1,color=0.2"``."""
    return dict(map(parse_threshold, value.split(","))) if isinstance(value, str) else value


def _parse_columns(value: Any) -> Any:
    """Names of columns without duplicates, from a sequence or comma-separated text; a set in the order of Table 4."""
    if isinstance(value, str):
        value = [name.strip() for name in value.split(",")]
    if isinstance(value, set | frozenset):
        value = [name for name in COLUMNS if name in value] + sorted(map(str, value - {*COLUMNS}))
    return tuple(dict.fromkeys(map(str, value))) if isinstance(value, list | tuple) else value


def _parse_animation(value: Any) -> Any:
    """One animation stands for a sequence of one; an empty sequence for all."""
    return (value,) if isinstance(value, str | int) else value or None


def parse_environment(text: Any) -> Any:
    """The value of ``environment`` that ``text`` spells: one number or R,G,B is a radiance (r, g, b).

    Values that are neither text nor numbers are returned unchanged.
    """
    if isinstance(text, float | int) and not isinstance(text, bool):
        return (text,) * 3
    if not isinstance(text, str):
        return text
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return text
    return numbers * 3 if len(numbers) == 1 else numbers


PARSERS: dict[str, Callable[[Any], Any]] = {
    "frames": parse_frames,
    "thresholds": _parse_thresholds,
    "columns": _parse_columns,
    "animation": _parse_animation,
    "environment": parse_environment,
}
"""Fields with more than one spelling -> the function that reads them."""


def read_value(name: str, value: Any) -> Any:
    """``value`` of a field, as people write it, in the field's type.  Raises SettingsError; ranges are not checked."""
    value, kind = _python(value), FIELD_TYPES[name]
    kinds = (kind, *typing.get_args(kind))
    # ``camera`` and ``scene`` keep text: a number may be a name.
    if isinstance(value, str) and (int in kinds or float in kinds) and name not in ("camera", "scene"):
        with contextlib.suppress(ValueError):
            value = float(value) if float in kinds else int(value)
    if name in PARSERS:
        value = PARSERS[name](value)
    return _converted(name, value)


def scheme_of(pairs: str) -> tuple[str, int]:
    """``MetricsSettings.pairs`` as (all | every | strata, number); ``auto`` is all until it is resolved."""
    pairs = "all" if pairs == AUTO else pairs
    scheme, _, number = pairs.partition(":")
    return scheme, int(number or 1)


def unknown_setting(name: str, others: tuple[str, ...] = ()) -> SettingsError:
    """The error for a name that is no setting; ``others``: further names allowed where it was given."""
    near = difflib.get_close_matches(name, [*FIELDS, "size", *others], 1)
    hint = f"did you mean {near[0]}?" if near else f"choose from {', '.join([*others, 'size', *FIELDS])}"
    return SettingsError(f"no setting is named {name!r}", hint=hint, setting=name)


def _group_of(name: str) -> str:
    if name in GROUPS and name not in _GROUP_OF:
        raise SettingsError(f"{name} is no {GROUPS[name].__name__}", hint="give its fields by name", setting=name)
    if name not in _GROUP_OF:
        raise unknown_setting(name)
    return _GROUP_OF[name]


def _with_sides(values: Mapping[str, Any]) -> dict[str, Any]:
    """``values`` with ``size`` as width and height."""
    values = dict(values)
    if "size" in values:
        values["width"], values["height"] = parse_size(values.pop("size"))
    return values


def _converted(name: str, value: Any) -> Any:
    """``value`` in the type of the field.  Raises SettingsError."""
    try:
        return msgspec.convert(value, FIELD_TYPES[name])
    except (msgspec.ValidationError, UnicodeError, AttributeError) as error:
        reason = str(error).replace("`", "") if isinstance(error, msgspec.ValidationError) else "of another type"
        what = f"{name} is {value!r:.60}: {reason}"
        check = FIELDS[name].metadata["check"]
        raise SettingsError(what, hint=check.hint(value) if check else None, setting=name) from None


def _python(value: Any) -> Any:
    """NumPy numbers and arrays as Python numbers and lists, a path as text; inside mappings too."""
    if isinstance(value, Mapping):
        return {key: _python(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(_python(one) for one in value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.tolist() if hasattr(value, "tolist") else value


def _plain(value: Any) -> Any:
    """JSON values: tuples as lists, mappings as dicts."""
    if isinstance(value, Mapping):
        return dict(value)
    return [_plain(one) for one in value] if isinstance(value, tuple) else value
