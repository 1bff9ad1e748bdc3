"""Inputs that are computed from the channels of a frame: lobes of light, albedos, masks of upscalers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import sky_directions
from taubench_gl.effects.lighting import environment_of
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.environment import declare_environment
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.declare import UPDATE, WRITE, ComputePass
from taubench_gl.lobes import REUSE_INPUTS, SCENE_LOBES, lobe_channels
from taubench_gl.metrics.lighting import albedo_table
from taubench_gl.metrics.shading_rate import RATES, phase
from taubench_gl.reuse.frame import INPUTS, MAX_REACTIVE, MIN_ALBEDO, input_texture
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

LIGHT_CHANNELS = ("direct", "indirect", "emission")
"""Channels that ``radiance`` is the sum of."""

NEEDS: dict[str, tuple[str, ...]] = {
    "diffuse_demodulated": ("diffuse", "diffuse_albedo"),
    "specular_demodulated": ("specular", "specular_albedo"),
}
"""Input -> inputs that it is computed from."""

LOBES = {
    name: tuple(channel for lobe in lobes if lobe in SCENE_LOBES for channel in lobe_channels((lobe,)))
    for name, lobes in REUSE_INPUTS.items()
}
"""Input -> the channels whose sum it is."""

COMPOSED = ("direct", "diffuse", "specular", "emitted", "sample_count", "hit_distance", "variance")
"""Inputs that the pass of ``radiance`` writes besides it."""

SURFACE = ("diffuse_albedo", "specular_albedo", "reactive", "transparency")
DERIVED = (*COMPOSED, *SURFACE, *NEEDS)

_SURFACE_CHANNELS = ("position", "normal", "base_color", "material")
_FORMATS = {1: "r32f", 2: "rg32f", 4: "rgba32f"}


def with_needs(reads: Collection[str]) -> tuple[str, ...]:
    """Names of DERIVED among ``reads``, and those that they are computed from, in the order of DERIVED."""
    needed = {*reads, *(need for name in reads for need in NEEDS.get(name, ()))}
    return tuple(name for name in DERIVED if name in needed)


def channels_for(reads: Collection[str]) -> tuple[str, ...]:
    """Channels of a frame that the derived inputs among ``reads`` are computed from."""
    needed = with_needs(reads)
    out = {channel for name in needed for channel in LOBES.get(name, ())}
    out |= set(_SURFACE_CHANNELS) if set(needed) & set(SURFACE) else set()
    out |= {"ids"} if "reactive" in needed else set()
    return tuple(sorted(out))


class ComposePass:
    """Computes ``radiance`` = (direct + indirect + emission, or the sky) times exposure; unshaded pixels are filled.

    ``textures``: ``radiance``, and the inputs of COMPOSED that are asked for.
    """

    def __init__(
        self,
        owner: GpuOwner,
        source: RasterSource,
        settings: Settings,
        *,
        rate: str = "full",
        accumulate: bool = False,
        derived: Collection[str] = (),
        samples: int = 1,
    ):
        """Compile the pass for frames of ``source``; ``owner`` frees it.

        ``rate``: name of the shading rate; ``accumulate``: sum weighted samples of one frame; ``derived``: inputs of
        COMPOSED to write; ``samples``: light samples in a shaded pixel.
        """
        self._hazards, self._source, self._settings = owner.gpu.hazards, source, settings
        self._rate, self._accumulate, self._samples = rate, accumulate, samples
        self._environment = environment_of(settings)
        lit = tuple(name for name in LIGHT_CHANNELS if source.effects[name].enabled)
        composed = tuple(name for name in COMPOSED if name in derived)
        lobes = {channel for name in LOBES if name in composed for channel in LOBES[name]} & set(source.channels)
        declaration = ComputePass("reuse compose", ("reuse/compose.comp.glsl",))
        declaration.define(**{f"HAS_{name.upper()}": name in lit for name in LIGHT_CHANNELS})
        declaration.define(SHADING_RATE=RATES.index(rate), ACCUMULATE=accumulate)
        for name in ("position", *lit):
            declaration.texture(name)
        declare_environment(declaration, self._environment, lobes=False, owned=False)
        declaration.image("radiance_out", access=UPDATE if accumulate else WRITE)
        for name, parts in LOBES.items():
            declaration.define(**{f"EACH_{name.upper()}(DO)": " ".join(f"DO({c})" for c in parts if c in lobes)})
        for name in sorted(lobes):
            declaration.texture(name)
        if {"hit_distance", "variance"} & set(composed):
            declaration.texture("path_info")
        _writing(declaration, composed, COMPOSED)
        declaration.dispatch(source.size, Tuning(owner.gpu.software).shading_group)
        self._pass = owner.own(owner.context.compute(declaration))
        self.textures = {n: owner.own(input_texture(owner.gpu, n, source.size)) for n in ("radiance", *composed)}

    def run(self, frame: int = 0, share: float = 1.0) -> None:
        """Write the textures for the current frame of the source.

        ``share``: weight of this sample if samples add up, negative for the first sample.
        """
        source = self._source
        values: dict[str, Any] = {"size": source.size, "exposure": self._settings.lighting.exposure_factor}
        if self._environment.kind == "image":
            rays = sky_directions(source.renderer.frame.view, *source.size)
            values |= zip(("sky_origin", "sky_dx", "sky_dy"), map(tuple, rays), strict=True)
        else:
            values["sky"] = self._environment.radiance
        if self._rate != "full":
            values["phase"] = phase(self._rate, frame)
        if self._accumulate:
            values["share"] = share
        if "sample_count" in self.textures:
            values["samples"] = float(self._samples)
        resources = {**source.renderer.frame.tables, **source.current, **_images(self.textures)}
        self._pass.run(None, resources, **values)
        self._hazards.publish()


class DerivedInputs:
    """Computes inputs from the surface of every pixel: albedos, masks of upscalers, and demodulated light."""

    def __init__(self, owner: GpuOwner, size: tuple[int, int], reads: Collection[str], scene: Scene):
        """Compile the passes for the inputs of SURFACE and NEEDS among ``reads``; ``owner`` frees them."""
        gpu, self._hazards, self._size = owner.gpu, owner.gpu.hazards, size
        needed = with_needs(reads)
        surface = tuple(name for name in SURFACE if name in needed)
        demodulated = tuple(name for name in NEEDS if name in needed)
        self.textures = {name: owner.own(input_texture(gpu, name, size)) for name in (*surface, *demodulated)}
        self._tables: dict[str, moderngl.Texture | moderngl.Buffer] = {}
        self._surface = self._demodulate = None
        group = Tuning(gpu.software).shading_group
        if surface:
            declaration = ComputePass("reuse surface", ("reuse/surface.comp.glsl",))
            for name in (*_SURFACE_CHANNELS, "albedo_table"):
                declaration.texture(name)
            if "reactive" in surface:
                declaration.texture("ids", "usampler2D").buffer("blended", "uint")
                flags = [0, *(m.alpha_mode == "BLEND" for m in scene.materials)]
                self._tables["blended"] = owner.own(gpu.ctx.buffer(np.array(flags, dtype=np.uint32).tobytes()))
            declaration.glsl(f"const float MIN_ALBEDO = {MIN_ALBEDO}, MAX_REACTIVE = {MAX_REACTIVE};")
            declaration = _writing(declaration, surface, SURFACE).dispatch(size, group)
            self._surface = owner.own(owner.context.compute(declaration))
            table = albedo_table()
            self._tables["albedo_table"] = owner.own(gpu.texture(table.shape[1::-1]))
            self._tables["albedo_table"].write(table.tobytes())
        if demodulated:
            declaration = ComputePass("reuse demodulate", ("reuse/demodulate.comp.glsl",))
            for name in (need for output in demodulated for need in NEEDS[output]):
                declaration.texture(name)
            declaration = _writing(declaration, demodulated, tuple(NEEDS)).dispatch(size, group)
            self._demodulate = owner.own(owner.context.compute(declaration))

    def run(self, channels: Mapping[str, moderngl.Texture], view: View) -> None:
        """Write ``textures`` from the ``channels`` of the current frame and its composed light, seen from ``view``."""
        resources = {**channels, **self._tables, **self.textures, **_images(self.textures)}
        if self._surface is not None:
            values = {"size": self._size}
            if {"specular_albedo", "transparency"} & self.textures.keys():  # GL removes unused uniforms
                values["parallel_view"] = view.towards_parallel_camera
            self._surface.run(None, resources, **values)
        if self._demodulate is not None:
            self._demodulate.run(None, resources, size=self._size)
        self._hazards.publish()


def _images(textures: Mapping[str, moderngl.Texture]) -> dict[str, moderngl.Texture]:
    """``textures`` by the names of images in shaders: an input can have the name of a channel."""
    return {f"{name}_out": texture for name, texture in textures.items()}


def _writing(declaration: ComputePass, outputs: Collection[str], every: Collection[str]) -> ComputePass:
    declaration.define(**{f"WRITE_{name.upper()}": name in outputs for name in every})
    for name in outputs:
        form = _FORMATS[INPUTS[name].components]
        declaration.image(f"{name}_out", form, access=WRITE)
    return declaration
