"""Groups of options beside Settings, as dataclasses of fields (``fields.setting``)."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from taubench_gl.errors import SettingsError
from taubench_gl.fields import Check, Checked, above_zero, at_least, declared, one_of, setting, some_of, value_text
from taubench_gl.lobes import LOBES
from taubench_gl.settings import (
    DEFAULT_SPP,
    FILES,
    MASKS,
    OUTPUT,
    PAPER_SIZE,
    SIZE,
    LightingSettings,
    parse_size,
)

MAX_SEEDS = 64
"""Most noisy images of one exported frame."""

DEFAULT_METRICS = ("psnr", "ssim", "flip", "relmse", "tpsnr", "flicker", "warp_error")
"""PSNR, relMSE and the linear MSE are always computed."""

METRICS = (*DEFAULT_METRICS, "hdr_flip", "lpips", "cvvdp")
"""Metrics of reuse methods: the default ones, and those that take more time or another package."""

FITTED_METRICS = METRICS[:-1]
"""Metrics with a value of every frame."""

REUSE_SETTINGS = (
    "fps", "size", "thresholds", "unit_scale",
    *(name for name in declared(LightingSettings) if name not in ("effects", "probes")),
)  # fmt: skip
"""Settings that evaluations of reuse methods depend on, besides those that name the scene, frames and machine."""


@dataclass(frozen=True, slots=True)
class PathTracedOptions(Checked):
    """How path-traced files are read, and the lobes to measure.  At most one of ``camera_file`` and ``scene_file``.

    Raises SettingsError.
    """

    group: ClassVar[str] = FILES

    camera_file: str | Path | None = setting(
        None, "Camera sidecar of the frames", metavar="JSON", shown="that of an export, else estimated"
    )
    scene_file: str | Path | None = setting(
        None, "glTF file with the camera of the frames; check compares their motion with it", metavar="SCENE"
    )
    mapping: str | Path | None = setting(
        None,
        "Names and conventions of the passes: babylon, blender, eevee, falcor, godot, luxcore, mitsuba, taubench, "
        "three-webgl, three-webgpu, unity, unreal or a TOML file",
        metavar="NAME|FILE",
        shown="taubench for an export, else blender",
    )
    layer: str | None = setting(None, "View layer", metavar="NAME", shown="the one with most passes")
    view: str | None = setting(None, "View of stereo files, as left", metavar="NAME", shown="the first")
    second_seed: str | Path | None = setting(
        None, "The same frames with another seed, for the noise floor", metavar="exr:DIR"
    )
    lobes: tuple[str, ...] = setting(
        (),
        "Also measure this lobe of direct and indirect apart; may be repeated.  Null with its reason where scene or "
        "files have none",
        some_of(LOBES),
        group=MASKS,
        flag="--lobe",
        repeats=True,
    )

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.camera_file is not None and self.scene_file is not None:
            raise SettingsError("a camera file and a scene file are given", hint="give one")


LIGHT_SAMPLES = setting(1, "noisy: light samples per pixel", at_least(1))
VPL_SAMPLES = setting(4, "noisy: VPL samples per pixel", at_least(1))
REFERENCE_SAMPLES = setting(16, "max: samples per pixel", at_least(1))
"""Fields of the same names of ``export`` and ``reuse evaluate``: their light is the same by the same words."""


@dataclass(frozen=True, slots=True)
class TrainingOptions(Checked):
    """Light of an export for training, by the words of ``reuse evaluate``.  Raises SettingsError."""

    input: str | None = setting(
        None,
        "Also export the radiance that reuse methods get by these words of 'reuse evaluate --input', such as "
        "path-traced@1: noisy0_radiance, and noisy0_direct_diffuse, ... where paths are traced",
        metavar="KIND",
        shown="none",
    )
    light_samples: int = LIGHT_SAMPLES
    vpl_samples: int = VPL_SAMPLES
    seeds: int = setting(
        1,
        "Images of the input, with this many seeds from --seed on: noisy0_*, noisy1_*, ...",
        at_least(1, most=MAX_SEEDS),
        metavar="S",
    )
    reference: str | None = setting(
        None,
        "Also export the reference that methods are compared with, clean_radiance.  path-traced@M: M samples per "
        "pixel, also per lobe; stored, see 'reference list'.  max: exact light of the raster method, supersampled",
        metavar="path-traced@M|max",
        shown="none",
    )
    reference_samples: int = REFERENCE_SAMPLES

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.seeds > 1 and self.input is None:
            raise SettingsError("seeds are of an input", hint="give --input path-traced@1")

    @property
    def wanted(self) -> bool:
        """Whether any light is exported."""
        return self.input is not None or self.reference is not None


NO_TRAINING = TrainingOptions()

LEARNING = ("nss", "noisebase")
"""Formats of an export that are data for learning: noisy and clean light."""


@dataclass(frozen=True, slots=True)
class ExportOptions(Checked):
    """What to export and how.  Raises SettingsError for an unknown value."""

    group: ClassVar[str] = OUTPUT

    format: str = setting(
        "exr",
        "exr: multilayer OpenEXR.  npz: NumPy.  zarr: Zarr v3, one chunk per frame.  sintel: the MPI-Sintel layout.  "
        "nss: data of ng-model-gym for super sampling.  noisebase: data of noisebase for denoising",
        one_of(("exr", "npz", "zarr", "sintel", *LEARNING)),
        short=True,
    )
    channels: tuple[str, ...] = setting(
        (), "Names and groups of channels, see below", short=True, shown="gbuffer,flow,masks"
    )
    precision: str = setting(
        "native",
        "native: as on the GPU.  float: 32 bits.  half: 16 bits except for positions, depth and motion",
        one_of(("native", "float", "half")),
    )
    jitter: str = setting(
        "none",
        "Sub-pixel offset of the samples of each frame; not part of motion",
        one_of(("none", "halton")),
    )
    training: TrainingOptions = NO_TRAINING

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.training.wanted and self.format == "sintel":
            raise SettingsError("light for training is no part of the Sintel layout", hint="give another --format")


@dataclass(frozen=True, slots=True)
class ReuseOptions(Checked):
    """On which frames reuse methods are evaluated, and with which reference.  Raises SettingsError."""

    input: str = setting(
        "path-traced@1",
        "Frames to reuse: path-traced@N: light of N samples per pixel, others in every pixel and frame, each of one "
        "punctual light, with +all-lights of every one; full, or some of jittered, noisy, half, checkerboard, quarter, "
        "and upscale@S (frames S times smaller than the result), joined by +; or exr:DIR, path-traced frames with the "
        "camera of SCENE",
        short=True,
        metavar="KIND",
    )
    metrics: tuple[str, ...] = setting(
        DEFAULT_METRICS,
        "Metrics to compute; also hdr_flip, lpips and cvvdp, which need more time or packages",
        some_of(METRICS),
        short=True,
    )
    light_samples: int = LIGHT_SAMPLES
    vpl_samples: int = VPL_SAMPLES
    reference: str | None = setting(
        None,
        "path-traced: path-traced light with the samples that fit --reference-time, or as few as leave no noise "
        "to see; path-traced@M: of M samples per pixel; both stored and extended.  max: exact light of the raster "
        "method, supersampled.  exr:DIR: path-traced frames with the same numbers",
        short=True,
        metavar="max|path-traced[@M]|exr:DIR",
        shown="path-traced for path-traced input, else max",
    )
    reference_time: float = setting(
        120.0, "path-traced: time for references that are not stored", above_zero(), metavar="SECONDS"
    )
    reference_samples: int = REFERENCE_SAMPLES
    mapping: str | None = setting(
        None,
        "exr: names of the passes: blender, falcor, godot, mitsuba, taubench, unity, unreal or a TOML file",
        metavar="NAME|FILE",
        shown="taubench for an export, else blender",
    )
    render_every: int = setting(
        2, "Methods that generate frames: one of this many frames is rendered", at_least(2), metavar="N"
    )
    seeds: int = setting(
        1,
        "Repeat the frames with this many seeds, from --seed on; five or more give intervals over seeds",
        at_least(1),
    )
    warmup: int = setting(1, "First frames that means and intervals leave out", at_least(1))
    cuts: tuple[int, ...] = setting(
        (), "Frame declared to have no history; may be repeated", flag="--cut", repeats=True
    )


@dataclass(frozen=True, slots=True)
class FitOptions(Checked):
    """How the settings of a reuse method are searched.  Raises SettingsError."""

    metric: str = setting(
        "flip", "Metric to optimize; a single bright pixel can dominate relmse", one_of(FITTED_METRICS), short=True
    )
    refine: int = setting(1, "Finer grids around the best point", at_least(0), short=True)


def _seconds(value: Any) -> Any:
    """Seconds that ``90s``, ``5m`` or ``1h`` spells, None for ``none``; other values come back unchanged."""
    if not isinstance(value, str):
        return value
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh]?)|none", value.strip())
    if match is None:
        raise SettingsError(f"{value!r} is no time", hint="give one such as 90s, 5m, 1h, or none")
    return float(match[1]) * {"s": 1.0, "": 1.0, "m": 60.0, "h": 3600.0}[match[2]] if match[1] else None


@dataclass(frozen=True, slots=True)
class CostOptions(Checked):
    """What a cost study measures and compares with.  Raises SettingsError."""

    truth_within: float = setting(
        0.25,
        "Half width of the 95 % interval of the truth, percentage points; at most 16 evaluations of decided samples",
        above_zero("a number of points above 0"),
        unit="points",
        short=True,
        metavar="POINTS",
    )
    time: float | None = setting(
        90.0,
        "Time of all evaluations, such as 90s, 5m or none: what is not expected to fit is left out.  At most half of "
        "it is for the truth",
        above_zero("a time above 0"),
        read=_seconds,
        short=True,
        metavar="T",
        shown="90s",
    )
    clock: str = setting(
        "wall",
        "Seconds of picture and choice; cpu: of all cores of the processor, for software renderers beside other work",
        one_of(("wall", "cpu")),
        short=True,
    )
    repeats: int = setting(3, "Evaluations of a configuration that takes at most 5 s, whose median counts", at_least(1))


def _rates_fault(name: str, rates: Any) -> str | None:
    good = rates and len(set(rates)) == len(rates) and all(0.0 < rate < math.inf for rate in rates)
    return None if good else value_text(name, rates)


@dataclass(frozen=True, slots=True)
class PaperOptions(Checked):
    """What of the paper's tables is measured, and how.  Raises SettingsError."""

    size: tuple[int, int] = setting(
        PAPER_SIZE,
        "Size of the images of Table 4",
        SIZE.check,
        read=parse_size,
        short=True,
        metavar="WxH",
        shown="{}x{}".format(*PAPER_SIZE),
    )
    lights: tuple[str, ...] = setting(
        ("auto",),
        "Light of Table 4, one row each: auto (path-traced at random pixels, with intervals), raster, path-traced (of "
        "whole images), comma-separated",
        some_of(("auto", "raster", "path-traced"), least=1),
        short=True,
        flag="--light",
    )
    fps: tuple[float, ...] = setting(
        (24.0, 60.0),
        "Rates of Table 4, one row each: the paper renders at 24 and captures at 60, comma-separated",
        Check("different numbers above 0", _rates_fault),
        shown="24,60",
        metavar="R,...",
    )
    spp: int | None = setting(
        None, "Samples per pixel of path-traced light", at_least(1), short=True, shown=str(DEFAULT_SPP["path-traced"])
    )
    lobes: tuple[str, ...] = setting(
        (), "Also measure this lobe apart; may be repeated", some_of(LOBES), short=True, flag="--lobe", repeats=True
    )
    quick: bool = setting(False, "Table 4 of 8 pairs spread over the animation, with confidence intervals", short=True)

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if self.spp is not None and "path-traced" not in self.lights:
            raise SettingsError("samples per pixel are of path-traced light", hint="give --light path-traced")


@dataclass(frozen=True, slots=True)
class WorkerOptions(Checked):
    """How many worker processes run the units of a study, and how many pairs a unit has."""

    workers: int = setting(0, "Worker processes; 0: none, all in this process", at_least(0), short=True)
    chunk: int | None = setting(
        None, "Pairs per unit of work; does not change results", metavar="PAIRS", shown="automatic"
    )


@dataclass(frozen=True, slots=True)
class RenderOptions(Checked):
    """How Cycles renders reference images.  The paper uses 1024 samples and 12 bounces.  Raises SettingsError."""

    samples: int = setting(64, "Samples per pixel", at_least(1, most=2**31 - 1), short=True)
    bounces: int = setting(12, "Longest path", at_least(0, most=2**31 - 1), short=True)
    seed: int = setting(0, "Seed of the noise", at_least(0, most=2**31 - 1), short=True)
    seed_per_frame: bool = setting(
        True,
        "Independent noise in every frame, or the same pattern in all frames",
        flag="--seed-per-frame/--one-seed",
        shown="seed-per-frame",
    )
    crisp: bool = setting(False, "Sample pixel centers only, as a rasterizer does", short=True)
    threads: int = setting(0, "CPU threads of Blender", at_least(0), shown="all cores")
