"""Reference images of an evaluation: supersampled exact light, or path-traced files."""

from __future__ import annotations

from typing import Any

import numpy as np

from taubench_gl.animation.jitter import grid_offsets
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import SourceOptions
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.reuse.frame import read_result
from taubench_gl.reuse.inputs import ComposePass, InputRequest, light_channels, light_settings
from taubench_gl.settings import Settings

Array = np.ndarray
MAX_SAMPLES = 256


class SupersampledReference(GpuOwner):
    """Exact light at ``samples`` positions per pixel, the cell centers of a grid; mean of linear radiance."""

    def __init__(self, request: InputRequest, samples: int = 16):
        """Raises SettingsError for a number of samples outside 1..MAX_SAMPLES."""
        if not 1 <= samples <= MAX_SAMPLES:
            raise SettingsError(f"reference samples is {samples}", hint=f"give 1 to {MAX_SAMPLES}")
        super().__init__(request.gpu)
        self._offsets = grid_offsets(samples)
        self._offset = self._offsets[0]
        settings = light_settings(request.settings, request.kind)
        options = SourceOptions(shading=Shading(gather_each=request.kind.noisy), jitter=lambda frame: self._offset)
        self._source = self.open_source(request.scene, request.camera, settings, options, poser=request.poser)
        channels = light_channels(self._source)
        self._compose = self.own(ComposePass(self.context, self._source.size, settings, channels, accumulate=True))

    def image(self, frame: int) -> Array:
        """Linear radiance x exposure.  (h, w, 3) float32, row 0 at the top."""
        share = 1.0 / len(self._offsets)
        for k, offset in enumerate(self._offsets):
            self._offset = offset
            self._source.advance(frame)
            self._compose.run(self._source, frame, -share if k == 0 else share)
        return read_result(self._compose.radiance)[..., :3]

    def describe(self) -> dict[str, Any]:
        return {"kind": "max", "samples": len(self._offsets), "path": None}


class FileReference:
    """Combined radiance of path-traced files ``exr:DIR`` with the frame numbers of the scene."""

    def __init__(self, spec: str, size: tuple[int, int], frames: range, settings: Settings, mapping: str | None = None):
        """Raises PathTracedError for another image size and for missing frames."""
        self._sequence, self._exposure = (
            PathTracedSequence.open(spec, mapping=mapping),
            settings.lighting.exposure_factor,
        )
        self._sequence.require(size, frames, of="the input")

    def image(self, frame: int) -> Array:
        """Linear radiance x exposure.  (h, w, 3) float32, row 0 at the top."""
        return self._sequence.radiance(frame, self._exposure)

    def describe(self) -> dict[str, Any]:
        return {"kind": "exr", "samples": None, "path": str(self._sequence.path)}

    def release(self) -> None:
        """Nothing to release."""
