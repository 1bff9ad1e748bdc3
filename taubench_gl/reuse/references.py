"""Reference images of an evaluation: supersampled exact light, path-traced light, or path-traced files.

Path-traced light is also a ``Source`` of noise-free frames, which ``exact_mask`` compares.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.jitter import grid_offsets
from taubench_gl.animation.pairs import sky_directions
from taubench_gl.effects.decide import decide
from taubench_gl.effects.lighting import environment_of
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.features import COLUMNS, LIGHT_FEATURES
from taubench_gl.frame.environment import maps_of
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.targets import read_channel, write_channel
from taubench_gl.metrics.color import display_color
from taubench_gl.metrics.environment import lookup
from taubench_gl.pathtraced.references import FEWEST, Accumulated, Estimate, References
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.reuse.derived import ComposePass
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.inputs import FrameRequest, light_settings
from taubench_gl.reuse.quality import half_noise

Array = np.ndarray
MAX_SAMPLES = 256
"""Limit on the samples per pixel of ``SupersampledReference``."""

QUIET_DB = 35.0
"""PSNR of the noise of a reference, from which on its samples are not fitted to the time that is left."""

FITTED = "path-traced"
"""The path-traced reference with the samples that fit a time."""

PREFIX = "path-traced@"


def reference_samples(text: str) -> int | None:
    """Samples per pixel of ``path-traced@M``, FEWEST for FITTED; None for another kind of reference.

    Raises SettingsError.
    """
    if text == FITTED:
        return FEWEST
    if not text.startswith(PREFIX):
        return None
    number = text.removeprefix(PREFIX)
    if not number.isascii() or not number.isdecimal() or not int(number):
        raise SettingsError(f"reference is {text!r}", hint="give path-traced@M with M samples per pixel")
    return int(number)


@dataclass(frozen=True, slots=True)
class ReferenceImage:
    """Linear radiance x exposure of one frame, row 0 at the top.

    ``radiance`` (h, w, 3) float32; ``emitters`` (h, w) bool: a visible surface emits, None: not known; ``halves``:
    radiance (h, w, 3) of two independent halves of its samples, whose mean is ``radiance``, None: it has no noise, or
    it is not known.
    """

    radiance: Array
    emitters: Array | None = None
    halves: tuple[Array, Array] | None = None

    @property
    def bytes(self) -> int:
        arrays = (self.radiance, self.emitters, *(self.halves or ()))
        return sum(array.nbytes for array in arrays if array is not None)


class SupersampledReference(GpuOwner):
    """Exact light at ``samples`` positions per pixel, the cell centers of a grid; mean of linear radiance."""

    def __init__(self, request: FrameRequest, samples: int):
        """Open the frames of ``request``.  Raises SettingsError for a number of samples outside 1 .. MAX_SAMPLES."""
        if not 1 <= samples <= MAX_SAMPLES:
            raise SettingsError(f"reference samples is {samples}", hint=f"give 1 to {MAX_SAMPLES}")
        super().__init__(request.gpu)
        self._offsets = grid_offsets(samples)
        self._offset = self._offsets[0]
        settings = light_settings(request.settings, request.kind)
        shading = Shading(gather_each=request.kind.noisy)
        self._source = self.open_source(request.animated, settings, shading=shading, jitter=lambda frame: self._offset)
        self._compose = ComposePass(self, self._source, settings, accumulate=True)
        self._emits = self._source.effects["emission"].enabled

    def image(self, frame: int) -> ReferenceImage:
        """The reference of ``frame``; in ``emitters`` are pixels where any sample shows an emitter."""
        share = 1.0 / len(self._offsets)
        emitters = np.full(self._source.size[::-1], False)
        for k, offset in enumerate(self._offsets):
            self._offset = offset
            self._source.advance(frame)
            self._compose.run(frame, -share if k == 0 else share)
            if self._emits:
                emitters |= emitting(self._source)
        return ReferenceImage(read_result(self._compose.textures["radiance"])[..., :3], emitters)

    def describe(self) -> dict[str, Any]:
        return {"kind": "max", "samples": len(self._offsets), "path": None}


def emitting(source: RasterSource) -> Array:
    """Pixels whose visible surface emits in the current frame, (h, w) bool; ``source`` has the channel ``emission``."""
    return (source.read("emission")[..., :3] > 0.0).any(axis=-1)


class FileReference:
    """Combined radiance of path-traced files ``exr:DIR`` with the frame numbers of the scene."""

    def __init__(self, request: FrameRequest, spec: str, size: tuple[int, int], frames: range):
        """Open the files ``spec`` (``exr:DIR``).  Raises PathTracedError for another image size and missing frames."""
        self._sequence = PathTracedSequence.open(spec, mapping=request.mapping)
        self._sequence.require(size, frames, of="the input")
        self._exposure = request.settings.lighting.exposure_factor

    def image(self, frame: int) -> ReferenceImage:
        """The reference of ``frame``; ``emitters`` is None where the files have no pass of emission."""
        emission = self._sequence.emission(frame)
        emitters = None if emission is None else (emission[..., :3] > 0.0).any(axis=-1)
        return ReferenceImage(self._sequence.radiance(frame, self._exposure), emitters)

    def describe(self) -> dict[str, Any]:
        return {"kind": "exr", "samples": None, "path": str(self._sequence.path)}


class PathTracedReference(GpuOwner):
    """Frames of a scene at pixel centers: geometry from the rasterizer, light from stored references.

    A ``Source`` with direct, indirect and color, and a reference with ``image``.
    """

    cuts = True

    def __init__(self, request: FrameRequest, samples: int, exact: bool = False):
        """Open geometry and stored light.  ``samples``, ``exact``: as of ``References.open``.  Raises SettingsError."""
        super().__init__(request.gpu)
        gpu, settings = request.gpu, request.settings
        self.references = References.open(self, request.animated, settings, samples, exact=exact)
        self._settings, self._environment = settings, environment_of(settings)
        geometry = settings.replace(columns=("frustum", "position", "normal"), samples_per_pixel=1)
        every = settings.replace(columns=COLUMNS, light="path-traced", indirect="auto")
        self._emits = decide(request.scene, every)["emission"].enabled
        extra = ("ids", *(("emission",) * self._emits))
        self._source = self.open_source(request.animated, geometry, extra=extra)
        self.size, self.reprojection = self._source.size, self._source.reprojection
        self.radiance, self.others = LIGHT_FEATURES, ()
        self.unmeasured: Mapping[str, str] = {}
        self._textures = [{name: self.own(gpu.texture(self.size)) for name in self.radiance} for _ in range(2)]
        self._frame: int | None = None
        self._image = ReferenceImage(np.zeros((self.size[1], self.size[0], 3), dtype=np.float32))

    def prepare(self, frames: range, seconds: float | None) -> Estimate:
        """The time that ``frames`` will take; with ``seconds``, first choose the samples that fit it."""
        references = self.references
        return references.estimate(frames) if seconds is None else references.fit(frames, seconds, self._enough)

    def _enough(self, sums: Accumulated) -> float:
        """Samples with which the noise that a display shows is QUIET_DB below its range, by ``sums`` of fewer."""
        light = self._settings.lighting
        first, second = sums.halves() * light.exposure_factor
        error = half_noise(first, second, light.tone_map, np.full(first.shape[:2], True))["psnr_db"]
        return sums.samples * error * 10.0 ** (QUIET_DB / 10.0)

    def advance(self, frame: int) -> View:
        view = self._source.advance(frame)
        self._textures.reverse()
        reference = self.references.frame(frame)
        channels = {"direct": reference.direct, "indirect": reference.indirect}
        lights = (reference.direct + reference.indirect, *(() if reference.halves is None else reference.halves))
        radiance, *halves = self._radiance(view, lights)
        exposure = self._settings.lighting.exposure_factor
        exposed = [(x * exposure).astype(np.float32) for x in (radiance, *halves)]
        emitters = emitting(self._source) if self._emits else np.full(radiance.shape[:2], False)
        self._image = ReferenceImage(exposed[0], emitters, (exposed[1], exposed[2]) if halves else None)
        channels["color"] = display_color(radiance, exposure, self._settings.lighting.tone_map)
        for name, values in channels.items():
            write_channel(self._textures[0][name], name, np.asarray(values, dtype=np.float32))
        self._frame = frame
        return view

    def _radiance(self, view: View, lights: Sequence[Array]) -> list[Array]:
        """(h, w, 3) float64 without exposure, of each of ``lights``: light and emission of surfaces, the environment
        elsewhere."""
        width, height = self.size
        surface = self._source.read("position")[..., 3:] > 0.0
        emitted = self._source.read("emission")[..., :3] if self._emits else 0.0
        sky: Any = np.asarray(self._environment.radiance, dtype=np.float64)
        if self._environment.kind == "image":
            origin, dx, dy = sky_directions(view, width, height)
            up = np.arange(height)[::-1, None, None]  # GL rows: 0 is at the bottom
            sky = lookup(maps_of(self._environment).seen, origin + np.arange(width)[:, None] * dx + up * dy)
        return [np.where(surface, light.astype(np.float64) + emitted, sky) for light in lights]

    def image(self, frame: int) -> ReferenceImage:
        if self._frame != frame:
            self.advance(frame)
        return self._image

    @property
    def current(self) -> Mapping[str, moderngl.Texture]:
        return {**self._source.current, **self._textures[0]}

    @property
    def previous(self) -> Mapping[str, moderngl.Texture]:
        return {**self._source.previous, **self._textures[1]}

    def read(self, name: str, *, previous: bool = False) -> Array:
        return read_channel((self.previous if previous else self.current)[name], name)

    def describe(self) -> dict[str, Any]:
        """The block ``reference`` of reuse.json; ``noise_*``: of the noisiest frame (``references.Noise``)."""
        noise = self.references.worst_noise
        return {
            "kind": "path-traced", "samples": self.references.samples, "path": None,
            "noise_rms": None if noise is None else noise.rms,
            "noise_percent": None if noise is None else noise.percent,
            "noise_typical_percent": None if noise is None else noise.typical_percent,
            "noise": None if noise is None else noise.text,
        }  # fmt: skip
