"""Inputs of a reuse method for one frame: the table of inputs, the record, and conversion to and from arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from msgspec import Struct

from taubench_gl.animation import View
from taubench_gl.data_files import read_toml
from taubench_gl.frame.targets import read_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.reprojection import Reprojection


class InputInfo(Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """One texture that a method can read.  ``components`` and ``dtype`` as in ``channels.ChannelInfo``."""

    components: int
    dtype: str
    unit: str
    doc: str


MIN_ALBEDO = 0.01
"""Smallest component of the albedos that light is divided by."""

MAX_REACTIVE = 0.9
"""Largest value of ``reactive``: AMD's advice for FidelityFX Super Resolution 2, which discards all history at 1."""

INPUTS = read_toml(Path(__file__).with_name("inputs.toml"), dict[str, InputInfo])
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
    ``phase``: 0 for a rendered frame, else the share of the interval between rendered frames that has passed at the
    generated one; ``shown``: the camera of the generated frame, None: ``view``; ``next_rendered``: for methods that
    interpolate, the inputs of the rendered frame at the end of the interval.
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
    phase: float = 0.0
    shown: View | None = None
    next_rendered: FrameInputs | None = None

    def shown_clip_from_current(self, width: int, height: int) -> np.ndarray:
        """Clip of the shown frame from positions relative to the current camera, world axes: (4, 4) float64."""
        return (self.shown or self.view).clip_from_relative(width, height, self.view.position)


def input_texture(gpu: Gpu, name: str, size: tuple[int, int]) -> moderngl.Texture:
    """A texture for input ``name`` of INPUTS, not filtered."""
    return gpu.texture(size, INPUTS[name].components, INPUTS[name].dtype)


def texture_bytes(*textures: moderngl.Texture) -> int:
    """Bytes of GPU memory that ``textures`` take."""
    return sum(t.width * t.height * t.components * int(t.dtype[1]) for t in textures)


_FLIP_Y = np.float32([1.0, -1.0])
"""Factors from offsets in pixels with y up, as in GL, to those with y down, as in arrays."""


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
    ``prev_clip_from_prev``, ``shown_clip_from_current`` (4, 4) and ``camera_delta`` (3,), float64; ``phase``; ``pair``
    (Reprojection), ``view``, ``prev_view`` (View).
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
        "phase": frame.phase,
        "shown_clip_from_current": frame.shown_clip_from_current(frame.pair.width, frame.pair.height),
    }
