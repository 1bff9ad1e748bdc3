"""The mask pass: reprojection, reason bits and their counts in one compute dispatch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import moderngl
import numpy as np

from taubench_gl import conventions
from taubench_gl.conventions import FEATURES, HISTOGRAM_BINS, HISTOGRAM_MANTISSA_BITS, Reason
from taubench_gl.frame.passes.images import order_drawing
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.layout import Field, Struct, column_major
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.metrics.reprojection import NEAR_GUARD, Reprojection
from taubench_gl.settings import Settings

REPROJECTION = Struct(
    "Reprojection",
    Field("clip_from_current", "mat4", "clip <- relative to the current camera, world axes"),
    Field("prev_clip_from_prev", "mat4", "previous clip <- relative to the previous camera, world axes"),
    Field("sky_origin", "vec4", "view ray of pixel (0, 0), world axes; w = 0 direction, 1 far-plane point"),
    Field("sky_dx", "vec4", "its step per pixel to the right"),
    Field("sky_dy", "vec4", "its step per pixel up"),
    Field("prev_forward", "vec4", "xyz: unit, where the previous camera looked"),
    Field("camera_delta", "vec4", "xyz: current - previous camera position, metres"),
    Field("size", "ivec4", "xy: pixels; z: 0"),
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
MASK_WORDS = 1 << 16
RADIANCE = ("direct", "indirect", "color")
GEOMETRY = ("position", "normal", "history_position", "history_normal", "prev_position")
_MASK_IMAGE, _MOTION_IMAGE, _GEOMETRY_IMAGES = 0, 1, 2


def preamble() -> str:
    """GLSL derived from Python: the parameter struct, reason bits and histogram constants."""
    lines = [REPROJECTION.glsl]
    lines += [f"const uint {bit.name} = {bit.value}u;" for bit in Reason]
    lines.append(f"const uint NO_HISTORY = {conventions.NO_HISTORY}u;")
    lines += [f"const int FEATURE_{name.upper()} = {i};" for i, name in enumerate(FEATURES)]
    lines.append(f"const int HISTOGRAM_BINS = {HISTOGRAM_BINS};")
    lines.append(f"const int HISTOGRAM_MANTISSA_BITS = {HISTOGRAM_MANTISSA_BITS};")
    lines.append(f"const int HISTOGRAM_MIN_EXPONENT = {conventions.HISTOGRAM_MIN_EXPONENT};")
    return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class Counts:
    """Exact pixel counts of one pair."""

    mask_histogram: np.ndarray  # (65536,) pixels per mask word; uint32 as read back, int64 once added
    histograms: np.ndarray  # (5, bins) pixels per bin of each feature's distance

    def __add__(self, other: Counts) -> Counts:
        """Exact sum of both, as of several samples per pixel."""
        words, distances = (np.asarray(x, dtype=np.int64) for x in (self.mask_histogram, self.histograms))
        return Counts(words + other.mask_histogram, distances + other.histograms)


class ComparedSource(Protocol):
    """What of a source of frames (``frame.sources.Source``) decides how its pairs are compared."""

    size: tuple[int, int]
    reprojection: str  # camera | motion
    radiance: tuple[str, ...]
    cuts: bool


class MaskPass:
    """Compares current channels with history channels.

    Reads ``position normal prev.position prev.normal`` (+ ``prev_position`` for motion reprojection, ``ids`` for
    cuts of single surfaces, radiance channels where both frames have them).  Writes ``mask`` and ``motion`` when asked.
    ``release`` frees its buffers.
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
        cuts: bool = False,
        write_mask: bool = False,
        write_motion: bool = False,
    ):
        self._gpu, self._size = gpu, size
        self._reprojection, self._radiance, self._cuts = reprojection, radiance, cuts
        # llvmpipe: one vector of lanes along a row, and few work groups, whose start costs as much as several pixels.
        # GPUs want square tiles, and enough of them.
        self._group, self._pixels_each = ((8, 1), 60) if gpu.software else ((8, 8), 4)
        self._programs: dict[bool, moderngl.ComputeShader] = {}  # by whether geometry is read as images
        defines = {
            "MOTION": reprojection == "motion",
            "BILINEAR": sampling == "bilinear",
            **{f"HAS_{name.upper()}": name in radiance for name in RADIANCE},
            "CUTS": cuts,
            "WRITE_MASK": write_mask,
            "WRITE_MOTION": write_motion,
            "GROUP_X": self._group[0],
            "GROUP_Y": self._group[1],
            "PIXELS_EACH": self._pixels_each,
            "SOFTWARE": gpu.software,
        }
        self._compile = lambda images: shaders.compute(
            "masks/masks.comp.glsl", {**defines, "GEOMETRY_IMAGES": images}, preamble()
        )
        self._bins = HISTOGRAM_BINS
        ctx = gpu.ctx
        self._parameters = ctx.buffer(reserve=REPROJECTION.dtype.itemsize)
        sizes = 4 * MASK_WORDS, 4 * len(FEATURES) * self._bins
        self._counters = [tuple(ctx.buffer(reserve=size) for size in sizes) for _ in range(2)]
        self._runs = 0
        self.mask = ctx.texture(size, 1, dtype="u4") if write_mask else None
        self.motion = ctx.texture(size, 2, dtype="f4") if write_motion else None

    @classmethod
    def for_source(
        cls,
        context: GpuContext,
        source: ComparedSource,
        settings: Settings,
        *,
        reprojection: str | None = None,
        sampling: str | None = None,
        radiance: tuple[str, ...] | None = None,
        write_mask: bool = False,
        write_motion: bool = False,
    ) -> MaskPass:
        """The mask pass of ``source`` with the metric of ``settings``.

        ``reprojection``, ``sampling``, ``radiance``: None as the source and the settings have them.
        """
        return cls(
            context.gpu,
            context.shaders,
            source.size,
            reprojection=source.reprojection if reprojection is None else reprojection,
            sampling=settings.metrics.sampling if sampling is None else sampling,
            radiance=source.radiance if radiance is None else radiance,
            cuts=source.cuts,
            write_mask=write_mask,
            write_motion=write_motion,
        )

    def run(
        self,
        pair: Reprojection,
        thresholds: Mapping[str, float],
        current: Mapping[str, moderngl.Texture],
        history: Mapping[str, moderngl.Texture],
        declared: int = 0,
        exposure: float = 1.0,
    ) -> int:
        """Submit the pass.  ``thresholds``: a_B of every feature; ``declared``: Reason.FIRST or CUT
        for the whole frame, else 0.  The number of this run, for ``read``."""
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
        self._parameters.bind_to_uniform_block(0)
        self._runs += 1
        for binding, buffer in enumerate(self._counters[self._runs % 2], start=1):
            buffer.clear()
            buffer.bind_to_storage_buffer(binding)
        program = self._bind_channels(current, history)
        if self.mask is not None:
            self.mask.bind_to_image(_MASK_IMAGE, read=False, write=True)
        if self.motion is not None:
            self.motion.bind_to_image(_MOTION_IMAGE, read=False, write=True)
        w, h = self._size
        program.run(-(-w // (self._group[0] * self._pixels_each)), -(-h // self._group[1]))
        self._gpu.ctx.memory_barrier()
        return self._runs

    def _bind_channels(
        self, current: Mapping[str, moderngl.Texture], history: Mapping[str, moderngl.Texture]
    ) -> moderngl.ComputeShader:
        """Bind what is compared; the program that reads it that way."""
        textures = {"position": current["position"], "normal": current["normal"]}
        textures |= {f"history_{name}": history[name] for name in ("position", "normal", *self._radiance)}
        if self._reprojection == "motion":
            textures["prev_position"] = current["prev_position"]
        if self._cuts:
            textures["ids"] = current["ids"]
        textures |= {name: current[name] for name in self._radiance}
        images = self._gpu.software and all(textures[n].dtype == "f4" for n in GEOMETRY if n in textures)
        if images not in self._programs:  # which it is shows only now
            self._programs[images] = self._compile(images)
        program = self._programs[images]
        if images:
            order_drawing(self._gpu)
        for unit, (name, texture) in enumerate(textures.items()):
            if images and name in GEOMETRY:
                texture.bind_to_image(_GEOMETRY_IMAGES + GEOMETRY.index(name), read=True, write=False)
            else:
                texture.use(unit)
                program[name] = unit
        return program

    def read(self, run: int | None = None) -> Counts:
        """Wait for a run, the latest or the one before it, and read its counts back.

        Reading a run after the next one was submitted is what keeps a GPU busy: it waits for work long done.
        """
        run = self._runs if run is None else run
        if not self._runs - 1 <= run <= self._runs or run < 1:
            raise ValueError(f"run {run} of {self._runs} is not kept: only the last two are")
        mask_histogram, histograms = (np.frombuffer(b.read(), dtype=np.uint32) for b in self._counters[run % 2])
        return Counts(mask_histogram, histograms.reshape(len(FEATURES), self._bins))

    def release(self) -> None:
        for item in (self._parameters, *(b for pair in self._counters for b in pair), self.mask, self.motion):
            if item is not None:
                item.release()
