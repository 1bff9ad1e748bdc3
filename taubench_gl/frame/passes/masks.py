"""The mask pass: reprojection, reason bits and their counts in one compute dispatch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import moderngl
import numpy as np

from taubench_gl import conventions
from taubench_gl.conventions import FEATURES, HISTOGRAM_BINS, Reason
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct, column_major
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.metrics.reprojection import NEAR_GUARD, Reprojection

REPROJECTION = Struct(
    "Reprojection",
    Field("clip_from_current", "mat4", "clip <- relative to the current camera, world axes"),
    Field("prev_clip_from_prev", "mat4", "previous clip <- relative to the previous camera, world axes"),
    Field("sky_origin", "vec4", "view ray of pixel (0, 0), world axes; w = 0 direction, 1 far-plane point"),
    Field("sky_dx", "vec4", "its step per pixel to the right"),
    Field("sky_dy", "vec4", "its step per pixel up"),
    Field("prev_forward", "vec4", "xyz: unit, where the previous camera looked"),
    Field("camera_delta", "vec4", "xyz: current - previous camera position, metres"),
    Field("size", "ivec4", "xy: pixels"),
    Field("prev_near", "float", "metres, previous camera's near plane less NEAR_GUARD"),
    Field("near", "float", "metres, current camera's near plane"),
    Field("guard_px", "float", "pixels, guard of the outside test"),
    Field("threshold_color", "float", "sRGB-encoded, 0..1, largest channel difference"),
    Field("threshold_position", "float", "metres, Euclidean"),
    Field("threshold_normal", "float", "Euclidean distance of unit vectors, 0..2"),
    Field("threshold_direct", "float", "linear radiance x exposure, Euclidean"),
    Field("threshold_indirect", "float", "linear radiance x exposure, Euclidean"),
    Field("exposure", "float", "factor on direct and indirect radiance before they are compared"),
    Field("declared", "uint", "FIRST or CUT for the whole frame, else 0"),
)
COMBOS = 1 << 16
RADIANCE = ("direct", "indirect", "color")
_MASK_IMAGE, _MOTION_IMAGE = 0, 1


def preamble() -> str:
    """GLSL derived from Python: the parameter struct, reason bits and histogram constants."""
    lines = [REPROJECTION.glsl]
    lines += [f"const uint {bit.name} = {bit.value}u;" for bit in Reason]
    lines += [f"const int FEATURE_{name.upper()} = {i};" for i, name in enumerate(FEATURES)]
    for name in ("HISTOGRAM_BINS", "HISTOGRAM_MANTISSA_BITS", "HISTOGRAM_MIN_EXPONENT"):
        lines.append(f"const int {name} = {getattr(conventions, name)};")
    return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class Counts:
    """What one pair counted, exact.  ``combos`` (65536,) uint32 pixels per reason word; ``histograms`` (5, bins)."""

    combos: np.ndarray
    histograms: np.ndarray


class MaskPass:
    """Compares current channels with history channels.

    Reads ``position normal prev.position prev.normal`` (+ ``prev_position`` for motion reprojection, + radiance
    channels where both frames have them).  Writes ``mask`` and ``motion`` when asked.  ``release`` frees its buffers.
    """

    def __init__(
        self,
        gpu: Gpu,
        shaders: ShaderCache,
        size: tuple[int, int],
        *,
        reprojection: str = "camera",
        sampling: str = "nearest",
        radiance: tuple[str, ...] = (),
        write_mask: bool = False,
        write_motion: bool = False,
    ):
        self._gpu, self._size = gpu, size
        self._reprojection, self._radiance = reprojection, radiance
        # One row per work group suits llvmpipe's scanline texture layout; GPUs want square tiles.
        self._group = (32, 1) if gpu.software else (8, 8)
        self._program = shaders.compute(
            "masks/masks.comp.glsl",
            {
                "MOTION": reprojection == "motion",
                "BILINEAR": sampling == "bilinear",
                **{f"HAS_{name.upper()}": name in radiance for name in RADIANCE},
                "WRITE_MASK": write_mask,
                "WRITE_MOTION": write_motion,
                "GROUP_X": self._group[0],
                "GROUP_Y": self._group[1],
            },
            preamble(),
        )
        ctx = gpu.ctx
        self._parameters = ctx.buffer(reserve=REPROJECTION.dtype.itemsize)
        self._combos = ctx.buffer(reserve=4 * COMBOS)
        self._histograms = ctx.buffer(reserve=4 * len(FEATURES) * HISTOGRAM_BINS)
        self.mask = ctx.texture(size, 1, dtype="u4") if write_mask else None
        self.motion = ctx.texture(size, 2, dtype="f4") if write_motion else None

    def run(
        self,
        pair: Reprojection,
        thresholds: Mapping[str, float],
        current: Mapping[str, moderngl.Texture],
        history: Mapping[str, moderngl.Texture],
        declared: int = 0,
        exposure: float = 1.0,
    ) -> None:
        """Submit the pass.  ``thresholds``: a_B of every feature; ``declared``: Reason.FIRST or CUT
        for the whole frame, else 0."""
        record = REPROJECTION.zeros()
        record["clip_from_current"] = column_major(pair.clip_from_current)
        record["prev_clip_from_prev"] = column_major(pair.prev_clip_from_prev)
        record["sky_origin"], record["sky_dx"], record["sky_dy"] = pair.sky_origin, pair.sky_dx, pair.sky_dy
        record["prev_forward"][:3], record["camera_delta"][:3] = pair.prev_forward, pair.camera_delta
        record["size"][:2] = self._size
        record["prev_near"] = pair.prev_near * (1.0 - NEAR_GUARD)
        record["near"] = pair.near
        record["guard_px"] = conventions.GUARD_PX
        record["declared"], record["exposure"] = int(declared), exposure
        for feature in FEATURES:
            record[f"threshold_{feature}"] = thresholds[feature]
        self._parameters.write(record.tobytes())
        self._combos.clear()
        self._histograms.clear()
        for binding, buffer in enumerate((self._parameters, self._combos, self._histograms)):
            buffer.bind_to_storage_buffer(binding)
        self._bind_textures(current, history)
        if self.mask is not None:
            self.mask.bind_to_image(_MASK_IMAGE, read=False, write=True)
        if self.motion is not None:
            self.motion.bind_to_image(_MOTION_IMAGE, read=False, write=True)
        w, h = self._size
        self._program.run(-(-w // self._group[0]), -(-h // self._group[1]))
        self._gpu.ctx.memory_barrier()

    def _bind_textures(self, current: Mapping[str, moderngl.Texture], history: Mapping[str, moderngl.Texture]) -> None:
        textures = {"position": current["position"], "normal": current["normal"]}
        if self._reprojection == "motion":
            textures["prev_position"] = current["prev_position"]
        textures |= {f"history_{name}": history[name] for name in ("position", "normal", *self._radiance)}
        textures |= {name: current[name] for name in self._radiance}
        for unit, (name, texture) in enumerate(textures.items()):
            texture.use(unit)
            self._program[name] = unit

    def read(self) -> Counts:
        """Wait for the pass and read its counts back."""
        combos = np.frombuffer(self._combos.read(), dtype=np.uint32)
        histograms = np.frombuffer(self._histograms.read(), dtype=np.uint32).reshape(len(FEATURES), HISTOGRAM_BINS)
        return Counts(combos, histograms)

    def release(self) -> None:
        for item in (self._parameters, self._combos, self._histograms, self.mask, self.motion):
            if item is not None:
                item.release()
