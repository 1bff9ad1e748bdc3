"""What one frame hands a reuse method: the table of inputs and the record that carries them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.metrics.reprojection import Reprojection


@dataclass(frozen=True, slots=True)
class InputInfo:
    """One texture a method may read.  ``components`` and ``dtype`` as in ``channels.ChannelInfo``."""

    name: str
    components: int
    dtype: str
    unit: str
    doc: str


INPUTS: dict[str, InputInfo] = {
    info.name: info
    for info in (
        InputInfo(
            "radiance", 4, "f4", "W/(sr m2)",
            "rgb: this frame's shaded result, linear, exposure applied, as costly or noisy as the input kind makes it; "
            "a: 1 where the pixel was shaded this frame, 0 where it was filled from its nearest shaded neighbor",
        ),
        InputInfo("position", 4, "f4", "m", "as channels.position: relative to this camera, w: planar depth, 0 = sky"),
        InputInfo("normal", 4, "f4", "1", "as channels.normal"),
        InputInfo("prev_position", 4, "f4", "m", "as channels.prev_position: the same point one frame ago"),
        InputInfo("base_color", 4, "f2", "1", "as channels.base_color"),
        InputInfo("emission", 4, "f4", "W/(sr m2)", "as channels.emission, exposure not applied"),
        InputInfo("ids", 2, "u4", "1", "as channels.ids"),
        InputInfo("history_position", 4, "f4", "m", "position of the last frame, relative to the last camera"),
        InputInfo("history_normal", 4, "f4", "1", "normal of the last frame"),
        InputInfo("history_ids", 2, "u4", "1", "ids of the last frame"),
        InputInfo(
            "motion", 2, "f4", "px",
            "previous - current position of the surface point, +x right, +y up (GL memory), jitter of both frames "
            "taken out: 0 on a still picture; where behind the previous camera, a large number",
        ),
        InputInfo(
            "mask", 1, "u4", "bits",
            "conventions.Reason bits a renderer can know: geometry only (FIRST CUT INVALID SKY HISTORY_SKY BEHIND "
            "OUTSIDE POSITION NORMAL DISOCCLUDED OCCLUDING)",
        ),
        InputInfo(
            "truth_mask", 1, "u4", "bits",
            "the same with DIRECT, INDIRECT, COLOR, LIT and SHADOWED of the noise-free frames: for an oracle only",
        ),
    )
}  # fmt: skip
"""Textures by name.  All have the size of the picture; row 0 of GL memory is the bottom."""


@dataclass(frozen=True, slots=True)
class FrameInputs:
    """One frame as a method sees it.  ``textures`` holds at least the inputs the method declared."""

    index: int  # 0 for the first frame of the sequence: there is no history yet
    time: float  # seconds
    textures: Mapping[str, moderngl.Texture]
    # Matrices from this frame to the last, float64, jitter left out (the sky rays go through the samples); on frame 0
    # from itself to itself.
    pair: Reprojection
    view: View
    prev_view: View
    jitter_px: np.ndarray  # (2,) sub-pixel offset of this frame's samples, +x right, +y up
    prev_jitter_px: np.ndarray
    exposure: float
    cut: bool  # the caller knows that this frame has nothing to do with the last
