"""Re-shaded samples: surface samples of the previous frame in the light of this frame, with their old random numbers.

Schied, Peters, Dachsbacher 2018, "Gradient Estimation for Real-Time Adaptive Temporal Filtering" (A-SVGF): the
difference to the light that the sample had is a change of light, not noise.  The samples are lit at their pixels of the
previous frame, by the passes that light a frame, with the number of the previous frame: so they get the random numbers
they had.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np

from taubench_gl.channels import CHANNELS, stored_dtype
from taubench_gl.conventions import NOT_COMPARABLE, Reason
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.passes.lighting import SURFACE
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.targets import read_channel
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.declare import UPDATE, WRITE, ComputePass
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.reuse.frame import input_texture, texture_bytes
from taubench_gl.settings import Settings

RESHADED = ("reshaded", "reshaded_direct", "reshaded_before")
BLOCK = 3
"""Pixels along the sides of a block, which has one re-shaded sample."""

CHANNELS_READ = (*SURFACE, "prev_position")
"""Channels that the source has to have."""

_MOVED = ("position", "normal", "geometric_normal", "prev_position")
"""Channels of the current frame that the passes read."""

_DISCARDED = int(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL | Reason.SKY)
_FORMATS = {"f4": "rgba32f", "f2": "rgba16f"}


class Reshade:
    """Textures of RESHADED for the frames of one source."""

    def __init__(self, owner: GpuOwner, source: RasterSource, settings: Settings):
        """Compile the passes for frames of ``source``; ``owner`` frees them."""
        gpu, self._hazards, self._source = owner.gpu, owner.gpu.hazards, source
        self._size, self._exposure = source.size, settings.lighting.exposure_factor
        width, height = source.size
        light = source.light.written

        def channel(name: str) -> moderngl.Texture:
            dtype = stored_dtype(name, settings.device.storage)
            return owner.own(gpu.texture(source.size, CHANNELS[name].components, dtype))

        self.textures = {name: owner.own(input_texture(gpu, name, source.size)) for name in RESHADED}
        self._surface = {name: channel(name) for name in SURFACE}
        self._light = {name: channel(name) for name in light}
        self._link = owner.own(gpu.ctx.buffer(reserve=4 * width * height))

        def make(name: str, *channels: str, grid: tuple[int, int] = source.size, **access: str) -> ComputePass:
            p = ComputePass("reuse reshade", (f"reuse/{name}.comp.glsl",)).buffer("link", "uint", **access)
            for channel in channels:
                p.texture(channel, "usampler2D" if channel == "mask" else "sampler2D")
            return p.dispatch(grid, Tuning(gpu.software).shading_group)

        blocks = (-(-width // BLOCK), -(-height // BLOCK))
        lit = tuple(name for name in ("direct", "indirect") if name in light)
        passes = {
            "clear": make("reshade_clear", access=WRITE),
            "select": make("reshade_select", "position", "history_position", "mask", "motion", grid=blocks,
                           access=UPDATE),
            "surface": make("reshade_surface", *_MOVED, *(f"history_{name}" for name in SURFACE)),
            "store": make("reshade_store", *lit, *(f"history_{name}" for name in lit)),
        }  # fmt: skip
        for name in RESHADED:
            passes["clear"].image(f"{name}_out", access=WRITE)
            passes["store"].image(f"{name}_out", access=WRITE)
        for name in SURFACE:
            passes["surface"].image(f"surface_{name}_out", _FORMATS[self._surface[name].dtype], access=WRITE)
        passes["store"].define(HAS_INDIRECT="indirect" in lit)
        self._passes = {name: owner.own(owner.context.compute(p)) for name, p in passes.items()}

    def run(
        self, numbers: tuple[int, int], pair: Reprojection, masks: dict[str, moderngl.Texture], seed: int, valid: bool
    ) -> None:
        """``numbers``: of the random numbers of the current frame and of its history; ``masks``: mask and motion;
        ``valid``: there is a previous frame."""
        size, source = self._size, self._source
        resources: dict[str, Any] = {**source.current, **masks, "link": self._link}
        resources |= {f"history_{name}": texture for name, texture in source.previous.items()}
        resources |= {f"{name}_out": texture for name, texture in self.textures.items()}
        resources |= {f"surface_{name}_out": texture for name, texture in self._surface.items()}
        self._passes["clear"].run(None, resources, size=size)
        if valid:
            of_frame = (numbers[0] & 0xFFFFFFFF, seed)
            self._passes["select"].run(None, resources, size=size, numbers=of_frame, discarded=_DISCARDED)
            forward = -source.renderer.frame.view.world_from_view[:, 2]
            camera = {"camera_delta": tuple(pair.camera_delta), "forward": tuple(forward)}
            self._passes["surface"].run(None, resources, size=size, **camera)
            # Light of this frame with the random numbers of the last: a difference is a change of light, not noise.
            source.light.relight({**self._surface, **self._light}, numbers[1])
            self._passes["store"].run(None, {**resources, **self._light}, size=size, exposure=self._exposure)
        self._hazards.publish()

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """What the passes computed in the last frame, at the samples' pixels of the previous frame, row 0 at the top.

        -> the current pixel that found the sample, (h, w) int64, column + row from the bottom * width, -1: none; its
        position in this frame, (h, w, 4) float32.
        """
        width, height = self._size
        # GL's row 0 is at the bottom
        link = np.frombuffer(self._link.read(), dtype=np.uint32).reshape(height, width)[::-1].astype(np.int64) - 1
        return link, read_channel(self._surface["position"], "position")

    @property
    def bytes(self) -> int:
        return self._link.size + texture_bytes(*self.textures.values(), *self._surface.values(), *self._light.values())
