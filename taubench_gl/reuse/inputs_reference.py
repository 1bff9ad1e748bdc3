"""What methods are judged against: our own best picture of each frame, or a path-traced one."""

from __future__ import annotations

from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, Poser
from taubench_gl.animation.jitter import grid_offsets
from taubench_gl.errors import PathTracedError, SettingsError
from taubench_gl.frame.shading import Shading
from taubench_gl.frame.sources import RasterSource
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.shader import ShaderCache
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.reuse.arrays import read_result
from taubench_gl.reuse.inputs import light_settings, lit_channels
from taubench_gl.reuse.inputs_kind import InputKind
from taubench_gl.reuse.inputs_passes import ComposePass
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray
MAX_SAMPLES = 256


class MaxReference:
    """Exact light at ``samples`` places per pixel (the centres of a grid), averaged in linear radiance."""

    def __init__(
        self,
        gpu: Gpu,
        scene: Scene,
        camera: CameraTrack,
        settings: Settings,
        kind: InputKind,
        samples: int = 16,
        poser: Poser | None = None,
    ):
        if not 1 <= samples <= MAX_SAMPLES:
            raise SettingsError(f"reference samples is {samples}", hint=f"give 1 to {MAX_SAMPLES}")
        self._offsets = grid_offsets(samples)
        self._at = self._offsets[0]
        settings = light_settings(settings, kind)
        self._source = RasterSource(
            gpu, scene, camera, settings, poser=poser, shading=Shading(gather_each=kind.noisy),
            jitter=lambda frame: self._at,
        )  # fmt: skip
        self._shaders = ShaderCache(gpu.ctx)
        self._compose = ComposePass(
            gpu, self._shaders, self._source.size, settings, lit_channels(self._source), accumulate=True
        )

    def picture(self, frame: int) -> Array:
        """Linear radiance, exposure applied.  (h, w, 3) float32, row 0 at the top."""
        share = 1.0 / len(self._offsets)
        for k, offset in enumerate(self._offsets):
            self._at = offset
            self._source.advance(frame)
            self._compose.run(self._source.current, frame, -share if k == 0 else share)
        return read_result(self._compose.radiance)[..., :3]

    def describe(self) -> dict[str, Any]:
        return {"kind": "max", "samples": len(self._offsets), "path": None}

    def release(self) -> None:
        self._compose.release()
        self._shaders.release()
        self._source.release()


class FileReference:
    """Combined radiance of path-traced files ``exr:DIR``, whose frame numbers are the scene's."""

    def __init__(self, spec: str, size: tuple[int, int], frames: range, settings: Settings, mapping: str | None = None):
        self._sequence, self._exposure = PathTracedSequence.open(spec, mapping=mapping), settings.lighting.exposure
        if self._sequence.size != size:
            got, wanted = ("x".join(map(str, s)) for s in (self._sequence.size, size))
            raise PathTracedError(f"is {got} pixels, the input {wanted}", where=spec, hint=f"use --size {got}")
        lost = sorted(set(frames) - set(self._sequence.frames))
        if lost:
            raise PathTracedError(f"lacks frame {lost[0]}", where=spec, hint="give --frames that it has")

    def picture(self, frame: int) -> Array:
        return combined_radiance(self._sequence.read(frame), self._exposure, f"{self._sequence.path}, frame {frame}")

    def describe(self) -> dict[str, Any]:
        return {"kind": "exr", "samples": None, "path": str(self._sequence.path)}

    def release(self) -> None:
        """Nothing is held."""


def combined_radiance(truth: Any, exposure: float, where: str) -> Array:
    """Exposed linear radiance (h, w, 3) float32 of a PathTracedFrame.  Raises PathTracedError where it has none."""
    if truth.combined is None:
        raise PathTracedError(
            "has no combined pass", where=where, hint="switch it on in the renderer, or give --mapping"
        )
    if truth.color_encoded:
        raise PathTracedError("its combined pass is display-encoded, not linear radiance", where=where)
    return truth.combined[..., :3].astype(np.float32) * np.float32(exposure)
