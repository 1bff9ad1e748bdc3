"""Inputs of a frame as arrays and back: row 0 at the top, y down; GL memory has it the other way round."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from taubench_gl.reuse.frame import INPUTS, FrameInputs

_NUMPY = {"f4": np.float32, "f2": np.float16, "u4": np.uint32}
_UP_IS_DOWN = np.float32([1.0, -1.0])


def read_input(texture: moderngl.Texture, name: str) -> np.ndarray:
    """Input ``name`` of INPUTS as (h, w, components) of its own dtype, row 0 at the top; motion turns +y down here."""
    info = INPUTS[name]
    width, height = texture.size
    out = np.empty((height, width, info.components), dtype=_NUMPY[info.dtype])
    texture.read_into(out)
    out = out[::-1]
    if name == "motion":
        out = out * _UP_IS_DOWN
        out[out == 0] = 0.0  # no negative zeros
    return out


def write_input(texture: moderngl.Texture, name: str, values: np.ndarray) -> None:
    """The inverse: (h, w) or (h, w, <= components), row 0 at the top; what is left of the components becomes 0."""
    info = INPUTS[name]
    width, height = texture.size
    values = np.asarray(values)
    values = values[..., None] if values.ndim == 2 else values
    full = np.zeros((height, width, info.components), dtype=_NUMPY[info.dtype])
    full[..., : values.shape[-1]] = values[::-1]
    if name == "motion":
        full[..., 1] *= -1
    texture.write(full)


def read_result(texture: moderngl.Texture) -> np.ndarray:
    """A result as (h, w, 4) float32, row 0 at the top: rgb linear radiance x exposure, a the weight of history (-1:
    the method does not say)."""
    width, height = texture.size
    out = np.empty((height, width, 4), dtype=np.float32)
    texture.read_into(out)
    return out[::-1]


def frame_arrays(frame: FrameInputs, reads: tuple[str, ...], has_history: bool) -> dict[str, Any]:
    """What a Python method's ``step`` is given: its inputs as arrays, and the frame's numbers, y down throughout.

    ``index time exposure cut has_history``; ``jitter_px``, ``prev_jitter_px`` (2,); ``clip_from_current``,
    ``prev_clip_from_prev`` (4, 4) and ``camera_delta`` (3,), float64; ``pair`` (Reprojection), ``view``,
    ``prev_view`` (View).
    """
    arrays: dict[str, Any] = {name: np.ascontiguousarray(read_input(frame.textures[name], name)) for name in reads}
    return arrays | {
        "index": frame.index,
        "time": frame.time,
        "exposure": frame.exposure,
        "cut": frame.cut,
        "has_history": has_history,
        "jitter_px": np.asarray(frame.jitter_px, dtype=np.float64) * _UP_IS_DOWN,
        "prev_jitter_px": np.asarray(frame.prev_jitter_px, dtype=np.float64) * _UP_IS_DOWN,
        "clip_from_current": frame.pair.clip_from_current,
        "prev_clip_from_prev": frame.pair.prev_clip_from_prev,
        "camera_delta": frame.pair.camera_delta,
        "pair": frame.pair,
        "view": frame.view,
        "prev_view": frame.prev_view,
    }
