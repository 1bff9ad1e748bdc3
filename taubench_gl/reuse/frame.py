"""Inputs of a reuse method for one frame: the table of inputs, the record, and conversion to and from arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.channels import RADIANCE_UNIT
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.reprojection import Reprojection


@dataclass(frozen=True, slots=True)
class InputInfo:
    """One texture that a method can read.  ``components`` and ``dtype`` as in ``channels.ChannelInfo``."""

    name: str
    components: int
    dtype: str
    unit: str
    doc: str


MIN_ALBEDO = 0.01
"""Smallest component of the albedos that light is divided by."""

MAX_REACTIVE = 0.9
"""Largest value of ``reactive``: AMD's advice for FidelityFX Super Resolution 2, which discards all history at 1."""

_AT_LEAST = f"at least {MIN_ALBEDO}"

INPUTS: dict[str, InputInfo] = {
    info.name: info
    for info in (
        InputInfo(
            "radiance", 4, "f4", RADIANCE_UNIT,
            "rgb: this frame's radiance, linear, exposure applied, with the noise and resolution of the input kind; "
            "a: 1 where the pixel was shaded in this frame, 0 where it was filled from its nearest shaded neighbor",
        ),
        InputInfo(
            "direct", 4, "f4", RADIANCE_UNIT,
            "rgb: the direct light in radiance, with the surface's color, exposure applied; without a surface, "
            "radiance; a: as radiance",
        ),
        InputInfo("position", 4, "f4", "m", "as channels.position: relative to this camera, w: planar depth, 0 = sky"),
        InputInfo("normal", 4, "f4", "1", "as channels.normal"),
        InputInfo("prev_position", 4, "f4", "m", "as channels.prev_position: the same point in the previous frame"),
        InputInfo("base_color", 4, "f2", "1", "as channels.base_color"),
        InputInfo("emission", 4, "f4", RADIANCE_UNIT, "as channels.emission, exposure not applied"),
        InputInfo("ids", 2, "u4", "1", "as channels.ids"),
        InputInfo("history_position", 4, "f4", "m", "position of the previous frame, relative to the previous camera"),
        InputInfo("history_normal", 4, "f4", "1", "normal of the previous frame"),
        InputInfo("history_ids", 2, "u4", "1", "ids of the previous frame"),
        InputInfo(
            "motion", 2, "f4", "px",
            "previous - current position of the surface point, +x right, +y up (GL memory), without jitter: 0 for a "
            "still image; a large number behind the previous camera",
        ),
        InputInfo(
            "mask", 1, "u4", "bits",
            "conventions.Reason bits that a renderer can know: geometry only (FIRST CUT INVALID SKY HISTORY_SKY BEHIND "
            "OUTSIDE POSITION NORMAL DISOCCLUDED OCCLUDING)",
        ),
        InputInfo(
            "exact_mask", 1, "u4", "bits",
            "mask of the exact frames (noise-free, at pixel centers), also with DIRECT, INDIRECT, COLOR, LIT and "
            "SHADOWED: unknown to a renderer",
        ),
        InputInfo(
            "reference", 4, "f4", RADIANCE_UNIT,
            "rgb: the reference image, linear, exposure applied; a: 1 where it is finite: unknown to a renderer",
        ),
        InputInfo("eye_motion", 2, "f4", "px", "with history both: as motion, to the surface in the other eye, now"),
        InputInfo("eye_mask", 1, "u4", "bits", "with history both: as mask, of the other eye; FIRST in that eye"),
        InputInfo(
            "eye_result", 4, "f4", RADIANCE_UNIT,
            "with history both: the method's own result in the other eye, now; undefined in that eye",
        ),
        InputInfo(
            "diffuse", 4, "f4", RADIANCE_UNIT,
            "rgb: diffuse lobe of direct and indirect light, with the color of the surface, exposure applied; 0 for "
            "sky; a: as radiance.  radiance = diffuse + specular + emitted",
        ),
        InputInfo(
            "specular", 4, "f4", RADIANCE_UNIT,
            "rgb: glossy lobe of direct and indirect light, and what comes through the surface; as diffuse",
        ),
        InputInfo(
            "emitted", 4, "f4", RADIANCE_UNIT,
            "rgb: emission of surfaces, the environment elsewhere, exposure applied: radiance without light noise",
        ),
        InputInfo("diffuse_albedo", 4, "f4", "1", f"rgb: base color x (1 - metallic), {_AT_LEAST}"),
        InputInfo(
            "specular_albedo", 4, "f4", "1",
            f"rgb: share of light from all directions that the glossy lobe reflects to the camera, {_AT_LEAST}",
        ),
        InputInfo("diffuse_demodulated", 4, "f4", RADIANCE_UNIT, "rgb: diffuse / diffuse_albedo; a: as radiance"),
        InputInfo("specular_demodulated", 4, "f4", RADIANCE_UNIT, "rgb: specular / specular_albedo; a: as radiance"),
        InputInfo("material", 4, "f2", "1", "as channels.material: metallic, roughness, occlusion, specular"),
        InputInfo(
            "hit_distance", 1, "f4", "m", "length of the first ray from the surface, mean over rays that hit; 0: none"
        ),
        InputInfo("sample_count", 1, "f4", "1", "samples of light in the radiance of the pixel"),
        InputInfo(
            "variance", 1, "f4", "radiance2",
            "variance of the mean of direct luminance plus that of indirect, exposure applied; 0: one sample",
        ),
        InputInfo(
            "reactive", 1, "f4", "1",
            f"alpha of surfaces whose material is blended, at most {MAX_REACTIVE}, else 0: motion may not be theirs",
        ),
        InputInfo(
            "transparency", 1, "f4", "1",
            "share of mirror-like reflection, whose motion is not that of the surface: (1 - roughness)^2 x luminance "
            "of specular_albedo / luminance of both albedos",
        ),
        InputInfo(
            "reshaded", 4, "f4", RADIANCE_UNIT,
            "rgb: light without emission, exposure applied, of one surface sample of the previous frame in each 3x3 "
            "block of pixels: moved with its surface to this frame, in this frame's light, with its random numbers of "
            "the previous frame; a: 1 at the pixel of the sample, 0 elsewhere",
        ),
        InputInfo("reshaded_direct", 4, "f4", RADIANCE_UNIT, "rgb: the direct light in reshaded; a: as reshaded"),
        InputInfo(
            "reshaded_before", 4, "f4", RADIANCE_UNIT,
            "rgb: light of the same sample in the previous frame; a: as reshaded",
        ),
    )
}  # fmt: skip
"""Textures by name.  All have the size of the input; row 0 of GL memory is the bottom."""

RESERVED_INPUTS = frozenset(
    {"radiance", "position", "normal", "prev_position", "base_color", "emission", "ids", "history_position"}
    | {"history_normal", "history_ids", "motion", "mask", "exact_mask"}
)
"""Names that no history, buffer or setting can have.  Later inputs are not reserved where they are not read."""

EYE_INPUTS = ("eye_motion", "eye_mask", "eye_result")
"""Inputs of a method that asks for both histories, of the last frame and of the other eye."""

FAR_AWAY_PX = 1.0e6
"""``motion`` of points behind the previous camera."""


@dataclass(frozen=True, slots=True)
class FrameInputs:
    """The inputs of one frame.  ``textures`` contains at least the inputs that the method declares.

    ``missing``: input -> why this kind of frames does not have it; ``light``: for methods with ``light = "own"``.
    """

    index: int  # 0 for the first frame of the sequence, which has no history
    time: float  # seconds
    textures: Mapping[str, moderngl.Texture]
    # Reprojection to the previous frame, float64, without jitter (sky rays include it); for frame 0 to itself.
    pair: Reprojection
    view: View
    prev_view: View
    jitter_px: np.ndarray  # (2,) sub-pixel offset of this frame's samples, +x right, +y up
    prev_jitter_px: np.ndarray
    exposure: float
    cut: bool  # declared by the caller: this frame has no history
    missing: Mapping[str, str] = field(default_factory=dict)
    light: Any = None  # scene_light.SceneLight


def input_texture(gpu: Gpu, name: str, size: tuple[int, int]) -> moderngl.Texture:
    """A texture for input ``name`` of INPUTS, not filtered."""
    return gpu.texture(size, INPUTS[name].components, INPUTS[name].dtype)


def texture_bytes(*textures: moderngl.Texture) -> int:
    """Bytes of GPU memory that ``textures`` take."""
    return sum(t.width * t.height * t.components * int(t.dtype[1]) for t in textures)


_FLIP_Y = np.float32([1.0, -1.0])
"""From offsets in pixels with y up, as in GL, to those with y down, as in arrays."""


def read_result(texture: moderngl.Texture) -> np.ndarray:
    """A result as (h, w, 4) float32, row 0 at the top.

    rgb: linear radiance x exposure; a: weight of history, -1 where it is not reported.
    """
    width, height = texture.size
    out = np.empty((height, width, 4), dtype=np.float32)
    texture.read_into(out)
    return out[::-1]  # GL's row 0 is at the bottom


def frame_arrays(frame: FrameInputs, reads: tuple[str, ...], has_history: bool) -> dict[str, Any]:
    """The argument of a Python method's ``step``: its inputs as arrays and the numbers of the frame, y down.

    ``index time exposure cut has_history``; ``jitter_px``, ``prev_jitter_px`` (2,); ``clip_from_current``,
    ``prev_clip_from_prev`` (4, 4) and ``camera_delta`` (3,), float64; ``pair`` (Reprojection), ``view``,
    ``prev_view`` (View).
    """
    arrays: dict[str, Any] = {
        name: np.ascontiguousarray(read_channel(frame.textures[name], name.removeprefix("eye_"))) for name in reads
    }
    return arrays | {
        "index": frame.index,
        "time": frame.time,
        "exposure": frame.exposure,
        "cut": frame.cut,
        "has_history": has_history,
        "jitter_px": np.asarray(frame.jitter_px, dtype=np.float64) * _FLIP_Y,
        "prev_jitter_px": np.asarray(frame.prev_jitter_px, dtype=np.float64) * _FLIP_Y,
        "clip_from_current": frame.pair.clip_from_current,
        "prev_clip_from_prev": frame.pair.prev_clip_from_prev,
        "camera_delta": frame.pair.camera_delta,
        "pair": frame.pair,
        "view": frame.view,
        "prev_view": frame.prev_view,
    }
