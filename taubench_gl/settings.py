"""What a user can choose about an evaluation.  One immutable object, checked when made."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from taubench_gl.conventions import COLUMNS, DEFAULT_FPS, DEFAULT_THRESHOLD, FEATURES
from taubench_gl.errors import SettingsError

REPROJECTIONS = ("camera", "motion")
SAMPLINGS = ("nearest", "bilinear")
CULLINGS = ("gltf", "none")
TEXTURES = ("mipmapped", "finest")
BACKENDS = ("auto", "egl", "osmesa")
EFFECTS = ("auto", "all")
TONE_MAPS = ("linear", "reinhard", "aces")
INDIRECT = ("auto", "none", "rsm", "probes")
SHADOW_FILTERS = ("hard", "bilinear")
STORAGES = ("float", "half")
SUMMATIONS = ("integer", "compensated", "plain")
PAIR_SAMPLES = ("all", "every:K", "strata:H")
_PAIR_SAMPLE = re.compile(r"all|(every|strata):([1-9][0-9]{0,6})")
MAX_SIZE = 16384
MAX_FRAMES = 1_000_000
"""Frames of one evaluation: more than eleven hours at 24 fps.  What is kept per frame fits in memory up to here."""
_FLOAT32_MAX = 3.4e38


def scheme_of(pairs: str) -> tuple[str, int]:
    """``Settings.pairs`` as (all | every | strata, number)."""
    scheme, _, number = pairs.partition(":")
    return scheme, int(number or 1)


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of one evaluation.

    ``frames`` is a Python slice (A, B) of frame numbers, ``None`` for a default end.  ``thresholds`` maps a feature of
    ``conventions.FEATURES`` to its a_B; the position threshold is in metres *before* ``unit_scale`` multiplies it.
    """

    width: int = 1920
    height: int = 1080
    fps: float = DEFAULT_FPS
    frames: tuple[int | None, int | None] = (None, None)
    camera: str | int | None = None  # node name, camera name or index; None: the first, else a framing orbit
    scene: str | int | None = None
    animation: tuple[str | int, ...] | None = None  # None: all that do not collide
    reprojection: str = "camera"
    sampling: str = "nearest"
    thresholds: Mapping[str, float] = field(default_factory=dict)
    unit_scale: float = 1.0
    culling: str = "gltf"
    textures: str = "mipmapped"  # finest: no mipmaps, as a path tracer's pixel-centre samples read them
    columns: tuple[str, ...] = COLUMNS  # columns asked for; what no column needs is not simulated
    effects: str = "auto"  # auto: what the scene calls for | all: everything, needed or not
    sky: tuple[float, float, float] = (0.0, 0.0, 0.0)  # uniform sky radiance, linear
    exposure: float = 1.0  # factor on radiance before thresholds and tone mapping
    tone_map: str = "linear"
    shadow_size: int = 1024  # texels along a shadow face; directional maps have four times as many
    shadow_lights: int = 8  # lights that get shadows, the most significant first
    shadow_filter: str = "bilinear"
    indirect: str = "auto"  # auto | none | rsm | probes
    indirect_samples: int = 1024  # virtual lights, all lights together
    probes: int = 768  # irradiance probes, about
    light_error: float = 1e-3  # radiance that light culling may leave out of a tile
    storage: str = "float"  # of channels between passes: float | half (32 or 16 bits a component)
    samples_per_pixel: int = 1  # sub-pixel places at which both frames of a pair are drawn and judged
    pairs: str = "all"  # pairs looked at: all | every:K | strata:H (two drawn from each of H stretches)
    summation: str = "integer"  # of pixel counts over pairs: integer (exact) | compensated | plain (float32)
    histogram_bits: int = 3  # 2^bits bins per octave of the discard-versus-threshold curves
    backend: str = "auto"
    device: int | None = None

    def __post_init__(self) -> None:
        for name, value in (("width", self.width), ("height", self.height)):
            if not 1 <= value <= MAX_SIZE:
                raise SettingsError(f"{name} is {value}", hint=f"give a size from 1x1 to {MAX_SIZE}x{MAX_SIZE} pixels")
        if not (math.isfinite(self.fps) and self.fps > 0):
            raise SettingsError(f"fps is {self.fps}", hint="give a rate above 0")
        if not (math.isfinite(self.unit_scale) and self.unit_scale > 0):
            raise SettingsError(f"unit scale is {self.unit_scale}", hint="give a factor above 0")
        for option, value, allowed in (
            ("reprojection", self.reprojection, REPROJECTIONS),
            ("sampling", self.sampling, SAMPLINGS),
            ("culling", self.culling, CULLINGS),
            ("textures", self.textures, TEXTURES),
            ("backend", self.backend, BACKENDS),
            ("effects", self.effects, EFFECTS),
            ("tone map", self.tone_map, TONE_MAPS),
            ("indirect rung", self.indirect, INDIRECT),
            ("shadow filter", self.shadow_filter, SHADOW_FILTERS),
            ("storage", self.storage, STORAGES),
            ("summation", self.summation, SUMMATIONS),
        ):
            if value not in allowed:
                raise SettingsError(f"{option} is {value!r}", hint=f"choose from {', '.join(allowed)}")
        for name in self.columns:
            if name not in COLUMNS:
                raise SettingsError(f"no column is named {name!r}", hint=f"choose from {', '.join(COLUMNS)}")
        if not (math.isfinite(self.exposure) and self.exposure > 0):
            raise SettingsError(f"exposure is {self.exposure}", hint="give a factor above 0")
        if len(self.sky) != 3 or not all(math.isfinite(c) and c >= 0 for c in self.sky):
            raise SettingsError(f"sky is {self.sky}", hint="give three radiances of at least 0: R,G,B")
        if not 16 <= self.shadow_size <= 4096:
            raise SettingsError(f"shadow size is {self.shadow_size}", hint="give 16 to 4096 texels")
        for name, value, least in (("indirect samples", self.indirect_samples, 1), ("probes", self.probes, 8)):
            if value < least:
                raise SettingsError(f"{name} is {value}", hint=f"give at least {least}")
        if self.shadow_lights < 0:
            raise SettingsError(f"shadow lights is {self.shadow_lights}", hint="give 0 or more")
        if not (math.isfinite(self.light_error) and self.light_error >= 0):
            raise SettingsError(f"light error is {self.light_error}", hint="give a radiance of at least 0")
        if not 1 <= self.samples_per_pixel <= 64:
            raise SettingsError(f"samples per pixel is {self.samples_per_pixel}", hint="give 1 to 64")
        if not 0 <= self.histogram_bits <= 8:
            raise SettingsError(f"histogram bits is {self.histogram_bits}", hint="give 0 to 8")
        if _PAIR_SAMPLE.fullmatch(self.pairs) is None:
            raise SettingsError(f"pairs is {self.pairs!r}", hint=f"choose from {', '.join(PAIR_SAMPLES)}")
        for name, value in self.thresholds.items():
            if name not in FEATURES:
                raise SettingsError(f"no feature is named {name!r}", hint=f"choose from {', '.join(FEATURES)}")
            if not (math.isfinite(value) and value >= 0):
                raise SettingsError(f"threshold of {name} is {value}", hint="give a finite number of at least 0")
        for name in FEATURES:
            if self.threshold(name) > _FLOAT32_MAX:
                what = f"threshold of {name} is {self.threshold(name):g} with unit scale {self.unit_scale:g}"
                raise SettingsError(what, hint=f"masks compare float32, give at most {_FLOAT32_MAX:g}")

    def threshold(self, feature: str) -> float:
        """a_B of ``feature`` as the masks use it: position in scene units, metres times ``unit_scale``."""
        value = float(self.thresholds.get(feature, DEFAULT_THRESHOLD))
        return value * self.unit_scale if feature == "position" else value

    @property
    def pair_scheme(self) -> tuple[str, int]:
        """``pairs`` as (all | every | strata, number)."""
        return scheme_of(self.pairs)

    def frame_count(self, duration: float) -> int:
        """Frames of an animation of ``duration`` seconds: i = 0 .. floor(duration fps (1 + 2^-23) + 1e-6).

        Key times are float32: n / fps rounded down would lose frame n from n = 50 on at 24 fps without the factor.
        Any number, however large.  Raises SettingsError where a float64 cannot count them.
        """
        if not duration * self.fps < 2.0**53:
            what = f"{duration:g} s at {self.fps:g} fps have no countable frames"
            raise SettingsError(what, hint="give a lower --fps")
        return math.floor(duration * self.fps * (1.0 + 2.0**-23) + 1e-6) + 1

    def frame_range(self, duration: float) -> range:
        """Frame numbers to evaluate, as ``frames`` slices them.  Raises SettingsError for more than MAX_FRAMES."""
        first, stop = self.frames
        count = self.frame_count(duration)
        frames = range(count)[slice(first, stop)]
        if frames.stop - frames.start > MAX_FRAMES:
            what = f"{frames.stop - frames.start} frames are more than {MAX_FRAMES}"
            hint = f"the scene has {count} at {self.fps:g} fps"
            raise SettingsError(f"{what}: give --frames A:B", hint=hint)
        return frames

    def as_summary(self, frames: range) -> dict[str, Any]:
        """The ``settings`` block of summary.json; ``thresholds``: as the masks use them."""
        return {
            "width": self.width,
            "height": self.height,
            "fps": self.fps,
            "first_frame": frames[0] if frames else None,
            "last_frame": frames[-1] if frames else None,
            "reprojection": self.reprojection,
            "sampling": self.sampling,
            "thresholds": {name: self.threshold(name) for name in FEATURES},
            "unit_scale": self.unit_scale,
            "culling": self.culling,
            "textures": self.textures,
            "columns": list(self.columns),
            "effects": self.effects,
            "sky": list(self.sky),
            "exposure": self.exposure,
            "tone_map": self.tone_map,
            "shadow_size": self.shadow_size,
            "shadow_lights": self.shadow_lights,
            "shadow_filter": self.shadow_filter,
            "indirect": self.indirect,
            "indirect_samples": self.indirect_samples,
            "probes": self.probes,
            "light_error": self.light_error,
            "storage": self.storage,
            "samples_per_pixel": self.samples_per_pixel,
            "pairs": self.pairs,
            "summation": self.summation,
            "histogram_bits": self.histogram_bits,
        }
