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
from taubench_gl.frame.passes.lighting import SURFACE
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.targets import read_channel
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.declare import UPDATE, WRITE, ComputePass
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.reuse.derived import input_texture
from taubench_gl.settings import Settings

RESHADED = ("reshaded", "reshaded_before")
BLOCK = 3
"""Pixels along the sides of a block, which has one re-shaded sample."""

CHANNELS_READ = (*SURFACE, "prev_position")
"""Channels that the source has to have."""

_MOVED = ("position", "normal", "geometric_normal", "prev_position")
"""Of these, channels of the current frame."""

_DISCARDED = int(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL | Reason.SKY)
_FORMATS = {"f4": "rgba32f", "f2": "rgba16f"}


class Reshade:
    """Textures of RESHADED for the frames of one source."""

    def __init__(self, context: GpuContext, source: RasterSource, settings: Settings):
        self._hazards, self._source, self._settings = context.gpu.hazards, source, settings
        self._size, gpu = source.size, context.gpu
        width, height = source.size
        self.textures = {name: input_texture(gpu, name, source.size) for name in RESHADED}
        self._link = gpu.ctx.buffer(reserve=4 * width * height)
        self._surface = {name: self._texture(gpu.ctx, name) for name in SURFACE}
        self._light = {name: self._texture(gpu.ctx, name) for name in source.light.written}
        group = Tuning(gpu.software).shading_group

        def make(name: str, grid: tuple[int, int], *channels: str, **access: str) -> ComputePass:
            p = ComputePass("reuse reshade", (f"reuse/{name}.comp.glsl",)).buffer("link", "uint", **access)
            for channel in channels:
                unsigned = channel == "mask"
                p.texture(channel, "usampler2D" if unsigned else "sampler2D")
            return p.dispatch(grid, group)

        def writing(p: ComputePass) -> ComputePass:
            for name in RESHADED:
                p.image(f"{name}_out", access=WRITE)
            return p

        blocks = (-(-width // BLOCK), -(-height // BLOCK))
        surface = make("reshade_surface", source.size, *_MOVED,
                       *(f"history_{c}" for c in SURFACE))  # fmt: skip
        for name in SURFACE:
            form = _FORMATS[self._surface[name].dtype]
            surface.image(f"surface_{name}_out", form, access=WRITE)
        lit = tuple(name for name in ("direct", "indirect") if name in self._light)
        store = make("reshade_store", source.size, *lit, *(f"history_{name}" for name in lit))
        store.define(HAS_INDIRECT="indirect" in lit)
        self._passes = {
            "clear": context.compute(writing(make("reshade_clear", source.size, access=WRITE))),
            "select": context.compute(
                make("reshade_select", blocks, "position", "history_position", "mask", "motion", access=UPDATE)
            ),
            "surface": context.compute(surface),
            "store": context.compute(writing(store)),
        }

    def _texture(self, ctx: moderngl.Context, name: str) -> moderngl.Texture:
        dtype = stored_dtype(name, self._settings.device.storage)
        texture = ctx.texture(self._size, CHANNELS[name].components, dtype=dtype)
        texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
        return texture

    def run(self, number: int, pair: Reprojection, masks: dict[str, moderngl.Texture], seed: int, valid: bool) -> None:
        """``number``: of the current frame; ``masks``: mask and motion; ``valid``: there is a previous frame."""
        size, source = self._size, self._source
        resources: dict[str, Any] = {**source.current, **masks, "link": self._link}
        resources |= {f"history_{name}": texture for name, texture in source.previous.items()}
        resources |= {f"{name}_out": texture for name, texture in self.textures.items()}
        resources |= {f"surface_{name}_out": texture for name, texture in self._surface.items()}
        self._passes["clear"].run(None, resources, size=size)
        if valid:
            self._passes["select"].run(
                None, resources, size=size, numbers=(number & 0xFFFFFFFF, seed), discarded=_DISCARDED
            )
            forward = -source.renderer.frame.view.world_from_view[:, 2]
            self._passes["surface"].run(
                None, resources, size=size, camera_delta=tuple(pair.camera_delta), forward=tuple(forward)
            )
            source.light.relight({**self._surface, **self._light}, number - 1)
            exposure = self._settings.lighting.exposure_factor
            self._passes["store"].run(None, {**resources, **self._light}, size=size, exposure=exposure)
        self._hazards.publish()

    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the last frame, for tests, row 0 at the top, at the samples' pixels of the previous frame.

        -> the current pixel that found the sample, (h, w) int64, column + row from the bottom * width, -1: none; its
        position in this frame, (h, w, 4) float32.
        """
        width, height = self._size
        link = np.frombuffer(self._link.read(), dtype=np.uint32).reshape(height, width)[::-1].astype(np.int64) - 1
        return link, read_channel(self._surface["position"], "position")

    @property
    def bytes(self) -> int:
        width, height = self._size
        textures = (*self.textures.values(), *self._surface.values(), *self._light.values())
        return width * height * (4 + sum(t.components * int(t.dtype[1]) for t in textures))

    def release(self) -> None:
        parts = (*self._passes.values(), *self.textures.values(), *self._surface.values(), *self._light.values())
        for part in (*parts, self._link):
            part.release()
