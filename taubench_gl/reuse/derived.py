"""Inputs that are computed from the channels of a frame: lobes of light, albedos, masks of upscalers."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.frame.tuning import Tuning
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import WRITE, ComputePass
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.metrics.lighting import albedo_table
from taubench_gl.reuse.frame import INPUTS, MAX_REACTIVE, MIN_ALBEDO
from taubench_gl.scene.model import Scene

NEEDS: dict[str, tuple[str, ...]] = {
    "diffuse_demodulated": ("diffuse", "diffuse_albedo"),
    "specular_demodulated": ("specular", "specular_albedo"),
}
"""Input -> inputs that it is computed from."""

LOBES = {"diffuse": ("direct_diffuse", "indirect_diffuse"), "specular": ("direct_glossy", "indirect_glossy")}
"""Input -> the channels that it is the sum of."""

COMPOSED = ("direct", "diffuse", "specular", "emitted", "sample_count", "hit_distance", "variance")
"""Written together with ``radiance``."""

SURFACE = ("diffuse_albedo", "specular_albedo", "reactive", "transparency")
DERIVED = (*COMPOSED, *SURFACE, *NEEDS)

_SURFACE_CHANNELS = ("position", "normal", "base_color", "material")
_FORMATS = {1: "r32f", 2: "rg32f", 4: "rgba32f"}


def with_needs(reads: Collection[str]) -> tuple[str, ...]:
    """Those of DERIVED that ``reads`` contains or needs."""
    wanted = {*reads, *(need for name in reads for need in NEEDS.get(name, ()))}
    return tuple(name for name in DERIVED if name in wanted)


def channels_for(reads: Collection[str]) -> tuple[str, ...]:
    """Channels of a frame that the derived inputs among ``reads`` are computed from."""
    wanted = with_needs(reads)
    out = {channel for name in wanted for channel in LOBES.get(name, ())}
    out |= set(_SURFACE_CHANNELS) if set(wanted) & set(SURFACE) else set()
    out |= {"ids"} if "reactive" in wanted else set()
    return tuple(sorted(out))


def input_texture(gpu: Gpu, name: str, size: tuple[int, int]) -> moderngl.Texture:
    """A texture for input ``name``, without filtering."""
    info = INPUTS[name]
    texture = gpu.ctx.texture(size, info.components, dtype=info.dtype)
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture


class DerivedInputs:
    """Textures of albedos, masks and demodulated light; ``composed``: textures of diffuse and specular light."""

    def __init__(self, context: GpuContext, size: tuple[int, int], reads: Collection[str], scene: Scene):
        self._hazards, self._size = context.gpu.hazards, size
        wanted = with_needs(reads)
        surface = tuple(name for name in SURFACE if name in wanted)
        demodulated = tuple(name for name in NEEDS if name in wanted)
        self.textures = {name: input_texture(context.gpu, name, size) for name in (*surface, *demodulated)}
        self._tables: dict[str, moderngl.Texture | moderngl.Buffer] = {}
        self._surface = self._demodulate = None
        group = Tuning(context.gpu.software).shading_group
        if surface:
            declaration = ComputePass("reuse surface", ("reuse/surface.comp.glsl",))
            for name in (*_SURFACE_CHANNELS, "albedo_table"):
                declaration.texture(name)
            if "reactive" in surface:
                declaration.texture("ids", "usampler2D").buffer("blended", "uint")
                flags = [0, *(m.alpha_mode == "BLEND" for m in scene.materials)]
                self._tables["blended"] = context.gpu.ctx.buffer(np.array(flags, dtype=np.uint32).tobytes())
            declaration.glsl(f"const float MIN_ALBEDO = {MIN_ALBEDO}, MAX_REACTIVE = {MAX_REACTIVE};")
            self._surface = context.compute(_writing(declaration, surface, SURFACE).dispatch(size, group))
            table = albedo_table()
            texture = context.gpu.ctx.texture(table.shape[1::-1], 4, table.tobytes(), dtype="f4")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self._tables["albedo_table"] = texture
        if demodulated:
            declaration = ComputePass("reuse demodulate", ("reuse/demodulate.comp.glsl",))
            for name in (need for output in demodulated for need in NEEDS[output]):
                declaration.texture(name)
            self._demodulate = context.compute(_writing(declaration, demodulated, tuple(NEEDS)).dispatch(size, group))

    def run(self, channels: Mapping[str, moderngl.Texture], view: View) -> None:
        """``channels``: of the current frame, and the composed light."""
        resources = {**channels, **self._tables, **self.textures, **written(self.textures)}
        if self._surface is not None:
            values = {"size": self._size}
            if {"specular_albedo", "transparency"} & self.textures.keys():  # GL removes unused uniforms
                values["parallel_view"] = view.towards_parallel_camera
            self._surface.run(None, resources, **values)
        if self._demodulate is not None:
            self._demodulate.run(None, resources, size=self._size)
        self._hazards.publish()

    @property
    def bytes(self) -> int:
        pixels = self._size[0] * self._size[1]
        return sum(pixels * INPUTS[name].components * int(INPUTS[name].dtype[1]) for name in self.textures)

    def release(self) -> None:
        for item in (self._surface, self._demodulate, *self.textures.values(), *self._tables.values()):
            if item is not None:
                item.release()


def written(textures: Mapping[str, moderngl.Texture]) -> dict[str, moderngl.Texture]:
    """``textures`` by the names of images in shaders: an input can have the name of a channel."""
    return {f"{name}_out": texture for name, texture in textures.items()}


def declare_composed(declaration: ComputePass, wanted: Collection[str], channels: Collection[str]) -> ComputePass:
    """What the pass that writes ``radiance`` reads and writes for those of COMPOSED that are ``wanted``."""
    lobes = {c for name in LOBES if name in wanted for c in LOBES[name]}
    declaration.define(**{f"HAS_{c.upper()}": c in lobes and c in channels for pair in LOBES.values() for c in pair})
    for name in sorted(lobes & set(channels)):
        declaration.texture(name)
    if {"hit_distance", "variance"} & set(wanted):
        declaration.texture("path_info")
    return _writing(declaration, tuple(n for n in COMPOSED if n in wanted), COMPOSED)


def _writing(declaration: ComputePass, outputs: Collection[str], every: Collection[str]) -> ComputePass:
    declaration.define(**{f"WRITE_{name.upper()}": name in outputs for name in every})
    for name in outputs:
        form = _FORMATS[INPUTS[name].components]
        declaration.image(f"{name}_out", form, access=WRITE)
    return declaration
