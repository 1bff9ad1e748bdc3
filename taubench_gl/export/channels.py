"""Channels that can be exported: those of the channel table, and those derived from them."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass

import numpy as np

from taubench_gl.channels import CHANNELS, RADIANCE_UNIT
from taubench_gl.errors import SettingsError
from taubench_gl.features import LIGHT_FEATURES
from taubench_gl.lobes import SCENE_LOBES, lobe_channels

_DTYPES = {"f4": np.float32, "f2": np.float16, "u4": np.uint32}


EXACT_REASONS = "exact_reasons"
"""Channel that lights every point four times; ``all`` does not have it."""


DISPARITY = "disparity"
"""Channel of an export of both eyes, which has it by default."""


@dataclass(frozen=True, slots=True)
class ExportChannel:
    """One channel of a file: an image (h, w, components), row 0 at the top."""

    name: str
    components: int
    dtype: np.dtype
    unit: str
    doc: str
    exr: tuple[str, ...]  # one EXR channel per component
    keeps_float: bool = False  # never stored in half precision, which is too coarse for geometry


def _from_table(name: str) -> ExportChannel:
    """The components with an EXR name in the table.  The w component of position is the channel ``depth``."""
    info = CHANNELS[name]
    exr = tuple(e for e in info.exr if e and not (name == "position" and e.startswith("Depth")))
    geometry = name in ("position", "prev_position", "motion")
    return ExportChannel(name, len(exr), np.dtype(_DTYPES[info.dtype]), info.unit, info.doc, exr, geometry)


EXPORTS: dict[str, ExportChannel] = {
    c.name: c
    for c in (
        _from_table("position"),
        ExportChannel(
            "depth", 1, np.dtype(np.float32), "m", "planar depth along the view direction; 0 = no surface",
            ("Depth.Z",), True,
        ),
        *(_from_table(name) for name in CHANNELS if name not in ("position", "motion", "mask")),
        ExportChannel(
            "motion", 2, np.dtype(np.float32), "px",
            "backward: previous - current, +x right, +y down, with object motion; NaN where undefined",
            ("Motion.X", "Motion.Y"), True,
        ),
        ExportChannel(
            "motion_forward", 2, np.dtype(np.float32), "px",
            "forward: next - current, +x right, +y down, from the next pose; NaN where undefined",
            ("MotionForward.X", "MotionForward.Y"), True,
        ),
        ExportChannel(
            DISPARITY, 1, np.dtype(np.float32), "px",
            "x in the left eye - x in the right eye, of the same point; NaN where undefined", ("Disparity.X",), True,
        ),
        ExportChannel(
            "mask", 1, np.dtype(np.uint32), "bits", "reason bits against the previous frame (conventions.Reason)",
            ("Mask",), True,
        ),
        ExportChannel(
            EXACT_REASONS, 1, np.dtype(np.uint32), "bits",
            "prev_visibility and, of visible points whose light changed, why (conventions.Visibility)",
            ("ExactReasons",), True,
        ),
        ExportChannel(
            "mask_forward", 1, np.dtype(np.uint32), "bits",
            "reason bits against the next frame, with object motion, geometry only: DISOCCLUDED means hidden there",
            ("MaskForward",), True,
        ),
    )
}  # fmt: skip

PATH_INFO = "path_info"
RADIANCE_OF_ALL = "radiance"
"""Name of the channel that holds all light of a training pair, emission and background included."""


def clean_name(lobe: str) -> str:
    """Channel of the converged light of a lobe, or of ``radiance``."""
    return f"clean_{lobe}"


def noisy_name(seed: int, name: str) -> str:
    """Channel of the light of a lobe, of ``radiance`` or ``path_info``, of the input: the image number ``seed``."""
    return f"noisy{seed}_{name}"


_TRAINING = re.compile(r"(clean|noisy\d+)_(\w+)")


def channel_named(name: str) -> ExportChannel:
    """An entry of EXPORTS, or a channel of a training pair.  Raises KeyError."""
    if name in EXPORTS:
        return EXPORTS[name]
    match = _TRAINING.fullmatch(name)
    if match is None or match[2] not in (*EXPORTS, RADIANCE_OF_ALL):
        raise KeyError(name)
    kind = "converged" if match[1] == "clean" else "at few samples"
    if match[2] == RADIANCE_OF_ALL:
        exr = tuple(f"{match[1].capitalize()}.{part}" for part in "RGBA")
        return ExportChannel(
            name, 4, np.dtype(np.float32), RADIANCE_UNIT, f"rgb: radiance, exposure applied, {kind}", exr
        )
    of = EXPORTS[match[2]]
    exr = tuple(f"{match[1].capitalize()}.{part}" for part in of.exr)
    return dataclasses.replace(of, name=name, doc=f"{of.doc}, {kind}", exr=exr)


GROUPS = {
    "gbuffer": ("position", "depth", "normal", "geometric_normal", "base_color", "material", "emission", "ids"),
    "radiance": LIGHT_FEATURES,
    "lobes": lobe_channels(SCENE_LOBES),
    "flow": ("motion", "motion_forward"),
    "masks": ("mask", "mask_forward"),
}
DEFAULT = ("gbuffer", "flow", "masks")
RADIANCE = (*GROUPS["radiance"], *GROUPS["lobes"], "path_info")


def choose_channels(words: tuple[str, ...], *, stereo: bool = False) -> tuple[str, ...]:
    """Names of channels and groups -> channel names in the order of the table.  Raises SettingsError.

    ``stereo``: of an export of both eyes.
    """
    names: set[str] = set()
    for word in words or (*DEFAULT, *(DISPARITY,) * stereo):
        if word == DISPARITY and not stereo:
            raise SettingsError("disparity is between two eyes", hint="give --history eye")
        if word == "all":
            names |= EXPORTS.keys() - {EXACT_REASONS, *(DISPARITY,) * (not stereo)}
        elif word in GROUPS:
            names |= set(GROUPS[word])
        elif word in EXPORTS:
            names.add(word)
        else:
            listed = ", ".join([*GROUPS, "all", *EXPORTS])
            raise SettingsError(f"no channel is named {word!r}", hint=f"choose from {listed}")
    return tuple(name for name in EXPORTS if name in names)


def stored_as(channel: ExportChannel, precision: str) -> np.dtype:
    """The stored type: ``native`` as on the GPU, ``float`` 32 bits, ``half`` 16 bits except for geometry."""
    if channel.dtype.kind != "f":
        return channel.dtype
    if precision == "float" or (precision == "half" and channel.keeps_float):
        return np.dtype(np.float32)
    return np.dtype(np.float16) if precision == "half" else channel.dtype
